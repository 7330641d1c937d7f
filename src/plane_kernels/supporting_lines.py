"""Supporting lines: the half planes that keep a segment away from convex polygons.

A line with the unit normal c supports a polygon if c'v <= h(c) = max_v c'v for its corners v. A segment both
of whose ends lie beyond such a line cannot meet the polygon, so the probability of a collision is at most the
sum of those that an end lies on the other side. The line with the largest number of standard deviations

    z = min_e (c'x_e - h(c)) / √(c' Σ_e c)      over the two ends e

is best for one end, from the nearest point of the polygon in the metric of Σ_e, or it is as far from both.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plane_kernels.gaussian import tail, variance_along
from plane_kernels.types import BoolArray, Corners, Cov, FloatArray, Gaussian, IntArray, Point
from typed_kernels.jit import allocating, kernel

FAR = 6.0  # standard deviations beyond which a polygon adds less than 1e-9
HALVINGS = 24  # of the angle between the best lines of both ends
ROUNDING = 1e-6  # [m] by which a polygon may reach over a line that it touches
SURE = 40.0  # standard deviations that count as certainty


class Line(NamedTuple):
    """A half plane c'x >= offset [m], and the standard deviations of the nearer end beyond it."""

    east: float
    north: float
    offset: float
    z: float


class SegmentLines(NamedTuple):
    """Lines of each of T segments, K at most.

    ``line`` (T, K, 4): c, offset and z; ``owner`` (T, K): the polygon of each line; ``risk`` (T,):
    Σ_j Φ(-z_j) of all polygons.
    """

    line: FloatArray
    owner: IntArray
    risk: FloatArray


@kernel
def support(polygons: Corners, j: int, east: float, north: float) -> float:
    """h(c): the largest c'v of the corners of polygon ``j`` [m]."""
    limit = -math.inf
    for k in range(polygons.ptr[j], polygons.ptr[j + 1]):
        limit = max(limit, east * polygons.corner[k, 0] + north * polygons.corner[k, 1])
    return limit


@kernel
def deviations(east: float, north: float, offset: float, here: Gaussian, least: float) -> float:
    """(c'x - offset) / √(c' Σ c + ``least``)."""
    gap = east * here.mean.x + north * here.mean.y - offset
    return gap / math.sqrt(variance_along(east, north, here.cov) + least)


@kernel
def line_of(
    polygons: Corners, j: int, east: float, north: float, here: Gaussian, there: Gaussian, least: float
) -> Line:
    """The supporting line of polygon ``j`` with the normal (``east``, ``north``) of any length."""
    size = math.sqrt(east * east + north * north)
    east, north = east / size, north / size
    offset = support(polygons, j, east, north)
    z = min(deviations(east, north, offset, here, least), deviations(east, north, offset, there, least))
    return Line(east, north, offset, z)


@kernel
def normal_of_nearest(polygons: Corners, j: int, here: Gaussian, least: float) -> Point:
    """Σ⁻¹ (x - y), y the point of polygon ``j`` nearest to x in the metric of Σ; (0, 0) for x inside.

    It is the normal of the supporting line most standard deviations from x: max_c (c'x - h(c)) / √(c'Σc) and
    min_y √((x - y)' Σ⁻¹ (x - y)) are dual to each other.
    """
    a, b, c = here.cov.xx + least, here.cov.xy, here.cov.yy + least
    p = math.sqrt(a)  # Σ = L L', L = ((p, 0), (q, r))
    q = b / p
    r = math.sqrt(max(c - q * q, 1e-12 * c))
    first, last = polygons.ptr[j], polygons.ptr[j + 1]
    best, wx, wy, inside = math.inf, 0.0, 0.0, True
    for k in range(first, last):
        n = k + 1 if k + 1 < last else first
        ux, uy = polygons.corner[k, 0] - here.mean.x, polygons.corner[k, 1] - here.mean.y
        vx, vy = polygons.corner[n, 0] - here.mean.x, polygons.corner[n, 1] - here.mean.y
        ux, vx = ux / p, vx / p
        uy, vy = (uy - q * ux) / r, (vy - q * vx) / r
        dx, dy = vx - ux, vy - uy
        if ux * vy - uy * vx < 0.0:
            inside = False
        square = dx * dx + dy * dy
        share = 0.0 if square == 0.0 else max(0.0, min(1.0, -(ux * dx + uy * dy) / square))
        nx, ny = ux + share * dx, uy + share * dy
        if nx * nx + ny * ny < best:
            best, wx, wy = nx * nx + ny * ny, nx, ny
    if inside or best == 0.0:
        return Point(0.0, 0.0)
    return Point(-(wx - q * wy / r) / p, -wy / r)


