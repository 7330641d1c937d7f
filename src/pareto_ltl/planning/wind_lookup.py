"""The wind on its lattice between nodes and slots, in NumPy: for single places and for whole paths.

:mod:`pareto_ltl.kernels.interpolation` computes the same for compiled loops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray, IntArray

if TYPE_CHECKING:
    from pareto_ltl.kernels.data import CoherentLaw, LandmarkLaw, Modes, Wind

NEAR = 1.0  # [m] half of the distance over which modes are differentiated


def lattice_corners(
    lattice: Wind | Modes, table: FloatArray, slot: IntArray, x: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """The square that holds each of ``x`` (P, 2), clamped to the lattice.

    Returns the values (2, 2, P, ...) of slots ``slot`` (P,) of ``table`` (K, NX, NY, ...) at its corners, by
    east and north neighbour; the fractions (P, 2); and which coordinates lie on the lattice (P, 2).
    """
    top = np.array(table.shape[1:3]) - 1
    g = (x - np.array([lattice.west, lattice.south])) * lattice.per_metre
    inside = (g >= 0) & (g <= top)
    g = np.clip(g, 0, top)
    i, j = np.minimum(g.astype(np.int64), top - 1).T
    corners = np.array([[table[slot, i + a, j + b] for b in (0, 1)] for a in (0, 1)])
    return corners, g - np.column_stack([i, j]), inside


def bilinear_value(corners: FloatArray, first: FloatArray | float, second: FloatArray | float) -> FloatArray:
    """Linear along the second index of ``corners`` (2, 2, ...), then along the first."""
    low, high = ((1 - second) * c[0] + second * c[1] for c in corners)
    return np.asarray((1 - first) * low + first * high, float)


def interpolate_time(wind: Wind, table: FloatArray, step: int) -> FloatArray:
    """A table (K, ...) at a step, linear between slots."""
    k, w = wind.slot[step], wind.weight[step]
    return np.asarray(table[k] if w == 0 else (1 - w) * table[k] + w * table[k + 1], float)


def interpolate(wind: Wind, table: FloatArray, step: int, point: FloatArray) -> FloatArray:
    """A table (K, NX, NY, n) at a step and a point, (n,); only the square that holds the point is read."""
    gx, gy = (float(point[0]) - wind.west) * wind.per_metre, (float(point[1]) - wind.south) * wind.per_metre
    nx, ny = table.shape[1:3]
    gx, gy = min(max(gx, 0.0), nx - 1.0), min(max(gy, 0.0), ny - 1.0)
    i, j = min(int(gx), nx - 2), min(int(gy), ny - 2)
    square = interpolate_time(wind, table[:, i : i + 2, j : j + 2], step)
    return bilinear_value(square, gx - i, gy - j)


def wind_and_gradient(wind: Wind, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """μ(x_t, t) (T, 2) [m/s] and Dμ (T, 2, 2) [1/s] at the rows of ``x``, one per step.

    μ is bilinear on the lattice, so ∂μ/∂x runs linearly between the differences along the lower and the
    upper side of the square. Beyond the lattice the wind is constant, and so it is after its last known step.
    """
    step = np.minimum(np.arange(len(x)), len(wind.slot) - 1)
    k, w = wind.slot[step], wind.weight[step, None]
    now, fractions, inside = lattice_corners(wind, wind.mean, k, x)
    after, _, _ = lattice_corners(wind, wind.mean, np.minimum(k + 1, len(wind.mean) - 1), x)
    corners = (1 - w) * now + w * after
    fx, fy = fractions.T[..., None]
    (c00, c01), (c10, c11) = corners
    mean = bilinear_value(np.swapaxes(corners, 0, 1), fy, fx)
    along = (1 - fy) * (c10 - c00) + fy * (c11 - c01)
    across = (1 - fx) * (c01 - c00) + fx * (c11 - c10)
    gradient = np.stack([along, across], axis=-1) * wind.per_metre * inside[:, None, :]
    return mean, gradient


# --- the wind law at one step: at several positions, and linear about one -----------------------


class LocalWind(NamedTuple):
    """The law at n positions: w = mean + ψ θ + √white η, with η ~ N(0, 1) new at every step.

    ``mean`` (n, 2) [m/s], ``psi`` (n, 2, P) [m/s], ``white`` (n, 2) [m²/s²].
    """

    mean: FloatArray
    psi: FloatArray
    white: FloatArray

    @classmethod
    def at(cls, law: CoherentLaw | LandmarkLaw, step: int, x: FloatArray) -> LocalWind:
        """The law at ``step`` and the positions ``x`` (n, 2) [m].

        Eqs. (M14) and (M19) of docs/mathematics.md.
        """
        wind, modes, slot = law.wind, law.modes, int(law.wind.slot[step])
        psi = modes_at(modes, step, x)
        mean, latent = (
            _between(wind, table, slot, float(wind.weight[step]), x) for table in (wind.mean, wind.latent)
        )
        smooth = np.maximum(latent + wind.between[step] - (psi**2).sum(axis=-1), 0.0)
        white = modes.white * interpolate_time(wind, wind.gust, step) + modes.rest * smooth
        return cls(mean, psi, white)

    def met(self, theta: FloatArray, white: FloatArray) -> FloatArray:
        """The winds (n, 2) of the fields ``theta`` (n, 2, P) and the white parts ``white`` (n, 2) [m/s]."""
        return np.asarray(self.mean + np.einsum("ncm,ncm->nc", self.psi, theta) + white)


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

    @classmethod
    def about(
        cls, law: CoherentLaw | LandmarkLaw, step: int, x: FloatArray, cov: FloatArray, cross: FloatArray
    ) -> LinearWind:
        """The law about ``x`` (2,) with Σ = ``cov`` (2, 2) [m²] and C = ``cross`` (2, 2, P) = Cov(e, θ) [m].

        The mean is μ + ½ D²μ : Σ + ∂ψ : C.

        Eq. (M24) of docs/mathematics.md.
        """
        wind, modes = law.wind, law.modes
        here = LocalWind.at(law, step, x[None])
        slope, bend = (interpolate(wind, table, step, x) for table in (modes.slope, modes.bend))
        beside = NEAR * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        around = modes_at(modes, step, x + beside)
        change = (around[::2] - around[1::2]) / (2.0 * NEAR)  # (direction, component, P)
        squares = np.array([cov[0, 0], 2.0 * cov[0, 1], cov[1, 1]])
        shift = 0.5 * bend.reshape(2, 3) @ squares + np.einsum("dcm,dcm->c", change, cross)
        return cls(here.mean[0] + shift, slope.reshape(2, 2), here.psi[0], here.white[0])


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
