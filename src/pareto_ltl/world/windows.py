"""Time windows: when a region or an obstacle is active, or the clock of a time span in a formula holds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from careful_io.messages import shown_text
from careful_io.times import hours_text
from ltlf import clock_span
from pareto_ltl.support.departure import seconds_after
from pareto_ltl.support.errors import DataError

ROUNDING = 1e-6  # [s] tolerance at the ends of a window


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


def clock_windows(atoms: Iterable[str]) -> dict[str, Window]:
    """The windows of those ``atoms`` that are clocks of time spans in formulas (:mod:`ltlf.spans`)."""
    return {atom: Window(None, *span) for atom in atoms if (span := clock_span(atom)) is not None}
