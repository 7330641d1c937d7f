"""Collision bounds of plans beside simulated collisions; the arguments are results directories.

For each plan: R with runs beside faces only, R with supporting lines as well, the sum over segments of the
end that is nearer to each line, and the rate of collisions (obstacles, and borders that are walls) in flights
of the wind law that the plan was made for. The last line has the median of each ratio to the simulated rate.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl import load_results
from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning.evaluate import collision_risk, propagate
from pareto_ltl.planning.separation import separation
from pareto_ltl.run.results import planned_run

FEWEST = 20  # collisions that a rate must have for a ratio
SEED = 20_261_124


def main() -> None:
    """One line for each results directory, and the medians."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="+", help="results directories")
    parser.add_argument("--runs", type=int, default=20_000, help="flights of each plan")
    asked = parser.parse_args()
    heads = ("R by faces", "R by lines", "sum of segments", "simulated")
    print(" ".join(f"{head:>16}" for head in heads))
    rows = [row for row in (bounds(folder, asked.runs) for folder in asked.results) if row is not None]
    many = np.array([row for row in rows if row[-1] * asked.runs >= FEWEST])
    if len(many):
        ratios = np.median(many[:, :-1] / many[:, -1:], axis=0)
        print(
            " ".join(f"{ratio:16.2f}" for ratio in ratios),
            f"{'':16} median over simulated, {len(many)} plans",
        )


def bounds(folder: str, runs: int) -> tuple[float, ...] | None:
    """The three bounds and the simulated rate of the plan in ``folder``; None for a map without barriers."""
    results = load_results(folder)
    problem, path = planned_run(results).problem, results.plan.path
    if not len(problem.barriers.ptr) - 1:
        return None
    law = problem.fidelity.law
    flight = propagate(problem, path.x)
    faces, lines = (
        collision_risk(problem, flight, problem.world.law, tight=tight) for tight in (False, True)
    )
    flown = simulate_flights(problem, path.u, runs, law, SeedSequence(SEED), path.x)
    rate = float((flown.collided | (flown.off_map & problem.scene.walled)).mean())
    row = faces, lines, float(separation(problem, flight).risk.sum()), rate
    print(" ".join(f"{value:16.4f}" for value in row), folder, flush=True)
    return row


if __name__ == "__main__":
    main()
