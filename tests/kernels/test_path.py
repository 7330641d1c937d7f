"""Paths evaluated by kernel and reference; the collision bound against every division into runs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from pareto_ltl.kernels import path as kernel
from pareto_ltl.kernels.geometry import SLACK
from pareto_ltl.planning import reference as risk
from pareto_ltl.planning.problem import trail
from pareto_ltl.settings import PlannerConfig, RobotConfig
from problems import KM, box, make_problem, make_scene, polygon_faces, rough_wind, steady_wind, two_goals

some = settings(deadline=None, max_examples=40)
few = settings(deadline=None, max_examples=8)
seeds = st.integers(0, 2**32 - 1)
ALONE = np.empty((0, 0, 2, 2))  # no correlation between steps is known
TURNED = RobotConfig(
    dt=100.0, u_max=10.0, start_sd=50.0, a=[[1.0, 0.01], [-0.02, 0.99]], b=[[1, 0.3], [0, 1]]
)


@pytest.fixture(scope="module")
def gentle():
    return rough_wind(two_goals().scene, variance=0.2)


@pytest.fixture(scope="module")
def problem(gentle):
    return two_goals(wind=gentle)


@pytest.fixture(scope="module")
def turned():
    """A and B that are not the identity, an uncertain start, and almost no constraint on collisions."""
    return two_goals(robot=TURNED, planner=PlannerConfig(epsilon=0.999))


def flown(problem, x, fast=1.0):
    """What ``evaluate`` returns and fills."""
    n, m = len(x), len(problem.tables.obstacles.ptr) - 1
    cov, u = np.full((n, 3), np.nan), np.full((n - 1, 2), np.nan)
    q, cell = np.full(n, -9, np.int64), np.full(n, -9, np.int64)
    f_o, touch = np.full(len(problem.atoms), np.nan), np.full((n, m), np.nan)
    start = problem.start_variance
    fault = kernel.evaluate(
        problem.tables, np.ascontiguousarray(x), start, fast, cov, u, q, cell, f_o, touch,
        trail(problem, len(x)), np.empty(len(x)),
    )  # fmt: skip
    return fault, cov, u, q, cell, f_o, touch


def along(*corners, step=0.4):
    """Positions ``step`` km apart along straight legs [m]."""
    legs = []
    for p, q in itertools.pairwise(np.array(corners, float)):
        n = max(1, int(np.ceil(np.linalg.norm(q - p) / step)))
        legs.append(p + np.arange(n)[:, None] / n * (q - p))
    return np.vstack([*legs, [corners[-1]]]) * KM


AROUND = ((2, 3), (5, 8), (10, 8), (14, 5), (15, 8), (8, 9), (4, 14))  # a, then b, clear of both obstacles


def full(cov):
    return cov[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


@pytest.mark.parametrize("which", ["problem", "turned"])
def test_a_path_costs_what_the_reference_says(which, request):
    problem = request.getfixturevalue(which)
    x = along(*AROUND)
    (fault, where), cov, u, q, cell, f_o, touch = flown(problem, x)
    assert (fault, where) == (kernel.FLOWN, len(x) - 1)
    expected_cov, expected_u = risk.propagate(problem, x)
    np.testing.assert_allclose(full(cov), expected_cov, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(u, expected_u, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(cell, problem.locate(x))
    state, states = problem.automaton.initial, []
    for c in cell:
        state = problem.automaton.step(state, problem.labels[c])
        states.append(state)
    assert q.tolist() == states
    assert problem.automaton.accepting[q[-1]]
    np.testing.assert_allclose(f_o, risk.mission_risk_paper(problem, x, expected_cov, cell), rtol=1e-9)
    for j, (normals, offsets) in enumerate(polygon_faces(problem.tables.obstacles)):
        bound = [risk.inside_bound(normals, offsets, m, c) for m, c in zip(x, expected_cov, strict=True)]
        np.testing.assert_allclose(touch[:, j], bound, rtol=1e-8, atol=1e-300)


def test_regions_never_visited_cost_nothing(problem):
    (fault, _), *_, f_o, _ = flown(problem, along((2, 3), (4, 5)))
    assert fault == kernel.FLOWN
    assert f_o.tolist() == [0.0, 0.0]


def test_the_first_fault_is_named_with_its_step(problem):
    def fault(*corners, of=problem, **how):
        return flown(of, along(*corners, **how))[0]

    assert fault((2, 3), (3, 3), (9, 9), step=3.0) == (kernel.TOO_FAST, 2)
    assert fault((2, 3), (2, -2))[0] == kernel.OFF_MAP
    assert fault((6, 3), (6.9, 3))[0] == kernel.CROSSING
    assert fault((6.9, 8.5), (8, 3), step=9.0) == (kernel.TOO_FAST, 1)
    assert flown(problem, along((6, 3), (8, 3), step=2.5), fast=9.0)[0] == (kernel.OFF_MAP, 1)
    brief = two_goals(wind=rough_wind(problem.scene, slots=2, hours=0.25))  # known for 10 steps
    assert brief.horizon == 10
    x = along((2, 3), (4, 10))
    assert len(x) > 12
    assert flown(brief, x)[0] == (kernel.UNKNOWN_WIND, 11)
    assert flown(brief, x[:11])[0] == (kernel.FLOWN, 10)


def test_too_much_airspeed_is_forgiven_up_to_the_given_factor(problem, gentle):
    x = along((2, 3), (8, 7.5), step=0.4)
    u = flown(problem, x, fast=100.0)[2]
    excess = np.linalg.norm(u, axis=1).max() / problem.tables.motion.u_max
    slow = two_goals(wind=gentle, robot=RobotConfig(dt=100.0, u_max=excess * 10.0 / 1.001))
    assert flown(slow, x, fast=1.0)[0][0] == kernel.TOO_FAST
    assert flown(slow, x, fast=1.002)[0][0] == kernel.FLOWN


def test_a_step_that_cuts_a_corner_is_a_crossing():
    """Both ends are clear of the obstacle, but no face of it serves both."""
    scene = make_scene({"a": box(15, 15, 17, 17)}, [box(5, 5, 8, 8)], start=(4.6, 7.5))
    problem = make_problem("F a", scene, steady_wind(scene, gust=(0.0, 0.0)))
    cut, around = np.array([[4.6, 7.5], [5.4, 8.1]]) * KM, np.array([[4.6, 7.5], [4.6, 8.2], [5.4, 8.2]]) * KM
    assert flown(problem, cut)[0] == (kernel.CROSSING, 1)
    assert flown(problem, around)[0] == (kernel.FLOWN, 2)


@few
@given(seeds)
def test_random_paths_of_a_robot_with_matrices_follow_the_reference(turned, seed):
    """Mean, covariance and controls of random walks far from obstacles."""
    x = np.cumsum(np.vstack([[4e3, 9e3], np.random.default_rng(seed).uniform(-300, 300, (12, 2))]), axis=0)
    (fault, _), cov, u, *_ = flown(turned, x, fast=100.0)
    if fault == kernel.FLOWN:
        expected_cov, expected_u = risk.propagate(turned, x)
        np.testing.assert_allclose(full(cov), expected_cov, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(u, expected_u, rtol=1e-9, atol=1e-9)


# --- collision_bound -----------------------------------------------------------------------------------


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
    for normals, offsets in polygon_faces(problem.tables.obstacles):
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
    return min(total, 1.0)


@some
@given(seeds, st.integers(1, 6), st.floats(20.0, 900.0))
def test_the_collision_bound_is_the_cheapest_division_into_runs(problem, seed, steps, sd):
    rng = np.random.default_rng(seed)
    x = rng.uniform([5, 0], [16, 15], 2) * KM + np.cumsum(rng.uniform(-KM, KM, (steps + 1, 2)), axis=0)
    root = sd * rng.standard_normal((steps + 1, 2, 2))
    cov = root @ root.transpose(0, 2, 1) + np.eye(2)
    three = np.ascontiguousarray(cov.reshape(-1, 4)[:, [0, 1, 3]])
    found = kernel.collision_bound(problem.tables, x, three, ALONE)
    assert found == pytest.approx(every_division(problem, x, cov, reflect=True), rel=1e-9, abs=1e-300)


@few
@given(seeds)
def test_without_the_identity_the_reflection_is_not_used(turned, seed):
    rng = np.random.default_rng(seed)
    x = np.array([[6.0, 6.5]]) * KM + np.cumsum(rng.uniform(-200, 500, (5, 2)), axis=0)
    cov = np.repeat((rng.uniform(50, 400) ** 2 * np.eye(2))[None], 5, axis=0)
    three = np.ascontiguousarray(cov.reshape(-1, 4)[:, [0, 1, 3]])
    found = kernel.collision_bound(turned.tables, x, three, ALONE)
    assert found == pytest.approx(every_division(turned, x, cov, reflect=False), rel=1e-9, abs=1e-300)


def test_a_long_parallel_flight_pays_once_for_the_reflection(problem):
    """Side by side with one face for 30 steps: 2 Φ(-d/σ) is far below 31 Φ(-d/σ)."""
    x = np.column_stack([np.linspace(7.2, 8.8, 31), np.full(31, 7.0)]) * KM
    three = np.tile([500.0**2, 0.0, 500.0**2], (31, 1))
    north = np.array([0.0, 5 * KM])
    far = kernel.collision_bound(problem.tables, x + north, three, ALONE)  # what the other obstacle adds
    found = kernel.collision_bound(problem.tables, x, three, ALONE)
    assert found == pytest.approx(2 * ndtr(-1000 / 500), rel=0.02)
    assert far < found


def test_a_lone_position_is_covered_by_the_sum(problem):
    x, three = np.array([[8.0, 6.5]]) * KM, np.array([[400.0**2, 0.0, 400.0**2]])
    found = kernel.collision_bound(problem.tables, x, three, ALONE)
    assert found == pytest.approx(ndtr(-500 / 400), rel=1e-6)


def test_a_path_through_an_obstacle_is_certain_to_collide(problem):
    x = along((6, 3), (10, 3), step=0.5)
    three = np.tile([100.0, 0.0, 100.0], (len(x), 1))
    assert kernel.collision_bound(problem.tables, x, three, ALONE) == 1.0


def test_far_from_everything_the_bound_is_zero():
    problem = make_problem("F a", make_scene({"a": box(10, 10, 12, 12)}))
    assert kernel.collision_bound(problem.tables, np.zeros((3, 2)), np.ones((3, 3)), ALONE) == 0.0
