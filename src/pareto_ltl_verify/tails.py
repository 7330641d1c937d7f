"""The scale of the errors of forecasts, which differs from one new flight to another: they have tails.

In slot k the logarithm of the scale is Gaussian, with the variance s² = s_f² + s_k² and the mean -s², so that
the mean square of the scale is 1. Its part s_f lasts for the flight; the other one is renewed from slot to
slot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.random import Generator

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_verify.laws import Coherent, Law
from pareto_ltl_verify.wind_tables import OF_FORECASTS


def drawn_scales(law: Law, runs: int, rng: Generator) -> dict[int, FloatArray]:
    """The scale (runs,) in each slot whose modes are used, by slot; empty for errors without tails."""
    wind, found = law.wind, dict[int, FloatArray]()
    tail = None if wind.error is None else wind.error.tail
    if tail is None or wind.modes is None or not isinstance(law, Coherent):
        return found
    lasting, renewed = rng.standard_normal((2, runs))
    before: float | None = None
    for k in np.unique(law.times.nearest).tolist():
        now, moment = min(float(wind.times[k]), wind.last_field), tail.moment_at(float(wind.leads[k]))
        if before is not None:
            kept = math.exp((before - now) / tail.memory)
            renewed = kept * renewed + math.sqrt(1.0 - kept**2) * rng.standard_normal(runs)
        logarithm = tail.flight * lasting + moment * renewed
        found[k] = np.exp(logarithm - tail.flight**2 - moment**2)
        before = now
    return found


def scaled_field(law: Law, t: int, theta: FloatArray, scales: Mapping[int, FloatArray]) -> FloatArray:
    """θ (n, N) of step t with the coefficients of the parts of forecasts times the scale of the flight."""
    modes, scale = law.wind.modes, scales.get(int(law.times.nearest[t]))
    if modes is None or scale is None:
        return theta
    scaled = np.zeros(theta.shape[1], bool)
    scaled[: law.modes] = np.tile(np.isin(modes.part, list(OF_FORECASTS.values())), 2)
    return np.where(scaled, scale[:, None] * theta, theta)
