"""The progress bar of a run: shown if the error stream is a terminal, silent otherwise."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING

from pareto_ltl.run.watching import Found, watcher

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


class ProgressBar:
    """One line for the present stage, on the error stream of a terminal.

    A call with ``(done, total)`` moves the bar of the stage; a text beside it describes the result so
    far, or has both counts, and ``found`` has the failure rate and the positions (T+1, 2) [m] of each of its
    paths.
    """

    def __init__(self, shown: bool | None = None) -> None:
        self._shown = sys.stderr.isatty() if shown is None else shown
        self._bar: Progress | None = None
        self._task: TaskID | None = None

    def __enter__(self) -> ProgressBar:
        if self._shown:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

            columns = (
                SpinnerColumn(),
                TextColumn("{task.description:<14}"),
                BarColumn(),
                TimeElapsedColumn(),
                TextColumn("{task.fields[state]}"),
            )
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Show ``name`` for the duration of the block."""
        watcher().stage(name)
        if self._bar is None:
            yield
            return
        outer, self._task = self._task, self._bar.add_task(name, total=None, state="")
        try:
            yield
        finally:
            self._bar.remove_task(self._task)
            self._task = outer

    def __call__(self, done: int, total: int, state: str = "", found: Found = ()) -> None:
        """Move the bar of the stage to ``done`` of ``total``; write ``state`` beside it, or both counts."""
        watcher().progress(done, total, state, found)
        if self._bar is not None and self._task is not None:
            counts = state or f"{done:,} of {total:,}"
            self._bar.update(self._task, completed=done, total=total, state=counts)
