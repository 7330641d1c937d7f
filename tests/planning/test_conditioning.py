"""What a fix tells, against flights that are weighted by how well they explain it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.random import SeedSequence

from coherent import LOOSE, SCENE, STEPS, coherent_problem
from pareto_ltl.planning.conditioning import Fix, learn, learn_at, likely_histories, states_reached
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.settings import RobotConfig
from pareto_ltl.simulation.common_flights import draw_flights
from pareto_ltl.wind.conditioned import conditioned_field, field_from, less_doubt, mode_values
from problems import make_problem, smooth_wind

RUNS, STEP = 40_000, 15
ROBOT = RobotConfig(dt=100.0, u_max=20.0, start_sd=50.0)


@pytest.fixture(scope="module")
def weighed():
    """Flights of a plan in coherent winds, and weights that make them flights given a fix."""
    problem = coherent_problem()
    flight = propagate(problem, STEPS)
    drawn = draw_flights(problem, "coherent", RUNS, SeedSequence(5))
    x = drawn.flown(flight.u, flight.x)
    spread = np.sqrt(flight.cov[STEP, 0])
    fix = Fix(flight.x[STEP] + spread * np.array([0.8, -0.6]), 0.3 * spread)
    gap = (x[:, STEP] - fix.place) / fix.sd
    weight = np.exp(-0.5 * (gap**2).sum(axis=1))
    theta = drawn.draws.theta[problem.modes.epoch[STEP]].astype(float)
    return problem, flight, x, theta, fix, weight / weight.sum()


def test_the_position_given_a_fix_is_that_of_weighted_flights(weighed) -> None:
    """Means within 6 standard errors and 3 % of the spread for what is not linear."""
    problem, flight, x, _, fix, weight = weighed
    learnt = learn_at(problem, flight.x, STEP, fix)
    effective = 1.0 / (weight**2).sum()
    assert effective > 500
    mean = weight @ x[:, STEP]
    spread = np.sqrt(flight.cov[STEP, 0])
    sd = np.sqrt(np.diag(learnt.cov))
    assert (np.abs(mean - learnt.mean) < 6 * sd / np.sqrt(effective) + 0.03 * spread).all()
    off = x[:, STEP] - mean
    found = np.sqrt(weight @ off**2)
    assert found == pytest.approx(sd, rel=6 / np.sqrt(2 * effective) + 0.05)


def test_the_field_given_a_fix_is_that_of_weighted_flights(weighed) -> None:
    problem, flight, _, theta, fix, weight = weighed
    learnt = learn_at(problem, flight.x, STEP, fix)
    effective = 1.0 / (weight**2).sum()
    mean = np.einsum("n,ncm->cm", weight, theta)
    assert np.abs(learnt.theta).max() > 0.3
    assert np.abs(mean - learnt.theta).max() < 6 / np.sqrt(effective) + 0.05
    off = theta - mean
    found = np.einsum("n,ncm->cm", weight, off**2)
    assert np.abs(found - (1.0 - (learnt.told**2).sum(axis=0))).max() < 10 / np.sqrt(effective) + 0.05


def test_flights_of_the_conditioned_law_are_weighted_flights_gone_on(weighed) -> None:
    """Mean and spread at the end, where the prior mean would be several spreads off."""
    problem, flight, x, _, fix, weight = weighed
    learnt = learn_at(problem, flight.x, STEP, fix)
    moment = STEP * problem.motion.dt
    field = conditioned_field(field_from(smooth_wind(SCENE), moment), learnt.theta, learnt.told)
    scene = replace(SCENE, start=learnt.mean)
    robot = replace(ROBOT, start_sd=learnt.sd)
    later = make_problem("F a", scene, field, robot, LOOSE, fidelity="full")
    drawn = draw_flights(later, "coherent", 20_000, SeedSequence(6))
    gone_on = drawn.flown(np.ascontiguousarray(flight.u[STEP:]), np.ascontiguousarray(flight.x[STEP:]))
    effective = 1.0 / (weight**2).sum()
    mean, sd = weight @ x[:, -1], np.sqrt(weight @ (x[:, -1] - weight @ x[:, -1]) ** 2)
    assert (np.abs(gone_on[:, -1].mean(axis=0) - mean) < 7 * sd / np.sqrt(effective) + 0.15 * sd).all()
    ratio = gone_on[:, -1].std(axis=0) / sd
    assert (ratio > 0.85).all()
    assert (ratio < 1.25).all()
    assert np.linalg.norm(flight.x[-1] - mean) > 0.4 * np.sqrt(flight.cov[-1, 0])


@given(st.integers(0, 10_000), st.floats(0.1, 10.0))
def test_a_fix_without_worth_changes_nothing_and_an_exact_one_leaves_no_doubt(
    seed: int, scale: float
) -> None:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((2, 2))
    cov = scale**2 * (root @ root.T + 0.1 * np.eye(2))
    share = rng.standard_normal((4, 6))
    cross = (np.linalg.cholesky(cov) @ (share[:2] / np.linalg.norm(share))).reshape(2, 2, 3)
    x = rng.standard_normal(2)
    vague = learn(x, cov, cross, Fix(x + 1.0, 1e9 * scale))
    np.testing.assert_allclose(vague.mean, x, atol=1e-6)
    np.testing.assert_allclose(vague.cov, cov, rtol=1e-6)
    assert np.abs(vague.theta).max() < 1e-6
    assert np.abs(vague.told).max() < 1e-6
    exact = learn(x, cov, cross, Fix(x + 0.5, 1e-4 * scale))
    np.testing.assert_allclose(exact.mean, x + 0.5, atol=1e-3 * scale)
    assert exact.sd < 2e-4 * scale
    middle = learn(x, cov, cross, Fix(x, scale))
    np.testing.assert_allclose(middle.mean, x)
    assert np.trace(exact.cov) < np.trace(middle.cov) < np.trace(cov)


def test_histories_given_a_fix_end_at_the_fix(weighed) -> None:
    _, _, x, _, fix, weight = weighed
    noise = np.random.default_rng(3).standard_normal((4000, 2))
    moved = likely_histories(x[:4000, : STEP + 1], fix, noise)
    effective = 1.0 / (weight**2).sum()
    for t in (5, 10, STEP):
        wanted = weight @ x[:, t]
        sd = x[:, t].std(axis=0)
        assert (np.abs(moved[:, t].mean(axis=0) - wanted) < 7 * sd / np.sqrt(effective) + 0.05 * sd).all()


def test_states_are_read_step_by_step() -> None:
    problem = coherent_problem(formula="F a")
    inside, outside = np.full(2, 17e3), np.full(2, 2e3)
    x = np.array([[outside, inside, outside], [outside, outside, outside]])
    reached = states_reached(problem, x)
    assert problem.logic.distance[reached].tolist() == [0.0, 1.0]


# --- the field -----------------------------------------------------------------------------------


def test_what_is_learnt_fades_from_slot_to_slot_and_only_lessens_doubt() -> None:
    field = field_from(smooth_wind(SCENE), 0.0)
    modes = field.modes
    assert modes is not None
    count = len(modes.part)
    rng = np.random.default_rng(1)
    told = 0.9 * np.linalg.qr(rng.standard_normal((2 * count, 2)))[0].T.reshape(2, 2, count)
    theta = rng.standard_normal((2, count))
    after = conditioned_field(field, theta, told)
    assert after.modes is not None
    assert (after.latent_var <= field.latent_var + 1e-12).all()
    assert (after.latent_var >= 0.0).all()
    moved = [np.abs(after.mean[k] - field.mean[k]).mean() for k in range(len(field.times))]
    assert moved[0] > 0.0
    assert all(b <= a * 1.5 for a, b in pairwise(moved))
    root = less_doubt(told[:, 0], np.ones(count), modes.part)
    np.testing.assert_allclose(root @ root, np.eye(count) - told[:, 0].T @ told[:, 0], atol=1e-9)
    places = np.array([[5e3, 7e3], [11e3, 3e3]])
    before, later = (mode_values(m, 0, places) for m in (modes, after.modes))
    assert ((later**2).sum(axis=2) <= (before**2).sum(axis=2) + 1e-6).all()


def test_nothing_learnt_leaves_the_field_as_it_is() -> None:
    field = field_from(smooth_wind(SCENE), 0.0)
    assert field.modes is not None
    count = len(field.modes.part)
    same = conditioned_field(field, np.zeros((2, count)), np.zeros((2, 2, count)))
    np.testing.assert_array_equal(same.mean, field.mean)
    np.testing.assert_allclose(same.latent_var, field.latent_var)
    assert same.modes is not None
    np.testing.assert_allclose(same.modes.psi, field.modes.psi)


def test_a_later_clock_has_the_slots_from_then_on() -> None:
    field = smooth_wind(SCENE)
    moment = float(field.times[-1]) - 1.0
    later = field_from(field, moment)
    assert later.times[0] <= 0.0
    assert later.known_until == pytest.approx(field.known_until - moment)
    np.testing.assert_array_equal(later.mean[-1], field.mean[-1])
