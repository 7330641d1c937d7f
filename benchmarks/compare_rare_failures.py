"""Weighted flights beside plain ones: failure rates of plans, in the winds that they were made for.

    python benchmarks/compare_rare_failures.py DIR ... [--plain 1000000] [--draws 20000]

For each results directory: the rate of plain flights and of weighted flights, each with its 95 % interval,
the number of half-spaces that failures are drawn from, and the standard deviation of the weighted rate over
ten repetitions with other seeds, as a share of it.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl import load_results
from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run.results import planned_run
from pareto_ltl.simulation import importance
from pareto_ltl.support.counts import clopper_pearson

AT_ONCE = 50_000  # plain flights in memory
REPETITIONS = 10
SEED = 20_261_125


def main() -> None:
    """One line for each results directory."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="+", help="results directories")
    parser.add_argument("--plain", type=int, default=1_000_000, help="plain flights of each plan")
    parser.add_argument("--draws", type=int, default=20_000, help="weighted flights of each plan")
    asked = parser.parse_args()
    for folder in asked.results:
        results = load_results(folder)
        problem, path = planned_run(results).problem, results.plan.path
        print(f"{folder}: {compared(problem, path, asked.plain, asked.draws)}", flush=True)


def compared(problem: Problem, path: PlannedPath, plain: int, draws: int) -> str:
    """Both rates of ``path`` in one line."""
    law, seed = problem.fidelity.law, SeedSequence(SEED)
    chunks = [min(AT_ONCE, plain - first) for first in range(0, plain, AT_ONCE)]
    seeds = seed.spawn(len(chunks) + REPETITIONS + 1)
    failed = sum(
        int(simulate_flights(problem, path.u, n, law, one, path.x).failed.sum())
        for n, one in zip(chunks, seeds, strict=False)
    )
    low, high = clopper_pearson(failed, plain)
    text = f"{law} winds; {plain} flights {failed / plain:.6f} ({low:.6f} to {high:.6f})"
    proposal = importance.make_proposal(problem, path)
    rates = [importance.weighted_rate(problem, path, draws, one) for one in seeds[len(chunks) :]]
    first, others = rates[0], [rate.failure for rate in rates[1:] if rate is not None]
    if proposal is None or first is None:
        return f"{text}; no weighted flights"
    spread = float(np.std(others, ddof=1) / np.mean(others))
    return (
        f"{text}; {draws} weighted {first.failure:.6f} ({first.low:.6f} to {first.high:.6f}), "
        f"{len(proposal.modes.threshold)} half-spaces, sd of {REPETITIONS} repetitions {spread:.1%}"
    )


if __name__ == "__main__":
    main()
