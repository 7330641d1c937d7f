"""The robot's own errors: flights, the linear law, fixes and rare failures, each on two roads."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence

from careful_io.yaml_files import read_yaml
from coherent import LOOSE, STEPS, coherent_problem, rate_interval
from landmarks import LANDMARK_WAY, landmark_problem
from oracle import importance as plain
from pareto_ltl.extend import draw_flights, simulate_flights
from pareto_ltl.kernels.data import EXACT, RobotErrors
from pareto_ltl.kernels.fixes import fix_error, likely_sight
from pareto_ltl.kernels.flight import CoherentDraws
from pareto_ltl.kernels.pilots import Autopilot
from pareto_ltl.kernels.robot_errors import mean_flown
from pareto_ltl.planning.evaluate import cross_covariance, evaluate_path, propagate
from pareto_ltl.planning.problem import Problem, unaided
from pareto_ltl.planning.rates import WEIGHTED
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.settings import RobotConfig
from pareto_ltl.simulation import failure_modes, importance
from pareto_ltl.simulation.common_flights import is_certain
from pareto_ltl.simulation.flights import fly_draws
from pareto_ltl.simulation.robot_errors import erring_pilot
from pareto_ltl.support.arrays import FloatArray, square_matrices
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.conditioning import Fix, Learnt
from pareto_ltl_verify.robot import Errors
from plane_kernels.types import Cov, Gaussian, Point
from problems import KM, along, box, make_problem, make_scene, steady_wind

SD = {"airspeed_sd": 0.04, "heading_sd": 3.0, "clock_sd": 40.0}
BASE = {"dt": 100.0, "u_max": 20.0, "start_sd": 50.0}
RUNS = 20_000


KNOWN = {  # after a fix: expected errors, and what is left of them, correlated and with the start
    "airspeed_sd": 0.03, "heading_sd": 2.0, "clock_sd": 30.0,
    "airspeed_bias": -0.06, "heading_bias": 4.0, "clock_bias": 25.0,
    "error_correlation": [0.5, -0.3, 0.2],
    "start_error_covariance": [[3.0, -4.0], [150.0, 250.0], [-1000.0, 800.0]],
}  # fmt: skip


def erring_problem(errors: dict[str, float] | None = None, **wind: float) -> Problem:
    """A mission in winds with exact modes, by a robot with ``errors`` of its own."""
    return coherent_problem(robot=RobotConfig(**BASE | (SD if errors is None else errors)), **wind)


# --- flights ----------------------------------------------------------------------------------


def plain_flights(
    u: FloatArray, start: FloatArray, wind: FloatArray, gust_sd: float, runs: int, robot: RobotConfig
) -> FloatArray:
    """Flights (runs, T+1, 2) of controls ``u`` in a steady wind with white gusts, in NumPy alone."""
    rng = np.random.default_rng(77)
    sd = np.array([robot.airspeed_sd, robot.heading_sd, robot.clock_sd], float)
    joint = np.diag([*sd**2, robot.start_sd**2, robot.start_sd**2])
    for (p, q), r in zip(((0, 1), (0, 2), (1, 2)), robot.error_correlation, strict=True):
        joint[p, q] = joint[q, p] = r * sd[p] * sd[q]
    shared = np.array(robot.start_error_covariance)
    joint[:3, 3:], joint[3:, :3] = shared, shared.T
    joint[3:, 3:] += shared.T @ np.linalg.solve(joint[:3, :3], shared)
    mean = [robot.airspeed_bias, robot.heading_bias, robot.clock_bias, *start]
    drawn = rng.multivariate_normal(mean, joint, runs)
    scale, turn, late = 1.0 + drawn[:, 0], np.radians(-drawn[:, 1]), drawn[:, 2]  # headings are clockwise
    x = [drawn[:, 3:]]
    for t in range(len(u)):
        before = u[max(t - 1, 0)]
        east, north = (np.outer(late / BASE["dt"], before - u[t]) + u[t]).T
        speed, angle = scale * np.hypot(east, north), np.arctan2(north, east) + turn
        air = speed[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        x.append(x[-1] + BASE["dt"] * (air + wind + gust_sd * rng.standard_normal((runs, 2))))
    return np.stack(x, axis=1)


@pytest.mark.statistical
@pytest.mark.parametrize("errors", [SD, KNOWN], ids=["unknown", "after a fix"])
def test_as_many_flights_fail_as_in_a_plain_simulator(errors):
    """20,000 flights of each, with airspeed, heading and clock errors drawn independently."""
    scene = make_scene({"a": box(15, 15, 18, 18)}, [box(8, 5, 11, 8.6)], start=(2.0, 2.0))
    wind = np.array([2.0, -1.0])
    robot = RobotConfig(**BASE | errors)
    blowing = steady_wind(scene, wind, gust=(0.05, 0.05))
    p = make_problem("F a", scene, blowing, robot, LOOSE, fidelity="full")
    path = evaluate_path(p, along((2, 2), (6, 9), (11, 12), (16.5, 16.5), step=0.8), "")
    ours = simulate_flights(p, path.u, RUNS, "coherent", SeedSequence(5), path.x)
    gust_sd = math.sqrt(p.modes.white * float(p.wind.gust[0, 0]))
    x = plain_flights(path.u, scene.start, wind, gust_sd, RUNS, robot)
    lines = shapely.linestrings(x)
    hit = shapely.intersects(lines, shapely.Polygon(scene.obstacles[0]))
    inside = ((x >= 15 * KM) & (x <= 18 * KM)).all(axis=2).any(axis=1)
    failed = int((hit | ~inside).sum())
    low, high = rate_interval(failed, RUNS)
    assert 0.05 < failed / RUNS < 0.5
    ends = rate_interval(int(ours.failed.sum()), RUNS)
    assert low <= ends[1]
    assert ends[0] <= high
    for t in (5, len(path.u)):  # means to 5 standard errors, spreads to 4 %
        gap = np.abs(ours.x[:, t].mean(axis=0) - x[:, t].mean(axis=0))
        assert (gap < 5.0 * np.sqrt(2.0 / RUNS) * x[:, t].std(axis=0)).all()
        np.testing.assert_allclose(ours.x[:, t].std(axis=0), x[:, t].std(axis=0), rtol=0.04)
    exact = make_problem("F a", scene, blowing, RobotConfig(**BASE), LOOSE, fidelity="full")
    without = simulate_flights(exact, path.u, RUNS, "coherent", SeedSequence(5), path.x)
    # An exact robot is safer by the plan of a robot with errors, unless it corrects errors that are known.
    if errors is SD:
        assert without.failed.mean() < 0.1 * ours.failed.mean()
    else:
        assert without.failed.mean() > 2.0 * ours.failed.mean()


def moved_by(p: Problem, u: FloatArray, errors: FloatArray) -> FloatArray:
    """Positions (n, T+1, 2) of flights that meet the expected wind, with the coefficients ``errors``."""
    law, n, own = p.laws["coherent"], len(errors), p.own_errors("coherent")
    epochs, modes = int(p.modes.epoch.max()) + 1, p.modes.psi.shape[-1]
    draws = CoherentDraws(law, np.zeros((len(u), n, 2)), np.zeros((epochs, n, 2, modes), np.float32))
    x = np.empty((n, len(u) + 1, 2))
    x[:, 0] = p.scene.start + errors @ own.start.T
    fly_draws(p, draws, erring_pilot(Autopilot(u, STEPS), u, own, errors), x)
    return x


@pytest.mark.parametrize("q", [0, 1, 2])
@pytest.mark.parametrize("errors", [SD, KNOWN], ids=["unknown", "after a fix"])
def test_the_linear_law_is_the_derivative_of_flights(q, errors):
    """Central differences by each coefficient, in a curved wind, for A and B that are not the identity.

    The law is linearised about the mean, which the winds' own errors shift by a little.
    """
    matrices = {"a": [[1.0, 0.002], [-0.001, 0.999]], "b": [[1.0, 0.2], [-0.1, 1.0]]}
    p = coherent_problem(robot=RobotConfig(**BASE | errors | matrices | {"u_max": 60.0}))
    flight = propagate(p, STEPS)
    h = 1e-3 * np.eye(3)[q]
    ahead, behind = moved_by(p, flight.u, np.stack([h, -h]))
    slope = (ahead - behind) / 2e-3
    np.testing.assert_allclose(flight.errors.cross[..., q], slope, atol=0.02 * np.abs(slope).max())


@given(st.integers(0, 2**31))
def test_the_mean_of_what_is_flown_is_that_of_a_quadrature(seed):
    rng = np.random.default_rng(seed)
    root = np.tril(rng.standard_normal((3, 3))) * np.array([[0.05], [0.2], [30.0]])
    mean = rng.standard_normal(3) * [0.1, 0.3, 40.0]
    now, change = Errors(mean, root @ root.T, np.zeros((2, 3))).flown
    found = mean_flown(RobotErrors(mean, root, np.zeros((2, 3))))
    for ours, theirs in zip(found, (now, change), strict=True):
        turned = np.array([[ours.real, -ours.imag], [ours.imag, ours.real]])
        np.testing.assert_allclose(turned, theirs, atol=1e-9 * max(abs(ours), 1.0))


@pytest.mark.statistical
def test_flights_spread_as_planned_about_the_planned_means():
    """A heading error of 12 degrees shortens what is flown on average by 2 %, which the plan compensates."""
    known = {**KNOWN, "airspeed_sd": 0.03, "heading_sd": 12.0, "clock_sd": 20.0}
    p = erring_problem(known, speed=1.0, sd=0.2)
    flight = propagate(p, STEPS)
    x = simulate_flights(p, flight.u, RUNS, "coherent", SeedSequence(2)).x[:, -1]
    planned = square_matrices(flight.cov)[-1]
    np.testing.assert_allclose(np.cov(x.T), planned, atol=0.1 * planned.max())
    gap = np.abs(x.mean(axis=0) - STEPS[-1])
    uncompensated = 0.022 * np.linalg.norm(STEPS[-1] - STEPS[0])
    assert gap.max() < 5.0 * np.sqrt(planned.max() / RUNS) + 0.1 * uncompensated


@settings(max_examples=25, deadline=None)
@given(st.floats(1e-3, 0.3), st.floats(0.01, 20.0), st.integers(0, 2**31))
def test_errors_add_their_squares_to_the_covariance(airspeed, heading, seed):
    """In a steady wind: Σ of a robot with errors is Σ of an exact one plus C C', for any way."""
    scene, rng = make_scene({"a": box(15, 15, 19, 19)}), np.random.default_rng(seed)
    way = np.cumsum(np.vstack([[[2.0, 2.0]], rng.uniform(-0.5, 0.9, (12, 2))]), axis=0) * KM
    errors = {"airspeed_sd": airspeed, "heading_sd": heading}
    exact, erring = (
        propagate(make_problem("F a", scene, steady_wind(scene), robot, fidelity="full"), way)
        for robot in (RobotConfig(**BASE), RobotConfig(**BASE | errors))
    )
    C = erring.errors.cross
    added = square_matrices(erring.cov) - square_matrices(exact.cov)
    np.testing.assert_allclose(added, C @ C.transpose(0, 2, 1), atol=1e-6 * max(float(added.max()), 1.0))
    # The airspeed's share: the deviation is that share of the way through the air.
    air = np.vstack([np.zeros((1, 2)), np.cumsum(BASE["dt"] * erring.u, axis=0)])
    np.testing.assert_allclose(C[..., 0], airspeed * air, atol=1e-6)
    aside = math.radians(heading) * np.column_stack([-air[:, 1], air[:, 0]])
    np.testing.assert_allclose(C[..., 1], aside, atol=1e-6)


