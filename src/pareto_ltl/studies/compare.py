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

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.report.records import Study
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import PROBLEM, WIND, Records
from pareto_ltl.settings import Settings, preset
from pareto_ltl.studies.flown_planners import (
    FlownPlanners,
    Planner,
    Result,
    Results,
    bound,
    failure_columns,
    flags,
    fly_planners,
    planned_text,
    pooled_flags,
    truth,
    with_plan,
)
from pareto_ltl.studies.parts import PartsProgress, part_key
from pareto_ltl.studies.planning import fly_seeded, still, study_run, with_wind
from pareto_ltl.studies.statistics import Columns, mcnemar_test, mean_interval, quartile_columns, rate_columns
from pareto_ltl.studies.tables import kilometres_text, markdown_table, number_or_nan, rate_cell
from pareto_ltl.support.display import probability_text

TITLES = {
    "paper": "proposed (paper)",
    "smoothed": "paper, smoothed",
    "full": "full fidelity",
    "cc_rrt": "CC-RRT",
    "ml_rrt": "ML-RRT (no wind)",
    "calm_shortest": "shortest in calm air",
}
COSTS = ("mission_risk_paper", "mission_risk_ordered", "collision_risk")


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


def run_comparison(
    settings: Settings, world: Records, directory: Path, progress: PartsProgress | None = None
) -> Study:
    """Plan with every method and seed, fly all, and compare."""
    world = with_wind(settings, world)
    real = truth(settings, world)
    planners = {
        name: Planner(method(name, settings, world), real, seeded=name != "calm_shortest")
        for name in settings.compare.methods
    }

    def key(name: str, seed: int) -> str:
        mine, more = replace(planners[name].run.settings, seed=seed), settings.deployment.runs
        return part_key(mine, "compare", name, more, settings.evaluation.laws, settings.fidelity.label)

    return _collect_comparison(settings, *fly_planners(settings, planners, key, directory, progress))


# --- tables ----------------------------------------------------------------------------------


def _collect_comparison(settings: Settings, flown: FlownPlanners, found: Results) -> Study:
    names, seeds, laws = settings.compare.methods, settings.evaluation.seeds, flown.laws
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
    pictures = {"panels": _panels(settings, flown, found), "wind": _wind(flown)}
    return Study(
        {name: tuple(table) for name, table in tables.items()},
        numbers,
        _comparison_text(rows, pairs),
        pictures,
    )


def _comparison_row(name: str, law: str, results: Sequence[Result]) -> Columns:
    """All seeds of one method under one law; a seed without a plan has no flights."""
    planned = with_plan(results)
    row: Columns = {"method": name, "title": TITLES[name], "law": law, "seeds": len(results)}
    row |= {"flights": len(pooled_flags(planned, law))} | failure_columns(results, law)
    for rate, flag in (("collision", "collided"), ("off_map", "off_map"), ("completion", "accepted")):
        row |= rate_columns(rate, pooled_flags(planned, law, flag))
    for cost in COSTS:
        row |= quartile_columns(cost, [number_or_nan(result["objectives"][cost]) for result in planned])
    bounds = [bound(result) for result in planned]
    row |= quartile_columns("bound_paper", [bound(result, "mission_risk_paper") for result in planned])
    row |= quartile_columns("bound", bounds)
    row |= {"bound_mean": float(np.mean(bounds)) if bounds else float("nan")}
    row |= quartile_columns("forecast", [result["laws"][law]["bound"] for result in planned])
    row |= {"bounds_broken": sum(_is_broken(result, law) for result in planned)}
    return row | quartile_columns("plan_seconds", [result["seconds"] for result in results])


def _is_broken(result: Result, law: str) -> bool:
    """Whether a plan fails significantly more often than the forecast."""
    return bool(rate_columns("f", flags(result, law))["f_low"] > result["laws"][law]["bound"])


