"""Wind between lattice nodes: kernels against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from pareto_ltl.kernels import interpolation as lattice
from pareto_ltl.kernels.interpolation import wind_slopes
from pareto_ltl.planning.wind_lookup import wind_and_gradient
from plane_kernels.types import Point
from problems import KM, box, make_problem, make_scene, rough_wind

SCENE = make_scene({"a": box(10, 10, 12, 12)})
WIND = rough_wind(SCENE, hours=1.0)


@pytest.fixture(scope="module")
def problem():
    return make_problem("F a", SCENE, WIND)


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
    wind = problem.wind
    table = getattr(wind, name)
    steps = rng.integers(0, problem.horizon, 200)
    points = rng.uniform(-4 * KM, 25 * KM, (200, 2))  # past the lattice as well
    found = [lattice.wind_at(table, wind, t, Point(x, y)) for t, (x, y) in zip(steps, points, strict=True)]
    where = np.column_stack([steps * 100.0, clamped(points)])
    np.testing.assert_allclose(found, interpolator(table)(where), atol=1e-12)


def test_nodes_are_reproduced_exactly(problem):
    wind = problem.wind
    nx, ny = wind.mean.shape[1:3]
    for slot, step in enumerate((0, 36, 72, 108)):
        for i, j in ((0, 0), (3, 5), (nx - 1, ny - 1), (0, ny - 1)):
            node = Point(*(WIND.origin + WIND.spacing * np.array([i, j])))
            found = lattice.wind_at(wind.mean, wind, step, node)
            np.testing.assert_allclose(found, wind.mean[slot, i, j])


def test_the_gust_is_linear_in_time(problem):
    found = [lattice.gust_variance(problem.wind, t) for t in range(problem.horizon)]
    times = 100.0 * np.arange(problem.horizon)
    expected = np.column_stack([np.interp(times, WIND.times, WIND.gust_var[:, c]) for c in (0, 1)])
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_slopes_along_a_path_are_those_of_the_bilinear_wind(problem):
    x = np.random.default_rng(2).uniform(-4 * KM, 25 * KM, (problem.horizon + 1, 2))  # past the lattice too
    slopes = np.empty((problem.horizon, 2, 2))
    wind_slopes(problem.wind, x, slopes)
    np.testing.assert_allclose(slopes, wind_and_gradient(problem.wind, x[:-1])[1], rtol=1e-9, atol=1e-15)
    assert (slopes == 0.0).any()
