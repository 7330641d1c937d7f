"""Wind readings in the plane and on the clock of a scene."""

from __future__ import annotations

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.readings import Readings, farthest_points, iso, on_sphere, seconds
from pareto_ltl.wind.records import WindObservations
from pareto_ltl.world.scene import Scene

FEWEST_READINGS = 5  # readings near the scene, at each time
FIT_RADIUS = 500e3  # [m], about one correlation length of the 10 m wind over land
HORIZON_ANGLE = np.deg2rad(45.0)  # readings farther away carry no information and are distorted in the plane


def place_readings(cfg: WindConfig, readings: Readings, scene: Scene) -> WindObservations:
    """Wind readings in the plane of ``scene``, from the last time at or before departure on.

    Earth-relative winds are rotated by the meridian convergence; their speed is not scaled. Calm wind is one
    time without readings.

    Raises
    ------
    DataError
        If the frames of readings and scene differ, the readings do not cover the departure, or too few lie
        near the scene.
    ConfigError
        If the departure is not an ISO 8601 time.
    """
    if not len(readings.times):
        return WindObservations(np.zeros(1), (np.empty((0, 2)),), (np.empty((0, 2)),), cfg.source)
    _refuse_other_frame(readings, scene)
    zero = _departure_time(scene, readings)
    kept = _slots_from_departure(cfg, readings, zero)
    placed = [_readings_in_plane(cfg, scene, readings, k) for k in kept]
    return WindObservations(
        times=readings.times[kept] - zero,
        points=tuple(points for points, _ in placed),
        winds=tuple(winds for _, winds in placed),
        source=f"{cfg.source}: {', '.join(file.name for file in readings.files[:8])}"
        + (f" and {len(readings.files) - 8} more" if len(readings.files) > 8 else ""),
    )


def _refuse_other_frame(readings: Readings, scene: Scene) -> None:
    if readings.geographic and scene.crs is None:
        raise DataError(
            f"{readings.name} is in degrees but the scene lies nowhere on Earth; set scene.centre "
            "(latitude, longitude), or use wind.source=csv with columns time,x,y,u,v or wind.source=calm"
        )


def _departure_time(scene: Scene, readings: Readings) -> float:
    """Departure [s since 1970]: that of the scene, else the first time of the readings."""
    if scene.time_zero is None:
        return float(readings.times[0])
    try:
        return seconds(scene.time_zero)
    except ValueError:
        raise ConfigError(
            f"mission.start_time {scene.time_zero!r} is no ISO 8601 time; expected e.g. 2018-10-09T18:00:00Z"
        ) from None


def _slots_from_departure(cfg: WindConfig, readings: Readings, zero: float) -> IntArray:
    """Indices of the times from the last one at or before departure ``zero`` [s since 1970] on."""
    times = readings.times
    spell = f"{iso(times[0])} .. {iso(times[-1])}"
    name = readings.name
    if len(times) == 1 and not cfg.hold_last:
        raise DataError(
            f"{name} holds one wind time only ({iso(times[0])}), which covers no flight; "
            "add later times, or let it stand for all with wind.hold_last=true"
        )
    if zero < times[0] or (zero >= times[-1] and not cfg.hold_last):
        raise DataError(
            f"departure {iso(zero)} is not covered by the wind of {name} ({spell}); "
            "choose mission.start_time inside, or add wind files"
        )
    start = int(np.searchsorted(times, zero, side="right")) - 1
    return np.arange(start, len(times))


def _readings_in_plane(
    cfg: WindConfig, scene: Scene, readings: Readings, k: int
) -> tuple[FloatArray, FloatArray]:
    """Positions [m] and winds [m/s] of time k in the plane, at most ``wind.max_points``."""
    points, winds = readings.points[k], readings.winds[k]
    reach = max(cfg.padding, float(np.max(scene.bounds[1] - scene.bounds[0])))
    if readings.geographic:
        points, winds = project_readings(str(scene.crs), scene.bounds.mean(axis=0), points, winds)
        reach = max(cfg.padding, FIT_RADIUS)
    gap = _distance_to_box(scene.bounds, points)
    near = int(np.sum(gap <= reach))
    if near < FEWEST_READINGS:
        raise DataError(
            f"{readings.name}: {near} wind readings within {reach / 1e3:g} km of the scene at "
            f"{iso(readings.times[k])}, expected at least {FEWEST_READINGS}; "
            "is the scene where the wind data is?"
        )
    chosen = _readings_for_fit(cfg, scene.bounds.mean(axis=0), points, gap)
    return points[chosen], winds[chosen]


def project_readings(
    crs: str, centre: FloatArray, lonlat: FloatArray, winds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions [m] and winds [m/s], in the plane ``crs``, of readings near ``centre`` (2,) [m]."""
    from pareto_ltl.world import projection

    middle = on_sphere(np.stack(projection.to_geographic(crs, centre), axis=1))
    close = (on_sphere(lonlat) @ middle.T).ravel() >= np.cos(HORIZON_ANGLE)
    lon, lat = lonlat[close].T
    if not len(lon):
        return np.empty((0, 2)), np.empty((0, 2))
    turned = projection.rotate_vectors(winds[close], projection.meridian_convergence(crs, lon, lat))
    return projection.to_plane(crs, lon, lat), turned


def _distance_to_box(bounds: FloatArray, points: FloatArray) -> FloatArray:
    """Distance (N,) [m] from ``points`` (N, 2) to the rectangle ``bounds``; 0 inside."""
    outside = np.maximum(0.0, np.maximum(bounds[0] - points, points - bounds[1]))
    distance: FloatArray = np.hypot(outside[:, 0], outside[:, 1])
    return distance


def _readings_for_fit(cfg: WindConfig, centre: FloatArray, points: FloatArray, gap: FloatArray) -> IntArray:
    """Indices of the readings for the fit: all, or an even selection inside the lattice, or the nearest."""
    if len(points) <= cfg.max_points:
        return np.arange(len(points))
    inside = np.flatnonzero(gap <= cfg.padding)
    if len(inside) < cfg.max_points:
        return np.sort(np.argsort(gap, kind="stable")[: cfg.max_points])
    first = int(np.argmin(np.sum((points[inside] - centre) ** 2, axis=1)))
    return np.sort(inside[farthest_points(points[inside], cfg.max_points, first)])


__all__ = ["FEWEST_READINGS", "place_readings", "project_readings"]
