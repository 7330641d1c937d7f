"""The wind lattice in time and in space, and the search trees, as figures and pages show them."""

from __future__ import annotations

import numpy as np

from pareto_ltl import WindField
from pareto_ltl.extend import Forest
from pareto_ltl.support.arrays import FloatArray, IntArray

ARROWS_ALONG = 13  # wind arrows along the longer side of the map


def interpolate_slots(times: FloatArray, values: FloatArray, t: float) -> FloatArray:
    """``values`` (K, ...) at ``t`` [s], linear between ``times`` (K,) [s] and constant outside of them."""
    weights = [np.interp(t, times, slot) for slot in np.eye(len(times))]
    return np.asarray(np.tensordot(weights, values, 1), float)


def lattice_nodes(wind: WindField) -> tuple[FloatArray, FloatArray]:
    """x (NX,) and y (NY,) of the lattice [m]."""
    nx, ny = wind.mean.shape[1:3]
    return wind.origin[0] + wind.spacing * np.arange(nx), wind.origin[1] + wind.spacing * np.arange(ny)


def arrow_nodes(wind: WindField, bounds: FloatArray) -> tuple[IntArray, IntArray]:
    """Indices along x and y of the nodes at which wind arrows stand on a map of ``bounds`` (2, 2) [m]."""
    (west, south), (east, north) = bounds
    x, y = lattice_nodes(wind)
    gap = max(east - west, north - south) / ARROWS_ALONG
    return (
        spaced_nodes(x, west + gap / 4, east - gap / 4, gap),
        spaced_nodes(y, south + gap / 4, north - gap / 4, gap),
    )


def wind_deviation(wind: WindField, t: float) -> FloatArray:
    """Standard deviation of a component of the wind of one step at ``t`` [s], (NX, NY) [m/s].

    The root of the mean variance of both components.
    """
    latent = interpolate_slots(wind.times, wind.latent_var, t)
    gust = interpolate_slots(wind.times, wind.gust_var, t)
    between = float(wind.time_variance(np.array([t]))[0])
    return np.asarray(np.sqrt((latent + gust).mean(axis=-1) + between), float)


def oldest_edges(forest: Forest, limit: int) -> FloatArray:
    """Ends (n, 2, 2) [m] of the edges to the oldest ``most / trees`` vertices of each tree."""
    share = max(2, limit // max(1, len(forest.trees)))
    pieces = [np.empty((0, 2, 2))]
    pieces += [np.stack([tree.x[tree.parent[1:share]], tree.x[1:share]], axis=1) for tree in forest.trees]
    return np.concatenate(pieces)


def spaced_nodes(nodes: FloatArray, low: float, high: float, gap: float) -> IntArray:
    """Indices of every n-th node between ``low`` and ``high``, about ``gap`` [m] apart and centred."""
    inside = np.flatnonzero((nodes >= low - 1e-6) & (nodes <= high + 1e-6))
    if len(inside) < 2:
        return inside
    stride = max(1, round(gap / (nodes[1] - nodes[0])))
    return inside[(len(inside) - 1) % stride // 2 :: stride]