def test_steps_are_correlated_as_flights_are():
    p = erring_problem(speed=1.0, sd=0.3)
    flight = propagate(p, STEPS)
    x = simulate_flights(p, flight.u, RUNS, "coherent", SeedSequence(4)).x
    e = x - x.mean(axis=0)
    cross = cross_covariance(p.laws["coherent"], flight)
    for s, t in ((8, 20), (15, len(STEPS) - 1)):
        found = e[:, t].T @ e[:, s] / RUNS
        np.testing.assert_allclose(cross[t, s], found, atol=0.06 * np.abs(found).max())


@pytest.mark.parametrize("errors", [SD, KNOWN], ids=["unknown", "after a fix"])
def test_linear_flights_deviate_as_the_law_says(errors):
    """Common flights of the search: their linear form is the matrix M of the plain implementation."""
    p = erring_problem(errors)
    flight, drawn = propagate(p, STEPS), draw_flights(p, "coherent", 500, SeedSequence(1))
    assert drawn.errors.shape == (500, 3)
    linear, exact = drawn.linear().deviations(flight), drawn.deviations(flight)
    start = drawn.start - drawn.errors @ flight.errors.law.start.T
    none = replace(drawn, errors=np.zeros_like(drawn.errors), start=start)
    alone = none.linear().deviations(flight)
    by_errors = np.einsum("tcq,nq->tcn", flight.errors.cross, drawn.errors)
    np.testing.assert_allclose(linear - alone, by_errors, atol=1e-3 * np.abs(by_errors).max())
    assert np.sqrt(((linear - exact) ** 2).mean()) < 0.25 * exact.std()
    assert not is_certain(p)


