"""R of a path against every division of it into runs, and of long paths against the judge's code."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from pareto_ltl.planning.evaluate import collision_risk, propagate
from pareto_ltl.planning.pack import pack_faces, pack_nearby
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl_verify.gaussians import Convex, growing, path_bound
from plane_kernels import path_collision as kernel
from plane_kernels.geometry import SLACK
from plane_kernels.path_collision import collision_bound
from plane_kernels.types import Faces
from problems import KM, along, box, make_problem, make_scene, polygon_faces, three_columns, two_goals

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


def bound_of(problem, x, cov, reflect=kernel.REFLECT, cross=ALONE):
    """R of means (T+1, 2) and rows (xx, xy, yy)."""
    path = kernel.GaussianPath(np.ascontiguousarray(x), np.ascontiguousarray(cov), cross, reflect)
    bound = problem.world.collision
    return collision_bound(bound.barriers, bound.nearby, path)


def many_obstacles(rng, count):
    """Triangles all over the map of two goals."""
    middle = rng.uniform(0, 20 * KM, (count, 1, 2))
    angle = np.sort(rng.uniform(0, 2 * np.pi, (count, 1)) + 2 * np.pi * np.arange(3) / 3, axis=1)
    corners = middle + 300 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return pack_faces(list(corners))


def run_cost(normals, offsets, x, cov, reflect):
    """The cheapest face for one run of steps, inf where no face separates them all."""
    best = np.inf
    for normal, offset in zip(normals, offsets, strict=True):
        gap = x @ normal - offset
        if np.all(gap >= -SLACK):
            sd = np.sqrt(np.einsum("i,tij,j->t", normal, cov, normal))
            cost = ndtr(-gap / sd).sum()
            if reflect:
                cost = min(cost, 2 * ndtr(-gap.min() / sd.max()))
            best = min(best, cost)
    return best


def every_division(problem, x, cov, reflect):
    """Runs overlap in the step where the face changes: choose these steps in all 2^(T-1) ways."""
    total, last = 0.0, len(x) - 1
    for normals, offsets in polygon_faces(problem.obstacles):
        best = np.inf
        for count in range(last):
            for cuts in itertools.combinations(range(1, last), count):
                ends = [0, *cuts, last]
                best = min(
                    best,
                    sum(
                        run_cost(normals, offsets, x[s : t + 1], cov[s : t + 1], reflect)
                        for s, t in itertools.pairwise(ends)
                    ),
                )
        total += min(best, 1.0)
    return total


@some
@given(seeds, st.integers(1, 6), st.floats(20.0, 900.0))
def test_the_collision_bound_is_the_cheapest_division_into_runs(problem, seed, steps, sd):
    rng = np.random.default_rng(seed)
    x = rng.uniform([5, 0], [16, 15], 2) * KM + np.cumsum(rng.uniform(-KM, KM, (steps + 1, 2)), axis=0)
    root = sd * rng.standard_normal((steps + 1, 2, 2))
    cov = root @ root.transpose(0, 2, 1) + np.eye(2)
    found = bound_of(problem, x, three_columns(cov))
    assert found == pytest.approx(every_division(problem, x, cov, reflect=True), rel=1e-9, abs=1e-13)


@few
@given(seeds)
def test_without_the_identity_the_reflection_is_not_used(turned, seed):
    rng = np.random.default_rng(seed)
    x = np.array([[6.0, 6.5]]) * KM + np.cumsum(rng.uniform(-200, 500, (5, 2)), axis=0)
    cov = np.repeat((rng.uniform(50, 400) ** 2 * np.eye(2))[None], 5, axis=0)
    flight = propagate(turned, x)._replace(cov=three_columns(cov))
    found = collision_risk(turned, flight, turned.world.law)
    assert found == pytest.approx(every_division(turned, x, cov, reflect=False), rel=1e-9, abs=1e-13)


def test_a_long_parallel_flight_pays_once_for_the_reflection(problem):
    """Side by side with one face for 30 steps: 2 Φ(-d/σ) is far below 31 Φ(-d/σ)."""
    x = np.column_stack([np.linspace(7.2, 8.8, 31), np.full(31, 7.0)]) * KM
    three = np.tile([500.0**2, 0.0, 500.0**2], (31, 1))
    north = np.array([0.0, 5 * KM])
    far = bound_of(problem, x + north, three)  # what the other obstacle adds
    found = bound_of(problem, x, three)
    assert found == pytest.approx(2 * ndtr(-1000 / 500), rel=0.02)
    assert far < found


def test_a_lone_position_is_covered_by_the_sum(problem):
    found = bound_of(problem, np.array([[8.0, 6.5]]) * KM, np.array([[400.0**2, 0.0, 400.0**2]]))
    assert found == pytest.approx(ndtr(-500 / 400), rel=1e-6)


def test_a_path_through_an_obstacle_is_certain_to_collide(problem):
    x = along((6, 3), (10, 3), step=0.5)
    assert bound_of(problem, x, np.tile([100.0, 0.0, 100.0], (len(x), 1))) == 1.0


def test_far_from_everything_the_bound_is_zero():
    problem = make_problem("F a", make_scene({"a": box(10, 10, 12, 12)}))
    assert bound_of(problem, np.zeros((3, 2)), np.ones((3, 3))) == 0.0


def test_the_reflection_is_left_out_where_deviations_shrink():
    """A run beside one face whose variance falls: 2 Φ(-d/σ) no longer bounds what happened on the way."""
    scene = make_scene({"a": box(15, 15, 19, 19)}, [box(8, 2, 11, 6)], start=(2.0, 2.0))
    problem = make_problem("F a", scene)
    x = np.column_stack([np.full(20, 12.0), np.linspace(2, 6, 20)]) * KM
    sd = np.linspace(500.0, 100.0, 20)
    three = np.column_stack([sd**2, np.zeros(20), sd**2])
    cross = np.zeros((20, 20, 2, 2))
    for s in range(20):
        for t in range(s, 20):
            cross[t, s] = 0.9 ** (t - s) * sd[s] * sd[t] * np.eye(2)
    alone = bound_of(problem, x, three, kernel.SUM_ONLY)
    assert bound_of(problem, x, three, kernel.REFLECT_WHERE_GROWING, cross) == alone
    for s in range(20):
        cross[s:, s] = sd[s] ** 2 * np.eye(2)  # Cov(e_t, e_s) = Var e_s: the reflection is allowed
    assert bound_of(problem, x, three, kernel.REFLECT_WHERE_GROWING, cross) < alone


# --- long paths --------------------------------------------------------------------------------


def wandering(seed, steps):
    """A path that passes obstacles slowly and comes back, its variances, and Cov(e_t, e_r) of the process
    e_{t+1} = 0.995 e_t + noise, whose deviations grow at first and shrink here and there."""
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.normal(0, 0.1, steps))
    stride = 24.0 / steps * KM * np.column_stack([np.cos(turns), np.sin(turns)])
    x = rng.uniform([4, 1], [9, 8], 2) * KM + np.vstack([np.zeros(2), np.cumsum(stride, axis=0)])
    cross = np.zeros((steps + 1, steps + 1, 2, 2))
    cross[0, 0] = rng.uniform(1, 300) ** 2 * np.eye(2)
    for t in range(steps):
        keep = rng.choice([1.0, 0.995])
        root = rng.normal(0, rng.choice([0.0, 40.0]), (2, 2))
        cross[t + 1, : t + 1] = keep * cross[t, : t + 1]
        cross[t + 1, t + 1] = keep**2 * cross[t, t] + root @ root.T
    var = np.einsum("ttij->tij", cross)
    return x, var, cross


@few
@given(seeds, st.integers(50, 150))
def test_long_paths_cost_what_the_judge_finds(problem, seed, steps):
    x, cov, cross = wandering(seed, steps)
    parts = [
        Convex(np.empty((0, 2)), normals, offsets) for normals, offsets in polygon_faces(problem.obstacles)
    ]
    judged = np.einsum("trij->rtji", cross)  # (r, t): Cov(e_r, e_t)
    allowed = {
        kernel.SUM_ONLY: [np.zeros((len(p.offsets), steps + 1, steps + 1), bool) for p in parts],
        kernel.REFLECT: [np.ones((len(p.offsets), steps + 1, steps + 1), bool) for p in parts],
        kernel.REFLECT_WHERE_GROWING: [growing(p, judged, 1e-9) for p in parts],
    }
    for reflect, grows in allowed.items():
        found = bound_of(problem, x, three_columns(cov), reflect, cross)
        assert min(found, 1.0) == pytest.approx(path_bound(parts, x, cov, grows), rel=1e-9, abs=1e-13)


@few
@given(seeds, st.integers(1, 40))
def test_r_of_many_obstacles_is_the_sum_of_each_alone(seed, count):
    rng = np.random.default_rng(seed)
    obstacles = many_obstacles(rng, count)
    bounds = np.array([[0.0, 0.0], [20 * KM, 20 * KM]])
    x = np.cumsum(np.vstack([rng.uniform(4, 16, 2) * KM, rng.normal(300, 800, (9, 2))]), axis=0)
    cov = np.tile([200.0**2, 0.0, 200.0**2], (10, 1)) * np.linspace(0.1, 1, 10)[:, None]
    path = kernel.GaussianPath(x, cov, ALONE, kernel.REFLECT)
    alone = 0.0
    for normals, offsets in polygon_faces(obstacles):
        one = Faces(np.array([0, len(offsets)]), np.ascontiguousarray(normals), np.ascontiguousarray(offsets))
        everywhere = pack_nearby(one, bounds)
        everywhere = everywhere._replace(gap=np.full_like(everywhere.gap, -np.inf))
        alone += collision_bound(one, everywhere, path)
    found = collision_bound(obstacles, pack_nearby(obstacles, bounds), path)
    assert found == pytest.approx(alone, rel=1e-12, abs=1e-13)