@kernel
def best_line(polygons: Corners, j: int, here: Gaussian, there: Gaussian, least: float) -> Line:
    """The supporting line of polygon ``j`` with the largest z for the segment from ``here`` to ``there``.

    ``least`` [m²] is added to every variance. z is negative if no line has both ends beyond it; then the line
    is the distance from an edge.
    """
    c0, c1 = (
        normal_of_nearest(polygons, j, here, least),
        normal_of_nearest(polygons, j, there, least),
    )
    if (c0.x == 0.0 and c0.y == 0.0) or (c1.x == 0.0 and c1.y == 0.0):
        return best_edge(polygons, j, here, there, least)
    from_here = line_of(polygons, j, c0.x, c0.y, here, there, least)
    from_there = line_of(polygons, j, c1.x, c1.y, here, there, least)
    if is_best(from_here, here, there, least):
        return from_here
    if is_best(from_there, there, here, least):
        return from_there
    best = from_here if from_here.z >= from_there.z else from_there
    angle = math.atan2(from_here.north, from_here.east)
    turn = math.atan2(
        from_here.east * from_there.north - from_here.north * from_there.east,
        from_here.east * from_there.east + from_here.north * from_there.north,
    )
    best = better_between(polygons, j, here, there, least, angle, turn, best)
    if best.z < 0.0:  # opposite normals: the polygon is beside the middle of the segment, on either side
        best = better_between(
            polygons, j, here, there, least, angle, turn - math.copysign(2.0 * math.pi, turn), best
        )
    if best.z < 0.0:
        edge = best_edge(polygons, j, here, there, least)
        if edge.z > best.z:
            return edge
    return best


@kernel
def is_best(line: Line, own: Gaussian, other: Gaussian, least: float) -> bool:
    """Whether the other end is as far beyond ``line``, the best one for its own end, as that end is.

    No line is then farther from the nearer end: it is needless to search between the normals of both ends.
    """
    first = deviations(line.east, line.north, line.offset, own, least)
    return first >= 0.0 and deviations(line.east, line.north, line.offset, other, least) >= first


@kernel
def better_between(
    polygons: Corners, j: int, here: Gaussian, there: Gaussian, least: float, angle: float, turn: float,
    best: Line,
) -> Line:  # fmt: skip
    """``best``, or a line with a larger z whose normal lies between ``angle`` and ``angle`` + ``turn``.

    From one end of the arc to the other, z of ``here`` falls and z of ``there`` rises: where they are
    equal, the smaller of them is largest.
    """
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        east, north = math.cos(angle + middle * turn), math.sin(angle + middle * turn)
        line = line_of(polygons, j, east, north, here, there, least)
        if line.z > best.z:
            best = line
        first = deviations(east, north, line.offset, here, least)
        if first > deviations(east, north, line.offset, there, least):
            low = middle
        else:
            high = middle
    return best


@kernel
def best_edge(polygons: Corners, j: int, here: Gaussian, there: Gaussian, least: float) -> Line:
    """The line along an edge of polygon ``j`` (counter-clockwise) with the largest z."""
    first, last = polygons.ptr[j], polygons.ptr[j + 1]
    best = Line(1.0, 0.0, support(polygons, j, 1.0, 0.0), -math.inf)
    for k in range(first, last):
        n = k + 1 if k + 1 < last else first
        dx = polygons.corner[n, 0] - polygons.corner[k, 0]
        dy = polygons.corner[n, 1] - polygons.corner[k, 1]
        if dx == 0.0 and dy == 0.0:
            continue
        line = line_of(polygons, j, dy, -dx, here, there, least)
        if line.z > best.z:
            best = line
    return best


@kernel
def is_far(polygons: Corners, j: int, here: Gaussian, there: Gaussian, reach: float) -> bool:
    """Whether polygon ``j`` is certainly more than ``reach`` [m] away from the segment."""
    mx, my = polygons.middle[j, 0] - here.mean.x, polygons.middle[j, 1] - here.mean.y
    dx, dy = there.mean.x - here.mean.x, there.mean.y - here.mean.y
    square = dx * dx + dy * dy
    share = 0.0 if square == 0.0 else max(0.0, min(1.0, (mx * dx + my * dy) / square))
    mx, my = mx - share * dx, my - share * dy
    return bool(mx * mx + my * my > (polygons.radius[j] + reach) ** 2)


