"""The benefit of replanning: one plan in many true winds, with and without a new plan at each fix.

A flight meets one wind, drawn from the law of the plan. It follows the plan to the step of a fix, measures
its position there, replans (``run/replanning.py``) and takes the new plan or the rest of the old one,
whichever fails less in flights of the conditioned law. For comparison, the plan is flown to its end in the
same wind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.planning.conditioning import Fix
from pareto_ltl.planning.refine.front_sweep import COARSE_EFFORT
from pareto_ltl.report.records import Study
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import PLAN, PROBLEM, WIND, Records
from pareto_ltl.run.replanning import replanned
from pareto_ltl.run.stage_table import stage_seeds
from pareto_ltl.settings import Settings
from pareto_ltl.simulation.common_flights import DrawnFlights, draw_flights
from pareto_ltl.studies.parts import Part, PartsProgress, part_key, work_parts
from pareto_ltl.studies.planning import study_run
from pareto_ltl.studies.statistics import Columns, rate_columns
from pareto_ltl.studies.tables import markdown_table, rate_cell
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.cores import cores
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import ConfigError, InfeasibleError

STREAM, FIXES = "replanning", "replanning fixes"
USUAL = 6.0  # default time between fixes without landmarks [h]


@dataclass(frozen=True, slots=True)
class ReplanningContext:
    """The run with the plan, the true winds, and the steps of the fixes."""

    run: Run
    winds: DrawnFlights
    steps: tuple[int, ...]


def run_replanning(
    settings: Settings, world: Records, directory: Path, progress: PartsProgress | None = None
) -> Study:
    """Fly the plan ``settings.replanning.flights`` times, with and without replanning."""
    cfg = settings.replanning
    run = study_run(settings, world)
    run.make(WIND)
    plan, problem = run.make(PLAN), run.make(PROBLEM)
    seeds = stage_seeds(settings.seed, STREAM)
    winds = draw_flights(problem, problem.fidelity.law, cfg.flights, seeds)
    context = ReplanningContext(run, winds, fix_steps(settings, run))
    key = part_key(settings, STREAM, cfg.every, cfg.fix_sd, cfg.flights, COARSE_EFFORT)
    todo = [Part(f"flight-{i}", (i,), f"{key[:48]}{i:016x}"[::-1]) for i in range(cfg.flights)]
    shared = replace(settings.evaluation, jobs=settings.evaluation.jobs or max(1, cores() // 2))
    results = work_parts(shared, directory, replanning_part, context, todo, progress)
    return replanning_study(context, results, plan.path.objectives.length)


def fix_steps(settings: Settings, run: Run) -> tuple[int, ...]:
    """Steps of the plan at which flights measure their position."""
    plan, every = run.make(PLAN), settings.replanning.every
    if every is None and plan.path.fixes:
        return plan.path.fixes
    apart = max(1, round(3600.0 * (every or USUAL) / plan.dt))
    return tuple(range(apart, len(plan.path.u), apart))


def replanning_part(context: ReplanningContext, number: int) -> Columns:
    """One true wind: whether the plan fails in it without and with new plans at the fixes."""
    wind = context.winds.only(np.array([number]))
    path = context.run[PLAN].path
    alone = bool(wind.failed(wind.flown(path.u, path.x))[0])
    u, x, taken = replanned_controls(context, wind, number)
    return {
        "alone": alone,
        "replanned": bool(wind.failed(wind.flown(u, x))[0]),
        "new_plans": taken,
        "length_m": float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum()),
    }


def replanned_controls(
    context: ReplanningContext, wind: DrawnFlights, number: int
) -> tuple[FloatArray, FloatArray, int]:
    """Controls (T, 2) [m/s], means (T+1, 2) [m] and the number of new plans taken, for one flight."""
    settings = context.run.settings
    rng = np.random.default_rng([*stage_seeds(settings.seed, FIXES).generate_state(2).tolist(), number])
    run, path, since, taken = context.run, context.run[PLAN].path, 0, 0
    u, x = path.u, path.x
    for step in context.steps:
        if step >= len(u):
            break
        there = wind.flown(u, x)[0, step]
        sd = settings.replanning.fix_sd
        fix = Fix(there + sd * rng.standard_normal(2), sd)
        try:
            done = replanned(run, run[PROBLEM].motion.dt * (step - since), fix)
        except (ConfigError, InfeasibleError):  # complete, failed, or no new plan: the plan continues
            continue
        if done.advice == "old" or done.run is None:
            continue
        run, since, taken = done.run, step, taken + 1
        new = done.plan.path
        if step + len(new.u) > wind.problem.horizon:
            break
        u, x = np.concatenate([u[:step], new.u]), np.concatenate([x[:step], new.x])
    return u, x, taken


def replanning_study(context: ReplanningContext, results: Sequence[dict[str, Any]], length: float) -> Study:
    """Both rates, and their difference flight by flight."""
    alone, anew = (np.array([row[key] for row in results], bool) for key in ("alone", "replanned"))
    gap, low, high = paired_difference(alone, anew)
    row: Columns = {"law": context.winds.law, "flights": len(alone), "fixes": len(context.steps)}
    row |= rate_columns("failure", alone) | rate_columns("failure_replanned", anew)
    row |= {"difference": gap, "difference_low": low, "difference_high": high}
    row |= {
        "new_plans": float(np.mean([found["new_plans"] for found in results])),
        "length_m": length,
        "length_replanned_m": float(np.mean([found["length_m"] for found in results])),
    }
    numbers = {f"replanning_{name}": float(value) for name, value in row.items() if name != "law"}
    each = tuple({"flight": i} | {k: int(v) if isinstance(v, bool) else v for k, v in found.items()}
                 for i, found in enumerate(results))  # fmt: skip
    return Study({"replanning": (row,), "replanning_flights": each}, numbers, _text(row))


def _text(row: Columns) -> str:
    gap, low, high = (100.0 * row[f"difference{end}"] for end in ("", "_low", "_high"))
    return markdown_table(
        f"The plan in {row['flights']} true winds, {row['law']} law, with and without a new plan at each of "
        f"{row['fixes']} fixes; 95 % intervals, the difference by pairs",
        {
            "failed": lambda row: rate_cell(row, "failure"),
            "failed, replanned": lambda row: rate_cell(row, "failure_replanned"),
            "difference [points]": lambda _: f"{gap:+.1f} [{low:+.1f}, {high:+.1f}]",
            "new plans a flight": lambda row: f"{row['new_plans']:.1f}",
            "length [km]": lambda row: f"{row['length_m'] / 1e3:.0f}",
            "length, replanned [km]": lambda row: f"{row['length_replanned_m'] / 1e3:.0f}",
        },
        [row],
    )
