"""Flights of robots that take position fixes: spread, collisions, ranking."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.random import SeedSequence

from landmarks import LANDMARK_SCENE, LANDMARK_WAY, landmark_problem
from levels import AT_NIGHT
from oracle.navigator import filtered
from pareto_ltl.extend import simulate_flights
from pareto_ltl.kernels import navigator
from pareto_ltl.kernels.pilots import Autopilot, Navigator
from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.simulation import flights as deployment
from pareto_ltl.simulation import importance
from pareto_ltl.simulation.judging import fly_race
from pareto_ltl.world.scene import FixShape
from problems import KM, QUICK_ERROR, box


def pilot_of(problem, u, mean, law="coherent", runs=2):
    """What flies the controls."""
    noise = np.random.default_rng(0).standard_normal((len(u) + 1, runs, 2))
    return deployment.pilot_maker(problem, u, mean, law)(noise, np.zeros((runs, 0)))


def flown(problem, path, runs, seed=3, steps=None):
    """Positions (n, T+1, 2) and pilot of ``runs`` flights, and their fixes' noise."""
    u, mean = path.u[:steps], path.x[: None if steps is None else steps + 1]
    rng = np.random.default_rng(seed)
    draws = deployment.draw_coherent(problem, runs, len(u), rng)
    pilot = pilot_of(problem, u, mean, runs=runs)
    x = np.empty((runs, len(u) + 1, 2))
    x[:, 0] = problem.scene.start + np.sqrt(problem.start_variance) * rng.standard_normal((runs, 2))
    deployment.fly_draws(problem, draws, pilot, x)
    carry_all(pilot, len(u) - 1)
    return x, pilot


def carry_all(pilot, t):
    """Bring the covariances of all flights to step ``t``, the last: a flight needs them at its fixes only."""
    for row in set(pilot.history.tolist()):
        if pilot.beliefs.step[row] < t:
            navigator.move_to(pilot, t, row)


@pytest.mark.statistical
@pytest.mark.parametrize("error", [None, QUICK_ERROR])
def test_flights_with_certain_fixes_spread_as_foreseen(error):
    """The robots of the simulation run filters; the Gaussian of the plan is somewhat wider, not narrower.

    It takes the drift after a fix as independent, and a robot measures up to the edge of the landmark.
    """
    p = landmark_problem(error=error)
    path = evaluate_path(p, LANDMARK_WAY, "")
    flights = simulate_flights(p, path.u, 20_000, "coherent", SeedSequence(1), path.x)
    last = path.fixes[-1]
    for t in (last + 1, last + 4, len(LANDMARK_WAY) - 1):
        wide = np.sqrt(np.trace(path.cov[t]))
        assert 0.7 * wide < np.sqrt(np.trace(np.cov(flights.x[:, t].T))) < 1.05 * wide


SMALL_MARKS = (box(5.0, 4.5, 6.2, 6.0), box(8.4, 8.0, 9.6, 9.8), box(11.0, 11.4, 12.5, 12.3))


FILTERED = 40 if AT_NIGHT else 10  # flights; a plain filter takes a second and more for one
LINES = (FixShape(400.0, 30.0, 60.0), None, FixShape(20.0, 900.0, -20.0))  # errors of their fixes


@pytest.mark.parametrize(("error", "fixes"), [(None, ()), (QUICK_ERROR, ()), (None, LINES)])
def test_robots_know_what_a_plain_filter_knows(error, fixes):
    """Fixes of one flight at any step, or between two, against one matrix for (e_t, e_{t-1}, θ) in NumPy."""
    p = landmark_problem(replace(LANDMARK_SCENE, landmarks=SMALL_MARKS, landmark_fixes=fixes), error=error)
    path = evaluate_path(p, LANDMARK_WAY, "")
    x, pilot = flown(p, path, FILTERED)
    b, dt = p.motion.b, p.motion.dt
    numbers = []
    for i in range(FILTERED):
        winds_free = filtered(
            pilot.law, pilot.landmarks, pilot.root, pilot.noise[:, i], x[i], partial(wanted, p, pilot), b, dt
        )
        numbers.append(len(winds_free.fixes))
        known = winds_free.estimates[-1]
        if not winds_free.fixes:
            assert not pilot.fixed[i]
            continue
        np.testing.assert_allclose(pilot.estimate[i, 2:], known[:2], rtol=2e-3, atol=0.5)
        np.testing.assert_allclose(pilot.field[i].ravel(), known[4:], rtol=5e-3, atol=2e-3)
        row = pilot.history[i]
        np.testing.assert_allclose(pilot.beliefs.cov[row], winds_free.joint[:2, :2], rtol=2e-3, atol=1.0)
        known = pilot.beliefs.known[row][: pilot.beliefs.rank[row]]
        unknown = np.eye(known.shape[1]) - known.T @ known
        np.testing.assert_allclose(unknown, winds_free.joint[4:, 4:], atol=2e-3)
    assert len(set(numbers)) > 3  # many histories