@allocating
def segment_lines(
    polygons: Corners, requested: BoolArray, x: FloatArray, cov: FloatArray, least: float, around: float,
    lines: SegmentLines,
) -> None:  # fmt: skip
    """Fill in, for each segment, its closest supporting lines and the sum of the risks beyond all of them.

    A polygon wholly beyond the line of another one adds nothing: both are met only beyond that line.

    Eq. (M73) of docs/mathematics.md.

    Parameters
    ----------
    requested : (T, m) bool
        Which polygons each segment has to avoid.
    x : (T+1, 2) float, cov : (T+1, 3) float
        Means [m] and covariances [m²].
    least : float
        Added to every variance [m²].
    around : float
        Polygons up to this distance have lines although they add no risk [m].
    lines : SegmentLines
        Filled: the smallest z first; z is ``SURE``, c zero and the owner -1 in rows that are not used.
    """
    line, owner, risk = lines.line, lines.owner, lines.risk
    m, slots = len(polygons.radius), line.shape[1]
    near, best = np.empty(m, np.int64), np.empty((m, 4))
    for t in range(len(x) - 1):
        here = Gaussian(Point(x[t, 0], x[t, 1]), Cov(cov[t, 0], cov[t, 1], cov[t, 2]))
        there = Gaussian(Point(x[t + 1, 0], x[t + 1, 1]), Cov(cov[t + 1, 0], cov[t + 1, 1], cov[t + 1, 2]))
        reach = around + FAR * math.sqrt(max(largest(here.cov), largest(there.cov)) + least)
        count = 0
        for j in range(m):
            if requested[t, j] and not is_far(polygons, j, here, there, reach):
                best[count] = best_line(polygons, j, here, there, least)
                near[count] = j
                count += 1
        risk[t] = 0.0
        for k in range(slots):
            line[t, k, 0], line[t, k, 1], line[t, k, 2], line[t, k, 3] = 0.0, 0.0, 0.0, SURE
            owner[t, k] = -1
        used = 0
        while count > 0:
            i = 0
            for k in range(1, count):
                if best[k, 3] < best[i, 3]:
                    i = k
            east, north, offset, z = best[i]
            risk[t] += tail(z, 1.0)
            if used < slots:
                line[t, used, 0], line[t, used, 1] = east, north
                line[t, used, 2], line[t, used, 3] = offset, min(z, SURE)
                owner[t, used] = near[i]
                used += 1
            left = 0
            for k in range(count):
                if k != i and support(polygons, near[k], east, north) > offset + ROUNDING:
                    near[left] = near[k]
                    best[left] = best[k]
                    left += 1
            count = left


@allocating
def lines_of_each(polygons: Corners, x: FloatArray, cov: FloatArray, least: float, line: FloatArray) -> None:
    """Fill ``line`` (T, m, 4) with the best line of each segment and polygon: c, offset and z.

    z is ``SURE`` where the polygon is more than ``FAR`` standard deviations away.
    """
    for t in range(len(x) - 1):
        here = Gaussian(Point(x[t, 0], x[t, 1]), Cov(cov[t, 0], cov[t, 1], cov[t, 2]))
        there = Gaussian(Point(x[t + 1, 0], x[t + 1, 1]), Cov(cov[t + 1, 0], cov[t + 1, 1], cov[t + 1, 2]))
        reach = FAR * math.sqrt(max(largest(here.cov), largest(there.cov)) + least)
        for j in range(len(polygons.radius)):
            line[t, j, 0], line[t, j, 1], line[t, j, 2], line[t, j, 3] = 0.0, 0.0, 0.0, SURE
            if not is_far(polygons, j, here, there, reach):
                one = best_line(polygons, j, here, there, least)
                line[t, j, 0], line[t, j, 1], line[t, j, 2], line[t, j, 3] = one


@kernel
def largest(cov: Cov) -> float:
    """An upper bound of the largest eigenvalue (Gershgorin) [m²]."""
    return max(cov.xx, cov.yy) + abs(cov.xy)
