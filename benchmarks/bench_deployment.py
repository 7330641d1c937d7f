"""Deployment budgets: 500 flights of 100 steps in 50 ms, 100,000 in 5 s.

python -m pytest benchmarks/bench_deployment.py
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.simulation import flights as deployment
from problems import paper_problem

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
