"""A plan made again after a fix: its robot has the errors that it began with, whatever the fix says of them.

A fix that lies near the plan shows small errors, so that the new plan promises too many failures; one far
from the plan shows large errors, which the new plan does not know, so that it promises too few. Over all
fixes the promises are right in the mean. The flights that they are compared with are simulated in NumPy
alone, and weighted by how well their position agrees with the fix.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from numpy.random import SeedSequence

from coherent import LOOSE
from pareto_ltl.planning.conditioning import Fix, learn_at
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import RobotConfig
from pareto_ltl.simulation.flights import simulate_flights
from pareto_ltl.support.arrays import BoolArray, FloatArray
from problems import KM, along, box, make_problem, make_scene, steady_wind

SD = {"airspeed_sd": 0.04, "heading_sd": 3.0, "clock_sd": None}
ROBOT: dict[str, Any] = {"dt": 100.0, "u_max": 20.0, "start_sd": 50.0}
STEP, FIX_SD, GUST = 5, 150.0, 0.05
WALLS = [box(10, 10.7, 19, 12), box(10, 8, 19, 9.3)]  # of a corridor for the second half of the flight
RUNS, FIXES, PLAIN = 2_000, 100, 100_000


def corridor(start: FloatArray, start_sd: float) -> Problem:
    """A flight from ``start`` [m] eastwards between two obstacles."""
    scene = make_scene({"a": box(14.5, 9.35, 19.5, 10.65)}, WALLS, start=tuple(start / KM))
    wind = steady_wind(scene, gust=(GUST, GUST))
    robot = RobotConfig(**ROBOT | SD | {"start_sd": start_sd})
    return make_problem("F a", scene, wind, robot, LOOSE, fidelity="full")


def plain_flights(u: FloatArray, start: FloatArray, gust: float) -> FloatArray:
    """Positions (PLAIN, T+1, 2) [m] of robots with airspeed and heading errors, each drawn once a flight."""
    rng = np.random.default_rng(5)
    scale = 1.0 + SD["airspeed_sd"] * rng.standard_normal(PLAIN)
    turn = np.radians(SD["heading_sd"]) * rng.standard_normal(PLAIN)
    x = [start + ROBOT["start_sd"] * rng.standard_normal((PLAIN, 2))]
    for east, north in u:
        speed, angle = scale * np.hypot(east, north), np.arctan2(north, east) + turn
        air = speed[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        x.append(x[-1] + ROBOT["dt"] * (air + gust * rng.standard_normal((PLAIN, 2))))
    return np.stack(x, axis=1)


def rest_fails(x: FloatArray) -> BoolArray:
    """Which flights meet an obstacle from ``STEP`` on."""
    walls = shapely.MultiPolygon([shapely.Polygon(wall) for wall in WALLS])
    return np.asarray(shapely.intersects(shapely.linestrings(x[:, STEP:]), walls))


class Flown:
    """The plan, plain flights of it, and what fails after a fix, as promised and as flown."""

    def __init__(self) -> None:
        self.begun = corridor(np.array([2.0, 10.0]) * KM, ROBOT["start_sd"])
        self.path = evaluate_path(self.begun, along((2, 10), (17, 10), step=1.5), "")
        white = float(np.sqrt(self.begun.modes.white * self.begun.wind.gust[0, 0]))
        self.x = plain_flights(self.path.u, self.path.x[0], white)
        self.failed = rest_fails(self.x)

    def flown(self, fix: FloatArray) -> float:
        """Share of failures of the flights that lead to ``fix`` (2,) [m]."""
        weight = np.exp(-0.5 * np.sum((self.x[:, STEP] - fix) ** 2, axis=1) / FIX_SD**2)
        assert weight.sum() > 100.0
        return float(weight @ self.failed / weight.sum())

    def promised(self, fix: FloatArray) -> float:
        """Failure rate of the rest of the plan, planned again from ``fix`` (2,) [m]."""
        learnt = learn_at(self.begun, self.path.x, STEP, [Fix(fix, FIX_SD, STEP)])
        x = self.path.x[STEP:] + learnt.mean - self.path.x[STEP]
        rest, seed = corridor(learnt.mean, learnt.sd), SeedSequence(7)
        return float(simulate_flights(rest, self.path.u[STEP:], RUNS, "coherent", seed, x).failed.mean())


@pytest.fixture(scope="module")
def made() -> Flown:
    return Flown()


@pytest.mark.statistical
def test_after_a_fix_on_the_plan_the_promise_is_careful(made: Flown) -> None:
    fix = made.path.x[STEP]
    assert made.promised(fix) > made.flown(fix) + 0.05


@pytest.mark.statistical
def test_after_a_fix_far_from_the_plan_the_promise_is_too_low(made: Flown) -> None:
    """1.3 standard deviations aside, which the heading's error explains and repeats."""
    fix = made.path.x[STEP] + np.array([0.0, 500.0])
    assert made.promised(fix) < made.flown(fix)


@pytest.mark.statistical
def test_over_all_fixes_the_promises_are_right_in_the_mean(made: Flown) -> None:
    rng = np.random.default_rng(11)
    fixes = made.x[:FIXES, STEP] + FIX_SD * rng.standard_normal((FIXES, 2))
    gaps = np.array([made.promised(fix) - made.flown(fix) for fix in fixes])
    assert abs(gaps.mean()) < 5.0 * gaps.std() / np.sqrt(FIXES)