def wanted(problem, pilot, t, estimate):
    """The control of step ``t`` for an estimate of (e_t, e_{t-1}, θ), by (M27)."""
    law, motion = pilot.law, problem.motion
    modes = law.psi.shape[2]
    wind = [law.psi[t, c] @ estimate[4 + c * modes : 4 + (c + 1) * modes] for c in (0, 1)]
    u = law.u[t] - motion.b_inv @ (pilot.landmarks.gain / motion.dt * estimate[:2] + np.array(wind))
    return u * min(1.0, motion.u_max / np.linalg.norm(u))


@pytest.mark.statistical
def test_errors_of_estimates_are_as_large_as_filters_say():
    """(x - m - ê)' Cov(ẽ)⁻¹ (x - m - ê) is chi-squared with two degrees of freedom."""
    p = landmark_problem(replace(LANDMARK_SCENE, landmarks=SMALL_MARKS))
    path = evaluate_path(p, LANDMARK_WAY, "")
    x, pilot = flown(p, path, 4000)
    off = x[:, -2] - path.x[-2] - pilot.estimate[:, 2:]
    spread = pilot.beliefs.cov[pilot.history]
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off)
    assert pilot.fixed.mean() > 0.5
    own = squares[pilot.fixed]
    assert own.mean() == pytest.approx(2.0, abs=0.2 + 5.0 * 2.0 / np.sqrt(len(own)))


@pytest.mark.statistical
def test_shared_histories_cost_few_rows_and_change_flights_little():
    """A search compares paths in them: flights spread as with a filter for each history."""
    p = landmark_problem(replace(LANDMARK_SCENE, landmarks=SMALL_MARKS))
    path, runs = evaluate_path(p, LANDMARK_WAY, ""), 4000
    rng = np.random.default_rng(5)
    draws = deployment.draw_coherent(p, runs, len(path.u), rng)
    noise, begin = rng.standard_normal((len(path.x), runs, 2)), rng.standard_normal((runs, 2))
    x, rows = np.empty((2, runs, len(path.x), 2)), []
    for linear in (False, True):
        pilot = deployment.pilot_maker(p, path.u, path.x, "coherent", linear=linear)(
            noise, np.zeros((runs, 0))
        )
        x[int(linear), :, 0] = p.scene.start + np.sqrt(p.start_variance) * begin
        deployment.fly_draws(p, draws, pilot, x[int(linear)])
        rows.append(int((pilot.beliefs.last > 0).sum()))
        assert pilot.shared == linear
    assert rows[1] < 0.2 * rows[0]
    apart = np.sqrt(((x[0] - x[1]) ** 2).sum(axis=2).mean(axis=0))
    wide = np.sqrt(((x[0] - path.x) ** 2).sum(axis=2).mean(axis=0))
    assert (apart < 0.2 * wide + 1.0).all()
    np.testing.assert_allclose(np.sqrt(((x[1] - path.x) ** 2).sum(axis=2).mean(axis=0)), wide, rtol=0.05)


