"""The law of forecast errors in ``wind.nc``: variance of a forecast by lead, change of the wind by time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray

HOUR = 3600.0
FAR = 1e9  # [s] beyond every lead
SHORT_TIME_POWER = 1.3  # of D(τ) below the shortest time of a table


@dataclass(frozen=True, slots=True)
class Scaled:
    """Mean ``squares`` [m²/s²] of changes between analyses at ``pairs`` (P, 2) [s], and the factor of D."""

    pairs: FloatArray
    squares: FloatArray
    freedom: float
    factor: float


@dataclass(frozen=True, slots=True)
class ErrorLaw:
    """Tables of one component; ``leads``, ``lags`` [s], ``forecast_sd``, ``change_sd``, ``spread`` [m/s].

    ``forecast_length``, ``change_length`` [m] are length scales; errors of valid times ``persistence_time``
    [s] apart have the correlation ``persistence``. ``scaled``: changes of the winds at hand, to which
    ``change_sd`` was scaled.
    """

    name: str
    level: str
    spread: float
    leads: FloatArray
    forecast_sd: FloatArray
    forecast_length: float
    persistence: float
    persistence_time: float
    lags: FloatArray
    change_sd: FloatArray
    change_length: float
    scaled: Scaled | None = None

    def forecast_variance(self, lead: FloatArray) -> FloatArray:
        """e²(L) [m²/s²] of each lead [s], linear between leads and beyond; 0 where the lead is not known."""
        x, y = self.leads, self.forecast_sd**2
        if len(x) > 1:
            slope = max((y[-1] - y[-2]) / (x[-1] - x[-2]), 0.0)
            x, y = np.append(x, x[-1] + FAR), np.append(y, y[-1] + slope * FAR)
        known = np.isfinite(lead)
        return np.where(known, np.interp(np.where(known, lead, 0.0), x, y), 0.0)

    def change_variance(self, lag: float) -> float:
        """D(τ) [m²/s²], a power of τ between two times of the table, and beyond."""
        x, y = self.lags, self.change_sd**2
        if lag <= 0.0 or not y.all():
            return 0.0
        i = int(np.searchsorted(x, lag, side="right")) - 1
        if i < 0:
            return float(y[0] * (lag / x[0]) ** SHORT_TIME_POWER)
        if len(x) == 1:
            return float(y[0])
        left = min(i, len(x) - 2)
        power = math.log(y[left + 1] / y[left]) / math.log(x[left + 1] / x[left])
        return float(y[i] * (lag / x[i]) ** (max(power, 0.0) if i == len(x) - 1 else power))

    def between_variance(self, passed: float, gap: float) -> float:
        """Variance [m²/s²] of interpolation ``passed`` [s] after the first of two fields ``gap`` apart.

        Var(X - a Y) of the changes X and Y of the wind in ``passed`` and in ``gap``, a = passed / gap::

            D(passed) + a² D(gap) - 2 a Cov(X, Y),    2 Cov(X, Y) = D(passed) + D(gap) - D(gap - passed)
        """
        a = passed / gap
        X, Y, rest = map(self.change_variance, (passed, gap, gap - passed))
        return max(X + a * a * Y - a * (X + Y - rest), 0.0)

    def change_correlation(self, first: float, second: float) -> float:
        """Correlation in [0, 1] of the changes of the wind up to two times [s] after one field."""
        s, t, apart = map(self.change_variance, (first, second, abs(second - first)))
        return min(max(0.5 * (s + t - apart) / math.sqrt(s * t), 0.0), 1.0) if s * t > 0 else 0.0


def error_law(document: Mapping[str, Any]) -> ErrorLaw:
    """The law of a JSON document ``pareto_ltl.forecast_error/1``."""
    forecast, change, scaled = document["forecast"], document["change"], document.get("variability")
    return ErrorLaw(
        name=str(document["name"]),
        level=str(document["level"]),
        spread=float(document["spread"]),
        leads=HOUR * np.array(forecast["lead_hours"], float),
        forecast_sd=np.array(forecast["sd"], float),
        forecast_length=float(forecast["length"]),
        persistence=float(forecast["persistence"]),
        persistence_time=HOUR * float(forecast["persistence_hours"]),
        lags=HOUR * np.array(change["lag_hours"], float),
        change_sd=np.array(change["sd"], float),
        change_length=float(change["length"]),
        scaled=None if scaled is None else _scaled(scaled),
    )


def _scaled(document: Mapping[str, Any]) -> Scaled:
    pairs = np.stack([np.array(document[name], float) for name in ("from_seconds", "to_seconds")], axis=1)
    squares = np.array(document["mean_square"], float)
    return Scaled(pairs, squares, float(document["freedom"]), float(document["factor"]))


def independent_changes(law: ErrorLaw, pairs: FloatArray, kinship: FloatArray) -> float:
    """Twice the squared mean over the variance of a mean of squares of equally distributed Gaussian changes.

    The changes have two components over ``pairs`` (P, 2) of times [s] at places with the correlations
    ``kinship`` (N, N).
    """
    total = 0.0
    for a, b in pairs:
        for c, d in pairs:
            D = [law.change_variance(abs(t)) for t in (b - c, d - a, a - c, b - d, b - a, d - c)]
            total += (D[0] + D[1] - D[2] - D[3]) ** 2 / (4 * D[4] * D[5])
    return 2 * len(pairs) ** 2 * kinship.size / (total * float((kinship**2).sum()))
