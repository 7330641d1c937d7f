"""The times at which propositions hold, read from the results without the planner's code."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

Label = frozenset[str]

TOUCH = 1e-6  # [s] windows are wider by this at both ends, against rounding


@dataclass(frozen=True, slots=True)
class Timetable:
    """Windows by name: region or None, first and last moment [s after departure]; the step ``dt`` [s]."""

    windows: Mapping[str, tuple[str | None, float, float]] = field(default_factory=dict)
    dt: float = 1.0

    def now(self, step: int) -> Label:
        """The propositions whose windows are open at a step."""
        return self._open(self.dt * step, self.dt * step)

    def way(self, step: int) -> Label:
        """The propositions whose windows are open at some moment between the step before and this one."""
        return self._open(self.dt * max(step - 1, 0), self.dt * step)

    def _open(self, first: float, last: float) -> Label:
        return frozenset(
            name
            for name, (_, begin, end) in self.windows.items()
            if begin - TOUCH <= last and first <= end + TOUCH
        )

    def letter(self, label: Collection[str], holding: Collection[str]) -> Label:
        """The propositions that hold in the regions ``label`` while windows ``holding`` are open."""
        always = {name for name in label if name not in self.windows}
        places = {name for name in holding if self.windows[name][0] is None or self.windows[name][0] in label}
        return frozenset(always | places)

    def places(self, label: Collection[str]) -> Label:
        """The propositions that hold in the regions ``label`` at some time, without clocks."""
        return frozenset(
            {name for name in label if name not in self.windows}
            | {name for name, (region, _, _) in self.windows.items() if region in label}
        )

    def region(self, name: str) -> str | None:
        """The region in which a proposition holds; None for a clock."""
        return self.windows[name][0] if name in self.windows else name


def windows_of(content: Mapping[str, Any] | None) -> dict[str, tuple[str | None, float, float]]:
    """The windows of scene.json or automaton.json by name; null in the file means no limit."""
    windows = {}
    for name, window in (content or {}).items():
        begin, end = window.get("begin"), window.get("end")
        windows[name] = (
            window.get("region"), -math.inf if begin is None else float(begin),
            math.inf if end is None else float(end),
        )  # fmt: skip
    return windows


def clock_of(name: str) -> tuple[str | None, float, float] | None:
    """The window in the name of a clock, such as ``clock_0_21600`` or ``clock_21600p001_on``."""
    match = re.fullmatch(r"clock_([\dp]+)_([\dp]+|on)", name)
    if match is None:
        return None
    begin, end = (math.inf if t == "on" else float(t.replace("p", ".")) for t in match.groups())
    return None, begin, end
