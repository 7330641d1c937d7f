"""What of a front depends on the seed of its run."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import pareto_ltl
from pareto_ltl.run.front_stage import REFINERS, Search, make_front
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


def test_seeds_search_with_the_same_flights_and_are_judged_by_others() -> None:
    """From the same trees they find the same paths; no flight that judges these is one of the search."""
    run = pareto_ltl.plan(SCENE, "F a", **SMALL)
    searches = [
        Search(replace(run.settings, seed=seed), run.problem, run.forest, Budget()) for seed in (3, 4)
    ]
    one, other = (REFINERS["sampled"](search, ()) for search in searches)
    assert len(one) >= 2
    for path, same in zip(one, other, strict=True):
        np.testing.assert_array_equal(path.x, same.x)
    first, second = (make_front(search).failed for search in searches)
    assert first.shape != second.shape or (first != second).any()
