"""Compare the fronts of pairs of results: FOLDER OTHER [FOLDER OTHER ...], each pair of one mission.

The paths of both fronts are judged by the same fresh flights, on the map and in the wind of FOLDER. OTHER may
be of an earlier version: only the positions in its ``front.npz`` are read. The columns are the failures of
FOLDER over the failures of OTHER at equal length (mean and largest over the lengths that both fronts have,
logarithms interpolated), and the same of the hypervolumes (failure below 1, length below twice the longest).
"""

from __future__ import annotations

import argparse

import moocore
import numpy as np
from numpy.random import SeedSequence

from pareto_ltl import load_results
from pareto_ltl.extend import which_fail
from pareto_ltl.run.front_stage import extra_paths
from pareto_ltl.support.arrays import FloatArray

LENGTHS = 40  # at which failures are compared
JUDGING = SeedSequence(29)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="+", help="results directories, two of each mission")
    parser.add_argument("--runs", type=int, default=20_000, help="flights that judge each path")
    return parser.parse_args()


def main() -> None:
    asked = arguments()
    if len(asked.results) % 2:
        raise SystemExit("name two results directories of each mission")
    print(f"{'mission':12} {'paths':>9} {'mean':>6} {'worst':>6} {'at':>7} {'volume':>7} {'least':>15}")
    for folder, other in zip(asked.results[::2], asked.results[1::2], strict=True):
        print(compared(folder, other, asked.runs), flush=True)


def compared(folder: str, other: str, runs: int) -> str:
    """One line on a pair."""
    results = load_results(folder)
    problem = results.problem
    groups = [extra_paths(place, problem) for place in (folder, other)]
    failed = which_fail(problem, [path for paths in groups for path in paths], runs, JUDGING)
    rates = np.maximum(failed.mean(axis=1), 0.5 / runs)
    first = len(groups[0])
    one, two = (
        np.column_stack([part, [path.objectives.length for path in paths]])
        for part, paths in zip((rates[:first], rates[first:]), groups, strict=True)
    )
    corner = np.array([1.0, 2.0 * max(one[:, 1].max(), two[:, 1].max())])
    volume = moocore.hypervolume(one, ref=corner) / moocore.hypervolume(two, ref=corner)
    ratios, lengths = ratios_at_equal_length(one, two)
    worst, least = int(ratios.argmax()), f"{one[:, 0].min():.3%}/{two[:, 0].min():.3%}"
    return (
        f"{results.settings.name:12} {f'{len(one)}/{len(two)}':>9} {np.exp(np.log(ratios).mean()):6.3f} "
        f"{ratios[worst]:6.2f} {lengths[worst] / 1e3:7.1f} {volume:7.4f} {least:>15}"
    )


def ratios_at_equal_length(one: FloatArray, two: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Failures of ``one`` over failures of ``two``, rows (failure, length [m]), and the lengths [m]."""
    shortest = max(rows[:, 1].min() for rows in (one, two))
    longest = max(shortest, min(rows[:, 1].max() for rows in (one, two)))
    lengths = np.geomspace(shortest, longest, LENGTHS)
    one_at, two_at = (failures_at(rows, lengths) for rows in (one, two))
    return one_at / two_at, lengths


def failures_at(rows: FloatArray, lengths: FloatArray) -> FloatArray:
    """The least failure up to each of ``lengths`` [m], interpolated between the points of a front."""
    rows = rows[np.argsort(rows[:, 1])]
    least = np.log(np.minimum.accumulate(rows[:, 0]))
    return np.asarray(np.exp(np.interp(np.log(lengths), np.log(rows[:, 1]), least)))


if __name__ == "__main__":
    main()
