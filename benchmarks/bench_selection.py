"""Selection: the filter of 25,000 accepted vertices, and the evaluation of the paths on the front.

python -m pytest benchmarks/bench_selection.py
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import SeedSequence

from oracle import path_risk as risk
from pareto_ltl.planning import growth, selection
from pareto_ltl.settings import PlannerConfig
from problems import paper_problem


@pytest.fixture(scope="module", params=["phi1", "phi2"])
def planted(request):
    problem = paper_problem(request.param)
    return problem, growth.grow_forest(PlannerConfig(), problem, SeedSequence(0))


@pytest.mark.parametrize("rows", [25_000, 250_000])
def test_filter_three_objectives(benchmark, rows):
    costs = np.random.default_rng(0).random((rows, 3))
    benchmark.extra_info["budget"] = 0.015 * rows / 25_000
    benchmark(selection.non_dominated, costs)


def test_front_of_ten_trees(benchmark, planted):
    problem, forest = planted
    benchmark.extra_info["budget"] = 0.25
    front = benchmark.pedantic(selection.tree_front, (problem, forest), rounds=3, warmup_rounds=1)
    benchmark.extra_info["paths"] = len(front)
    assert len(front) > 0


def test_ordered_bound_of_one_path(benchmark, planted):
    problem, forest = planted
    path = selection.tree_front(problem, forest)[0]
    benchmark.extra_info["budget"] = 0.05
    benchmark(risk.ordered_bound, problem, path.x, path.cov)
