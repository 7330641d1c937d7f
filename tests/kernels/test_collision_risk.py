"""Steps that keep clear of obstacles, which obstacles are looked at, and the risk of a step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from pareto_ltl.planning.pack import pack_faces, pack_nearby
from plane_kernels import collision_risk as kernel
from plane_kernels.geometry import look_around
from plane_kernels.types import Cov, Gaussian, PathBound, Point, StepBound
from problems import KM, box, make_problem, make_scene, polygon_faces, two_goals

some = settings(deadline=None, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def problem():
    return two_goals()


# --- the faces an obstacle is cleared by -------------------------------------------------------


def step_bound(obstacles, z, bounds=((0.0, 0.0), (20 * KM, 20 * KM))):
    """Eq. (10) with quantile z on a map of the given bounds."""
    return StepBound(obstacles, pack_nearby(obstacles, np.array(bounds)), z)


def a_gaussian(rng, sd=500.0):
    """A position on the map of two goals."""
    root = rng.normal(0, sd, (2, 2))
    cov = root @ root.T
    x = rng.uniform(0, 20 * KM, 2)
    return x, cov, Gaussian(Point(*x), Cov(cov[0, 0], cov[0, 1], cov[1, 1]))


def cleared(obstacles, z, x, cov):
    """Which faces are cleared, an array for each obstacle."""
    found = []
    for normals, offsets in polygon_faces(obstacles):
        gap = normals @ x - offsets
        sd = np.sqrt(np.einsum("ij,jk,ik->i", normals, cov, normals))
        assume(np.abs(gap - z * sd).min() > 1e-6)
        assume(np.abs(gap).min() > 1e-6)
        found.append((gap >= z * sd) & ((gap >= 0) | (z < 0)))
    return found


@some
@given(seeds, st.floats(-1.0, 4.0))
def test_a_step_is_clear_where_one_face_of_every_obstacle_serves_both_ends(problem, seed, z):
    rng = np.random.default_rng(seed)
    obstacles = problem.obstacles
    x, cov, here = a_gaussian(rng)
    y, wider, there = a_gaussian(rng)
    both = zip(cleared(obstacles, z, x, cov), cleared(obstacles, z, y, wider), strict=True)
    assert kernel.step_is_clear(step_bound(obstacles, z), here, there) == all(np.any(a & b) for a, b in both)


def test_a_map_without_obstacles_stops_nothing():
    problem = make_problem("F a", make_scene({"a": box(10, 10, 12, 12)}))
    here = Gaussian(Point(0.0, 0.0), Cov(1.0, 0.0, 1.0))
    assert kernel.step_is_clear(step_bound(problem.obstacles, 3.0), here, here)


# --- obstacles near a place -------------------------------------------------------------------


def many_obstacles(rng, count):
    """Triangles all over the map of two goals."""
    middle = rng.uniform(0, 20 * KM, (count, 1, 2))
    angle = np.sort(rng.uniform(0, 2 * np.pi, (count, 1)) + 2 * np.pi * np.arange(3) / 3, axis=1)
    corners = middle + 300 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return pack_faces(list(corners))


@some
@given(seeds, st.integers(1, 60), st.booleans())
def test_obstacles_that_are_not_looked_at_lie_far_behind_one_face(seed, count, outside):
    """Also where the step leaves the map, beyond the squares."""
    rng = np.random.default_rng(seed)
    obstacles = many_obstacles(rng, count)
    nearby = pack_nearby(obstacles, np.array([[0.0, 0.0], [20 * KM, 15 * KM]]))
    x, _, here = a_gaussian(rng, 50.0)
    y, _, there = a_gaussian(rng, 100.0)
    if outside:
        y = y + 20 * KM
        there = there._replace(mean=Point(*y))
    leg = kernel.leg_between(here, there, 3.0)
    row, far = look_around(nearby, here.mean, there.mean, max(leg.far_here, leg.far_there))
    kept = {int(j) for j in nearby.order[row][nearby.gap[row] < far]}
    assert sorted(nearby.order[row]) == list(range(count))
    for j, (normals, offsets) in enumerate(polygon_faces(obstacles)):
        beyond = np.minimum(normals @ x, normals @ y) - offsets
        assert j in kept or beyond.max() >= max(leg.far_here, leg.far_there)


# --- the constraint of a path bound ------------------------------------------------------------


@some
@given(seeds)
def test_the_risk_of_a_step_is_the_sum_over_obstacles_of_the_best_face_beyond_which_both_ends_lie(seed):
    """The second way is in plain NumPy, over all obstacles; those that are not looked at add 3e-7 each."""
    rng = np.random.default_rng(seed)
    obstacles = many_obstacles(rng, 30)
    nearby = pack_nearby(obstacles, np.array([[0.0, 0.0], [20 * KM, 20 * KM]]))
    x, _, here = a_gaussian(rng, 200.0)
    y, cov, there = a_gaussian(rng, 200.0)
    expected = 0.0
    for normals, offsets in polygon_faces(obstacles):
        gaps = np.column_stack([normals @ x, normals @ y]) - offsets[:, None]
        risks = norm.sf(gaps[:, 1] / np.sqrt(np.einsum("ij,jk,ik->i", normals, cov, normals)))
        expected += min(risks[(gaps >= 0.0).all(axis=1)], default=np.inf)
    bound = PathBound(obstacles, nearby, np.inf, np.inf)
    found = kernel.step_risk(bound, kernel.leg_between(here, there, kernel.FAR_DEVIATIONS))
    assert found == pytest.approx(expected, abs=1e-5)
    for epsilon in (0.5 * expected, 2.0 * expected + 1e-4):
        allowed = kernel.step_allowed(bound._replace(epsilon=epsilon), here, there)
        assert allowed == (expected <= epsilon) or abs(expected - epsilon) < 1e-5
