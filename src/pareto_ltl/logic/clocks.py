"""Deadlines in formulas: ``F[0,6h] a`` is true if a is met between departure and six hours after it.

A time span is translated into clocks, propositions that depend only on the time. With c "now is in the span"
and d "the span is over"::

    F[b,e] p = F(c & p),    G[b,e] p = (c -> p) U d

The second formula is co-safe, as it is decided after e. Times count from departure, so a time span is not
allowed below another temporal operator.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from pareto_ltl.world.windows import UNITS, Window, duration_seconds

Span = tuple[float, float]

AFTER = 1e-3  # [s] time from the end of a span to the begin of its end clock
_CLOCK = re.compile(r"clock_(\d+(?:p\d+)?)_(\d+(?:p\d+)?|on)")


def clock_name(begin: float, end: float) -> str:
    """Name of the clock "now is between ``begin`` and ``end``" [s after departure], ``clock_0_21600``."""
    first, last = (f"{round(t, 3):.15g}".replace(".", "p") for t in (begin, end))
    return f"clock_{first}_{'on' if math.isinf(end) else last}"


def span_clock(span: Span) -> str:
    """Name of the clock "now is in the span"."""
    return clock_name(*span)


def end_clock(span: Span) -> str:
    """Name of the clock "the span is over"."""
    return clock_name(span[1] + AFTER, math.inf)


def clock_windows(atoms: Iterable[str]) -> dict[str, Window]:
    """The windows of those ``atoms`` that are clocks."""
    matches = {atom: _CLOCK.fullmatch(atom) for atom in atoms}
    return {
        atom: Window(None, _seconds(match[1]), math.inf if match[2] == "on" else _seconds(match[2]))
        for atom, match in matches.items() if match is not None
    }  # fmt: skip


def _seconds(text: str) -> float:
    return float(text.replace("p", "."))


def read_span(text: str) -> Span | None:
    """Begin and end of ``[0,6h]`` or ``[90min, 2.5 h]`` [s]; None if ``text`` is not a time span.

    A number without a unit has the unit of the other number.
    """
    parts = text.strip().removeprefix("[").removesuffix("]").split(",")
    units = [re.search(r"(s|min|h|d)\s*$", part) for part in parts]
    own = [unit[1] for unit in units if unit is not None]
    if len(parts) != 2 or not own:
        return None
    begin, end = (duration_seconds(part, own[-1]) for part in parts)
    return None if begin is None or end is None or not 0.0 <= begin < end else (begin, end)


def shown_span(span: Span) -> str:
    """A span as text, e.g. ``[0,6h]``, which :func:`read_span` can read."""
    unit = next(u for u in ("d", "h", "min", "s") if u == "s" or all((t / UNITS[u]) % 0.5 == 0 for t in span))
    begin, end = (f"{t / UNITS[unit]:.15g}" for t in span)
    return f"[{begin},{end}{unit}]"
