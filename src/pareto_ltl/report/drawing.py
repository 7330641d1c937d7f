"""The figures of a run as files, drawn by a second process that imports matplotlib while the trees grow.

It receives records, draws them and sends the files back: the run itself writes them. So if one of the two
processes ends for any reason, no file is half-written and nothing is written after the run.
"""

from __future__ import annotations

import logging
import os
import sys
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields
from typing import TYPE_CHECKING, Any, BinaryIO

from pareto_ltl.report.records import DrawnRun
from pareto_ltl.support.files import write_bytes
from pareto_ltl.support.second_process import (
    begin_process,
    can_be_sent,
    can_begin_one,
    end_process,
    receive,
    requests,
    send,
)

if TYPE_CHECKING:
    from pathlib import Path

    from pareto_ltl.settings import ReportConfig, Settings

LOG = logging.getLogger(__name__)
PROGRAM = "from pareto_ltl.report.drawing import serve; serve()"
MATPLOTLIB = "matplotlib.figure"  # the module that takes long to import
SHOWN = {part.name: part.name for part in fields(DrawnRun)} | {"deployment": "deployments"}  # by record name
FILE, DONE, FAILED = "file", "done", "failed"  # kinds of answers of the drawing process


def draw_run_figures(
    folder: Path, cfg: ReportConfig, run: DrawnRun, process: DrawingProcess | None = None
) -> tuple[Path, ...]:
    """Write the figures of ``run`` into ``folder``, each in ``report.formats``; return the paths.

    ``process`` draws them. If there is none, or if it has been killed, this process draws them.
    """
    if process is not None:
        try:
            return _write_files(folder, process.figures(run))
        except DrawingEndedError as error:
            LOG.warning("the run draws the figures itself: %s", error)
    from pareto_ltl.report.figures import run_figures

    return _write_files(folder, run_figures(cfg, run))


def _write_files(folder: Path, files: Iterator[tuple[str, bytes]]) -> tuple[Path, ...]:
    """Write each file (name, content) into ``folder`` as it comes; return the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, content in files:
        write_bytes(folder / name, content)
        paths.append(folder / name)
    return tuple(paths)


class DrawingEndedError(Exception):
    """The drawing process has ended without an answer."""


class _ElsewhereError(Exception):
    """The traceback of an error in the drawing process, as the cause of the same error here."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


class DrawingProcess:
    """A second process that draws the figures of a run, some of them before the run has its last record."""

    def __init__(self, cfg: ReportConfig) -> None:
        self._process = begin_process(PROGRAM)
        self._made: dict[str, Any] = {}
        self._sent: dict[str, Any] = {}
        self._ask(cfg)

    @property
    def number(self) -> int:
        """Its process id."""
        return self._process.pid

    def record_made(self, name: str, record: Any) -> None:
        """Keep a record that figures show; send all records from the trees on (until then it imports)."""
        if name in SHOWN:
            self._made[SHOWN[name]] = record
            if "forest" in self._made:
                with suppress(BrokenPipeError):  # an end of the process is noticed when figures are due
                    self._send_records(self._made)

    def figures(self, run: DrawnRun) -> Iterator[tuple[str, bytes]]:
        """What :func:`pareto_ltl.report.figures.run_figures` yields; its errors and warnings appear here.

        Raises
        ------
        DrawingEndedError
            If the process has ended without an answer, for example killed by another program.
        """
        answers = self._process.stdout
        try:
            self._send_records({part.name: getattr(run, part.name) for part in fields(run)})
            self._ask(None)
            while (answer := receive(answers))[0] == FILE:
                yield answer[1], answer[2]
        except (EOFError, BrokenPipeError) as error:
            code = self._process.wait()
            raise DrawingEndedError(f"the drawing process ended with exit code {code}") from error
        kind, warned, failure, told = answer
        for warning in warned:
            warnings.warn_explicit(*warning)
        if kind == FAILED:
            raise failure from _ElsewhereError(told)

    def _send_records(self, records: Mapping[str, Any]) -> None:
        for name, record in records.items():
            if self._sent.get(name, self) is not record:
                self._ask((name, record))
                self._sent[name] = record

    def _ask(self, request: Any) -> None:
        send(self._process.stdin, request)

    def end(self) -> None:
        """End the process at once."""
        end_process(self._process)


@contextmanager
def drawing_process(settings: Settings) -> Iterator[DrawingProcess | None]:
    """A drawing process for the duration of the block; None if a run is as fast without one.

    That is the case without figures; on one core, which a job of a sweep often has; if matplotlib is already
    imported, as in a notebook or in a process that runs several jobs; in a program that cannot start its own
    Python interpreter; and if no process can be started.
    """
    process = None
    if settings.report.figures and MATPLOTLIB not in sys.modules and can_begin_one():
        with suppress(OSError):
            process = DrawingProcess(settings.report)
    try:
        yield process
    finally:
        if process is not None:
            process.end()


# --- in the drawing process --------------------------------------------------------------------


def serve() -> None:
    """Read the report settings from the standard input, then records as (name, record), and draw them.

    None instead of a record asks for the figures. The answers on the standard output are (FILE, name,
    content) for each file, then (DONE or FAILED, warnings, the error or None, its traceback).
    """
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # output of a library must not mix with the answers
    asked = requests()
    cfg = asked.get()
    with suppress(Exception):  # an error appears again when a figure is drawn
        _warm_up(cfg.formats)
    from pareto_ltl.report.figures import FiguresOfRecords

    figures = FiguresOfRecords(cfg)
    with warnings.catch_warnings(record=True) as caught:
        while True:
            request = asked.get()
            if request is not None:
                figures.add(*request)
                continue
            outcome = _send_files(answers, figures.files())
            warned = [(str(one.message), one.category, one.filename, one.lineno) for one in caught]
            caught.clear()
            _send(answers, (outcome[0], warned, *outcome[1:]))


def _warm_up(formats: Sequence[str]) -> None:
    """Import what figures need, and load fonts and the writers of ``formats``."""
    import pyproj

    from pareto_ltl.report import figures, style

    assert figures
    assert pyproj
    with style.report_style():
        figure = style.blank_figure(1.0, 1.0)
        style.axes_at(figure, 0.3, 0.3, 0.6, 0.6).set_title("x", fontweight="bold")
        for kind in formats:
            style.figure_bytes(figure, kind, 30)


def _send_files(answers: BinaryIO, files: Iterator[tuple[str, bytes]]) -> tuple[str, Exception | None, str]:
    """Send each file when it is drawn; return DONE or FAILED, the error or None, and its traceback."""
    try:
        for name, content in files:
            _send(answers, (FILE, name, content))
    except Exception as error:
        return FAILED, _sendable(error), traceback.format_exc()
    return DONE, None, ""


def _sendable(error: Exception) -> Exception:
    """``error``, or a RuntimeError with its text if it cannot be sent."""
    return error if can_be_sent(error) else RuntimeError(f"{type(error).__name__}: {error}")


def _send(answers: BinaryIO, answer: tuple[Any, ...]) -> None:
    try:
        send(answers, answer)
    except BrokenPipeError:
        os._exit(0)  # the run has ended
