"""What commands print: text for people, more of it, paths alone, or one JSON document for programs."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from enum import Enum
from typing import Any

from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.files import plain_data
from pareto_ltl.support.messages import shown_line


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
        For programs; :func:`~pareto_ltl.support.files.plain_data` turns it into JSON.
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


def answered(work: Callable[[], Answer], output: Output) -> int:
    """Do ``work``, print its answer in the form ``output``, and return its exit code."""
    with _standard_output_kept(output):
        answer = work()
    print_answer(answer, output)
    return answer.code


@contextmanager
def _standard_output_kept(output: Output) -> Iterator[None]:
    """Let only the answer reach the standard output."""
    if output is Output.JSON:
        with redirect_stdout(sys.stderr):
            yield
    elif output is Output.QUIET:
        with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
            yield
    else:
        yield


def print_answer(answer: Answer, output: Output) -> None:
    """Print ``answer`` to the standard output."""
    if output is Output.JSON:
        print(json.dumps(plain_data(answer.document), ensure_ascii=False, allow_nan=False, default=str))
    elif output is Output.QUIET:
        for path in answer.written:
            print(os.fspath(path))
    else:
        _print_lines(answer.lines)


def _print_lines(lines: Sequence[object]) -> None:
    console = None
    for line in lines:
        if isinstance(line, str):
            print(line)
            continue
        if console is None:
            from rich.console import Console

            console = Console(highlight=False, markup=False)
        console.print(line)


def print_problem(line: str, output: Output = Output.TEXT) -> None:
    """Print ``line`` to standard error, with the name of the program before it; for programs as JSON too."""
    line = shown_line(line)
    print(f"pareto-ltl: {line}", file=sys.stderr)
    if output is Output.JSON:
        print_answer(Answer({"error": line}), output)
