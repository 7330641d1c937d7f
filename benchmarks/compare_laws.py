"""Comparison: do plans that are refined under one wind law also fail less under other laws?

    python benchmarks/compare_laws.py [phi1 phi2] [--border open]

The plan of a default run, the path of its front that fails least among those no longer than the plan of the
paper's method, and that plan fly in coherent winds of other persistence and kernel, and in steps of five
minutes. Printed: failed of 20,000 flights.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import Settings
from search_best_known import benchmark_run, paper_run

FLIGHTS = 20_000
SHORT = 300.0  # [s]


def laws(settings: Settings) -> dict[str, Settings]:
    """Settings of the winds that plans are flown in."""
    wind, robot, planner = settings.wind, settings.robot, settings.planner
    longer = replace(planner, max_steps=round(planner.max_steps * float(robot.dt) / SHORT))
    return {
        "as planned": settings,
        "rho = 1": replace(settings, wind=replace(wind, rho=1.0)),
        "rho = 0.3": replace(settings, wind=replace(wind, rho=0.3)),
        "RBF kernel": replace(settings, wind=replace(wind, kernel="rbf")),
        "five-minute steps": replace(settings, robot=replace(robot, dt=SHORT), planner=longer),
    }


def plans(name: str, border: str, seed: int) -> dict[str, PlannedPath]:
    """Plans of a default run, of its front no longer than the paper's plan, and of the paper's method."""
    run = benchmark_run(name, border, seed)
    paper = paper_run(run).plan.path
    front = run.front
    short = [
        (rate.failure, k)
        for k, (path, rate) in enumerate(zip(front.paths, front.rates, strict=True))
        if path.objectives.length <= paper.objectives.length
    ]
    return {"default": run.plan.path, "as short": front.paths[min(short)[1]], "paper": paper}


def failure(problem: Problem, path: PlannedPath, dt: float) -> float:
    """Share of failed flights of a path that was planned with steps of ``dt`` [s]."""
    parts = round(dt / problem.motion.dt)
    u = np.repeat(path.u, parts, axis=0)
    at = np.arange(len(u) + 1) / parts
    x = np.column_stack([np.interp(at, np.arange(len(path.x)), path.x[:, c]) for c in (0, 1)])
    return float(simulate_flights(problem, u, FLIGHTS, "coherent", SeedSequence(17), x).failed.mean())


def main() -> None:
    """Plan, fly and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", nargs="*", default=["phi1", "phi2"])
    parser.add_argument("--border", choices=("open", "wall"), default="open")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    for name in asked.missions:
        run = benchmark_run(name, asked.border, asked.seed)
        paths = plans(name, asked.border, asked.seed)
        print(
            f"{name}, border {asked.border}",
            *(f"{key} {p.objectives.length / 1e3:.0f} km" for key, p in paths.items()),
            sep="; ",
        )
        for law, settings in laws(run.settings).items():
            problem = Run(settings, {"scene": run.scene}).problem
            rates = (failure(problem, path, float(run.settings.robot.dt)) for path in paths.values())
            print(f"  {law:18}", *(f"{rate:8.4f}" for rate in rates), flush=True)


if __name__ == "__main__":
    main()
