"""Maps with random regions and obstacles, to test planners on many maps."""

from __future__ import annotations

from dataclasses import replace
from string import ascii_lowercase

import numpy as np
from numpy.random import Generator

from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError

PLACEMENT_TRIES = 20_000  # random positions tried for one disc
CORNER_RANGE = (5, 9)  # of a polygon: smallest number, largest number + 1

PlacedDisc = tuple[float, float, float]


def add_random_places(cfg: SceneConfig) -> SceneConfig:
    """``cfg`` with the random regions and obstacles of ``cfg.random`` added, in the units of the scene.

    Each is a convex polygon with corners on a random circle. The circles are at least ``random.gap`` apart
    from each other, from the start, and from the named regions and obstacles, so that every region can be
    reached. The same ``random.seed`` gives the same map.

    Raises
    ------
    ConfigError
        If there is no free position for one of them.
    """
    wanted = cfg.random
    if wanted.regions + wanted.obstacles == 0:
        return cfg
    low, high = np.array(cfg.bounds, float)
    side = float((high - low).min())
    rng = np.random.default_rng(wanted.seed)
    circles = _existing_discs(cfg)
    polygons = []
    for _ in range(wanted.regions + wanted.obstacles):
        circle = _free_disc(rng, low, high, side, circles, cfg)
        circles.append(circle)
        polygons.append(_inscribed_polygon(rng, circle))
    names = [name for name in ascii_lowercase if name not in cfg.regions][: wanted.regions]
    return replace(
        cfg,
        regions={**cfg.regions, **dict(zip(names, polygons, strict=False))},
        obstacles=[*cfg.obstacles, *polygons[wanted.regions :]],
        random=replace(wanted, regions=0, obstacles=0),
    )


def _existing_discs(cfg: SceneConfig) -> list[PlacedDisc]:
    """Discs around the start and around the regions and obstacles of ``cfg``."""
    circles: list[PlacedDisc] = [(float(cfg.start[0]), float(cfg.start[1]), 0.0)] if cfg.start else []
    for polygon in (*cfg.regions.values(), *cfg.obstacles):
        corners = np.array(polygon, float)
        middle = corners.mean(axis=0)
        circles.append((*middle, float(np.linalg.norm(corners - middle, axis=1).max())))
    return circles


def _free_disc(
    rng: Generator,
    low: FloatArray,
    high: FloatArray,
    side: float,
    circles: list[PlacedDisc],
    cfg: SceneConfig,
) -> PlacedDisc:
    gap, (smallest, largest) = cfg.random.gap * side, cfg.random.radius
    others = np.array(circles).reshape(-1, 3)
    for _ in range(PLACEMENT_TRIES):
        radius = side * rng.uniform(smallest, largest)
        middle = rng.uniform(low + radius + gap, high - radius - gap)
        apart = np.linalg.norm(others[:, :2] - middle, axis=1)
        if np.all(apart >= others[:, 2] + radius + gap):
            return float(middle[0]), float(middle[1]), float(radius)
    raise ConfigError(
        f"scene.random: {cfg.random.regions} regions and {cfg.random.obstacles} obstacles do not fit the "
        f"map; ask for fewer, for a smaller scene.random.radius (now {cfg.random.radius}) or gap"
    )


def _inscribed_polygon(rng: Generator, circle: PlacedDisc) -> list[list[float]]:
    """Corners of a convex polygon on the circle, one at a random position in each of several equal arcs."""
    x, y, radius = circle
    corners = int(rng.integers(*CORNER_RANGE))
    angles = 2 * np.pi * (np.arange(corners) + rng.uniform(0.1, 0.9, corners)) / corners
    return [[x + radius * float(np.cos(a)), y + radius * float(np.sin(a))] for a in angles]
