"""Ranking of the front and acceptance of the plan by simulated flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.planning import growth, selection
from pareto_ltl.planning.records import Front
from pareto_ltl.planning.refine import smooth_paths
from pareto_ltl.settings import PlannerConfig, RobotConfig, SelectionConfig, SmoothingConfig
from pareto_ltl.simulation.acceptance import LINEAR, accept_path, rank_front
from pareto_ltl.simulation.flights import simulate_flights
from problems import KM, box, make_problem, make_scene, smooth_wind

PLANNER = PlannerConfig(trees=4, n_max=600)
SCENE = make_scene(
    {"a": box(13, 2, 17, 6), "b": box(3, 13, 7, 17)},
    [box(7, 0.5, 9, 6), box(10, 10, 14, 13)],
    start=(2.0, 3.0),
)


@pytest.fixture(scope="module")
def task():
    wind = smooth_wind(SCENE, speed=2.0, sd=0.25, gust=0.3)
    robot = RobotConfig(dt=100.0, u_max=10.0)
    return make_problem("F(a & F b)", SCENE, wind, robot, PLANNER, fidelity="full")


@pytest.fixture(scope="module")
def front(task):
    forest = growth.grow_forest(PLANNER, task, SeedSequence(1))
    raw = selection.tree_front(task, forest)
    begun = (*raw, *selection.order_representatives(task, forest))
    return selection.build_front(smooth_paths(SmoothingConfig(), task, begun), raw)


def test_ranking_estimates_the_rate_of_linear_flights(task, front):
    """Against nonlinear flights: in a mild wind the two rates agree within their sampling error."""
    ranked = rank_front(task, front, 4000, SeedSequence(3))
    assert len(ranked.estimates) == len(front.paths)
    for path, estimate in list(zip(ranked.paths, ranked.estimates, strict=True))[:3]:
        flights = simulate_flights(task, path.u, 4000, "coherent", SeedSequence(4), path.x)
        rate = float((~flights.accepted | flights.collided).mean())
        error = np.sqrt(max(rate * (1 - rate), 1e-3) / 4000)
        assert abs(rate - estimate) < 8 * error + 0.1 * rate


def test_the_accepted_path_kept_its_promise_in_simulation(task, front):
    wind = smooth_wind(SCENE, speed=2.0, sd=0.25, gust=0.3)
    ranked = rank_front(task, front, 500, SeedSequence(3))
    path, verdict = accept_path(SelectionConfig(), task, wind, ranked, SeedSequence(5))
    assert any(path is other for other in ranked.paths)
    assert verdict.passed
    assert verdict.low <= verdict.bound
    assert 0.0 < verdict.linearity < LINEAR


def test_a_path_whose_bound_is_broken_is_passed_over(task, front, caplog):
    """The first choice is given a bound of nothing, as a broken formula would; the next one is flown."""
    wind = smooth_wind(SCENE, speed=2.0, sd=0.25, gust=0.3)
    first, second = front.paths[0], front.paths[-1]
    off = np.zeros_like(first.u)
    liar = replace(
        first, u=off, objectives=replace(first.objectives, mission_risk=0.0, collision_risk=0.0, length=0.0)
    )
    pair = Front((liar, second), (), 0.0, front.reference)
    path, verdict = accept_path(SelectionConfig(runs=300), task, wind, pair, SeedSequence(5))
    assert path is second
    assert verdict.passed
    assert "of the flights simulated in coherent winds fail" in caplog.text
    assert "more than its bound V + R in coherent winds, 0 %" in caplog.text


def test_an_unreliable_linearisation_is_said(task, front, caplog):
    wind = smooth_wind(SCENE, length=1.0 * KM)
    accept_path(SelectionConfig(runs=50), task, wind, front, SeedSequence(5))
    assert "length scale" in caplog.text
