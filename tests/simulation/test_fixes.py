"""Flights of robots that take position fixes: spread, collisions, ranking."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from landmarks import LANDMARK_SCENE, LANDMARK_WAY, landmark_problem
from pareto_ltl.kernels.flight import Autopilot, Navigator
from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.simulation import flights as deployment
from pareto_ltl.simulation.flights import simulate_flights
from pareto_ltl.simulation.judging import fly_race
from problems import KM, QUICK_ERROR, box


def pilot_of(problem, u, mean, law="coherent"):
    """What flies the controls."""
    return deployment.pilot_maker(problem, u, mean, law)(2, np.random.default_rng(0))


@pytest.mark.statistical
@pytest.mark.parametrize(("feedback", "error"), [(0.0, None), (0.3, None), (0.0, QUICK_ERROR)])
def test_flights_with_fixes_spread_as_foreseen(feedback, error):
    """The robot of the simulation runs the estimator itself. The few flights that miss the landmark count as
    failed, and what is foreseen is how the others go on."""
    p = landmark_problem(feedback=feedback, error=error)
    path = evaluate_path(p, LANDMARK_WAY, "")
    flights = simulate_flights(p, path.u, 20_000, "coherent", SeedSequence(1), path.x)
    at_fix = flights.x[:, path.fixes[0]]
    found_it = np.all((at_fix >= 4.0 * KM) & (at_fix <= 12.5 * KM), axis=1)
    assert 0.97 < found_it.mean() <= 1.0
    assert found_it.mean() < 1.0 or feedback > 0.0
    for t in (path.fixes[0], path.fixes[0] + 1, path.fixes[0] + 4, len(LANDMARK_WAY) - 1):
        found = np.cov(flights.x[found_it, t].T)
        expected = path.cov[t]
        wide = np.sqrt(np.trace(expected))
        assert np.sqrt(np.trace(found)) == pytest.approx(wide, rel=0.1)
    failures = int((~flights.accepted).sum())
    assert failures / 20_000 - 5 * np.sqrt(failures + 1) / 20_000 <= path.objectives.mission_risk


def test_feedback_makes_a_difference_to_robots_with_fixes():
    """The spread that is foreseen with feedback is not the one without: the test above tells them apart."""
    ends = [evaluate_path(landmark_problem(feedback=k), LANDMARK_WAY, "").cov[-1] for k in (0.0, 0.3)]
    without, held = (np.sqrt(np.trace(cov)) for cov in ends)
    assert held < 0.8 * without


def test_a_robot_with_fixes_collides_between_steps_too():
    """Both ends of a step lie outside a thin wall; the robot that flies it has taken fixes before."""
    wall = box(12.42, 0, 12.78, 20)
    scene = replace(LANDMARK_SCENE, obstacles=(wall,), start=np.array([2.0, 10.0]) * KM)
    scene = replace(scene, landmarks=(box(4, 2, 11.5, 18),), regions={"a": box(14, 2, 19, 18)})
    p = landmark_problem(scene, feedback=0.3, start_sd=50.0)
    x = np.column_stack([np.arange(2.0, 17.0), np.full(15, 10.0)]) * KM + [100.0, 0.0]
    x[0] = scene.start
    u = propagate(p, x).u
    assert isinstance(pilot_of(p, u, x), Navigator)
    flights = simulate_flights(p, u, 500, "coherent", SeedSequence(2), x)
    inside = (flights.x[..., 0] > 12.42 * KM) & (flights.x[..., 0] < 12.78 * KM)
    jumped = ~inside.any(axis=1)
    assert jumped.sum() > 100  # otherwise the positions alone show the collision
    assert flights.collided.all()


def test_without_landmarks_on_the_way_the_controls_are_flown_as_they_are():
    p = landmark_problem(replace(LANDMARK_SCENE, landmarks=(box(15, 2, 19, 6),)))
    u = propagate(p, LANDMARK_WAY).u
    assert isinstance(pilot_of(p, u, LANDMARK_WAY), Autopilot)


def test_equal_paths_with_fixes_fail_in_the_same_flights():
    """Common random numbers: all paths of a front meet the same winds, the same starts, the same noise."""
    p = landmark_problem()
    way = np.vstack([LANDMARK_WAY[:22], [[13.2 * KM, 13.2 * KM]]])  # just within the region
    path = evaluate_path(p, way, "")
    assert path.fixes
    seed = SeedSequence(7)
    race = fly_race(p, (path,) * 4, 600, seed)
    assert len(race) == 4
    failed = race[0].failed
    assert 0 < failed.sum() < 600
    for flown in (*race, *fly_race(p, (path,), 600, seed)):  # the seed is not used up
        np.testing.assert_array_equal(flown.failed, failed)
    alone = simulate_flights(p, path.u, 600, "coherent", seed, path.x)
    np.testing.assert_array_equal(alone.failed, failed)
