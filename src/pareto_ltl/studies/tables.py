"""Tables for people, and values in the form of files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import BoolArray
from pareto_ltl.support.display import interval_text, probability_text

# --- values in files -------------------------------------------------------------------------


def flags_to_text(values: BoolArray) -> str:
    """Flags (N,) as a text of N digits 0 and 1: small, and readable in a file."""
    return "".join("1" if value else "0" for value in values)


def text_to_flags(text: str) -> BoolArray:
    """Flags (N,) from what :func:`flags_to_text` wrote."""
    return np.asarray(np.frombuffer(text.encode(), np.uint8) == ord("1"))


def number_or_nan(value: float | None) -> float:
    """A number out of a file, where NaN is null."""
    return math.nan if value is None else float(value)


# --- values on a page ------------------------------------------------------------------------


def rate_cell(row: Mapping[str, Any], name: str) -> str:
    """A rate of ``row`` with its interval: ``1.2 % (0.9 to 1.5 %)``."""
    return _cell_with_ends(row, name, "low", "high")


def quartiles_cell(row: Mapping[str, Any], name: str) -> str:
    """A median of ``row`` with its quartiles: ``1.2 % (0.9 to 1.5 %)``."""
    return _cell_with_ends(row, name, "q25", "q75")


def _cell_with_ends(row: Mapping[str, Any], name: str, *ends: str) -> str:
    if not math.isfinite(row[name]):
        return "-"
    low, high = (row[f"{name}_{end}"] for end in ends)
    return f"{probability_text(row[name])} ({interval_text(low, high)})"


def kilometres_text(metres: float) -> str:
    """Whole kilometres; a dash where the length is not known."""
    return f"{metres / 1e3:.0f}" if math.isfinite(metres) else "-"


def markdown_table(title: str, columns: Mapping[str, Callable[[Any], str]], rows: Iterable[Any]) -> str:
    """A table in Markdown below its title: ``columns`` maps the head of a column to its cell in a row."""
    lines = [f"**{title}**", "", f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    cells = ([cell(row) for cell in columns.values()] for row in rows)
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in cells), ""])
