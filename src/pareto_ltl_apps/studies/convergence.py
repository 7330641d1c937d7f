"""Bound and simulated failure of the selected path as the trees grow (the paper's Figure 2).

One forest for each seed is grown to the largest size. The path to a vertex never changes and vertices are
stored in the order of their creation, so the first n of each tree are the forest as it was at n vertices per
tree. At each size the path is selected and flown as in a run that stops there, in the same winds at all
sizes.

Theorem 3 claims that the front never gets worse. This is measured by the hypervolume of the front, with one
reference for all sizes and seeds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl import Run, Settings
from pareto_ltl.extend import FidelityConfig, Forest, Problem, Study, Tree
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl_apps.studies import planning, tables
from pareto_ltl_apps.studies.parts import Part, Progress, part_key, work_parts
from pareto_ltl_apps.studies.planning import flags
from pareto_ltl_apps.studies.settings import ConvergenceConfig, EvaluationConfig
from pareto_ltl_apps.studies.tables import (
    Columns,
    number_or_nan,
    quartile_columns,
    quartiles_cell,
    rate_columns,
)

FEWEST = 1e-9  # smaller mission risks count as equal: no wind model is so accurate
FAR = 2.0  # the reference of the hypervolume, in lengths of the shortest path of all seeds
BY_CREATION = ("swaps", "beta")  # arrays of a tree without a row for each vertex


def run_convergence(settings: Settings, world: Run, directory: Path, progress: Progress = None) -> Study:
    """Grow one forest for each seed, and select and fly a plan at every size."""
    cfg, sizes = settings[EvaluationConfig], tuple(sorted(settings[ConvergenceConfig].sizes))
    mine = planning.unsmoothed(settings, n_max=sizes[-1])
    world = planning.with_wind(settings, world)
    run = world.with_settings(mine)
    run.make("problem")
    inputs = sizes, settings.deployment.runs, tuple(cfg.laws)
    todo = [
        Part(f"seed-{seed}", (seed,), part_key(replace(mine, seed=seed), "convergence", *inputs))
        for seed in cfg.seeds
    ]
    context = run, planning.truth(settings, world)
    return _study(mine, work_parts(cfg, directory, convergence_part, context, todo, progress))


# --- one seed --------------------------------------------------------------------------------


def convergence_part(context: tuple[Run, Problem], seed: int) -> Columns:
    """One forest at every size, and the time of its first solution; ``context``: the run, the true model."""
    run = context[0].with_seed(seed)
    forest = run.forest
    sizes = sorted(run.settings[ConvergenceConfig].sizes)
    looks = [_look(run.given(forest=snapshot(forest, n)), context[1], n) for n in sizes]
    spent = sum(tree.seconds for tree in forest.trees)
    rate = sum(map(len, forest.trees)) / spent if spent > 0 else math.nan
    return {"looks": looks, "nodes_per_second": rate, **first_answer(run)}


def _look(run: Run, truth: Problem, n: int) -> Columns:
    """The plan of a run that stops at ``n`` vertices per tree, and the outcomes of its flights."""
    forest, cfg = run.forest, run.settings
    look: Columns = {"size": n, "vertices": sum(map(len, forest.trees)), "accepted": len(forest.accepted)}
    try:
        plan = run.plan
    except InfeasibleError:
        return look | {"planned": False}
    flight = plan.path.u, plan.path.x
    laws = planning.outcomes(truth, flight, cfg.deployment.runs, cfg[EvaluationConfig].laws, cfg.seed)
    found = look | planning.plan_columns(plan, laws)
    return found | {"mission_bound": found["objectives"]["mission_risk"], "front": trade_offs(forest)}


def trade_offs(forest: Forest) -> FloatArray:
    """Non-dominated (risk, length [m]) of the accepted vertices; risk is the sum of all stored risks."""
    from pareto_ltl.extend import accepted_rows, non_dominated

    rows = accepted_rows(forest)
    table = np.column_stack([np.minimum(1.0, rows[:, :-1].sum(axis=1)), rows[:, -1]])
    return np.asarray(table[non_dominated(table)], float)


def snapshot(forest: Forest, n: int) -> Forest:
    """The forest as it was when each tree had ``n`` vertices."""
    old = forest.accepted[forest.accepted[:, 1] < n]
    return replace(forest, trees=tuple(_first(tree, n) for tree in forest.trees), accepted=old)


def _first(tree: Tree, n: int) -> Tree:
    if len(tree) <= n:
        return tree
    rows: dict[str, Any] = {
        f.name: value[:n]
        for f in fields(tree)
        if f.name not in BY_CREATION and isinstance(value := getattr(tree, f.name), np.ndarray)
    }
    return replace(tree, **rows)


def first_answer(run: Run) -> Columns:
    """Number of vertices with which the fastest tree completes the mission, and its time [s]."""
    from pareto_ltl.planning import growth

    seeds = run.seeds("forest")
    options = growth.GrowthOptions(stop_at_first=True)
    forest = growth.grow_forest(run.settings.planner, run.problem, seeds, None, options)
    there = np.unique(forest.accepted[:, 0])
    if not len(there):
        return {"first_seconds": None, "first_vertices": None, "trees_done": 0}
    quickest = min(there, key=lambda j: len(forest.trees[j]))  # by count: clocks differ from run to run
    return {
        "first_seconds": forest.trees[quickest].seconds,
        "first_vertices": len(forest.trees[quickest]),
        "trees_done": len(there),
    }


# --- all seeds -------------------------------------------------------------------------------


def _study(settings: Settings, results: Sequence[Mapping[str, Any]]) -> Study:
    sizes, cfg = sorted(settings[ConvergenceConfig].sizes), settings[EvaluationConfig]
    volumes = hypervolumes(results)
    rows = [
        _row(n, law, [result["looks"][k] for result in results], volumes[:, k])
        | {"planned_law": settings.fidelity.law}
        for k, n in enumerate(sizes)
        for law in cfg.laws
    ]
    each = [
        _seed_row(seed, law, look, volumes[s, k])
        for s, seed in enumerate(cfg.seeds)
        for k, look in enumerate(results[s]["looks"])
        for law in cfg.laws
    ]
    clocks = ("first_seconds", "first_vertices", "nodes_per_second")
    firsts = [
        {"seed": seed} | {key: number_or_nan(result[key]) for key in clocks}
        for seed, result in zip(cfg.seeds, results, strict=True)
    ]
    numbers = {"seeds": float(len(cfg.seeds))}
    for name in clocks[:2]:
        numbers |= quartile_columns(name, [row[name] for row in firsts])
    for row in rows[-len(cfg.laws) :]:
        law = row["law"]
        numbers |= {f"bound_{law}": row["bound"], f"median_failure_{law}": row["failure_of_a_plan"]}
    made = {"convergence": rows, "convergence_seeds": each, "first_answer": firsts}
    return Study(made, numbers, _text(rows, numbers, settings.fidelity))


def hypervolumes(results: Sequence[Mapping[str, Any]]) -> FloatArray:
    """(seeds, sizes): volume that each front dominates, in risk (decades) and length.

    Both are scaled to [0, 1]: risk as 1 + log10(max(f, 1e-9)) / 9, length against ``FAR`` times the shortest
    path of any seed. The logarithm does not change which path dominates which, and makes a decrease
    from 1e-2 to 1e-4 visible.
    """
    from pareto_ltl.extend import hypervolume

    lengths = [row[1] for r in results for look in r["looks"] if look["planned"] for row in look["front"]]
    volumes = np.zeros((len(results), len(results[0]["looks"])))
    if not lengths:
        return volumes
    far = FAR * min(lengths)
    for s, result in enumerate(results):
        for k, look in enumerate(result["looks"]):
            if look["planned"]:
                rows = np.array([[decades(risk), length / far] for risk, length in look["front"]])
                volumes[s, k] = hypervolume(rows, np.ones(2))
    return volumes


def decades(risk: float) -> float:
    """Mission risk on a logarithmic scale: 0 at ``FEWEST`` and below, 1 at a risk of 1."""
    return 1.0 - math.log10(max(risk, FEWEST)) / math.log10(FEWEST)


def _row(n: int, law: str, looks: Sequence[Mapping[str, Any]], volumes: FloatArray) -> Columns:
    """Median and quartiles over the seeds that have a plan at this size."""
    planned = planning.with_plan(looks)
    missed = [1.0 - flags(look, law, "accepted").mean() for look in planned]
    bounds = [number_or_nan(look["mission_bound"]) for look in planned]
    broken = (
        tables.exceeds(~flags(look, law, "accepted"), limit)
        for look, limit in zip(planned, bounds, strict=True)
    )
    row: Columns = {"size": n, "law": law, "seeds": len(looks)} | planning.failure_columns(looks, law)
    row |= quartile_columns("mission_bound", bounds)
    row |= quartile_columns("bound", [planning.bound(look) for look in planned])
    row |= quartile_columns("missed_of_a_plan", missed)
    row |= {"bounds_broken": sum(broken)}
    return row | quartile_columns("hypervolume", volumes)


def _seed_row(seed: int, law: str, look: Mapping[str, Any], volume: float) -> Columns:
    row: Columns = {"seed": seed, "size": look["size"], "law": law, "planned": int(look["planned"])}
    costs = look["objectives"] if look["planned"] else {}
    for name in ("length", "mission_risk_paper", "mission_risk_ordered", "collision_risk"):
        row[name] = number_or_nan(costs.get(name))
    row |= rate_columns("failure", flags(look, law) if look["planned"] else np.empty(0, bool))
    return row | {"hypervolume": volume, "accepted_vertices": look["accepted"]}


def _text(rows: Sequence[Columns], numbers: Mapping[str, float], models: FidelityConfig) -> str:
    mission_bound = f"bound {models.mission_symbol} on missed, {models.law} winds"
    table = tables.markdown_table(
        "The selected path as trees grow: median (quartiles) over seeds that have a plan",
        {
            "vertices per tree": lambda row: f"{row['size']:,}",
            "winds": "law",
            "with a plan": planning.planned_text,
            mission_bound: lambda row: quartiles_cell(row, "mission_bound"),
            "missed": lambda row: quartiles_cell(row, "missed_of_a_plan"),
            "broken": lambda row: f"{row['bounds_broken']} of {round(row['planned'] * row['seeds'])}",
            f"bound V + R, {models.law} winds": lambda row: quartiles_cell(row, "bound"),
            "failed": lambda row: quartiles_cell(row, "failure_of_a_plan"),
            "length [km]": tables.length_cell,
            "hypervolume": lambda row: f"{row['hypervolume']:.3f}",
        },
        rows,
    )
    first = [1e3 * numbers[f"first_seconds{end}"] for end in ("", "_q25", "_q75")]
    return table + (
        f"\nFirst answer: {first[0]:.1f} ms (quartiles {first[1]:.1f} to {first[2]:.1f}), "
        f"after {numbers['first_vertices']:.0f} vertices of its tree.\n"
    )
