"""The belief of a watch against the law of the plan: winds, filter, members, and the rest of a plan."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy.stats import chi2

from coherent import STEPS, coherent_problem, rate_interval
from levels import AT_NIGHT
from pareto_ltl.extend import LocalWind, simulate_flights
from pareto_ltl.kernels.flight import CoherentDraws, wind_met
from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.settings import RobotConfig
from pareto_ltl.support.arrays import square_matrices
from pareto_ltl_apps.conditioning import Fix, Learnt
from pareto_ltl_apps.flight.belief import Belief

TRUTHS = 500 if AT_NIGHT else 60
PROBLEM = coherent_problem()
FLIGHT = propagate(PROBLEM, STEPS)
DT = PROBLEM.motion.dt


def flown(steps: float, members: int = 200, seed: int = 1, parts: int = 1) -> Belief:
    """The belief of a robot that flies as planned for so many steps, told in so many parts a step."""
    belief = Belief(PROBLEM, members, SeedSequence(seed))
    for t in range(int(np.ceil(steps))):
        share = min(1.0, steps - t)
        for _ in range(parts):
            belief.advance(share * DT / parts, share * DT / parts * FLIGHT.u[t])
    return belief


@pytest.mark.parametrize("step", [0, 7, 21])
def test_the_wind_at_a_place_is_that_of_the_kernels(step: int) -> None:
    rng, law = np.random.default_rng(step), PROBLEM.laws["coherent"]
    modes = law.modes.psi.shape[-1]
    for place in rng.uniform(-2e3, 22e3, (20, 2)):
        theta = rng.standard_normal((int(law.modes.epoch.max()) + 1, 1, 2, modes)).astype(np.float32)
        white, met = rng.standard_normal((step + 1, 1, 2)), np.empty((1, 4))
        x = np.full((1, step + 2, 2), np.nan)
        x[0, step] = place
        wind_met(CoherentDraws(law, white, theta), step, x, met)
        here = LocalWind.at(law, step, place[None])
        field = np.einsum("cm,cm->c", here.psi[0], theta[law.modes.epoch[step], 0])
        ours = here.mean[0] + field + np.sqrt(here.white[0]) * white[step, 0]
        np.testing.assert_allclose(ours, met[0, :2], atol=2e-5)


def test_without_fixes_it_is_the_forecast_of_the_plan() -> None:
    for t in (1, 9, len(FLIGHT.u)):
        now = flown(t).estimate()
        np.testing.assert_allclose(now.mean, FLIGHT.x[t], atol=2.0)  # modes are kept in single precision
        np.testing.assert_allclose(now.cov, square_matrices(FLIGHT.cov)[t], rtol=1e-3, atol=1.0)


def test_parts_of_steps_add_up() -> None:
    """At the end of a step, and within one."""
    for steps in (6, 6.4):
        one, other = flown(steps, members=20), flown(steps, members=20, parts=7)
        np.testing.assert_allclose(one.estimate().mean, other.estimate().mean, atol=1e-6)
        np.testing.assert_allclose(one.estimate().cov, other.estimate().cov, rtol=1e-9)
        np.testing.assert_allclose(one.flown, other.flown, atol=1e-6)


def test_a_fix_at_a_step_is_that_of_the_planner() -> None:
    belief, step = flown(15), 15
    place, sd = FLIGHT.x[step] + [700.0, -400.0], 150.0
    learnt = Learnt.at(PROBLEM, FLIGHT.x, step, [Fix(place, sd, step)])
    far = belief.distance(place, sd**2 * np.eye(2))
    belief.learn(place, sd**2 * np.eye(2))
    now = belief.estimate()
    assert far == pytest.approx(float(learnt.distance[0]), rel=0.02)
    np.testing.assert_allclose(now.mean, learnt.mean, atol=5.0)
    np.testing.assert_allclose(now.cov, learnt.cov, rtol=0.02, atol=5.0)
    modes = PROBLEM.modes.psi.shape[-1]
    np.testing.assert_allclose(belief.z[2 : 2 + 2 * modes].reshape(2, modes), learnt.theta, atol=0.02)


def test_the_truth_is_in_the_ellipses_as_often_as_they_say() -> None:
    """Truths of the law, two fixes within steps: squared distances have two components.

    Winds are not linear in the position, so 2 % of the coverage are left for that.
    """
    truths = simulate_flights(PROBLEM, FLIGHT.u, TRUTHS, "coherent", SeedSequence(9), FLIGHT.x).x
    rng, inside = np.random.default_rng(3), dict.fromkeys((0.5, 0.9, 0.99), 0)
    for x in truths:
        belief = Belief(PROBLEM, 2, SeedSequence(1))
        for t in range(30):
            parts = (0.3, 0.7) if t in (12, 23) else (1.0,)
            for k, part in enumerate(parts):
                belief.advance(part * DT, part * DT * FLIGHT.u[t])
                if len(parts) == 2 and k == 0:
                    there = x[t] + part * (x[t + 1] - x[t])
                    belief.learn(there + 120.0 * rng.standard_normal(2), 120.0**2 * np.eye(2))
        now = belief.estimate()
        far = (x[30] - now.mean) @ np.linalg.solve(now.cov, x[30] - now.mean)
        for p in inside:
            inside[p] += int(far <= chi2.ppf(p, 2))
    for p, count in inside.items():
        low, high = rate_interval(count, len(truths))
        assert low - 0.02 <= p <= high + 0.02


def test_members_spread_as_the_filter_says_after_fixes() -> None:
    belief = flown(14.5, members=4000)
    belief.learn(belief.estimate().mean + np.array([300.0, 500.0]), 200.0**2 * np.eye(2))
    belief.advance(0.5 * DT, 0.5 * DT * FLIGHT.u[14])
    for t in range(15, 25):
        belief.advance(DT, DT * FLIGHT.u[t])
    now, members = belief.estimate(), belief.flown[:, -1]
    sd = np.sqrt(np.diag(now.cov))
    assert (np.abs(members.mean(axis=0) - now.mean) < 6 * sd / np.sqrt(4000) + 0.05 * sd).all()
    assert members.std(axis=0) == pytest.approx(sd, rel=6 / np.sqrt(8000) + 0.05)


def test_the_promise_at_departure_is_that_of_flights() -> None:
    """Flights of the same law with other draws; both intervals miss less than once in 10^6."""
    belief = Belief(PROBLEM, 4000, SeedSequence(4))
    x, failed = belief.rest_fails(FLIGHT.u, FLIGHT.x)
    flights = simulate_flights(PROBLEM, FLIGHT.u, 20_000, "coherent", SeedSequence(11), FLIGHT.x)
    assert 0.02 < flights.failed.mean() < 0.98
    low, high = rate_interval(int(failed.sum()), len(failed))
    least, most = rate_interval(int(flights.failed.sum()), 20_000)
    assert low <= most
    assert least <= high
    sd = flights.x[:, -1].std(axis=0)
    assert x[:, -1].std(axis=0) == pytest.approx(sd, rel=6 / np.sqrt(8000))


def test_the_promise_during_a_flight_is_the_failure_of_flights_like_it() -> None:
    """Mean over truths of what is promised at half-way after a fix, against how many of them fail."""
    runs, step, rng = TRUTHS, 18, np.random.default_rng(8)
    truths = simulate_flights(PROBLEM, FLIGHT.u, runs, "coherent", SeedSequence(21), FLIGHT.x)
    lost = np.flatnonzero(truths.failed)
    promised, failed = [], []
    for k in range(runs):
        belief = flown(step, members=60, seed=k)
        place = truths.x[k, step] + 150.0 * rng.standard_normal(2)
        belief.learn(place, 150.0**2 * np.eye(2))
        promised.append(belief.rest_fails(FLIGHT.u, FLIGHT.x)[1].mean())
        failed.append(k in lost)
    gap = np.mean(promised) - np.mean(failed)
    assert abs(gap) < 5 * np.std(np.array(promised) - failed) / np.sqrt(runs) + 0.02
    assert np.mean(np.array(promised)[failed]) > np.mean(np.array(promised)[~np.array(failed)])


def test_a_restart_believes_the_place_and_forgets_the_wind() -> None:
    belief = flown(12.5)
    belief.learn(belief.estimate().mean + np.array([900.0, 0.0]), 100.0**2 * np.eye(2))
    place = belief.estimate().mean + np.array([9e3, -9e3])
    belief.restart(place, 50.0**2 * np.eye(2))
    now = belief.estimate()
    np.testing.assert_allclose(now.mean, place, atol=30.0)
    assert 45.0 < np.sqrt(now.cov[0, 0]) < 300.0
    np.testing.assert_allclose(belief.z[2:-2], 0.0)


# --- the robot's own errors -------------------------------------------------------------------

ERRING = coherent_problem(
    robot=RobotConfig(dt=DT, u_max=20.0, start_sd=50.0, airspeed_sd=0.05, heading_sd=4.0)
)


def erring_belief(steps: int, members: int = 200) -> tuple[Belief, Flight]:
    """The belief of a robot with errors that is told to have flown as planned, and its planned flight."""
    flight, belief = propagate(ERRING, STEPS), Belief(ERRING, members, SeedSequence(1))
    for t in range(steps):
        belief.advance(DT, DT * flight.u[t])
    return belief, flight


def test_a_belief_knows_the_errors_of_the_robot() -> None:
    """Without fixes it is the forecast of the plan; a fix at a step is that of the planner."""
    belief, flight = erring_belief(15)
    now = belief.estimate()
    np.testing.assert_allclose(now.mean, flight.x[15], atol=5.0)
    np.testing.assert_allclose(now.cov, square_matrices(flight.cov)[15], rtol=1e-3, atol=20.0)
    place, sd = flight.x[15] + [700.0, -400.0], 150.0
    learnt = Learnt.at(ERRING, flight.x, 15, [Fix(place, sd, 15)])
    belief.learn(place, sd**2 * np.eye(2))
    after = belief.estimate()
    np.testing.assert_allclose(after.mean, learnt.mean, atol=10.0)
    np.testing.assert_allclose(after.cov, learnt.cov, rtol=0.02, atol=20.0)


def test_a_belief_learns_the_errors_of_the_robot_from_fixes() -> None:
    """A robot that is 8 % faster than it says, in the expected wind: fixes tell it so, and members follow."""
    flight, belief = propagate(ERRING, STEPS), Belief(ERRING, 2000, SeedSequence(1))
    ahead = 0.08 * DT * np.cumsum(flight.u, axis=0)
    for t in range(30):
        belief.advance(DT, DT * flight.u[t])
        if t % 5 == 4:
            belief.learn(flight.x[t + 1] + ahead[t], 30.0**2 * np.eye(2))
    sd = np.sqrt(belief.cov[-4, -4])
    assert sd < 0.9
    assert belief.z[-4] > 0.3
    assert belief.errors[:, 0].mean() == pytest.approx(belief.z[-4], abs=0.25)
    assert belief.errors[:, 0].std() == pytest.approx(sd, rel=0.25)
