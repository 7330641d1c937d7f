"""The local plane of a geographic scene.

A plane is named by its PROJ string, which is stored in ``Scene.crs`` and ``scene.json``. We use the oblique
stereographic projection. It is defined at every latitude and conformal, so that one angle rotates wind
vectors of all directions. Its relative scale error at a distance r from the centre is

    (r / 2R)²

with the radius R of the Earth: 0.3 % at 700 km.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text, shown_value

if TYPE_CHECKING:
    import pyproj


def local_plane(lat: float, lon: float) -> str:
    """PROJ string of the stereographic plane centred at ``lat``, ``lon`` [deg]; DataError if out of range."""
    if not -90 <= lat <= 90 or not -180 <= lon <= 360:
        raise DataError(
            f"latitude {lat:g}, longitude {lon:g} is not on Earth: expected -90..90 and -180..180"
        )
    lon = (lon + 180) % 360 - 180
    return f"+proj=stere +lat_0={lat:.10g} +lon_0={lon:.10g} +k=1 +datum=WGS84 +units=m +no_defs"


def to_plane(crs: str, lon: FloatArray, lat: FloatArray) -> FloatArray:
    """Positions of ``lon``, ``lat`` (N,) [deg] in the plane, shape (N, 2) [m]; DataError if too far away."""
    x, y = _cached_projection(crs)(
        np.atleast_1d(np.asarray(lon, float)), np.atleast_1d(np.asarray(lat, float))
    )
    xy: FloatArray = np.stack([x, y], axis=-1)
    if not np.isfinite(xy).all():
        bad = int(np.flatnonzero(~np.isfinite(xy).all(axis=-1).ravel())[0])
        where = f"longitude {np.ravel(lon)[bad]:g}, latitude {np.ravel(lat)[bad]:g}"
        raise DataError(
            f"{where} cannot be drawn in the plane {shown_value(crs)}: it lies too far from its centre"
        )
    return xy


def to_geographic(crs: str, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Longitude and latitude [deg] of ``xy`` (N, 2) [m], (N,) each; DataError if outside the plane."""
    xy = np.atleast_2d(np.asarray(xy, float))
    lon, lat = _cached_projection(crs)(xy[..., 0], xy[..., 1], inverse=True)
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        raise DataError(
            f"a position lies outside the plane {shown_value(crs)}: check that coordinates are in metres"
        )
    return np.asarray(lon, float), np.asarray(lat, float)


def degrees_of(where: str, crs: str, points: FloatArray) -> FloatArray:
    """Longitude and latitude (N, 2) [deg] of ``points`` (N, 2) in the system ``crs``, e.g. ``EPSG:3857``.

    The order of the axes is east, north (or longitude, latitude), also if ``crs`` defines another order.

    Raises
    ------
    DataError
        If the system is unknown or a point lies outside of it; ``where`` begins the message.
    """
    import pyproj

    try:
        change = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except pyproj.exceptions.ProjError:
        raise DataError(
            f"{where}: PROJ does not know the crs {shown_value(crs)}; convert the map to "
            "longitude and latitude and leave crs out"
        ) from None
    lonlat = np.column_stack(change.transform(points[:, 0], points[:, 1]))
    if not np.isfinite(lonlat).all():
        x, y = points[~np.isfinite(lonlat).all(axis=1)][0]
        raise DataError(
            f"{where}: ({x:.6g}, {y:.6g}) lies outside of crs {shown_value(crs)}; check the units"
        )
    return lonlat


def meridian_convergence(crs: str, lon: FloatArray, lat: FloatArray) -> FloatArray:
    """Angle from +y of the plane to true north, counter-clockwise, shape (N,) [rad]."""
    factors = _cached_projection(crs).get_factors(
        np.atleast_1d(np.asarray(lon, float)), np.atleast_1d(np.asarray(lat, float)), errcheck=True
    )
    angle: FloatArray = np.deg2rad(np.asarray(factors.meridian_convergence, float))
    return angle


def largest_scale(crs: str, bounds: FloatArray) -> float:
    """Largest scale factor (metres in the plane per metre on the ground) within ``bounds`` (2, 2) [m].

    In the planes of :func:`local_plane` it is at a corner. Corners, middles of the sides and the centre are
    evaluated.
    """
    return float(_scales(crs, bounds).max())


def scale_error(crs: str, bounds: FloatArray) -> float:
    """Largest relative error of lengths in the plane within ``bounds`` (2, 2) [m]."""
    return float(np.abs(_scales(crs, bounds) - 1.0).max())


def _scales(crs: str, bounds: FloatArray) -> FloatArray:
    """Scale factors along meridians and parallels at nine points of ``bounds``, (2, 9)."""
    sides = np.linspace(bounds[0], bounds[1], 3)
    lon, lat = to_geographic(crs, np.stack(np.meshgrid(*sides.T), axis=-1).reshape(-1, 2))
    factors = _cached_projection(crs).get_factors(lon, lat, errcheck=True)
    return np.array([factors.meridional_scale, factors.parallel_scale], float)


def rotate_vectors(vectors: FloatArray, angle: FloatArray) -> FloatArray:
    """``vectors`` (N, 2) rotated counter-clockwise by ``angle`` (N,) [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


@lru_cache(maxsize=32)
def _cached_projection(crs: str) -> pyproj.Proj:
    import pyproj  # takes 0.2 s, and planar scenes do not need it

    try:
        proj = pyproj.Proj(crs)
    except pyproj.exceptions.CRSError as error:
        reason = str(error).splitlines()[0]
        raise DataError(f"PROJ does not know scene.crs {shown_value(crs)}: {shown_text(reason)}") from None
    if proj.crs.is_geographic:
        raise DataError(f"scene.crs {shown_value(crs)} is in degrees; expected a plane in metres")
    return proj
