"""Maps with many obstacles or many corners, shared by the suites of lines and of smoothing."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from problems import KM

SIDE = 20.0  # of the maps [km]
MEGABYTE = 1e6


class Waiting(NamedTuple):
    """Data of a path for a taut line: places to bend at, and the covariance at each step."""

    x: FloatArray
    cov: FloatArray


def many_discs(
    count: int, seed: int, radius: tuple[float, float], gap: float = 0.15, corners: int | None = None
) -> list[FloatArray]:
    """Convex polygons in discs [km] that do not touch each other, the start or two regions.

    They have 5 to 8 corners, or the number asked for.
    """
    rng = np.random.default_rng(seed)
    polygons: list[FloatArray] = []
    placed = [(1.0, 1.0, 0.5), (17.0, 17.0, 1.5), (3.0, 16.0, 1.5)]
    while len(polygons) < count:
        r = rng.uniform(*radius)
        middle = rng.uniform(r, SIDE - r, 2)
        if all(math.dist(middle, (x, y)) >= r + other + gap for x, y, other in placed):
            placed.append((*middle, r))
            n = corners or int(rng.integers(5, 9))
            angle = 2 * np.pi * (np.arange(n) + rng.uniform(0.1, 0.9, n)) / n
            polygons.append((middle + r * np.column_stack([np.cos(angle), np.sin(angle)])) * KM)
    return polygons


def rough_disc(
    corners: int = 2000,
    east: float = 13.0,
    north: float = 13.0,
    radius: float = 3.0,
    roughness: float = 0.02,
    seed: int = 0,
) -> FloatArray:
    """A disc with a wavy, irregular outline, so that it is not convex; kilometres in, metres out."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(corners) / corners
    waves = sum(rng.normal() / k * np.cos(k * angle + rng.uniform(0, 6)) for k in range(2, 12))
    r = radius * (1 + roughness * waves + 0.1 * roughness * rng.uniform(-1, 1, corners))
    return np.column_stack([east + r * np.cos(angle), north + r * np.sin(angle)]) * KM