def _flight_row(name: str, seed: int, law: str, result: Result) -> Columns:
    costs = result["objectives"]
    row: Columns = {"method": name, "seed": seed, "law": law, "length_m": costs["length"]}
    row |= {cost: number_or_nan(costs[cost]) for cost in COSTS} | {"steps": len(result["u"])}
    return (
        row
        | rate_columns("failure", flags(result, law))
        | rate_columns("collision", flags(result, law, "collided"))
    )


def _difference(first: str, other: str, law: str, found: Results, seeds: Sequence[int]) -> Columns:
    """Failure of ``other`` minus failure of ``first``, flight by flight in the same winds."""
    both = [s for s in seeds if found[first, s]["planned"] and found[other, s]["planned"]]
    pairs = [(flags(found[first, s], law), flags(found[other, s], law)) for s in both]
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


def _panels(settings: Settings, flown: FlownPlanners, found: Results) -> list[Columns]:
    """The first seed's plan of every method with its flights, for Figure 1."""
    seed = settings.evaluation.seeds[0]
    panels = []
    for name in settings.compare.methods:
        result = found[name, seed]
        panel: Columns = {"method": name, "title": TITLES[name], "planned": result["planned"]}
        if result["planned"]:
            u, x = (np.array(result[key], float).reshape(-1, 2) for key in ("u", "x"))
            panel |= {
                "x": x,
                "flights": {
                    law: fly_seeded(flown.planners[name].truth, u, flown.runs, law, seed, x)
                    for law in flown.laws
                },
                "length_m": result["objectives"]["length"],
                "bound": bound(result),
            }
        panels.append(panel)
    return panels


def _wind(flown: FlownPlanners) -> Any:
    """The expected wind, for the arrows."""
    winds = (planner.run[WIND] for planner in flown.planners.values())
    return next((wind for wind in winds if wind.mean.any()), None)


def _comparison_text(rows: Sequence[Columns], pairs: Sequence[Columns]) -> str:
    first = markdown_table(
        "Failure of the flights (missed the mission, touched an obstacle or, where the border is a wall, "
        "left the map), 95 % intervals; bounds: mission "
        "risk (f_o or V) + collision risk R, in the winds that the plan was made for and in those flown in; "
        "medians over seeds",
        {
            "method": lambda row: TITLES[row["method"]],
            "winds": lambda row: row["law"],
            "planned": planned_text,
            "length [km]": lambda row: kilometres_text(row["length_m"]),
            "f_o + R, as planned": lambda row: _planned_risk(row, "bound_paper"),
            "V + R, as planned": lambda row: _planned_risk(row, "bound"),
            "V + R in these winds": lambda row: probability_text(row["forecast"]),
            "failed": lambda row: rate_cell(row, "failure"),
            "collided": lambda row: rate_cell(row, "collision"),
            "left the map": lambda row: rate_cell(row, "off_map"),
            "completed": lambda row: rate_cell(row, "completion"),
        },
        rows,
    )
    if not pairs:
        return first
    reference = TITLES[pairs[0]["against"]]
    second = markdown_table(
        f"Failure minus failure of {reference}, in the same winds (95 % interval over seeds)",
        {
            "method": lambda row: TITLES[row["method"]],
            "winds": lambda row: row["law"],
            "difference": _points,
            "only this failed": lambda row: f"{row['only_this_failed']:,}",
            "only the other failed": lambda row: f"{row['only_the_other_failed']:,}",
            "McNemar p": lambda row: _chance(row["mcnemar_p"]),
        },
        pairs,
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
    if math.isnan(row["difference_low"]):  # one seed has no interval over seeds
        return f"{100 * row['difference']:+.2f} %"
    low, high = max(row["difference_low"], -1.0), min(row["difference_high"], 1.0)
    return f"{100 * row['difference']:+.2f} % ({100 * low:+.2f} to {100 * high:+.2f})"


def _chance(p: float) -> str:
    return "< 1e-6" if p < 1e-6 else f"{p:.2g}"
