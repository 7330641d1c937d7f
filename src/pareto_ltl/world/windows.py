"""Time windows: when a region or an obstacle is active; and deadlines in formulas, such as ``F[0,6h] a``.

``F[0,6h] a`` is true if a is met between departure and six hours after it. A time span is translated into
clocks, propositions that depend only on the time. With c "now is in the span" and d "the span is over"::

    F[b,e] p = F(c & p),    G[b,e] p = (c -> p) U d

The second formula is co-safe, as it is decided after e. Times count from departure, so a time span is not
allowed below another temporal operator.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.support.times import (
    UNITS,
    duration_seconds,
    hours_text,
    seconds_after,
)

Span = tuple[float, float]

ROUNDING = 1e-6  # [s] tolerance at the ends of a window
AFTER = 1e-3  # [s] time from the end of a span to the begin of its end clock
_CLOCK = re.compile(r"clock_(\d+(?:p\d+)?)_(\d+(?:p\d+)?|on)")


@dataclass(frozen=True, slots=True)
class Window:
    """The proposition "in ``region``, between ``begin`` and ``end``"; without a region, a clock.

    Attributes
    ----------
    region : str or None
        Name of the region; None for a proposition that depends only on the time.
    begin, end : float
        First and last moment [s after departure]; -inf and inf for no limit.
    """

    region: str | None
    begin: float = -math.inf
    end: float = math.inf

    def holds_at(self, time: float) -> bool:
        """Whether ``time`` [s after departure] is in the window; the ends are included."""
        return self.begin - ROUNDING <= time <= self.end + ROUNDING

    def meets(self, first: float, last: float) -> bool:
        """Whether some moment between ``first`` and ``last`` [s after departure] is in the window."""
        return self.begin - ROUNDING <= last and first <= self.end + ROUNDING

    def later(self, moment: float) -> Window:
        """The window for times that count from ``moment`` [s after departure]."""
        return replace(self, begin=self.begin - moment, end=self.end - moment)

    def as_dict(self) -> dict[str, Any]:
        """The window as a dictionary for JSON; infinite ends are None."""
        ends = {"begin": self.begin, "end": self.end}
        return {"region": self.region} | {k: v if math.isfinite(v) else None for k, v in ends.items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Window:
        """The inverse of :meth:`as_dict`."""
        begin, end = data.get("begin"), data.get("end")
        return cls(
            data.get("region"), -math.inf if begin is None else begin, math.inf if end is None else end
        )

    def __str__(self) -> str:
        place = "" if self.region is None else f"in {self.region} "
        return f"{place}{span_text(self.begin, self.end)}"


@dataclass(frozen=True, slots=True)
class TimedPlace:
    """A window as written in a map, before the departure time is known.

    Attributes
    ----------
    name : str
        Name of the proposition; the name of the region if the window limits the region itself.
    region : str
        Name of the region.
    begin, end : str, float or None
        ISO 8601 times (UTC), or times after departure: seconds, or a text such as ``6h``; None: no limit.
    forbidden : bool
        Whether the place must not be met within the window: an obstacle that is active for a limited time.
    """

    name: str
    region: str
    begin: str | float | None = None
    end: str | float | None = None
    forbidden: bool = False

    def window(self, where: str, departure: str | None) -> Window:
        """The window in seconds after ``departure`` (ISO 8601, UTC); ``where`` begins error messages.

        DataError if a limit is not a time, or the window is empty.
        """
        what = f"{where}: {shown_text(self.name)!r}"
        begin = -math.inf if self.begin is None else seconds_after(f"{what}: from", self.begin, departure)
        end = math.inf if self.end is None else seconds_after(f"{what}: until", self.end, departure)
        if begin >= end:
            raise DataError(
                f"{what}: the time window from {self.begin} until {self.end} is empty; expected from < until"
            )
        return Window(self.region, begin, end)


def missed_windows(windows: Mapping[str, Window], last: float) -> list[str]:
    """One message for each window that lies before departure or after ``last`` [s], the longest plan."""
    lines = []
    for name, window in windows.items():
        if window.end < 0.0:
            when = f"ended {hours_text(-window.end)} before the departure"
        elif window.begin > last:
            when = (
                f"begins {hours_text(window.begin)} after departure, and a plan ends after {hours_text(last)}"
            )
        else:
            continue
        lines.append(f"the time window of {name!r} {when}: it never holds")
    return lines


def span_text(begin: float, end: float) -> str:
    """Times [s after departure] as text: ``from 2 h until 6 h after departure``."""
    if math.isinf(begin) and math.isinf(end):
        return "at any time"
    first = "" if math.isinf(begin) else f"from {hours_text(begin)} "
    last = "on" if math.isinf(end) else f"until {hours_text(end)}"
    return f"{first}{last} after departure".replace("  ", " ")


# --- clocks of formulas -----------------------------------------------------------------------------


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
