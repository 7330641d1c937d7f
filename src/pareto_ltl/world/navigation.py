"""A plan in the terms of navigation: times, positions on Earth, true headings, airspeeds."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.projection import meridian_convergence, to_geographic
from pareto_ltl.world.scene import Scene


@dataclass(frozen=True, slots=True)
class Navigation:
    """A plan of T steps in the terms of navigation.

    Attributes
    ----------
    airspeed : (T,) float
        Speed through the air [m/s].
    time_utc : tuple of T + 1 str, or None
        ISO 8601 times; None if the departure time is not known.
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


def navigate(scene: Scene, t: FloatArray, x: FloatArray, u: FloatArray) -> Navigation:
    """Navigation of times ``t`` (T+1,) [s], positions ``x`` (T+1, 2) [m] and controls ``u`` (T, 2) [m/s]."""
    airspeed = np.hypot(u[:, 0], u[:, 1])
    times = utc_times(scene.time_zero, t)
    if scene.crs is None:
        return Navigation(airspeed, times)
    lon, lat = to_geographic(scene.crs, x)
    heading = true_heading(scene.crs, lon[:-1], lat[:-1], u)
    return Navigation(airspeed, times, scene.crs, lat, lon, heading)


def true_heading(crs: str, lon: FloatArray, lat: FloatArray, u: FloatArray) -> FloatArray:
    """Directions of ``u`` (T, 2) at ``lon``, ``lat`` (T,) [deg], clockwise from true north, (T,) [deg].

    NaN where u is 0. With the meridian convergence γ, counter-clockwise from +y of the plane to true north,

        heading = atan2(u_x, u_y) + γ    (mod 360 deg).
    """
    if not len(u):
        return np.empty(0)
    grid = np.arctan2(u[:, 0], u[:, 1])
    heading = np.rad2deg(grid + meridian_convergence(crs, lon, lat)) % 360.0
    heading[heading >= 360.0] = 0.0  # a tiny negative angle, rounded
    return np.where(u.any(axis=1), heading, np.nan)


def utc_times(time_zero: str | None, t: FloatArray) -> tuple[str, ...] | None:
    """``t`` (N,) [s after ``time_zero``] as ISO 8601 times; None without ``time_zero`` or after year 9999."""
    if time_zero is None:
        return None
    start = datetime.fromisoformat(time_zero)
    start = start.replace(tzinfo=UTC) if start.tzinfo is None else start.astimezone(UTC)
    try:
        times = [start + timedelta(seconds=float(seconds)) for seconds in t]
    except OverflowError:
        return None
    return tuple(time.isoformat().replace("+00:00", "Z") for time in times)
