"""Tables as people read them, and values as their files hold them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import BoolArray

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


def percent_text(value: float) -> str:
    """As many digits as tell something: 0.12 %, 4.5 %, 45.7 %, 99.98 %."""
    if not math.isfinite(value):
        return "-"
    if 0 < value < 1e-7:
        return "< 1e-5 %"
    value *= 100
    if value in (0, 100):
        return f"{value:.0f} %"
    if value > 99:
        return f"{min(value, 99.99):.2f} %"
    return f"{value:.2g} %" if value < 10 else f"{value:.1f} %"


def interval_text(row: Mapping[str, Any], name: str) -> str:
    """A rate of ``row`` with its interval: ``1.2 % (0.9 to 1.5)``."""
    return _ends_text(row, name, "low", "high")


def quartiles_text(row: Mapping[str, Any], name: str) -> str:
    """A median of ``row`` with its quartiles: ``1.2 % (0.9 to 1.5)``."""
    return _ends_text(row, name, "q25", "q75")


def _ends_text(row: Mapping[str, Any], name: str, *ends: str) -> str:
    if not math.isfinite(row[name]):
        return "-"
    low, high = (percent_text(row[f"{name}_{end}"]).removesuffix(" %") for end in ends)
    return f"{percent_text(row[name])} ({low} to {high})"


def kilometres_text(metres: float) -> str:
    """Whole kilometres; a dash where the length is not known."""
    return f"{metres / 1e3:.0f}" if math.isfinite(metres) else "-"


def markdown_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown under a line that says what it is."""
    lines = [f"**{title}**", "", f"| {' | '.join(header)} |", f"|{'---|' * len(header)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows), ""])
