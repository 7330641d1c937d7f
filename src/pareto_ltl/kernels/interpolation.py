"""Interpolation of tables on a lattice: bilinear in space, linear in time.

:func:`pareto_ltl.planning.wind_lookup.interpolate` is the same in plain Python.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from pareto_ltl.kernels.data import Modes, Square, Wind
from pareto_ltl.support.arrays import Float32Array, FloatArray
from plane_kernels.types import Point
from typed_kernels.jit import inlined, kernel, vector

F32 = np.float32
Weights: TypeAlias = tuple[np.float32, np.float32, np.float32, np.float32]


@inlined
def lattice_square(lattice: Wind | Modes, nx: int, ny: int, at: Point) -> Square:
    """The square of a lattice of ``nx`` by ``ny`` nodes that contains a point, clamped to the lattice."""
    gx = min(max((at.x - lattice.west) * lattice.per_metre, 0.0), nx - 1.0)
    gy = min(max((at.y - lattice.south) * lattice.per_metre, 0.0), ny - 1.0)
    i, j = min(int(gx), nx - 2), min(int(gy), ny - 2)
    return Square(i, j, gx - i, gy - j)


@inlined
def wind_square(wind: Wind, at: Point) -> Square:
    """The square of the wind's lattice that contains a point."""
    return lattice_square(wind, wind.mean.shape[1], wind.mean.shape[2], at)


@inlined
def mode_square(modes: Modes, at: Point) -> Square:
    """The square of the lattice of the modes that contains a point."""
    return lattice_square(modes, modes.psi.shape[1], modes.psi.shape[2], at)


@kernel
def bilinear(table: FloatArray, slot: int, square: Square, first: int) -> tuple[float, float]:
    """Columns ``first`` and ``first + 1`` of one slot of ``table`` (K, NX, NY, n), bilinear in a square."""
    i, j, fx, fy = square
    a, b, c, d = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
    h, l, p, q = i + 1, j + 1, first, first + 1  # noqa: E741
    e = a * table[slot, i, j, p] + b * table[slot, h, j, p] + c * table[slot, i, l, p]
    n = a * table[slot, i, j, q] + b * table[slot, h, j, q] + c * table[slot, i, l, q]
    return e + d * table[slot, h, l, p], n + d * table[slot, h, l, q]


@kernel
def pair_at(table: FloatArray, wind: Wind, step: int, square: Square, first: int) -> tuple[float, float]:
    """Columns ``first`` and ``first + 1`` of ``table`` (K, NX, NY, n) at a step, linear between its slots.

    Eq. (M10) of docs/mathematics.md.
    """
    k, w = wind.slot[step], wind.weight[step]
    e, n = bilinear(table, k, square, first)
    if w > 0.0:
        e1, n1 = bilinear(table, k + 1, square, first)
        e, n = (1 - w) * e + w * e1, (1 - w) * n + w * n1
    return e, n


@inlined
def wind_at(table: FloatArray, wind: Wind, step: int, at: Point) -> tuple[float, float]:
    """Both components of ``table`` (K, NX, NY, 2) at a point and a step."""
    return pair_at(table, wind, step, wind_square(wind, at), 0)


@kernel
def gust_variance(wind: Wind, step: int) -> tuple[float, float]:
    """Variance of the white part at a step, east and north [m²/s²]."""
    k, w = wind.slot[step], wind.weight[step]
    e, n = wind.gust[k, 0], wind.gust[k, 1]
    if w > 0.0:
        e, n = (1 - w) * e + w * wind.gust[k + 1, 0], (1 - w) * n + w * wind.gust[k + 1, 1]
    return e, n


@kernel
def corner_weights(square: Square) -> Weights:
    """Bilinear weights of the corners (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1) in single precision."""
    fx, fy = square.fx, square.fy
    return F32((1 - fx) * (1 - fy)), F32(fx * (1 - fy)), F32((1 - fx) * fy), F32(fx * fy)


@vector
def mode_value(
    psi: Float32Array, slot: int, square: Square, weights: Weights, c: int, m: int
) -> np.float32:  # fmt: skip
    """ψ_m(x) of wind component ``c``; ``weights`` are the :func:`corner_weights` of ``square``."""
    i, j = square.i, square.j
    w00, w10, w01, w11 = weights
    low = w00 * psi[slot, i, j, c, m] + w10 * psi[slot, i + 1, j, c, m]
    high = w01 * psi[slot, i, j + 1, c, m] + w11 * psi[slot, i + 1, j + 1, c, m]
    return low + high  # type: ignore[no-any-return]


@kernel
def node_wind(wind: Wind, t: int, i: int, j: int, c: int) -> float:
    """Component ``c`` of the expected wind [m/s] at node (i, j) of the lattice and step ``t``."""
    k, w = wind.slot[t], wind.weight[t]
    value = wind.mean[k, i, j, c]
    return float((1.0 - w) * value + w * wind.mean[k + 1, i, j, c] if w > 0.0 else value)


@kernel
def wind_slopes(wind: Wind, x: FloatArray, slopes: FloatArray) -> None:
    """Fill ``slopes`` (T, 2, 2) with Dμ [1/s] at the first T rows of ``x`` [m], one for each step.

    μ is bilinear on the lattice and constant beyond it.
    """
    last_x, last_y = wind.mean.shape[1] - 1.0, wind.mean.shape[2] - 1.0
    for t in range(len(slopes)):
        gx, gy = (x[t, 0] - wind.west) * wind.per_metre, (x[t, 1] - wind.south) * wind.per_metre
        i, j, fx, fy = wind_square(wind, Point(x[t, 0], x[t, 1]))
        east = wind.per_metre if 0.0 <= gx <= last_x else 0.0
        north = wind.per_metre if 0.0 <= gy <= last_y else 0.0
        for c in range(2):
            low, right = node_wind(wind, t, i, j, c), node_wind(wind, t, i + 1, j, c)
            up, far = node_wind(wind, t, i, j + 1, c), node_wind(wind, t, i + 1, j + 1, c)
            slopes[t, c, 0] = east * ((1.0 - fy) * (right - low) + fy * (far - up))
            slopes[t, c, 1] = north * ((1.0 - fx) * (up - low) + fx * (far - right))


@vector
def dot(one: Float32Array, other: Float32Array | FloatArray) -> float:
    """The scalar product of two vectors, in 64 bits if one of them has them."""
    total = F32(0.0)
    for j in range(len(one)):
        total += one[j] * other[j]
    return total  # type: ignore[return-value]
