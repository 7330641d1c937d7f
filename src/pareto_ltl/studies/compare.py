"""One mission, several planners, the same winds (the paper's Figure 1 and its baseline).

``paper``            the proposed planner as in the paper: paths of the trees without refinement
``smoothed``         the same with convex smoothing, as ``pipelines=plan fidelity=paper``
``full``             refined and ranked by flights, as ``pipelines=plan fidelity=full``
``cc_rrt``           plain CC-RRT: chance constraints, no re-selection of parents (lines 5-13 of Algorithm 2)
``ml_rrt``           the same planner without any knowledge of wind, μ = 0 and Σ = 0 (the paper's baseline)
``calm_shortest``    the shortest path in still air, by convex smoothing of ``ml_rrt``; one path for all seeds

The last two fly the airspeeds that they planned for calm air in the wind. All plans of one seed meet the same
winds.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.planning.evaluate import forecast
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Plan
from pareto_ltl.report.records import Study
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import PLAN, PROBLEM, WIND, Records
from pareto_ltl.settings import Settings, preset
from pareto_ltl.studies.parts import Part, PartsProgress, part_key, work_parts
from pareto_ltl.studies.planning import fly_seeded, still, study_run, with_wind
from pareto_ltl.studies.statistics import Columns, mcnemar_test, mean_interval, quartile_columns, rate_columns
from pareto_ltl.studies.tables import (
    flags_to_text,
    kilometres_text,
    markdown_table,
    number_or_nan,
    rate_cell,
    text_to_flags,
)
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.display import probability_text
from pareto_ltl.support.errors import InfeasibleError

TITLES = {
    "paper": "proposed (paper)",
    "smoothed": "paper, smoothed",
    "full": "full fidelity",
    "cc_rrt": "CC-RRT",
    "ml_rrt": "ML-RRT (no wind)",
    "calm_shortest": "shortest in calm air",
}
FLAGS = ("accepted", "collided", "off_map", "failed")
COSTS = ("mission_risk_paper", "mission_risk_ordered", "collision_risk")


@dataclass(frozen=True, slots=True)
class ComparisonContext:
    """Data for all parts: a run for each method, and the problem ``truth`` in which all plans are flown."""

    methods: Mapping[str, Run]
    truth: Problem
    runs: int
    laws: tuple[str, ...]
    kept: dict[str, Plan] = field(default_factory=dict)  # plans that no seed changes, once a process


def method(name: str, settings: Settings, world: Records) -> Run:
    """The run of the planner ``name``, with its settings and the wind that it plans in."""
    models = preset("full" if name == "full" else "paper")
    if name not in ("smoothed", "full", "calm_shortest"):
        models = replace(models, refine="none")
    mine = replace(
        settings,
        fidelity=models,
        planner=replace(settings.planner, threads=1),  # seeds share the cores, not trees
    )
    if name == "cc_rrt":
        mine = replace(mine, planner=replace(mine.planner, near=0))  # no parents tried: no re-selection
    run = study_run(mine, world)
    wind = run.make(WIND)
    if name in ("ml_rrt", "calm_shortest"):
        run = run.with_record(WIND, still(wind))
    run.make(PROBLEM)
    return run


def truth(settings: Settings, world: Records) -> Problem:
    """The problem in which plans are flown: ``fidelity=full``, all wind laws."""
    laws = list(settings.evaluation.laws)
    real = replace(settings, fidelity=preset("full"), deployment=replace(settings.deployment, laws=laws))
    return study_run(real, world).make(PROBLEM)


def run_comparison(
    settings: Settings, world: Records, directory: Path, progress: PartsProgress | None = None
) -> Study:
    """Plan with every method and seed, fly all, and compare."""
    cfg, names = settings.evaluation, tuple(settings.compare.methods)
    world = with_wind(settings, world)
    context = ComparisonContext(
        {name: method(name, settings, world) for name in names},
        truth(settings, world),
        settings.deployment.runs,
        tuple(cfg.laws),
    )
    todo = [
        Part(f"{name}-{seed}", (name, seed), _comparison_key(context, settings, name, seed))
        for seed in cfg.seeds
        for name in names
    ]
    results = work_parts(cfg, directory, comparison_part, context, todo, progress)
    found = {part.arguments: result for part, result in zip(todo, results, strict=True)}
    return _collect_comparison(settings, context, found)


def _comparison_key(context: ComparisonContext, settings: Settings, name: str, seed: int) -> str:
    mine = replace(context.methods[name].settings, seed=seed)
    return part_key(mine, "compare", name, context.runs, context.laws, settings.fidelity.label)


def comparison_part(context: ComparisonContext, name: str, seed: int) -> Columns:
    """A plan of one method and the outcomes of its flights; or why there is no plan."""
    began = time.perf_counter()
    try:
        plan = _comparison_plan(context, name, seed)
    except InfeasibleError as error:
        return {"planned": False, "reason": str(error), "seconds": time.perf_counter() - began}
    return {
        "planned": True,
        "seconds": time.perf_counter() - began,
        "objectives": asdict(plan.path.objectives),
        "x": plan.path.x,
        "u": plan.path.u,
        "laws": outcomes(context.truth, plan.path.u, plan.path.x, context.runs, context.laws, seed),
    }


def _comparison_plan(context: ComparisonContext, name: str, seed: int) -> Plan:
    """The plan of one seed; the shortest path in still air is the same for all, to a thousandth."""
    if name != "calm_shortest":
        return context.methods[name].with_seed(seed).make(PLAN)
    if name not in context.kept:
        context.kept[name] = context.methods[name].make(PLAN)
    return context.kept[name]


def outcomes(
    problem: Problem, u: FloatArray, x: FloatArray, runs: int, laws: Sequence[str], seed: int
) -> dict[str, Columns]:
    """For each law, which flights completed the mission, met an obstacle, left the map and failed.

    ``bound`` is V + R under the law.
    """
    found: dict[str, Columns] = {}
    for law in laws:
        flown, ahead = fly_seeded(problem, u, runs, law, seed, x), forecast(problem, u, law)
        seen = (flown.accepted, flown.collided, flown.off_map, flown.failed)
        found[law] = dict(zip(FLAGS, map(flags_to_text, seen), strict=True))
        found[law] |= {"bound": min(1.0, ahead.mission_risk + ahead.collision_risk)}
    return found


# --- tables ----------------------------------------------------------------------------------

Found = Mapping[tuple[Any, ...], Mapping[str, Any]]


def failed(result: Mapping[str, Any], law: str) -> BoolArray:
    """Flights that failed, as ``Deployment.failed`` has it."""
    return text_to_flags(result["laws"][law]["failed"])


def bound(result: Mapping[str, Any], mission: str) -> float:
    """P(fail or collide) ≤ mission risk + collision risk."""
    costs = result["objectives"]
    return min(1.0, number_or_nan(costs[mission]) + number_or_nan(costs["collision_risk"]))


def _collect_comparison(settings: Settings, context: ComparisonContext, found: Found) -> Study:
    names, seeds, laws = settings.compare.methods, settings.evaluation.seeds, context.laws
    rows = [
        _comparison_row(name, law, [found[name, seed] for seed in seeds]) for name in names for law in laws
    ]
    each = [
        _flight_row(name, seed, law, found[name, seed])
        for name in names
        for seed in seeds
        for law in laws
        if found[name, seed]["planned"]
    ]
    pairs = [_difference(names[0], name, law, found, seeds) for name in names[1:] for law in laws]
    missing = [
        {"method": name, "seed": seed, "reason": found[name, seed]["reason"]}
        for name in names
        for seed in seeds
        if not found[name, seed]["planned"]
    ]
    tables = {"compare": rows, "compare_seeds": each, "differences": pairs, "no_plan": missing}
    numbers = {
        f"{row['method']}_failure_{row['law']}{end}": row[f"failure{end}"]
        for row in rows
        for end in ("", "_low", "_high")
    }
    numbers |= {f"{row['method']}_planned": row["planned"] for row in rows}
    numbers |= {"seeds": float(len(seeds))}
    pictures = {"panels": _panels(settings, context, found), "wind": _wind(context)}
    return Study(
        {name: tuple(table) for name, table in tables.items()},
        numbers,
        _comparison_text(rows, pairs),
        pictures,
    )


def _comparison_row(name: str, law: str, results: Sequence[Mapping[str, Any]]) -> Columns:
    """All seeds of one method under one law; a seed without a plan has no flights."""
    planned = [result for result in results if result["planned"]]
    missed = [~text_to_flags(result["laws"][law]["accepted"]) for result in planned]
    hit = [text_to_flags(result["laws"][law]["collided"]) for result in planned]
    gone = [text_to_flags(result["laws"][law]["off_map"]) for result in planned]
    lost = [failed(result, law) for result in planned]
    broken = [
        rate_columns("f", f)["f_low"] > result["laws"][law]["bound"]
        for f, result in zip(lost, planned, strict=True)
    ]
    row: Columns = {"method": name, "title": TITLES[name], "law": law, "seeds": len(results)}
    row |= rate_columns("planned", np.array([result["planned"] for result in results]))
    row |= {"flights": sum(map(len, lost))}
    row |= (
        rate_columns("failure", _joined(lost))
        | rate_columns("completion", ~_joined(missed))
        | rate_columns("collision", _joined(hit))
        | rate_columns("off_map", _joined(gone))
    )
    row |= quartile_columns("failure_of_a_plan", [f.mean() for f in lost])
    row |= quartile_columns("length_m", [result["objectives"]["length"] for result in planned])
    for cost in COSTS:
        row |= quartile_columns(cost, [number_or_nan(result["objectives"][cost]) for result in planned])
    row |= quartile_columns("bound_paper", [bound(result, "mission_risk_paper") for result in planned])
    row |= quartile_columns("bound", [bound(result, "mission_risk_ordered") for result in planned])
    row |= {"bound_mean": _mean([bound(result, "mission_risk_ordered") for result in planned])}
    row |= quartile_columns("forecast", [result["laws"][law]["bound"] for result in planned])
    row |= {"bounds_broken": int(sum(broken))}  # plans that fail significantly more often than the forecast
    row |= quartile_columns("plan_seconds", [result["seconds"] for result in results])
    return row


def _joined(pieces: Sequence[BoolArray]) -> BoolArray:
    return np.concatenate(pieces) if pieces else np.empty(0, bool)


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def _flight_row(name: str, seed: int, law: str, result: Mapping[str, Any]) -> Columns:
    costs = result["objectives"]
    row: Columns = {"method": name, "seed": seed, "law": law, "length_m": costs["length"]}
    row |= {cost: number_or_nan(costs[cost]) for cost in COSTS} | {"steps": len(result["u"])}
    return (
        row
        | rate_columns("failure", failed(result, law))
        | rate_columns("collision", text_to_flags(result["laws"][law]["collided"]))
    )


def _difference(first: str, other: str, law: str, found: Found, seeds: Sequence[int]) -> Columns:
    """Failure of ``other`` minus that of ``first``, flight by flight in the same winds."""
    both = [s for s in seeds if found[first, s]["planned"] and found[other, s]["planned"]]
    pairs = [(failed(found[first, s], law), failed(found[other, s], law)) for s in both]
    gaps = np.array([b.mean() - a.mean() for a, b in pairs])
    low, high = mean_interval(gaps)
    one_only, other_only = (
        int(sum(n)) for n in ([(a & ~b).sum() for a, b in pairs], [(b & ~a).sum() for a, b in pairs])
    )
    return {
        "method": other,
        "against": first,
        "law": law,
        "seeds": len(both),
        "pairs": sum(len(a) for a, _ in pairs),
        "difference": float(gaps.mean()) if len(gaps) else float("nan"),
        "difference_low": low,
        "difference_high": high,
        "only_this_failed": other_only,
        "only_the_other_failed": one_only,
        "mcnemar_p": mcnemar_test(one_only, other_only),
    }


def _panels(settings: Settings, context: ComparisonContext, found: Found) -> list[Columns]:
    """The first seed's plan of every method with its flights, for Figure 1."""
    seed = settings.evaluation.seeds[0]
    panels = []
    for name in settings.compare.methods:
        result = found[name, seed]
        panel: Columns = {"method": name, "title": TITLES[name], "planned": result["planned"]}
        if result["planned"]:
            u = np.array(result["u"], float).reshape(-1, 2)
            x = np.array(result["x"], float)
            flown = {law: fly_seeded(context.truth, u, context.runs, law, seed, x) for law in context.laws}
            panel |= {
                "x": np.array(result["x"], float),
                "flights": flown,
                "length_m": result["objectives"]["length"],
            }
            panel |= {"bound": bound(result, "mission_risk_ordered")}
        panels.append(panel)
    return panels


