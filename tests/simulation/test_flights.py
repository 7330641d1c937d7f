"""Simulated flights: against plain NumPy, and as judges of the bounds."""

from __future__ import annotations

import os

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.stats import binom, binomtest

from oracle import path_risk as risk
from pareto_ltl.kernels import flight as rollout
from pareto_ltl.kernels.pilots import Autopilot
from pareto_ltl.planning import growth, selection
from pareto_ltl.planning.records import Plan
from pareto_ltl.planning.wind_lookup import interpolate, interpolate_time
from pareto_ltl.settings import DeploymentConfig, PlannerConfig, RobotConfig
from pareto_ltl.simulation import flights as deployment
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.errors import InfeasibleError
from problems import KM, RARE, box, make_problem, make_scene, rough_wind, steady_wind, two_goals

TURNED = RobotConfig(
    dt=100.0, u_max=10.0, start_sd=300.0, a=[[1.0, 0.01], [-0.02, 0.99]], b=[[1, 0.3], [0, 1]]
)
SEED = 11


def fly(problem, u, runs=500, seed=SEED):
    return deployment.simulate_flights(problem, u, runs, "independent", SeedSequence(seed))


@pytest.fixture(scope="module")
def planned():
    """A problem and the least risky path of a small forest."""
    problem = two_goals()
    forest = growth.grow_forest(PlannerConfig(trees=3, n_max=600), problem, SeedSequence(0))
    return problem, selection.tree_front(problem, forest)[0]


# --- one flight, by hand ---------------------------------------------------------------------------------


def plain(problem, u, draws, x0):
    """One flight with given standard normal draws (T, 2), in NumPy and shapely."""
    motion, wind, automaton = problem.motion, problem.wind, problem.automaton
    B = np.linalg.inv(motion.b_inv)
    blocks = [shapely.Polygon(o).buffer(-1e-6) for o in problem.decomposition.obstacles]
    cells = [shapely.Polygon(c) for c in problem.decomposition.cells]

    def label(point):
        held = [k for k, c in enumerate(cells) if c.covers(shapely.Point(point))]
        return problem.labels[held[0]] if held else frozenset()

    x, q, hit = [np.array(x0)], automaton.step(automaton.initial, label(x0)), False
    for t, control in enumerate(u):
        mean = interpolate(problem.wind, wind.mean, t, x[-1])
        variance = interpolate(problem.wind, wind.latent, t, x[-1])
        variance = variance + interpolate_time(problem.wind, wind.gust, t)
        w = mean + np.sqrt(variance) * draws[t]
        x.append(motion.a @ x[-1] + motion.dt * (B @ control + w))
        leg = shapely.LineString([x[-2], x[-1]])
        hit = hit or any(leg.intersects(block) for block in blocks)
        q = automaton.step(q, label(x[-1]))
    return np.array(x), bool(automaton.accepting[q]), hit


@pytest.mark.parametrize("robot", [None, TURNED], ids=["identity", "matrices"])
def test_flights_are_those_of_a_plain_simulation_with_the_same_draws(robot, planned):
    problem = two_goals(robot=robot or RobotConfig(dt=100.0, u_max=10.0))
    u = planned[1].u[:12] if robot else planned[1].u
    rng = np.random.default_rng(3)
    runs = 12
    x = np.empty((runs, len(u) + 1, 2))
    x[:, 0] = problem.scene.start + rng.normal(0, 300, (runs, 2))
    draws = rng.standard_normal((len(u), runs, 2))
    law = problem.laws["independent"]
    pilot = Autopilot(u, np.zeros((len(u) + 1, 2)))
    deployment.fly_draws(problem, rollout.IndependentDraws(law, draws), pilot, x)
    outcome = Deployment.judged(problem, "independent", x)
    outcomes = set()
    for i in range(runs):
        way, done, hit = plain(problem, u, draws[:, i], x[i, 0])
        np.testing.assert_allclose(x[i], way, rtol=1e-9, atol=1e-6)
        assert (outcome.accepted[i], outcome.collided[i]) == (done, hit)
        outcomes.add((done, hit))
    assert robot or len(outcomes) > 1


def test_a_flight_outlives_a_visit_to_an_obstacle_and_to_nowhere():
    """Positions inside an obstacle or off the map show no label; the automaton goes on from there."""
    scene = make_scene({"a": box(15, 8, 19, 12)}, [box(8, 8, 11, 12)], start=(1, 10))
    problem = make_problem("F a", scene, steady_wind(scene, gust=(0.0, 0.0)))
    through = np.tile([10.0, 0.0], (16, 1))
    result = fly(problem, through, runs=3)
    assert result.accepted.all()
    assert result.collided.all()
    away = np.vstack([np.tile([-10.0, 0.0], (4, 1)), np.tile([0.0, 10.0], (3, 1))])
    result = fly(problem, away, runs=3)
    assert not result.accepted.any()
    assert not result.collided.any()
    assert result.x[0, -1, 0] == pytest.approx(-3 * KM)


