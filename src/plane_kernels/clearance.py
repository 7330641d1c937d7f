"""Signed distances of segments from convex polygons, and where and in which direction they are measured."""

from __future__ import annotations

import math
from typing import NamedTuple

from plane_kernels.types import Corners, Faces, Point
from typed_kernels.jit import kernel

CERTAIN = 1e18  # [m] margin of a condition that cannot fail; -CERTAIN: of one that cannot hold
TINY = 1e-300


class Event(NamedTuple):
    """A signed distance ``margin`` [m] of one point of a sequence of segments, and its gradient.

    The point is at ``share`` (0 to 1) of segment ``t``; the gradient of the margin with respect to it is the
    unit vector (``nx``, ``ny``).
    """

    margin: float
    t: int
    nx: float
    ny: float
    share: float


@kernel
def face_clearance(
    faces: Faces, part: int, t: int, start: Point, end: Point, enough: float
) -> tuple[Event, int]:
    """Largest signed distance [m] of a segment from the line of one face, and the row of that face.

    The search stops at the first face with a distance of at least ``enough`` [m].
    """
    best, row = Event(-CERTAIN, t, 0.0, 0.0, 0.0), -1
    for j in range(faces.ptr[part], faces.ptr[part + 1]):
        nx, ny = faces.normal[j, 0], faces.normal[j, 1]
        a = nx * start.x + ny * start.y - faces.offset[j]
        b = nx * end.x + ny * end.y - faces.offset[j]
        if min(a, b) > best.margin:
            best, row = Event(a, t, nx, ny, 0.0) if a < b else Event(b, t, nx, ny, 1.0), j
            if best.margin >= enough:
                break
    return best, row


@kernel
def beside_edge(corners: Corners, part: int, edge: int, at: Point) -> bool:
    """Whether the projection of ``at`` onto the line of an edge lies on the edge."""
    first = corners.ptr[part] + edge
    last = first + 1 if first + 1 < corners.ptr[part + 1] else corners.ptr[part]
    px, py = corners.corner[first, 0], corners.corner[first, 1]
    ex, ey = corners.corner[last, 0] - px, corners.corner[last, 1] - py
    along = ex * (at.x - px) + ey * (at.y - py)
    return bool(0.0 <= along <= ex * ex + ey * ey)


@kernel
def segment_clearance(
    faces: Faces, corners: Corners, part: int, t: int, start: Point, end: Point, enough: float
) -> Event:
    """Signed distance [m] of a segment from a convex polygon: minus the penetration depth if they intersect.

    The penetration depth is the smallest along the normals of the faces and of the segment. If they do not
    intersect, the nearest pair of points has a corner of the polygon, or an end of the segment beside an
    edge. The search stops when the distance is known to be at least ``enough`` [m].

    Eq. (M53) of docs/mathematics_methods.md.
    """
    best, row = face_clearance(faces, part, t, start, end, enough)
    first, last = corners.ptr[part], corners.ptr[part + 1]
    if best.margin >= enough or first == last:
        return best
    dx, dy = end.x - start.x, end.y - start.y
    length = math.sqrt(dx * dx + dy * dy)
    dx, dy = (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)  # a point: any normal is valid
    low, high, at_low, at_high = CERTAIN, -CERTAIN, 0.0, 0.0
    near, rx, ry, at_near = CERTAIN, 0.0, 0.0, 0.0
    for c in range(first, last):
        px, py = corners.corner[c, 0] - start.x, corners.corner[c, 1] - start.y
        across, along = dx * py - dy * px, dx * px + dy * py
        if across < low:
            low, at_low = across, along
        if across > high:
            high, at_high = across, along
        beyond = along - min(max(along, 0.0), length)
        square = across * across + beyond * beyond
        if square < near:
            near, rx, ry, at_near = square, beyond * dx - across * dy, beyond * dy + across * dx, along
    nearest = end if best.share > 0.0 else start
    if best.margin > 0.0 and beside_edge(corners, part, row - faces.ptr[part], nearest):
        return best
    length = max(length, TINY)
    if best.margin > 0.0 or low > 0.0 or high < 0.0:
        near = max(math.sqrt(near), TINY)
        return Event(near, t, -rx / near, -ry / near, min(max(at_near / length, 0.0), 1.0))
    if low > best.margin:  # the polygon lies to the left: the segment must stay right of it
        best = Event(low, t, dy, -dx, min(max(at_low / length, 0.0), 1.0))
    if -high > best.margin:
        best = Event(-high, t, -dy, dx, min(max(at_high / length, 0.0), 1.0))
    return best


@kernel
def beyond_reach(corners: Corners, part: int, start: Point, end: Point, reach: float) -> bool:
    """Whether the bounding circles of a polygon and of a segment are more than ``reach`` [m] apart."""
    dx, dy = 0.5 * (end.x - start.x), 0.5 * (end.y - start.y)
    far = corners.radius[part] + math.sqrt(dx * dx + dy * dy) + max(reach, 0.0)
    ax, ay = corners.middle[part, 0] - start.x - dx, corners.middle[part, 1] - start.y - dy
    return bool(ax * ax + ay * ay > far * far)
