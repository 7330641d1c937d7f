"""The benefit of replanning: one plan in many true winds, with and without new plans on the way.

A flight meets one wind, drawn from the law of the plan. It follows the plan to the step of a fix, measures
its position there, replans (``run/replanning.py``) and takes the new plan, unless the rest of the old one
fails less in flights of the conditioned law. For comparison, the plan is flown to its end in the same wind.
A further way also gets a newer forecast at regular times (``studies/newer_forecasts.py``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.exports.held_course import held_problem
from pareto_ltl.planning.conditioning import Fix
from pareto_ltl.report.records import Study
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.quick import PROMPT_FLIGHTS, PROMPT_POINTS, PROMPT_TREES
from pareto_ltl.run.records import PLAN, PROBLEM, WIND, Records
from pareto_ltl.run.replanning import Replanned, replanned
from pareto_ltl.run.stage_table import stage_seeds
from pareto_ltl.settings import Settings
from pareto_ltl.simulation.common_flights import DrawnFlights, draw_flights
from pareto_ltl.studies.newer_forecasts import newer_forecast, require_cycles
from pareto_ltl.studies.parts import Part, PartsProgress, part_key, work_parts
from pareto_ltl.studies.planning import study_run
from pareto_ltl.studies.statistics import Columns, rate_columns
from pareto_ltl.studies.tables import markdown_table, rate_cell
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.cores import cores
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import ConfigError, InfeasibleError
from pareto_ltl.wind.conditioned import field_from
from pareto_ltl.wind.records import WindField

STREAM, FIXES, FORECASTS = "replanning", "replanning fixes", "replanning forecasts"
OPEN_LOOP, HELD = "as planned", "position always known"


@dataclass(frozen=True, slots=True)
class Way:
    """One way to fly: ``name``, the steps of its fixes, and those at which a newer forecast arrives.

    ``held``: the plan is flown by an autopilot that always knows its position.
    """

    name: str
    fixes: tuple[int, ...] = ()
    forecasts: tuple[int, ...] = ()
    held: bool = False

    @property
    def steps(self) -> tuple[int, ...]:
        """The steps at which the robot plans again."""
        return tuple(sorted({*self.fixes, *self.forecasts}))


@dataclass(frozen=True, slots=True)
class ReplanningContext:
    """The run with the plan, the true winds, and the ways to fly in them."""

    run: Run
    winds: DrawnFlights
    ways: tuple[Way, ...]


def run_replanning(
    settings: Settings, world: Records, directory: Path, progress: PartsProgress | None = None
) -> Study:
    """Fly the plan ``settings.replanning.flights`` times in each way."""
    cfg = settings.replanning
    run = study_run(settings, world)
    run.make(WIND)
    plan, problem = run.make(PLAN), run.make(PROBLEM)
    if cfg.forecasts is not None:
        require_cycles(run.make(WIND))
    winds = draw_flights(problem, problem.fidelity.law, cfg.flights, stage_seeds(settings.seed, STREAM))
    context = ReplanningContext(run, winds, ways_of(settings, run))
    effort = (PROMPT_FLIGHTS, PROMPT_POINTS, PROMPT_TREES)
    key = part_key(settings, STREAM, cfg.fixes, cfg.every, cfg.forecasts, cfg.fix_sd, cfg.flights, effort)
    numbers = [(way, i) for i in range(cfg.flights) for way in range(len(context.ways))]
    todo = [Part(f"flight-{i}-{way}", (way, i), f"{key[:44]}{way:04x}{i:016x}"[::-1]) for way, i in numbers]
    shared = replace(settings.evaluation, jobs=settings.evaluation.jobs or max(1, cores() // 2))
    results = work_parts(shared, directory, replanning_part, context, todo, progress)
    flown = {way.name: results[k :: len(context.ways)] for k, way in enumerate(context.ways)}
    return replanning_study(context, flown, plan.path.objectives.length)


# --- the ways to fly ------------------------------------------------------------------------------


def ways_of(settings: Settings, run: Run) -> tuple[Way, ...]:
    """As planned; with a known position; with each set of fixes; with the last set and newer forecasts."""
    cfg, plan = settings.replanning, run.make(PLAN)
    steps = len(plan.path.u)
    if cfg.every is not None:
        apart = max(1, round(3600.0 * cfg.every / plan.dt))
        sets = {f"a fix every {cfg.every:g} h": tuple(range(apart, steps, apart))}
    else:
        sets = {f"{count} fix{'es' * (count > 1)}": evenly(steps, count) for count in cfg.fixes}
        sets |= {"fixes at landmarks": plan.path.fixes} if plan.path.fixes else {}
    known = [] if run[PROBLEM].motion.gain > 0.0 else [Way(HELD, held=True)]
    ways = [Way(OPEN_LOOP), *known, *(Way(name, own) for name, own in sets.items())]
    if cfg.forecasts is not None:
        apart = max(1, round(3600.0 * cfg.forecasts / plan.dt))
        cycles = tuple(range(apart, steps, apart))
        ways.append(Way(f"{ways[-1].name}, a forecast every {cfg.forecasts:g} h", ways[-1].fixes, cycles))
    return tuple(ways)


def evenly(steps: int, count: int) -> tuple[int, ...]:
    """``count`` different steps of ``steps``, as evenly spaced as they can be."""
    places = np.unique(np.round(np.arange(1, count + 1) * steps / (count + 1)).astype(int))
    return tuple(int(step) for step in places if 0 < step < steps)


# --- one flight -----------------------------------------------------------------------------------


def replanning_part(context: ReplanningContext, way: int, number: int) -> Columns:
    """One true wind flown in one way: whether the flight fails, its new plans and the length flown."""
    wind = context.winds.only(np.array([number]))
    u, x, taken = replanned_controls(context, context.ways[way], wind, number)
    if context.ways[way].held:
        flown = replace(wind, problem=held_problem(wind.problem)).held(u, x)
    else:
        flown = wind.flown(u, x)
    return {
        "failed": bool(wind.failed(flown)[0]),
        "new_plans": taken,
        "length_m": float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum()),
    }


def replanned_controls(
    context: ReplanningContext, way: Way, wind: DrawnFlights, number: int
) -> tuple[FloatArray, FloatArray, int]:
    """Controls (T, 2) [m/s], means (T+1, 2) [m] and the number of new plans taken, for one flight."""
    run, since, taken = context.run, 0, 0
    u, x = run[PLAN].path.u, run[PLAN].path.x
    for step in way.steps:
        if step >= len(u):
            break
        done = _new_plan(context, way, (wind, number), run, (step, since), wind.flown(u, x)[0, step])
        if done is None or done.advice == "old" or done.run is None:
            continue
        new = done.plan.path
        if step + len(new.u) > wind.problem.horizon:
            break
        run, since, taken = done.run, step, taken + 1
        u, x = np.concatenate([u[:step], new.u]), np.concatenate([x[:step], new.x])
    return u, x, taken


def _new_plan(
    context: ReplanningContext, way: Way, flight: tuple[DrawnFlights, int], run: Run,
    steps: tuple[int, int], there: FloatArray,
) -> Replanned | None:  # fmt: skip
    """The plan made now; None if the flight is over, or has no other plan.

    ``steps`` are the present one, and the one at which the plan of ``run`` began.
    """
    settings, (wind, number), (now, since) = context.run.settings, flight, steps
    rng = np.random.default_rng([*stage_seeds(settings.seed, FIXES).generate_state(2).tolist(), number, now])
    sd = settings.replanning.fix_sd
    fixes = (Fix(there + sd * rng.standard_normal(2), sd, now - since),) if now in way.fixes else ()
    newer = cycle_at(context, wind, number, now) if now in way.forecasts else None
    try:
        return replanned(run, run[PROBLEM].motion.dt * (now - since), fixes, wind=newer)
    except (ConfigError, InfeasibleError):  # complete, failed, or no new plan: the plan continues
        return None


def cycle_at(context: ReplanningContext, wind: DrawnFlights, number: int, step: int) -> WindField:
    """The forecast that begins at ``step`` of the flight, for the rest of it."""
    run = context.run
    moment = step * run[PROBLEM].motion.dt
    seeds = stage_seeds(run.settings.seed, FORECASTS).generate_state(2).tolist()
    rng = np.random.default_rng([*seeds, number, step])
    newer = newer_forecast(run[WIND], wind.problem.modes, wind.draws.theta[:, 0], moment, rng)
    return field_from(newer, moment)


# --- the study ------------------------------------------------------------------------------------


def replanning_study(
    context: ReplanningContext, flown: Mapping[str, Sequence[dict[str, Any]]], length: float
) -> Study:
    """The rate of each way, and its difference from the plan flown as it is, flight by flight."""
    alone = np.array([row["failed"] for row in flown[OPEN_LOOP]], bool)
    rows: list[Columns] = []
    for way in context.ways:
        own = flown[way.name]
        failed = np.array([row["failed"] for row in own], bool)
        gap, low, high = paired_difference(alone, failed)
        rows.append(
            {"way": way.name, "law": context.winds.law, "flights": len(failed), "fixes": len(way.fixes)}
            | {"forecasts": len(way.forecasts)}
            | rate_columns("failure", failed)
            | {"difference": gap, "difference_low": low, "difference_high": high}
            | {"new_plans": float(np.mean([row["new_plans"] for row in own]))}
            | {"length_m": float(np.mean([row["length_m"] for row in own]))}
        )
    numbers = {
        f"replanning_{name}_{k}": float(row[name])
        for k, row in enumerate(rows)
        for name in ("failure", "failure_low", "failure_high", "difference", "length_m", "new_plans")
    }
    each = tuple(
        {"flight": i, "way": name} | {k: int(v) if isinstance(v, bool) else v for k, v in row.items()}
        for name, own in flown.items()
        for i, row in enumerate(own)
    )
    numbers |= {"replanning_flights": float(len(alone)), "replanning_planned_length_m": length}
    return Study({"replanning": tuple(rows), "replanning_flights": each}, numbers, _text(rows))


def _text(rows: Sequence[Columns]) -> str:
    def difference(row: Columns) -> str:
        gap, low, high = (100.0 * row[f"difference{end}"] for end in ("", "_low", "_high"))
        return "-" if row["way"] == OPEN_LOOP else f"{gap:+.1f} [{low:+.1f}, {high:+.1f}]"

    return markdown_table(
        f"The plan in {rows[0]['flights']} true winds of the {rows[0]['law']} law, as planned and with new "
        "plans "
        "on the way; 95 % intervals, the difference by pairs",
        {
            "way": lambda row: str(row["way"]),
            "failed": lambda row: rate_cell(row, "failure"),
            "difference [points]": difference,
            "new plans a flight": lambda row: f"{row['new_plans']:.1f}",
            "length [km]": lambda row: f"{row['length_m'] / 1e3:.0f}",
        },
        rows,
    )