def test_segments_between_steps_collide_too():
    """Both ends of the step lie outside the obstacle, its middle inside."""
    scene = make_scene({"a": box(15, 8, 19, 12)}, [box(8.2, 8, 8.8, 12)], start=(8, 10))
    problem = make_problem("F a", scene, steady_wind(scene, gust=(0.0, 0.0)))
    assert fly(problem, np.array([[10.0, 0.0]]), runs=1).collided.all()
    assert not fly(problem, np.array([[-10.0, 0.0]]), runs=1).collided.any()


def test_without_uncertainty_every_flight_is_the_plan():
    problem = two_goals(wind=rough_wind(two_goals().scene, variance=0.0))
    forest = growth.grow_forest(PlannerConfig(trees=2, n_max=600), problem, SeedSequence(0))
    for path in selection.tree_front(problem, forest):
        result = fly(problem, path.u, runs=3)
        np.testing.assert_allclose(result.x, np.tile(path.x, (3, 1, 1)), atol=1e-5)
        assert result.accepted.all()
        assert not result.collided.any()


def test_a_plan_that_outlasts_the_wind_is_refused():
    problem = two_goals(wind=rough_wind(two_goals().scene, slots=2, hours=0.25))
    assert fly(problem, np.zeros((problem.horizon, 2)), runs=2).x.shape == (2, 11, 2)
    with pytest.raises(InfeasibleError, match=r"a plan of 11 steps outlasts the wind, .* known for 10"):
        fly(problem, np.zeros((11, 2)), runs=2)


# --- chance ------------------------------------------------------------------------------------------------


@pytest.mark.statistical
def test_positions_have_the_planned_mean_and_covariance_in_an_even_wind():
    scene = make_scene({"a": box(15, 15, 19, 19)})
    robot = RobotConfig(dt=100.0, u_max=10.0, start_sd=200.0, a=TURNED.a, b=TURNED.b)
    wind = steady_wind(scene, mean=(2.0, -1.0), latent=(1.0, 2.0), gust=(2.0, 0.5))
    problem = make_problem("F a", scene, wind, robot)
    u = np.random.default_rng(0).uniform(0, 6, (12, 2))
    x = [problem.scene.start]
    for control in u:
        motion = problem.motion
        x.append(motion.a @ x[-1] + 100.0 * (np.array(TURNED.b) @ control + [2.0, -1.0]))
    cov, _ = risk.propagate_independent(problem, np.array(x))
    runs = 20_000
    result = fly(problem, u, runs)
    for t in (0, 1, 6, 12):
        away = np.linalg.solve(np.linalg.cholesky(cov[t]), (result.x[:, t] - x[t]).T)
        assert np.all(np.abs(away.mean(axis=1)) < 6 / np.sqrt(runs))
        np.testing.assert_allclose(np.cov(away), np.eye(2), atol=6 * np.sqrt(2 / runs))


def test_the_same_seed_flies_the_same_winds_whatever_the_threads(planned, monkeypatch):
    problem, path = planned
    first = fly(problem, path.u)
    for count in (1, 3):
        monkeypatch.setattr(os, "cpu_count", lambda count=count: count)
        again = fly(problem, path.u)
        np.testing.assert_array_equal(first.x, again.x)
        np.testing.assert_array_equal(first.accepted, again.accepted)
        np.testing.assert_array_equal(first.collided, again.collided)
    assert not np.array_equal(first.x, fly(problem, path.u, seed=SEED + 1).x)


@pytest.mark.parametrize("law", ["independent", "coherent"])
def test_a_seed_that_has_spawned_before_flies_the_same_winds(planned, law):
    problem, path = planned
    seed = SeedSequence(SEED)
    first = deployment.simulate_flights(problem, path.u, 300, law, seed, path.x)
    seed.spawn(3)
    again = deployment.simulate_flights(problem, path.u, 300, law, seed, path.x)
    np.testing.assert_array_equal(first.x, again.x)
    child = seed.spawn(1)[0]  # and children differ from one another
    other = deployment.simulate_flights(problem, path.u, 300, law, child, path.x)
    assert not np.array_equal(first.x, other.x)


def test_no_two_flights_meet_the_same_wind(planned):
    problem, path = planned
    ends = fly(problem, path.u, runs=600).x[:, -1]
    assert len(np.unique(ends, axis=0)) == 600


