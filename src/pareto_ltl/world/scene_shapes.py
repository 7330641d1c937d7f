"""The polygons of the places that are active: parts and holes, with buffers, clipped to the map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from careful_io.texts import distance_text
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.projection import Frame
from pareto_ltl.world.scene_mend import enclosed_area
from pareto_ltl.world.scene_sketch import Place, SceneSketch

ALMOST_STRAIGHT = 5e-4  # of the longer side of the map: how far its sides move to straighten the border
THINNEST = 1e-6  # of the longer side of the map: thinner parts along its edges are left out
ARC = 4  # segments of a quarter circle around a corner of a buffer


def drawn_shape(sketch: SceneSketch, place: Place) -> shapely.Geometry:
    """The polygons of ``place`` without its buffer; DataError if one crosses itself or has no area.

    Parts that overlap or touch are merged. An outline without holes keeps its corners, counter-clockwise.
    """
    found = [enclosed_area(sketch, place.what, rings) for rings in place.polygons]
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
    return 1.0 if sketch.crs is None else Frame(sketch.crs).largest_scale(sketch.bounds)


def _inside_of(sketch: SceneSketch, fence: Place) -> shapely.Geometry:
    """The inside of a border ``fence`` reduced by its buffer."""
    return with_buffer(sketch, fence, drawn_shape(sketch, fence), outwards=False)


def outside_parts(sketch: SceneSketch, fence: Place) -> list[Any]:
    """The polygons that lie within the bounds and outside of a border ``fence`` reduced by its buffer."""
    outside = shapely.difference(shapely.box(*sketch.bounds.ravel()), _inside_of(sketch, fence))
    return [part for part in shapely.get_parts(outside).tolist() if _is_thick(sketch, part)]


def straightened_bounds(sketch: SceneSketch, fence: Place) -> FloatArray:
    """The bounds (2, 2) [m] with the sides moved inwards where the border ``fence`` is almost straight.

    A border drawn as a rectangle in degrees or in another plane has slightly bent or turned sides here, and
    its outside would be slivers. A side of the bounds that corners of the border accompany, over half of its
    length and within ``ALMOST_STRAIGHT``, moves to the innermost of these corners, unless that would cut off
    the start or a part of a region or a landmark.
    """
    bounds, corners = sketch.bounds.copy(), shapely.get_coordinates(_inside_of(sketch, fence))
    sides = bounds[1] - bounds[0]
    places = [
        place.corners for place in (*sketch.regions, *sketch.landmarks) if place.polygons or place.lines
    ]
    used = np.concatenate([sketch.start.reshape(-1, 2), *places])
    for axis in (0, 1):
        for end, inwards in ((0, 1.0), (1, -1.0)):
            depth = inwards * (corners[:, axis] - bounds[end, axis])
            beside = depth <= ALMOST_STRAIGHT * sides.max()
            move = float(depth[beside].max(initial=0.0))
            long = np.ptp(corners[beside, 1 - axis]) > 0.5 * sides[1 - axis] if beside.any() else False
            if long and (inwards * (used[:, axis] - bounds[end, axis]) >= move).all():
                bounds[end, axis] += inwards * move
    return bounds


def clipped_parts(sketch: SceneSketch, shape: shapely.Geometry) -> list[Any]:
    """The polygons of ``shape`` clipped to the bounds; those inside are returned unchanged.

    Cut polygons thinner than ``THINNEST`` are left out: they lie along an edge of the map.
    """
    low, high = sketch.bounds
    box: shapely.Polygon = shapely.box(*low, *high)
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
            if _is_thick(sketch, piece)
        ]
    return found


def _is_thick(sketch: SceneSketch, part: Any) -> bool:
    """Whether ``part`` is a polygon with a mean width of ``THINNEST`` of the map or more."""
    size = float((sketch.bounds[1] - sketch.bounds[0]).max())
    return bool(part.geom_type == "Polygon" and 2 * part.area > THINNEST * size * part.length)


def refuse_crossings(outlines: Sequence[FloatArray]) -> None:
    """ValueError if one of ``outlines``, each (n, 2), crosses itself, as no outline of a result does."""
    for corners in outlines:
        if not shapely.Polygon(corners).is_valid:
            raise ValueError(f"the outline from {corners[0].tolist()} on crosses itself")
