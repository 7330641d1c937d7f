"""What branches have of the gain of new plans, on missions of the corpus: ``branches_pay.py --count 60``.

Each mission is planned without landmarks. In the same fresh winds it is flown as planned, with branches at
one fix (half-way) and at two (after a third and two thirds), with branches on the trunk that is best without
any, with a position that is always known, and, in some of these winds, with a new plan at each of the same
fixes. These winds are drawn from the flights that fail as planned and from the others, half each, and
weighted back. Missions that hardly fail are left out. A finished mission is a line of OUT/rows.jsonl and is
not repeated: the same command continues, and prints the tables of what is finished.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from corpus.missions import missions
from corpus.running import read_rows
from pareto_ltl.run.plan_run import Run
from pareto_ltl.run.plan_stage import branched
from pareto_ltl.settings import BranchConfig
from pareto_ltl.simulation.tree_flights import TreeFlights, fly_branches
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl_apps.studies.replanning import (
    ReplanningContext,
    Way,
    always_known,
    law_cycle,
    replanned_controls,
)

FOLDER = Path(__file__).parents[1] / "outputs" / "branches_pay"
FLIGHTS, LEAVES, FIX_SHARE = 4000, 4, 0.005  # error of a fix, of the side of the map
SETS = {"1 fix": (0.5,), "2 fixes": (1 / 3, 2 / 3)}  # times of the fixes, of the duration
QUICK = (
    "planner.trees=5",
    "refine.flights=1000",
    "refine.sweep_flights=250",
    "refine.points=6",
    "selection.runs=20000",
)
RESAMPLED = 10_000
SAFE = 0.005  # failure as planned below which there is nothing to gain
OTHER_TRUNK = "the trunk of the plan"  # not fitted to its branches


def planned(folder: Path, words: Sequence[str], extra: Sequence[str]) -> str:
    """Plan the mission in ``folder``; what went wrong, or an empty text."""
    bare = "bare" if any(folder.glob("bare.*")) else "map"
    own = [word.replace(f"{folder}/map.", f"{folder}/{bare}.") for word in words]
    target = [f"hydra.run.dir='{folder / 'run'}'", "report=none", "exports=none", "deployment.runs=100"]
    command = [sys.executable, "-m", "pareto_ltl", "plan", *own, *QUICK, *target, *extra]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else (done.stderr.strip() or "no plan").splitlines()[-1][:300]


def measured(folder: Path, replans: int) -> dict[str, Any]:
    """The row of a mission whose plan is in ``folder``: failures of each way, and how the trees came out."""
    run = Run.open(folder / "run")
    problem, plan = run.problem, run.plan
    own = next(path for path in run.front.paths if np.array_equal(path.x, plan.path.x))
    plan = replace(plan, path=own)  # the stage of the plan looks for it in the front
    steps, dt = len(plan.path.u), problem.motion.dt
    sd = FIX_SHARE * float(np.ptp(run.scene.bounds, axis=0).max())
    winds = TreeFlights.drawn(problem, FLIGHTS, SeedSequence(20261128))
    alone = winds.failed(plan.path.u)
    known = winds.flights.failed(always_known(winds.flights, plan.path.u, plan.path.x))
    row: dict[str, Any] = {
        "steps": steps, "fix_sd": sd, "as planned": alone.mean(), "position always known": known.mean(),
    }  # fmt: skip
    if alone.mean() < SAFE:
        return row
    settings = replace(run.settings, replanning=replace(run.settings.replanning, fix_sd=sd))
    context = ReplanningContext(run.with_settings(settings), winds.flights, (), law_cycle)
    for name, shares in SETS.items():
        at = sorted({min(max(round(share * steps), 1), steps - 1) for share in shares})
        if len(at) < len(shares):
            continue
        hours = [step * dt / 3600.0 for step in at]
        branch = BranchConfig(leaves=LEAVES, at=hours, fixes=len(at), fix_sd=sd)
        with_tree = branched(run.with_settings(replace(run.settings, branch=branch)), plan)
        tree = with_tree.branching
        failed = alone if tree is None else fly_branches(winds, with_tree.path.u, tree).failed
        if len(at) == 1:
            plain = replace(run.settings, branch=replace(branch, fit_trunk=False))
            simple = branched(run.with_settings(plain), plan)
            other = simple.branching
            lost = alone if other is None else fly_branches(winds, simple.path.u, other).failed
            row[OTHER_TRUNK] = lost.mean()
            row["fitted less other trunk"] = paired_difference(lost, failed)
        row[f"branches, {name}"] = failed.mean()
        row[f"difference, {name}"] = paired_difference(alone, failed)
        if tree is not None:
            row[f"tree, {name}"] = {
                "promised": tree.rate.failure, "runs": tree.rate.runs, "bent": tree.bent,
                "rows": [[one.leaves, one.fixes, one.rate.failure, one.length] for one in tree.front],
            }  # fmt: skip
        way = Way(name, plan.path, fixes=tuple(at))
        row[f"new plans, {name}"] = replanned_rate(context, way, alone, replans)
    return row


def replanned_rate(context: ReplanningContext, way: Way, alone: np.ndarray, count: int) -> dict[str, Any]:
    """Failures with new plans, of flights that fail as planned and of the others, and the rate of all."""
    rng, p = np.random.default_rng(20261129), float(alone.mean())
    parts: dict[str, Any] = {}
    rate = 0.0
    for name, rows, weight in (
        ("failed", np.flatnonzero(alone), p),
        ("others", np.flatnonzero(~alone), 1 - p),
    ):
        chosen = np.sort(rng.permutation(rows)[: count // 2])
        lost = []
        for number in chosen.tolist():
            wind = context.winds.only(np.array([number]))
            u, x, _ = replanned_controls(context, way, wind, number)
            lost.append(bool(wind.failed(way.pilot(wind, u, x))[0]))
        parts[name] = [int(np.sum(lost)), len(lost)]
        rate += weight * (float(np.mean(lost)) if lost else 0.0)
    return {"rate": rate, **parts}


def tables(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What is known from the finished missions."""
    done = [row for row in rows if "as planned" in row]
    yield f"{len(done)} of {len(rows)} missions have a plan"
    ways = ["as planned", "position always known"]
    for way in ways:
        yield f"{way}: {100 * np.mean([row[way] for row in done]):.2f} %"
    fitted = [row for row in done if OTHER_TRUNK in row]
    if fitted:
        gaps = [row["fitted less other trunk"] for row in fitted]
        better, worse = sum(gap[2] < 0.0 for gap in gaps), sum(gap[1] > 0.0 for gap in gaps)
        yield (
            f"trunks fitted to their branches: {len(gaps)} missions, mean difference "
            f"{100 * np.mean([gap[0] for gap in gaps]):+.2f} points; {better} fail less than with the trunk "
            f"of the plan (interval below 0), {worse} more"
        )
    for name in SETS:
        own = [row for row in done if f"branches, {name}" in row]
        if not own:
            continue
        p, b = (np.array([row[key] for row in own]) for key in ("as planned", f"branches, {name}"))
        r = np.array([row[f"new plans, {name}"]["rate"] for row in own])
        grown = [row for row in own if f"tree, {name}" in row]
        yield (
            f"{name}: {len(own)} missions, {len(grown)} with branches; as planned {100 * p.mean():.2f} %, "
            f"branches {100 * b.mean():.2f} %, new plans {100 * r.mean():.2f} %"
        )
        middle, low, high = contingency(p - b, p - r)
        yield f"  of the gain of new plans, branches have {middle:.0f} % (95 %: {low:.0f} to {high:.0f} %)"
        worse = [row["mission"] for row in own if row[f"difference, {name}"][1] > 0.0]
        yield f"  missions with a tree that is worse than its plan (interval above 0): {worse or 'none'}"
        bent = [row["mission"] for row in grown if row[f"tree, {name}"]["bent"] is not None]
        yield f"  bent trunks: {bent or 'none'}"
        z = [_apart(row, name) for row in grown]
        yield f"  promised less flown, in standard errors: {', '.join(f'{one:+.1f}' for one in z)}"


