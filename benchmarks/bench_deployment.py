"""Deployment budgets.

500 flights of 100 steps in 50 ms, 100,000 in 5 s; 100,000 coherent flights of 50 steps in 1.5 s; a rare
failure within 5 % in 1 s.

python -m pytest benchmarks/bench_deployment.py
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import SeedSequence

import pareto_ltl
from pareto_ltl.extend import draw_flights
from pareto_ltl.planning.evaluate import propagate_controls
from pareto_ltl.planning.rates import WEIGHTED
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import Settings
from pareto_ltl.simulation import flights as deployment
from pareto_ltl.simulation import importance
from problems import MISSIONS, paper_problem

STEPS = 100


@pytest.fixture(scope="module")
def mission():
    """phi2 and the controls of a wide circle through its obstacles; one simulation compiles the kernels."""
    problem = paper_problem("phi2", slots=18)
    angle = np.linspace(0, 2 * np.pi, STEPS, endpoint=False)
    u = 12.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    deployment.simulate_flights(problem, u, 2, "independent", SeedSequence(0))
    return problem, u


@pytest.mark.parametrize(("runs", "budget"), [(500, 0.05), (100_000, 5.0)])
def test_flights_of_100_steps(benchmark, mission, runs, budget):
    problem, u = mission
    benchmark.extra_info["budget"] = budget
    rounds = 20 if runs < 1000 else 3
    arguments = (problem, u, runs, "independent", SeedSequence(1))
    result = benchmark.pedantic(deployment.simulate_flights, arguments, rounds=rounds, warmup_rounds=1)
    assert result.x.shape == (runs, STEPS + 1, 2)
    assert np.isfinite(result.x).all()


@pytest.fixture(scope="module")
def windy():
    """phi2 in the coherent winds of the sample, with the modes of full runs, and a tour of 50 steps."""
    given = {"pipelines": "plan", "scene": "phi2", "mission": {"formula": MISSIONS["phi2"]}}
    settings = Settings.of(given | {"fidelity": "full", "robot": {"dt": 1800.0}})
    problem = Run(settings).problem
    angle = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    u = 12.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    deployment.simulate_flights(problem, u, 2, "coherent", SeedSequence(0))
    return problem, u


def test_100_000_coherent_flights_of_50_steps(benchmark, windy):
    problem, u = windy
    benchmark.extra_info["budget"] = 1.5
    arguments = (problem, u, 100_000, "coherent", SeedSequence(1))
    result = benchmark.pedantic(deployment.simulate_flights, arguments, rounds=5, warmup_rounds=1)
    assert result.x.shape == (100_000, 51, 2)


def test_one_roll_out_of_1_500_coherent_flights(benchmark, windy):
    """Positions of flights whose random numbers are given; the sampled refinement needs them 1,000 times."""
    problem, u = windy
    path = propagate_controls(problem, u, problem.laws["coherent"])
    flights = draw_flights(problem, "coherent", 1_500, SeedSequence(1))
    benchmark.extra_info["budget"] = 0.006
    positions = benchmark(flights.positions, path)
    assert positions.shape == (1_500, 51, 2)


@pytest.fixture(scope="module")
def safe_plan():
    """A plan for phi2 with feedback, in the winds of the sample: it fails in a few of 10,000 flights."""
    planned = pareto_ltl.plan(
        "phi2", MISSIONS["phi2"], fidelity="full", robot={"dt": 1800.0, "feedback_time": 18000.0}
    )
    importance.weighted_rate(planned.problem, planned.plan.path, 250, SeedSequence(0))
    return planned.problem, planned.plan.path


def test_rate_of_a_rare_failure_from_20_000_draws(benchmark, safe_plan):
    problem, path = safe_plan
    arguments = (problem, path, 20_000, SeedSequence(1))
    rate = benchmark.pedantic(importance.weighted_rate, arguments, rounds=5, warmup_rounds=1)
    proposal = importance.make_proposal(problem, path)
    weights, failed = importance.weighted_flights(proposal, *arguments[2:])
    error = float(np.where(failed, weights, 0.0).std()) / np.sqrt(20_000) / rate.failure
    benchmark.extra_info["budget"] = 1.0
    benchmark.extra_info["figures"] = [(f"standard error at {rate.failure:.1e}", error, 0.05)]
    assert rate.method == WEIGHTED
