"""Lines and polygons of the plane as longitude and latitude, in WGS 84.

Straight lines of the plane are not straight on other maps. Points are added along them, so that a reader that
joins points by great circles or by straight lines in degrees deviates by at most :data:`SAG`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from pareto_ltl.extend import Frame
from pareto_ltl.support.arrays import FloatArray

SAG = 0.5  # [m] largest distance between a line of the plane and the line that a reader draws
EARTH = 6.371e6  # [m]
MOST_POINTS = 200  # added to a line
DECIMALS = 8  # of degrees: a millimetre


def denser(points: FloatArray, crs: str, sag: float = SAG) -> FloatArray:
    """``points`` (N, 2) [m] of a line, with more along each segment, (M, 2) [m], M at least 2.

    A chord of length l along a parallel at the latitude φ is l² tan φ / 8 R from the parallel.
    """
    if len(points) == 1:
        return np.repeat(points, 2, axis=0)
    _, lat = Frame(crs).to_geographic(points)
    bend = max(math.tan(math.radians(min(float(np.abs(lat).max()), 89.0))), 0.1)
    longest = math.sqrt(8.0 * EARTH * sag / bend)
    parts = []
    for a, b in pairwise(points):
        n = min(max(1, math.ceil(math.dist(a, b) / longest)), MOST_POINTS)
        parts.append(a + (b - a) * (np.arange(n) / n)[:, None])
    return np.concatenate([*parts, points[-1:]])


def line_degrees(crs: str, points: FloatArray, sag: float = SAG) -> FloatArray:
    """Longitude and latitude (M, 2) [deg] of the line through ``points`` (N, 2) [m]."""
    return lonlat(crs, denser(points, crs, sag))


def outline_degrees(crs: str, corners: FloatArray, sag: float = SAG) -> FloatArray:
    """Longitude and latitude (M, 2) [deg] around a polygon of ``corners`` (N, 2) [m], closed."""
    return line_degrees(crs, np.concatenate([corners, corners[:1]]), sag)


def lonlat(crs: str, points: FloatArray) -> FloatArray:
    """Longitude, -180 to 180, and latitude of ``points`` (..., 2) [m], of the same shape [deg]."""
    lon, lat = Frame(crs).to_geographic(points.reshape(-1, 2))
    return np.asarray(np.stack([lon, lat], axis=-1).round(DECIMALS), float).reshape(points.shape)


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
                places = np.round(shapely.get_coordinates(part) - [turn, 0.0], DECIMALS)
                parts.append(shapely.set_coordinates(part, places))
    return parts
