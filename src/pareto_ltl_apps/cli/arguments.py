"""Arguments of commands: a parser whose errors are one line, and readers of values with a unit or a range."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn, TypeVar

from careful_io.messages import shown_text, shown_value, wrong_value
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.exports.kinds import format_names

METRES = {"": 1.0, "m": 1.0, "km": 1e3, "nmi": 1852.0}
NUMBER = r"[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?|\.[0-9]+"
LENGTH = re.compile(rf"({NUMBER})\s*(|m|km|nmi)")
HELP_FLAGS = {"-h": "short", "--help": "short", "--help=all": "all", "--help-all": "all"}
SHARE = re.compile(rf"({NUMBER})\s*(%?)")
Value = TypeVar("Value", int, float, str)


class CommandArguments(argparse.ArgumentParser):
    """An argument parser that raises ConfigError instead of leaving the program."""

    def error(self, message: str) -> NoReturn:
        """Raise ConfigError with ``message`` and the command for help."""
        raise ConfigError(f"{message}; see {self.prog} --help")


class ToolArguments(CommandArguments):
    """The parser of a command with arguments, which has no short flag except ``-h``.

    Any other word that begins with one minus sign is a value: half of all coordinates are negative.
    """

    def _parse_optional(self, arg_string: str) -> Any:
        """What :mod:`argparse` asks of each word: None says that it is not a flag."""
        if arg_string.startswith("-") and arg_string[1:2] != "-" and arg_string != "-h":
            return None
        return super()._parse_optional(arg_string)


def accepted(
    kind: Callable[[str], Value], accepts: Callable[[Value], bool], meaning: str
) -> Callable[[str], Value]:
    """A reader of values that ``accepts`` is true for; the message for any other text says ``meaning``."""

    def read(text: str) -> Value:
        with suppress(ValueError):
            if accepts(value := kind(text)):
                return value
        raise argparse.ArgumentTypeError(f"{shown_text(text)} is not {meaning}")

    return read


def read_share(text: str, flag: str = "--failure") -> float:
    """A probability from ``0.02`` or ``2%``; raises ConfigError for anything else."""
    match = SHARE.fullmatch(text.strip())
    value = float(match[1]) / (100.0 if match[2] else 1.0) if match else -1.0
    if not 0.0 < value < 1.0:
        raise wrong_value(flag, "be a probability between 0 and 1, e.g. 0.02 or 2%", text)
    return value


def read_length(text: str, flag: str = "--length") -> float:
    """A length [m] from ``1900km``, ``1.9e6`` or ``1020nmi``; raises ConfigError for anything else."""
    match = LENGTH.fullmatch(text.strip())
    value = float(match[1]) * METRES[match[2]] if match else 0.0
    if not 0.0 < value <= 1e9:
        raise wrong_value(flag, "be a length in m, km or nmi, e.g. 1900km", text)
    return value


def read_number(text: str) -> int:
    """The number of a path; raises ConfigError for anything else."""
    if not (text.isascii() and text.isdigit()) or len(text) > 6:
        raise wrong_value("--point", "be the number of a path in front.csv, e.g. 3", text)
    return int(text)


def read_fix(text: str) -> tuple[float, ...]:
    """Three numbers; raises ConfigError for anything else."""
    with suppress(ValueError):
        if len(numbers := tuple(map(float, text.split(",")))) == 3:
            return numbers
    raise wrong_value("--fix", "be LAT,LON,SD (or X,Y,SD), e.g. 37.5,-93.2,500", text)


def read_formats(text: str) -> list[str]:
    """The formats of ``kml,gpx``; raises ConfigError for an unknown name."""
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in format_names():
            raise ConfigError(
                f"--formats: there is no format {shown_value(name)}; there are {', '.join(format_names())}"
            )
    return list(dict.fromkeys(names))


def read_metres(flag: str, text: str) -> float:
    """A height [m]; raises ConfigError for anything except a number."""
    try:
        return float(text)
    except ValueError:
        raise wrong_value(flag, "be a height in metres, e.g. 120", text) from None
