"""Rank planners by their plans: ``python -m published.rank PLANS PLANS ...`` in the folder ``benchmarks``.

Each folder is one planner, as for ``published.score``. On a mission the planner whose plan fails least often
has rank 1; equal rates share their ranks. Printed are mean failure and mean rank with 95 % intervals in
which a weather situation is one trial, the mean length, and the number of plans that fail in most flights.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import rankdata

from pareto_ltl.studies.calibration import mean_interval
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from published.dataset import FOLDER, missions
from published.score import RUNS, read_promises, score_mission


def failures(folders: Sequence[Path], runs: int, data: Path) -> tuple[FloatArray, FloatArray, list[str]]:
    """Failure and length [km] of each planner on each mission, (P, M), and the situations (M,)."""
    rates, lengths, places = [], [], []
    for folder in folders:
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder")
        promises = read_promises(folder)
        rows = [
            score_mission(each, folder / f"{each.name}.csv", promises.get(each.name), runs, data)
            for each in missions(data)
        ]
        rates.append([row.failure for row in rows])
        lengths.append([np.nan if row.length_km is None else row.length_km for row in rows])
        places = [row.situation for row in rows]
    return np.array(rates), np.array(lengths, float), places


def lines_of(
    names: Sequence[str], rates: FloatArray, lengths: FloatArray, situations: Sequence[str]
) -> list[str]:
    """The table, best mean rank first."""
    ranks = rankdata(rates, axis=0)
    lines = [f"{'planner':<12}{'fails':>8}{'95 %':>18}{'rank':>7}{'95 %':>16}{'km':>6}{'above half':>12}"]
    for p in np.argsort(ranks.mean(axis=1), kind="stable"):
        _, low, high = mean_interval(rates[p], situations)
        _, first, last = mean_interval(ranks[p], situations)
        between = f"{max(low, 0.0):.1%} to {min(high, 1.0):.1%}"
        half = int((rates[p] > 0.5).sum())
        lines.append(
            f"{names[p]:<12}{rates[p].mean():>8.1%}{between:>18}{ranks[p].mean():>7.2f}"
            f"{f'{first:.2f} to {last:.2f}':>16}{np.nanmean(lengths[p]):>6.0f}{half:>12}"
        )
    return [*lines, "", f"{rates.shape[1]} missions in {len(set(situations))} situations"]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; 2 if plans cannot be read."""
    parser = argparse.ArgumentParser(prog="python -m published.rank", description=__doc__)
    parser.add_argument("plans", type=Path, nargs="+", help="folders with NAME.csv for each mission")
    parser.add_argument("--runs", type=int, default=RUNS, help="flights of each plan")
    parser.add_argument("--data", type=Path, default=FOLDER, help=argparse.SUPPRESS)
    asked = parser.parse_args(argv)
    try:
        found = failures(asked.plans, asked.runs, asked.data)
    except DataError as error:
        print(f"published.rank: {error}", file=sys.stderr)
        return 2
    print("\n".join(lines_of([folder.name for folder in asked.plans], *found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
