"""Cells of measured positions beside the planned track.

A person applies two distances: along the track from the planned position, ahead of it positive, and to the
left of the track. A cell is a box of the two; it is a half-plane where one of its four ends is finite.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from careful_io.texts import distance_text
from pareto_ltl.support.arrays import BoolArray, FloatArray

Ends = tuple[float, float]
EVERYWHERE: Ends = (-math.inf, math.inf)


@dataclass(frozen=True, slots=True)
class Cell:
    """Measured positions whose distances ``along`` and ``left`` of the planned track [m] lie in a box.

    A position at the lower end of an interval belongs to it, one at the upper end does not.
    """

    along: Ends = EVERYWHERE
    left: Ends = EVERYWHERE

    def __post_init__(self) -> None:
        for name, (low, high) in (("along", self.along), ("left", self.left)):
            if not low < high:
                raise ValueError(f"a cell needs low < high, got {name} = {low:g} to {high:g}")

    def holds(self, y: FloatArray) -> BoolArray:
        """Which of the distances ``y`` (n, 2) [m], along and left, lie in the cell."""
        return np.asarray(
            (y[:, 0] >= self.along[0]) & (y[:, 0] < self.along[1])
            & (y[:, 1] >= self.left[0]) & (y[:, 1] < self.left[1]), bool
        )  # fmt: skip

    @property
    def words(self) -> str:
        """Where the cell lies, for people: the question to which a position in it is the answer yes."""
        parts = [
            _side(self.left, ("left of", "right of"), "the planned track"),
            _side(self.along, ("ahead of", "behind"), "the planned position (along the track)"),
        ]
        return ", and ".join(filter(None, parts)) or "anywhere"


def _side(ends: Ends, sides: tuple[str, str], what: str) -> str:
    """``more than 3.2 km left of the planned track``; empty without a limit.

    ``sides`` are the words for positive distances and for negative ones.
    """
    low, high = ends
    if high == math.inf:
        return "" if low == -math.inf else _beyond(low, sides, what)
    if low == -math.inf:
        return _beyond(-high, sides[::-1], what)
    if low >= 0.0 or high <= 0.0:
        near, far = sorted((abs(low), abs(high)))
        side = sides[0] if low >= 0.0 else sides[1]
        if near == 0.0:
            return f"{side} {what} by less than {distance_text(far)}"
        return f"between {distance_text(near)} and {distance_text(far)} {side} {what}"
    return f"less than {distance_text(-low)} {sides[1]}, or {distance_text(high)} {sides[0]}, {what}"


def _beyond(low: float, sides: tuple[str, str], what: str) -> str:
    """On the first of ``sides`` of a line that lies ``low`` [m] on that side."""
    if low == 0.0:
        return f"{sides[0]} {what}"
    if low > 0.0:
        return f"more than {distance_text(low)} {sides[0]} {what}"
    return f"{sides[0]} {what}, or less than {distance_text(-low)} {sides[1]} it"
