"""Areas that a flight must not leave, and how often flights leave them: border, corridor, a given volume."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from careful_io.texts import distance_text
from pareto_ltl.extend import (
    FailureRate,
    FlightEvent,
    FlightSample,
    PlannedPath,
    Problem,
    count_agrees,
    weighted_samples,
)
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl_apps.preflight.volumes import distance_to

RARE = 1e-3  # lower rates are estimated with weighted flights: too few plain ones leave
QUADRANT = 32  # segments of a quarter circle of a corridor: 0.03 % narrower at its bends


@dataclass(frozen=True)
class Area:
    """Where a flight may be at each time.

    Attributes
    ----------
    within : tuple of T shapely areas
        The area of each step: both ends of the step and the straight line between them lie in it.
    name : str
        What it is called: ``border``.
    half_width : float
        Of a corridor [m] along ``route`` (T+1, 2) [m]; 0 for other areas.
    """

    name: str
    within: tuple[Any, ...]
    half_width: float = 0.0
    route: FloatArray | None = None

    @cached_property
    def one(self) -> bool:
        """Whether the area is the same at all times."""
        return all(area is self.within[0] for area in self.within)

    def left_by(self, x: FloatArray) -> BoolArray:
        """Which of the flights ``x`` (n, T+1, 2) [m] leave the area, (n,)."""
        import shapely

        left = np.zeros(len(x), bool)
        for k, area in enumerate(self.within):
            shapely.prepare(area)
            for t in (k + 1,) if self.one and k else (k, k + 1):
                left |= ~shapely.intersects_xy(area, x[:, t, 0], x[:, t, 1])
            if not _is_convex(area):
                rows = np.flatnonzero(~left)
                rows = rows[~self._in_one_capsule(k, x[rows])]
                left[rows] |= ~shapely.covers(area, shapely.linestrings(x[rows, k : k + 2]))
        return left

    def _in_one_capsule(self, k: int, x: FloatArray) -> BoolArray:
        """Which steps k have both ends within the half width of a leg close to theirs: they lie inside."""
        inside = np.zeros(len(x), bool)
        if self.route is not None:
            legs = list(pairwise(self.route))
            for leg in legs[max(k - 1, 0) : k + 2]:
                near = [distance_to(leg, x[:, t]) <= self.half_width for t in (k, k + 1)]
                inside |= near[0] & near[1]
        return inside

    def normals(self, x: FloatArray) -> FloatArray:
        """Directions (n, T+1, 2) out of the area, at the first position of each flight outside of it."""
        import shapely

        made = np.zeros(x.shape)
        for row, flight in enumerate(x):
            for k, area in enumerate(self.within):
                place = shapely.Point(flight[k + 1])
                if not shapely.intersects(area, place):
                    to = shapely.get_coordinates(shapely.shortest_line(area, place))
                    made[row, k + 1] = to[1] - to[0]
                    break
        return made

    def event(self) -> FlightEvent:
        """The event that a flight leaves the area."""
        return FlightEvent(self.left_by, self.normals)


def _is_convex(area: Any) -> bool:
    """Whether a shapely area is convex, so that straight lines between its points are in it."""
    import shapely

    return bool(shapely.area(shapely.convex_hull(area)) <= shapely.area(area) * (1.0 + 1e-9))


def border_area(bounds: FloatArray, steps: int) -> Area:
    """The drawn border of the map, a rectangle of corners ``bounds`` (2, 2) [m]."""
    import shapely

    return Area("border", (shapely.box(*bounds.ravel()),) * steps)


def corridor_area(route: FloatArray, width: float) -> Area:
    """All places within half of ``width`` [m] of the ``route`` (T+1, 2) [m]."""
    import shapely

    tube = shapely.buffer(shapely.LineString(route), 0.5 * width, quad_segs=QUADRANT)
    return Area(f"corridor of {distance_text(width)}", (tube,) * (len(route) - 1), 0.5 * width, route)


def leaving_rate(
    problem: Problem, path: PlannedPath, area: Area, flown: FlightSample, seed: SeedSequence
) -> FailureRate:
    """How often flights leave ``area``: by counting flights of ``flown``, or by weighted ones if it is rare.

    The count stands if there is no proposal, if its interval is narrower, or if it contradicts the weighted
    flights.
    """
    return rarer_rate(problem, path, area.event(), flown, seed)


def rarer_rate(
    problem: Problem, path: PlannedPath, event: FlightEvent, flown: FlightSample, seed: SeedSequence
) -> FailureRate:
    """The rate of ``event`` in the flights ``flown``, or by weighted flights below ``RARE``."""
    counted = flown.rate(event.happens(flown.x))
    if counted.failure >= RARE:
        return counted
    made = weighted_samples(problem, path, event, len(flown), seed)
    if not made:
        return counted
    weighted = made[0].rate(event.happens(made[0].x))
    narrower = weighted.high - weighted.low < counted.high - counted.low
    return weighted if narrower and count_agrees(counted, weighted) else counted