def test_the_independent_law_has_an_exact_robot():
    p, exact = erring_problem(), coherent_problem(robot=RobotConfig(**BASE))
    assert len(p.own_errors("independent").mean) == 0
    u = propagate(exact, STEPS).u
    ours, others = (simulate_flights(q, u, 100, "independent", SeedSequence(3)).x for q in (p, exact))
    np.testing.assert_array_equal(ours, others)


def test_a_robot_without_errors_flies_as_before():
    """Its winds are the same draws, whether or not a robot with errors is flown with this seed."""
    erring, exact = erring_problem({"clock_sd": 1e-9}), coherent_problem(robot=RobotConfig(**BASE))
    u = propagate(exact, STEPS).u
    ours, others = (simulate_flights(q, u, 300, "coherent", SeedSequence(3)).x for q in (erring, exact))
    np.testing.assert_allclose(ours, others, atol=1e-3)


# --- who knows its position -------------------------------------------------------------------


def test_a_robot_that_knows_its_position_corrects_its_own_errors():
    """With feedback the law and flights agree; errors that outweigh the wind matter little."""
    held = coherent_problem(robot=RobotConfig(**BASE | SD | {"feedback_time": 300.0, "u_max": 60.0}))
    free = erring_problem()
    flight = propagate(held, STEPS)
    x = simulate_flights(held, flight.u, 4000, "coherent", SeedSequence(6), STEPS).x[:, -1]
    planned = square_matrices(flight.cov)[-1]
    np.testing.assert_allclose(np.cov(x.T), planned, atol=0.1 * planned.max())
    assert planned.trace() < 0.1 * square_matrices(propagate(free, STEPS).cov)[-1].trace()


