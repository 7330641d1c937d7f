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
from pareto_ltl.extend import draw_flights
from pareto_ltl.kernels.data import EXACT
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.settings import RobotConfig
from pareto_ltl_apps.conditioning import Fix, Joint, Learnt, learn
from pareto_ltl_apps.flight.position_fixes import likely_histories
from problems import QUICK_ERROR, make_problem, smooth_wind
from wind_laws.conditioned import conditioned_field, field_from, less_doubt
from wind_laws.lattice import lattice_values
from wind_laws.records import HELD, TIME

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
    fix = Fix(flight.x[STEP] + spread * np.array([0.8, -0.6]), 0.3 * spread, STEP)
    gap = (x[:, STEP] - fix.place) / fix.sd
    weight = np.exp(-0.5 * (gap**2).sum(axis=1))
    theta = drawn.draws.theta[problem.modes.epoch[STEP]].astype(float)
    return problem, flight, x, theta, fix, weight / weight.sum()


def test_the_position_given_a_fix_is_that_of_weighted_flights(weighed) -> None:
    """Means within 6 standard errors and 3 % of the spread for what is not linear."""
    problem, flight, x, _, fix, weight = weighed
    learnt = Learnt.at(problem, flight.x, STEP, [fix])
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
    learnt = Learnt.at(problem, flight.x, STEP, [fix])
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
    learnt = Learnt.at(problem, flight.x, STEP, [fix])
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
    prior = Joint(x, cov, cov, cov, cross, np.zeros((2, 0)), np.zeros((2, 0)), EXACT)

    def given(off: float, sd: float) -> Learnt:
        return learn(prior, x[None], [Fix(x + off, sd, 3)])

    vague = given(1.0, 1e9 * scale)
    np.testing.assert_allclose(vague.mean, x, atol=1e-6)
    np.testing.assert_allclose(vague.cov, cov, rtol=1e-6)
    assert np.abs(vague.theta).max() < 1e-6
    assert np.abs(vague.told).max() < 1e-6
    exact = given(0.5, 1e-4 * scale)
    np.testing.assert_allclose(exact.mean, x + 0.5, atol=1e-3 * scale)
    assert exact.sd < 2e-4 * scale
    middle = given(0.0, scale)
    np.testing.assert_allclose(middle.mean, x)
    assert np.trace(exact.cov) < np.trace(middle.cov) < np.trace(cov)


def test_histories_given_a_fix_end_at_the_fix(weighed) -> None:
    _, _, x, _, fix, weight = weighed
    noise = np.random.default_rng(3).standard_normal((4000, 2))
    moved = likely_histories(x[:4000, : STEP + 1], [fix], noise)
    effective = 1.0 / (weight**2).sum()
    for t in (5, 10, STEP):
        wanted = weight @ x[:, t]
        sd = x[:, t].std(axis=0)
        assert (np.abs(moved[:, t].mean(axis=0) - wanted) < 7 * sd / np.sqrt(effective) + 0.05 * sd).all()


def test_states_are_read_step_by_step() -> None:
    problem = coherent_problem(formula="F a")
    inside, outside = np.full(2, 17e3), np.full(2, 2e3)
    x = np.array([[outside, inside, outside], [outside, outside, outside]])
    reached = np.array([problem.states(flight)[-1] for flight in x])
    assert problem.logic.distance[reached].tolist() == [0.0, 1.0]


# --- a held field ----------------------------------------------------------------------------------

HOUR = 3600.0
SLOW_ERROR = replace(
    QUICK_ERROR, leads=np.array([0.0, 10 * HOUR]), forecast_sd=np.array([0.01, 0.04]),
    persistence_time=6 * HOUR, lags=np.array([3 * HOUR, 9 * HOUR]), change_sd=np.array([0.06, 0.10]),
)  # fmt: skip
SLOW = RobotConfig(dt=1800.0, u_max=1.1, start_sd=50.0)


@pytest.fixture(scope="module")
def held():
    """40,000 flights of 17.5 h in a field that is held after 1 h: most of their error is its change."""
    wind = smooth_wind(
        SCENE, speed=0.15, sd=0.05, gust=0.02, slots=2, hours=1.0, error=SLOW_ERROR, until=24 * HOUR
    )
    wind = replace(wind, gust_time=1800.0, leads=np.zeros(2))
    problem = make_problem("F a", SCENE, wind, SLOW, LOOSE, fidelity="full")
    flight = propagate(problem, STEPS)
    x = draw_flights(problem, "coherent", RUNS, SeedSequence(5)).flown(flight.u, flight.x)
    return problem, wind, flight, x


def fixes_off(flight, *rows: tuple[int, float, float]) -> list[Fix]:
    """Fixes at steps, so many standard deviations off the mean."""
    spread = np.sqrt(flight.cov[:, 0])
    return [Fix(flight.x[t] + spread[t] * np.array([a, b]), 0.2 * spread[t], t) for t, a, b in rows]


