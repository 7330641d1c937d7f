"""Outlines that touch themselves, with the area that they enclose, where it is certain.

Spikes, keyholes (a hole joined to the outline by a cut), rings that meet in a corner, and holes that touch
the outline enclose the same area by every rule. An outline that crosses itself does not: its parts have
opposite signs, or count twice.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import shapely

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.scene_sketch import SceneSketch

UNCERTAIN = 1e-7  # of the longer side of the map: mean width of an area that counts as a rounding error


def enclosed_area(sketch: SceneSketch, what: str, rings: tuple[FloatArray, ...]) -> Any:
    """The area within an outline and outside of its holes, rings (n, 2) [m]; counter-clockwise.

    DataError if a ring has no area or crosses itself, or a hole crosses the outline or another hole. A valid
    outline without holes keeps its corners.
    """
    outline, *holes = [_one_area(sketch, what, ring) for ring in rings]
    if not holes:
        return outline
    whole = (
        shapely.Polygon(_ring(outline), [_ring(hole) for hole in holes])
        if _simple((outline, *holes))
        else None
    )
    if whole is not None and whole.is_valid:
        return whole
    limit = _doubt(sketch, [outline, *holes])
    beyond = [shapely.difference(hole, outline) for hole in holes]
    twice = shapely.area(holes).sum() - shapely.area(shapely.union_all(holes))
    outside = next((part for part in beyond if part.area > limit), None)
    if outside is None and twice <= limit:
        return _areas(shapely.difference(outline, shapely.union_all(holes)), limit)
    spot = outside if outside is not None else _common(holes)
    at = shapely.get_coordinates(shapely.point_on_surface(spot))[0]
    raise DataError(
        f"{sketch.where}: {what}: its holes cross its outline or each other at {sketch.show(at)}; redraw them"
    )


def _one_area(sketch: SceneSketch, what: str, corners: FloatArray) -> Any:
    """The polygon, or the polygons, that one ring encloses."""
    if _is_flat(corners, sketch.tolerance):
        raise DataError(
            f"{sketch.where}: {what} is degenerate: all its corners lie on one line, from "
            f"{sketch.show(corners[0])} on; give it an inside, or remove it"
        )
    polygon = shapely.Polygon(corners)
    if polygon.is_valid:
        return polygon if shapely.is_ccw(shapely.LinearRing(corners)) else shapely.Polygon(corners[::-1])
    limit = _doubt(sketch, [polygon])
    mended = _areas(_valid(polygon), limit)
    x, y = (corners - corners.mean(axis=0)).T
    signed = abs(0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))
    if mended.is_empty or abs(signed - mended.area) > limit:
        raise DataError(
            f"{sketch.where}: {what} crosses or touches its own outline at "
            f"{sketch.show(_invalid_spot(polygon, corners))}, and its area is not certain; list its "
            "corners in order along the outline"
        )
    return mended


def _valid(polygon: Any) -> Any:
    """``polygon`` made valid; empty where GEOS cannot, as with corners of very unlike sizes."""
    try:
        return shapely.make_valid(polygon)
    except shapely.errors.GEOSException:
        return shapely.Polygon()


def _doubt(sketch: SceneSketch, shapes: list[Any]) -> float:
    """The area [m²] that counts as a rounding error along the outlines of ``shapes``."""
    size = float((sketch.bounds[1] - sketch.bounds[0]).max())
    return UNCERTAIN * size * float(sum(map(shapely.length, shapes)))


def _areas(shape: Any, limit: float) -> Any:
    """The polygons of ``shape``, counter-clockwise, without slivers below ``limit`` [m²]."""
    parts = [part for part in _polygons(shape) if part.area > min(limit, 0.01 * shape.area)]
    found = [shapely.orient_polygons(part) for part in parts]
    return found[0] if len(found) == 1 else shapely.MultiPolygon(found)


def _polygons(shape: Any) -> list[Any]:
    return [
        part
        for many in shapely.get_parts([shape]).tolist()
        for part in shapely.get_parts([many]).tolist()
        if part.geom_type == "Polygon"
    ]


def _simple(shapes: tuple[Any, ...]) -> bool:
    """Whether each of ``shapes`` is one polygon without holes."""
    return all(shape.geom_type == "Polygon" and not len(shape.interiors) for shape in shapes)


def _ring(shape: Any) -> FloatArray:
    return np.asarray(shapely.get_coordinates(shape.exterior), float)


def _common(holes: list[Any]) -> Any:
    """The largest common area of two of ``holes``."""
    pairs = [shapely.intersection(one, other) for k, one in enumerate(holes) for other in holes[k + 1 :]]
    return max(pairs, key=shapely.area)


def _invalid_spot(polygon: shapely.Polygon, corners: FloatArray) -> FloatArray:
    """The position at which GEOS finds ``polygon`` invalid, (2,) [m]."""
    spot = re.search(r"\[(\S+) (\S+)\]", shapely.is_valid_reason(polygon))
    return np.array([float(v) for v in spot.groups()]) if spot else corners[0]


def _is_flat(corners: FloatArray, tolerance: float) -> bool:
    """Whether all corners lie on one line, within ``tolerance`` [m]."""
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    return bool(spread[-1] <= tolerance)
