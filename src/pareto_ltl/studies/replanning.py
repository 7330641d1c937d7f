"""The benefit of replanning: one plan in many true winds, with and without new plans on the way.

A flight meets one wind, drawn from the law of the plan. It follows the plan to the step of a fix, measures
its position there, replans (``run/replanning.py``) and takes the new plan, unless the rest of the old one
fails less in flights of the conditioned law. For comparison, the plan is flown to its end in the same wind.
Further ways also get newer forecasts at regular times (``studies/newer_forecasts.py``). The same ways in the
winds of later analyses are ``studies/replan_test.py``.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np

from pareto_ltl.exports.exported import held_problem
from pareto_ltl.planning.conditioning import Fix
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.report.records import Study
from pareto_ltl.run.newer_wind import NewWind
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.quick import PROMPT_FLIGHTS, PROMPT_POINTS, PROMPT_TREES
from pareto_ltl.run.records import AUTOMATON, DECOMPOSITION, PLAN, PROBLEM, SCENE, WIND, Records
from pareto_ltl.run.replanning import Replanned, replanned
from pareto_ltl.run.stage_table import stage_seeds
from pareto_ltl.settings import ReplanningConfig, Settings
from pareto_ltl.simulation.common_flights import DrawnFlights, draw_flights
from pareto_ltl.studies.newer_forecasts import newer_forecast, require_cycles
from pareto_ltl.studies.parts import Part, PartsProgress, half_the_cores, part_key, work_parts
from pareto_ltl.studies.planning import study_run
from pareto_ltl.studies.statistics import Columns, rate_columns
from pareto_ltl.studies.tables import markdown_table, rate_cell
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.wind.conditioned import field_from

LOG = logging.getLogger(__name__)
STREAM, FIXES, FORECASTS = "replanning", "replanning fixes", "replanning forecasts"
AS_PLANNED, HELD = "as planned", "position always known"
NO_FIXES, BY_CHANCE = "no fixes", "fixes by chance"
EFFORT = (PROMPT_FLIGHTS, PROMPT_POINTS, PROMPT_TREES)

Pilot: TypeAlias = Callable[[DrawnFlights, FloatArray, FloatArray], FloatArray]


def with_fixes(wind: DrawnFlights, u: FloatArray, mean: FloatArray) -> FloatArray:
    """Positions of a robot that uses the fixes at landmarks that it passes."""
    return wind.flown(u, mean)


def without_fixes(wind: DrawnFlights, u: FloatArray, mean: FloatArray) -> FloatArray:
    """Positions of a robot that sees no landmark."""
    return wind.held(u, mean)


def always_known(wind: DrawnFlights, u: FloatArray, mean: FloatArray) -> FloatArray:
    """Positions of a robot with an autopilot that always knows its position."""
    return replace(wind, problem=held_problem(wind.problem)).held(u, mean)


class Cycles(Protocol):
    """The newer forecasts of a flight."""

    def at(self, run: Run, wind: DrawnFlights, number: int, step: int) -> NewWind:
        """The forecast known at ``step`` of flight ``number`` in ``wind``."""


class LawCycles:
    """Forecasts drawn from the law of the plan, given the true wind of the flight."""

    def at(self, run: Run, wind: DrawnFlights, number: int, step: int) -> NewWind:
        """The forecast that begins at ``step`` of the flight, for the rest of it."""
        moment = step * run[PROBLEM].motion.dt
        rng = stream_at(run.settings, FORECASTS, number, step)
        newer = newer_forecast(run[WIND], wind.problem.modes, wind.draws.theta[:, 0], moment, rng)
        return field_from(newer, moment)


@dataclass(frozen=True, slots=True)
class Way:
    """One way to fly.

    Attributes
    ----------
    name : str
    path : PlannedPath
        The path at departure.
    pilot : function
        What the robot knows of its position on the way.
    fixes, forecasts : tuple of int
        Steps of position fixes and of newer forecasts; the robot plans again at each.
    """

    name: str
    path: PlannedPath
    pilot: Pilot = with_fixes
    fixes: tuple[int, ...] = ()
    forecasts: tuple[int, ...] = ()

    @property
    def steps(self) -> tuple[int, ...]:
        """The steps at which the robot plans again."""
        return tuple(sorted({*self.fixes, *self.forecasts}))


@dataclass(frozen=True, slots=True)
class ReplanningContext:
    """The run with the plan, the true winds, the ways to fly in them, and the newer forecasts."""

    run: Run
    winds: DrawnFlights
    ways: tuple[Way, ...]
    cycles: Cycles


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
    context = ReplanningContext(run, winds, (*unaided_ways(run), *ways_of(cfg, run)), LawCycles())
    key = part_key(settings, STREAM, cfg.fixes, cfg.every, cfg.forecasts, cfg.fix_sd, cfg.flights, EFFORT)
    numbers = [(way, i) for i in range(cfg.flights) for way in range(len(context.ways))]
    todo = [Part(f"flight-{i}-{way}", (way, i), f"{key[:44]}{way:04x}{i:016x}"[::-1]) for way, i in numbers]
    results = work_parts(
        half_the_cores(settings.evaluation), directory, replanning_part, context, todo, progress
    )
    flown = {way.name: results[k :: len(context.ways)] for k, way in enumerate(context.ways)}
    title = f"The plan in {cfg.flights} true winds of the {winds.law} law, in each of {len(flown)} ways"
    study = replanning_study(flown, winds.law, title)
    planned = {"replanning_planned_length_m": plan.path.objectives.length}
    return replace(study, numbers={**study.numbers, **planned})


# --- the ways to fly ------------------------------------------------------------------------------


def ways_of(cfg: ReplanningConfig, run: Run) -> tuple[Way, ...]:
    """As planned; with a known position; with each set of fixes; with newer forecasts; with both."""
    plan = run.make(PLAN)
    steps, path = len(plan.path.u), plan.path
    if cfg.every is not None:
        apart = max(1, round(3600.0 * cfg.every / plan.dt))
        sets = {f"a fix every {cfg.every:g} h": tuple(range(apart, steps, apart))}
    else:
        sets = {f"{count} fix{'es' * (count > 1)}": evenly(steps, count) for count in cfg.fixes}
        sets |= {"fixes at landmarks": path.fixes} if path.fixes else {}
    known = [] if run[PROBLEM].motion.gain > 0.0 else [Way(HELD, path, always_known)]
    ways = [Way(AS_PLANNED, path), *known, *(Way(name, path, fixes=own) for name, own in sets.items())]
    if cfg.forecasts is not None:
        apart = max(1, round(3600.0 * cfg.forecasts / plan.dt))
        cycles, often = tuple(range(apart, steps, apart)), f"a forecast every {cfg.forecasts:g} h"
        last = ways[-1]
        ways += [
            Way(often, path, forecasts=cycles),
            Way(f"{last.name}, {often}", path, fixes=last.fixes, forecasts=cycles),
        ]
    return tuple(ways)


def unaided_ways(run: Run) -> tuple[Way, ...]:
    """On a map with landmarks, the plan made without them: flown without fixes, and with those it meets."""
    scene = run.make(SCENE)
    if not scene.landmarks:
        return ()
    bare = Records({SCENE: replace(scene, landmarks=()), DECOMPOSITION: run[DECOMPOSITION]})
    bare[AUTOMATON], bare[WIND] = run[AUTOMATON], run[WIND]
    try:
        path = study_run(run.settings, bare).make(PLAN).path
    except (InfeasibleError, DataError) as error:
        LOG.warning(
            "no rows '%s' and '%s': without landmarks there is no plan (%s)", NO_FIXES, BY_CHANCE, error
        )
        return ()
    return Way(NO_FIXES, path, without_fixes), Way(BY_CHANCE, path)


def evenly(steps: int, count: int) -> tuple[int, ...]:
    """``count`` different steps of ``steps``, as evenly spaced as they can be."""
    places = np.unique(np.round(np.arange(1, count + 1) * steps / (count + 1)).astype(int))
    return tuple(int(step) for step in places if 0 < step < steps)


# --- one flight -----------------------------------------------------------------------------------


def replanning_part(context: ReplanningContext, way: int, number: int) -> Columns:
    """One true wind flown in one way: whether the flight fails, its new plans and the length flown."""
    return fly_way(context, context.ways[way], number)


def fly_way(context: ReplanningContext, way: Way, number: int) -> Columns:
    """Flight ``number`` of ``context.winds`` in one way."""
    wind = context.winds.only(np.array([number]))
    u, x, taken = replanned_controls(context, way, wind, number)
    return {
        "failed": bool(wind.failed(way.pilot(wind, u, x))[0]),
        "new_plans": taken,
        "length_m": float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum()),
    }


def replanned_controls(
    context: ReplanningContext, way: Way, wind: DrawnFlights, number: int
) -> tuple[FloatArray, FloatArray, int]:
    """Controls (T, 2) [m/s], means (T+1, 2) [m] and the number of new plans taken, for one flight."""
    run, since, taken = context.run, 0, 0
    u, x = way.path.u, way.path.x
    for step in way.steps:
        if step >= len(u):
            break
        done = _new_plan(context, way, (wind, number), run, (step, since), way.pilot(wind, u, x)[0, step])
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
    sd, rng = settings.replanning.fix_sd, stream_at(settings, FIXES, number, now)
    fixes = (Fix(there + sd * rng.standard_normal(2), sd, now - since),) if now in way.fixes else ()
    newer = context.cycles.at(context.run, wind, number, now) if now in way.forecasts else None
    try:
        return replanned(run, run[PROBLEM].motion.dt * (now - since), fixes, wind=newer)
    except (ConfigError, InfeasibleError):  # complete, failed, or no new plan: the plan continues
        return None
    except DataError as error:
        LOG.warning("flight %d flies on without the forecast of step %d: %s", number, now, error)
        return None


def stream_at(settings: Settings, stream: str, number: int, step: int) -> np.random.Generator:
    """The random numbers of ``stream`` at ``step`` of flight ``number``."""
    return np.random.default_rng(
        [*stage_seeds(settings.seed, stream).generate_state(2).tolist(), number, step]
    )


# --- the study ------------------------------------------------------------------------------------


def replanning_study(flown: Mapping[str, Sequence[Mapping[str, Any]]], law: str, title: str) -> Study:
    """The rate of each way, and its difference from the first one, flight by flight.

    ``flown`` has for each way the flights in the same order of winds; ``law`` names these winds.
    """
    base, *_ = flown
    alone = np.array([row["failed"] for row in flown[base]], bool)
    rows: list[Columns] = []
    for name, own in flown.items():
        failed = np.array([row["failed"] for row in own], bool)
        gap, low, high = paired_difference(alone, failed)
        rows.append(
            {"way": name, "law": law, "flights": len(failed)}
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
    numbers |= {"replanning_flights": float(len(alone))}
    return Study({"replanning": tuple(rows), "replanning_flights": each}, numbers, _text(rows, title))


def _text(rows: Sequence[Columns], title: str) -> str:
    def difference(row: Columns) -> str:
        gap, low, high = (100.0 * row[f"difference{end}"] for end in ("", "_low", "_high"))
        return "-" if row is rows[0] else f"{gap:+.1f} [{low:+.1f}, {high:+.1f}]"

    return markdown_table(
        f"{title}; 95 % intervals, the difference from the first row by pairs",
        {
            "way": lambda row: str(row["way"]),
            "failed": lambda row: rate_cell(row, "failure"),
            "difference [points]": difference,
            "new plans a flight": lambda row: f"{row['new_plans']:.1f}",
            "length [km]": lambda row: f"{row['length_m'] / 1e3:.0f}",
        },
        rows,
    )
