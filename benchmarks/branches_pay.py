"""What branches have of the gain of new plans, on missions of the corpus: ``branches_pay.py --count 60``.

Each mission is planned without landmarks. In the same fresh winds it is flown as planned, with a position
that is always known, and, in some of these winds, with a new plan at a fix after a third of the flight, and
at a second one after two thirds. These winds are drawn from the flights that fail as planned and from the
others, and weighted back. Missions that hardly fail are left out. A finished mission is a line of
OUT/rows.jsonl and is not repeated: the same command continues; ``--tables`` prints what is known so far.

Three passes over the finished missions follow, on the same plans and in the same winds; each has its own file
in OUT. ``--branches`` plans branches at the first fix and branches of branches at the second one; ``--cells``
does so with ``branch.rejoin=false``. ``--trunks`` plans branches at the first fix, once on the path that is
best without branches and once on the one that ``branch.fit_trunk`` takes.

The searches of the plan, the branches and the new plans are smaller than by default (``QUICK``), so that a
mission takes a minute or two.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from corpus.missions import missions
from corpus.running import read_rows
from pareto_ltl import Run
from pareto_ltl.extend import Branching, Plan
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl_apps.branching.settings import BranchConfig
from pareto_ltl_apps.branching.stage import branched_plan
from pareto_ltl_apps.branching.tree_flights import TreeFlights, fly_branches
from pareto_ltl_apps.branching.tree_search import SMALL
from pareto_ltl_apps.studies.replanning import (
    ReplanningContext,
    Way,
    always_known,
    controls_by_fix,
    law_cycle,
)
from pareto_ltl_apps.studies.settings import ReplanningConfig

FOLDER = Path(__file__).parents[1] / "outputs" / "branches_pay"
FLIGHTS, LEAVES, FIX_SHARE = 4000, 4, 0.005  # error of a fix, of the side of the map
FIXES = (1 / 3, 2 / 3)  # times of the fixes, of the duration
SETS = ("1 fix", "2 fixes")
PASSES = {"branches": True, "cells": False}  # of branches, and whether they fly distances off
QUICK = (
    "planner.trees=5",
    "refine.flights=300",
    "refine.sweep_flights=150",
    "refine.points=4",
    "refine.classes=2",
    "selection.runs=5000",
)
RESAMPLED = 10_000
SAFE = 0.005  # failure as planned below which there is nothing to gain
RISKY = 0.2  # failure above which few would fly a plan


def planned(folder: Path, words: Sequence[str], extra: Sequence[str]) -> str:
    """Plan the mission in ``folder``; what went wrong, or an empty text."""
    bare = "bare" if any(folder.glob("bare.*")) else "map"
    own = [word.replace(f"{folder}/map.", f"{folder}/{bare}.") for word in words]
    target = [f"hydra.run.dir='{folder / 'run'}'", "report=none", "exports=none", "deployment.runs=100"]
    command = [sys.executable, "-m", "pareto_ltl", "plan", *own, *QUICK, *target, *extra]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else (done.stderr.strip() or "no plan").splitlines()[-1][:300]


def opened(folder: Path) -> tuple[Run, Plan]:
    """The run in ``folder``, and its plan."""
    run = Run.open(folder / "run")
    own = next(path for path in run.front.paths if np.array_equal(path.x, run.plan.path.x))
    return run, replace(run.plan, path=own)  # the stage of the plan looks for it in the front


def with_branches(run: Run, plan: Plan, at: Sequence[int], fit_trunk: bool, *, rejoin: bool) -> Plan:
    """``plan`` with branches at the steps ``at``."""
    hours = [step * run.problem.motion.dt / 3600.0 for step in at]
    branch = BranchConfig(
        leaves=LEAVES, at=hours, fixes=len(at), fix_sd=error_of(run), fit_trunk=fit_trunk, rejoin=rejoin
    )
    return branched_plan(run.with_settings(run.settings.with_sections(branch)), plan)


def error_of(run: Run) -> float:
    """The standard deviation of a fix [m]."""
    return FIX_SHARE * float(np.ptp(run.scene.bounds, axis=0).max())


def compared_trunks(folder: Path) -> dict[str, Any]:
    """Failure and expected length of the trees on the plan in ``folder`` and on a trunk for its branches."""
    run, plan = opened(folder)
    winds = TreeFlights.drawn(run.problem, 2 * FLIGHTS, SeedSequence(20261130))
    first = min(max(round(FIXES[0] * len(plan.path.u)), 1), len(plan.path.u) - 1)
    failed: list[np.ndarray] = []
    row: dict[str, Any] = {"as planned": winds.failed(plan.path.u).mean()}
    for name, fit in (("plan", False), ("fitted", True)):
        one = with_branches(run, plan, [first], fit, rejoin=True)
        tree = one.branching
        failed.append(fly_branches(winds, one.path.u, tree).failed if tree else winds.failed(one.path.u))
        length = tree.length if tree else one.path.objectives.length
        score = math.log(failed[-1].mean() + SMALL) + run.settings.selection.saving * math.log(length)
        row[name] = {
            "failure": failed[-1].mean(), "length": length, "score": score,
            "other": bool(not np.array_equal(one.path.x, plan.path.x)),
        }  # fmt: skip
    row["difference"] = paired_difference(*failed)
    return row


def trunk_table(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What the compared trunks say."""
    done = [row for row in rows if "difference" in row]
    if not done:
        return
    other = [row for row in done if row["fitted"]["other"]]
    gap = np.array([row["difference"][0] for row in done])
    drawn = np.random.default_rng(2).choice(gap, (RESAMPLED, len(gap))).mean(axis=1)
    low, high = 100.0 * np.quantile(drawn, [0.025, 0.975])
    longer = np.mean([math.log(row["fitted"]["length"] / row["plan"]["length"]) for row in done])
    scores = np.array([row["fitted"]["score"] - row["plan"]["score"] for row in done])
    best, worst = np.quantile(
        np.random.default_rng(3).choice(scores, (RESAMPLED, len(done))).mean(axis=1), [0.025, 0.975]
    )
    less, more = (sum(test(row["difference"]) for row in other) for test in (_below, _above))
    yield f"trunks for their branches: {len(done)} missions, another trunk in {len(other)}"
    yield (
        f"  failure of the tree {100 * gap.mean():+.2f} points (95 %: {low:+.2f} to {high:+.2f}), length "
        f"{100 * longer:+.1f} %, score {scores.mean():+.3f} "
        f"({best:+.3f} to {worst:+.3f}); {less} fail less (interval below 0), {more} more"
    )


