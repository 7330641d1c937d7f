"""What of a front depends on the seed of its run."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from pareto_ltl.run.front_stage import REFINERS, Search, make_front
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import Settings
from pareto_ltl.support.budget import Budget
from quick_wind import QUICK_WIND

SCENE = {
    "name": "two sides", "unit": 1e5, "centre": [37.0, -92.0], "bounds": [[0, 0], [10, 10]], "start": [1, 5],
    "regions": {"a": [[7, 4], [9, 4], [9, 6], [7, 6]]},
    "obstacles": [[[4, 4.2], [4.5, 4.2], [4.5, 6], [4, 6]]],
}  # fmt: skip
SMALL: dict[str, Any] = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 1, "n_max": 400, "max_steps": 60},
    "refine": {"flights": 100, "sweep_flights": 50, "classes": 2, "points": 4},
    "selection": {"draws": 500, "runs": 1000},
    "wind": QUICK_WIND,
    "deployment": {"runs": 1000},
    "report": {"figures": False},
}


@pytest.fixture(scope="module")
def run() -> Run:
    return pareto_ltl.plan(SCENE, "F a", **SMALL)


def again(run: Run, **changed: Any) -> Run:
    """A run of the same problem with other settings, whose trees are not grown yet."""
    return Run(replace(run.settings, **changed), run.make("scene", "cells", "automaton", "wind", "problem"))


def same_trees(run: Run, other: Run) -> bool:
    pairs = zip(run.forest.trees, other.forest.trees, strict=True)
    return all(np.array_equal(one.x, two.x) for one, two in pairs)


def found(run: Run) -> list[bytes]:
    """The paths that the search finds."""
    search = Search(run.settings, run.problem, run.forest, Budget())
    return [path.x.tobytes() for path in REFINERS["sampled"](search, ())]


def test_seeds_search_with_the_same_trees_and_flights_and_are_judged_by_others(run: Run) -> None:
    one, other = again(run, seed=3), again(run, seed=4)
    assert same_trees(one, other)
    assert len(found(one)) >= 2
    assert found(one) == found(other)
    first, second = (
        make_front(Search(each.settings, each.problem, each.forest, Budget())).failed for each in (one, other)
    )
    assert first.shape != second.shape or (first != second).any()


def test_another_seed_of_the_search_is_another_search(run: Run) -> None:
    other = again(run, refine=replace(run.settings.refine, seed=1))
    assert not same_trees(run, other)
    assert found(run) != found(other)


def test_a_search_of_no_seed_has_the_seed_of_the_run(run: Run) -> None:
    own = again(run, seed=1, refine=replace(run.settings.refine, seed=None))
    other = again(run, refine=replace(run.settings.refine, seed=1))
    assert same_trees(own, other)
    assert found(own) == found(other)


def test_trees_of_the_published_method_follow_from_the_seed_of_the_run() -> None:
    settings = [Settings.of({"fidelity": "paper", "seed": seed}) for seed in (3, 4)]
    assert [each.search_seed for each in settings] == [3, 4]
    assert Settings.of({"seed": 3}).search_seed == 0
