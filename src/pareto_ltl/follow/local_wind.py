"""The wind law at one step and several positions, in NumPy: for the belief and for the flights of a watch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pareto_ltl.kernels.data import CoherentLaw, LandmarkLaw, Modes, Wind
from pareto_ltl.planning.wind_lookup import (
    bilinear_value,
    interpolate_time,
    lattice_corners,
    wind_and_gradient,
)
from pareto_ltl.support.arrays import Float32Array, FloatArray


class LocalWind(NamedTuple):
    """The law at n positions: w = mean + ψ θ + √white η, with η ~ N(0, 1) new at every step.

    ``mean`` (n, 2) [m/s], ``gradient`` (n, 2, 2) = Dμ [1/s], ``psi`` (n, 2, P) [m/s], ``white`` (n, 2)
    [m²/s²].
    """

    mean: FloatArray
    gradient: FloatArray
    psi: FloatArray
    white: FloatArray


def local_wind(law: CoherentLaw | LandmarkLaw, step: int, x: FloatArray) -> LocalWind:
    """The law at ``step`` and the positions ``x`` (n, 2) [m].

    Eqs. (M14) and (M19) of docs/mathematics.md.
    """
    wind, modes, n = law.wind, law.modes, len(x)
    here = wind._replace(slot=np.full(n, wind.slot[step]), weight=np.full(n, wind.weight[step]))
    mean, gradient = wind_and_gradient(here, x)
    psi = _at(modes, modes.psi, int(modes.slot[step]), x) * modes.scale[step].astype(float)
    first, weight = int(wind.slot[step]), float(wind.weight[step])
    latent = _at(wind, wind.latent, first, x)
    if weight > 0.0:
        latent = (1.0 - weight) * latent + weight * _at(wind, wind.latent, first + 1, x)
    smooth = np.maximum(latent + wind.between[step] - (psi**2).sum(axis=-1), 0.0)
    gust = interpolate_time(wind, wind.gust, step)
    return LocalWind(mean, gradient, psi, modes.white * gust + modes.rest * smooth)


def _at(lattice: Wind | Modes, table: FloatArray | Float32Array, slot: int, x: FloatArray) -> FloatArray:
    """Slot ``slot`` of ``table`` (K, NX, NY, ...) at the positions ``x`` (n, 2), (n, ...)."""
    one = np.asarray(table[slot : slot + 1], float)
    corners, fractions, _ = lattice_corners(lattice, one, np.zeros(len(x), np.int64), x)
    more = (1,) * (corners.ndim - 3)
    first, second = (f.reshape(-1, *more) for f in fractions.T)
    return bilinear_value(corners, first, second)
