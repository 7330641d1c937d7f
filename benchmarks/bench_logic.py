"""Formulas to automata: the missions, coverage, long sequences and keys over all letters.

python -m pytest benchmarks/bench_logic.py
"""

from __future__ import annotations

import tracemalloc

import pytest

from ltlf import patterns
from pareto_ltl.logic import translate


def disjoint(names: list[str]) -> list[frozenset[str]]:
    return [frozenset[str](), *(frozenset({name}) for name in names)]


@pytest.mark.parametrize(
    ("formula", "regions", "states"),
    [("F(a & F b & F c)", "abc", 5), ("F(a & F(b & F c)) | F(a & F(d & F c))", "abcd", 4)],
    ids=["phi1", "phi2"],
)
def test_translate_mission(benchmark, formula, regions, states):
    benchmark.extra_info["budget"] = 2e-3
    assert benchmark(translate, formula, disjoint(list(regions))).n_states == states


@pytest.mark.parametrize(("goals", "budget"), [(10, 0.05), (12, 0.3)])
def test_coverage_of_disjoint_regions(benchmark, goals, budget):
    names = [f"p{i}" for i in range(goals)]
    benchmark.extra_info["budget"] = budget
    found = benchmark.pedantic(
        translate, (patterns.coverage(*names), disjoint(names)), rounds=5, warmup_rounds=1
    )
    assert found.n_states == 2**goals


def test_sequence_of_twelve_over_all_letters(benchmark):
    benchmark.extra_info["budget"] = 1.0
    text = patterns.sequence(*(f"p{i}" for i in range(12)))
    assert benchmark.pedantic(translate, (text,), rounds=5, warmup_rounds=1).n_states == 13


def test_six_keys_and_doors_over_all_letters(benchmark):
    benchmark.extra_info["budget"] = 0.05
    text = patterns.key_door(*((f"k{i}", f"d{i}") for i in range(6)))
    assert benchmark.pedantic(translate, (text,), rounds=5, warmup_rounds=1).n_states > 700


@pytest.mark.parametrize("goals", [8, 9, 10, 11, 12, 13])
def test_coverage_with_its_preorder(benchmark, goals):
    """2^goals states: translation and language inclusion, with the peak of the arrays that they make."""
    names = [f"p{i}" for i in range(goals)]
    text = patterns.coverage(*names)

    def peak() -> float:
        tracemalloc.start()
        assert translate(text, disjoint(names)).preorder.sum() == 3**goals
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most / 2**20

    benchmark.extra_info["budget"] = 2.0
    benchmark.extra_info["figures"] = [("peak [MiB]", peak(), 256)]
    benchmark.pedantic(lambda: translate(text, disjoint(names)).preorder, rounds=3)


def test_hoa_of_ten_fold_coverage(benchmark):
    names = [f"p{i}" for i in range(10)]
    automaton = translate(patterns.coverage(*names), disjoint(names))
    assert len(benchmark.pedantic(automaton.to_hoa, rounds=3)) > 1000
