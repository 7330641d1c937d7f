"""Flights that correct their course spend other energy than the plan; without any left they land."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.extend import draw_flights
from pareto_ltl.kernels import flight as rollout
from pareto_ltl.kernels.pilots import Autopilot
from pareto_ltl.planning.evaluate import propagate_controls
from pareto_ltl.planning.wind_lookup import interpolate, interpolate_time
from pareto_ltl.settings import PowerConfig, RobotConfig
from pareto_ltl.simulation import flights as deployment
from pareto_ltl_verify.robot import power_law
from problems import box, make_problem, make_scene, rough_wind

DT, LAW, RUNS = 100.0, "independent", 40
SCENE = make_scene({"a": box(15, 8, 19, 12)}, start=(1, 10))
U = np.tile([8.0, 0.0], (20, 1))
POWERS = (
    PowerConfig(kind="body", base=50.0, drag=0.2),
    PowerConfig(kind="wing", base=20.0, drag=0.1, lift=900.0),
    PowerConfig(kind="rotor", base=30.0, drag=0.02, blade=80.0, lifting=90.0),
    PowerConfig(kind="table", base=10.0, points=[[2.0, 100.0], [7.0, 80.0], [12.0, 300.0]]),
)


def problem_of(power: PowerConfig, watt_hours: float | None, feedback_time: float | None = 300.0):
    robot = RobotConfig(
        dt=DT, u_min=2.0, u_max=12.0, feedback_time=feedback_time, power=replace(power, capacity=watt_hours)
    )
    return make_problem("F a", SCENE, rough_wind(SCENE), robot, fidelity="paper")


def spent_by(power: PowerConfig, problem, x: np.ndarray, mean: np.ndarray, white: np.ndarray) -> np.ndarray:
    """Energy [J] of each flight after each step, (n, T), from its positions and draws, in NumPy."""
    motion, wind, watts = problem.motion, problem.wind, power_law(vars(power))
    used = np.zeros((len(x), len(U)))
    for i, t in np.ndindex(*used.shape):
        variance = interpolate(wind, wind.latent, t, x[i, t]) + interpolate_time(wind, wind.gust, t)
        met = interpolate(wind, wind.mean, t, x[i, t]) + np.sqrt(variance) * white[t, i]
        expected = (mean[t + 1] - mean[t]) / DT - U[t]
        back = motion.gain / DT * (x[i, t] - mean[t]) + (1.0 - motion.exposed) * (met - expected)
        control = U[t] - back
        size = float(np.hypot(*control))
        used[i, t] = DT * watts(min(max(size, 2.0), 12.0))
    return used.cumsum(axis=1)


@pytest.mark.parametrize("power", POWERS, ids=lambda power: power.kind)
def test_a_robot_lands_where_its_corrected_course_has_spent_the_capacity(power: PowerConfig) -> None:
    free = problem_of(power, None)
    mean = propagate_controls(free, U, free.world.law).x
    white = np.random.default_rng(4).standard_normal((len(U), RUNS, 2))
    start = free.scene.start + np.random.default_rng(5).normal(0.0, 300.0, (RUNS, 2))

    def flown(problem) -> np.ndarray:
        x = np.empty((RUNS, len(U) + 1, 2))
        x[:, 0] = start
        draws = rollout.IndependentDraws(problem.laws[LAW], white)
        deployment.fly_draws(problem, draws, Autopilot(U, mean), x, problem.energy)
        return x

    whole = flown(free)
    used = spent_by(power, free, whole, mean, white)
    capacity = float(np.median(used[:, -1]))
    landed = flown(problem_of(power, capacity / 3600.0))
    near = np.abs(used - capacity) < 2e-5 * capacity  # the kernel reads the power from a table
    dry = used > capacity
    assert dry[:, -1].any()
    assert not dry[:, -1].all()
    for i in np.flatnonzero(~near.any(axis=1)):
        last = int(np.argmax(dry[i])) if dry[i].any() else len(U)
        np.testing.assert_array_equal(landed[i, : last + 1], whole[i, : last + 1])
        np.testing.assert_array_equal(
            landed[i, last:], np.broadcast_to(whole[i, last], landed[i, last:].shape)
        )


def test_the_controls_of_a_plan_are_flown_as_they_are() -> None:
    """Without feedback and fixes a flight spends what the plan does, which choosing it has compared."""
    tight = problem_of(POWERS[0], 1e-3, feedback_time=None)
    free = problem_of(POWERS[0], None, feedback_time=None)
    flights = [deployment.simulate_flights(p, U, 50, LAW, SeedSequence(1)) for p in (tight, free)]
    np.testing.assert_array_equal(flights[0].x, flights[1].x)


def test_flights_without_energy_fail_and_polishes_do_not_see_it() -> None:
    tight, free = problem_of(POWERS[0], 1e-3), problem_of(POWERS[0], None)
    flight = propagate_controls(free, U, free.world.law)
    drawn = {
        name: draw_flights(p, LAW, 60, SeedSequence(2)) for name, p in (("tight", tight), ("free", free))
    }
    assert drawn["tight"].failed(drawn["tight"].flown(U, flight.x)).all()
    assert not drawn["free"].failed(drawn["free"].flown(U, flight.x)).all()
    np.testing.assert_array_equal(drawn["tight"].positions(flight), drawn["free"].positions(flight))
    stopped = deployment.simulate_flights(tight, U, 60, LAW, SeedSequence(3), flight.x)
    assert stopped.failed.all()


@pytest.mark.parametrize("power", POWERS)
def test_a_robot_that_flies_faster_than_its_largest_airspeed_spends_what_that_takes(power):
    """Where its airspeed errs; the power at the largest airspeed would be too little."""
    problem = problem_of(power, 1e6)
    assert problem.energy is not None
    tank = deployment.full_tank(problem.motion, 1, problem.energy)
    for share in (0.6, 1.0, 1.015, 1.1, 1.4):
        before, speed = float(tank.spent[0]), share * problem.motion.u_max
        assert rollout.can_fly(tank, 0, speed, DT)
        wanted = DT * float(problem.energy.curve.watts(np.array([speed]))[0])
        assert tank.spent[0] - before == pytest.approx(wanted, rel=1e-3)
