"""Maps of a thousand kilometres with given numbers of regions, obstacles and corners."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

SIDE = 10.0  # of the map, in units of 100 km
Polygon = list[list[float]]


def region_names(count: int) -> list[str]:
    """r0, r1, ..."""
    return [f"r{k}" for k in range(count)]


def crowded_map(regions: int, obstacles: int, corners: int = 6, seed: int = 1) -> dict[str, Any]:
    """Keys of ``scene``: polygons in the squares of a grid, regions and obstacles in mixed order.

    The start is the middle of the south-western square, which stays empty.
    """
    rng = np.random.default_rng(seed)
    places = math.ceil(math.sqrt(regions + obstacles + 1))
    width = SIDE / places
    squares = rng.permutation(np.arange(1, places * places))[: regions + obstacles]
    polygons = []
    for square in squares:
        middle = width * (np.array(divmod(int(square), places)) + rng.uniform(0.45, 0.55, 2))
        polygons.append(disc(middle, width * rng.uniform(0.25, 0.36), corners, rng))
    return {
        "name": "scale",
        "unit": 100_000.0,
        "centre": [37.0, -92.0],
        "bounds": [[0.0, 0.0], [SIDE, SIDE]],
        "start": [0.5 * width, 0.5 * width],
        "regions": dict(zip(region_names(regions), polygons[:regions], strict=True)),
        "obstacles": polygons[regions:],
    }


def disc(middle: np.ndarray, radius: float, corners: int, rng: np.random.Generator) -> Polygon:
    """A polygon around ``middle`` with a wavy outline, which is not convex if it has many corners."""
    angle = 2 * np.pi * (np.arange(corners) + rng.uniform(0, 1)) / corners
    wave = 1.0 + 0.05 * np.sin(7 * angle + rng.uniform(0, 6)) if corners > 30 else np.ones(corners)
    rim = radius * wave
    return (middle + np.column_stack([rim * np.cos(angle), rim * np.sin(angle)])).round(6).tolist()


__all__ = ["SIDE", "crowded_map", "disc", "region_names"]
