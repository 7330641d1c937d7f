"""The coherent wind law: kernels against the reference, the Gaussian against nonlinear flights, V and R."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.special import owens_t
from scipy.stats import beta as beta_law

from pareto_ltl.kernels import mission_risk as ordered
from pareto_ltl.kernels import path as path_kernel
from pareto_ltl.kernels.data import Labelled
from pareto_ltl.planning import problem
from pareto_ltl.planning import reference as risk
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.simulation import flights as deployment
from pareto_ltl.support.errors import InfeasibleError
from problems import KM, box, make_problem, make_scene, smooth_wind

few = settings(deadline=None, max_examples=15)
RARE = 1e-6  # chance at which a statistical test may fail
SCENE = make_scene({"a": box(15, 15, 19, 19)}, [box(8, 2, 11, 6)], start=(2.0, 2.0))
WAY = (
    np.array(
        [
            [2.0, 2.0],
            [3.0, 4.0],
            [5.0, 7.0],
            [7.0, 9.0],
            [9.0, 11.0],
            [12.0, 12.0],
            [14.0, 14.0],
            [16.5, 16.5],
        ]
    )
    * KM
)
STEPS = np.vstack([np.linspace(a, b, 6)[:-1] for a, b in pairwise(WAY)] + [WAY[-1:]])
LOOSE = PlannerConfig(epsilon=0.999, delta=0.999)


def task(scene=SCENE, robot=None, planner=LOOSE, formula="F a", **wind):
    robot = robot or RobotConfig(dt=100.0, u_max=20.0, start_sd=50.0)
    return make_problem(formula, scene, smooth_wind(scene, **wind), robot, planner, fidelity="full")


def interval(failures, runs):
    """An interval that misses the true rate less than once in 10^6."""
    low = 0.0 if failures == 0 else float(beta_law.ppf(RARE / 2, failures, runs - failures + 1))
    high = 1.0 if failures == runs else float(beta_law.ppf(1 - RARE / 2, failures + 1, runs - failures))
    return low, high


# --- the kernel and the formula --------------------------------------------------------------------


@pytest.mark.parametrize("gain", [0.0, 0.3])
@pytest.mark.parametrize("rho", [0.0, 0.6, 1.0])
def test_covariances_and_controls_are_those_of_the_formula(rho, gain):
    p = task(rho=rho, robot=RobotConfig(dt=100.0, u_max=60.0, start_sd=50.0, feedback=gain), hours=0.25)
    path = problem.evaluate(p, STEPS, "by hand")
    cov, u = risk.propagate_coherent(p, STEPS)
    np.testing.assert_allclose(path.cov, cov, rtol=2e-4, atol=1.0)
    np.testing.assert_allclose(path.u, u, atol=2e-4)


def test_the_forecast_of_a_plan_is_the_plan():
    """Flying the controls forward gives back the means that they were made for."""
    p = task()
    path = problem.evaluate(p, STEPS, "by hand")
    seen = problem.forecast(p, path.u, "coherent")
    np.testing.assert_allclose(seen.x, STEPS, atol=0.1)
    np.testing.assert_allclose(seen.cov, path.cov, rtol=1e-4)
    assert seen.mission_risk == pytest.approx(path.objectives.mission_risk, abs=1e-6)
    assert seen.collision_risk == pytest.approx(path.objectives.collision_risk, rel=1e-3)


def test_correlations_between_steps_are_those_of_linear_flights():
    """Cov(e_t, e_s) against 200,000 flights of e' = F e + dt (ψ' θ + white) drawn in plain NumPy."""
    p = task(hours=0.25, rho=0.6)
    F, psi, noise = problem.linear_law(p, STEPS)
    n, dt, modes = 200_000, p.tables.motion.dt, p.tables.modes
    winds = deployment.draw(p, "coherent", n, len(F), np.random.default_rng(3))
    e = [np.random.default_rng(4).standard_normal((n, 2)) * np.sqrt(p.start_variance)]
    for t in range(len(F)):
        wind = np.einsum("cp,ncp->nc", psi[t], winds.theta[:, modes.slot[t]])
        e.append(e[-1] @ F[t].T + dt * (wind + np.sqrt(noise[t]) * winds.white[t]))
    course, cov3 = problem.trail(p, len(STEPS)), np.empty((len(STEPS), 3))
    path_kernel.foresee(
        p.tables, np.eye(2), problem.evaluate(p, STEPS, "").u, p.start_variance, True, STEPS.copy(), cov3,
        course, np.empty(len(STEPS)),
    )  # fmt: skip
    cross = np.zeros((len(STEPS), len(STEPS), 2, 2))
    path_kernel.across_time(p.tables, F, psi, course.theta.astype(float), cov3, cross)
    for s, t in ((5, 6), (10, 30), (20, 35)):
        found = e[t].T @ e[s] / n
        scale = np.sqrt(np.outer(np.diag(cross[t, t]), np.diag(cross[s, s])))
        np.testing.assert_allclose(found / scale, cross[t, s] / scale, atol=0.02)


# --- the Gaussian and nonlinear flights -----------------------------------------------------------


@pytest.mark.statistical
@pytest.mark.parametrize("gain", [0.0, 0.2])
def test_the_end_point_of_nonlinear_flights_is_foreseen(gain):
    p = task(robot=RobotConfig(dt=100.0, u_max=60.0, start_sd=50.0, feedback=gain), hours=0.5, sd=1.0)
    path = problem.evaluate(p, STEPS, "by hand")
    flights = deployment.fly(p, path.u, 40_000, "coherent", SeedSequence(1), path.x)
    for t in (10, 20, len(STEPS) - 1):
        sd = flights.x[:, t].std(axis=0)
        np.testing.assert_allclose(sd, np.sqrt(np.diag(path.cov[t])), rtol=0.05)
        off = np.abs(flights.x[:, t].mean(axis=0) - path.x[t])
        assert np.all(off < 5.0 * sd / np.sqrt(40_000) + 0.02 * sd)


@pytest.mark.statistical
def test_the_mean_shift_is_what_flights_show():
    """Controls that ignore it end where the second-order terms say, not at the expected path."""
    p = task(speed=8.0, sd=2.0, length=8 * KM, hours=2.0, rho=1.0, robot=RobotConfig(dt=100.0, u_max=60.0))
    plain = replace(p, tables=p.tables._replace(full=False))
    path = problem.evaluate(plain, STEPS, "by hand")
    seen = problem.forecast(p, path.u, "coherent")
    ends = deployment.fly(p, path.u, 60_000, "coherent", SeedSequence(2)).x[:, -1]
    error = 5.0 * ends.std(axis=0) / np.sqrt(len(ends))
    shift = seen.x[-1] - path.x[-1]
    assert np.any(np.abs(shift) > 2 * error)  # otherwise this tests nothing
    off = np.abs(ends.mean(axis=0) - seen.x[-1])
    assert np.all(off < error + 0.35 * np.abs(shift).max())
    assert np.linalg.norm(ends.mean(axis=0) - seen.x[-1]) < np.linalg.norm(ends.mean(axis=0) - path.x[-1])


def test_one_frozen_field_spreads_flights_in_proportion_to_time_and_new_ones_to_its_root():
    """Calm expected wind, an error that is the same everywhere: sd = s t, or s √(t slot)."""
    ends = {}
    for rho in (0.0, 1.0):
        p = task(speed=0.0, gust=0.0, length=1e7, rho=rho, hours=1 / 36, slots=40, hold_last=False)
        path = problem.evaluate(p, STEPS, "")
        ends[rho] = np.sqrt((path.cov[-1][0, 0] - 50.0**2) / (len(STEPS) - 1))
    assert ends[1.0] == pytest.approx(100.0 * np.sqrt(len(STEPS) - 1), rel=1e-2)
    assert ends[0.0] == pytest.approx(100.0, rel=1e-2)


@pytest.mark.parametrize("dt", [50.0, 200.0])
def test_the_answer_hardly_depends_on_the_time_step(dt):
    """Of the coherent law; the independent one averages a shorter step's winds away."""

    def spread(step, law):
        p = task(robot=RobotConfig(dt=step, u_max=60.0), hours=0.5)
        ratio = step / 100.0
        n = round((len(STEPS) - 1) / ratio)
        x = np.column_stack(
            [np.interp(np.linspace(0, 1, n + 1), np.linspace(0, 1, len(STEPS)), STEPS[:, i]) for i in (0, 1)]
        )
        u = problem.evaluate(p, x, "").u
        return np.sqrt(np.trace(problem.forecast(p, u, law).cov[-1]))

    assert spread(dt, "coherent") == pytest.approx(spread(100.0, "coherent"), rel=0.06)
    assert abs(np.log(spread(dt, "independent") / spread(100.0, "independent"))) > 0.25


