"""Lines and polygons in longitude and latitude, cut at the 180th meridian."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pareto_ltl.extend import Frame
from pareto_ltl.support.arrays import FloatArray

# --- the 180th meridian -----------------------------------------------------------------------


def crosses(lonlats: FloatArray) -> bool:
    """Whether a line of (N, 2) [deg] jumps from one end of the longitudes to the other."""
    return bool((np.abs(np.diff(lonlats[:, 0])) > 180.0).any())


def closes(ring: FloatArray) -> bool:
    """Whether a closed ring of (N, 2) [deg] does not go around a pole."""
    return bool(abs(_unwrapped(ring)[-1, 0] - ring[0, 0]) < 180.0)


def line_parts(line: FloatArray) -> list[FloatArray]:
    """A line, cut where it crosses the 180th meridian, as GeoJSON requires (RFC 7946, 3.1.9)."""
    import shapely

    if not crosses(line):
        return [line]
    return [shapely.get_coordinates(part) for part in _cut(shapely.LineString(_unwrapped(line)))]


def polygon_parts(rings: Sequence[FloatArray]) -> list[list[FloatArray]]:
    """A polygon of closed ``rings``, the outline first, cut at the 180th meridian: the rings of each part."""
    import shapely

    if not any(map(crosses, rings)):
        return [list(rings)]
    turned = [_unwrapped(ring) for ring in rings]
    middle = float(turned[0][:, 0].mean())
    holes = [ring - np.array([360.0 * round((ring[0, 0] - middle) / 360.0), 0.0]) for ring in turned[1:]]
    parts = shapely.orient_polygons(_cut(shapely.Polygon(turned[0], holes)))
    return [[shapely.get_coordinates(ring) for ring in (p.exterior, *p.interiors)] for p in parts]


def _unwrapped(line: FloatArray) -> FloatArray:
    """The line with longitudes without jumps; the first one is unchanged."""
    return np.column_stack([np.rad2deg(np.unwrap(np.deg2rad(line[:, 0]))), line[:, 1]])


def _cut(shape: Any) -> list[Any]:
    """The shapely lines or polygons of ``shape``, each moved into -180 to 180."""
    import shapely

    parts = []
    for turn in (-360.0, 0.0, 360.0):
        within = shapely.intersection(shape, shapely.box(turn - 180.0, -90.0, turn + 180.0, 90.0))
        for part in shapely.get_parts(within):
            if part.geom_type == shape.geom_type and not part.is_empty:
                places = np.round(shapely.get_coordinates(part) - [turn, 0.0], Frame.DECIMALS)
                parts.append(shapely.set_coordinates(part, places))
    return parts


def united_rings(outlines: Sequence[FloatArray]) -> list[list[FloatArray]]:
    """The union of ``outlines`` as polygons: the rings (n, 2) of each, the outer one first.

    This is the inverse of ``world.polygons.outlines_of``.
    """
    import shapely

    if len(outlines) < 2:
        return [[outline] for outline in outlines]
    whole = shapely.union_all([shapely.Polygon(outline) for outline in outlines])
    return [
        [shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)]
        for part in shapely.get_parts(shapely.orient_polygons(whole)).tolist()
    ]
