"""Wind between lattice nodes and what it does to a Gaussian: kernels against scipy and matrices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from pareto_ltl.kernels import interpolation as lattice
from pareto_ltl.planning import reference as risk
from pareto_ltl.settings import RobotConfig
from problems import KM, box, make_problem, make_scene, random_covariances, rough_wind

SCENE = make_scene({"a": box(10, 10, 12, 12)})
WIND = rough_wind(SCENE, hours=1.0)
A, B = [[1.01, 0.02], [-0.03, 0.98]], [[0.9, 0.2], [-0.1, 1.1]]
ROBOT = RobotConfig(dt=100.0, u_max=10.0, a=A, b=B)

some = settings(deadline=None, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def problem():
    return make_problem("F a", SCENE, WIND, ROBOT)


def interpolator(table):
    nx, ny = table.shape[1:3]
    x, y = (WIND.origin[i] + WIND.spacing * np.arange(n) for i, n in enumerate((nx, ny)))
    return RegularGridInterpolator((WIND.times, x, y), table)


def clamped(points):
    top = WIND.origin + WIND.spacing * (np.array(WIND.mean.shape[1:3]) - 1)
    return np.clip(points, WIND.origin, top)


@pytest.mark.parametrize("name", ["mean", "latent"])
def test_the_wind_is_linear_in_time_and_bilinear_in_space(problem, name):
    rng = np.random.default_rng(1)
    wind = problem.tables.wind
    table = getattr(wind, name)
    steps = rng.integers(0, problem.horizon, 200)
    points = rng.uniform(-4 * KM, 25 * KM, (200, 2))  # past the lattice as well
    found = [lattice.at(table, wind, t, x, y) for t, (x, y) in zip(steps, points, strict=True)]
    where = np.column_stack([steps * 100.0, clamped(points)])
    np.testing.assert_allclose(found, interpolator(table)(where), atol=1e-12)


def test_nodes_are_reproduced_exactly(problem):
    wind = problem.tables.wind
    nx, ny = wind.mean.shape[1:3]
    for slot, step in enumerate((0, 36, 72, 108)):
        for i, j in ((0, 0), (3, 5), (nx - 1, ny - 1), (0, ny - 1)):
            x, y = WIND.origin + WIND.spacing * np.array([i, j])
            np.testing.assert_allclose(lattice.at(wind.mean, wind, step, x, y), wind.mean[slot, i, j])


def test_the_gust_is_linear_in_time(problem):
    found = [lattice.gust(problem.tables.wind, t) for t in range(problem.horizon)]
    times = 100.0 * np.arange(problem.horizon)
    expected = np.column_stack([np.interp(times, WIND.times, WIND.gust_var[:, c]) for c in (0, 1)])
    np.testing.assert_allclose(found, expected, atol=1e-12)


@some
@given(seeds, st.floats(0, 5 * KM))
def test_the_worst_variance_has_the_largest_trace_of_centre_and_rim(problem, seed, radius):
    rng = np.random.default_rng(seed)
    step, x = int(rng.integers(0, problem.horizon)), rng.uniform(0, 20 * KM, 2)
    angles = np.pi / 4 * np.arange(8)
    rim = x + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    around = clamped(np.vstack([x, rim]))
    latent = interpolator(WIND.latent_var)(np.column_stack([np.full(9, step * 100.0), around]))
    gust = np.array(lattice.gust(problem.tables.wind, step))
    found = lattice.worst_variance(problem.tables.wind, step, *x, radius)
    best = latent.sum(axis=1).max() + gust.sum()
    assert sum(found) == pytest.approx(best, rel=1e-9)
    assert np.min(np.abs(latent + gust - found).sum(axis=1)) < 1e-9  # a pair that occurs, not a mixture


def test_a_certain_position_meets_the_variance_where_it_is(problem):
    wind = problem.tables.wind
    here = np.add(lattice.at(wind.latent, wind, 7, 5e3, 6e3), lattice.gust(wind, 7))
    np.testing.assert_allclose(lattice.worst_variance(wind, 7, 5e3, 6e3, 0.0), here)


@some
@given(seeds)
def test_mean_and_covariance_move_by_the_matrices(problem, seed):
    rng = np.random.default_rng(seed)
    motion, wind = problem.tables.motion, problem.tables.wind
    step, x = int(rng.integers(0, problem.horizon)), rng.uniform(0, 20 * KM, 2)
    (cov,) = random_covariances(rng, 1, 800.0)
    mean = risk.interpolate(problem, wind.mean, step, x)
    np.testing.assert_allclose(lattice.drift(wind, motion, step, *x), np.array(A) @ x + 100 * mean)
    radius = motion.ball * np.sqrt(np.trace(cov) / 2)
    variance = lattice.worst_variance(wind, step, *x, radius)
    after = np.array(A) @ cov @ np.array(A).T + 100.0**2 * np.diag(variance)
    xx, xy, yy = lattice.spread(wind, motion, step, *x, cov[0, 0], cov[0, 1], cov[1, 1])
    np.testing.assert_allclose([[xx, xy], [xy, yy]], after, rtol=1e-9)


@some
@given(seeds)
def test_airspeed_is_the_length_of_the_control_that_makes_the_move(problem, seed):
    u = np.random.default_rng(seed).uniform(-10, 10, 2)
    moved = 100.0 * np.array(B) @ u
    assert lattice.airspeed(problem.tables.motion, *moved) == pytest.approx(np.linalg.norm(u), rel=1e-9)
