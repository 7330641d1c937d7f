"""Random missions at real places: a place, a departure, three regions, a few obstacles, a formula.

Each has a separate random generator, so that mission 17 does not depend on the number of missions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from numpy.random import Generator, SeedSequence

from pareto_ltl.settings import ForecastTestConfig
from pareto_ltl.studies.true_fields import Spell
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.readings import iso
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene

REGIONS = ("a", "b", "c")
REGION, OBSTACLE = (0.06, 0.11), (0.05, 0.13)  # radii in sides of the map
APART, ASIDE = 0.05, 0.02  # free space around regions and the start, and between obstacles, in sides
TRIES = 2000  # places tried for a polygon before a new map is begun


@dataclass(frozen=True, slots=True)
class Mission:
    """A random map with its formula, in a period of consecutive wind fields."""

    number: int
    scene: Scene
    formula: str
    spell: Spell
    latitude: float
    longitude: float


def mission(
    cfg: ForecastTestConfig, seed: int, number: int, spells: Sequence[Spell], border: str = "open"
) -> Mission:
    """Mission ``number`` of seed ``seed`` on a map with the given ``border``."""
    rng = np.random.default_rng(SeedSequence(seed, spawn_key=(crc32(cfg.section.encode()), number)))
    spell, departure = _departure(cfg, rng, spells)
    lon, lat = _place(cfg, rng)
    formula = str(cfg.formulas[int(rng.integers(len(cfg.formulas)))])
    side = float(rng.uniform(cfg.side[0], cfg.side[1]))
    scene = None
    while scene is None:
        scene = _scene(cfg, rng, side, projection.local_plane(lat, lon), iso(departure))
    return Mission(number, replace(scene, border=border), formula, spell, lat, lon)


def _departure(cfg: ForecastTestConfig, rng: Generator, spells: Sequence[Spell]) -> tuple[Spell, float]:
    """A random full hour after ``wait`` with wind for ``hours`` from then on; all are equally likely."""
    counts = np.array([int((s.end - s.start) / 3600 - cfg.wait - cfg.hours) + 1 for s in spells])
    pick = int(rng.integers(counts.sum()))
    k = int(np.searchsorted(np.cumsum(counts), pick, side="right"))
    hour = pick - int(counts[:k].sum())
    return spells[k], spells[k].start + 3600.0 * (cfg.wait + hour)


def _place(cfg: ForecastTestConfig, rng: Generator) -> tuple[float, float]:
    """A random point of the area (longitude, latitude) [deg], uniform on its surface."""
    import shapely

    area = shapely.Polygon(cfg.area)
    west, south, east, north = area.bounds
    low, high = np.sin(np.deg2rad([south, north]))
    while True:
        lon, lat = float(rng.uniform(west, east)), float(np.rad2deg(np.arcsin(rng.uniform(low, high))))
        if shapely.contains_xy(area, lon, lat):
            return lon, lat


def _scene(cfg: ForecastTestConfig, rng: Generator, side: float, crs: str, time_zero: str) -> Scene | None:
    """Regions, start and obstacles at a distance from one another; None if there is not enough space."""
    import shapely

    bounds = side / 2 * np.array([[-1.0, -1.0], [1.0, 1.0]])
    room = shapely.box(*(bounds * (1 - 2 * ASIDE)).ravel())
    taken: list[shapely.Geometry] = []

    def put(radius: tuple[float, float], gap: float) -> FloatArray | None:
        for _ in range(TRIES):
            corners: FloatArray = polygon(rng, side * rng.uniform(*radius)) + rng.uniform(
                bounds[0], bounds[1]
            )
            shape = shapely.Polygon(corners)
            if room.contains(shape) and all(shape.distance(other) >= gap * side for other in taken):
                taken.append(shape)
                return corners
        return None

    start = rng.uniform(0.9 * bounds[0], 0.9 * bounds[1])
    taken.append(shapely.Point(start))
    regions = {name: put(REGION, APART) for name in REGIONS}
    walls = [put(OBSTACLE, APART) for _ in range(int(rng.integers(cfg.obstacles[0], cfg.obstacles[1] + 1)))]
    if any(shape is None for shape in (*regions.values(), *walls)):
        return None
    return Scene(
        bounds,
        start,
        {k: (v,) for k, v in regions.items() if v is not None},
        tuple(w for w in walls if w is not None),
        crs,
        time_zero,
    )


def polygon(rng: Generator, radius: float) -> FloatArray:
    """Convex, counter-clockwise, 4 to 7 corners on a circle about the origin, (n, 2)."""
    n = int(rng.integers(4, 8))
    angle = (np.arange(n) + rng.uniform(-0.3, 0.3, n)) * 2 * np.pi / n + rng.uniform(0, 2 * np.pi)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