def _below(difference: Sequence[float]) -> bool:
    return difference[2] < 0.0


def _above(difference: Sequence[float]) -> bool:
    return difference[1] > 0.0


def measured(folder: Path, replans: int, most: float) -> dict[str, Any]:
    """The row of a mission whose plan is in ``folder``: failures of each way, and how the tree came out."""
    run, plan = opened(folder)
    problem, sd = run.problem, error_of(run)
    steps = len(plan.path.u)
    winds = TreeFlights.drawn(problem, FLIGHTS, SeedSequence(20261128))
    alone = winds.failed(plan.path.u)
    known = winds.flights.failed(always_known(winds.flights, plan.path.u, plan.path.x))
    row: dict[str, Any] = {
        "steps": steps, "fix_sd": sd, "as planned": alone.mean(), "position always known": known.mean(),
    }  # fmt: skip
    if not SAFE <= alone.mean() <= most:
        return row
    if (at := fixes_of(steps)) is None:
        return row
    settings = run.settings.with_sections(replace(run.settings[ReplanningConfig], fix_sd=sd))
    context = ReplanningContext(run.with_settings(settings), winds.flights, (), law_cycle)
    for name, rate in zip(
        SETS, replanned_rates(context, Way("", plan.path, fixes=tuple(at)), alone, replans), strict=True
    ):
        row[f"new plans, {name}"] = rate
    return row


def fixes_of(steps: int) -> list[int] | None:
    """The steps of the fixes of a plan of ``steps``; None if it is too short for them."""
    at = sorted({min(max(round(share * steps), 1), steps - 1) for share in FIXES})
    return at if len(at) == len(FIXES) else None


