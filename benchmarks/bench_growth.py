"""Growth budgets: vertices per second, time to the first path, cost at a million vertices, bytes per vertex.

    python -m pytest benchmarks/bench_growth.py

Paper fidelity on the two missions in a rough wind of up to 10 m/s, kernels compiled.
"""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.planning import growth
from pareto_ltl.planning.growth import GrowthOptions
from pareto_ltl.planning.records import Forest
from pareto_ltl.settings import PlannerConfig
from problems import paper_problem


@pytest.fixture(scope="module", params=["phi1", "phi2"])
def problem(request):
    """A mission; kernels are compiled by a first small forest."""
    made = paper_problem(request.param)
    growth.grow_forest(PlannerConfig(trees=1, n_max=50), made, SeedSequence(0))
    return made


def speed(forest: Forest) -> float:
    """Vertices per second and core."""
    return sum(map(len, forest.trees)) / sum(tree.seconds for tree in forest.trees)


def test_vertices_a_second_on_one_core(benchmark, problem):
    cfg = PlannerConfig(trees=8, n_max=2500, threads=1)
    forests: list[Forest] = []
    benchmark.pedantic(lambda: forests.append(growth.grow_forest(cfg, problem, SeedSequence(0))), rounds=5)
    benchmark.extra_info["figures"] = [("vertices/s", float(np.median([*map(speed, forests)])), 350_000)]
    benchmark.extra_info["sense"] = ">="


def test_ten_trees_on_two_threads(benchmark, problem):
    cfg = PlannerConfig(trees=10, n_max=2500, threads=2)
    benchmark.extra_info["budget"] = 0.1
    forest = benchmark.pedantic(
        growth.grow_forest, (cfg, problem, SeedSequence(0)), rounds=5, warmup_rounds=1
    )
    assert len(forest.accepted) > 0


def test_time_a_vertex_at_a_million(benchmark, problem):
    """Time per vertex at 10^6 vertices divided by that at 10^4; takes minutes if the budget is exceeded."""
    small = PlannerConfig(trees=1, n_max=10_000)
    large = PlannerConfig(trees=1, n_max=1_000_000)
    few = max(speed(growth.grow_forest(small, problem, SeedSequence(seed))) for seed in range(3))
    forest = benchmark.pedantic(growth.grow_forest, (large, problem, SeedSequence(0)), rounds=1)
    assert len(forest.trees[0]) == 1_000_000
    benchmark.extra_info["figures"] = [("times the cost at 10^4", few / speed(forest), 2.0)]


def test_first_accepted_path(benchmark, problem):
    """One tree per repetition, each with another seed.

    Not every seed finds a path: if the first vertices in a region are late, the tree may reach the end of the
    wind data.
    """
    cfg = PlannerConfig(trees=1, n_max=5000)
    seeds, found = iter(SeedSequence(0).spawn(1000)), []

    def first() -> None:
        found.append(
            len(
                growth.grow_forest(
                    cfg, problem, next(seeds), options=GrowthOptions(stop_at_first=True)
                ).accepted
            )
        )

    benchmark.extra_info["budget"] = 0.010
    benchmark.pedantic(first, rounds=40)
    benchmark.extra_info["figures"] = [
        ("share of trees that find one", sum(map(bool, found)) / len(found), 0.95)
    ]
    benchmark.extra_info["sense"] = ">="


def test_bytes_a_vertex(benchmark, problem):
    """Peak memory of the growth of a tree and of its record, with the tables of the product graph."""
    n = 100_000
    cfg = PlannerConfig(trees=1, n_max=n)

    def peak() -> float:
        tracemalloc.start()
        growth.grow_forest(cfg, problem, SeedSequence(0))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most / n

    benchmark.extra_info["figures"] = [("peak [B]", benchmark.pedantic(peak, rounds=1), 250)]