def test_both_laws_have_the_same_wind_at_one_place_and_time():
    """ψ' ψ and the white remainder add up to the predictive variance of the independent law."""
    p = task(gust=0.7)
    p = replace(p, tables=p.tables._replace(modes=p.tables.modes._replace(white=1.0)))
    _, psi, noise = problem.linear_law(p, STEPS)
    for t in range(len(psi)):
        marginal = (psi[t] ** 2).sum(axis=1) + noise[t]
        wind = p.tables.wind
        latent = risk.interpolate(p, wind.latent, t, STEPS[t]) + risk.interpolate_time(p, wind.gust, t)
        np.testing.assert_allclose(marginal, latent, rtol=1e-4)


def test_fields_of_neighbouring_slots_are_correlated_by_rho():
    p = task(rho=0.7, hours=0.25)
    theta = deployment.draw(p, "coherent", 4000, 10, np.random.default_rng(0)).theta.astype(float)
    used = np.unique(p.tables.modes.slot)
    assert len(used) > 2
    np.testing.assert_allclose(theta.var(axis=0), 1.0, atol=0.15)
    for k in used[:-1]:
        assert np.mean(theta[:, k] * theta[:, k + 1]) == pytest.approx(0.7, abs=0.02)


def test_a_longer_plan_meets_the_same_field():
    p = task()
    short = deployment.draw(p, "coherent", 10, 5, np.random.default_rng(0))
    long = deployment.draw(p, "coherent", 10, 9, np.random.default_rng(0))
    np.testing.assert_array_equal(short.theta, long.theta)
    np.testing.assert_array_equal(short.white, long.white[:5])


