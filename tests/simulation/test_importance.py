"""Importance sampling of rare failures: weights, half-spaces and rates, each on two roads."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.special import ndtr
from scipy.stats import binom, binomtest, norm

from coherent import SCENE, STEPS, coherent_problem
from landmarks import LANDMARK_WAY, landmark_problem
from oracle import importance as plain
from pareto_ltl.extend import simulate_flights
from pareto_ltl.kernels import importance as kernel
from pareto_ltl.kernels.flight import link_fields
from pareto_ltl.planning.evaluate import cross_covariance, evaluate_path, propagate
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.rates import FLIGHTS, WEIGHTED, FailureRate
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.settings import PlannerConfig, RobotConfig, preset
from pareto_ltl.simulation import failure_modes, importance
from pareto_ltl.simulation import promise as promises
from pareto_ltl.simulation.promise import RARE, count_agrees, fresh_rate
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.seeds import unspawned
from problems import KM, QUICK_ERROR, along, box, make_problem, make_scene, smooth_wind, steady_wind

LOOSE = PlannerConfig(epsilon=0.999, delta=0.999)
ALOE = importance.Ladder(np.ones(1), np.ones(1), 0.0)  # the mixture of the paper: exact in the linearised law
CHANCE = 1e-6  # at which a statistical test may fail
MAP = {"a": box(13, 13, 19, 19), "b": box(2, 13, 7, 18), "h": box(7.5, 7.5, 10, 10)}
BLOCKS = [box(8, 1, 12, 5.5), box(9, 15, 11, 20)]


def task(
    formula: str, corners: tuple[tuple[float, float], ...], law: str = "coherent", border: str = "open",
    feedback: float | None = None, u_max: float = 25.0, **wind: float,
) -> tuple[Problem, PlannedPath]:  # fmt: skip
    """A plan along ``corners`` [km] in curved winds, and what it is to do."""
    scene = replace(make_scene(MAP, BLOCKS, start=corners[0]), border=border)
    models = replace(preset("full"), law=law, border=border)
    robot = RobotConfig(dt=100.0, u_max=u_max, start_sd=50.0, feedback_time=feedback)
    problem = make_problem(formula, scene, smooth_wind(scene, **wind), robot, LOOSE, fidelity=models)
    return problem, evaluate_path(problem, along(*corners, step=0.8), "by hand")


def tasks() -> dict[str, tuple[Problem, PlannedPath]]:
    """Plans that fail in 0.2 to 4 % of the flights, each in its own way."""
    sweep = ((2, 3), (6.5, 6.5), (11, 11), (15, 16), (18, 17), (16.5, 14))
    tour = ((2, 3), (6, 8), (4.5, 15), (8, 13), (12.5, 13), (16, 16))
    return {
        "coherent": task("F a", ((2, 3), (6, 8), (11, 12), (16, 16)), sd=0.42, gust=0.3),
        "sweep": task("F a", sweep, sd=0.7, gust=0.3),
        "wall": task("F b & F a", tour, border="wall", sd=0.3, gust=0.4),
        "forbidden": task("!h U a", ((2, 3), (5.5, 9.5), (9, 12), (16, 16)), sd=0.25, gust=0.3),
        "choice": task("F(a & F b) | F(b & F a)", tour, sd=0.28, gust=0.3),
        "feedback": task("F a", (*sweep[:3], (16, 16)), feedback=1950.0, sd=0.8, gust=0.5),
        "independent": task("F b & F a", tour, "independent", sd=1.0, gust=1.2),
        # held on its path, but too slow for a head wind that lasts
        "too slow": task("F a", (*sweep[:3], (16, 16)), feedback=300.0, u_max=10.0, sd=1.3, gust=0.1),
    }


TASKS = tasks()


def proposal_of(name: str, ladder: importance.Ladder = importance.LADDER) -> importance.Proposal:
    problem, path = TASKS[name]
    proposal = importance.make_proposal(problem, path, ladder)
    assert proposal is not None
    return proposal


def drawn(proposal: importance.Proposal, n: int, seed: int) -> tuple[kernel.NormalDraws, FloatArray]:
    """z of ``n`` flights and their linear deviations."""
    z, _, _ = importance.draw_proposal(proposal, np.ones(n), np.random.default_rng(seed))
    theta = z.field.copy()
    link_fields(proposal.plan.linear.kept, theta)
    return z, failure_modes.linear_deviations(proposal.plan.linear, z, theta)


# --- the linear law and its half-spaces ------------------------------------------------------------


@pytest.mark.parametrize("name", ["coherent", "feedback", "independent"])
def test_linear_deviations_and_directions_are_those_of_a_matrix(name):
    """The recursion of deviations, the adjoint recursion and M z agree."""
    proposal = proposal_of(name)
    z, e = drawn(proposal, 40, seed=1)
    M = plain.deviation_map(proposal.plan.linear)
    rows = plain.joined(z)
    scale = np.abs(e).max()
    np.testing.assert_allclose(e, np.einsum("tid,nd->nti", M, rows), atol=2e-5 * scale)
    omega = plain.half_space_directions(proposal.plan.linear, proposal.modes.weight)
    np.testing.assert_allclose(np.linalg.norm(omega, axis=1), 1.0, atol=1e-6)
    parts = [part.reshape(len(part), -1) for part in proposal.directions]
    np.testing.assert_allclose(np.hstack(parts), omega, atol=1e-6)


@pytest.mark.parametrize("error", [None, QUICK_ERROR])
def test_the_covariance_of_deviations_is_the_planned_one(error):
    """M M' against the recursion of Cov(e_t, e_s) in the propagation, over epochs of all parts."""
    p = coherent_problem(hours=0.25, rho=0.6, error=error)
    law = failure_modes.SMOOTH_LAWS["coherent"](p)
    flight = propagate(p, STEPS, law)
    M = plain.deviation_map(failure_modes.linear_law(p, flight, law))
    cross = cross_covariance(law, flight)
    for t in (0, 5, 17, len(STEPS) - 1):
        for s in (0, 3, t // 2, t):
            expected = cross[t, min(s, t)]
            np.testing.assert_allclose(M[t] @ M[min(s, t)].T, expected, atol=1e-4 * flight.cov.max())


@pytest.mark.parametrize("name", list(TASKS))
def test_most_failures_lie_near_a_half_space(name):
    """Of nonlinear flights drawn far around the half-spaces; want of airspeed is no linear event."""
    proposal = proposal_of(name)
    z, e = drawn(proposal, 3000, seed=2)
    reached = np.einsum("jti,nti->nj", proposal.modes.weight, e)
    covered = (reached >= 0.9 * proposal.modes.threshold).any(axis=1)
    fails = proposal.plan.fly(z, failure_modes.linked_fields(proposal.plan.linear, z))[1]
    assert fails.sum() > 300
    assert (~covered).sum() > 300
    assert covered[fails].mean() > (0.85 if name == "too slow" else 0.95)


def union_bound(proposal):
    """Σ_j Φ(-τ_j), Eq. (M65)."""
    return float(ndtr(-proposal.modes.threshold).sum())


def test_half_spaces_of_several_events_bring_the_bound_down_to_the_rate():
    """A region is swept in several steps; V charges the visit at one of them."""
    problem, path = TASKS["sweep"]
    rate = importance.weighted_rate(problem, path, 4000, SeedSequence(3)).failure
    bound = union_bound(proposal_of("sweep"))
    risk = path.objectives.mission_risk + path.objectives.collision_risk
    assert rate < bound < 0.95 * risk


@pytest.mark.parametrize("name", list(TASKS))
def test_along_each_direction_flights_fail_from_the_threshold_on(name):
    """Nonlinear flights, just before and just behind it; and no two half-spaces are nearly parallel."""
    proposal = proposal_of(name)
    plan, modes = proposal.plan, proposal.modes
    rows = np.arange(len(modes))
    assert plan.fly_along(proposal.directions, rows, modes.threshold * (1 + 1e-6)).all()
    assert not plan.fly_along(proposal.directions, rows, modes.threshold * (1 - 1e-6)).any()
    omega = plain.half_space_directions(plan.linear, modes.weight)
    assert (np.tril(omega @ omega.T, -1) <= failure_modes.ALIKE + 1e-6).all()
    assert (np.diff(modes.threshold) >= 0.0).all()


def test_forms_are_those_of_deviations_with_less_feedback():
    """Against deviations that are propagated with a share of the feedback, from the same winds."""
    plan = proposal_of("feedback").plan
    _, e = drawn(proposal_of("feedback"), 30, seed=11)
    F, normals = plan.linear.F, np.random.default_rng(12).standard_normal((3, *plan.mean.shape))
    forms = failure_modes.less_held_forms(plan, normals, failure_modes.FEEDBACK).reshape(
        len(failure_modes.FEEDBACK), *normals.shape
    )
    for form, share in zip(forms, failure_modes.FEEDBACK, strict=True):
        free = e.copy()
        for t in range(len(F)):
            wind = e[:, t + 1] - e[:, t] @ F[t].T
            free[:, t + 1] = free[:, t] @ (np.eye(2) + share * (F[t] - np.eye(2))).T + wind
        expected = np.einsum("kti,nti->kn", normals, free)
        np.testing.assert_allclose(
            np.einsum("kti,nti->kn", form, e), expected, atol=1e-8 * np.abs(expected).max()
        )


# --- weights --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["coherent", "sweep", "independent"])
def test_densities_are_those_of_the_components(name):
    proposal = proposal_of(name)
    _, e = drawn(proposal, 500, seed=3)
    density = np.empty(500)
    scale = np.linspace(0.5, 4.0, 500)
    kernel.mixture_density(proposal.mixture(scale, proposal.chances(scale)), e, density)
    reached = np.einsum("jti,nti->nj", proposal.modes.weight, e)
    for i, c in enumerate(scale):
        expected = plain.proposal_density(reached[i : i + 1], proposal.modes.threshold / c, *proposal.ladder)
        assert density[i] == pytest.approx(expected[0], rel=1e-9)
    assert len(np.unique(density)) > 50


@pytest.mark.parametrize("name", ["coherent", "feedback"])
def test_drawn_densities_are_those_of_the_draws(name):
    proposal = proposal_of(name)
    scale = np.linspace(0.5, 4.0, 200)
    z, _, density = importance.draw_proposal(proposal, scale, np.random.default_rng(4))
    e = failure_modes.linear_deviations(
        proposal.plan.linear, z, failure_modes.linked_fields(proposal.plan.linear, z)
    )
    reached = np.einsum("jti,nti->nj", proposal.modes.weight, e)
    expected = [
        plain.proposal_density(row[None], proposal.modes.threshold / c, *proposal.ladder)[0]
        for row, c in zip(reached, scale, strict=True)
    ]
    np.testing.assert_allclose(density, expected, rtol=1e-9)
    # a share of 1 - α is pushed into a half-space of the lowest level or a higher one
    inside = reached >= proposal.ladder.level[-1] * proposal.modes.threshold / scale[:, None] - 1e-5
    assert inside.any(axis=1).sum() >= 150


def test_flights_whose_errors_hardly_count_have_finite_draws_and_densities() -> None:
    """Half-spaces are hundreds of their deviations away: their chances round to 0."""
    proposal = proposal_of("feedback")
    n = 400
    with np.errstate(all="raise", under="ignore"):
        z, theta, density = importance.draw_proposal(proposal, np.full(n, 1e-3), np.random.default_rng(5))
    for part in (*z, theta, density):
        assert np.isfinite(part).all()
    assert (density >= proposal.ladder.plain).all()


def test_headwinds_are_the_way_by_which_steady_winds_set_a_robot_back():
    u = np.array([[3.0, 4.0], [5.0, 0.0], [0.0, -2.0], [1.0, 0.0]])
    forms = failure_modes.headwinds(u)
    ahead = u / np.linalg.norm(u, axis=1, keepdims=True)
    winds = np.random.default_rng(1).standard_normal((4, 2))
    free = np.vstack([np.zeros(2), np.cumsum(winds, axis=0)])  # deviations without feedback
    back = [-(ahead[a:b] * winds[a:b]).sum() for a, b in ((0, 3), (1, 4), (0, 4))]
    np.testing.assert_allclose(np.einsum("kti,ti->k", forms, free), back, atol=1e-12)


def test_draws_are_pushed_into_their_half_space_and_left_alone_beside_it():
    proposal = proposal_of("coherent")
    n, modes = 60, len(proposal.modes)
    z, _ = drawn(replace(proposal, ladder=importance.Ladder(np.ones(1), np.zeros(1), 1.0)), n, seed=4)
    before = plain.joined(z)
    event = np.arange(n) % (modes + 1) - 1
    size = np.linspace(0.0, 6.0, n)
    kernel.push_draws(proposal.directions, event, size, z)
    after, omega = plain.joined(z), plain.half_space_directions(proposal.plan.linear, proposal.modes.weight)
    for i in range(n):
        moved = after[i] - before[i]
        if event[i] < 0:
            assert not moved.any()
        else:
            own = omega[event[i]]
            assert after[i] @ own == pytest.approx(size[i], abs=1e-5)
            np.testing.assert_allclose(moved, (moved @ own) * own, atol=1e-5)


@pytest.mark.statistical
def test_draws_have_the_law_of_their_half_spaces():
    """Along ω a truncated normal, across it a standard normal; each half-space in proportion to Φ(-τ)."""
    proposal = proposal_of("coherent", ALOE)
    n = 20_000
    z, e = drawn(proposal, n, seed=5)
    reached = np.einsum("jti,nti->nj", proposal.modes.weight, e)
    tau = proposal.modes.threshold
    inside = reached >= tau
    assert inside.any(axis=1).all()
    chance = norm.sf(tau)
    # E_q[1{in j} / S] = Φ(-τ_j) / Σ Φ(-τ) exactly
    share = (inside / inside.sum(axis=1, keepdims=True)).mean(axis=0)
    np.testing.assert_allclose(share, chance / chance.sum(), atol=5.5 * 0.5 / math.sqrt(n))
    rows = plain.joined(z)
    omega = plain.half_space_directions(proposal.plan.linear, proposal.modes.weight)
    across = rows - (rows @ omega.T) @ np.linalg.pinv(omega.T)  # the part in no half-space's direction
    left = rows.shape[1] - np.linalg.matrix_rank(omega)
    assert (across**2).sum() / (n * left) == pytest.approx(1.0, abs=6 * math.sqrt(2 / (n * left)))


def test_the_mixture_of_the_paper_never_exceeds_the_union_bound():
    for name in TASKS:
        proposal = proposal_of(name, ALOE)
        weights, _ = importance.weighted_flights(proposal, 500, SeedSequence(6))
        bound = union_bound(proposal)
        assert weights.max() <= bound * (1 + 1e-12)
        assert weights.mean() <= bound * (1 + 1e-12)
        assert weights.min() >= bound / len(proposal.modes) * (1 - 1e-12)


def test_no_weight_exceeds_what_plain_flights_allow():
    proposal = proposal_of("coherent")
    weights, _ = importance.weighted_flights(proposal, 5000, SeedSequence(7))
    assert weights.max() <= 1 / importance.LADDER.plain
    assert weights.mean() == pytest.approx(1.0, abs=6 * weights.std() / math.sqrt(len(weights)))


# --- rates ----------------------------------------------------------------------------------------


def straight(offset: float, sigma: float = 3.0, law: str = "independent") -> tuple[Problem, PlannedPath]:
    """East in an even wind into the half plane x >= 15 km, ``offset`` deviations deep at the last step.

    The step before ends 10 deviations short of it, and everything else is far: P(fail) = Φ(-offset).
    """
    scene = make_scene({"a": box(15, 0, 40, 40)}, start=(2.0, 20.0), side=40.0)
    robot = RobotConfig(dt=100.0, u_max=40.0)
    models = replace(preset("full"), law=law, border="open")
    wind = steady_wind(scene, gust=(1.0, 1.0))
    problem = make_problem("F a", scene, wind, robot, LOOSE, fidelity=models)
    sd = math.sqrt(8) * 100.0
    end = 15 * KM + offset * sd
    x = np.column_stack([np.linspace(2 * KM, end, 9), np.full(9, 20 * KM)])
    return problem, evaluate_path(problem, x, "by hand")


@pytest.mark.parametrize("offset", [2.0, 4.0, 5.5])
def test_one_half_space_is_exact(offset):
    """Every draw fails and weighs the same: the rate is Φ(-τ) without sampling error. With lowered thresholds
    it has one, and stays unbiased."""
    problem, path = straight(offset)
    proposal = importance.make_proposal(problem, path, ALOE)
    assert proposal is not None
    weights, failed = importance.weighted_flights(proposal, 400, SeedSequence(0))
    assert failed.all()
    assert weights == pytest.approx(norm.sf(offset), rel=1e-6)
    proposal = replace(proposal, ladder=importance.LADDER)
    weights, failed = importance.weighted_flights(proposal, 4000, SeedSequence(1))
    weighted = np.where(failed, weights, 0.0)
    low, high = importance.weighted_interval(weighted, proposal.ladder.plain, 1 - CHANCE)
    assert low <= norm.sf(offset) <= high < 1.8 * low


@pytest.mark.statistical
@pytest.mark.parametrize("name", list(TASKS))
def test_rates_are_those_of_plain_flights(name):
    """Nonlinear flights both; a normal deviate of 5.3 is exceeded with a chance of 1e-7."""
    problem, path = TASKS[name]
    law, runs, draws = problem.fidelity.law, 40_000, 6000
    plain_rate = float(simulate_flights(problem, path.u, runs, law, SeedSequence(1), path.x).failed.mean())
    proposal = proposal_of(name)
    weights, failed = importance.weighted_flights(proposal, draws, SeedSequence(2))
    weighted = np.where(failed, weights, 0.0)
    rate, error = weighted.mean(), weighted.std() / math.sqrt(draws)
    assert error < 0.06 * rate
    assert abs(rate - plain_rate) < 5.3 * math.hypot(error, math.sqrt(rate * (1 - rate) / runs))
    found = importance.weighted_rate(problem, path, draws, SeedSequence(2))
    assert found == FailureRate(law, found.failure, found.low, found.high, draws, WEIGHTED)
    assert found.failure == pytest.approx(rate)
    assert found.low < rate < found.high


@pytest.mark.statistical
def test_intervals_hold_the_rate_as_often_as_they_say():
    """400 intervals for a rate that is known exactly, from as few as 40 draws."""
    problem, path = straight(3.0)
    proposal = importance.make_proposal(problem, path)
    assert proposal is not None
    for draws in (40, 400):
        weights, failed = importance.weighted_flights(proposal, 400 * draws, SeedSequence(3))
        rows = np.where(failed, weights, 0.0).reshape(400, draws)
        ends = np.array([importance.weighted_interval(row, importance.LADDER.plain) for row in rows])
        missed = int(((ends[:, 0] > norm.sf(3.0)) | (ends[:, 1] < norm.sf(3.0))).sum())
        assert binom.sf(missed - 1, 400, 0.05) > CHANCE
        assert (ends[:, 1] - ends[:, 0]).mean() < norm.sf(3.0) * (3.0 if draws == 40 else 0.5)


@settings(deadline=None, max_examples=30)
@given(st.integers(-900, 0))
def test_intervals_of_very_small_weights_scale(power):
    """Squares of weights below 1e-154 are 0."""
    weights = np.random.default_rng(0).uniform(0.0, 1.0, 200) * (np.arange(200) % 3 == 0)
    ends = importance.weighted_interval(weights, 0.1)
    scaled = importance.weighted_interval(weights * 2.0**power, 0.1)
    assert scaled == (ends[0] * 2.0**power, ends[1] * 2.0**power)


def test_an_interval_without_failures_is_that_of_the_plain_flights_among_the_draws():
    low, high = importance.weighted_interval(np.zeros(1000), 0.1)
    assert low == 0.0
    assert high == pytest.approx(-math.log(0.025) / 100.0)  # 100 flights, none of which fails


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 60), st.floats(1e-6, 1.0), st.integers(100, 2000))
def test_intervals_of_equal_weights_are_those_of_counts(hits, weight, draws):
    """Against the quantiles of Poisson counts; two more of them above."""
    from scipy.stats import gamma

    weights = np.zeros(draws)
    weights[:hits] = weight
    low, high = importance.weighted_interval(weights, 0.1)
    share = 1 - hits / draws  # v is the variance of a binomial count
    assert low == pytest.approx(min(weight / draws * share * gamma.ppf(0.025, hits / share), 1.0))
    above, spread = hits + 2, hits * share + 4
    assert high == pytest.approx(weight / draws * spread / above * gamma.ppf(0.975, above**2 / spread))


