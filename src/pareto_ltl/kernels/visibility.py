"""Which places see each other past convex polygons, each of which keeps a distance from one of its faces."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pareto_ltl.kernels.data import Faces, Point
from pareto_ltl.kernels.jit import allocating, entry, kernel
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

TOUCH = 1e-3  # [m] a place this much too near still keeps its distance
BESIDE = 1.3  # a crossing lies within this many distances of both its polygons
SECTORS = 1024  # around a place, in which walls throw shadows
SETTLED = 4  # rounds until a place and the distance to keep there agree to centimetres


class Walls(NamedTuple):
    """Convex polygons that a line may not cross.

    Face k of ``faces`` begins at ``corner[k]`` (F, 2); a polygon with one face is a half plane, whose corner
    means nothing. ``asks`` is 1 where the line keeps its distance, 0 where it only must not cross.
    """

    faces: Faces
    corner: FloatArray
    asks: FloatArray


class Sight(NamedTuple):
    """What is ``seen`` (P,) from a place, all of it at first.

    ``shadow`` (SECTORS,) is that of walls, none at first; ``order`` that in which walls are tried.
    """

    seen: BoolArray
    shadow: FloatArray
    order: IntArray


class Places(NamedTuple):
    """Place k lies at ``at[k] + r grow[k]`` [m], where r is the distance to keep on arrival."""

    at: FloatArray
    grow: FloatArray


class Distances(NamedTuple):
    """After n steps of ``step`` [m] a line keeps ``keep[n]`` [m] from obstacles, then the last one."""

    step: float
    keep: FloatArray


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


@kernel
def direction(dx: float, dy: float) -> float:
    """A number in [0, 4) that grows with the angle of a vector, and costs less than ``atan2``."""
    size = abs(dx) + abs(dy)
    if size == 0.0:
        return 0.0
    if dx < 0.0:
        return 2.0 - dy / size
    return dy / size if dy >= 0.0 else 4.0 + dy / size


@kernel
def fill_shadow(walls: Walls, part: int, start: Point, shadow: FloatArray) -> None:
    """Enter a polygon into ``shadow``: beyond how many metres it hides all of each sector around ``start``.

    Without shadows, :func:`seen_places` takes 2.3 times as long past 300 obstacles.
    """
    first, last = walls.faces.ptr[part], walls.faces.ptr[part + 1]
    if last - first < 3 or depth_outside(walls.faces, part, start) <= 0.0:
        return
    corner, n = walls.corner, len(shadow)
    reference = direction(corner[first, 0] - start.x, corner[first, 1] - start.y)
    low, high, far = 0.0, 0.0, 0.0
    for k in range(first, last):
        dx, dy = corner[k, 0] - start.x, corner[k, 1] - start.y
        turn = (direction(dx, dy) - reference + 6.0) % 4.0 - 2.0
        low, high, far = min(low, turn), max(high, turn), max(far, math.hypot(dx, dy))
    # Only sectors that lie in the shadow as a whole.
    for sector in range(math.ceil((reference + low) * n / 4.0), math.floor((reference + high) * n / 4.0)):
        shadow[sector % n] = min(shadow[sector % n], far)


def seen_places(
    walls: Walls, here: FloatArray, keep: float, there: FloatArray, keeps: FloatArray, step: float
) -> BoolArray:
    """Which places ``there`` (P, 2) a flight from ``here`` (2,) can go straight to, in steps of ``step`` [m].

    It passes wall j if one of its faces is ``asks[j]`` times the distance to keep away from both ends of a
    step, as in (M39); this distance is ``keep`` [m] here and ``keeps[i]`` [m] at place i.
    """
    seen, shadow = np.ones(len(there), np.bool_), np.full(SECTORS, np.inf)
    order = np.arange(len(walls.asks))
    if len(order) > 0:
        faces = walls.faces
        depth = np.maximum.reduceat(faces.normal @ here - faces.offset, faces.ptr[:-1])
        order = np.argsort(depth)
    see_places(
        walls, Point(float(here[0]), float(here[1])), keep, there, keeps, step, Sight(seen, shadow, order)
    )
    return seen


@entry
def see_places(
    walls: Walls, start: Point, keep: float, there: FloatArray, keeps: FloatArray, step: float, sight: Sight
) -> None:  # fmt: skip
    """:func:`seen_places` into ``sight.seen``.

    Most places are hidden. Those in the shadow of a wall are left out first; then the wall that hid the place
    before is tried first, since places are corners of walls, and neighbours are hidden by the same one.
    """
    seen, shadow, order = sight
    for j in range(len(walls.asks)):
        fill_shadow(walls, j, start, shadow)
    for i in range(len(there)):
        end = Point(there[i, 0], there[i, 1])
        dx, dy = end.x - start.x, end.y - start.y
        way = math.sqrt(dx * dx + dy * dy)
        if way > shadow[int(direction(dx, dy) * SECTORS / 4.0) % SECTORS]:
            seen[i] = False
            continue
        steps = math.ceil(way / step)
        for n in range(len(order)):
            j = order[n]
            asks = walls.asks[j]
            if not passes(walls.faces, j, start, asks * keep, end, asks * keeps[i], steps):
                seen[i] = False
                for m in range(n, 0, -1):
                    order[m] = order[m - 1]
                order[0] = j
                break


@kernel
def kept_distance(distances: Distances, metres: float) -> float:
    """The distance to keep [m] after a way of ``metres``."""
    n = metres / distances.step
    i = int(n)
    if i >= len(distances.keep) - 1:
        return float(distances.keep[-1])
    return float(distances.keep[i] + (n - i) * (distances.keep[i + 1] - distances.keep[i]))


@allocating
def arrivals(
    places: Places,
    best: FloatArray,
    here: FloatArray,
    length: float,
    distances: Distances,
    bounds: FloatArray,
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Places that a line to ``here`` (2,) and a straight flight reach in less than ``best`` (P,) [m].

    The line has a ``length`` [m]. Returns the numbers of the places (n,), where they lie on arrival (n, 2),
    which is within ``bounds`` (2, 2), the distances to keep there (n,) and the lengths of the lines (n,).
    """
    rows, ends = np.empty(len(best), np.int64), np.empty((len(best), 2))
    keeps, total = np.empty(len(best)), np.empty(len(best))
    n, widest = 0, distances.keep.max()
    for k in range(len(best)):
        ax, ay = places.at[k, 0] - here[0], places.at[k, 1] - here[1]
        gx, gy = places.grow[k, 0], places.grow[k, 1]
        way = length + math.sqrt(ax * ax + ay * ay)
        if way - widest * math.sqrt(gx * gx + gy * gy) >= best[k]:
            continue
        keep = 0.0
        for _ in range(SETTLED):
            keep = kept_distance(distances, way)
            dx, dy = ax + keep * gx, ay + keep * gy
            way = length + math.sqrt(dx * dx + dy * dy)  # with hypot, this kernel takes 2.4 times as long
        x, y = places.at[k, 0] + keep * gx, places.at[k, 1] + keep * gy
        inside = bounds[0, 0] <= x <= bounds[1, 0] and bounds[0, 1] <= y <= bounds[1, 1]
        if inside and way < best[k]:
            rows[n], ends[n, 0], ends[n, 1], keeps[n], total[n] = k, x, y, keep, way
            n += 1
    return rows[:n], ends[:n], keeps[:n], total[:n]


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