def test_plans_of_different_length_meet_the_same_winds(planned):
    """Common random numbers: a longer plan only draws further."""
    problem, path = planned
    short, long = fly(problem, path.u[:10], runs=300), fly(problem, path.u[:20], runs=300)
    np.testing.assert_array_equal(short.x, long.x[:, :11])


def test_different_plans_meet_the_same_winds():
    """In an even wind, what two plans drift by is the same, flight by flight."""
    scene = make_scene({"a": box(15, 15, 19, 19)})
    problem = make_problem(
        "F a", scene, steady_wind(scene), RobotConfig(dt=100.0, u_max=10.0, start_sd=100.0)
    )
    u = np.random.default_rng(0).uniform(0, 5, (2, 8, 2))
    one, other = (fly(problem, plan, runs=300).x for plan in u)
    flown = [100.0 * np.vstack([[0.0, 0.0], np.cumsum(plan, axis=0)]) for plan in u]
    drift = [one - flown[0], other - flown[1]]
    np.testing.assert_allclose(drift[0], drift[1], atol=1e-6)


def visits_in_order(path):
    """Does the path leave a for good before it comes to b?"""
    a, b = ([t for t, label in enumerate(path.label) if name in label] for name in "ab")
    return max(a) < min(b)


@pytest.mark.statistical
@pytest.mark.parametrize("formula", ["F(a & F b)", "F a & F b", "F b"])
def test_missions_of_visits_fail_no_more_often_than_the_papers_bound(formula):
    """Theorem 2 where it applies: visits only, each made when it counts, a mean wind without gradients.

    The ordered bound and the path's collision bound need no such condition.
    """
    scene = two_goals().scene
    problem = two_goals(formula, wind=steady_wind(scene, mean=(2.0, 1.0), latent=(0.4, 0.2), gust=(0.5, 0.4)))
    forest = growth.grow_forest(PlannerConfig(trees=3, n_max=800), problem, SeedSequence(0))
    front = selection.tree_front(problem, forest)
    informative = 0
    for path in front:
        result, costs = fly(problem, path.u, runs=10_000), path.objectives
        promises = [(~result.accepted, costs.mission_risk_ordered), (result.collided, costs.collision_risk)]
        if formula != "F(a & F b)" or visits_in_order(path):
            promises.append((~result.accepted, costs.mission_risk_paper))
        for failed, bound in promises:
            count = int(failed.sum())
            assert count == 0 or bound >= 1 or binom.sf(count - 1, len(failed), bound) > RARE
            informative += count > 0 and bound < 0.5
    assert informative > 0


# --- figures -----------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 3000), st.floats(0, 1), st.sampled_from([0.8, 0.95, 0.999]))
def test_the_interval_is_that_of_clopper_and_pearson(runs, share, confidence):
    failures = round(share * runs)
    expected = binomtest(failures, runs).proportion_ci(confidence, method="exact")
    assert deployment.clopper_pearson(failures, runs, confidence) == pytest.approx(tuple(expected), abs=1e-10)


@pytest.mark.parametrize("walled", [False, True])
def test_rates_count_a_flight_once_however_it_fails(walled):
    accepted = np.array([True, True, False, False, True, True, True, True, True, True])
    collided = np.array([False, True, True, False, False, False, False, False, False, False])
    off_map = np.array([False, False, True, False, False, True, False, False, False, False])
    flights = Deployment("independent", np.zeros((10, 2, 2)), accepted, collided, off_map, walled)
    rates = deployment.flight_rates(flights)
    low, high = deployment.clopper_pearson(3 + walled, 10)
    assert rates == {
        "runs_independent": 10.0,
        "failure_independent": pytest.approx(0.3 + 0.1 * walled),
        "failure_independent_low": low,
        "failure_independent_high": high,
        "mission_failure_independent": pytest.approx(0.2),
        "collision_independent": pytest.approx(0.2),
        "off_map_independent": pytest.approx(0.2),
    }


def test_a_plan_is_deployed_under_every_law_asked_for(planned):
    problem, path = planned
    plan = Plan(path, "F(a & F b)", problem.atoms, 100.0, 10.0, 0.05, "paper", "priority", (1.0, 0.0, 0.0))
    cfg = DeploymentConfig(runs=40)
    found = deployment.deploy_plan(cfg, problem, plan, SeedSequence(5))
    assert list(found) == ["independent", "coherent"]
    result = found["independent"]
    assert result.x.shape == (40, len(path.x), 2)
    assert result.accepted.shape == result.collided.shape == (40,)
    again = deployment.deploy_plan(cfg, problem, plan, SeedSequence(5))["independent"]
    np.testing.assert_array_equal(result.x, again.x)
