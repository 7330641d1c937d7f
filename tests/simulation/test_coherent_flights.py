"""Flights through coherent winds: the foreseen Gaussian and both bounds against nonlinear simulation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import SeedSequence

from coherent import STEPS, coherent_problem, rate_interval
from pareto_ltl.extend import Forecast, simulate_flights
from pareto_ltl.kernels.flight import link_fields
from pareto_ltl.kernels.pilots import Autopilot
from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.planning.wind_lookup import interpolate, interpolate_time
from pareto_ltl.settings import RobotConfig
from pareto_ltl.simulation.flights import draw_coherent, draw_innovations, fly_draws, kept_by_epoch
from problems import KM, QUICK_ERROR, box, make_scene
from wind_laws.records import FORECAST, SPACE, TIME


@pytest.mark.statistical
@pytest.mark.parametrize("time", [None, 450.0, 50.0])
def test_the_end_point_of_nonlinear_flights_is_foreseen(time):
    robot = RobotConfig(dt=100.0, u_max=60.0, start_sd=50.0, feedback_time=time)
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
    seen = Forecast.of(p, plain.u, "coherent")
    ends = simulate_flights(p, plain.u, 60_000, "coherent", SeedSequence(2)).x[:, -1]
    error = 5.0 * ends.std(axis=0) / np.sqrt(len(ends))
    shift = seen.x[-1] - plain.x[-1]
    assert np.any(np.abs(shift) > 2 * error)  # otherwise this tests nothing
    off = np.abs(ends.mean(axis=0) - seen.x[-1])
    assert np.all(off < error + 0.35 * np.abs(shift).max())
    assert np.linalg.norm(ends.mean(axis=0) - seen.x[-1]) < np.linalg.norm(ends.mean(axis=0) - plain.x[-1])


def test_fields_of_neighbouring_slots_are_correlated_by_rho():
    p = coherent_problem(rho=0.7, hours=0.25)
    theta = draw_coherent(p, 4000, 40, np.random.default_rng(0)).theta.astype(float)
    assert len(theta) == len(np.unique(p.modes.slot)) > 2
    np.testing.assert_allclose(theta.var(axis=1), 1.0, atol=0.15)
    for k in range(len(theta) - 1):
        assert np.mean(theta[k] * theta[k + 1]) == pytest.approx(0.7, abs=0.02)


@pytest.mark.statistical
def test_each_part_of_the_error_lasts_as_long_as_it_should():
    """Slots change midway between fields, errors of interpolation in time at the fields themselves."""
    p = coherent_problem(rho=0.7, hours=0.25, error=QUICK_ERROR)
    n = 40_000
    theta = draw_coherent(p, n, 40, np.random.default_rng(0)).theta.astype(float)
    meets = [theta[epoch] for epoch in p.modes.epoch[:40]]
    noise = 5.0 / np.sqrt(n * 48)

    def correlation(part, s, t):
        own = p.modes.part == part
        return np.mean(meets[s][..., own] * meets[t][..., own])

    # Fields at 0, 900, 1800 s; the nearest one changes at 500 s, 1400 s; steps of 100 s.
    assert correlation(SPACE, 0, 4) == pytest.approx(1.0, abs=0.02)
    assert correlation(SPACE, 4, 5) == pytest.approx(0.7, abs=noise)
    assert correlation(SPACE, 0, 14) == pytest.approx(0.7**2, abs=noise)
    assert correlation(FORECAST, 4, 5) == pytest.approx(0.8 ** (900 / 1200), abs=noise)
    assert correlation(TIME, 1, 8) == pytest.approx(1.0, abs=0.02)
    assert correlation(TIME, 8, 9) == pytest.approx(0.0, abs=noise)


@pytest.mark.statistical
@pytest.mark.parametrize("until", [np.inf, 1800.0 + 1e-3])
def test_the_covariance_of_flights_is_the_planned_one_with_all_parts_of_the_error(until):
    """Also past the last field, which is held: there the wind has changed by the square root of D."""
    wind = {"hours": 0.25, "slots": 3, "rho": 0.6, "speed": 1.0, "error": QUICK_ERROR, "until": until}
    p = coherent_problem(robot=RobotConfig(dt=100.0, u_max=60.0), **wind)
    steps = STEPS[: len(p.wind.slot) + 1] if until < np.inf else STEPS
    flight = propagate(p, steps)
    n = 60_000
    ends = simulate_flights(p, flight.u, n, "coherent", SeedSequence(3)).x[:, -1]
    planned = flight.cov[-1][[0, 1, 1, 2]].reshape(2, 2)
    np.testing.assert_allclose(np.cov(ends.T) / planned.max(), planned / planned.max(), atol=0.05)
    steady = coherent_problem(robot=RobotConfig(dt=100.0, u_max=60.0), **wind | {"error": None})
    assert planned[0, 0] > 1.02 * propagate(steady, steps).cov[-1][0]


def test_interpolation_in_time_adds_nothing_at_the_time_of_a_field():
    p = coherent_problem(hours=0.25, slots=3, error=QUICK_ERROR)
    at_fields = [0, 9, 18]
    assert (p.wind.between[at_fields] == 0.0).all()
    assert (np.delete(p.wind.between[:19], at_fields) > 0.0).all()
    assert p.wind.between[4] == pytest.approx(p.wind.between[5])  # 400 s after one, 400 s before the next
    assert p.wind.between[19] == pytest.approx(QUICK_ERROR.change_variance(np.array(100.0)))
    assert (p.modes.scale[4, p.modes.part == TIME] == np.sqrt(np.float32(p.wind.between[4]))).all()


def test_flights_are_those_of_a_plain_simulation_with_the_same_draws():
    """One flight after the other, in NumPy, with all parts of the error."""
    robot = RobotConfig(dt=100.0, u_max=60.0, a=[[1.0, 0.01], [-0.02, 0.99]], b=[[1, 0.3], [0, 1]])
    p = coherent_problem(robot=robot, hours=0.25, slots=3, rho=0.6, error=QUICK_ERROR)
    n, u = 7, np.random.default_rng(1).uniform(0, 6, (18, 2))
    draws = draw_coherent(p, n, len(u), np.random.default_rng(2))
    x = np.empty((n, len(u) + 1, 2))
    x[:, 0] = p.scene.start + np.random.default_rng(3).normal(0, 300, (n, 2))
    fly_draws(p, draws, Autopilot(u, np.zeros((len(u) + 1, 2))), x)
    for i in range(n):
        at = x[i, 0]
        for t, control in enumerate(u):
            psi = mode_values(p.modes, t, at)
            mean, latent = (interpolate(p.wind, table, t, at) for table in (p.wind.mean, p.wind.latent))
            rest = np.maximum(latent + p.wind.between[t] - (psi**2).sum(axis=1), 0.0)
            white = p.modes.white * interpolate_time(p.wind, p.wind.gust, t) + p.modes.rest * rest
            wind = mean + (psi * draws.theta[p.modes.epoch[t], i]).sum(axis=1)
            wind = wind + np.sqrt(white) * draws.white[t, i]
            at = p.motion.a @ at + p.motion.dt * (p.motion.b @ control + wind)
            np.testing.assert_allclose(x[i, t + 1], at, atol=0.02)


def mode_values(modes, t, at):
    """ψ (2, P) at step ``t`` and a place: bilinear between the nodes."""
    place = (at - [modes.west, modes.south]) * modes.per_metre
    i, j = place.astype(int)
    fx, fy = place - [i, j]
    corners = modes.psi[modes.slot[t], i : i + 2, j : j + 2].astype(float)
    return modes.scale[t] * np.einsum("i,j,ijcm->cm", [1 - fx, fx], [1 - fy, fy], corners)


def test_innovations_are_drawn_for_what_changes_alone():
    p = coherent_problem(hours=0.25, rho=0.6, error=QUICK_ERROR)
    kept = kept_by_epoch(p.modes, 30)
    field = draw_innovations(kept, 500, np.random.default_rng(0))
    assert (kept == 1.0).any()
    assert (field[:, :, 0][np.broadcast_to((kept == 1.0)[:, None], field[:, :, 0].shape)] == 0.0).all()
    changes = np.moveaxis(field, 1, -1)[np.broadcast_to((kept < 1.0)[:, None], field[:, 0].shape)]
    assert (changes != 0.0).all()
    assert len(np.unique(changes)) > 0.99 * changes.size  # none is used twice
    theta = field.copy()
    link_fields(kept, theta)
    np.testing.assert_array_equal(theta[0], field[0])
    for k in range(1, len(kept)):
        expected = kept[k] * theta[k - 1] + np.sqrt(1.0 - kept[k] ** 2) * field[k]
        np.testing.assert_allclose(theta[k], expected, atol=1e-6)


def test_a_longer_plan_meets_the_same_field():
    p = coherent_problem()
    short = draw_coherent(p, 10, 5, np.random.default_rng(0))
    long = draw_coherent(p, 10, 9, np.random.default_rng(0))
    np.testing.assert_array_equal(short.theta, long.theta[: len(short.theta)])
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
