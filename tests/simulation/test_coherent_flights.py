"""Flights through coherent winds: the foreseen Gaussian and both bounds against nonlinear simulation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import SeedSequence

from coherent import STEPS, coherent_problem, rate_interval
from pareto_ltl.planning.evaluate import evaluate_path, forecast, propagate
from pareto_ltl.settings import RobotConfig
from pareto_ltl.simulation.flights import draw_coherent, simulate_flights
from problems import KM, box, make_scene


@pytest.mark.statistical
@pytest.mark.parametrize("gain", [0.0, 0.2])
def test_the_end_point_of_nonlinear_flights_is_foreseen(gain):
    robot = RobotConfig(dt=100.0, u_max=60.0, start_sd=50.0, feedback=gain)
    p = coherent_problem(robot=robot, hours=0.5, sd=1.0)
    path = evaluate_path(p, STEPS, "by hand")
    flights = simulate_flights(p, path.u, 40_000, "coherent", SeedSequence(1), path.x)
    for t in (10, 20, len(STEPS) - 1):
        sd = flights.x[:, t].std(axis=0)
        np.testing.assert_allclose(sd, np.sqrt(np.diag(path.cov[t])), rtol=0.05)
        off = np.abs(flights.x[:, t].mean(axis=0) - path.x[t])
        assert np.all(off < 5.0 * sd / np.sqrt(40_000) + 0.02 * sd)


@pytest.mark.statistical
def test_the_mean_shift_is_what_flights_show():
    """Controls that ignore it end where the second-order terms say, not at the expected path."""
    robot = RobotConfig(dt=100.0, u_max=60.0)
    p = coherent_problem(speed=8.0, sd=2.0, length=8 * KM, hours=2.0, rho=1.0, robot=robot)
    plain = propagate(p, STEPS, p.laws["independent"])
    seen = forecast(p, plain.u, "coherent")
    ends = simulate_flights(p, plain.u, 60_000, "coherent", SeedSequence(2)).x[:, -1]
    error = 5.0 * ends.std(axis=0) / np.sqrt(len(ends))
    shift = seen.x[-1] - plain.x[-1]
    assert np.any(np.abs(shift) > 2 * error)  # otherwise this tests nothing
    off = np.abs(ends.mean(axis=0) - seen.x[-1])
    assert np.all(off < error + 0.35 * np.abs(shift).max())
    assert np.linalg.norm(ends.mean(axis=0) - seen.x[-1]) < np.linalg.norm(ends.mean(axis=0) - plain.x[-1])


def test_fields_of_neighbouring_slots_are_correlated_by_rho():
    p = coherent_problem(rho=0.7, hours=0.25)
    theta = draw_coherent(p, 4000, 10, np.random.default_rng(0)).theta.astype(float)
    used = np.unique(p.modes.slot)
    assert len(used) > 2
    np.testing.assert_allclose(theta.var(axis=0), 1.0, atol=0.15)
    for k in used[:-1]:
        assert np.mean(theta[:, k] * theta[:, k + 1]) == pytest.approx(0.7, abs=0.02)


def test_a_longer_plan_meets_the_same_field():
    p = coherent_problem()
    short = draw_coherent(p, 10, 5, np.random.default_rng(0))
    long = draw_coherent(p, 10, 9, np.random.default_rng(0))
    np.testing.assert_array_equal(short.theta, long.theta)
    np.testing.assert_array_equal(short.white, long.white[:5])


@pytest.mark.statistical
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_bounds_hold_in_coherent_winds(seed):
    scene = make_scene({"a": box(14, 14, 18, 18)}, [box(9.5, 3, 12, 9)], start=(2.0, 2.0))
    p = coherent_problem(scene, sd=0.6, gust=0.5, seed=seed, robot=RobotConfig(dt=100.0, u_max=30.0))
    path = evaluate_path(p, STEPS, "by hand")
    flights = simulate_flights(p, path.u, 20_000, "coherent", SeedSequence(seed), path.x)
    o = path.objectives
    lost, hit = int((~flights.accepted).sum()), int(flights.collided.sum())
    assert lost + hit > 50
    assert rate_interval(lost, 20_000)[0] <= o.mission_risk
    assert rate_interval(hit, 20_000)[0] <= o.collision_risk
    assert (
        rate_interval(int((~flights.accepted | flights.collided).sum()), 20_000)[0]
        <= o.mission_risk + o.collision_risk
    )


def test_calm_air_and_a_single_time_are_no_special_cases():
    scene = make_scene({"a": box(14, 14, 18, 18)}, start=(2.0, 2.0))
    p = coherent_problem(scene, speed=0.0, sd=0.0, gust=0.0, slots=1, robot=RobotConfig(dt=100.0, u_max=60.0))
    path = evaluate_path(p, STEPS, "")
    assert path.objectives.mission_risk == path.objectives.collision_risk == 0.0
    flights = simulate_flights(p, path.u, 10, "coherent", SeedSequence(0), path.x)
    np.testing.assert_allclose(flights.x[:, -1], np.tile(STEPS[-1], (10, 1)), atol=1e-3)
