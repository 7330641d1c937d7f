"""Wind readings in the plane of a scene, with times that count from departure."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from careful_io.texts import probability_text
from careful_io.times import HOUR, iso, seconds
from flight_quantities.levels import DEPTH
from flight_quantities.sphere import on_sphere
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray, IntArray, rotate_vectors
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.levels import wind_level
from pareto_ltl.wind.air import MapAir, NodeAir, map_air
from pareto_ltl.wind.area import swap_question
from pareto_ltl.wind.doubts import assumed_leads, edge_warning, refuse_small_extent, spread_warning
from pareto_ltl.wind.named_laws import AUTO, CURRENTS, NONE, law_named
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.records import WindObservations
from pareto_ltl.wind.sources import wind_source
from pareto_ltl.world.projection import Frame
from pareto_ltl.world.scene import Scene
from wind_laws.change_law import Variability, reasons_text
from wind_laws.error_law import ErrorLaw
from wind_laws.places import thinned
from wind_laws.variability import variability_of

FEWEST_READINGS = 5  # required readings near the scene, at each time
ENOUGH_READINGS = 40  # with fewer readings near the scene at a time, readings farther away are used too
FIT_RADIUS = 500e3  # [m], about one correlation length of the 10 m wind over land
HORIZON_ANGLE = np.deg2rad(45.0)  # readings farther away carry no information and are distorted in the plane
OLDEST_ANALYSIS = 48 * HOUR  # before departure, of those that show how variable the wind is
FILL_GAP = "add wind files, or raise wind.max_gap"
OLDEST_HELD = 48.0  # [h] longest time for which a message advises to hold the last field
FEW_SITUATIONS = 10  # a law of fewer is used with a warning
LOG = logging.getLogger(__name__)


class _Placed(NamedTuple):
    """Positions (n, 2) [m], winds (n, 2) [m/s] and deviations of members (n, 2, M) [m/s] at one time.

    ``counts`` are numbers of readings: used and all of those beside the map, used and all near it.
    """

    points: FloatArray
    winds: FloatArray
    members: FloatArray
    counts: tuple[int, int, int, int]


def place_readings(cfg: WindConfig, readings: Readings, scene: Scene) -> WindObservations:
    """Wind readings in the plane of ``scene``, from the last time at or before departure on.

    They end before the first gap of more than ``wind.max_gap``. Earth-relative winds are rotated by the
    meridian convergence; their speed is not scaled. Calm wind is a single time without readings.

    Raises
    ------
    DataError
        If the readings are in degrees and the scene has no position on Earth, the readings do not cover the
        departure, or too few are near the scene.
    ConfigError
        If the departure is not an ISO 8601 time.
    """
    if not len(readings.times):
        nothing = np.empty((0, 2))
        return WindObservations(np.zeros(1), (nothing,), (nothing,), cfg.source, until=np.inf)
    if readings.geographic and scene.crs is None:
        raise DataError(
            f"{readings.name} is in degrees, but the scene has no location on Earth; set scene.centre "
            "(latitude, longitude), or use wind.source=csv with columns time,x,y,u,v or wind.source=calm"
        )
    zero = _departure_time(scene, readings)
    slots, until, ends = _slots_from_departure(cfg, readings, zero)
    placed = {int(k): _readings_in_plane(cfg, scene, readings, k) for k in slots}
    _log_thinning(cfg, readings, [each.counts for each in placed.values()])
    winds = tuple(each.winds for each in placed.values())
    law = law_of_wind(cfg, readings)
    leads = _implied_leads(cfg, readings) if law.parts else readings.leads
    spread = float(np.sqrt(np.mean([w.var(axis=0).mean() for w in winds])))  # of a component, over places
    doubts = (
        edge_warning(readings.name, scene.bounds, [each.points for each in placed.values()]),
        spread_warning(readings.name, law, readings.level, spread),
    )
    for doubt in filter(None, doubts):
        LOG.warning("%s", doubt)
    law = law.for_winds(readings.level, spread).shared(readings.forecast_share)
    law = law.varying(_variability(cfg, scene, readings, law, placed))
    return WindObservations(
        times=readings.times[slots] - zero,
        points=tuple(each.points for each in placed.values()),
        winds=winds,
        source=_source(cfg.source, readings.files),
        leads=leads[slots],
        level=readings.level,
        until=until - zero,
        ends=ends,
        error=law,
        members=tuple(each.members for each in placed.values()) if readings.members else (),
        air=_air_of_map(scene, readings, slots, zero),
    )


def _source(name: str, files: Sequence[Path]) -> str:
    """``name`` of the source, with up to eight of its files; winds in memory have none."""
    more = f" and {len(files) - 8} more" if len(files) > 8 else ""
    return f"{name}: {', '.join(file.name for file in files[:8])}{more}" if files else name


def _air_of_map(scene: Scene, readings: Readings, slots: IntArray, zero: float) -> MapAir | None:
    """The air of the map at the times ``slots``, which count from ``zero`` [s since 1970]."""
    if not readings.airs:
        return None

    placed = {}
    for k in slots.tolist():
        air = readings.airs[k]
        if air is not None and readings.geographic:
            centre = scene.frame.to_geographic(scene.bounds.mean(axis=0))
            near = on_sphere(air.points) @ on_sphere(np.stack(centre, axis=1))[0] >= np.cos(HORIZON_ANGLE)
            air = NodeAir(
                scene.frame.to_plane(*air.points[near].T), air.temperature[near], air.level,
                air.pressure[near], air.pressure_level,
            )  # fmt: skip
        placed[float(readings.times[k] - zero)] = air
    return map_air(placed, scene.bounds)


def law_of_wind(cfg: WindConfig, readings: Readings) -> ErrorLaw:
    """The law of ``wind.forecast_error``; with ``auto``, of the model of the readings or of their source."""
    name = cfg.forecast_error
    if name == AUTO:
        name = readings.law or wind_source(cfg).forecast_error
        if name != NONE and wind_level(readings.level).kind == DEPTH:
            name = CURRENTS
    law = law_named(name)
    if law.situations is not None and law.situations < FEW_SITUATIONS:
        LOG.warning(
            "%s: the law of errors %s rests on %d situation%s: no promise below %s can be claimed; estimate "
            "a law of your own forecasts (pareto-ltl wind-error) for lower ones", readings.name, law.name,
            law.situations, "s" * (law.situations > 1), probability_text(law.floor),
        )  # fmt: skip
    return law


def _implied_leads(cfg: WindConfig, readings: Readings) -> FloatArray:
    """The leads (K,) [s], assumed where the files do not state them; a warning says so.

    The packaged sample and observations are no forecasts.
    """
    if not wind_source(cfg).modelled:
        return readings.leads
    leads, message = assumed_leads(readings)
    if message:
        LOG.warning("%s", message)
    return leads


def of_weather_model(cfg: WindConfig, readings: Readings) -> bool:
    """Whether the readings are fields of a weather model whose age and analyses count."""
    return wind_source(cfg).modelled and wind_level(readings.level).kind != DEPTH


def _variability(
    cfg: WindConfig, scene: Scene, readings: Readings, law: ErrorLaw, placed: Mapping[int, _Placed]
) -> Variability | None:
    """The variability of the wind at the places of the first slot, from its winds and earlier analyses.

    Analyses are the fields of lead 0 among the slots ``placed`` and up to ``OLDEST_ANALYSIS`` before them.
    """
    first, times = min(placed), readings.times

    def same_places(k: int) -> bool:
        if k in placed:
            return np.array_equal(placed[k].points, placed[first].points)
        return np.array_equal(readings.points[k], readings.points[first])

    recent = (times >= times[first] - OLDEST_ANALYSIS) & (times <= times[max(placed)])
    used = [k for k in np.flatnonzero(recent & (readings.leads == 0)).tolist() if same_places(k)]
    if not of_weather_model(cfg, readings):
        used = []
    if len(used) < 2:
        if law.winds is None:
            return None
        used = [first]
    winds = np.stack([(placed.get(k) or _readings_in_plane(cfg, scene, readings, k)).winds for k in used])
    since = times[used] - _departure_time(scene, readings)
    found = variability_of(
        law, since, placed[first].points, winds, placed[first].winds, _latitude(scene, readings)
    )
    if found is not None:
        LOG.info(
            "%s: the mean square change of the wind in time is taken as %.2f times its value in the law %s, "
            "by %s", readings.name, found.factor, law.name, reasons_text(found),
        )  # fmt: skip
    return found


def _latitude(scene: Scene, readings: Readings) -> float | None:
    """Latitude of the middle of the map [deg]; None if the readings are in a plane."""
    if not readings.geographic:
        return None

    return float(scene.frame.to_geographic(scene.bounds.mean(axis=0)[None])[1][0])


def _departure_time(scene: Scene, readings: Readings) -> float:
    """Departure [s since 1970]: of the scene, else the first time of the readings."""
    if scene.time_zero is None:
        return float(readings.times[0])
    try:
        return seconds(scene.time_zero)
    except ValueError:
        raise ConfigError(
            f"mission.start_time {scene.time_zero!r} is not an ISO 8601 time; e.g. 2018-10-09T18:00:00Z"
        ) from None


def _slots_from_departure(cfg: WindConfig, readings: Readings, zero: float) -> tuple[IntArray, float, str]:
    """Indices of the times from the last one at or before departure ``zero`` [s since 1970] up to a gap.

    Also returns the end of the time for which they can be used [s since 1970], and the reason for this end.
    """
    times, name, held = readings.times, readings.name, cfg.max_gap * HOUR if cfg.hold_last else 0.0
    period = f"{iso(times[0])} .. {iso(times[-1])}"
    if len(times) == 1 and not cfg.hold_last:
        raise DataError(
            f"{name} holds one wind time only ({iso(times[0])}), which covers no flight; add later "
            f"times, or hold it for up to wind.max_gap ({cfg.max_gap:g} h) with wind.hold_last=true"
        )
    if zero < times[0]:
        raise DataError(
            f"departure {iso(zero)} is not covered by the wind of {name} ({period}); "
            "choose mission.start_time inside, or add wind files"
        )
    start = int(np.searchsorted(times, zero, side="right")) - 1
    gaps = np.diff(times[start:])
    wide = np.flatnonzero(gaps > cfg.max_gap * HOUR + 1.0)
    last = start + (int(wide[0]) if len(wide) else len(gaps))
    until, ends = times[last] + held, f"the last wind time of {name} is {iso(times[last])}"
    if len(wide):
        ends = (
            f"{name} has a gap of {gaps[wide[0]] / HOUR:g} h from {iso(times[last])} to "
            f"{iso(times[last + 1])}, longer than wind.max_gap ({cfg.max_gap:g} h)"
        )
        LOG.warning("%s; flights must end before it: %s", ends, FILL_GAP)
    if cfg.hold_last:
        ends += f", and wind.hold_last holds it for {cfg.max_gap:g} h"
    if until <= zero:
        more = FILL_GAP if len(wide) else "choose mission.start_time inside, or add wind files"
        raise DataError(
            f"departure {iso(zero)} is not covered by the wind of {name} ({period}): {ends}; {more}"
            f"{_holding_advice(cfg, zero - times[last])}"
        )
    return np.arange(start, last + 1), until, ends


def _holding_advice(cfg: WindConfig, late: float) -> str:
    """Advice to hold the last field, for a departure ``late`` [s] after it; empty if the field is too old."""
    if late < cfg.max_gap * HOUR:
        return f", or hold the last field for up to wind.max_gap ({cfg.max_gap:g} h) with wind.hold_last=true"
    if late > OLDEST_HELD * HOUR:
        return ""
    return (
        f", or hold the last field with wind.hold_last=true and a wind.max_gap (now {cfg.max_gap:g} h) of "
        f"{np.ceil(late / HOUR):g} h and the time of the flight"
    )


def _readings_in_plane(cfg: WindConfig, scene: Scene, readings: Readings, k: int) -> _Placed:
    """Readings at time index ``k`` near the scene, in its plane, at most ``wind.max_points``."""
    points, winds = readings.points[k], readings.winds[k]
    members = readings.members[k] if readings.members else np.empty((len(points), 2, 0))
    side = float(np.max(scene.bounds[1] - scene.bounds[0]))
    near = max(cfg.padding, side)
    if readings.geographic:
        columns = np.concatenate([winds[:, :, None], members], axis=2)
        points, turned = project_readings(str(scene.crs), scene.bounds.mean(axis=0), points, columns)
        winds, members = turned[:, :, 0], turned[:, :, 1:]
        near = max(cfg.padding, FIT_RADIUS)
    else:
        refuse_small_extent(readings.name, scene.bounds, points)
    outside = np.maximum(0.0, np.maximum(scene.bounds[0] - points, points - scene.bounds[1]))
    gap = np.hypot(outside[:, 0], outside[:, 1])  # distance to the map
    count = int(np.sum(gap <= near))
    if count < FEWEST_READINGS:
        raise DataError(
            f"{readings.name}: {count} wind readings within {near / 1e3:g} km of the scene at "
            f"{iso(readings.times[k])}, expected at least {FEWEST_READINGS}; "
            f"{_swap_question(readings, scene, k) or _more_readings(cfg, count)}"
        )
    # Readings farther away are not used: the statistics of the wind differ between parts of a continent.
    close = np.flatnonzero(gap <= near)
    if len(close) < ENOUGH_READINGS:
        close = np.sort(np.argsort(gap, kind="stable")[:ENOUGH_READINGS])
    half_way = np.sort(gap[close])[min(cfg.max_points // 2, len(close)) - 1]  # of wind.max_points readings
    beside = gap[close] <= max(min(cfg.padding, side), half_way)
    chosen = thinned(points[close], beside, scene.bounds.mean(axis=0), cfg.max_points)
    used = close[chosen]
    counts = int(beside[chosen].sum()), int(beside.sum()), len(used), len(close)
    return _Placed(points[used], winds[used], members[used], counts)


def _more_readings(cfg: WindConfig, count: int) -> str:
    """What to do if only ``count`` readings are near the scene."""
    if cfg.source == "sample":
        return (
            "the sample covers the contiguous United States; for another place see docs/wind.md, or wind=calm"
        )
    return "add readings near the scene" if count else "is the scene where the wind data is?"


def _log_thinning(cfg: WindConfig, readings: Readings, counts: Sequence[tuple[int, int, int, int]]) -> None:
    """Log how many readings the fit uses, if it does not use all near the map."""
    own, beside, used, near = np.array(counts).T
    if (used < near).any():
        LOG.info(
            "%s: the fit uses %s of the readings on and beside the map and %s of those farther away, at each "
            "of %d times (wind.max_points=%d)", readings.name, _share_text(own, beside),
            _share_text(used - own, near - beside), len(counts), cfg.max_points,
        )  # fmt: skip


def _share_text(some: IntArray, every: IntArray) -> str:
    """``all 99``, ``600 of 1570``, or ``380 to 600 of 400 to 1570`` if the numbers differ between times."""
    ranges = [f"{n.min()}" if n.min() == n.max() else f"{n.min()} to {n.max()}" for n in (some, every)]
    return f"all {ranges[1]}" if (some == every).all() else " of ".join(ranges)


def _swap_question(readings: Readings, scene: Scene, k: int) -> str:
    """The question of :func:`swap_question` for the readings at time index ``k``."""
    if not readings.geographic:
        return ""
    middle = np.stack(scene.frame.to_geographic(scene.bounds.mean(axis=0)), axis=1)
    return swap_question(readings.points[k], middle)


def project_readings(
    crs: str, centre: FloatArray, lonlat: FloatArray, winds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Project the readings within 45 degrees of ``centre`` (2,) [m] into the plane ``crs``.

    ``lonlat`` (N, 2) [deg]; ``winds`` (N, 2, ...) towards east and north [m/s]. Returns positions (n, 2) [m]
    and winds (n, 2, ...) towards x and y [m/s].
    """
    middle = on_sphere(np.stack(Frame(crs).to_geographic(centre), axis=1))
    close = (on_sphere(lonlat) @ middle.T).ravel() >= np.cos(HORIZON_ANGLE)
    lon, lat = lonlat[close].T
    if not len(lon):
        return np.empty((0, 2)), np.empty((0, *winds.shape[1:]))
    angle = Frame(crs).convergence(lon, lat)
    columns = winds[close].reshape(len(lon), 2, -1)
    turned = np.stack([rotate_vectors(w, angle) for w in np.moveaxis(columns, 2, 0)], axis=2)
    return Frame(crs).to_plane(lon, lat), turned.reshape(len(lon), *winds.shape[1:])
