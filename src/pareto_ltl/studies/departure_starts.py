"""The times of departure that are planned, from the settings and the times of the wind."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from pareto_ltl.settings import DepartureConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.wind.readings import HOUR, Readings, iso, seconds

MOST_STARTS = 1000
A_DAY = 24 * HOUR  # span of the starts in calm wind, which has no times


def candidate_starts(cfg: DepartureConfig, readings: Readings, departure: str | None) -> tuple[float, ...]:
    """Times of departure of the settings, increasing [s since 1970].

    Parameters
    ----------
    departure : str or None
        ``mission.start_time``: the earliest start if ``cfg.first`` is not set.

    Raises
    ------
    ConfigError
        If there is none, or one lies outside the times of the wind.
    """
    first, last = wind_span(cfg, readings, departure)
    if cfg.starts:
        times = np.unique([seconds(text) for text in cfg.starts])
        for time in times:
            _refuse_outside("departure.starts", float(time), readings)
        return tuple(times.tolist())
    for key, text in (("first", cfg.first), ("last", cfg.last)):
        if text is not None:
            _refuse_outside(f"departure.{key}", seconds(text), readings)
    earliest = cfg.first or departure
    begin = seconds(earliest) if earliest else first
    end = seconds(cfg.last) if cfg.last else last
    times = _grid(cfg, readings, begin, end)
    if cfg.arrive_by is not None:
        times = times[times < seconds(cfg.arrive_by)]
    if not len(times):
        before = "" if cfg.arrive_by is None else f" and before departure.arrive_by = {cfg.arrive_by}"
        raise ConfigError(
            f"no start lies between {iso(begin)} and {iso(end)}{before}: move departure.first or last, or "
            "choose a smaller departure.every"
        )
    if len(times) > MOST_STARTS:
        raise ConfigError(
            f"departure.every = {cfg.every:g} h gives {len(times):,} starts, expected at most "
            f"{MOST_STARTS:,}: choose a larger one"
        )
    return tuple(times.tolist())


def wind_span(cfg: DepartureConfig, readings: Readings, departure: str | None) -> tuple[float, float]:
    """First and last wind time [s since 1970]; for calm wind, one day from the first start on."""
    if len(readings.times):
        return float(readings.times[0]), float(readings.times[-1])
    begin = cfg.first or departure or (cfg.starts[0] if cfg.starts else None)
    if begin is None:
        raise ConfigError("calm wind has no times: give departure.first or departure.starts")
    return seconds(begin), seconds(begin) + A_DAY


def _grid(cfg: DepartureConfig, readings: Readings, begin: float, end: float) -> FloatArray:
    """Every ``cfg.every`` hours, or every wind time except the last one, after which no wind is known."""
    if cfg.every is not None:
        count = int((end - begin) / (HOUR * cfg.every) + 1e-9) + 1 if end >= begin else 0
        times: FloatArray = begin + HOUR * cfg.every * np.arange(min(count, MOST_STARTS + 1), dtype=float)
    else:
        times = np.asarray(readings.times, float) if len(readings.times) else np.array([begin])
    known = times[:-1] if len(times) > 1 and times[-1] == _end(readings) else times
    return known[(known >= begin) & (known <= end)]


def _end(readings: Readings) -> float | None:
    return float(readings.times[-1]) if len(readings.times) else None


def _refuse_outside(key: str, time: float, readings: Readings) -> None:
    if not len(readings.times):
        return
    first, last = float(readings.times[0]), float(readings.times[-1])
    if not first <= time <= last:
        raise ConfigError(
            f"{key}: departure {iso(time)} lies outside the wind of {readings.name} ({iso(first)} .. "
            f"{iso(last)}); choose a time inside, or add wind files"
        )


def folder_name(time: float) -> str:
    """The folder of a start: ``20181009T120000Z``."""
    return datetime.fromtimestamp(time, UTC).strftime("%Y%m%dT%H%M%SZ")
