"""Spatial derivatives of the expected wind along a path.

:func:`pareto_ltl.planning.wind_lookup.wind_and_gradient` is the same in plain Python.
"""

from __future__ import annotations

from pareto_ltl.kernels.data import Point, Wind
from pareto_ltl.kernels.interpolation import wind_square
from pareto_ltl.kernels.jit import kernel
from pareto_ltl.support.arrays import FloatArray


@kernel
def node(wind: Wind, t: int, i: int, j: int, c: int) -> float:
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
            low, right = node(wind, t, i, j, c), node(wind, t, i + 1, j, c)
            up, far = node(wind, t, i, j + 1, c), node(wind, t, i + 1, j + 1, c)
            slopes[t, c, 0] = east * ((1.0 - fy) * (right - low) + fy * (far - up))
            slopes[t, c, 1] = north * ((1.0 - fx) * (up - low) + fx * (far - right))
