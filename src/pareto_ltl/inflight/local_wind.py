"""The wind law at one step, in NumPy: at several positions, and linear about one for a filter."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pareto_ltl.kernels.data import CoherentLaw, LandmarkLaw, Modes, Wind
from pareto_ltl.planning.wind_lookup import bilinear_value, interpolate, interpolate_time, lattice_corners
from pareto_ltl.support.arrays import Float32Array, FloatArray

NEAR = 1.0  # [m] half of the distance over which modes are differentiated


class LocalWind(NamedTuple):
    """The law at n positions: w = mean + ψ θ + √white η, with η ~ N(0, 1) new at every step.

    ``mean`` (n, 2) [m/s], ``psi`` (n, 2, P) [m/s], ``white`` (n, 2) [m²/s²].
    """

    mean: FloatArray
    psi: FloatArray
    white: FloatArray

    def met(self, theta: FloatArray, white: FloatArray) -> FloatArray:
        """The winds (n, 2) of the fields ``theta`` (n, 2, P) and the white parts ``white`` (n, 2) [m/s]."""
        return np.asarray(self.mean + np.einsum("ncm,ncm->nc", self.psi, theta) + white)


def local_wind(law: CoherentLaw | LandmarkLaw, step: int, x: FloatArray) -> LocalWind:
    """The law at ``step`` and the positions ``x`` (n, 2) [m].

    Eqs. (M14) and (M19) of docs/mathematics.md.
    """
    wind, modes, slot = law.wind, law.modes, int(law.wind.slot[step])
    psi = modes_at(modes, step, x)
    mean, latent = (
        _between(wind, table, slot, float(wind.weight[step]), x) for table in (wind.mean, wind.latent)
    )
    smooth = np.maximum(latent + wind.between[step] - (psi**2).sum(axis=-1), 0.0)
    return LocalWind(mean, psi, modes.white * interpolate_time(wind, wind.gust, step) + modes.rest * smooth)


def modes_at(modes: Modes, step: int, x: FloatArray) -> FloatArray:
    """ψ at ``step`` and the positions ``x`` (n, 2), (n, 2, P) [m/s]."""
    return np.asarray(_at(modes, modes.psi, int(modes.slot[step]), x) * modes.scale[step].astype(float))


class LinearWind(NamedTuple):
    """The law about one position: w = mean + slope e + ψ θ + √white η.

    ``mean`` (2,) includes what the curvature of the field adds, ``slope`` (2, 2) = Dμ [1/s], ``psi`` (2, P),
    ``white`` (2,).
    """

    mean: FloatArray
    slope: FloatArray
    psi: FloatArray
    white: FloatArray


def linear_wind(
    law: CoherentLaw | LandmarkLaw, step: int, x: FloatArray, cov: FloatArray, cross: FloatArray
) -> LinearWind:
    """The law about ``x`` (2,) with Σ = ``cov`` (2, 2) [m²] and C = ``cross`` (2, 2, P) = Cov(e, θ) [m].

    The mean is μ + ½ D²μ : Σ + ∂ψ : C.

    Eq. (M24) of docs/mathematics.md.
    """
    wind, modes = law.wind, law.modes
    here = local_wind(law, step, x[None])
    slope, bend = (interpolate(wind, table, step, x) for table in (modes.slope, modes.bend))
    around = modes_at(modes, step, x + NEAR * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]))
    change = (around[::2] - around[1::2]) / (2.0 * NEAR)  # (direction, component, P)
    squares = np.array([cov[0, 0], 2.0 * cov[0, 1], cov[1, 1]])
    shift = 0.5 * bend.reshape(2, 3) @ squares + np.einsum("dcm,dcm->c", change, cross)
    return LinearWind(here.mean[0] + shift, slope.reshape(2, 2), here.psi[0], here.white[0])


def _between(wind: Wind, table: FloatArray, slot: int, weight: float, x: FloatArray) -> FloatArray:
    """``table`` (K, NX, NY, n) between two slots."""
    now = _at(wind, table, slot, x)
    return now if weight == 0.0 else (1.0 - weight) * now + weight * _at(wind, table, slot + 1, x)


def _at(lattice: Wind | Modes, table: FloatArray | Float32Array, slot: int, x: FloatArray) -> FloatArray:
    """Slot ``slot`` of ``table`` (K, NX, NY, ...) at the positions ``x`` (n, 2), (n, ...)."""
    one = np.asarray(table[slot : slot + 1], float)
    corners, fractions, _ = lattice_corners(lattice, one, np.zeros(len(x), np.int64), x)
    more = (1,) * (corners.ndim - 3)
    first, second = (f.reshape(-1, *more) for f in fractions.T)
    return bilinear_value(corners, first, second)
