"""A watched flight: the belief, the rest of the plan, and ten hours of telemetry.

python -m pytest benchmarks/bench_follow.py
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import psutil
import pytest
from numpy.random import SeedSequence

import pareto_ltl
from pareto_ltl_apps.conditioning import Fix
from pareto_ltl_apps.flight.belief import Belief
from pareto_ltl_apps.flight.following import follow
from pareto_ltl_apps.flight.replanning import replanned
from pareto_ltl_apps.flight.telemetry import Reading

HALF_WAY = 15  # steps
TEN_HOURS = 36_000.0
FIXES = 40


@pytest.fixture(scope="module")
def flight():
    """The default plan of phi1, and a belief of 1,000 flights half-way."""
    result = pareto_ltl.plan("phi1", "F(a & F b & F c)", report="none")
    problem, plan = result.problem, result.plan
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
        return sum(1 for _ in follow(result, memory_at_events(readings)))

    memory: list[float] = []

    def memory_at_events(readings: Iterator[Reading]) -> Iterator[Reading]:
        """The readings, with the memory of the process after each hour of them [MiB]."""
        for k, reading in enumerate(readings):
            if k % 36_000 == 0:
                memory.append(psutil.Process().memory_info().rss / 2**20)
            yield reading

    assert benchmark.pedantic(watched, rounds=1) > TEN_HOURS
    benchmark.extra_info["figures"] = [
        ("growth from the first to the last hour [MiB]", memory[-1] - memory[1], 20.0)
    ]


def test_new_plan_after_a_fix(benchmark, flight):
    """From a position fix half-way to the new plan, on phi1, at 40 places where the robot may be."""
    result, *_ = flight
    run, path = result, result.plan.path
    rng = np.random.default_rng(3)
    places = iter(rng.multivariate_normal(path.x[HALF_WAY], path.cov[HALF_WAY], FIXES + 1))
    seconds: list[float] = []

    def planned() -> None:
        made = replanned(run, None, [Fix(next(places), 500.0, HALF_WAY)])
        seconds.append(made.seconds)

    benchmark.pedantic(planned, rounds=FIXES, warmup_rounds=1)
    benchmark.extra_info["figures"] = [
        ("median, records to plan [s]", float(np.median(seconds[1:])), 1.5),
        ("95 % of them [s]", float(np.quantile(seconds[1:], 0.95)), 1.5),
    ]
