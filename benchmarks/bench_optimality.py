"""Fronts of default runs against the best known fronts (``best_known.json``, ``search_best_known.py``).

For each mission and border: the ratio of the failure rates at equal length, and the ratio of the
hypervolumes. Rates are from flights that neither search has used.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from pareto_ltl.planning.selection import hypervolume
from search_best_known import KEPT, benchmark_run

KNOWN: dict[str, list[dict[str, float]]] = json.loads(KEPT.read_text()) if KEPT.is_file() else {}
BOXES = {"phi1": (1800e3, 3000e3, 0.15), "phi2": (1450e3, 2400e3, 0.2)}  # lengths [m], largest failure
MOST = 0.2  # largest failure of other missions; their lengths come from the best known front
RATIOS = {True: 1.3, False: 1.5}  # of failures at equal length, median: of the two missions, of random ones
LEAST_SHARE = 0.9  # of the best known hypervolume
LEAST_RATE = 1e-3  # failures below it count as equal


def dominated_share(rows: np.ndarray[Any, Any], box: tuple[float, float, float]) -> float:
    """Share of the box (shortest, longest, failure) that rows (failure, length) dominate."""
    short, long, worst = box
    inside = rows[(rows[:, 0] < worst) & (rows[:, 1] < long)]
    moved = np.column_stack([inside[:, 0], np.maximum(inside[:, 1] - short, 0.0)])
    return hypervolume(moved, np.array([worst, long - short]))


@pytest.mark.parametrize(
    ("case", "seed"), [(case, seed) for case in KNOWN for seed in range(2 if "random" in case else 4)]
)
def test_a_default_run_against_the_best_known_front(benchmark: Any, case: str, seed: int) -> None:
    name, border = case.split("_")
    run = benchmark_run(name, border, seed)
    run.make("forest")
    front = benchmark.pedantic(lambda: run.front, rounds=1, iterations=1)
    rows = np.array([[r.failure, p.objectives.length] for r, p in zip(front.rates, front.paths, strict=True)])
    known = np.array([[row["failure"], row["length_m"]] for row in KNOWN[case]])
    box = BOXES.get(name, (known[0, 1], known[-1, 1], MOST))
    ratios = []
    for length in np.linspace(known[0, 1], known[-1, 1], 40):
        own, best = rows[rows[:, 1] <= length, 0], known[known[:, 1] <= length, 0]
        if len(own) and best.min() < box[2]:
            ratios.append(max(own.min(), LEAST_RATE) / max(best.min(), LEAST_RATE))
    share = dominated_share(rows, box) / dominated_share(known, box)
    benchmark.extra_info["figures"] = [
        ("failure over best known", float(np.median(ratios)), RATIOS[name in BOXES], "<="),
        ("hypervolume over best known", share, LEAST_SHARE, ">="),
    ]