@pytest.mark.statistical
@pytest.mark.parametrize("errors", [SD, KNOWN], ids=["unknown", "after a fix"])
def test_flights_with_fixes_spread_as_foreseen(errors):
    """Filters learn about the errors at a fix; the planned Gaussian is somewhat wider, not narrower."""
    p = landmark_problem(**errors)
    path = evaluate_path(p, LANDMARK_WAY, "")
    x = simulate_flights(p, path.u, RUNS, "coherent", SeedSequence(1), path.x).x
    for t in (path.fixes[-1] + 1, path.fixes[-1] + 4, len(LANDMARK_WAY) - 1):
        wide = np.sqrt(np.trace(path.cov[t]))
        assert 0.7 * wide < np.sqrt(np.trace(np.cov(x[:, t].T))) < 1.05 * wide


def test_fixes_take_errors_away_from_what_is_unknown():
    """What is left of Cov(e, κ) is small beside what it is without fixes; without errors, less is unknown."""
    p = landmark_problem(**SD)
    law = p.laws["coherent"]
    flight, alone = propagate(p, LANDMARK_WAY), propagate(p, LANDMARK_WAY, unaided(law))
    assert flight.memory.used[0] > 0
    assert np.abs(flight.errors.cross[-1]).max() < 0.5 * np.abs(alone.errors.cross[-1]).max()
    exact = propagate(p, LANDMARK_WAY, law._replace(errors=EXACT))
    assert exact.cov[-1, 0] < flight.cov[-1, 0] < alone.cov[-1, 0]


@pytest.mark.parametrize("errors", [SD, KNOWN], ids=["unknown", "after a fix"])
def test_fixes_condition_wind_and_errors_together(errors):
    """The planned covariance with fixes is that of one filter for (e, θ, κ) with full matrices, in NumPy."""
    p = landmark_problem(**errors)
    law, flight, dt = p.laws["coherent"], propagate(p, LANDMARK_WAY), p.motion.dt
    modes = flight.psi.shape[2]
    last = 2 * modes
    cross, theta = np.hstack([np.zeros((2, last)), law.errors.start]), np.eye(last + 3)
    unknown, known = p.start_variance * np.eye(2) + cross @ cross.T, np.zeros((2, 2))
    for t in range(len(flight.u)):
        if flight.memory.chance[t] > 0.0:
            here = Gaussian(Point(*flight.x[t]), Cov(*flight.cov[t]))
            sight = likely_sight(law.landmarks, Point(*flight.x[max(t - 1, 0)]), here)
            xx, xy, yy = fix_error(law, t, sight, here.mean)
            S = unknown + np.array([[xx, xy], [xy, yy]])
            gain, learnt = (sight.chance * np.linalg.solve(S, part).T for part in (unknown, cross))
            theta = theta - learnt @ cross
            known, unknown, cross = known + gain @ unknown, unknown - gain @ unknown, cross - gain @ cross
        psi = np.zeros((2, last + 3))
        psi[0, :modes], psi[1, modes:last], psi[:, last:] = *flight.psi[t], flight.errors.push[t]
        kept, F = np.concatenate([np.tile(law.modes.kept[t + 1], 2), np.ones(3)]), flight.F[t]
        mixed = dt * F @ cross @ psi.T
        unknown = F @ unknown @ F.T + mixed + mixed.T
        unknown += dt**2 * (psi @ theta @ psi.T + np.diag(flight.white[t]))
        back = F - law.landmarks.gain * np.eye(2)
        known, cross = back @ known @ back.T, kept * (F @ cross + dt * psi @ theta)
        theta = np.outer(kept, kept) * theta + np.diag(1.0 - kept**2)
        total = unknown + known
        np.testing.assert_allclose(square_matrices(flight.cov)[t + 1], total, atol=1e-5 * total.max())
    left = cross[:, last:]
    np.testing.assert_allclose(flight.errors.cross[-1], left, atol=1e-5 * np.abs(left).max())
    assert flight.memory.used[0] > 1


