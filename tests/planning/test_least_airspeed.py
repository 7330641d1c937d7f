"""``robot.u_min``: no control is slower, in trees, smoothing, the sampled refinement and flights."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.extend import draw_flights, simulate_flights
from pareto_ltl.kernels.data import World
from pareto_ltl.planning.evaluate import airspeed_limits, completes_mission, evaluate_path, propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.margin_model import margin_model
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.planning.refine.sampled import (
    Polish,
    Refiner,
    resampled_means,
    steps_needed,
)
from pareto_ltl.planning.selection import tree_front
from pareto_ltl.planning.smoothing import smooth_paths
from pareto_ltl.planning.tree_models import tree_models
from pareto_ltl.settings import FidelityConfig, PlannerConfig, RobotConfig, SmoothingConfig
from pareto_ltl.settings.fidelity import preset
from pareto_ltl.support.arrays import FloatArray, length_of
from pareto_ltl.support.errors import InfeasibleError
from problems import KM, along, box, make_problem, make_scene, smooth_wind, steady_wind

SCENE = make_scene({"a": box(13, 7, 17, 11), "b": box(3, 14, 7, 18)}, [box(8, 3, 10, 8)], start=(2, 4))
SMALL = PlannerConfig(trees=3, n_max=500, threads=1, epsilon=0.3, delta=0.9)


def task(fidelity: str | FidelityConfig = "full", wind: float = 3.0, **robot: object) -> Problem:
    found = RobotConfig(**({"dt": 100.0, "u_max": 10.0} | robot))  # type: ignore[arg-type]
    blown = smooth_wind(SCENE, speed=wind, sd=0.4, gust=0.3)
    return make_problem("F(a & F b)", SCENE, blown, found, SMALL, fidelity=fidelity)


def airspeeds(problem: Problem, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Airspeed of each step of ``x`` and its limits, (T,) each [m/s]."""
    flight = propagate(problem, x)
    return np.linalg.norm(flight.u, axis=1), *airspeed_limits(problem, flight.speed)


def keeps(problem: Problem, x: FloatArray, slack: float = 1e-6) -> bool:
    speed, least, most = airspeeds(problem, x)
    return bool(((speed >= least * (1 - slack)) & (speed <= most * (1 + slack))).all())


# --- one path -------------------------------------------------------------------------------------


def test_feedback_takes_from_both_ends_of_the_airspeeds() -> None:
    models = replace(preset("full"), judge="bound")  # flights as judges need no reserve
    problem = task(fidelity=models, u_min=4.0, feedback_time=450.0, start_sd=100.0)
    flight = propagate(problem, along((2, 4), (5, 4), (9, 9), step=0.7))
    least, most = airspeed_limits(problem, flight.speed)
    assert (most < 10.0).all()
    np.testing.assert_allclose(least - 4.0, 10.0 - most)
    free = task(feedback_time=450.0, start_sd=100.0)
    assert not airspeed_limits(free, flight.speed)[0].any()  # it may hover, and turn round


def test_a_slow_step_is_refused_with_its_place() -> None:
    problem = make_problem("F a", SCENE, steady_wind(SCENE), RobotConfig(dt=100.0, u_max=10.0, u_min=6.0))
    x = np.array([[2.0, 4.0], [2.7, 4.0], [3.4, 4.0], [3.9, 4.0]]) * KM
    with pytest.raises(InfeasibleError, match=r"flies slower than robot\.u_min.* at step 3 of 3"):
        evaluate_path(problem, x, "")
    assert len(evaluate_path(problem, x[:3], "").u) == 2
    x[3] = [4.0 * KM, 4.0 * KM]
    assert len(evaluate_path(problem, x, "").u) == 3  # 6 m/s exactly


# --- trees ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("fidelity", ["paper", "full"])
@pytest.mark.parametrize(
    "robot", [{"u_min": 7.0}, {"u_min": 10.0}, {"u_min": 4.0, "feedback_time": 900.0, "start_sd": 50.0}]
)
def test_no_edge_of_a_tree_is_too_slow_or_too_fast(fidelity: str, robot: dict[str, float]) -> None:
    """In the models of the trees, which leave airspeed for what only the law of the plan shifts."""
    problem = task(fidelity, **robot)
    forest = grow_forest(SMALL, problem, SeedSequence(0))
    assert len(forest.accepted) > 0
    problem = replace(problem, world=World(*tree_models(problem)))
    slowest = np.inf
    for tree in forest.trees:
        childless = np.setdiff1d(np.arange(len(tree)), tree.parent)
        for v in childless[::3]:
            assert keeps(problem, tree.path(v))
            slowest = min(slowest, airspeeds(problem, tree.path(v))[0].min(initial=np.inf))
    assert slowest < robot["u_min"] + 1.0  # the limit is met