def weights_given(x, fixes: list[Fix]):
    """Weights of flights by their likelihood given fixes, and their effective number."""
    weight = np.exp(-0.5 * sum(((x[:, f.step] - f.place) ** 2).sum(axis=1) / f.sd**2 for f in fixes))
    weight /= weight.sum()
    return weight, 1.0 / (weight**2).sum()


@pytest.mark.parametrize("rows", [[(15, 0.8, -0.6)], [(10, 0.8, -0.6), (20, 1.0, -0.3)]])
def test_fixes_tell_of_the_change_of_a_held_field(held, rows: list[tuple[int, float, float]]) -> None:
    """Flights of the conditioned law have mean and spread of weighted ones; prior ones are far off."""
    _, wind, flight, x = held
    problem, fixes = held[0], fixes_off(flight, *rows)
    weight, effective = weights_given(x, fixes)
    assert effective > 200
    step = fixes[-1].step
    learnt = Learnt.at(problem, flight.x, step, fixes)
    spread = np.sqrt(flight.cov[step, 0])
    assert (np.abs(weight @ x[:, step] - learnt.mean) < 0.03 * spread).all()
    field = conditioned_field(field_from(wind, step * SLOW.dt), learnt.theta, learnt.told)
    assert field.held == pytest.approx(HOUR - step * SLOW.dt)
    assert field.modes is not None
    assert (field.modes.part == HELD).any()
    assert not (field.modes.part == TIME).any()
    scene, robot = replace(SCENE, start=learnt.mean), replace(SLOW, start_sd=learnt.sd)
    later = make_problem("F a", scene, field, robot, LOOSE, fidelity="full")
    drawn = draw_flights(later, "coherent", 20_000, SeedSequence(6))
    gone_on = drawn.flown(np.ascontiguousarray(flight.u[step:]), np.ascontiguousarray(flight.x[step:]))
    for k in (5, 10, 35 - step):
        mean = weight @ x[:, step + k]
        sd = np.sqrt(weight @ (x[:, step + k] - mean) ** 2)
        off = np.abs(gone_on[:, k].mean(axis=0) - mean) / sd
        assert (off < 6 / np.sqrt(effective) + 0.1).all()
        ratio = gone_on[:, k].std(axis=0) / sd
        assert (ratio > 0.85).all()
        assert (ratio < 1.2).all()
    assert np.sqrt(flight.cov[-1, 0]) > 1.5 * sd[0]


def test_the_distance_of_fixes_has_the_distribution_of_the_law(held) -> None:
    """Two fixes of simulated flights: P(distance > r) = exp(-r²/2), each given the fixes before it."""
    problem, _, flight, x = held
    rng, rows = np.random.default_rng(8), ((10, 0.0, 0.0), (20, 0.0, 0.0))
    plain = fixes_off(flight, *rows)
    far = np.array([
        Learnt.at(problem, flight.x, 20, [
            Fix(one[f.step] + f.sd * rng.standard_normal(2), f.sd, f.step) for f in plain
        ]).distance
        for one in x[:300]
    ])  # fmt: skip
    for distances in far.T:
        for r in (1.0, 2.0):
            share = np.exp(-0.5 * r * r)
            assert abs((distances > r).mean() - share) < 5.5 * np.sqrt(share * (1 - share) / 300) + 0.02


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
    root = less_doubt(told[:, 0])
    np.testing.assert_allclose(root @ root, np.eye(count) - told[:, 0].T @ told[:, 0], atol=1e-9)
    places = np.array([[5e3, 7e3], [11e3, 3e3]])
    before, later = (lattice_values(m, m.psi[0], places) for m in (modes, after.modes))
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


@pytest.mark.parametrize("sd", [1e-4, 0.01])
@pytest.mark.parametrize("many", [2, 200])
def test_equal_fixes_that_are_far_more_accurate_than_the_prior_are_learnt(sd: float, many: int) -> None:
    """Without a floor of their variances the rounding of the covariance makes it indefinite."""
    root = np.random.default_rng(0).standard_normal((2, 2)) * 1e5
    cov = root @ root.T
    prior = Joint(
        np.zeros(2),
        cov,
        np.tile(cov, (many, many)),
        np.tile(cov, (1, many)),
        np.zeros((2 * many, 2, 3)),
        np.zeros((2 * many, 0)),
        np.zeros((2, 0)),
        EXACT,
    )
    learnt = learn(prior, np.zeros((many, 2)), [Fix(np.array([1.0, 2.0]), sd, 3)] * many)
    np.testing.assert_allclose(learnt.mean, [1.0, 2.0], atol=1e-3)
    assert learnt.sd < 0.5