def flown_branches(
    winds: TreeFlights, plan: Plan, alone: np.ndarray, tree: Branching | None
) -> dict[str, Any]:
    """What a row says of the branches ``tree``: failures with each number of fixes."""
    row: dict[str, Any] = {}
    if tree is None:
        ways = [alone, alone]
    else:
        flown = fly_branches(winds, plan.path.u, tree)
        ways = [flown.before[:, 1], flown.failed]
        row["tree"] = {
            "step": tree.fix.step, "promised": tree.rate.failure, "runs": tree.rate.runs,
            "rows": [[one.leaves, one.fixes, one.rate.failure, one.length] for one in tree.front],
            "rejoin": tree.fix.rejoin, "counter": tree.fix.counter,
            "length": tree.length, "trunk": plan.path.objectives.length,
        }  # fmt: skip
    for name, failed in zip(SETS, ways, strict=True):
        row[f"branches, {name}"] = failed.mean()
        row[f"difference, {name}"] = paired_difference(alone, failed)
    return row


def tree_row(folder: Path, *, rejoin: bool) -> dict[str, Any]:
    """The row of branches on the plan in ``folder``, in the winds of :func:`measured`."""
    run, plan = opened(folder)
    winds = TreeFlights.drawn(run.problem, FLIGHTS, SeedSequence(20261128))
    at = fixes_of(len(plan.path.u))
    assert at is not None
    began = time.process_time()
    made = with_branches(run, plan, at, False, rejoin=rejoin)
    row = flown_branches(winds, plan, winds.failed(plan.path.u), made.branching)
    return row | {"cpu_s": round(time.process_time() - began, 1)}


