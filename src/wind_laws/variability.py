"""How variable the winds at hand are: their spread over places, and their changes between analyses."""

from __future__ import annotations

import numpy as np

from wind_laws.change_law import (
    FEWEST_PLACES,
    LAW_WEIGHT,
    LEAST_FACTOR,
    LONGEST_PAIR,
    MAX_FACTOR,
    Variability,
)
from wind_laws.error_law import ErrorLaw
from wind_laws.gp import CORRELATIONS
from wind_laws.places import pairwise_distances
from wind_laws.types import FloatArray


def spread_near(points: FloatArray, winds: FloatArray) -> float | None:
    """S [m/s]: the standard deviation of a component over pairs of places at most ``LONGEST_PAIR`` apart::

        S² = mean ‖w(x) - w(y)‖² / 4

    None for fewer than ``FEWEST_PLACES`` places, or if no two are so near. Unlike the deviation from a mean
    it depends little on the size of the map.

    Parameters
    ----------
    points : (n, 2) float
        Positions [m].
    winds : (n, 2) float
        Winds of one time there [m/s].
    """
    if len(points) < FEWEST_PLACES:
        return None
    apart = pairwise_distances(points, points)
    near = (apart > 0.0) & (apart <= LONGEST_PAIR)
    if not near.any():
        return None
    square = (winds**2).sum(axis=1)
    differences = square[:, None] + square - 2.0 * winds @ winds.T
    return float(np.sqrt(max(differences[near].mean(), 0.0) / 4.0))


def variability_of(
    law: ErrorLaw, times: FloatArray, points: FloatArray, winds: FloatArray, now: FloatArray | None = None,
    latitude: float | None = None,
) -> Variability | None:  # fmt: skip
    """The factor of D(τ) from the spread of the winds and the changes between successive analyses.

    Analyses count that are a time apart that the table of the law covers. None if there are no such two, and
    the law does not depend on the spread.

    Parameters
    ----------
    times : (A,) float
        Increasing times of analyses [s]; at least one.
    points : (n, 2) float
        Positions [m].
    winds : (A, n, 2) float
        Winds there [m/s].
    now : (n, 2) float, optional
        Winds there whose spread counts; by default the last of ``winds``.
    latitude : float, optional
        Of the map [deg].

    Eq. (M12a) and (M12b) of docs/mathematics.md.
    """
    lags = np.diff(times)
    used = np.flatnonzero((lags >= law.lags[0] - 1.0) & (lags <= law.lags[-1] + 1.0))
    rule, spread, expected = law.winds, None, 1.0
    if rule is not None:
        spread = spread_near(points, winds[-1] if now is None else now)
        expected = rule.expected(spread, latitude)
    elif not len(used):
        return None
    starts, ends = times[used], times[used + 1]
    squares = ((winds[used + 1] - winds[used]) ** 2).mean(axis=(1, 2))
    freedom, factor = 0.0, 1.0
    if len(used):
        table = law.change_variance(lags[used])
        freedom = independent_changes(law, starts, ends, points)
        ratio = float((squares / (expected * table)).mean())
        prior, weight = (LAW_WEIGHT, freedom) if rule is None else (rule.freedom, rule.weight(freedom))
        found = (prior + weight * ratio) / (prior + weight)
        factor = float(np.clip(found, LEAST_FACTOR, MAX_FACTOR))
    known = None if rule is None else latitude
    return Variability(starts, ends, squares, freedom, expected * factor, spread, known)


def independent_changes(law: ErrorLaw, starts: FloatArray, ends: FloatArray, points: FloatArray) -> float:
    """ν of the changes between times ``starts`` and ``ends`` (P,) [s] at ``points`` (n, 2) [m]."""

    def apart(a: FloatArray, b: FloatArray) -> FloatArray:
        return law.change_variance(np.abs(a[:, None] - b))

    expected = law.change_variance(ends - starts)
    covariance = apart(starts, ends) + apart(ends, starts) - apart(starts, starts) - apart(ends, ends)
    in_time = covariance / (2.0 * np.sqrt(np.outer(expected, expected)))
    in_space = CORRELATIONS["matern32"](pairwise_distances(points, points) / law.change_length)
    return 2.0 / float((in_time**2).mean() * (in_space**2).mean())
