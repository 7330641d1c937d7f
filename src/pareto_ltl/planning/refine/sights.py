"""Landmarks on the way: which a path crosses, lines led through them, and what keeps a polish in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.special import expit

from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.search_map import search_map
from pareto_ltl.planning.refine.step_programme import Descent
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.world.cells import half_planes

LED = 12  # lines that are led through landmarks, the shortest
PLACES = 2  # legs of a line in which a landmark is tried, those of the least detours
STRETCH = 1.7  # lines that a landmark makes longer than this many times are left out
NEAREST = 3  # legs of a path on which a flight may be deepest in a landmark
SHARES = (0.5, 1.0)  # of a leg, where that is evaluated


def sights(problem: Problem, x: FloatArray) -> BoolArray:
    """Whether each leg of the means ``x`` (T+1, 2) [m] crosses each landmark, (T, K)."""
    import shapely

    marks = [shapely.Polygon(corners) for corners in problem.landmarks]
    if not marks or len(x) < 2:
        return np.zeros((max(len(x) - 1, 0), len(marks)), bool)
    legs = np.array(shapely.linestrings(np.stack([x[:-1], x[1:]], axis=1)))
    crossed: BoolArray = shapely.intersects(legs[:, None], np.array(marks)[None])
    return crossed


def led_lines(problem: Problem, lines: Sequence[FloatArray]) -> list[FloatArray]:
    """Each of the first ``lines`` (n, 2) [m] led through one landmark more, and those through another one.

    A line enters a landmark at its middle, in the legs where this is the least detour, and only where neither
    part of the leg meets an obstacle. Whether it still completes the mission is not checked.
    """
    if not len(problem.landmarks):
        return []
    once = [led for line in lines[:LED] for led in _led(problem, line)]
    twice = [led for line in once[:LED] for led in _led(problem, line)]
    return [*once, *twice]


def _led(problem: Problem, line: FloatArray) -> Iterator[FloatArray]:
    """``line`` through each landmark that it does not cross."""
    import shapely

    crossed = sights(problem, line).any(axis=0)
    blocked = shapely.union_all([shapely.Polygon(part) for part in search_map(problem).obstacles])
    shapely.prepare(blocked)
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    for k in np.flatnonzero(~crossed):
        middle = problem.landmarks[k].mean(axis=0)
        arms = np.linalg.norm(line - middle, axis=1)
        detour = arms[:-1] + arms[1:] - np.linalg.norm(np.diff(line, axis=0), axis=1)

        def clear(j: int, middle: FloatArray = middle) -> bool:
            return not shapely.intersects(blocked, shapely.LineString([line[j], middle, line[j + 1]]))

        legs = (int(j) for j in np.argsort(detour, kind="stable") if length + detour[j] <= STRETCH * length)
        for j in islice((j for j in legs if clear(j)), PLACES):
            yield np.insert(line, j + 1, middle, axis=0)


@dataclass(frozen=True, slots=True)
class Attraction:
    """What fixes are worth to a path: an objective that keeps polishes from leaving a landmark.

    Deviations of common flights are held fixed in a solve, so that the failure model does not see that a path
    that leaves a landmark loses its fix. This term does: ``worth`` σ(-m / τ) for each landmark, with m the
    distance by which a flight is inside and ``worth`` the failures that fixes save now.

    Eq. (M75) of docs/mathematics_methods.md.
    """

    marks: tuple[FloatArray, ...]
    worth: float

    def added(self, here: Descent, x: FloatArray, off: FloatArray, width: float, runs: int) -> Descent:
        """``here`` with the term of ``x`` + ``off`` (T+1, 2, n); of ``runs`` flights, others count as 0."""
        if self.worth <= 0.0:
            return here
        value, gradient, hessian = here.value, here.gradient.copy(), here.hessian.copy()
        share = self.worth * off.shape[2] / runs
        for corners in self.marks:
            seen = _inside(corners, x, off)
            missed = expit(-seen.margin / width)
            slope = missed * (1.0 - missed) / width
            bend = np.maximum(slope * (1.0 - 2.0 * missed) / width, 0.0)
            value += share * float(missed.mean())
            nx, ny = seen.normal.T
            pull = share / len(missed) * slope[:, None] * seen.normal
            curve = share / len(missed) * bend[:, None] * np.column_stack([nx * nx, nx * ny, ny * ny])
            for t, weight in ((seen.leg, 1.0 - seen.share), (seen.leg + 1, seen.share)):
                np.add.at(gradient, t, weight[:, None] * pull)
                np.add.at(hessian, t, (weight * weight)[:, None] * curve)
        return Descent(gradient, hessian, value)


class _Inside(NamedTuple):
    """For each flight the leg and the share of it where it is deepest in a landmark, and how deep [m].

    ``normal`` is that of the nearest face, which the depth falls along.
    """

    leg: IntArray
    share: FloatArray
    margin: FloatArray
    normal: FloatArray


def _inside(corners: FloatArray, x: FloatArray, off: FloatArray) -> _Inside:
    normals, offsets = half_planes(corners)
    middle = corners.mean(axis=0)
    ends = np.linalg.norm(x - middle, axis=1)
    near = np.sort(np.argsort(ends[:-1] + ends[1:], kind="stable")[:NEAREST])
    legs, shares = np.repeat(near, len(SHARES)), np.tile(SHARES, len(near))
    s = shares[:, None, None]
    at = (1.0 - s) * (x[legs, :, None] + off[legs]) + s * (x[legs + 1, :, None] + off[legs + 1])
    gap = offsets[None, :, None] - normals @ at
    deep = gap.min(axis=1)
    best, flights = deep.argmax(axis=0), np.arange(off.shape[2])
    face = gap[best, :, flights].argmin(axis=1)
    return _Inside(legs[best], shares[best], deep[best, flights], normals[face])
