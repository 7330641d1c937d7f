"""Faces that a position clears."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pareto_ltl.kernels import collision_risk as kernel
from pareto_ltl.kernels.data import Cov, Gaussian, Point
from pareto_ltl.planning.pack import pack_faces
from pareto_ltl.settings import PlannerConfig, RobotConfig
from problems import KM, box, make_problem, make_scene, polygon_faces, two_goals

some = settings(deadline=None, max_examples=40)
few = settings(deadline=None, max_examples=8)
seeds = st.integers(0, 2**32 - 1)
ALONE = np.empty((0, 0, 2, 2))  # no correlation between steps is known


@pytest.fixture(scope="module")
def problem():
    return two_goals()


@pytest.fixture(scope="module")
def turned():
    """A and B that are not the identity, and almost no constraint on collisions."""
    robot = RobotConfig(
        dt=100.0, u_max=10.0, start_sd=50.0, a=[[1.0, 0.01], [-0.02, 0.99]], b=[[1, 0.3], [0, 1]]
    )
    return two_goals(robot=robot, planner=PlannerConfig(epsilon=0.999))


# --- the faces an obstacle is cleared by -------------------------------------------------------


@some
@given(seeds, st.floats(-1.0, 4.0))
def test_a_face_is_cleared_where_it_is_z_standard_deviations_away(problem, seed, z):
    rng = np.random.default_rng(seed)
    obstacles = problem.obstacles
    x = rng.uniform(0, 20 * KM, 2)
    root = rng.normal(0, 500, (2, 2))
    cov = root @ root.T
    masks = np.zeros((1, len(obstacles.ptr) - 1), np.int64)
    here = Gaussian(Point(*x), Cov(cov[0, 0], cov[0, 1], cov[1, 1]))
    ok = kernel.clear_faces(obstacles, z, here, masks, 0)
    expected = []
    for normals, offsets in polygon_faces(obstacles):
        gap = normals @ x - offsets
        sd = np.sqrt(np.einsum("ij,jk,ik->i", normals, cov, normals))
        assume(np.abs(gap - z * sd).min() > 1e-6)
        assume(np.abs(gap).min() > 1e-6)
        clear = gap >= z * sd
        if z >= 0:
            clear &= gap >= 0
        expected.append(sum(1 << k for k in np.flatnonzero(clear)))
    assert ok == all(expected)
    if ok:
        np.testing.assert_array_equal(masks[0], expected)


def test_the_31st_face_has_its_own_bit():
    angle = 2 * np.pi * np.arange(32) / 32
    ring = pack_faces([100 * np.stack([np.cos(angle), np.sin(angle)], axis=1)])
    masks = np.zeros((1, 1), np.int64)
    here = Gaussian(Point(*(101 * ring.normal[31])), Cov(0.0, 0.0, 0.0))
    assert kernel.clear_faces(ring, 0.0, here, masks, 0)
    assert masks[0, 0] & (1 << 31)
    assert not masks[0, 0] & (1 << 15)  # the opposite face


def test_a_map_without_obstacles_stops_nothing():
    problem = make_problem("F a", make_scene({"a": box(10, 10, 12, 12)}))
    masks = np.zeros((1, 0), np.int64)
    here = Gaussian(Point(0.0, 0.0), Cov(1.0, 0.0, 1.0))
    assert kernel.clear_faces(problem.obstacles, 3.0, here, masks, 0)
