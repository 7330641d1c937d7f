"""Scale of the wind: seconds and memory of a fit against readings, times and nodes of the lattice.

Each function generates readings of a smooth field over 2,000 km around a map of 1,000 km, fits and tabulates
them without the cache, and returns the CPU seconds of all cores: other work on the machine counts less.
"""

from __future__ import annotations

import time

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.wind.field import fit_wind_field
from pareto_ltl.wind.records import WindObservations
from pareto_ltl.world.scene import Scene
from scale.case import GIBIBYTE, Case

SIDE = 1e6  # [m] of the map
WAVES = 60


def made_up(readings: int, times: int, same_places: bool) -> WindObservations:
    """``readings`` of a sum of waves with noise at each time, every 3 h, at the same or at new places."""
    rng = np.random.default_rng(0)
    places = rng.uniform(-SIDE, SIDE, (readings, 2))
    wave, phase = rng.normal(0, 1 / 400e3, (WAVES, 2)), rng.uniform(0, 2 * np.pi, (WAVES, 2))
    height = rng.normal(0, 0.8, (WAVES, 2))
    points, winds = [], []
    for k in range(times):
        at = places if same_places else rng.uniform(-SIDE, SIDE, (readings, 2))
        field = np.stack([np.cos(at @ wave.T + phase[:, c] + 0.3 * k) @ height[:, c] for c in (0, 1)], axis=1)
        points.append(at)
        winds.append(field + rng.normal(0, 0.5, field.shape))
    return WindObservations(10_800.0 * np.arange(times), tuple(points), tuple(winds), "made up")


def fit_seconds(readings: int = 120, times: int = 14, cells: int = 52, same_places: bool = True) -> float:
    """CPU seconds of a wind field from ``readings`` at each time on a lattice of ``cells`` along a side."""
    cfg = WindConfig(cache=False, max_points=10_000, spacing=1.3 * SIDE / cells)
    scene = Scene(SIDE * np.array([[-0.5, -0.5], [0.5, 0.5]]), np.zeros(2), {}, (), None, None)
    seen = made_up(readings, times, same_places)
    begin = time.process_time()
    fit_wind_field(cfg, seen, scene)
    return time.process_time() - begin


def gridded_readings(readings: int) -> float:
    """Scale in readings at each of 14 times, at the same places, as on a grid."""
    return fit_seconds(readings=readings)


def scattered_readings(readings: int) -> float:
    """Scale in readings at each of 3 times, at new places each time, as of stations: the slowest case."""
    return fit_seconds(readings=readings, times=3, same_places=False)


def wind_times(times: int) -> float:
    """Scale in times, each with 120 readings at new places."""
    return fit_seconds(times=times, same_places=False)


def wind_lattice(cells: int) -> float:
    """Scale in cells of the lattice along a side, with 120 readings at 14 times."""
    return fit_seconds(cells=cells)


READINGS = (120, 300, 1000, 2000, 5000)
CASES = [
    Case("wind, readings on a grid", READINGS, gridded_readings, "readings a time", 60.0, 2 * GIBIBYTE),
    Case("wind, scattered readings", READINGS, scattered_readings, "readings a time", 120.0, 2 * GIBIBYTE),
    Case("wind, times", (10, 30, 60, 120), wind_times, "times of 120 readings", 60.0),
    Case("wind, lattice", (50, 100, 200, 500), wind_lattice, "cells along a side", 10.0, 2 * GIBIBYTE),
]
