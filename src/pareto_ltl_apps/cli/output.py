"""What commands print: text for people, more of it, paths alone, or one JSON document for programs.

Warnings are lines of an answer, or printed as they come; an error is one line and an exit code.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import tempfile
import traceback
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from enum import Enum
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from careful_io.error_lines import one_line
from careful_io.files import plain_data
from careful_io.messages import shown_line
from pareto_ltl.support.errors import ConfigError, ParetoLtlError
from pareto_ltl_apps.stopping import StoppedError, signals_raise

if TYPE_CHECKING:
    from rich.table import Table

COLUMNS = 80
OURS = (
    "pareto_ltl",
    "careful_io",
    "typed_kernels",
    "wind_laws",
    "py.warnings",
)  # the loggers whose warnings are shown
EXPECTED_ERRORS: tuple[type[Exception], ...] = (ParetoLtlError, OSError)


class Output(Enum):
    """The form of the standard output; the values are the flags that select it."""

    TEXT = ""
    VERBOSE = "--verbose"
    QUIET = "--quiet"
    JSON = "--json"


@dataclass(frozen=True, slots=True)
class Answer:
    """The result of a command.

    Attributes
    ----------
    document : mapping
        For programs; :func:`~careful_io.files.plain_data` turns it into JSON.
    lines : sequence
        For people: text, which is printed as it is, or objects that ``rich`` renders.
    written : sequence of path-like
        The files or folders that were written; all that ``--quiet`` prints.
    code : int
        The exit code.
    """

    document: Mapping[str, Any]
    lines: Sequence[object] = ()
    written: Sequence[os.PathLike[str] | str] = ()
    code: int = 0


def output_of(argv: Sequence[str]) -> tuple[Output, list[str]]:
    """The form of the output that flags in ``argv`` select, and the other words.

    Raises
    ------
    ConfigError
        If two flags exclude each other.
    """
    flags = {output.value: output for output in Output if output.value}
    chosen = list(dict.fromkeys(word for word in argv if word in flags))
    if len(chosen) > 1:
        raise ConfigError(f"{' and '.join(chosen)} exclude each other; give one of them")
    return flags[chosen[0]] if chosen else Output.TEXT, [word for word in argv if word not in flags]


Tell = Callable[[Answer], None]


def answered(work: Callable[[Tell], Answer], output: Output) -> int:
    """Do ``work``, print its answer in the form ``output``, and return its exit code.

    ``work`` may print the answer before it ends, by its argument; what it returns is then not printed. If the
    reader of the output has ended by then, as ``head`` does, the work goes on, and the error is raised
    afterwards.
    """
    told, unread, stdout = list[Answer](), list[BrokenPipeError](), sys.stdout

    def tell(answer: Answer) -> None:
        told.append(answer)
        try:
            with redirect_stdout(stdout):
                print_answer(answer, output)
                stdout.flush()
        except BrokenPipeError as error:
            unread.append(error)

    with ExitStack() as redirected:  # for programs, nothing but the answer is on the standard output
        if output is Output.JSON:
            redirected.enter_context(redirect_stdout(sys.stderr))
        elif output is Output.QUIET:
            nowhere = redirected.enter_context(open(os.devnull, "w", encoding="utf-8"))
            redirected.enter_context(redirect_stdout(nowhere))
        answer = work(tell)
    if unread:
        raise unread[0]
    if not told:
        print_answer(answer, output)
    return answer.code


def print_answer(answer: Answer, output: Output) -> None:
    """Print ``answer`` to the standard output."""
    if output is Output.JSON:
        print(json.dumps(plain_data(answer.document), ensure_ascii=False, allow_nan=False, default=str))
    elif output is Output.QUIET:
        for path in answer.written:
            print(os.fspath(path))
    else:
        for line in answer.lines:
            if isinstance(line, str):
                print(line)
            else:
                from rich.console import Console

                try:
                    Console(highlight=False, markup=False).print(line)
                except SystemExit:  # rich ends the program if the reader of the output has ended
                    raise BrokenPipeError from None


def print_problem(line: str, output: Output = Output.TEXT) -> None:
    """Print ``line`` to standard error, with the name of the program before it; for programs as JSON too."""
    line = shown_line(line)
    print(f"pareto-ltl: {line}", file=sys.stderr)
    if output is Output.JSON:
        print_answer(Answer({"error": line}), output)


def shown_table(
    header: Sequence[str], rows: Iterable[Sequence[str]], left: Container[str] = (), gap: int = 1
) -> Table:
    """A table that ``rich`` renders: numbers to the right, the columns ``left`` to the left."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, gap, 0, 0))
    for name in header:
        words = name in left
        table.add_column(name, justify="left" if words else "right", no_wrap=not words)
    for row in rows:
        table.add_row(*row)
    return table


# --- errors ----------------------------------------------------------------------------------


def run_reported(
    work: Callable[[], int],
    expected: tuple[type[Exception], ...] = EXPECTED_ERRORS,
    describe_error: Callable[[BaseException], str] = one_line,
    output: Output = Output.TEXT,
) -> int:
    """Call ``work`` and return its exit code; for an error, print one line and return the code of the error.

    The code is 2 for an ``expected`` error, 130 for an interrupt, 143 for SIGTERM, 129 for SIGHUP, 141 for a
    closed pipe and 1 for any other error, whose line names a file with the traceback.
    """
    try:
        with signals_raise():
            code = work()
            sys.stdout.flush()  # an error of the output, e.g. a full disk, is reported too
        return code
    except SystemExit as leave:  # --help and --version of argparse
        return int(leave.code or 0)
    except BrokenPipeError:  # the reader of the output, e.g. head, has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except expected as error:
        print_problem(describe_error(error), output)
        return 2
    except StoppedError as stop:
        print_problem(one_line(stop), output)
        return stop.exit_code
    except KeyboardInterrupt:
        print_problem("interrupted", output)
        return 130
    except Exception as error:
        print_problem(f"{one_line(error)} (this is a bug; the traceback is in {_write_traceback()})", output)
        return 1


def _write_traceback() -> str:
    """Write the traceback of the present error to a new temporary file; return its path."""
    handle, path = tempfile.mkstemp(prefix="pareto_ltl_", suffix=".log")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(traceback.format_exc())
    return path


# --- warnings --------------------------------------------------------------------------------


class WarningList(logging.Handler):
    """Retains the first line of each warning, once, in the order in which they come.

    Attributes
    ----------
    lines : list of str
        The warnings so far.
    shown : callable
        Called with each new line.
    """

    def __init__(self, shown: Callable[[str], object]) -> None:
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
def collected_warnings(shown: Callable[[str], object] = lambda _line: None) -> Iterator[list[str]]:
    """The warnings of the package and of Python, as they come; ``shown`` is called with each."""
    handler, loggers = WarningList(shown), [logging.getLogger(name) for name in OURS]
    for logger in loggers:
        logger.addHandler(handler)
    try:
        yield handler.lines
    finally:
        for logger in loggers:
            logger.removeHandler(handler)


@contextmanager
def printed_warnings() -> Iterator[None]:
    """In the block, each warning is a line on standard error when it comes, and other packages are quiet."""
    with collected_warnings(lambda line: print(f"Warning: {line}", file=sys.stderr, flush=True)), _quiet():
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
def _quiet() -> Iterator[None]:
    """Without any handler, logging prints the warnings of other packages."""
    nowhere, root = logging.NullHandler(), logging.getLogger()
    root.addHandler(nowhere)
    try:
        yield
    finally:
        root.removeHandler(nowhere)
