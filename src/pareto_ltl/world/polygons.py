"""Polygons with holes as few convex parts, with exact predicates on an integer grid, and as simple polygons.

The triangles of a constrained Delaunay triangulation are merged across every diagonal whose two ends stay
convex (Hertel and Mehlhorn, 1983, doi:10.1007/3-540-12689-9_105), long diagonals first. On the two maps of
the package this gives one part more than the minimum without new corners (30 instead of 29 and 38 instead of
37 cells; an integer programme finds the minimum in 0.9 s). Short diagonals first gives 4 to 7 parts more.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import numpy as np
import shapely

from pareto_ltl.support.arrays import FloatArray

Number = TypeVar("Number", int, float)
Node = tuple[Number, Number]
Triangle = tuple[Node[Number], Node[Number], Node[Number]]
Corner = tuple[float, float]
GridNode = tuple[int, int]
GridRing = list[GridNode]
GridEdge = tuple[GridNode, GridNode]
GridCorner = tuple[GridNode, GridNode, GridNode]  # previous, node, next; the polygon lies to the left

BEND_STEPS = 2.0  # [grid steps]; snapping a crossing to the grid bends an edge by up to 1
KINK_ANGLE = 1e-6  # [rad]


def signed_turn(a: Node[Number], b: Node[Number], c: Node[Number]) -> Number:
    """Twice the signed area of a, b, c: positive for a left turn at ``b``."""
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])


def ring_edges(ring: Sequence[GridNode]) -> Iterator[GridEdge]:
    """The edges of a ring: pairs of consecutive nodes."""
    return zip(ring, [*ring[1:], ring[0]], strict=True)


def ring_corners(ring: Sequence[GridNode]) -> Iterator[GridCorner]:
    """The corners of a ring: triples of consecutive nodes, one for each node."""
    return zip([ring[-1], *ring[:-1]], ring, [*ring[1:], ring[0]], strict=True)


def is_left(a: GridNode, b: GridNode, c: GridNode) -> bool:
    """Whether a, b, c turn left or go straight on; a right turn due to snapping to the grid is allowed.

    Such a turn keeps ``b`` within ``BEND_STEPS`` of the line a, c, and its angle is below ``KINK_ANGLE``. The
    second condition is needed for nodes a few steps apart, where every corner is close to the line.
    """
    bend = signed_turn(a, b, c)
    return bend >= 0 or -bend <= min(
        BEND_STEPS * math.dist(a, c), KINK_ANGLE * math.dist(a, b) * math.dist(b, c)
    )


def convex_parts(outline: GridRing, holes: Sequence[GridRing] = ()) -> list[GridRing]:
    """Counter-clockwise convex rings that tile the polygon, without new corners.

    ``outline`` is counter-clockwise, ``holes`` are clockwise. Rings keep flat corners, at which they go
    straight on, so that neighbours share whole edges; :func:`drop_flat` removes these corners.
    """
    if not holes and all(is_left(*corner) for corner in ring_corners(outline)):
        return [outline]
    return merge_triangles(triangulate(shapely.Polygon(outline, holes), int))


def drop_flat(ring: GridRing) -> GridRing:
    """``ring`` without corners at which it goes straight on; empty if its area is 0."""
    ring = list(ring)
    i, turns = 0, 0  # turns: number of consecutive corners that turn left
    while len(ring) > 2 and turns < len(ring):
        i %= len(ring)
        if signed_turn(ring[i - 1], ring[i], ring[(i + 1) % len(ring)]) > 0:
            i, turns = i + 1, turns + 1
        else:
            ring.pop(i)
            i, turns = i - 1, max(0, turns - 2)
    return ring if len(ring) > 2 else []


# --- triangles ------------------------------------------------------------------------------------


def triangulate(polygon: shapely.Polygon, kind: type[Number]) -> list[Triangle[Number]]:
    """Constrained Delaunay triangulation: counter-clockwise triangles of the corners, as ``kind`` numbers."""
    found = shapely.get_coordinates(shapely.constrained_delaunay_triangles(polygon)).astype(kind)
    corners = [tuple(map(tuple, three)) for three in found.reshape(-1, 4, 2)[:, :3].tolist()]
    return [(a, b, c) if signed_turn(a, b, c) >= 0 else (a, c, b) for a, b, c in corners]


# --- merging --------------------------------------------------------------------------------------


def merge_triangles(found: Sequence[GridCorner]) -> list[GridRing]:
    """Merge triangles into convex rings, in one pass: a diagonal that is needed once remains needed."""
    cells: list[GridRing] = [list(three) for three in found]
    owner = {edge: i for i, ring in enumerate(cells) for edge in ring_edges(ring)}
    diagonals = [(a, b) for a, b in owner if a < b and (b, a) in owner]
    for a, b in sorted(diagonals, key=lambda edge: (-math.dist(*edge), edge)):
        i, j = owner[a, b], owner[b, a]
        left, right = rotated_ring(cells[i], b), rotated_ring(cells[j], a)  # b ... a and a ... b
        if is_left(left[-2], a, right[1]) and is_left(right[-2], b, left[1]):
            cells[i], cells[j] = left[:-1] + right[:-1], []
            owner.update((edge, i) for edge in ring_edges(cells[i]))
    return [ring for ring in cells if ring]


def rotated_ring(ring: GridRing, node: GridNode) -> GridRing:
    """``ring`` from ``node`` on."""
    i = ring.index(node)
    return ring[i:] + ring[:i]


# --- polygons with holes or several parts -----------------------------------------------------------


def outlines_of(shape: shapely.Geometry) -> tuple[FloatArray, ...]:
    """Simple polygons (n, 2), counter-clockwise, that tile the polygons of ``shape``, without new corners.

    A polygon without holes is not changed. One with holes is cut along diagonals into few polygons.
    """
    found: list[FloatArray] = []
    for part in shapely.get_parts(shape).tolist():
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        if len(part.interiors):
            found += _without_holes(part)
        else:
            ring: FloatArray = shapely.get_coordinates(part)[:-1]
            found.append(ring if shapely.is_ccw(part.exterior) else ring[::-1].copy())
    return tuple(found)


def _without_holes(polygon: Any) -> list[FloatArray]:
    """Simple polygons that tile a polygon with holes.

    Each starts as a triangle of the constrained Delaunay triangulation. A triangle is added across an edge if
    its third corner is not yet in the outline, so that the outline never touches itself.
    """
    triangles = triangulate(polygon, float)
    owner = {edge: k for k, (a, b, c) in enumerate(triangles) for edge in ((a, b), (b, c), (c, a))}
    left, parts = dict.fromkeys(range(len(triangles))), []
    while left:
        ring = _grown_ring(triangles, owner, left)
        if shapely.Polygon(ring).area > 0:
            parts.append(np.array(ring))
    return parts


def _grown_ring(
    triangles: Sequence[Triangle[float]],
    owner: dict[tuple[Corner, Corner], int],
    left: dict[int, None],
) -> list[Corner]:
    """A ring of as many adjacent triangles as can be added; they are removed from ``left``."""
    first = next(iter(left))
    del left[first]
    a, b, c = triangles[first]
    after, edges = {a: b, b: c, c: a}, deque([(a, b), (b, c), (c, a)])
    while edges:
        start, end = edges.popleft()
        k = owner.get((end, start), -1)
        if k not in left:
            continue
        tip = next(corner for corner in triangles[k] if corner not in (start, end))
        if tip not in after:
            del left[k]
            after[start], after[tip] = tip, end
            edges += [(start, tip), (tip, end)]
    ring = [a]
    while after[ring[-1]] != a:
        ring.append(after[ring[-1]])
    return ring
