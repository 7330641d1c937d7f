"""Time spans of formulas, such as ``F[0,6h] a``, and the clocks that they are translated into.

``F[0,6h] a`` is true if a is met between the start and six hours after it. A time span is translated into
clocks, propositions that depend only on the time. With c "now is in the span" and d "the span is over"::

    F[b,e] p = F(c & p),    G[b,e] p = (c -> p) U d

The second formula is co-safe, as it is decided after e. Times count from the start of the word, so a time
span is not allowed below another temporal operator.
"""

from __future__ import annotations

import math
import re

Span = tuple[float, float]  # begin and end [s after the start]

AFTER = 1e-3  # [s] time from the end of a span to the begin of its end clock
UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
_LIMIT = re.compile(r"([+-]?\d+(?:\.\d*)?|\.\d+)\s*(s|min|h|d)?")
_CLOCK = re.compile(r"clock_(\d+(?:p\d+)?)_(\d+(?:p\d+)?|on)")


def read_span(text: str) -> Span | None:
    """Begin and end of ``[0,6h]`` or ``[90min, 2.5 h]`` [s]; None if ``text`` is not a time span.

    A number without a unit has the unit of the other number.
    """
    parts = text.strip().removeprefix("[").removesuffix("]").split(",")
    limits = [match for part in parts if (match := _LIMIT.fullmatch(part.strip()))]
    units = [match[2] for match in limits if match[2]]
    if len(parts) != 2 or len(limits) != 2 or not units:
        return None
    begin, end = (float(match[1]) * UNITS[match[2] or units[-1]] for match in limits)
    return (begin, end) if 0.0 <= begin < end else None


def shown_span(span: Span) -> str:
    """A span as text, e.g. ``[0,6h]``, which :func:`read_span` can read."""
    unit = next(u for u in ("d", "h", "min", "s") if u == "s" or all((t / UNITS[u]) % 0.5 == 0 for t in span))
    begin, end = (f"{t / UNITS[unit]:.15g}" for t in span)
    return f"[{begin},{end}{unit}]"


def clock_name(begin: float, end: float) -> str:
    """Name of the clock "now is between ``begin`` and ``end``" [s after the start], ``clock_0_21600``."""
    first, last = (f"{round(t, 3):.15g}".replace(".", "p") for t in (begin, end))
    return f"clock_{first}_{'on' if math.isinf(end) else last}"


def span_clock(span: Span) -> str:
    """Name of the clock "now is in the span"."""
    return clock_name(*span)


def end_clock(span: Span) -> str:
    """Name of the clock "the span is over"."""
    return clock_name(span[1] + AFTER, math.inf)


def clock_span(name: str) -> Span | None:
    """The span in which the clock of this ``name`` holds; None for another proposition."""
    match = _CLOCK.fullmatch(name)
    if match is None:
        return None
    return _seconds(match[1]), math.inf if match[2] == "on" else _seconds(match[2])


def _seconds(text: str) -> float:
    return float(text.replace("p", "."))
