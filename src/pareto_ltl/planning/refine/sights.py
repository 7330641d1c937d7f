"""Landmarks on the way: which of them a path crosses, and lines that are led through them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.search_map import search_map
from pareto_ltl.support.arrays import BoolArray, FloatArray

LED = 12  # lines that are led through landmarks, the shortest
PLACES = 2  # legs of a line in which a landmark is tried, those of the least detours
STRETCH = 1.7  # lines that a landmark makes longer than this many times are left out


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
