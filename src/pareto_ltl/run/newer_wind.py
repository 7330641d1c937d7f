"""The wind of a newer forecast for the rest of a flight: read, compared with the old one, and fitted."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.run.position_fixes import FAR, chance
from pareto_ltl.settings.wind import STATED, WIND_SOURCES, usual_level
from pareto_ltl.support.display import distance_text
from pareto_ltl.support.errors import ConfigError, DataError

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import PlannedPath
    from pareto_ltl.settings import Settings, WindConfig
    from pareto_ltl.wind.readings import Readings
    from pareto_ltl.wind.records import WindField
    from pareto_ltl.world.scene import Scene

LOG = logging.getLogger(__name__)
HOUR = 3600.0
NewWind = Any  # a path, the keys of section wind, Readings or a WindField


def newer_field(settings: Settings, wind: NewWind, scene: Scene, steps: int) -> tuple[WindConfig, WindField]:
    """Settings and field of a newer forecast for a departure at ``scene.time_zero``, of at most ``steps``.

    Raises
    ------
    DataError
        If the forecast cannot be read, or does not cover the time or the map.
    """
    from pareto_ltl.wind.field import fit_wind_field
    from pareto_ltl.wind.observations import place_readings
    from pareto_ltl.wind.records import WindField

    cfg = newer_settings(settings.wind, wind)
    if isinstance(wind, WindField):
        return cfg, wind
    if scene.time_zero is None:
        raise ConfigError(
            "a newer forecast needs the date of the departure, which this plan does not have: set "
            "mission.start_time and plan again"
        )
    readings = _readings(settings, cfg, wind, scene)
    try:
        field = fit_wind_field(cfg, place_readings(cfg, readings, scene), scene, steps * settings.robot.dt)
    except DataError as error:
        raise DataError(f"the newer forecast cannot be used from {scene.time_zero} on: {error}") from None
    return cfg, field


def newer_settings(cfg: WindConfig, wind: NewWind) -> WindConfig:
    """The settings of the wind with the path or source of ``wind``; the reader stays if it reads files."""
    from pareto_ltl.wind.sources import source_of_file

    if isinstance(wind, Mapping):
        return _restated(cfg, replace(cfg, **{"path": None, **wind}), "level" in wind)
    if not isinstance(wind, str | Path):
        return replace(cfg, source="given", path=None)
    path = Path(wind).expanduser()
    if not path.exists() and not any(letter in str(wind) for letter in "*?["):
        raise ConfigError(f"wind {wind}: no such file; give a newer forecast (GRIB2, NetCDF or CSV)")
    kind = WIND_SOURCES.get(cfg.source)
    keeps = kind is not None and kind.reads_path
    source = cfg.source if keeps or not path.is_file() else source_of_file(path)
    if not keeps and not path.is_file():
        raise DataError(
            f"wind {wind}: the plan's wind.source={cfg.source} reads no files, so that the format of a "
            "folder is not known; name one file, or give wind={'source': ..., 'path': ...} from Python"
        )
    return _restated(cfg, replace(cfg, source=source, path=str(path)), stated=False)


def _restated(before: WindConfig, cfg: WindConfig, stated: bool) -> WindConfig:
    """``cfg`` without the level of files that states nothing on the table that replaces them."""
    kind = WIND_SOURCES.get(cfg.source)
    if stated or cfg.source == before.source or kind is None or kind.level != STATED:
        return cfg
    return replace(cfg, level=usual_level(cfg.source, before.level))


def _readings(settings: Settings, cfg: WindConfig, wind: NewWind, scene: Scene) -> Readings:
    from pareto_ltl.run.provenance import wanted_wind
    from pareto_ltl.wind.readings import Readings, check_all_readings
    from pareto_ltl.wind.sources import read_readings

    if isinstance(wind, Readings):
        check_all_readings(wind, cfg.max_speed)
        return wind
    mission = replace(settings.mission, start_time=scene.time_zero)
    return read_readings(cfg, wanted_wind(replace(settings, wind=cfg, mission=mission)))


# --- against the old wind -------------------------------------------------------------------------


def warn_of_use(old: WindField, new: WindField, moment: float, rest: float) -> None:
    """Log what is doubtful about a newer forecast: its age, and an end before the end of the old plan.

    The times of ``old`` count from the first departure, times of ``new`` from ``moment`` [s]; ``rest`` [s] is
    the time that the rest of the old plan takes.
    """
    before, now = issued(old), issued(new) + moment
    if now < before - 60.0:  # not if one of them is NaN
        LOG.warning(
            "the newer forecast is older than the one of the plan: it begins %.3g h before it; it is used "
            "in any case",
            (before - now) / HOUR,
        )  # fmt: skip
    if new.known_until < rest - 1.0:
        LOG.warning(
            "the newer forecast ends %.3g h before the old plan would arrive (%s): the new plan must arrive "
            "before; a forecast that reaches farther, or wind.hold_last=true, allows longer plans",
            (rest - new.known_until) / HOUR, new.ends,
        )  # fmt: skip


def issued(field: WindField) -> float:
    """Start of the latest forecast of ``field`` [s since its departure]; NaN if its leads are not known."""
    starts = field.times - field.leads
    known = starts[np.isfinite(starts)]
    return float(known.max()) if len(known) else math.nan


def field_alarms(old: Problem, new: Problem, rest: PlannedPath) -> list[str]:
    """A message if the law of the plan gives the newer forecast less than ``UNLIKELY``.

    The controls of the rest of the old plan are flown in both winds, from the same start. Half-way and at the
    end, the difference of the two places is Gaussian under the law, with at most the sum of both covariances.
    """
    from pareto_ltl.planning.evaluate import propagate_controls, square_matrices
    from pareto_ltl.planning.problem import unaided

    flown = min(len(rest.u), len(old.wind.slot), len(new.wind.slot))
    u = np.ascontiguousarray(rest.u[:flown])
    known = [replace(problem, start_variance=0.0) for problem in (old, new)]  # both start at one place
    a, b = (propagate_controls(problem, u, unaided(problem.world.law)) for problem in known)
    apart, S = b.x - a.x, square_matrices(a.cov + b.cov)
    for t in (flown // 2, flown):
        far = math.sqrt(max(float(apart[t] @ np.linalg.pinv(S[t]) @ apart[t]), 0.0))
        if far > FAR:
            gap = float(np.linalg.norm(apart[t]))
            return [
                f"the newer forecast moves the robot by {distance_text(gap)} in "
                f"{t * old.motion.dt / HOUR:.3g} h, {far:.1f} standard deviations of what the "
                f"{old.fidelity.law} winds of the plan allow "
                f"(probability {chance(far):.1g}): is it another time, level or unit, or are its components "
                f"swapped? Or the wind is outside the law: {gap / (t * old.motion.dt):.1f} m/s off on average"
            ]
    return []