def _apart(row: dict[str, Any], name: str) -> float:
    """Promised less flown rate of a tree, in standard errors."""
    tree, flown = row[f"tree, {name}"], row[f"branches, {name}"]
    error = math.sqrt(max(flown, 1e-4) * (1 / FLIGHTS + 1 / tree["runs"]))
    return float((tree["promised"] - flown) / error)


def contingency(branches: np.ndarray, replanned: np.ndarray) -> tuple[float, float, float]:
    """Per cent of the summed gain of new plans that branches have; interval by resampled missions."""
    n = len(branches)
    weight = np.random.default_rng(1).multinomial(n, np.full(n, 1.0 / n), RESAMPLED)
    whole = weight @ replanned
    drawn = 100.0 * (weight @ branches)[whole > 0.0] / whole[whole > 0.0]
    middle = 100.0 * branches.sum() / replanned.sum() if replanned.sum() > 0.0 else math.nan
    if not len(drawn):
        return middle, math.nan, math.nan
    low, high = np.quantile(drawn, [0.025, 0.975])
    return middle, float(low), float(high)


def main() -> int:
    """Measure what is not finished, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*", help="settings for every plan")
    parser.add_argument("--count", type=int, default=60, help="missions that are drawn")
    parser.add_argument("--seed", type=int, default=61, help="seed of the missions")
    parser.add_argument("--replans", type=int, default=8, help="flights of a mission with new plans")
    parser.add_argument("--out", type=Path, default=FOLDER)
    parser.add_argument("--tables", action="store_true", help="only print the tables")
    asked = parser.parse_intermixed_args()
    out = asked.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    identity = {"seed": asked.seed, "replans": asked.replans, "words": asked.words}
    mark = out / "study.json"
    if mark.exists() and json.loads(mark.read_text()) != identity:
        sys.exit(
            f"{mark} is of {mark.read_text().strip()}, not of {json.dumps(identity)}; choose another --out"
        )
    mark.write_text(json.dumps(identity) + "\n")
    done = {row["mission"] for row in read_rows(out)}
    for mission in [] if asked.tables else missions(asked.count, asked.seed, 1):
        if mission.name in done or mission.tags["wind"] == "calm":
            continue
        folder = out / "missions" / mission.name
        fault = planned(folder, mission.write(folder), asked.words)
        try:
            row = {"said": fault} if fault else measured(folder, asked.replans)
        except (ConfigError, DataError, InfeasibleError) as error:
            fault, row = str(error), {"said": str(error)}
        with (out / "rows.jsonl").open("a") as stream:
            stream.write(json.dumps({"mission": mission.name, **row}) + "\n")
        print(mission.name, fault or f"{100 * row['as planned']:.1f} % fail as planned", flush=True)
    print("\n".join(tables(read_rows(out))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
