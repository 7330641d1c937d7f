"""The tails of wind errors in simulated flights: the scale of a flight's errors is lognormal.

In the epoch k, in which no part of the error changes, the coefficients θ of the parts of the forecast are
multiplied by

    c_k = exp(s_f g + s_k h_k - s_f² - s_k²),      E c_k² = 1,

where g ~ N(0, 1) lasts for the flight, and h_k ~ N(0, 1) has the correlation exp(-Δt / τ) from one epoch to
the next (:class:`~wind_laws.error_law.TailScale`). Covariances, and with them all bounds, are the same
as without c. The white part, which flights average along their way, is not multiplied.

The coefficients of changes of the wind in time (held fields, interpolation between fields) are multiplied by
exp(s g' - s²), with g' ~ N(0, 1) for the flight and s of :class:`~wind_laws.change_law.ChangeLaw`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from wind_laws.records import FORECAST_PARTS, HELD, TIME, UncertainWind
from wind_laws.types import BoolArray, Float32Array, FloatArray, IntArray

TILTS = np.array([0.0, 1.0, 2.0, 3.0])  # shifts of a quarter of the weighted draws each, see weighted_scales


class ErrorTail(NamedTuple):
    """The scales of the wind errors of a flight.

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
    change : float
        s of changes of the wind in time.
    changed : (P,) bool
        Which modes belong to these.
    """

    flight: float
    moment: FloatArray
    kept: FloatArray
    scaled: BoolArray
    change: float
    changed: BoolArray

    @property
    def gradient(self) -> FloatArray:
        """Derivatives (3,) of the logarithms of the scales of the first epoch by g, h_0 and g'."""
        return np.array([self.flight, self.moment[0], self.change])


class Scales(NamedTuple):
    """Scales of ``forecasts`` (E, n) in each epoch and of the ``change`` (n,) of the wind, for n flights."""

    forecasts: FloatArray
    change: FloatArray


def error_tail(field: UncertainWind, slot: IntArray, epoch: IntArray) -> ErrorTail | None:
    """The tail of the law of ``field``; None if no mode has one.

    ``slot`` and ``epoch`` (S,) are the slot of the field and the epoch at each step of a flight.
    """
    law = field.error
    if law is None or field.modes is None:
        return None
    tail, change, part = law.tail, law.change_tail, field.modes.part
    scaled = np.isin(part, list(FORECAST_PARTS.values())) & (tail is not None)
    changed = np.isin(part, [TIME, HELD]) & (change > 0.0)
    if not (scaled.any() or changed.any()):
        return None
    _, first = np.unique(epoch, return_index=True)
    if tail is None:
        return ErrorTail(0.0, np.zeros(len(first)), np.zeros(len(first)), scaled, change, changed)
    slot = slot[first]
    moment = np.interp(np.nan_to_num(field.leads[slot]), tail.leads, tail.moment)
    times = np.minimum(field.times[slot], field.last_field)
    kept = np.append(0.0, np.exp(-np.diff(times) / tail.memory))
    if not scaled.any():
        return ErrorTail(0.0, np.zeros(len(first)), kept, scaled, change, changed)
    return ErrorTail(tail.flight, moment, kept, scaled, change if changed.any() else 0.0, changed)


def draw_scales(tail: ErrorTail, epochs: int, runs: int, rng: Generator) -> Scales:
    """Scales of ``runs`` flights; more epochs only add rows."""
    g, change = rng.standard_normal((2, runs))
    return _scales(tail, g, rng.standard_normal((epochs, runs)), change)


def weighted_scales(tail: ErrorTail, epochs: int, runs: int, rng: Generator) -> tuple[Scales, FloatArray]:
    """Scales, of which large ones are frequent, and the weights of the flights (runs,).

    The x = (g, h_0, g') of a flight are shifted by one of the δ_k of the lengths ``TILTS`` along
    (s_f, s_0, s). The density is q = φ(x) mean_k exp(δ_k'x - δ_k²/2), and the weight φ / q is at most the
    number of lengths, of which one is 0.
    """
    g, change = rng.standard_normal((2, runs))
    h = rng.standard_normal((epochs, runs))
    length = float(np.linalg.norm(tail.gradient))
    if length == 0.0:
        return _scales(tail, g, h, change), np.ones(runs)
    along, tilt = tail.gradient / length, rng.choice(TILTS, runs)
    g, h[0], change = g + tilt * along[0], h[0] + tilt * along[1], change + tilt * along[2]
    ratio = np.exp(np.outer(TILTS, along @ np.stack([g, h[0], change])) - 0.5 * TILTS[:, None] ** 2)
    return _scales(tail, g, h, change), 1.0 / ratio.mean(axis=0)


def typical_scale(tail: ErrorTail, scales: Scales) -> FloatArray:
    """About how many times as large as without tails the deviations of flights with ``scales`` are, (n,)."""
    if tail.scaled.any():
        return np.asarray(np.sqrt((scales.forecasts**2).mean(axis=0)), float)
    return scales.change


def _scales(tail: ErrorTail, g: FloatArray, h: FloatArray, change: FloatArray) -> Scales:
    """Scales of the draws ``g``, ``change`` (n,) and the innovations ``h`` (E, n), linked in place."""
    for k in range(1, len(h)):
        h[k] = tail.kept[k] * h[k - 1] + np.sqrt(1.0 - tail.kept[k] ** 2) * h[k]
    s = tail.moment[: len(h), None]
    forecasts = np.exp(tail.flight * g + s * h - tail.flight**2 - s**2)
    return Scales(forecasts, np.exp(tail.change * change - tail.change**2))


def scaled_fields(tail: ErrorTail, theta: Float32Array, scales: Scales) -> Float32Array:
    """``theta`` (E, n, 2, P) with the coefficients of the errors that have tails times their ``scales``."""
    factor = np.where(tail.scaled, scales.forecasts[:, :, None, None], 1.0)
    factor = np.where(tail.changed, scales.change[:, None, None], factor)
    return theta * factor.astype(np.float32)
