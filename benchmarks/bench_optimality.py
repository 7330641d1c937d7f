"""How close a default run comes to the best known front (``best_known.json``, ``search_best_known.py``).

For each mission and border: the ratio of the failure rates at equal length, and the hypervolume over that of
the best known front. Rates are those of flights that neither search has seen.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pareto_ltl.planning.selection import hypervolume
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import FRONT
from pareto_ltl.run.stages import PLAN_TABLE
from pareto_ltl.settings.building import build_settings
from search_best_known import KEPT

KNOWN: dict[str, list[dict[str, float]]] = json.loads(KEPT.read_text()) if KEPT.is_file() else {}
BOXES = {"phi1": (1800e3, 3000e3, 0.15), "phi2": (1450e3, 2400e3, 0.2)}  # lengths [m], largest failure
LEAST_RATE = 1e-3  # failures below it count as equal


def dominated_share(rows: np.ndarray[Any, Any], box: tuple[float, float, float]) -> float:
    """Share of the box (shortest, longest, failure) that rows (failure, length) dominate."""
    short, long, worst = box
    inside = rows[(rows[:, 0] < worst) & (rows[:, 1] < long)]
    moved = np.column_stack([inside[:, 0], np.maximum(inside[:, 1] - short, 0.0)])
    return hypervolume(moved, np.array([worst, long - short]))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("case", KNOWN)
def test_a_default_run_against_the_best_known_front(benchmark: Any, case: str, seed: int) -> None:
    name, border = case.split("_")
    settings = build_settings({
        "pipelines": "plan", "scene": name, "mission": name, "robot": {"dt": 1800.0},
        "fidelity": "full", "seed": seed,
    })  # fmt: skip
    run = Run(replace(settings, scene=replace(settings.scene, border=border)), PLAN_TABLE)
    front = benchmark.pedantic(lambda: run.make(FRONT), rounds=1, iterations=1)
    rows = np.array([[r.failure, p.objectives.length] for r, p in zip(front.rates, front.paths, strict=True)])
    known = np.array([[row["failure"], row["length_m"]] for row in KNOWN[case]])
    ratios = []
    for length in np.linspace(known[0, 1], known[-1, 1], 40):
        own, best = rows[rows[:, 1] <= length, 0], known[known[:, 1] <= length, 0]
        if len(own) and best.min() < BOXES[name][2]:
            ratios.append(max(own.min(), LEAST_RATE) / max(best.min(), LEAST_RATE))
    benchmark.extra_info["median failure over best known"] = float(np.median(ratios))
    volume = dominated_share(known, BOXES[name])
    benchmark.extra_info["hypervolume over best known"] = dominated_share(rows, BOXES[name]) / volume
