"""Conversion of polygons with holes or several parts to simple polygons without a common area, and back."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    import shapely

Corner = tuple[float, float]
Triangle = tuple[Corner, Corner, Corner]


def outlines_of(shape: shapely.Geometry) -> tuple[FloatArray, ...]:
    """Simple polygons (n, 2), counter-clockwise, that tile the polygons of ``shape``, without new corners.

    A polygon without holes is not changed. One with holes is cut along diagonals into few polygons.
    """
    import shapely

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


def united_rings(outlines: Sequence[FloatArray]) -> list[list[FloatArray]]:
    """The union of ``outlines`` as polygons: the rings (n, 2) of each, the outer one first.

    This is the inverse of :func:`outlines_of`.
    """
    import shapely

    if len(outlines) < 2:
        return [[outline] for outline in outlines]
    whole = shapely.union_all([shapely.Polygon(outline) for outline in outlines])
    return [
        [shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)]
        for part in shapely.get_parts(shapely.orient_polygons(whole)).tolist()
    ]


def _without_holes(polygon: Any) -> list[FloatArray]:
    """Simple polygons that tile a polygon with holes.

    Each starts as a triangle of the constrained Delaunay triangulation. A triangle is added across an edge if
    its third corner is not yet in the outline, so that the outline never touches itself.
    """
    import shapely

    found = shapely.get_coordinates(shapely.constrained_delaunay_triangles(polygon)).reshape(-1, 4, 2)
    triangles: list[Triangle] = [_left_turn(*map(tuple, three)) for three in found[:, :3].tolist()]
    owner = {edge: k for k, (a, b, c) in enumerate(triangles) for edge in ((a, b), (b, c), (c, a))}
    left, parts = dict.fromkeys(range(len(triangles))), []
    while left:
        ring = _grown_ring(triangles, owner, left)
        if shapely.Polygon(ring).area > 0:
            parts.append(np.array(ring))
    return parts


def _left_turn(a: Corner, b: Corner, c: Corner) -> Triangle:
    area = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
    return (a, b, c) if area >= 0 else (a, c, b)


def _grown_ring(
    triangles: Sequence[Triangle], owner: dict[tuple[Corner, Corner], int], left: dict[int, None]
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
