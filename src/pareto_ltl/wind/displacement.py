"""How far the errors of a wind displace a flight, from the readings and the settings alone.

It is a rough size, for the extent of a map; what is promised comes from the modes of the fitted field.
"""

from __future__ import annotations

import numpy as np

from careful_io.times import HOUR, seconds
from pareto_ltl.settings import WindConfig
from pareto_ltl.wind.doubts import assumed_leads
from pareto_ltl.wind.observations import law_of_wind, of_weather_model
from pareto_ltl.wind.readings import Readings
from wind_laws.drift import drift_variance

SPACE_SHARE = 0.11  # error of interpolation in space / spread of the winds: 0.35 of 3.2 m/s on GFS fields


def known_for(cfg: WindConfig, readings: Readings, departure: str | None) -> float:
    """The time [s] from ``departure`` to the end of the wind; inf for calm air."""
    if not len(readings.times):
        return np.inf
    held = cfg.max_gap * HOUR if cfg.hold_last else 0.0
    return max(0.0, float(readings.times[-1]) + held - _zero(readings, departure))


def displacement_variance(
    cfg: WindConfig, readings: Readings, departure: str | None, duration: float
) -> float:
    """Variance [m²] of the position, in one direction, after ``duration`` T [s] in the errors of the wind.

    An error of 0.11 of the spread of the winds (interpolation in space, on GFS fields) and the spread of the
    members of an ensemble last over the flight; gusts have the variance noise_min² and the time gust_time.

    Parameters
    ----------
    departure : str or None
        ISO 8601 UTC; None: the first time of the readings.
    """
    if not len(readings.times):
        return 0.0
    zero, times = _zero(readings, departure), readings.times
    spread = float(np.sqrt(readings.winds[0].var(axis=0).mean()))
    law = law_of_wind(cfg, readings)
    forecasts = bool(law.parts) and of_weather_model(cfg, readings)
    leads = assumed_leads(readings)[0] if forecasts else readings.leads
    law = law.for_winds(readings.level, spread).shared(readings.forecast_share)
    member_variance = float((readings.members[0] ** 2).sum(axis=2).mean()) if readings.members else 0.0
    lasting = (SPACE_SHARE * spread) ** 2 + member_variance
    return drift_variance(law, times, leads, zero, duration, lasting, cfg.noise_min**2 * cfg.gust_time)


def _zero(readings: Readings, departure: str | None) -> float:
    return float(readings.times[0]) if departure is None else seconds(departure)
