"""A watched flight: the belief, the rest of the plan, and ten hours of telemetry.

python -m pytest benchmarks/bench_follow.py
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import SeedSequence

import pareto_ltl
from pareto_ltl.inflight.belief import Belief
from pareto_ltl.inflight.following import follow
from pareto_ltl.inflight.telemetry import Reading
from pareto_ltl.run.records import PROBLEM

HALF_WAY = 15  # steps
TEN_HOURS = 36_000.0


@pytest.fixture(scope="module")
def flight():
    """The default plan of phi1, and a belief of 1,000 flights half-way."""
    result = pareto_ltl.plan("phi1", "F(a & F b & F c)", report="none")
    problem, plan = result.run.make(PROBLEM), result.plan
    belief, dt = Belief(problem, 1000, SeedSequence(1)), problem.motion.dt
    for t in range(HALF_WAY):
        belief.advance(dt, dt * plan.path.u[t])
    return result, belief, dt


def test_position_fix(benchmark, flight):
    _, belief, _ = flight
    benchmark.extra_info["budget"] = 5e-3
    benchmark(lambda: belief.learn(belief.estimate().mean, 1e8 * np.eye(2)))


def test_part_of_a_step(benchmark, flight):
    _, belief, dt = flight
    benchmark.extra_info["budget"] = 5e-3
    benchmark.pedantic(lambda: belief.advance(1e-4 * dt, np.zeros(2)), rounds=1000)


def test_rest_of_the_plan(benchmark, flight):
    result, belief, _ = flight
    benchmark.extra_info["budget"] = 0.2
    benchmark(lambda: belief.rest_fails(result.plan.path.u, result.plan.path.x))


def test_ten_hours_of_ten_readings_a_second(benchmark, flight):
    result, _, _ = flight
    benchmark.extra_info["budget"] = 60.0
    heading, airspeed = result.plan.navigation.heading_true[0], result.plan.navigation.airspeed[0]

    def watched() -> int:
        readings = (Reading(t, heading, airspeed) for t in np.arange(0.0, TEN_HOURS, 0.1))
        return sum(1 for _ in follow(result, readings))

    assert benchmark.pedantic(watched, rounds=1) > TEN_HOURS