# --- bounds -------------------------------------------------------------------------------------


@pytest.mark.statistical
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_bounds_hold_in_coherent_winds(seed):
    scene = make_scene({"a": box(14, 14, 18, 18)}, [box(9.5, 3, 12, 9)], start=(2.0, 2.0))
    p = task(scene, sd=0.6, gust=0.5, seed=seed, robot=RobotConfig(dt=100.0, u_max=30.0))
    path = problem.evaluate(p, STEPS, "by hand")
    flights = deployment.fly(p, path.u, 20_000, "coherent", SeedSequence(seed), path.x)
    o = path.objectives
    lost, hit = int((~flights.accepted).sum()), int(flights.collided.sum())
    assert lost + hit > 50
    assert interval(lost, 20_000)[0] <= o.mission_risk
    assert interval(hit, 20_000)[0] <= o.collision_risk
    assert (
        interval(int((~flights.accepted | flights.collided).sum()), 20_000)[0]
        <= o.mission_risk + o.collision_risk
    )


def test_the_reflection_is_left_out_where_deviations_shrink():
    """A run beside one face whose variance falls: 2 Φ(-d/σ) no longer bounds what happened on the way."""
    p = task(robot=RobotConfig(dt=100.0, u_max=60.0, feedback=0.5))
    x = np.column_stack([np.full(20, 12.0), np.linspace(2, 6, 20)]) * KM
    sd = np.linspace(500.0, 100.0, 20)
    cov3 = np.column_stack([sd**2, np.zeros(20), sd**2])
    cross = np.zeros((20, 20, 2, 2))
    for s in range(20):
        for t in range(s, 20):
            cross[t, s] = 0.9 ** (t - s) * sd[s] * sd[t] * np.eye(2)
    alone = path_kernel.collision_bound(p.tables, x, cov3, np.empty((0, 0, 2, 2)))
    assert path_kernel.collision_bound(p.tables, x, cov3, cross) == alone
    for s in range(20):
        cross[s:, s] = sd[s] ** 2 * np.eye(2)  # Cov(e_t, e_s) = Var e_s: the reflection is allowed
    assert path_kernel.collision_bound(p.tables, x, cov3, cross) < alone


@few
@given(st.integers(0, 2**32 - 1))
def test_owens_t_is_scipys(seed):
    rng = np.random.default_rng(seed)
    h = np.concatenate([rng.uniform(0, 10, 200), [0.0, 0.0, 1e-9, 9.0]])
    a = np.concatenate([rng.standard_normal(200) * 10 ** rng.uniform(-6, 6, 200), [0.0, 1.0, 1e6, -2.0]])
    np.testing.assert_allclose(ordered.owens_ts(h, a), owens_t(h, a), atol=2e-15)


