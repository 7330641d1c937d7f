"""The tails of forecast errors in simulated flights: the scale of a flight's errors is lognormal.

In the epoch k, in which no part of the error changes, the coefficients θ of the parts of the forecast are
multiplied by

    c_k = exp(s_f g + s_k h_k - s_f² - s_k²),      E c_k² = 1,

where g ~ N(0, 1) lasts for the flight, and h_k ~ N(0, 1) has the correlation exp(-Δt / τ) from one epoch to
the next (:class:`~pareto_ltl.wind.error_law.TailScale`). Covariances, and with them all bounds, are the same
as without c. The white part, which flights average along their way, is not multiplied.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from pareto_ltl.kernels import data as kd
from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray
from pareto_ltl.wind.records import FORECAST_PARTS, WindField

TILT = 2.0  # shift of half of the weighted draws of (g, h_0), along the gradient of log c_0


class ErrorTail(NamedTuple):
    """The scale of the forecast errors of a flight.

    Attributes
    ----------
    flight : float
        s_f.
    moment : (E,) float
        s_k of each epoch.
    kept : (E,) float
        Correlation of h_k and h_{k-1}; 0 in the first epoch.
    scaled : (P,) bool
        Which modes belong to parts of the forecast.
    """

    flight: float
    moment: FloatArray
    kept: FloatArray
    scaled: BoolArray

    @property
    def spread(self) -> float:
        """Standard deviation of log c in the first epoch."""
        return float(np.hypot(self.flight, self.moment[0]))


def error_tail(field: WindField, modes: kd.Modes) -> ErrorTail | None:
    """The tail of the law of ``field`` in the epochs of ``modes``; None if no mode has one."""
    tail = None if field.error is None else field.error.tail
    if tail is None or field.modes is None:
        return None
    scaled = np.isin(field.modes.part, list(FORECAST_PARTS.values()))
    if not scaled.any():
        return None
    _, first = np.unique(modes.epoch, return_index=True)
    slot = modes.slot[first]
    moment = np.interp(np.nan_to_num(field.leads[slot]), tail.leads, tail.moment)
    times = np.minimum(field.times[slot], field.last_field)
    kept = np.append(0.0, np.exp(-np.diff(times) / tail.memory))
    return ErrorTail(tail.flight, moment, kept, scaled)


def draw_scales(tail: ErrorTail, epochs: int, runs: int, rng: Generator) -> FloatArray:
    """c (epochs, runs) of ``runs`` flights; more epochs only add rows."""
    g, h = rng.standard_normal(runs), rng.standard_normal((epochs, runs))
    return _scales(tail, g, h)


def weighted_scales(tail: ErrorTail, epochs: int, runs: int, rng: Generator) -> tuple[FloatArray, FloatArray]:
    """Scales (epochs, runs), in half of the flights large ones, and the weights of the flights (runs,).

    Half of the (g, h_0) are shifted by δ, of length ``TILT`` along (s_f, s_0). With x = (g, h_0) the density
    is q = φ(x) (1 + exp(δ'x - δ²/2)) / 2, and the weight φ / q is at most 2.
    """
    g, h = rng.standard_normal(runs), rng.standard_normal((epochs, runs))
    if tail.spread == 0.0:
        return _scales(tail, g, h), np.ones(runs)
    shift = TILT / tail.spread * np.array([tail.flight, tail.moment[0]])
    shifted = rng.random(runs) < 0.5
    g, h[0] = g + shift[0] * shifted, h[0] + shift[1] * shifted
    ratio = np.exp(shift[0] * g + shift[1] * h[0] - 0.5 * TILT**2)
    return _scales(tail, g, h), 2.0 / (1.0 + ratio)


def _scales(tail: ErrorTail, g: FloatArray, h: FloatArray) -> FloatArray:
    """c of the draws ``g`` (n,) and the innovations ``h`` (E, n), which are linked in place."""
    for k in range(1, len(h)):
        h[k] = tail.kept[k] * h[k - 1] + np.sqrt(1.0 - tail.kept[k] ** 2) * h[k]
    s = tail.moment[: len(h), None]
    return np.asarray(np.exp(tail.flight * g + s * h - tail.flight**2 - s**2), float)


def scaled_fields(tail: ErrorTail, theta: Float32Array, scale: FloatArray) -> Float32Array:
    """``theta`` (E, n, 2, P) with the coefficients of the parts of the forecast times ``scale`` (E, n)."""
    factor = np.where(tail.scaled, scale[:, :, None, None], 1.0).astype(np.float32)
    return theta * factor
