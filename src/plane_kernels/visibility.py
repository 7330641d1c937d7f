"""Visibility past convex polygons: which straight lines keep a distance from a face of each polygon."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plane_kernels.types import BoolArray, Faces, FloatArray, IntArray, Point
from typed_kernels.jit import allocating, kernel, shared_entry

TOUCH = 1e-3  # [m] tolerance of the distance to keep
BESIDE = 1.3  # a crossing lies within this many distances of both its polygons
SECTORS = 1024  # number of angular sectors around a point, for the shadows of walls
SETTLED = 4  # iterations until a point and the distance to keep there agree to centimetres


class Walls(NamedTuple):
    """Convex polygons that a line may not cross.

    Face k of ``faces`` begins at ``corner[k]`` (F, 2) [m]; a polygon with one face is a half plane, whose
    corner is not used. ``asks`` (polygons,) multiplies the distance to keep: 0 if the line may touch the
    polygon.
    """

    faces: Faces
    corner: FloatArray
    asks: FloatArray


class Sight(NamedTuple):
    """The places that are ``seen`` (P,) from a point; all are true at first.

    ``shadow`` (SECTORS,): the distance [m] beyond which walls hide each sector, inf at first; ``order``: the
    order in which walls are tested.
    """

    seen: BoolArray
    shadow: FloatArray
    order: IntArray


class Places(NamedTuple):
    """Points that move with the distance r to keep on arrival: point k is ``at[k] + r grow[k]`` [m].

    ``at`` and ``grow`` have shape (P, 2).
    """

    at: FloatArray
    grow: FloatArray


class Distances(NamedTuple):
    """The distance to keep from obstacles after n steps of length ``step`` [m]: ``keep[n]`` [m].

    The last value applies to all longer lines.
    """

    step: float
    keep: FloatArray


@kernel
def depth_outside(faces: Faces, part: int, at: Point) -> float:
    """Largest signed distance [m] from a face of a polygon, max_k (n_k' x - b_k); negative inside."""
    limit = -np.inf
    normal, offset = faces.normal, faces.offset
    for k in range(faces.ptr[part], faces.ptr[part + 1]):
        limit = max(limit, normal[k, 0] * at.x + normal[k, 1] * at.y - offset[k])
    return limit


@kernel
def shares_face(faces: Faces, part: int, start: Point, keep: float, end: Point, keep_there: float) -> bool:
    """Whether one face of the polygon is ``keep`` [m] or more from ``start``, ``keep_there`` from ``end``."""
    normal, offset = faces.normal, faces.offset
    for k in range(faces.ptr[part], faces.ptr[part + 1]):
        if normal[k, 0] * start.x + normal[k, 1] * start.y - offset[k] >= keep - TOUCH:  # noqa: SIM102
            if normal[k, 0] * end.x + normal[k, 1] * end.y - offset[k] >= keep_there - TOUCH:
                return True
    return False


@kernel
def comes_near(faces: Faces, part: int, start: Point, end: Point, reach: float) -> bool:
    """Whether the segment meets the polygon after all its faces are moved outwards by ``reach`` [m].

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
    """Whether each of ``steps`` equal steps has a face of the polygon at the distances to keep at both ends.

    The distance to keep changes linearly from ``keep`` at ``start`` to ``keep_there`` at ``end`` [m].
    """
    if shares_face(faces, part, start, keep, end, keep_there):
        return True
    # A quick rejection makes this 3 times faster: a step within the smaller distance has no such face.
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
    """A number in [0, 4) that increases with the angle of a vector; cheaper than ``atan2``."""
    size = abs(dx) + abs(dy)
    if size == 0.0:
        return 0.0
    if dx < 0.0:
        return 2.0 - dy / size
    return dy / size if dy >= 0.0 else 4.0 + dy / size


@kernel
def fill_shadow(walls: Walls, part: int, start: Point, shadow: FloatArray) -> None:
    """Lower ``shadow`` to the distance [m] beyond which a polygon hides all of a sector around ``start``.

    Without shadows, :func:`seen_places` takes 2.3 times as long with 300 obstacles.
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
    # Only sectors that are entirely in the shadow.
    for sector in range(math.ceil((reference + low) * n / 4.0), math.floor((reference + high) * n / 4.0)):
        shadow[sector % n] = min(shadow[sector % n], far)


def seen_places(
    walls: Walls, here: FloatArray, keep: float, there: FloatArray, keeps: FloatArray, step: float
) -> BoolArray:
    """Which points ``there`` (P, 2) [m] a straight line from ``here`` (2,) [m] can reach: (P,).

    The line has steps of ``step`` [m]. It passes wall j if, for every step, one face of the wall is at least
    ``asks[j]`` times the distance to keep away from both ends of the step, as in (M39). The distance to
    keep is ``keep`` [m] at ``here`` and ``keeps[i]`` [m] at point i.
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


@shared_entry
def see_places(
    walls: Walls, start: Point, keep: float, there: FloatArray, keeps: FloatArray, step: float, sight: Sight
) -> None:  # fmt: skip
    """Write the result of :func:`seen_places` to ``sight.seen``.

    Most points are hidden. Those in the shadow of a wall are excluded first. Then the wall that hid the
    previous point is tested first, since consecutive points are corners of one wall and often hidden by the
    same one.
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
    """The distance to keep [m] after a line of length ``metres``."""
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
    """The places that a line of ``length`` [m] to ``here`` (2,) [m] reaches straight from there.

    Only places with a total length below ``best`` (P,) [m] that lie within ``bounds`` (2, 2) [m] are
    returned: their numbers (n,), positions on arrival (n, 2) [m], distances to keep there (n,) [m] and total
    lengths (n,) [m].
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
            way = length + math.sqrt(dx * dx + dy * dy)  # hypot would take 2.4 times as long
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
    """Which points ``at + r grow`` (n, 2) [m] are beside two polygons and clear of all, for some r: (n,).

    ``first`` and ``second`` (n,) are the two polygons, ``distances`` the values of r to try [m]. Beside: at
    most ``BESIDE`` r from both polygons. Clear: at least r outside every polygon.
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
