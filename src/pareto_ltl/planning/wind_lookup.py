"""The wind on its lattice between nodes and slots, in NumPy: for single places and for whole paths.

:mod:`pareto_ltl.kernels.interpolation` computes the same for compiled loops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from pareto_ltl.kernels.data import Modes, Wind


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
