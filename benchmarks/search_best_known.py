"""A slow, wide search for the best front, written to ``best_known.json`` for ``bench_optimality``.

    python benchmarks/search_best_known.py phi1 phi2 --border open --minutes 5
    python benchmarks/search_best_known.py random0 random1 random2 random3 random4 random5 --minutes 4

Many starts (the trees of four seeds, taut lines, other sides), then random changes of the best path at each
length: another number of steps, a bump, other times, polished on more flights than a run has. Rates are
computed from 20,000 flights that no search has used.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator, SeedSequence

from pareto_ltl.extend import draw_flights, simulate_flights
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.effort import Effort, Polish
from pareto_ltl.planning.refine.front_sweep import finished, swept
from pareto_ltl.planning.refine.levels import looks
from pareto_ltl.planning.refine.sampled import Candidate, resampled_means
from pareto_ltl.planning.refine.starts import Start, StartKind, first_starts
from pareto_ltl.planning.refine.sweep import first_of, new_sweep
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import RefineConfig, Settings, preset
from pareto_ltl_apps.studies.forecast_test import mission_settings
from pareto_ltl_apps.studies.random_missions import Spell
from pareto_ltl_apps.studies.random_missions import mission as random_mission
from pareto_ltl_apps.studies.settings import HindcastConfig

KEPT = Path(__file__).with_name("best_known.json")
SEEDS = (100, 101, 102, 103)  # of the trees: none that a benchmark plans with
WIDE = RefineConfig(flights=3000, sweep_flights=600, classes=8, points=30)
RANDOM_SEED = 11  # of the random missions
JUDGING = 20_000
STEP = 0.015  # ratio of neighbouring lengths that are kept, less one


@dataclass(slots=True)
class Best:
    """The best candidate at each of many lengths [m]."""

    caps: np.ndarray[Any, Any]
    paths: dict[int, Candidate] = field(default_factory=dict)

    def offer(self, k: Candidate) -> None:
        """Keep ``k`` at every length that it fits and fails least at."""
        for i in np.flatnonzero(self.caps >= k.length).tolist():
            if i not in self.paths or k.smoothed < self.paths[i].smoothed:
                self.paths[i] = k


def benchmark_run(name: str, border: str, seed: int) -> Run:
    """A run of phi1, phi2 or a random mission (``random0``, ...) in the packaged wind, default settings."""
    number = name.removeprefix("random")
    if number == name:
        choices: dict[str, Any] = {"scene": name, "mission": name, "robot": {"dt": 1800.0}}
        settings = Settings.of({"pipelines": "plan"} | choices).with_seed(seed)
        return Run(replace(settings, scene=replace(settings.scene, border=border)))
    settings = Settings.of({"pipelines": "plan"})
    times = Run(settings).readings.times
    spell = Spell(0, len(times) - 1, float(times[0]), float(times[-1]))
    task = random_mission(HindcastConfig(), RANDOM_SEED, int(number), [spell], border)
    settings = mission_settings(settings, HindcastConfig(), task, preset("full"))
    return Run(settings.with_seed(seed), {"scene": task.scene})


def paper_run(run: Run) -> Run:
    """The mission of ``run`` on its map, by the paper's method."""
    return Run(replace(run.settings, fidelity=preset("paper")), run.make("scene", "cells"))


def wide_search(name: str, border: str, minutes: float) -> list[dict[str, float]]:
    """Failure rates and lengths of the best paths found, shortest first."""
    rng = np.random.default_rng([7, len(name)])
    problem = benchmark_run(name, border, SEEDS[0]).problem
    starts: dict[StartKind, Start] = {}
    for seed in SEEDS:
        starts |= first_starts(problem, benchmark_run(name, border, seed).forest)
    law = problem.fidelity.law
    flights = draw_flights(problem, law, WIDE.flights, SeedSequence(8))
    sweep = new_sweep(Effort.of(WIDE), problem, first_of(flights))
    seen = swept(sweep, looks(sweep, starts))
    found = finished(sweep, [sweep.reassessed(k, sweep.flights) for k in seen])
    half = flights.only(np.arange(WIDE.flights // 2))
    best = Best(np.exp(np.arange(np.log(found[0].length), np.log(1.1 * found[-1].length), STEP)))
    for k in found:
        best.offer(k)
    how = sweep.polish_of(Polish((0.008, 0.008, 0.004, 0.004, 0.0025, 0.0025), 4))
    end = time.process_time() + 60 * minutes
    while time.process_time() < end:
        i = int(rng.integers(len(best.caps)))
        near = [j for j in best.paths if abs(j - i) <= 4]
        if near:
            k = best.paths[near[int(rng.integers(len(near)))]]
            x = changed(problem, k, rng)
            best.offer(sweep.refiner.polish(x, half, how, float(best.caps[i]), k.origin))
    return judged(problem, best, law)


def changed(problem: Problem, k: Candidate, rng: Generator) -> np.ndarray[Any, Any]:
    """The means of ``k`` in another number of steps, with a bump or with other times."""
    steps = int(np.clip(k.steps + rng.integers(-3, 4), 4, problem.horizon))
    x = resampled_means(problem, k.flight.x, steps)
    t = np.arange(steps + 1)
    if rng.random() < 0.6:
        bump = np.exp(-0.5 * ((t - rng.integers(1, steps)) / rng.uniform(1.0, 6.0)) ** 2)
        bump[0] = 0.0
        x = x + bump[:, None] * rng.normal(0.0, 0.04 * float(np.ptp(problem.scene.bounds)), 2)
    if rng.random() < 0.3:
        at = np.sort(np.clip(t / steps + rng.normal(0.0, 0.5 / steps, steps + 1), 0.0, 1.0))
        at[[0, -1]] = 0.0, 1.0
        x = np.column_stack([np.interp(at, t / steps, x[:, c]) for c in (0, 1)])
    return x


def judged(problem: Problem, best: Best, law: str) -> list[dict[str, float]]:
    """The paths that nothing beats in fresh flights."""
    rows: list[dict[str, float]] = []
    for k in sorted({id(k): k for k in best.paths.values()}.values(), key=lambda k: k.length):
        flown = simulate_flights(problem, k.flight.u, JUDGING, law, SeedSequence(9), k.flight.x)
        failure = float(flown.failed.mean())
        if not rows or failure < rows[-1]["failure"]:
            rows.append({"length_m": k.length, "failure": failure, "steps": k.steps})
    return rows


def main() -> None:
    """Search, and write what was found beside what is kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", nargs="+", help="phi1, phi2, random0, random1, ...")
    parser.add_argument("--border", choices=("open", "wall"), default="open")
    parser.add_argument("--minutes", type=float, default=5.0, help="of processor time")
    asked = parser.parse_args()
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {}
    for name in asked.missions:
        kept[f"{name}_{asked.border}"] = wide_search(name, asked.border, asked.minutes)
        KEPT.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
