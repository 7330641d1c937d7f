"""One step of the Gaussian under each wind law: kernels against scipy, matrices and formulas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from coherent import STEPS, coherent_problem
from oracle import path_risk as risk
from pareto_ltl.kernels import motion as steps
from pareto_ltl.kernels import propagation as kernel
from pareto_ltl.kernels.interpolation import gust_variance, wind_at
from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.planning.wind_lookup import interpolate, interpolate_time
from pareto_ltl.settings import RobotConfig
from plane_kernels.types import Cov, Gaussian, Point
from problems import KM, QUICK_ERROR, box, make_problem, make_scene, random_covariances, rough_wind

SCENE = make_scene({"a": box(10, 10, 12, 12)})
WIND = rough_wind(SCENE, hours=1.0)
A, B = [[1.01, 0.02], [-0.03, 0.98]], [[0.9, 0.2], [-0.1, 1.1]]
ROBOT = RobotConfig(dt=100.0, u_max=10.0, a=A, b=B)

some = settings(deadline=None, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def problem():
    return make_problem("F a", SCENE, WIND, ROBOT)


def latent_at(step, points):
    """Latent variance at a step and points (P, 2), by scipy."""
    x, y = (WIND.origin[i] + WIND.spacing * np.arange(n) for i, n in enumerate(WIND.mean.shape[1:3]))
    inside = np.clip(points, [x[0], y[0]], [x[-1], y[-1]])
    table = RegularGridInterpolator((WIND.times, x, y), WIND.latent_var)
    return table(np.column_stack([np.full(len(inside), step * 100.0), inside]))


# --- the independent law ----------------------------------------------------------------------


@some
@given(seeds, st.floats(0, 5 * KM))
def test_the_worst_variance_has_the_largest_trace_of_centre_and_rim(problem, seed, radius):
    rng = np.random.default_rng(seed)
    step, x = int(rng.integers(0, problem.horizon)), rng.uniform(0, 20 * KM, 2)
    angles = np.pi / 4 * np.arange(8)
    rim = x + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    latent = latent_at(step, np.vstack([x, rim]))
    gust = np.array(gust_variance(problem.wind, step))
    found = steps.worst_variance(problem.wind, step, Point(*x), radius)
    best = latent.sum(axis=1).max() + gust.sum()
    assert sum(found) == pytest.approx(best, rel=1e-9)
    assert np.min(np.abs(latent + gust - found).sum(axis=1)) < 1e-9  # a pair that occurs, not a mixture


def test_a_certain_position_meets_the_variance_where_it_is(problem):
    wind, at = problem.wind, Point(5e3, 6e3)
    here = np.add(wind_at(wind.latent, wind, 7, at), gust_variance(wind, 7))
    np.testing.assert_allclose(steps.worst_variance(wind, 7, at, 0.0), here)


@some
@given(seeds)
def test_mean_and_covariance_move_by_the_matrices(problem, seed):
    rng = np.random.default_rng(seed)
    motion, wind = problem.motion, problem.wind
    step, x = int(rng.integers(0, problem.horizon)), rng.uniform(0, 20 * KM, 2)
    (cov,) = random_covariances(rng, 1, 800.0)
    here = Gaussian(Point(*x), Cov(cov[0, 0], cov[0, 1], cov[1, 1]))
    mean = interpolate(wind, wind.mean, step, x)
    np.testing.assert_allclose(steps.drift(wind, motion, step, here.mean), np.array(A) @ x + 100 * mean)
    radius = motion.ball * np.sqrt(np.trace(cov) / 2)
    variance = steps.worst_variance(wind, step, here.mean, radius)
    after = np.array(A) @ cov @ np.array(A).T + 100.0**2 * np.diag(variance)
    xx, xy, yy = steps.spread(wind, motion, step, here)
    np.testing.assert_allclose([[xx, xy], [xy, yy]], after, rtol=1e-9)
    ahead = kernel.advance(problem.world.law, None, step, here, 0, 0)
    assert ahead.mean == steps.drift(wind, motion, step, here.mean)
    assert ahead.cov == (xx, xy, yy)
    assert ahead.speed == motion.u_max  # there is no feedback


@some
@given(seeds)
def test_airspeed_is_the_length_of_the_control_that_makes_the_move(problem, seed):
    u = np.random.default_rng(seed).uniform(-10, 10, 2)
    moved = 100.0 * np.array(B) @ u
    assert steps.airspeed(problem.motion, *moved) == pytest.approx(np.linalg.norm(u), rel=1e-9)


# --- the coherent law -------------------------------------------------------------------------


@pytest.mark.parametrize("error", [None, QUICK_ERROR])
@pytest.mark.parametrize("time", [None, 300.0])
@pytest.mark.parametrize("rho", [0.0, 0.6, 1.0])
def test_covariances_and_controls_are_those_of_the_formula(rho, time, error):
    robot = RobotConfig(dt=100.0, u_max=60.0, start_sd=50.0, feedback_time=time)
    p = coherent_problem(rho=rho, robot=robot, hours=0.25, error=error)
    path = evaluate_path(p, STEPS, "by hand")
    cov, u = risk.propagate_coherent(p, STEPS)
    np.testing.assert_allclose(path.cov, cov, rtol=2e-4, atol=1.0)
    np.testing.assert_allclose(path.u, u, atol=2e-4)


def test_one_frozen_field_spreads_flights_in_proportion_to_time_and_new_ones_to_its_root():
    """Calm expected wind, an error that is the same everywhere: sd = s t, or s √(t slot)."""
    ends = {}
    for rho in (0.0, 1.0):
        p = coherent_problem(speed=0.0, gust=0.0, length=1e7, rho=rho, hours=1 / 36, slots=40, until=None)
        path = evaluate_path(p, STEPS, "")
        ends[rho] = np.sqrt((path.cov[-1][0, 0] - 50.0**2) / (len(STEPS) - 1))
    assert ends[1.0] == pytest.approx(100.0 * np.sqrt(len(STEPS) - 1), rel=1e-2)
    assert ends[0.0] == pytest.approx(100.0, rel=1e-2)


def test_both_laws_have_the_same_wind_at_one_place_and_time():
    """ψ' ψ and the white remainder add up to the predictive variance of the independent law."""
    p = coherent_problem(gust=0.7)
    law = p.world.law._replace(modes=p.modes._replace(white=1.0, rest=1.0))
    flight, wind = propagate(p, STEPS, law), p.wind
    for t in range(len(flight.psi)):
        marginal = (flight.psi[t] ** 2).sum(axis=1) + flight.white[t]
        latent = interpolate(wind, wind.latent, t, STEPS[t]) + interpolate_time(wind, wind.gust, t)
        np.testing.assert_allclose(marginal, latent, rtol=1e-4)
