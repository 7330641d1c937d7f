"""The polygons of a place: its parts and holes, with its buffer, clipped to the map."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text
from pareto_ltl.support.errors import DataError
from pareto_ltl.world import projection
from pareto_ltl.world.scene_sketch import Place, SceneSketch

if TYPE_CHECKING:
    import shapely

ARC = 4  # segments of a quarter circle around a corner of a buffer


def drawn_shape(sketch: SceneSketch, place: Place) -> shapely.Geometry:
    """The polygons of ``place`` without its buffer; DataError if one crosses itself or has no area.

    Parts that overlap or touch are merged. An outline without holes keeps its corners, counter-clockwise.
    """
    import shapely

    found = []
    for rings in place.polygons:
        outline, *holes = [_simple_outline(sketch, place.what, ring) for ring in rings]
        polygon = shapely.Polygon(outline, holes)
        if holes and not polygon.is_valid:
            at = _invalid_spot(polygon, outline)
            raise DataError(
                f"{sketch.where}: {place.what}: its holes cross its outline or each other at "
                f"{sketch.show(at)}; redraw them"
            )
        found.append(polygon)
    return found[0] if len(found) == 1 else shapely.union_all(found)


def with_buffer(
    sketch: SceneSketch, place: Place, shape: shapely.Geometry, outwards: bool
) -> shapely.Geometry:
    """``shape`` enlarged or reduced by the buffer of ``place``, with its points and lines as areas.

    With ``outwards``, the result contains all points within the buffer distance; otherwise it contains no
    point of ``shape`` closer to its outline than the buffer, and only points within the buffer distance of
    points and lines. The buffer is a distance on the ground, so it is multiplied by the largest scale of the
    map.

    Raises
    ------
    DataError
        If nothing is left.
    """
    import shapely

    if not place.buffer:
        return shape
    wide = place.buffer * largest_scale(sketch) / math.cos(math.pi / (4 * ARC))  # arcs contain the circle
    parts = [shape]
    if place.polygons:
        parts = [shapely.buffer(shape, wide if outwards else -wide, quad_segs=ARC)]
    reach = wide if outwards else place.buffer
    parts += [
        shapely.buffer(
            shapely.LineString(line) if len(line) > 1 else shapely.Point(line[0]), reach, quad_segs=ARC
        )
        for line in place.lines
    ]
    found = shapely.union_all(parts)
    if found.is_empty:
        raise DataError(
            f"{sketch.where}: nothing is left of {place.what} within its buffer of "
            f"{distance_text(place.buffer)}: it is too narrow; make the buffer smaller"
        )
    return found


def largest_scale(sketch: SceneSketch) -> float:
    """Largest scale factor of the map: metres in the plane per metre on the ground."""
    return 1.0 if sketch.crs is None else projection.largest_scale(sketch.crs, sketch.bounds)


def outside_of(sketch: SceneSketch, fence: Place) -> shapely.Geometry:
    """The part of the bounds that is outside a border ``fence`` reduced by its buffer."""
    import shapely

    inside = with_buffer(sketch, fence, drawn_shape(sketch, fence), outwards=False)
    return shapely.difference(shapely.box(*sketch.bounds.ravel()), inside)


def clipped_parts(sketch: SceneSketch, shape: shapely.Geometry) -> list[Any]:
    """The polygons of ``shape`` clipped to the bounds; those inside are returned unchanged."""
    import shapely

    low, high = sketch.bounds
    box: shapely.Polygon = shapely.box(*low, *high)
    least = sketch.tolerance * math.sqrt(box.area)
    found: list[Any] = []
    for part in shapely.get_parts(shape).tolist():
        corners = shapely.get_coordinates(part)
        if (corners >= low).all() and (corners <= high).all():
            found.append(part)
            continue
        pieces = shapely.get_parts(shapely.orient_polygons(shapely.intersection(part, box))).tolist()
        found += [
            shapely.transform(piece, lambda points: np.clip(points, low, high))
            for piece in pieces
            if piece.geom_type == "Polygon" and piece.area > least
        ]
    return found


def _simple_outline(sketch: SceneSketch, what: str, corners: FloatArray) -> FloatArray:
    """``corners`` in counter-clockwise order; DataError if the polygon is degenerate or crosses itself."""
    import shapely

    if _is_flat(corners, sketch.tolerance):
        raise DataError(
            f"{sketch.where}: {what} is degenerate: all its corners lie on one line, from "
            f"{sketch.show(corners[0])} on; give it an inside, or remove it"
        )
    polygon = shapely.Polygon(corners)
    if not polygon.is_valid:
        raise DataError(
            f"{sketch.where}: {what} crosses or touches its own outline at "
            f"{sketch.show(_invalid_spot(polygon, corners))}; list its corners in order along the outline"
        )
    return corners if shapely.is_ccw(shapely.LinearRing(corners)) else corners[::-1].copy()


def _invalid_spot(polygon: shapely.Polygon, corners: FloatArray) -> FloatArray:
    """The position at which GEOS finds ``polygon`` invalid, (2,) [m]."""
    import shapely

    spot = re.search(r"\[(\S+) (\S+)\]", shapely.is_valid_reason(polygon))
    return np.array([float(v) for v in spot.groups()]) if spot else corners[0]


def _is_flat(corners: FloatArray, tolerance: float) -> bool:
    """Whether all corners lie on one line, within ``tolerance`` [m]."""
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    return bool(spread[-1] <= tolerance)


__all__ = ["clipped_parts", "drawn_shape", "largest_scale", "outside_of", "with_buffer"]