@few
@given(st.integers(0, 2**32 - 1))
def test_polygon_probabilities_of_the_kernel_are_the_references(seed):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 8)))
    polygon = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(0.1, 3.0)
    if np.min(np.diff(angles, append=angles[0] + 2 * np.pi)) < 1e-2:
        return
    ptr = np.array([0, len(polygon)])
    labelled = Labelled(np.zeros(1, np.int64), np.zeros((1, 2)), np.ones(1), ptr, polygon)
    x = rng.standard_normal((20, 2)) * 2
    half = rng.standard_normal((20, 2, 2))
    cov = half @ half.transpose(0, 2, 1) + 0.01 * np.eye(2)
    expected = [risk.polygon_probability(polygon, m, c) for m, c in zip(x, cov, strict=True)]
    three = np.ascontiguousarray(cov.reshape(-1, 4)[:, [0, 1, 3]])
    np.testing.assert_allclose(ordered.polygon_probabilities(labelled, x, three), expected, atol=1e-13)


def test_the_mission_bound_of_the_kernel_is_the_references():
    scene = make_scene(
        {"a": box(14, 14, 18, 18), "b": box(4, 6, 8, 10), "c": box(6, 8, 10, 12)}, start=(2.0, 2.0)
    )
    for formula in ("F(b & F a)", "!c U a", "F(b & c & F a)", "(!a U b) & F a"):
        p = task(scene, formula=formula, sd=2.0)
        path = problem.evaluate(p, STEPS, "")
        assert path.objectives.mission_risk == pytest.approx(
            risk.ordered_mission_risk(p, path.x, path.cov), abs=1e-12
        )


def test_the_ordered_bound_is_never_below_the_truth_of_random_automata_and_correlated_labels():
    """3,000 complete DFAs on labels that form a hidden Markov chain; the truth by dynamic programming."""
    rng = np.random.default_rng(0)
    for _ in range(3000):
        states, letters, hidden, steps = rng.integers(2, 6), rng.integers(2, 4), 3, rng.integers(1, 8)
        delta = rng.integers(0, states, (states, letters))
        goal = states - 1
        delta[goal] = goal
        covers = _preorder(delta, goal)
        move = rng.dirichlet(np.full(hidden, 0.3), hidden)
        show = rng.dirichlet(np.full(letters, 0.3), (steps, hidden))
        start = rng.dirichlet(np.ones(hidden))
        truth = np.zeros((hidden, states))
        truth[:, 0] = start
        V, now = np.where(covers[0], 0.0, 1.0), start
        spoils = ~covers[delta]
        for t in range(steps):
            if t > 0:
                truth, now = move.T @ truth, now @ move
            P = now @ show[t]
            V = np.minimum(1.0, (V[:, None] + np.einsum("qsp,s->qp", spoils, P)).min(axis=0))
            after = np.zeros_like(truth)
            for s in range(letters):
                np.add.at(after.T, delta[:, s], (truth * show[t][:, [s]]).T)
            truth = after
        assert 1.0 - truth[:, goal].sum() <= V[goal] + 1e-12


def _preorder(delta, goal):
    """covers[q, p]: q accepts all that p accepts; the greatest simulation by fixed point."""
    n = len(delta)
    covers = np.ones((n, n), bool)
    covers[:, goal] = np.arange(n) == goal
    while True:
        then = covers & covers[delta[:, None], delta[None, :]].all(axis=2)
        if (then == covers).all():
            return covers
        covers = then


# --- bad input ------------------------------------------------------------------------------------


def test_a_path_above_delta_is_refused():
    scene = make_scene({"a": box(14, 14, 18, 18)}, [box(8.6, 3, 12, 9)], start=(2.0, 2.0))
    p = task(scene, sd=2.0, planner=PlannerConfig(epsilon=0.999, delta=1e-9))
    with pytest.raises(InfeasibleError, match=r"planner\.delta"):
        problem.evaluate(p, STEPS, "")


def test_calm_air_and_a_single_time_are_no_special_cases():
    scene = make_scene({"a": box(14, 14, 18, 18)}, start=(2.0, 2.0))
    p = task(scene, speed=0.0, sd=0.0, gust=0.0, slots=1, robot=RobotConfig(dt=100.0, u_max=60.0))
    path = problem.evaluate(p, STEPS, "")
    assert path.objectives.mission_risk == path.objectives.collision_risk == 0.0
    flights = deployment.fly(p, path.u, 10, "coherent", SeedSequence(0), path.x)
    np.testing.assert_allclose(flights.x[:, -1], np.tile(STEPS[-1], (10, 1)), atol=1e-3)
