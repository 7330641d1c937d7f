"""How much the wind at hand changes in time, relative to a law of forecast errors: a factor of its D(τ)."""

from __future__ import annotations

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.forecast_error import ForecastError, Variability
from pareto_ltl.wind.gp import CORRELATIONS, pairwise_distances

LAW_WEIGHT = 10.0  # degrees of freedom of the law; before data, the factor has the standard deviation 0.5
LEAST, MOST = 0.25, 4.0  # factor


def variability_of(
    law: ForecastError, times: FloatArray, points: FloatArray, winds: FloatArray
) -> Variability | None:
    """The factor of D(τ) from the changes of the wind between successive analyses.

    None if no two of them are a time apart that the table of the law covers.

    Parameters
    ----------
    times : (A,) float
        Increasing times of analyses [s].
    points : (n, 2) float
        Positions [m].
    winds : (A, n, 2) float
        Winds there [m/s].

    Eq. (M12a) of docs/mathematics.md.
    """
    lags = np.diff(times)
    used = np.flatnonzero((lags >= law.lags[0] - 1.0) & (lags <= law.lags[-1] + 1.0))
    if not len(used):
        return None
    starts, ends, expected = times[used], times[used + 1], law.change_variance(lags[used])
    squares = ((winds[used + 1] - winds[used]) ** 2).mean(axis=(1, 2))

    def apart(a: FloatArray, b: FloatArray) -> FloatArray:
        return law.change_variance(np.abs(a[:, None] - b))

    covariance = apart(starts, ends) + apart(ends, starts) - apart(starts, starts) - apart(ends, ends)
    in_time = covariance / (2.0 * np.sqrt(np.outer(expected, expected)))
    in_space = CORRELATIONS["matern32"](pairwise_distances(points, points) / law.change_length)
    freedom = 2.0 / float((in_time**2).mean() * (in_space**2).mean())
    found = (LAW_WEIGHT + freedom * float((squares / expected).mean())) / (LAW_WEIGHT + freedom)
    return Variability(starts, ends, squares, freedom, float(np.clip(found, LEAST, MOST)))