def test_trees_without_a_least_airspeed_have_slower_edges() -> None:
    problem = task(u_min=0.0)
    forest = grow_forest(SMALL, problem, SeedSequence(0))
    slow = min(airspeeds(problem, tree.path(len(tree) - 1))[0].min() for tree in forest.trees)
    assert slow < 7.0


# --- refinement -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("fidelity", "u_min"), [("paper", 6.0), ("full", 6.0), ("paper", 9.5)])
def test_smoothed_paths_are_fast_enough_and_better(fidelity: str, u_min: float) -> None:
    problem = task(fidelity, u_min=u_min)
    paths = tree_front(problem, grow_forest(SMALL, problem, SeedSequence(0)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # cvxpy warns of problems that it must state anew for each solve
        smoothed = smooth_paths(SmoothingConfig(candidates=2), problem, paths)
    assert smoothed
    assert all(keeps(problem, path.x) and completes_mission(problem, path) for path in smoothed)

    def merit(path: PlannedPath) -> float:
        o = path.objectives
        return o.length / (10 * KM) + 10.0 * (o.mission_risk + o.collision_risk)

    assert min(map(merit, smoothed)) < min(map(merit, paths))


def test_smoothing_leaves_paths_alone_where_the_airspeed_is_fixed(caplog: pytest.LogCaptureFixture) -> None:
    problem = task("paper", u_min=10.0)
    paths = tree_front(problem, grow_forest(SMALL, problem, SeedSequence(0)))
    assert paths
    assert smooth_paths(SmoothingConfig(candidates=2), problem, paths) == ()
    assert "robot.u_min = 10 m/s is too close to robot.u_max" in caplog.text


@pytest.mark.parametrize("u_min", [5.0, 8.0, 10.0])
def test_polished_paths_are_fast_enough_and_fail_less(u_min: float) -> None:
    """With 10 m/s the airspeed is fixed, and headings alone are left to choose."""
    problem = task(u_min=u_min, wind=1.0)
    refiner = Refiner(problem, margin_model(problem))
    line = along((2, 4), (11, 8.6), (13.4, 10.6), (7.4, 14), (6.7, 14.3), step=0.9)
    start = resampled_means(problem, line, int(np.ceil(steps_needed(problem, line).sum())))
    flights = draw_flights(problem, "coherent", 200, SeedSequence(1))
    before = refiner.flown(start)
    assert keeps(problem, before.x)
    found = refiner.polish(start, flights, Polish((400.0, 400.0, 100.0, 100.0)), 1.1 * length_of(start))
    assert keeps(problem, found.flight.x)
    assert found.failed < float(flights.failed(flights.positions(before)).mean()) - 0.3
    assert found.length < 1.11 * length_of(start)


# --- flights --------------------------------------------------------------------------------------


def flown_airspeeds(problem: Problem, x: FloatArray, runs: int = 200) -> FloatArray:
    """Airspeeds (runs, T) [m/s] of flights in still air with feedback: all they do is their control."""
    u = propagate(problem, x).u
    flights = simulate_flights(problem, u, runs, "independent", SeedSequence(0), x)
    return np.linalg.norm(np.diff(flights.x, axis=1), axis=2) / problem.motion.dt


def test_feedback_never_asks_for_less_than_the_least_airspeed() -> None:
    x = along((2, 4), (9, 4), (9, 10), step=0.7)
    robot = {"dt": 100.0, "u_max": 10.0, "feedback_time": 150.0, "start_sd": 900.0}
    still = steady_wind(SCENE, gust=(0.0, 0.0))
    slow = make_problem("F a", SCENE, still, RobotConfig(**robot, u_min=6.0))
    speeds = flown_airspeeds(slow, x)
    assert speeds.min() == pytest.approx(6.0, rel=1e-9)
    assert speeds.max() == pytest.approx(10.0, rel=1e-9)
    free = make_problem("F a", SCENE, still, RobotConfig(**robot))
    assert flown_airspeeds(free, x).min() < 5.0


def test_a_planned_reserve_is_seldom_used_up() -> None:
    """The feedback of a step asks for less than u_min in at most ``effort_risk`` of the flights."""
    still = steady_wind(SCENE, gust=(0.0, 0.0))
    robot = RobotConfig(
        dt=100.0, u_max=10.0, u_min=5.0, feedback_time=150.0, start_sd=150.0, effort_risk=0.05
    )
    problem = make_problem("F a", SCENE, still, robot)
    x = along((2, 4), (9, 4), step=0.71)
    assert keeps(problem, x)
    speeds = flown_airspeeds(problem, x, 20_000)
    at_limit = (speeds <= 5.0 * (1 + 1e-9)).mean(axis=0).max()
    assert at_limit < 0.05 + 5.0 * np.sqrt(0.05 * 0.95 / 20_000)
