"""Polygons with fewer corners that contain a polygon, or lie inside it.

The outline is moved by half of the tolerance, outwards or inwards, and simplified by less than that (Douglas
and Peucker, 1973, doi:10.3138/FM57-6770-U75U-7727), so that it cannot reach the original outline again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import shapely

ARC = 4  # segments of a quarter circle around a moved corner; they reduce its radius by up to 2 %
WITHIN = 0.9  # tolerance of the simplification, as a share of the distance moved
HALVINGS = 8  # how often a tolerance that closes a bay is halved
CLOSED = 1e-5  # narrower gaps, as a share of the size of the map, count as closed
OWN_SHARE = 0.05  # largest move of an outline, as a share of the square root of the polygon's area
GAP_SHARE = 0.25  # largest move of an outline, as a share of the gap to the next outline or to the start


@dataclass(frozen=True, slots=True)
class Room:
    """The shapes on a map of ``size`` [m], whose gaps limit how far an outline may move."""

    tree: shapely.STRtree
    size: float

    @classmethod
    def of(cls, shapes: Iterable[shapely.Geometry], size: float) -> Room:
        """Make the record of ``shapes`` on a map of ``size`` [m]."""
        import shapely

        return cls(shapely.STRtree(list(shapes)), size)

    def tolerance(self, shape: shapely.Polygon, most: float) -> float:
        """How far [m] the outline of ``shape`` may move, at most ``most``, so that all gaps stay open."""
        import shapely

        widest = min(most, OWN_SHARE * math.sqrt(shape.area))
        near = self.tree.query(shape, predicate="dwithin", distance=widest / GAP_SHARE)
        gaps = shapely.distance(shape, self.tree.geometries[near])
        return min(widest, GAP_SHARE * float(np.min(gaps[gaps > CLOSED * self.size], initial=math.inf)))


def corner_count(shape: shapely.Geometry) -> int:
    """Number of corners of all rings of a shape."""
    import shapely

    return int(shapely.get_num_coordinates(shape)) - len(shapely.get_rings(shapely.get_parts(shape)))


def widened_polygon(polygon: shapely.Polygon, tolerance: float) -> shapely.Polygon:
    """A simpler polygon that contains ``polygon`` and extends at most ``tolerance`` [m] beyond it.

    Small bays and holes are filled. If a larger bay would be closed, the tolerance is halved until it stays
    open.
    """
    polygon = without_pools(polygon, tolerance)
    for _ in range(HALVINGS):
        found = without_pools(_moved(polygon, 0.5 * tolerance), tolerance)
        if len(found.interiors) == len(polygon.interiors):
            return found
        tolerance /= 2
    return polygon


def narrowed_polygon(polygon: shapely.Polygon, tolerance: float) -> shapely.Geometry:
    """A polygon inside ``polygon`` whose outline is at most ``tolerance`` [m] away, except in bottlenecks.

    Parts that are narrower than the tolerance are removed, so the result may have several parts. If nothing
    remains, ``polygon`` is returned.
    """
    found = _moved(polygon, -0.5 * tolerance)
    return polygon if found.is_empty else found


def without_pools(polygon: shapely.Polygon, size: float) -> shapely.Polygon:
    """``polygon`` without the holes whose area is at most the area of a circle with radius ``size`` [m]."""
    import shapely

    holes = [ring for ring in polygon.interiors if shapely.Polygon(ring).area > math.pi * size**2]
    return shapely.Polygon(polygon.exterior, holes)


def _moved(polygon: shapely.Polygon, distance: float) -> Any:
    """``polygon`` with its outline moved outwards by ``distance`` [m], and simplified by less than that.

    GEOS (3.12 and later) also removes the first corner of a ring if it is near the simplified outline, which
    may then deviate by twice the tolerance. If this breaks a guarantee, half the tolerance is used.
    """
    import shapely

    moved, limit = shapely.buffer(polygon, distance, quad_segs=ARC), WITHIN * abs(distance)
    found = shapely.simplify(moved, limit)
    outer, inner = (found, polygon) if distance > 0.0 else (polygon, found)
    if outer.covers(inner) and not shapely.hausdorff_distance(moved, found) > limit:
        return found
    return shapely.simplify(moved, limit / 2)
