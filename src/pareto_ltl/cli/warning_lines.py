"""Warnings of the package as lines: collected for an answer, or printed as they come."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from textwrap import wrap

from pareto_ltl.cli.output import Answer

COLUMNS = 80
OURS = ("pareto_ltl", "py.warnings")  # the loggers whose warnings are shown


class WarningList(logging.Handler):
    """Retains the first line of each warning, once, in the order in which they come.

    Attributes
    ----------
    lines : list of str
        The warnings so far.
    shown : callable
        Called with each new line.
    """

    def __init__(self, shown: Callable[[str], object] = lambda _line: None) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []
        self.shown = shown

    def emit(self, record: logging.LogRecord) -> None:
        """Retain a warning; an error ends the run and has its own line."""
        line = record.getMessage().partition("\n")[0]
        if record.levelno == logging.WARNING and line not in self.lines:
            self.lines.append(line)
            self.shown(line)


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """The warnings of the package and of Python, as they come."""
    with _heard(WarningList()) as handler:
        yield handler.lines


@contextmanager
def printed_warnings() -> Iterator[None]:
    """In the block, each warning is a line on standard error when it comes, and other packages are quiet."""
    with _heard(WarningList(lambda line: print(f"Warning: {line}", file=sys.stderr, flush=True))), _quiet():
        yield


def answer_with_warnings(work: Callable[[], Answer]) -> Answer:
    """The answer of ``work``, with the warnings that it does not have yet; other packages are quiet."""
    with collected_warnings() as warnings, _quiet():
        answer = work()
    known: Sequence[str] = answer.document.get("warnings", ())
    new = [line for line in warnings if line not in known]
    if not new:
        return answer
    document = {**answer.document, "warnings": [*known, *new]}
    lines = [part for line in new for part in wrap(f"Warning: {line}", COLUMNS, break_on_hyphens=False)]
    return replace(answer, document=document, lines=[*lines, *answer.lines])


@contextmanager
def _heard(handler: WarningList) -> Iterator[WarningList]:
    loggers = [logging.getLogger(name) for name in OURS]
    for logger in loggers:
        logger.addHandler(handler)
    try:
        yield handler
    finally:
        for logger in loggers:
            logger.removeHandler(handler)


@contextmanager
def _quiet() -> Iterator[None]:
    """Without any handler, logging prints the warnings of other packages."""
    nowhere, root = logging.NullHandler(), logging.getLogger()
    root.addHandler(nowhere)
    try:
        yield
    finally:
        root.removeHandler(nowhere)
