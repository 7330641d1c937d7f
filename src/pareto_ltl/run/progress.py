"""Progress of a run: a bar if the error stream is a terminal, and a watcher."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, TypeAlias

from careful_io.machine import cores
from pareto_ltl.run.compile_costs import COSTS
from typed_kernels.compile_time import CompileTime, seconds_text
from typed_kernels.watching import compilation_watched

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.progress import Progress, TaskID

    from pareto_ltl.support.arrays import FloatArray

Found = Sequence[tuple[float, "FloatArray"]]  # failure rates on the flights of the search, and paths
BAR_WIDTH = 14  # columns; the rest of a line of 80 is for the words


class Watcher:
    """The calls that a run makes while it works; this one ignores them."""

    Found: TypeAlias = Found

    def stage(self, name: str) -> None:
        """The stage ``name`` begins, or goes on."""

    def progress(self, done: int, total: int, state: str, found: Found) -> None:
        """The present stage has done ``done`` of ``total``; ``state`` and ``found`` are the result so far."""

    def made(self, name: str, records: Mapping[str, Any]) -> None:
        """The record ``name`` was made; ``records`` has it and all before."""


class Caller(Watcher):
    """Calls ``call`` with the name of the stage, what is done of which total, and a text on the result."""

    def __init__(self, call: Callable[[str, int, int, str], None]) -> None:
        self._call, self._stage = call, ""

    def stage(self, name: str) -> None:
        """Call with 0 of 0."""
        self._stage = name
        self._call(name, 0, 0, "")

    def progress(self, done: int, total: int, state: str, found: Found) -> None:  # noqa: ARG002 - as a Watcher
        """Call with the counts."""
        self._call(self._stage, done, total, state)


_WATCHER: ContextVar[Watcher | None] = ContextVar("_WATCHER", default=None)


@contextmanager
def watched_by(watcher: Watcher) -> Iterator[None]:
    """Let ``watcher`` follow the runs of command lines in the block."""
    token = _WATCHER.set(watcher)
    try:
        yield
    finally:
        _WATCHER.reset(token)


class ProgressBar:
    """One line for the present stage, on the error stream of a terminal.

    A call with ``(done, total)`` moves the bar of the stage; a text beside it describes the result so
    far, or has both counts, and ``found`` has the failure rate and the positions (T+1, 2) [m] of each of its
    paths.
    """

    def __init__(
        self, shown: bool | None = None, preset: str = "full", watcher: Watcher | None = None
    ) -> None:
        self._watcher = watcher or _WATCHER.get() or Watcher()
        self._stages: list[str] = []
        self._shown = sys.stderr.isatty() if shown is None else shown
        self._preset = preset  # whose kernels are compiled in a first run
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        self._compiling: TaskID | None = None
        self._time: CompileTime | None = None
        self._watching = ExitStack()

    def __enter__(self) -> ProgressBar:
        if self._shown:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
            from rich.table import Column

            show_compiling = self._show_compiling

            class Lines(Progress):
                """Asks for the time of the compilation whenever it is drawn."""

                def get_renderables(self) -> Iterable[RenderableType]:
                    show_compiling()
                    return super().get_renderables()

            columns = (
                SpinnerColumn(),
                TextColumn("{task.description}", table_column=Column(no_wrap=True)),
                BarColumn(BAR_WIDTH),
                TimeElapsedColumn(Column(min_width=len("0:00:00"))),
                TextColumn("{task.fields[state]}", table_column=Column(ratio=1)),
            )
            self._bar = Lines(*columns, console=Console(stderr=True), transient=True)
            self._bar.start()
            self._watching.enter_context(compilation_watched(self._begins, self._ends))
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Take the bar away, so that other text can be printed; the watcher hears of further stages."""
        self._watching.close()
        if self._bar is not None:
            self._bar.stop()
            self._bar = self._task = None

    @contextmanager
    def stage(self, name: str, words: str = "") -> Iterator[None]:
        """Show ``words`` about the stage ``name``, by default its name, for the duration of the block."""
        self._stages.append(name)
        self._watcher.stage(name)
        outer = self._task
        if self._bar is not None:
            self._task = self._bar.add_task(words or name.replace("_", " "), total=None, state="")
        try:
            yield
        finally:
            if self._bar is not None and self._task is not None:
                self._bar.remove_task(self._task)
            self._task = outer
            self._stages.pop()
            if self._stages:
                self._watcher.stage(self._stages[-1])

    def made(self, name: str, records: Mapping[str, Any]) -> None:
        """Tell the watcher that the record ``name`` was made."""
        self._watcher.made(name, records)

    def __call__(self, done: int, total: int, state: str = "", found: Found = ()) -> None:
        """Move the bar of the stage to ``done`` of ``total``; write ``state`` beside it, or both counts."""
        self._watcher.progress(done, total, state, found)
        if self._bar is not None and self._task is not None:
            counts = state or f"{done:,} of {total:,}"
            self._bar.update(self._task, completed=done, total=total, state=counts)

    # --- what is compiled ---

    def _begins(self, kernel: str) -> None:
        """Show that ``kernel`` is compiled, in place of the stage that waits for it."""
        from typed_kernels.code_cache import has_code

        if self._bar is None:
            return
        if self._time is None:
            self._time = CompileTime(COSTS.get(self._preset, {}), has_code, min(cores(), 2))
        self._time.begins(kernel)
        if self._compiling is None:
            self._compiling = self._bar.add_task("", total=1.0, state="")
        words = f"Compiling {kernel.partition('.')[2] or kernel}"
        self._bar.update(self._compiling, description=words)
        self._show(self._task, visible=False)

    def _ends(self, kernel: str) -> None:
        """Show the stage again if nothing else is compiled."""
        if self._bar is None or self._time is None:
            return
        self._time.ends(kernel)
        if not self._time.busy and self._compiling is not None:
            self._bar.remove_task(self._compiling)
            self._compiling = None
            self._show(self._task, visible=True)

    def _show(self, task: TaskID | None, *, visible: bool) -> None:
        if self._bar is not None and task is not None:
            self._bar.update(task, visible=visible)

    def _show_compiling(self) -> None:
        """Bar and words of the compilation, as they are now."""
        if self._bar is not None and self._time is not None and self._compiling is not None:
            number = f"{min(self._time.done + 1, self._time.total)} of {self._time.total}"
            words = f"{number}, once; {seconds_text(self._time.left())} left"
            self._bar.update(self._compiling, completed=self._time.share(), state=words)
