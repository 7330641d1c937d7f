"""Flights of the linearised law, for the search, beside those in the nonlinear winds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from coherent import SCENE, STEPS, coherent_problem
from landmarks import LANDMARK_WAY, landmark_problem
from oracle import importance as plain
from pareto_ltl.extend import draw_flights
from pareto_ltl.kernels.importance import NormalDraws
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.settings import PowerConfig, RobotConfig
from pareto_ltl.simulation.common_flights import draw_mirrored
from pareto_ltl.simulation.failure_modes import linear_law
from pareto_ltl.simulation.flights import BLOCK, draw_coherent
from problems import QUICK_ERROR, make_problem, smooth_wind

RUNS = 400


def both_deviations(problem, x, runs=RUNS):
    """Deviations of the same flights along ``x`` in the linearised law and in the law itself."""
    flight = propagate(problem, x)
    flights = draw_flights(problem, problem.fidelity.law, runs, SeedSequence(1))
    linear = flights.linear()
    assert linear.linearised
    np.testing.assert_array_equal(linear.exact().deviations(flight), flights.deviations(flight))
    return linear.deviations(flight), flights.deviations(flight)


@pytest.mark.parametrize("time", [None, 900.0])
def test_what_linear_winds_leave_out_falls_with_the_square_of_the_error(time):
    """They are the first-order part: half the error of the wind, half the share left out."""
    left = []
    for sd in (0.4, 0.2, 0.1):
        robot = RobotConfig(dt=100.0, u_max=20.0, feedback_time=time)
        linear, exact = both_deviations(coherent_problem(sd=sd, gust=0.1 * sd, rho=0.8, robot=robot), STEPS)
        left.append(np.sqrt(((linear - exact) ** 2).mean() / (exact**2).mean()))
    assert left[0] > 1e-3  # otherwise this tests nothing
    np.testing.assert_allclose([left[1] / left[0], left[2] / left[1]], 0.5, atol=0.1)


def test_flights_with_fixes_steer_by_them_in_linear_winds():
    problem = landmark_problem()
    linear, exact = both_deviations(problem, LANDMARK_WAY)
    flights = draw_flights(problem, "coherent", RUNS, SeedSequence(1))
    unaided = flights.linear().unaided(propagate(problem, LANDMARK_WAY))
    assert linear[-1].std() < 0.8 * unaided[-1].std()
    assert np.sqrt(((linear - exact) ** 2).mean() / (exact**2).mean()) < 0.1


def test_the_first_of_many_flights_are_those_of_few_flights_with_their_fixes():
    """So a coarse search of a long run finds what a quick run finds."""
    problem = landmark_problem()
    flight = propagate(problem, LANDMARK_WAY)
    few, many = (draw_flights(problem, "coherent", n * BLOCK, SeedSequence(1)) for n in (1, 3))
    first = many.only(np.arange(BLOCK))
    np.testing.assert_array_equal(first.deviations(flight), few.deviations(flight))
    assert (few.noise != 0.0).any()


def test_flights_of_one_seed_are_the_same_whatever_was_drawn_from_it_before():
    problem, seed = landmark_problem(), SeedSequence(1)
    flight = propagate(problem, LANDMARK_WAY)
    once, again = (draw_flights(problem, "coherent", BLOCK, seed).deviations(flight) for _ in range(2))
    np.testing.assert_array_equal(once, again)


def test_airspeed_limits_hold_in_linear_winds():
    """A correction beyond the largest airspeed is limited, as in the winds themselves."""
    robot = RobotConfig(dt=100.0, u_max=6.0, feedback_time=900.0)
    problem = coherent_problem(sd=1.5, gust=0.1, rho=0.9, robot=robot)
    linear, exact = both_deviations(problem, STEPS)
    free = coherent_problem(sd=1.5, gust=0.1, rho=0.9, robot=replace(robot, u_max=60.0))
    unlimited, _ = both_deviations(free, STEPS)
    apart = [np.sqrt(((off - exact) ** 2).mean()) for off in (linear, unlimited)]
    assert apart[0] < 0.5 * apart[1]


def test_draws_of_new_winds_at_every_step_are_not_linearised():
    problem = make_problem("F a", SCENE, smooth_wind(SCENE), RobotConfig(dt=100.0, u_max=20.0))
    np.testing.assert_array_equal(*both_deviations(problem, STEPS))


def test_linear_flights_are_a_matrix_times_their_draws():
    """Against M of the plain implementation, with the same generators as the flights."""
    problem = coherent_problem(hours=0.25, rho=0.6, error=QUICK_ERROR)
    flight, wind = propagate(problem, STEPS), SeedSequence(1).spawn(3)[0]
    linear, _ = both_deviations(problem, STEPS, 60)
    drawn = draw_coherent(problem, 60, problem.horizon, np.random.default_rng(wind.spawn(1)[0]))
    flights = draw_flights(problem, "coherent", 60, SeedSequence(1))
    np.testing.assert_array_equal(drawn.theta, flights.draws.theta)
    law = linear_law(problem, flight, problem.laws["coherent"])
    joined = plain.joined(
        NormalDraws(
            flights.start / law.start_sd,
            drawn.white[: len(flight.u)],
            innovations(drawn.theta, law.kept)[: len(law.kept)],
            flights.errors,
        )
    )
    expected = np.einsum("tid,nd->tin", plain.deviation_map(law), joined)
    np.testing.assert_allclose(linear, expected, atol=1e-4 * np.abs(expected).max())


def innovations(theta, kept):
    """η of θ_k = ρ_k θ_{k-1} + √(1 - ρ_k²) η_k; 0 where ρ_k = 1."""
    eta = theta.astype(float)
    for k in range(1, len(kept)):
        fresh = np.sqrt(1.0 - kept[k].astype(float) ** 2)
        change = theta[k] - kept[k] * theta[k - 1]
        eta[k] = np.divide(change, fresh, out=np.zeros_like(change, float), where=fresh > 0.0)
    return eta.astype(np.float32)


def test_flights_that_need_more_energy_than_there_is_are_exhausted():
    """With a capacity between what its flights spend, as many as land in flights with that capacity."""
    power = PowerConfig(kind="body", base=50.0, drag=0.2)
    robot = RobotConfig(dt=100.0, u_max=20.0, feedback_time=900.0, power=power)
    problem = coherent_problem(sd=1.0, gust=0.1, rho=0.9, robot=robot)
    flight = propagate(problem, STEPS)
    planned = problem.energy.of(flight.u, problem.motion.dt)
    for share in (0.5, 1.01, 2.0):
        tight = replace(problem, energy=replace(problem.energy, capacity=share * planned))
        flights = draw_flights(tight, "coherent", RUNS, SeedSequence(1))
        x = flights.flown(flight.u, flight.x)
        landed = (x[:, -1] == x[:, -2]).all(axis=1)
        off, exhausted = flights.ended(flight)
        np.testing.assert_array_equal(exhausted, landed)
        np.testing.assert_array_equal(off, flights.deviations(flight))
    assert not draw_flights(problem, "coherent", RUNS, SeedSequence(1)).ended(flight)[1].any()


def test_linear_deviations_are_those_of_flights_in_linear_winds():
    """The recursion of the law and flights of a pilot with the robot's own errors, step by step."""
    robot = RobotConfig(dt=100.0, u_max=20.0, airspeed_sd=0.03, heading_sd=2.0, clock_sd=20.0)
    problem = coherent_problem(sd=1.0, gust=0.3, rho=0.9, robot=robot)
    flight = propagate(problem, STEPS)
    flights = draw_flights(problem, "coherent", RUNS, SeedSequence(4)).linear()
    flown = flights.positions(flight) - flight.x
    off = flights.deviations(flight)
    assert np.abs(off[-1]).min() > 1.0
    np.testing.assert_allclose(np.moveaxis(off, 2, 0), flown, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("runs", [BLOCK, 2 * BLOCK + 1])
def test_every_second_mirrored_flight_errs_the_opposite_way(runs):
    """In the errors of winds, gusts, fixes and start; linear winds then make opposite deviations."""
    for problem, way in (
        (coherent_problem(sd=0.4, gust=0.1, rho=0.8), STEPS),
        (landmark_problem(), LANDMARK_WAY),
    ):
        flight = propagate(problem, way)
        flights = draw_mirrored(problem, "coherent", runs, SeedSequence(1))
        half = draw_flights(problem, "coherent", -(-runs // 2), SeedSequence(1))
        assert len(flights) == runs
        for name in ("white", "theta"):
            drawn, drawn_half = (getattr(one.draws, name) for one in (flights, half))
            np.testing.assert_array_equal(drawn[:, ::2], drawn_half)
            np.testing.assert_array_equal(drawn[:, 1::2], -drawn_half[:, : runs // 2])
        np.testing.assert_array_equal(flights.noise[:, 1::2], -flights.noise[:, : 2 * (runs // 2) : 2])
        off = flights.linear().unaided(flight)
        scale = np.abs(off).max()
        np.testing.assert_allclose(off[..., 1::2], -off[..., : 2 * (runs // 2) : 2], atol=1e-6 * scale)