def test_a_fix_is_less_surprising_for_a_robot_with_errors():
    erring, exact = erring_problem(), coherent_problem(robot=RobotConfig(**BASE))
    fix = Fix(STEPS[20] + [900.0, 400.0], 100.0, 20)
    ours, others = (Learnt.at(p, STEPS, 20, [fix]) for p in (erring, exact))
    assert ours.distance[0] < others.distance[0]
    assert np.abs(ours.theta).max() < np.abs(others.theta).max()


# --- rare failures ----------------------------------------------------------------------------


def rare_task(**known: object) -> tuple[Problem, PlannedPath]:
    """A plan of a robot with errors in a steady wind that fails in about one of 600 flights."""
    scene = make_scene({"a": box(13, 13, 19, 19)}, [box(8, 1, 12, 5.5)], start=(2.0, 3.0))
    errors = {"airspeed_sd": 0.05, "heading_sd": 3.0} | known
    robot = RobotConfig(dt=100.0, u_max=25.0, start_sd=50.0, **errors)
    wind = steady_wind(scene, (1.0, 0.5), gust=(0.05, 0.05))
    p = make_problem("F a", scene, wind, robot, LOOSE, fidelity="full")
    return p, evaluate_path(p, along((2, 3), (6, 8), (11, 12), (16, 16), step=0.8), "by hand")


@pytest.mark.statistical
@pytest.mark.parametrize(
    "known",
    [
        {},
        {
            "airspeed_bias": -0.05,
            "heading_bias": 3.0,
            "error_correlation": [0.4, 0.0, 0.0],
            "start_error_covariance": [[2.0, 1.0], [50.0, 100.0], [0.0, 0.0]],
        },
    ],
    ids=["unknown", "after a fix"],
)
def test_weighted_flights_of_rare_failures_agree_with_plain_ones(known):
    p, path = rare_task(**known)
    weighted = importance.weighted_rate(p, path, 4000, SeedSequence(2))
    assert weighted is not None
    assert weighted.method == WEIGHTED
    runs = 200_000
    failed = int(simulate_flights(p, path.u, runs, "coherent", SeedSequence(3), path.x).failed.sum())
    low, high = rate_interval(failed, runs)
    assert 1e-4 < failed / runs < 4e-3
    assert low <= weighted.high
    assert weighted.low <= high
    assert weighted.high - weighted.low < 0.3 * weighted.failure


def test_directions_of_half_spaces_have_the_errors():
    p, path = rare_task()
    proposal = importance.make_proposal(p, path)
    assert proposal is not None
    linear = proposal.plan.linear
    omega = plain.half_space_directions(linear, proposal.modes.weight)
    np.testing.assert_allclose(failure_modes._joined(proposal.directions), omega, atol=1e-6)  # noqa: SLF001
    assert np.abs(proposal.directions.errors).max() > 0.3


# --- settings ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["airspeed_sd", "heading_sd", "clock_sd"])
@pytest.mark.parametrize("value", [0.0, -0.01, math.nan, 1e6, True])
def test_errors_that_no_sensor_has_are_refused(name, value):
    with pytest.raises(ConfigError, match=f"robot.{name} must be ") as caught:
        RobotConfig(**{name: value})
    assert "\n" not in str(caught.value)


def test_an_error_of_zero_is_answered_by_null():
    with pytest.raises(ConfigError, match="null: not modelled, where 0 would claim a perfect sensor"):
        RobotConfig(airspeed_sd=0.0)
    with pytest.raises(ConfigError, match=r"at most 0.5 \(0.015: 1.5 %;.*got 0.51"):
        RobotConfig(airspeed_sd=0.51)
    assert len(erring_problem({}).own_errors("coherent").mean) == 0


def test_every_robot_preset_states_its_errors():
    folder = CONF.file("robot", "airframe").parent
    for file in sorted(folder.glob("*.yaml")):
        assert {"airspeed_sd", "heading_sd", "clock_sd"} <= read_yaml(file).keys(), file.name
