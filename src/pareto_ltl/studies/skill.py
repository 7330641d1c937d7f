"""Parts of a score of promises, and its value: calibration, skill, weather situations.

Missions that depart in one weather situation (a period of successive fields) share its weather. Intervals by
situations count a situation as one trial, not a mission.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pareto_ltl.studies.statistics import Columns
from pareto_ltl.support.arrays import FloatArray

LEVEL = 0.95


def brier_score(promised: FloatArray, realised: FloatArray) -> float:
    """Mean of f (1 - p)² + (1 - f) p² for promises p and realised rates f."""
    return float((realised * (1 - promised) ** 2 + (1 - realised) * promised**2).mean())


def isotonic_rates(promised: FloatArray, realised: FloatArray) -> FloatArray:
    """The rates that do not fall with the promise and have the least Brier score, one for each promise.

    They are the reliability diagram without bins (Dimitriadis, Gneiting and Jordan 2021,
    doi:10.1073/pnas.2016191118).
    """
    from sklearn.isotonic import IsotonicRegression

    return np.asarray(IsotonicRegression().fit(promised, realised).predict(promised), float)


def brier_parts(promised: FloatArray, realised: FloatArray) -> Columns:
    """Brier score = miscalibration - discrimination + uncertainty, from the isotonic rates."""
    fitted = brier_score(isotonic_rates(promised, realised), realised)
    usual = brier_score(np.full(len(realised), realised.mean()), realised)
    return {
        "miscalibration": brier_score(promised, realised) - fitted,
        "discrimination": usual - fitted,
        "uncertainty": usual,
    }


def climatology(realised: FloatArray) -> FloatArray:
    """For each mission the mean rate of all others; 1/2 for a single one."""
    n = len(realised)
    return np.full(1, 0.5) if n == 1 else (realised.sum() - realised) / (n - 1)


def persistence(realised: FloatArray, departures: Sequence[str]) -> FloatArray:
    """For each mission the mean rate of the latest earlier departure; of the first one, climatology."""
    _, place = np.unique(np.array(departures), return_inverse=True)
    means = np.bincount(place, realised) / np.bincount(place)
    return np.where(place == 0, climatology(realised), means[np.maximum(place - 1, 0)])


def skill(promised: FloatArray, realised: FloatArray, reference: FloatArray) -> float:
    """1 - Brier score of the promises / Brier score of ``reference``; NaN if the latter is 0."""
    usual = brier_score(reference, realised)
    return 1.0 - brier_score(promised, realised) / usual if usual > 0.0 else math.nan


@dataclass(frozen=True, slots=True)
class MeanInterval:
    """95 % interval of a mean, with a situation as one trial; infinite for one situation."""

    situations: int
    low: float
    high: float


def mean_interval(values: FloatArray, situations: Sequence[str]) -> MeanInterval:
    """The interval of the mean of clusters, with Student's t of n - 1 degrees of freedom."""
    from scipy.stats import t

    _, place = np.unique(np.array(situations), return_inverse=True)
    n, mean = int(place.max()) + 1, float(values.mean())
    if n == 1:
        return MeanInterval(1, -math.inf, math.inf)
    sums = np.bincount(place, values - mean)
    half = float(t.ppf(0.5 + LEVEL / 2, n - 1) * np.sqrt(n / (n - 1) * (sums**2).sum()) / len(values))
    return MeanInterval(n, mean - half, mean + half)


def situation_columns(realised: FloatArray, situations: Sequence[str]) -> Columns:
    """The number n of situations, the 95 % interval of the mean rate by them, and ``floor`` = 1 / (n + 1).

    One situation says nothing. No rate that is calibrated on n situations can be claimed to be below the
    floor: the next situation is the worst of n + 1 with that probability.
    """
    found = mean_interval(realised, situations)
    return {
        "situations": found.situations,
        "by_situation_low": max(0.0, found.low),
        "by_situation_high": min(1.0, found.high),
        "floor": 1.0 / (found.situations + 1),
    }
