"""Failures of the same flights with and without ``follow``: a position fix, a new plan if it is better.

python benchmarks/follow_flights.py +experiment=hop --flights 400 --out follow_flights.csv

Each flight has a wind of the coherent law. Without ``follow`` it flies the planned controls. With it, a
position is measured after a share of the steps; the rest is planned again, and flown if fewer of the same
simulated flights fail with it, as ``pareto-ltl follow --replan --auto`` does. Both are flown by our steps in
the same wind.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from pathlib import Path

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.cli.commands import run_command_line
from pareto_ltl.inflight.belief import LAW, Belief
from pareto_ltl.planning.conditioning import Fix
from pareto_ltl.run.exporting import run_with_plan
from pareto_ltl.run.interface import load_results
from pareto_ltl.run.records import PLAN, PROBLEM
from pareto_ltl.run.replanning import replanned
from pareto_ltl.simulation.flights import simulate_flights
from pareto_ltl.support.counts import clopper_pearson, paired_difference
from pareto_ltl.support.errors import ParetoLtlError

MEMBERS = 1000


def new_controls(run, step: int, place, sd: float, seed: int):
    """The controls and the mean path after the fix; None if the old plan is flown on."""
    problem, path = run.make(PROBLEM), run.make(PLAN).path
    belief, dt, R = Belief(problem, MEMBERS, SeedSequence(seed)), problem.motion.dt, sd**2 * np.eye(2)
    for t in range(step):
        belief.advance(dt, dt * (problem.motion.b @ path.u[t]))
    if belief.distance(place, R) > 4.0:
        return None
    belief.learn(place, R)
    try:
        done = replanned(run, step * dt, [Fix(place, sd, step)])
    except ParetoLtlError:
        return None
    if done.situation.alarms:
        return None
    other = done.plan.path
    u, x = np.concatenate([path.u[:step], other.u]), np.concatenate([path.x[:step], other.x])
    if len(u) > len(problem.laws[LAW].wind.slot):
        return None
    old, new = (belief.rest_fails(*pair)[1] for pair in ((path.u, path.x), (u, x)))
    return (u, x) if paired_difference(old, new)[2] < 0.0 else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("words", nargs="*", default=["+experiment=hop"])
    parser.add_argument("--flights", type=int, default=400)
    parser.add_argument("--after", type=float, default=0.4, help="share of the steps before the fix")
    parser.add_argument("--sd", type=float, default=100.0, help="of the fix [m]")
    parser.add_argument("--out", type=Path, default=Path("follow_flights.csv"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run_command_line(
            ["plan", *options.words, "report=none", "exports=none", f"hydra.run.dir={folder}/run"]
        )
        run = run_with_plan(load_results(f"{folder}/run"))
        problem, path = run.make(PROBLEM), run.make(PLAN).path
        n, seed, rng = options.flights, 77, np.random.default_rng(5)
        plain = simulate_flights(problem, path.u, n, LAW, SeedSequence(seed), path.x)
        step, failed, switched = round(options.after * len(path.u)), plain.failed.copy(), 0
        with options.out.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["flight", "without", "with", "switched"])
            for k in range(n):
                place = plain.x[k, step] + options.sd * rng.standard_normal(2)
                found = new_controls(run, step, place, options.sd, k)
                if found is not None:
                    switched += 1
                    failed[k] = simulate_flights(
                        problem, *found[:1], n, LAW, SeedSequence(seed), found[1]
                    ).failed[k]
                rows.writerow([k, int(plain.failed[k]), int(failed[k]), int(found is not None)])
                file.flush()
    for name, some in (("without", plain.failed), ("with", failed)):
        low, high = clopper_pearson(int(some.sum()), n)
        rate = f"{100 * some.mean():.1f} % ({100 * low:.1f} to {100 * high:.1f})"
        print(f"{name} follow {some.sum()} of {n} fail: {rate}")
    middle, low, high = paired_difference(plain.failed, failed)
    interval = f"{100 * middle:+.1f} % ({100 * low:+.1f} to {100 * high:+.1f})"
    print(f"difference {interval}; {switched} new plans flown")


if __name__ == "__main__":
    main()
