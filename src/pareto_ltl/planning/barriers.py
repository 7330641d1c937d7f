"""The barriers of a problem as polygons with corners, for supporting lines."""

from __future__ import annotations

from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.planning.pack_logic import pack_corners
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from pareto_ltl.kernels.supporting_lines import SegmentLines

LEAST = 0.1  # [m²] added to every variance: a position that is known exactly has a deviation of 0.3 m
BEYOND = 3.0  # depth of a wall as a polygon, in sizes of the map

_POLYGONS: WeakKeyDictionary[Problem, kd.Corners] = WeakKeyDictionary()


def barrier_polygons(problem: Problem) -> kd.Corners:
    """The convex polygons of ``problem.barriers`` as corners, made once; a wall is a deep rectangle."""
    found = _POLYGONS.get(problem)
    if found is None:
        polygons = barrier_outlines(problem)
        _POLYGONS[problem] = found = pack_corners(range(len(polygons)), polygons)
    return found


def barrier_outlines(problem: Problem) -> list[FloatArray]:
    """The corners of each convex part of the obstacles, then of the walls [m]."""
    return [*problem.decomposition.obstacles, *(_walls(problem) if problem.scene.walled else [])]


def _walls(problem: Problem) -> list[FloatArray]:
    """West, east, south and north of the map as rectangles, in the order of ``problem.barriers``."""
    (west, south), (east, north) = problem.scene.bounds
    deep = BEYOND * max(east - west, north - south)
    sides = [
        (west - deep, south - deep, west, north + deep), (east, south - deep, east + deep, north + deep),
        (west - deep, south - deep, east + deep, south), (west - deep, north, east + deep, north + deep),
    ]  # fmt: skip
    return [np.array([[w, s], [e, s], [e, n], [w, n]]) for w, s, e, n in sides]


def lines_of(
    corners: kd.Corners, asked: BoolArray, x: FloatArray, cov: FloatArray, slots: int, around: float = 0.0
) -> SegmentLines:
    """The ``slots`` closest supporting lines of each segment, and its risk.

    ``asked`` (T, m) are the polygons to avoid, ``x`` (T+1, 2) means [m], ``cov`` (T+1, 3) covariances [m²].
    """
    from pareto_ltl.kernels.supporting_lines import SegmentLines, segment_lines

    T = len(asked)
    lines = SegmentLines(np.empty((T, slots, 4)), np.empty((T, slots), np.int64), np.empty(T))
    segment_lines(corners, asked, x, cov, LEAST, around, lines)
    return lines


def start_risk(problem: Problem) -> float:
    """Σ_lines Q(z) at the start, Eq. (M73): the probability of a collision before anything is flown."""
    corners, v = barrier_polygons(problem), problem.start_variance
    asked, x = np.ones((1, len(corners.radius)), bool), np.tile(problem.scene.start, (2, 1))
    return float(lines_of(corners, asked, x, np.tile([v, 0.0, v], (2, 1)), 1).risk[0])
