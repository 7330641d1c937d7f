"""How far the errors of a wind displace what drifts in it, from a law and the times of its fields alone."""

from __future__ import annotations

import numpy as np

from wind_laws.error_law import ErrorLaw
from wind_laws.types import FloatArray

INSTANTS = 64  # of the integral over the time


def drift_variance(
    law: ErrorLaw, times: FloatArray, leads: FloatArray, start: float, duration: float, lasting: float = 0.0,
    gusts: float = 0.0,
) -> float:  # fmt: skip
    """Variance [m²] of the position, in one direction, ``duration`` T [s] after ``start`` [s].

    The sum of ::

        Σ ∫∫ σ(s) σ(t) ρ(s, t) ds dt            forecasts, for each part of the law at their leads
        b² T min(T, gap)                        interpolation in time, halfway in the longest gap
        D(h) h²                                 the last field, held for h
        lasting T² + gusts T

    Parameters
    ----------
    times, leads : (K,) float
        Times of the fields [s], increasing, and their leads [s]; all NaN if they are no forecasts.
    lasting : float
        Variance of an error that does not change [m²/s²].
    gusts : float
        Variance of gusts times their time constant [m²/s].
    """
    t = (np.arange(INSTANTS) + 0.5) * duration / INSTANTS
    at, total = np.interp(start + t, times, np.nan_to_num(leads)), 0.0
    for part in law.parts if np.isfinite(leads).any() else ():
        total += float(part.covariance(at, part.variance(at)).sum()) * (duration / INSTANTS) ** 2
    during = times[(times >= start) & (times <= start + duration)]
    around = np.unique(
        np.concatenate([times[times <= start][-1:], during, times[times > start + duration][:1]])
    )
    if len(around) > 1:
        gap = float(np.diff(around).max())
        total += float(law.between_variance(np.array(0.5), np.array(gap))) * duration * min(duration, gap)
    held = max(0.0, start + duration - float(times[-1]))
    total += float(law.change_variance(np.array(held))) * held**2
    return total + lasting * duration**2 + gusts * duration
