"""Score plans in the winds that came: ``python -m published.score PLANS ...`` in the folder ``benchmarks``.

PLANS has a table for each mission, NAME.csv, with the columns duration_s, heading_true_deg and airspeed_m_s.
A file promises.json, {"NAME": 0.05, ...}, may state the failure rates that the planner promises. A mission
without a table counts as failed. Of several folders the planners are ranked by the mean rate of failure;
intervals hold 95 % and are from a bootstrap over situations, which draws the same ones for all planners.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.studies.calibration import log_score
from pareto_ltl_apps.studies.planning import fly_seeded
from published.dataset import FOLDER, Mission, missions, true_problem
from published.plans import controls, read_orders

SEED = 0
RUNS = 2000
DRAWS = 4000  # of the bootstrap


@dataclass(frozen=True, slots=True)
class Row:
    """The score of one mission: shares of flights; ``promised`` is None if there is no promise."""

    mission: str
    situation: str
    failure: float
    low: float
    high: float
    missed: float
    collided: float
    hours: float | None
    length_km: float | None
    promised: float | None


def score_mission(mission: Mission, table: Path, promised: float | None, runs: int, data: Path) -> Row:
    """Fly the plan in ``table`` ``runs`` times in the true wind; without a table all flights fail."""
    if not table.is_file():
        return Row(mission.name, mission.situation, 1.0, 1.0, 1.0, 1.0, 0.0, None, None, promised)
    problem, orders = true_problem(mission, data), read_orders(table, mission)
    u, x = controls(problem, orders)
    flown = fly_seeded(problem, u, runs, "independent", SEED, x)
    failed = int(flown.failed.sum())
    low, high = clopper_pearson(failed, runs)
    length = float(np.hypot(*np.diff(x, axis=0).T).sum())
    return Row(
        mission.name, mission.situation, failed / runs, low, high,
        float((~flown.accepted).mean()), float(flown.collided.mean()),
        len(u) * mission.dt / 3600.0, length / 1e3, promised,
    )  # fmt: skip


def summary(rows: Sequence[Row]) -> dict[str, float]:
    """Means over missions; Brier and log score of the promises, if every mission has one (lower is better).

    With realised rates f and promises p the Brier score is the mean of f (1 - p)² + (1 - f) p². ``floor`` is
    the least rate that any calibration on so many situations can claim: 1 / (n + 1).
    """
    situations = len({row.situation for row in rows})
    found = {
        "missions": float(len(rows)),
        "situations": float(situations),
        "floor": 1.0 / (situations + 1),
        "failure": float(np.mean([row.failure for row in rows])),
    }
    drawn = drawn_weights([row.situation for row in rows]) @ np.array([row.failure for row in rows])
    found |= dict(zip(("failure_low", "failure_high"), _interval(drawn), strict=True))
    promised = [row.promised for row in rows if row.promised is not None]
    if len(promised) < len(rows):
        return found
    p, f = np.array(promised), np.array([row.failure for row in rows])
    brier = float(np.mean(f * (1 - p) ** 2 + (1 - f) * p**2))
    return found | {"promised": float(p.mean()), "brier": brier, "log_score": log_score(p, f)}


@dataclass(frozen=True, slots=True)
class Rank:
    """A planner among others: the mean rate of failure, the difference from the first one, and the rank."""

    planner: str
    failure: float
    failure_interval: tuple[float, float]
    behind: float
    behind_interval: tuple[float, float]
    rank: tuple[int, int]


def ranks(scores: Mapping[str, Sequence[Row]]) -> list[Rank]:
    """Planners from the lowest mean rate of failure to the highest; ``rank`` is an interval."""
    names = sorted(scores, key=lambda name: float(np.mean([row.failure for row in scores[name]])))
    rates = np.array([[row.failure for row in scores[name]] for name in names])
    situation = [row.situation for row in scores[names[0]]]
    weights = drawn_weights(situation)
    drawn = rates @ weights.T  # (planners, draws)
    means, behind = rates.mean(axis=1), drawn - drawn[0]
    places = 1 + (drawn[None] < drawn[:, None] - 1e-12).sum(axis=1)
    return [
        Rank(
            name, float(means[k]), _interval(drawn[k]), float(means[k] - means[0]), _interval(behind[k]),
            (int(np.quantile(places[k], 0.025)), int(np.ceil(np.quantile(places[k], 0.975)))),
        )
        for k, name in enumerate(names)
    ]  # fmt: skip


def drawn_weights(situation: Sequence[str]) -> np.ndarray:
    """Weights (``DRAWS``, missions) that sum to 1, of situations drawn with replacement."""
    names, member = np.unique(situation, return_inverse=True)
    drawn = np.random.default_rng(SEED).multinomial(len(names), np.full(len(names), 1 / len(names)), DRAWS)
    weights = drawn[:, member].astype(float)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _interval(values: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def ranks_text(found: Sequence[Rank]) -> str:
    """The planners, a line each."""
    lines = [f"{'planner':<14}{'fails':>8}{'95 %':>18}{'behind':>9}{'95 %':>18}{'rank':>9}"]
    for row in found:
        low, high = row.failure_interval
        less, more = row.behind_interval
        first, last = row.rank
        lines.append(
            f"{row.planner:<14}{row.failure:>8.1%}{f'{low:.1%} to {high:.1%}':>18}{row.behind:>9.1%}"
            f"{f'{less:.1%} to {more:.1%}':>18}{f'{first}' if first == last else f'{first} to {last}':>9}"
        )
    return "\n".join(lines)


def read_promises(folder: Path) -> dict[str, float]:
    """The promises of ``promises.json``, if there is one."""
    path = folder / "promises.json"
    if not path.is_file():
        return {}
    try:
        told = {
            str(name): float(value) for name, value in json.loads(path.read_text(encoding="utf-8")).items()
        }
    except (ValueError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: expected an object of numbers ({error})") from None
    if wrong := [name for name, value in told.items() if not 0.0 <= value <= 1.0]:
        raise DataError(f"{path}: promises must lie between 0 and 1: {', '.join(wrong)}")
    return told


def table_text(rows: Sequence[Row], total: Mapping[str, float]) -> str:
    """A table of 80 columns, and the means."""
    lines = [
        f"{'mission':<14}{'fails':>8}{'95 %':>17}{'missed':>9}{'hit':>8}{'hours':>7}{'km':>6}{'promised':>10}"
    ]
    for row in rows:
        hours = "-" if row.hours is None else f"{row.hours:.1f}"
        length = "-" if row.length_km is None else f"{row.length_km:.0f}"
        promised = "-" if row.promised is None else f"{row.promised:.1%}"
        between = f"{row.low:.1%} to {row.high:.1%}"
        lines.append(
            f"{row.mission:<14}{row.failure:>8.1%}{between:>17}{row.missed:>9.1%}{row.collided:>8.1%}"
            f"{hours:>7}{length:>6}{promised:>10}"
        )
    lines.append("")
    lines += [f"{name.replace('_', ' '):<14}{value:>8.4g}" for name, value in total.items()]
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the scores; 2 if a table cannot be read."""
    parser = argparse.ArgumentParser(prog="python -m published.score", description=__doc__)
    parser.add_argument("plans", type=Path, nargs="+", help="folders with NAME.csv for each mission")
    parser.add_argument("--runs", type=int, default=RUNS, help="flights of each plan")
    parser.add_argument("--only", default="", help="names of missions, with commas")
    parser.add_argument("--json", action="store_true", help="one JSON document instead of a table")
    parser.add_argument("--data", type=Path, default=FOLDER, help=argparse.SUPPRESS)
    asked = parser.parse_args(argv)
    try:
        found = scores_of(asked.plans, asked.only, asked.runs, asked.data)
    except DataError as error:
        print(f"published.score: {error}", file=sys.stderr)
        return 2
    told: dict[str, Any] = {
        name: {"missions": [asdict(row) for row in rows], "summary": summary(rows)}
        for name, rows in found.items()
    }
    if len(found) > 1:
        told = {"planners": told, "ranks": [asdict(row) for row in ranks(found)]}
    else:
        (told,) = told.values()
    if asked.json:
        print(json.dumps(told, indent=1))
    elif len(found) > 1:
        print(ranks_text(ranks(found)))
    else:
        (rows,) = found.values()
        print(table_text(rows, told["summary"]))
    return 0


def scores_of(folders: Sequence[Path], only: str, runs: int, data: Path) -> dict[str, list[Row]]:
    """The scores of the plans in each folder, by its name."""
    wanted = [name for name in only.split(",") if name]
    chosen = [m for m in missions(data) if not wanted or m.name in wanted]
    if not chosen:
        raise DataError(f"--only {only}: there is no such mission")
    found = {}
    for folder in folders:
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder")
        promises = read_promises(folder)
        found[folder.name] = [
            score_mission(m, folder / f"{m.name}.csv", promises.get(m.name), runs, data) for m in chosen
        ]
    if len(found) < len(folders):
        raise DataError(f"{folders[0]}: folders of planners have different names")
    return found


if __name__ == "__main__":
    sys.exit(main())
