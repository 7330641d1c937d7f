"""Which places see each other past convex polygons, each of which keeps a distance from one of its faces."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.kernels.data import Faces, Point
from pareto_ltl.kernels.jit import allocating, kernel
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

TOUCH = 1e-3  # [m] a place this much too near still keeps its distance
BESIDE = 1.3  # a crossing lies within this many distances of both its polygons


@kernel
def depth_outside(faces: Faces, part: int, at: Point) -> float:
    """Distance [m] to the farthest face of a polygon, max_k (n_k' x - b_k); negative inside."""
    most = -np.inf
    normal, offset = faces.normal, faces.offset
    for k in range(faces.ptr[part], faces.ptr[part + 1]):
        most = max(most, normal[k, 0] * at.x + normal[k, 1] * at.y - offset[k])
    return most


@kernel
def shares_face(faces: Faces, part: int, start: Point, keep: float, end: Point, keep_there: float) -> bool:
    """Whether one face of the polygon is ``keep`` [m] from ``start`` and ``keep_there`` [m] from ``end``."""
    normal, offset = faces.normal, faces.offset
    for k in range(faces.ptr[part], faces.ptr[part + 1]):
        if normal[k, 0] * start.x + normal[k, 1] * start.y - offset[k] >= keep - TOUCH:  # noqa: SIM102
            if normal[k, 0] * end.x + normal[k, 1] * end.y - offset[k] >= keep_there - TOUCH:
                return True
    return False


@kernel
def comes_near(faces: Faces, part: int, start: Point, end: Point, reach: float) -> bool:
    """Whether the segment meets the polygon whose faces have all moved outwards by ``reach`` [m].

    Cyrus and Beck, Computers & Graphics 3 (1978), doi:10.1016/0097-8493(78)90021-3.
    """
    enter, leave = 0.0, 1.0
    normal, offset = faces.normal, faces.offset
    for k in range(faces.ptr[part], faces.ptr[part + 1]):
        first = normal[k, 0] * start.x + normal[k, 1] * start.y - offset[k] - reach
        last = normal[k, 0] * end.x + normal[k, 1] * end.y - offset[k] - reach
        if first >= 0.0 and last >= 0.0:
            return False
        if first >= 0.0:
            enter = max(enter, first / (first - last))
        elif last >= 0.0:
            leave = min(leave, first / (first - last))
    return enter < leave


@kernel
def passes(
    faces: Faces, part: int, start: Point, keep: float, end: Point, keep_there: float, steps: int
) -> bool:
    """Whether a flight in ``steps`` equal steps has a face of the polygon for both ends of every step."""
    if shares_face(faces, part, start, keep, end, keep_there):
        return True
    # Where no face is as far away as either end asks for, no step has one: 3 times faster.
    if steps <= 1 or comes_near(faces, part, start, end, min(keep, keep_there) - TOUCH):
        return False
    dx, dy, more = (end.x - start.x) / steps, (end.y - start.y) / steps, (keep_there - keep) / steps
    for n in range(steps):
        a = Point(start.x + n * dx, start.y + n * dy)
        b = Point(start.x + (n + 1) * dx, start.y + (n + 1) * dy)
        if not shares_face(faces, part, a, keep + n * more, b, keep + (n + 1) * more):
            return False
    return True


@allocating
def seen_places(
    faces: Faces, asks: FloatArray, here: FloatArray, keep: float, there: FloatArray, keeps: FloatArray,
    step: float,
) -> BoolArray:  # fmt: skip
    """Which places ``there`` (P, 2) a flight from ``here`` (2,) can go straight to, in steps of ``step`` [m].

    It passes polygon j if one of its faces is ``asks[j]`` times the distance to keep away from both ends of a
    step (Section 4.5); this distance is ``keep`` [m] here and ``keeps[i]`` [m] at place i. The polygon that
    hid the place before is tried first: places are corners of polygons, and neighbours are hidden by the same
    one.
    """
    start, seen = Point(here[0], here[1]), np.ones(len(there), np.bool_)
    order = np.argsort(np.array([depth_outside(faces, j, start) for j in range(len(asks))]))
    for i in range(len(there)):
        end = Point(there[i, 0], there[i, 1])
        steps = math.ceil(math.hypot(end.x - start.x, end.y - start.y) / step)
        for n in range(len(order)):
            j = order[n]
            if not passes(faces, j, start, asks[j] * keep, end, asks[j] * keeps[i], steps):
                seen[i] = False
                order[1 : n + 1] = order[:n].copy()
                order[0] = j
                break
    return seen


@allocating
def clear_crossings(
    faces: Faces, first: IntArray, second: IntArray, at: FloatArray, grow: FloatArray, distances: FloatArray
) -> BoolArray:
    """Which places ``at + r grow`` (n, 2) are beside two polygons and clear of all, for some r.

    ``first`` and ``second`` (n,) are the two polygons. Beside: not deeper outside than ``BESIDE`` r. Clear:
    at least r outside of every polygon.
    """
    kept = np.zeros(len(at), np.bool_)
    for n in range(len(at)):
        for r in distances:
            p = Point(at[n, 0] + r * grow[n, 0], at[n, 1] + r * grow[n, 1])
            reach = BESIDE * r + TOUCH
            if depth_outside(faces, first[n], p) > reach or depth_outside(faces, second[n], p) > reach:
                continue
            clear = True
            for j in range(len(faces.ptr) - 1):
                if depth_outside(faces, j, p) < r - TOUCH:
                    clear = False
                    break
            if clear:
                kept[n] = True
                break
    return kept