def _wind(context: ComparisonContext) -> Any:
    """The expected wind, for the arrows."""
    for run in context.methods.values():
        if run[WIND].mean.any():
            return run[WIND]
    return None


def _comparison_text(rows: Sequence[Columns], pairs: Sequence[Columns]) -> str:
    first = markdown_table(
        "Failure of the flights (missed the mission, touched an obstacle or, where the border is a wall, "
        "left the map), 95 % intervals; bounds: mission "
        "risk (f_o or V) + collision risk R, in the winds that the plan was made for and in those flown in; "
        "medians over seeds",
        (
            "method",
            "winds",
            "planned",
            "length [km]",
            "f_o + R, as planned",
            "V + R, as planned",
            "V + R in these winds",
            "failed",
            "collided",
            "left the map",
            "completed",
        ),
        (
            (
                TITLES[row["method"]],
                row["law"],
                f"{round(row['planned'] * row['seeds'])} of {row['seeds']}",
                kilometres_text(row["length_m"]),
                _planned_risk(row, "bound_paper"),
                _planned_risk(row, "bound"),
                probability_text(row["forecast"]),
                rate_cell(row, "failure"),
                rate_cell(row, "collision"),
                rate_cell(row, "off_map"),
                rate_cell(row, "completion"),
            )
            for row in rows
        ),
    )
    if not pairs:
        return first
    second = markdown_table(
        f"Failure minus that of {TITLES[pairs[0]['against']]}, in the same winds (95 % interval over seeds)",
        ("method", "winds", "difference", "only this failed", "only the other failed", "McNemar p"),
        (
            (
                TITLES[row["method"]],
                row["law"],
                _points(row),
                f"{row['only_this_failed']:,}",
                f"{row['only_the_other_failed']:,}",
                _chance(row["mcnemar_p"]),
            )
            for row in pairs
        ),
    )
    return first + "\n" + second


def planned_winds(method: str) -> str:
    """The winds that a method plans for."""
    if method in ("ml_rrt", "calm_shortest"):
        return "calm air"
    return f"{preset('full' if method == 'full' else 'paper').law} winds"


def _planned_risk(row: Columns, name: str) -> str:
    """A bound of the plan with its winds; f_o does not hold in coherent winds."""
    winds = planned_winds(row["method"])
    if name == "bound_paper" and winds == "coherent winds":
        return "-"
    return f"{probability_text(row[name])} in {winds}"


def _points(row: Columns) -> str:
    low, high = max(row["difference_low"], -1.0), min(row["difference_high"], 1.0)
    return f"{100 * row['difference']:+.2f} % ({100 * low:+.2f} to {100 * high:+.2f})"


def _chance(p: float) -> str:
    return "< 1e-6" if p < 1e-6 else f"{p:.2g}"
