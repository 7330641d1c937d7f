"""A plane on the Earth and a clock, and a course in the terms of navigation.

A plane is named by its PROJ string. :func:`local_plane` is the oblique stereographic projection. It is
defined at every latitude and conformal, so that one angle rotates vectors of all directions.
Its relative scale error at a distance r from the centre is

    (r / 2R)²

with the radius R of the Earth: 0.3 % at 700 km.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from careful_io.errors import DataError
from careful_io.messages import shown_text, shown_value
from careful_io.projections import refuse_files
from careful_io.times import utc_moment
from flight_quantities.arrays import FloatArray

if TYPE_CHECKING:
    import pyproj


SAG = 0.5  # [m] largest distance between a line of the plane and the line that a reader draws
EARTH = 6.371e6  # [m]
MAX_POINTS = 200  # added to a line


def local_plane(lat: float, lon: float) -> str:
    """PROJ string of the stereographic plane centred at ``lat``, ``lon`` [deg]; DataError if out of range."""
    if not -90 <= lat <= 90 or not -180 <= lon <= 360:
        raise DataError(
            f"latitude {lat:g}, longitude {lon:g} is not on Earth: expected -90..90 and -180..180"
        )
    lon = (lon + 180) % 360 - 180
    return f"+proj=stere +lat_0={lat:.10g} +lon_0={lon:.10g} +k=1 +datum=WGS84 +units=m +no_defs"


@lru_cache(maxsize=32)
def _cached_projection(crs: str, name: str) -> pyproj.Proj:
    import pyproj  # takes 0.2 s, and planes without a place on Earth do not need it

    refuse_files(crs)
    try:
        proj = pyproj.Proj(crs)
    except pyproj.exceptions.CRSError as error:
        reason = str(error).splitlines()[0]
        raise DataError(f"PROJ does not know {name} {shown_value(crs)}: {shown_text(reason)}") from None
    if proj.crs.is_geographic:
        raise DataError(f"{name} {shown_value(crs)} is in degrees; expected a plane in metres")
    return proj


@dataclass(frozen=True, slots=True)
class Navigation:
    """A course of T steps in the terms of navigation.

    Attributes
    ----------
    airspeed : (T,) float
        Speed through the air [m/s].
    time_utc : tuple of T + 1 str, or None
        ISO 8601 times; None if the time of the begin is not known.
    crs : str or None
        PROJ string of the plane; for a plane without position on Earth, this and the next three are None.
    lat, lon : (T+1,) float or None
        WGS84 [deg].
    heading_true : (T,) float or None
        Direction of the nose, clockwise from true north, 0 <= heading < 360 [deg]; NaN at zero airspeed.
    """

    airspeed: FloatArray
    time_utc: tuple[str, ...] | None = None
    crs: str | None = None
    lat: FloatArray | None = None
    lon: FloatArray | None = None
    heading_true: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Frame:
    """Plane and clock: metres to longitude and latitude, seconds to UTC.

    A program can name the projection and its cure in errors by ``CRS`` and ``UNPLACED`` of a subclass. In a
    plane on Earth x points east and y north at the centre of the plane.

    Attributes
    ----------
    crs : str or None
        PROJ string of the plane; None for a plane without position on Earth.
    time_zero : str or None
        The time that seconds count from, ISO 8601 UTC; None if it is not known.
    """

    DECIMALS: ClassVar[int] = 8  # of degrees: a millimetre
    CRS: ClassVar[str] = "crs"
    UNPLACED: ClassVar[str] = "the frame has no place on Earth: give it a projection"
    crs: str | None
    time_zero: str | None = None

    @classmethod
    def at(cls, lat: float, lon: float) -> Self:
        """The stereographic plane centred at ``lat``, ``lon`` [deg]; DataError if out of range."""
        return cls(local_plane(lat, lon))

    @property
    def on_earth(self) -> bool:
        """Whether positions have a longitude and a latitude."""
        return self.crs is not None

    def to_plane(self, lon: Any, lat: Any) -> FloatArray:
        """Positions (N, 2) [m] of longitudes and latitudes (N,) [deg]; DataError if too far away."""
        x, y = self._projection(np.atleast_1d(np.asarray(lon, float)), np.atleast_1d(np.asarray(lat, float)))
        xy: FloatArray = np.stack([x, y], axis=-1)
        if not np.isfinite(xy).all():
            bad = int(np.flatnonzero(~np.isfinite(xy).all(axis=-1).ravel())[0])
            where = f"longitude {np.ravel(lon)[bad]:g}, latitude {np.ravel(lat)[bad]:g}"
            raise DataError(
                f"{where} cannot be drawn in the plane {shown_value(self.crs)}: it lies too far from its "
                "centre"
            )
        return xy

    def to_geographic(self, xy: Any) -> tuple[FloatArray, FloatArray]:
        """Longitudes and latitudes (N,) [deg] of positions (N, 2) [m]; DataError if outside the plane."""
        xy = np.atleast_2d(np.asarray(xy, float))
        lon, lat = self._projection(xy[..., 0], xy[..., 1], inverse=True)
        if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
            raise DataError(
                f"a position lies outside the plane {shown_value(self.crs)}: check that coordinates are in "
                "metres"
            )
        return np.asarray(lon, float), np.asarray(lat, float)

    def north(self, xy: Any) -> FloatArray:
        """Angle from +y to true north at positions (N, 2) [m], counter-clockwise, (N,) [rad]."""
        return self.convergence(*self.to_geographic(xy))

    def convergence(self, lon: Any, lat: Any) -> FloatArray:
        """:meth:`north` at longitudes and latitudes (N,) [deg], the meridian convergence, (N,) [rad]."""
        factors = self._projection.get_factors(
            np.atleast_1d(np.asarray(lon, float)), np.atleast_1d(np.asarray(lat, float)), errcheck=True
        )
        return np.asarray(np.deg2rad(factors.meridian_convergence), float)

    def heading(self, xy: Any, u: FloatArray) -> FloatArray:
        """Directions of ``u`` (T, 2) at positions ``xy`` (T, 2) [m], clockwise from true north, (T,) [deg].

        NaN where u is 0. With the meridian convergence γ, counter-clockwise from +y of the plane to true
        north,

            heading = atan2(u_x, u_y) + γ    (mod 360 deg).
        """
        if not len(u):
            return np.empty(0)
        grid = np.arctan2(u[:, 0], u[:, 1])
        heading = np.rad2deg(grid + self.north(xy)) % 360.0
        heading[heading >= 360.0] = 0.0  # a tiny negative angle, rounded
        return np.where(u.any(axis=1), heading, np.nan)

    def utc(self, t: Any) -> tuple[str, ...] | None:
        """``t`` (N,) [s since ``time_zero``] as ISO 8601; None without ``time_zero`` or after year 9999."""
        if self.time_zero is None:
            return None
        start = utc_moment(self.time_zero)
        try:
            times = [start + timedelta(seconds=float(seconds)) for seconds in t]
        except OverflowError:
            return None
        return tuple(time.isoformat().replace("+00:00", "Z") for time in times)

    def lonlat(self, points: FloatArray) -> FloatArray:
        """Longitude, -180 to 180, and latitude of ``points`` (..., 2) [m], of the same shape [deg]."""
        lon, lat = self.to_geographic(points.reshape(-1, 2))
        both = np.stack([lon, lat], axis=-1).round(self.DECIMALS)
        return np.asarray(both, float).reshape(points.shape)

    def line_degrees(self, points: FloatArray, sag: float = SAG) -> FloatArray:
        """Longitude and latitude (M, 2) [deg] of the line through ``points`` (N, 2) [m], M at least 2.

        Straight lines of the plane are not straight on other maps. Points are added, so that a reader that
        joins them by great circles or by straight lines in degrees deviates by at most ``sag`` [m].
        """
        return self.lonlat(self._denser(points, sag))

    def outline_degrees(self, corners: FloatArray, sag: float = SAG) -> FloatArray:
        """Longitude and latitude (M, 2) [deg] around a polygon of ``corners`` (N, 2) [m], closed."""
        return self.line_degrees(np.concatenate([corners, corners[:1]]), sag)

    def _denser(self, points: FloatArray, sag: float) -> FloatArray:
        """``points`` (N, 2) [m] of a line, with more along each segment, (M, 2) [m], M at least 2.

        A chord of length l along a parallel at the latitude φ is l² tan φ / 8 R from the parallel.
        """
        if len(points) == 1:
            return np.repeat(points, 2, axis=0)
        _, lat = self.to_geographic(points)
        bend = max(math.tan(math.radians(min(float(np.abs(lat).max()), 89.0))), 0.1)
        longest = math.sqrt(8.0 * EARTH * sag / bend)
        parts = []
        for a, b in pairwise(points):
            n = min(max(1, math.ceil(math.dist(a, b) / longest)), MAX_POINTS)
            parts.append(a + (b - a) * (np.arange(n) / n)[:, None])
        return np.concatenate([*parts, points[-1:]])

    def navigation(self, t: FloatArray, x: FloatArray, u: FloatArray) -> Navigation:
        """A course for navigators: ``t`` (T+1,) [s], ``x`` (T+1, 2) [m], controls ``u`` (T, 2) [m/s]."""
        airspeed = np.hypot(u[:, 0], u[:, 1])
        times = self.utc(t)
        if self.crs is None:
            return Navigation(airspeed, times)
        lon, lat = self.to_geographic(x)
        return Navigation(airspeed, times, self.crs, lat, lon, self.heading(x[:-1], u))

    def largest_scale(self, bounds: FloatArray) -> float:
        """Largest scale factor (metres in the plane per metre on the ground) within ``bounds`` (2, 2) [m].

        In the planes of :func:`local_plane` it is at a corner. Corners, middles of the sides and the centre
        are evaluated.
        """
        return float(self._scales(bounds).max())

    def scale_error(self, bounds: FloatArray) -> float:
        """Largest relative error of lengths in the plane within ``bounds`` (2, 2) [m]."""
        return float(np.abs(self._scales(bounds) - 1.0).max())

    def _scales(self, bounds: FloatArray) -> FloatArray:
        """Scale factors along meridians and parallels at nine points of ``bounds``, (2, 9)."""
        sides = np.linspace(bounds[0], bounds[1], 3)
        lon, lat = self.to_geographic(np.stack(np.meshgrid(*sides.T), axis=-1).reshape(-1, 2))
        factors = self._projection.get_factors(lon, lat, errcheck=True)
        return np.array([factors.meridional_scale, factors.parallel_scale], float)

    @property
    def _projection(self) -> pyproj.Proj:
        if self.crs is None:
            raise DataError(self.UNPLACED)
        return _cached_projection(self.crs, self.CRS)