def test_the_same_seed_gives_the_same_rate_whatever_the_threads(monkeypatch):
    problem, path = TASKS["wall"]
    seed = SeedSequence(8)
    first = importance.weighted_rate(problem, path, 900, seed)
    seed.spawn(2)
    for count in ("1", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", count)
        assert importance.weighted_rate(problem, path, 900, seed) == first
    assert importance.weighted_rate(problem, path, 900, SeedSequence(9)) != first


@pytest.mark.parametrize("u_min", [0.0, 6.0])
def test_tailwinds_are_looked_for_if_the_robot_cannot_brake(monkeypatch, u_min):
    """After a leg with a tailwind it is too far ahead, and turns too late: without a pilot that shows it."""
    corners = ((2.0, 3.0), (14.5, 3.0), (15.5, 16.0))
    scene = replace(make_scene({"a": MAP["a"]}, [box(17, 0, 20, 9)], start=corners[0]), border="open")
    robot = RobotConfig(dt=100.0, u_max=40.0, u_min=u_min, start_sd=50.0, feedback_time=300.0)
    wind = smooth_wind(scene, sd=1.3, gust=0.1)
    problem = make_problem("F a", scene, wind, robot, LOOSE, fidelity=replace(preset("full"), border="open"))
    path = evaluate_path(problem, along(*corners, step=0.8), "by hand")
    plan = failure_modes.flown_plan(problem, path)
    monkeypatch.setattr(failure_modes, "_first_failures", lambda plan: np.empty((0, *plan.mean.shape)))
    modes = failure_modes.find_failure_modes(plan)
    assert 3.5 < modes.threshold[0] < 4.8 if u_min else modes.threshold[0] > 7.0  # a headwind


@pytest.mark.statistical
def test_few_flights_have_a_promise_of_enough_weighted_ones():
    """With 20 weighted flights under a law with tails, 6 % of the intervals end below a tenth of the rate."""
    problem, path = straight(4.0)
    rate = fresh_rate(problem, path, 20, SeedSequence(4))
    assert (rate.runs, rate.method) == (importance.LEAST_DRAWS, WEIGHTED)
    assert rate.low / 2 < norm.sf(4.0) < 2 * rate.high


# --- where there is nothing to sample by ----------------------------------------------------------


@pytest.mark.parametrize("law", ["coherent", "independent"])
def test_a_law_without_variance_is_flown_as_it_is(law):
    problem, path = straight(2.0, law=law)
    still = make_problem(
        "F a", problem.scene, steady_wind(problem.scene, gust=(0.0, 0.0)), RobotConfig(dt=100.0, u_max=40.0),
        LOOSE, fidelity=problem.fidelity,
    )  # fmt: skip
    assert importance.weighted_rate(still, path, 100, SeedSequence(0)) is None
    assert fresh_rate(still, path, 100, SeedSequence(0)) == FailureRate.counted(law, 0, 100)
    short = replace(path, x=path.x[:-1], u=path.u[:-1])
    assert importance.weighted_rate(still, short, 100, SeedSequence(0)) is None


def test_a_plan_that_misses_its_region_is_flown_as_it_is():
    problem, path = straight(-0.5)
    assert importance.weighted_rate(problem, path, 2000, SeedSequence(0)) is None


def test_a_start_in_the_region_needs_no_step():
    scene = make_scene({"a": box(1, 1, 4, 4)}, start=(2.0, 2.0))
    problem = coherent_problem(scene)
    path = evaluate_path(problem, scene.start[None], "by hand")
    assert importance.weighted_rate(problem, path, 100, SeedSequence(0)) is None
    assert fresh_rate(problem, path, 100, SeedSequence(0)) == FailureRate.counted("coherent", 0, 100)


def test_a_plan_that_outlasts_the_wind_and_too_few_draws_are_refused():
    problem, path = TASKS["coherent"]
    with pytest.raises(ValueError, match="at least one draw, got draws = 0"):
        importance.weighted_rate(problem, path, 0, SeedSequence(0))
    longer = np.vstack([path.u] * 200)
    outlasting = replace(path, u=longer, x=np.vstack([path.x[:1]] * (len(longer) + 1)))
    known = coherent_problem(SCENE, until=1800.0)
    with pytest.raises(InfeasibleError, match="outlasts the wind"):
        importance.weighted_rate(known, outlasting, 10, SeedSequence(0))


# --- what is promised -----------------------------------------------------------------------------


def test_the_promise_of_a_plan_that_seldom_fails_is_weighted(caplog):
    rate = fresh_rate(*straight(4.0), 3000, SeedSequence(4))
    assert (rate.law, rate.method, rate.runs) == ("independent", WEIGHTED, 3000)
    assert rate.failure == pytest.approx(norm.sf(4.0), rel=0.2)  # six standard errors
    assert rate.high < 1.25 * rate.low
    assert fresh_rate(*straight(4.0), 3000, SeedSequence(4)) == rate
    often = fresh_rate(*straight(2.0), 3000, SeedSequence(4))
    assert often.method == FLIGHTS
    assert often.failure > RARE
    assert not caplog.text


def test_weighted_flights_never_draw_from_the_seed_of_the_plain_ones(monkeypatch):
    """Else both would be wrong alike, and the count could not contradict the weighted rate."""
    seeds = dict[str, SeedSequence]()

    def count(problem, path, runs, seed):
        seeds["plain"] = seed
        return 0

    def weigh(problem, path, draws, seed):
        seeds["weighted"] = seed

    monkeypatch.setattr(promises, "count_failures", count)
    monkeypatch.setattr(importance, "weighted_rate", weigh)
    fresh_rate(*straight(4.0), 5000, SeedSequence(4, spawn_key=(7,)))
    states = [
        tuple(child.generate_state(4))
        for seed in seeds.values()
        for child in (seed, *unspawned(seed).spawn(5000))
    ]
    assert len(set(states)) == len(states) == 2 * 5001


def test_a_count_that_contradicts_the_weighted_rate_is_what_is_promised(caplog, monkeypatch):
    monkeypatch.setattr(promises, "count_failures", lambda *_: 4)
    rate = fresh_rate(*straight(4.0), 5000, SeedSequence(4))
    assert rate == FailureRate.counted("independent", 4, 5000)
    assert "does not agree with 5000 fresh ones in independent winds" in caplog.text


def test_without_half_spaces_the_count_is_what_is_promised(monkeypatch):
    problem = landmark_problem()
    path = evaluate_path(problem, LANDMARK_WAY, "by hand")
    monkeypatch.setattr(promises, "count_failures", lambda *_: 1)
    assert fresh_rate(problem, path, 5000, SeedSequence(4)) == FailureRate.counted("coherent", 1, 5000)


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 40), st.integers(1000, 20_000), st.floats(1e-6, 1e-3), st.floats(1.0, 3.0))
def test_counts_agree_with_rates_that_explain_them(failures, runs, low, wider):
    weighted = FailureRate("coherent", low, low, low * wider, runs, WEIGHTED)
    within = binomtest(failures, runs, low * wider, alternative="greater").pvalue >= 1e-3
    within &= binomtest(failures, runs, low, alternative="less").pvalue >= 1e-3
    assert count_agrees(FailureRate.counted("coherent", failures, runs), weighted) == within
