"""The one pass along a path: kernels against the reference, faults by name, correlations by sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coherent import STEPS, coherent_problem
from oracle import path_risk as risk
from pareto_ltl.kernels import path as kernel
from pareto_ltl.planning.evaluate import cross_covariance, propagate
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.simulation.flights import draw_coherent
from plane_kernels.gaussian import inside
from plane_logic.mission_risk import theorem2_risks
from problems import (
    KM,
    along,
    box,
    make_problem,
    make_scene,
    polygon_faces,
    rough_wind,
    steady_wind,
    two_goals,
)

few = settings(deadline=None, max_examples=8)
seeds = st.integers(0, 2**32 - 1)
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
    """The flight along ``x``, and what ``check_path`` returns and fills."""
    n, flight = len(x), propagate(problem, x)
    q, cell = np.full(n, -9, np.int64), np.full(n, -9, np.int64)
    known = min(n - 1, len(problem.wind.slot))
    fault = kernel.check_path(problem.world, flight, known, fast, q, cell)
    return fault, flight, q, cell


AROUND = ((2, 3), (5, 8), (10, 8), (14, 5), (15, 8), (8, 9), (4, 14))  # a, then b, clear of both obstacles


def full(cov):
    return cov[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


@pytest.mark.parametrize("which", ["problem", "turned"])
def test_a_path_costs_what_the_reference_says(which, request):
    problem = request.getfixturevalue(which)
    x = along(*AROUND)
    (fault, where), flight, q, cell = flown(problem, x)
    assert (fault, where) == (kernel.FLOWN, len(x) - 1)
    expected_cov, expected_u = risk.propagate_independent(problem, x)
    np.testing.assert_allclose(full(flight.cov), expected_cov, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(flight.u, expected_u, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(cell, problem.locate(x))
    state, states = problem.automaton.initial, []
    for c in cell:
        state = problem.automaton.step(state, problem.labels[c])
        states.append(state)
    assert q.tolist() == states
    assert problem.automaton.accepting[q[-1]]
    f_o = theorem2_risks(problem.theorem2, x, flight.cov, cell)
    np.testing.assert_allclose(f_o, risk.theorem2_bound(problem, x, expected_cov, cell), rtol=1e-9)
    for j, (normals, offsets) in enumerate(polygon_faces(problem.obstacles)):
        bound = [risk.inside_bound(normals, offsets, m, c) for m, c in zip(x, expected_cov, strict=True)]
        touch = [inside(problem.obstacles, j, kernel.position(flight, t)) for t in range(len(x))]
        np.testing.assert_allclose(touch, bound, rtol=1e-8, atol=1e-300)


def test_regions_never_visited_cost_nothing(problem):
    (fault, _), flight, _, cell = flown(problem, along((2, 3), (4, 5)))
    assert fault == kernel.FLOWN
    assert theorem2_risks(problem.theorem2, flight.x, flight.cov, cell).tolist() == [0.0, 0.0]


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
    u = flown(problem, x, fast=100.0)[1].u
    excess = np.linalg.norm(u, axis=1).max() / problem.motion.u_max
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
    (fault, _), flight, *_ = flown(turned, x, fast=100.0)
    if fault == kernel.FLOWN:
        expected_cov, expected_u = risk.propagate_independent(turned, x)
        np.testing.assert_allclose(full(flight.cov), expected_cov, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(flight.u, expected_u, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("which", ["problem", "turned"])
def test_the_linearised_independent_law_makes_the_covariances(which, request):
    """Σ' = F Σ F' + dt² white, with F = A - K."""
    problem = request.getfixturevalue(which)
    flight = propagate(problem, along(*AROUND))
    sigma, dt = full(flight.cov), problem.motion.dt
    for t, F in enumerate(flight.F):
        expected = F @ sigma[t] @ F.T + dt**2 * np.diag(flight.white[t])
        np.testing.assert_allclose(sigma[t + 1], expected, rtol=1e-9)
    assert not flight.shift.any()


def test_correlations_between_steps_are_those_of_linear_flights():
    """Cov(e_t, e_s) against 200,000 flights of e' = F e + dt (ψ' θ + white) drawn in plain NumPy."""
    p = coherent_problem(hours=0.25, rho=0.6)
    flight = propagate(p, STEPS)
    n, dt, modes = 200_000, p.motion.dt, p.modes
    winds = draw_coherent(p, n, len(flight.F), np.random.default_rng(3))
    e = [np.random.default_rng(4).standard_normal((n, 2)) * np.sqrt(p.start_variance)]
    for t, F in enumerate(flight.F):
        wind = np.einsum("cp,ncp->nc", flight.psi[t], winds.theta[modes.epoch[t]])
        e.append(e[-1] @ F.T + dt * (wind + np.sqrt(flight.white[t]) * winds.white[t]))
    cross = cross_covariance(p.world.law, flight)
    for s, t in ((5, 6), (10, 30), (20, 35)):
        found = e[t].T @ e[s] / n
        scale = np.sqrt(np.outer(np.diag(cross[t, t]), np.diag(cross[s, s])))
        np.testing.assert_allclose(found / scale, cross[t, s] / scale, atol=0.02)
