"""Histories of analyses and forecasts whose errors have a known law."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from flight_quantities.sphere import on_sphere
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.snapshots import Snapshot

HOUR = 3600.0
EARTH = 6_371_000.0
CHANGE_LENGTH, ERROR_LENGTH = 250e3, 450e3
STEP_SD = 1.5  # change of the wind in a step [m/s]
E6, E12 = 0.8, 1.3  # direct histories
PERSISTENCE = 0.7
E3 = 1.2  # asymmetric ones
LON, LAT = np.meshgrid(np.arange(-104.0, -88.0, 1.25), np.arange(32.0, 44.0, 1.25))
NODES = np.column_stack([LON.ravel(), LAT.ravel()])


@lru_cache
def _root(length: float) -> FloatArray:
    """Square root of the Matern-3/2 correlation between the nodes, independent of the package's code."""
    sphere = on_sphere(NODES)
    angle = np.arccos(np.clip(sphere @ sphere.T, -1.0, 1.0))
    r = np.sqrt(3.0) * EARTH * angle / length
    correlation: FloatArray = (1 + r) * np.exp(-r)
    return np.linalg.cholesky(correlation + 1e-9 * np.eye(len(NODES)))


def random_field(rng: np.random.Generator, length: float) -> FloatArray:
    """Both components of a field of unit variance, (n, 2)."""
    return _root(length) @ rng.standard_normal((len(NODES), 2))


def snapshot(time: float, lead: float, winds: FloatArray, level: str = "10m") -> Snapshot:
    return Snapshot(time, lead, NODES, winds, level, (Path("made.grib2"),))


def direct_history(seed: int, cycles: int = 60) -> tuple[Snapshot, ...]:
    """A random walk in steps of 6 h; each cycle has forecasts for 6 and 12 h, whose errors persist."""
    rng = np.random.default_rng(seed)
    steps = [STEP_SD * random_field(rng, CHANGE_LENGTH) for _ in range(cycles)]
    truth = np.cumsum(steps, axis=0)
    told = []
    for k in range(cycles):
        told.append(snapshot(6 * HOUR * k, 0.0, truth[k]))
        first = random_field(rng, ERROR_LENGTH)
        second = PERSISTENCE * first + np.sqrt(1 - PERSISTENCE**2) * random_field(rng, ERROR_LENGTH)
        for ahead, sd, error in ((1, E6, first), (2, E12, second)):
            if k + ahead < cycles:
                time = 6 * HOUR * (k + ahead)
                told.append(snapshot(time, 6 * HOUR * ahead, truth[k + ahead] + sd * error))
    return tuple(told)


def asymmetric_history(seed: int, cycles: int = 60) -> tuple[Snapshot, ...]:
    """A random walk in steps of 3 h; analyses each 6 h, and forecasts for 3 h at the times between.

    A forecast departs from its analysis by κ c + √(1 - κ²) c', c the true change and c' a change of its own::

        e² = 2 (1 - κ) D(3 h)
    """
    rng = np.random.default_rng(seed)
    kappa = 1 - E3**2 / (2 * STEP_SD**2)
    wind, told = random_field(rng, CHANGE_LENGTH), []
    for k in range(cycles):
        told.append(snapshot(6 * HOUR * k, 0.0, wind))
        one, two, other = (STEP_SD * random_field(rng, CHANGE_LENGTH) for _ in range(3))
        guessed = wind + kappa * one + np.sqrt(1 - kappa**2) * other
        told.append(snapshot(6 * HOUR * k + 3 * HOUR, 3 * HOUR, guessed))
        wind = wind + one + two
    return tuple(told)