def test_a_flight_that_misses_a_landmark_flies_on_as_without():
    marks = (box(8.4, 8.0, 9.6, 9.8),)
    with_mark = landmark_problem(replace(LANDMARK_SCENE, landmarks=marks))
    without = landmark_problem(replace(LANDMARK_SCENE, landmarks=()))
    path = evaluate_path(without, LANDMARK_WAY, "")
    seed = SeedSequence(4)
    one, other = (simulate_flights(p, path.u, 2000, "coherent", seed, path.x).x for p in (with_mark, without))
    same = (one == other).all(axis=(1, 2))
    segments = np.stack([other[:, :-1], other[:, 1:]], axis=2)
    import shapely

    crossed = shapely.intersects(shapely.linestrings(segments), shapely.Polygon(marks[0])).any(axis=1)
    np.testing.assert_array_equal(same, ~crossed)
    assert 0.1 < crossed.mean() < 0.95


@pytest.mark.statistical
def test_time_steps_of_three_lengths_give_the_same_failures():
    rates = []
    for dt, every in ((50.0, 1), (100.0, 2), (300.0, 6)):
        p = landmark_problem(replace(LANDMARK_SCENE, landmarks=SMALL_MARKS), dt=dt, u_max=30.0)
        way = np.linspace([2.0, 2.0], [15.0, 15.0], 61)[::every] * KM
        path = evaluate_path(p, way, "")
        rates.append(simulate_flights(p, path.u, 20_000, "coherent", SeedSequence(9), path.x).failed.mean())
    assert rates[0] > 0.005
    assert max(rates) < 1.2 * min(rates) + 5.0 * np.sqrt(2.0 * max(rates) / 20_000)


@pytest.mark.statistical
def test_a_robot_that_always_knows_its_position_rarely_fails():
    for dt, every in ((50.0, 1), (300.0, 6)):
        p = landmark_problem(dt=dt, u_max=30.0, feedback_time=60.0)
        way = np.linspace([2.0, 2.0], [15.0, 15.0], 61)[::every] * KM
        path = evaluate_path(p, way, "")
        assert not simulate_flights(p, path.u, 5000, "coherent", SeedSequence(9), path.x).failed.any()


def test_a_robot_with_fixes_collides_between_steps_too():
    """Both ends of a step lie outside a thin wall; the robot that flies it has taken fixes before."""
    wall = box(12.42, 0, 12.78, 20)
    scene = replace(LANDMARK_SCENE, obstacles=(wall,), start=np.array([2.0, 10.0]) * KM)
    scene = replace(scene, landmarks=(box(4, 2, 11.5, 18),), regions={"a": box(14, 2, 19, 18)})
    p = landmark_problem(scene, start_sd=50.0)
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
    p = landmark_problem(replace(LANDMARK_SCENE, landmarks=(box(17, 17, 18, 18),)), start_sd=20.0)
    way = LANDMARK_WAY[:8]
    assert isinstance(pilot_of(p, propagate(p, way).u, way), Autopilot)


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


@pytest.mark.statistical
def test_a_line_of_position_makes_only_the_direction_across_it_certain():
    """Right after the landmark, in flights and in the Gaussian of the plan."""
    line = replace(LANDMARK_SCENE, landmark_fixes=(FixShape(1e5, 30.0, 45.0),))
    both, alone = (landmark_problem(scene) for scene in (line, replace(LANDMARK_SCENE, landmarks=())))
    paths = [evaluate_path(p, LANDMARK_WAY, "") for p in (both, alone)]
    t = paths[0].fixes[-1] + 2
    along, across = np.array([1.0, 1.0]) / np.sqrt(2.0), np.array([1.0, -1.0]) / np.sqrt(2.0)
    for way, low, high in ((along, 0.7, 1.1), (across, 0.0, 0.6)):
        sds = [np.sqrt(way @ path.cov[t] @ way) for path in paths]
        assert low < sds[0] / sds[1] < high
        seen = [
            simulate_flights(p, path.u, 4000, "coherent", SeedSequence(1), path.x).x[:, t] @ way
            for p, path in zip((both, alone), paths, strict=True)
        ]
        assert low < np.std(seen[0]) / np.std(seen[1]) < high


def test_a_plan_with_fixes_has_no_weighted_rate():
    problem = landmark_problem()
    path = evaluate_path(problem, LANDMARK_WAY, "by hand")
    assert path.fixes
    assert importance.weighted_rate(problem, path, 300, SeedSequence(1)) is None