def replanned_rates(
    context: ReplanningContext, way: Way, alone: np.ndarray, count: int
) -> list[dict[str, Any]]:
    """After each fix: failures with new plans of flights that fail as planned and of others, and the rate.

    Three of four of the ``count`` flights are some that fail as planned: what new plans save is of these.
    """
    rng, p = np.random.default_rng(20261129), float(alone.mean())
    found: list[dict[str, Any]] = [{"rate": 0.0} for _ in way.fixes]
    for name, rows, weight, many in (
        ("failed", np.flatnonzero(alone), p, count - count // 4),
        ("others", np.flatnonzero(~alone), 1 - p, count // 4),
    ):
        lost = []
        for number in np.sort(rng.permutation(rows)[:many]).tolist():
            wind = context.winds.only(np.array([number]))
            _, *after = controls_by_fix(context, way, wind, number)
            lost.append([bool(wind.failed(way.pilot(wind, u, x))[0]) for u, x, _ in after])
        for own, failed in zip(found, np.array(lost).T, strict=True):
            own[name] = [int(failed.sum()), len(failed)]
            own["rate"] += weight * float(failed.mean())
    return found


def joined(rows: Sequence[dict[str, Any]], more: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of missions with what ``more`` says of their branches."""
    known = {row["mission"]: row for row in more}
    return [row | known[row["mission"]] for row in rows if row["mission"] in known]


def tables(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What is known from the finished missions."""
    done = [row for row in rows if "as planned" in row]
    yield f"{len(done)} of {len(rows)} missions have a plan"
    ways = ["as planned", "position always known"]
    for way in ways:
        yield f"{way}: {100 * np.mean([row[way] for row in done]):.2f} %"
    for name in SETS:
        own = [row for row in done if f"branches, {name}" in row]
        if not own:
            continue
        p, b = (np.array([row[key] for row in own]) for key in ("as planned", f"branches, {name}"))
        r = np.array([row[f"new plans, {name}"]["rate"] for row in own])
        grown = [row for row in own if "tree" in row]
        yield (
            f"{name}: {len(own)} missions, {len(grown)} with branches; as planned {100 * p.mean():.2f} %, "
            f"branches {100 * b.mean():.2f} %, new plans {100 * r.mean():.2f} %"
        )
        middle, low, high = contingency(p - b, p - r)
        yield f"  of the gain of new plans, branches have {middle:.0f} % (95 %: {low:.0f} to {high:.0f} %)"
        worse = [row["mission"] for row in own if row[f"difference, {name}"][1] > 0.0]
        yield f"  missions with a tree that is worse than its plan (interval above 0): {worse or 'none'}"
    grown = [row for row in done if "tree" in row]
    for leaves in range(1, LEAVES + 1):
        rates = [one[2] for row in grown for one in row["tree"]["rows"] if one[0] == leaves and one[1] <= 1]
        if rates:
            yield f"{leaves} branches at the first fix: {100 * np.mean(rates):.2f} % (flights of the choice)"
    z = [_apart(row) for row in grown]
    yield f"promised less flown, in standard errors: {', '.join(f'{one:+.1f}' for one in z) or 'none'}"


def _apart(row: dict[str, Any]) -> float:
    """Promised less flown rate of a tree, in standard errors."""
    tree, flown = row["tree"], row[f"branches, {SETS[-1]}"]
    both = (tree["promised"] * tree["runs"] + flown * FLIGHTS) / (tree["runs"] + FLIGHTS)
    error = math.sqrt(max(both, 1e-4) * (1 / FLIGHTS + 1 / tree["runs"]))
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


def known_rows(file: Path) -> list[dict[str, Any]]:
    """The lines of ``file``; none if it does not exist."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def compare_all(out: Path, name: str, most: float, row_of: Callable[[Path], dict[str, Any]]) -> None:
    """``row_of`` the finished missions of ``out``, as lines of OUT/NAME.jsonl."""
    file, began = out / f"{name}.jsonl", time.process_time()
    done = {row["mission"] for row in known_rows(file)}
    for row in read_rows(out):
        mission = row["mission"]
        if mission in done or f"new plans, {SETS[0]}" not in row or row["as planned"] > most:
            continue
        found = {"mission": mission, **row_of(out / "missions" / mission)}
        with file.open("a") as stream:
            stream.write(json.dumps(found) + "\n")
        print(mission, f"{time.process_time() - began:.0f} s", flush=True)


def report(out: Path) -> str:
    """The tables of everything in ``out``."""
    rows = read_rows(out)
    lines = [*trunk_table(known_rows(out / "trunks.jsonl"))]
    for name in PASSES:
        if more := known_rows(out / f"{name}.jsonl"):
            both = joined(rows, more)
            lines += ["", f"{name}:", *tables(both)]
            low = [row for row in both if row["as planned"] <= RISKY]
            lines += [
                "",
                f"of them those of which at most {100 * RISKY:.0f} % fail as planned:",
                *tables(low),
            ]
    return "\n".join([*tables(rows), *lines])


def main() -> int:
    """Measure what is not finished, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*", help="settings for every plan")
    parser.add_argument("--count", type=int, default=60, help="missions that are drawn")
    parser.add_argument("--seed", type=int, default=61, help="seed of the missions")
    parser.add_argument("--replans", type=int, default=8, help="flights of a mission with new plans")
    parser.add_argument(
        "--most", type=float, default=1.0, help="failure as planned above which nothing is flown"
    )
    parser.add_argument("--out", type=Path, default=FOLDER)
    for name in (*PASSES, "trunks"):
        parser.add_argument(f"--{name}", action="store_true", help=f"the pass of {name}")
    parser.add_argument("--tables", "--report", action="store_true", help="only print the tables")
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
    passes = {name: partial(tree_row, rejoin=rejoin) for name, rejoin in PASSES.items()}
    for name, row_of in {**passes, "trunks": compared_trunks}.items():
        if getattr(asked, name):
            compare_all(out, name, asked.most, row_of)
            print(report(out))
            return 0
    done = {row["mission"] for row in read_rows(out)}
    for mission in [] if asked.tables else missions(asked.count, asked.seed, 1):
        if mission.name in done or mission.tags["wind"] == "calm":
            continue
        folder = out / "missions" / mission.name
        fault = planned(folder, mission.write(folder), asked.words)
        began = time.process_time()
        try:
            row = {"said": fault} if fault else measured(folder, asked.replans, asked.most)
        except (ConfigError, DataError, InfeasibleError) as error:
            fault, row = str(error), {"said": str(error)}
        row["cpu_s"] = round(time.process_time() - began, 1)
        with (out / "rows.jsonl").open("a") as stream:
            stream.write(json.dumps({"mission": mission.name, **row}) + "\n")
        print(mission.name, fault or f"{100 * row['as planned']:.1f} % fail as planned", flush=True)
    print(report(out))
    return 0


if __name__ == "__main__":
    sys.exit(main())
