"""Our side: the missions of the package in calm air, and the logic."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from ltlf import formula
from pareto_ltl.logic import translate
from pareto_ltl.planning import growth
from pareto_ltl.planning.growth import GrowthOptions
from pareto_ltl.planning.records import Forest
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import PlannerConfig, Settings

UNIT = 1e5  # peers get coordinates in units of 100 km [m]
ORDERS = {"phi1": (("a", "b", "c"), ("a", "c", "b")), "phi2": (("a", "b", "c"), ("a", "d", "c"))}


@dataclass(frozen=True, slots=True)
class Mission:
    """A mission of the package without wind, `fidelity=paper`, one thread."""

    name: str
    settings: Settings
    records: dict[str, Any]

    @classmethod
    def named(cls, name: str) -> Mission:
        settings = Settings.of(
            {"pipelines": "plan", "scene": name, "mission": name, "wind": "calm", "fidelity": "paper"}
            | {"robot": {"dt": 1800.0}, "planner": {"threads": 1}}
        )
        return cls(name, settings, Run(settings).make("scene", "cells", "problem"))

    def first_path(self, seed: int) -> float:
        """CPU time to the first path of one tree [s], with preparation of growth; inf if there is none."""
        cfg = PlannerConfig(trees=1, n_max=20_000, threads=1)
        options = GrowthOptions(stop_at_first=True)
        began = time.process_time()
        forest = growth.grow_forest(cfg, self.records["problem"], SeedSequence(seed), options=options)
        return time.process_time() - began if len(forest.accepted) else float("inf")

    def plan(self, seed: int) -> dict[str, float]:
        """CPU time of growth, and with smoothing [s], the length of the best path of each [km], vertices."""
        run = Run(replace(self.settings, seed=seed), dict(self.records))
        began = time.process_time()
        forest = run.forest
        grown = time.process_time() - began
        front = run.front
        return {
            "grown": grown, "grown_length": shortest(forest), "vertices": sum(map(len, forest.trees)),
            "planned": time.process_time() - began,
            "planned_length": min(path.objectives.length for path in front.paths) / 1e3,
        }  # fmt: skip

    def for_peers(self) -> dict[str, Any]:
        """The map in units of 100 km from its south-west corner, with the cells of the decomposition."""
        scene, cells = self.records["scene"], self.records["cells"]
        corner = scene.bounds[0]

        def scaled(points: Any) -> Any:
            return ((np.asarray(points) - corner) / UNIT).tolist()

        return {
            "side": float((scene.bounds[1] - corner).max() / UNIT),
            "start": scaled(scene.start),
            "obstacles": [scaled(polygon) for polygon in cells.obstacles],
            "regions": {name: scaled(polygon) for name, (polygon,) in scene.regions.items()},
            "cells": [scaled(cell) for cell in cells.cells],
            "doors": cells.doors.tolist(),
            "inside": {
                name: [i for i, label in enumerate(cells.labels) if name in label] for name in scene.regions
            },
            "step": float(self.records["problem"].reach / UNIT),
        }


def shortest(forest: Forest) -> float:
    """Length of the shortest path that completes the mission [km]; inf if there is none."""
    return min((float(forest.trees[j].length[v]) for j, v in forest.accepted), default=float("inf")) / 1e3


def cpu_seconds(call: Callable[[], object]) -> float:
    began = time.process_time()
    call()
    return time.process_time() - began


def translation_seconds(text: str, letters: Iterable[Iterable[str]] | None) -> float:
    """CPU time from the text of a formula to its minimal automaton [s]."""
    formula._parsed.cache_clear()  # noqa: SLF001 - else the second time costs nothing
    return cpu_seconds(lambda: translate(text, letters))
