"""The benefit of replanning: one plan in many true winds, with and without new plans on the way.

A flight meets one wind, drawn from the law of the plan. It follows the plan to the step of a fix, measures
its position there, replans (``flight/replanning.py``) and takes the new plan, unless the rest of the old one
fails less in flights of the conditioned law. For comparison, the plan is flown to its end in the same wind.
Further ways also get newer forecasts of this wind at regular times (:func:`newer_forecast`). The same ways in
the winds of later analyses, a mission being one trial, are ``replan_test``.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.random import Generator

from careful_io.fingerprints import data_fingerprint
from careful_io.times import HOUR
from pareto_ltl import Run, Settings, WindField
from pareto_ltl.extend import (
    Branching,
    DrawnFlights,
    LawPart,
    PlannedPath,
    Study,
    UnpricedRun,
    draw_flights,
)
from pareto_ltl.kernels import data as kd
from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray, length_of
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.support.seeds import stage_seeds
from pareto_ltl_apps.conditioning import Fix
from pareto_ltl_apps.exports.exported import HELD_TIME
from pareto_ltl_apps.flight.branches import rejoining
from pareto_ltl_apps.flight.replanning import replanned
from pareto_ltl_apps.flight.rest_of_flight import PROMPT_FLIGHTS, PROMPT_POINTS, PROMPT_TREES, NewWind
from pareto_ltl_apps.studies import forecast_test
from pareto_ltl_apps.studies.known_winds import DepartureWinds
from pareto_ltl_apps.studies.parts import Part, Progress, half_the_cores, part_key, work_parts
from pareto_ltl_apps.studies.random_missions import Mission
from pareto_ltl_apps.studies.settings import EvaluationConfig, ForecastTestConfig, ReplanningConfig
from pareto_ltl_apps.studies.tables import Columns, interval_columns, markdown_table, rate_cell, rate_columns
from wind_laws.records import FORECAST_PARTS, forecast_parts

LOG = logging.getLogger("pareto_ltl.studies.replanning")
STREAM, FIXES, FORECASTS = "replanning", "replanning fixes", "replanning forecasts"
TEST_STREAM, LATER = "replan test", "later"  # of flights in later fields: random stream, name of the winds
AS_PLANNED, HELD = "as planned", "position always known"
RESAMPLED = 10_000  # times, for the interval of a part
BRANCHES = " branches"  # end of the name of a way
AT_THE_BRANCH = "new plans at the same fixes"
NO_FIXES, BY_CHANCE = "no fixes", "fixes by chance"
EFFORT = (PROMPT_FLIGHTS, PROMPT_POINTS, PROMPT_TREES)

Pilot: TypeAlias = Callable[[DrawnFlights, FloatArray, FloatArray], FloatArray]
# The newer forecast at a step of a flight, by the run with the plan, the wind, the flight and the step.
Cycles: TypeAlias = Callable[[Run, DrawnFlights, int, int], NewWind]


def always_known(wind: DrawnFlights, u: FloatArray, mean: FloatArray) -> FloatArray:
    """Positions of a robot with an autopilot that always knows its position."""
    return replace(wind, problem=wind.problem.with_feedback(HELD_TIME)).held(u, mean)


@dataclass(frozen=True, slots=True)
class Way:
    """One way to fly.

    Attributes
    ----------
    name : str
    path : PlannedPath
        The path at departure.
    pilot : function
        The positions of a flight, from what the robot knows of its position on the way.
    fixes, forecasts : tuple of int
        Steps of position fixes and of newer forecasts; the robot plans again at each.
    branching : Branching or None
        The branches of the plan, of which the robot takes one at its fix.
    """

    name: str
    path: PlannedPath
    pilot: Pilot = DrawnFlights.flown
    fixes: tuple[int, ...] = ()
    forecasts: tuple[int, ...] = ()
    branching: Branching | None = None

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


def run_replanning(settings: Settings, world: Run, directory: Path, progress: Progress = None) -> Study:
    """Fly the plan ``settings.replanning.flights`` times in each way."""
    cfg = settings[ReplanningConfig]
    run = world.with_settings(settings)
    run.make("wind")
    plan, problem = run.plan, run.problem
    if cfg.forecasts is not None:
        require_cycles(run.wind)
    winds = draw_flights(problem, problem.fidelity.law, cfg.flights, stage_seeds(settings.seed, STREAM))
    ways = (*unaided_ways(run), *ways_of(cfg, run))
    context = ReplanningContext(run, winds, ways, law_cycle)
    key = part_key(settings, STREAM, cfg.fixes, cfg.every, cfg.forecasts, cfg.fix_sd, cfg.flights, EFFORT)
    numbers = [(way, i) for i in range(cfg.flights) for way in range(len(ways))]
    todo = [Part(f"flight-{i}-{way}", (way, i), data_fingerprint([key, way, i])) for way, i in numbers]
    shared = half_the_cores(settings[EvaluationConfig])
    results = work_parts(shared, directory, replanning_part, context, todo, progress)
    flown = {way.name: results[k :: len(ways)] for k, way in enumerate(ways)}
    title = f"The plan in {cfg.flights} true winds of the {winds.law} law, in each of {len(flown)} ways"
    study = replanning_study(flown, winds.law, title)
    planned = {"replanning_planned_length_m": plan.path.objectives.length}
    return replace(study, numbers={**study.numbers, **planned})


# --- the ways to fly ------------------------------------------------------------------------------


def ways_of(cfg: ReplanningConfig, run: Run) -> tuple[Way, ...]:
    """As planned; with a known position; with each set of fixes; with newer forecasts; with both."""
    plan = run.plan
    steps, path = len(plan.path.u), plan.path
    if cfg.every is not None:
        apart = max(1, round(3600.0 * cfg.every / plan.dt))
        sets = {f"a fix every {cfg.every:g} h": tuple(range(apart, steps, apart))}
    else:
        sets = {f"{count} fix{'es' * (count > 1)}": evenly(steps, count) for count in cfg.fixes}
        sets |= {"fixes at landmarks": path.fixes} if path.fixes else {}
    known = [] if run.problem.motion.gain > 0.0 else [Way(HELD, path, always_known)]
    ways = [Way(AS_PLANNED, path), *known]
    if (tree := plan.branching) is not None:
        fixes = tuple(sorted({own.fix.step for own, _ in tree.all_branches()}))
        ways += [
            Way(f"{len(list(tree.ends()))}{BRANCHES}", path, branching=tree),
            Way(AT_THE_BRANCH, path, fixes=fixes),
        ]
    ways += [Way(name, path, fixes=own) for name, own in sets.items()]
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
    scene = run.scene
    if not scene.landmarks:
        return ()
    bare = {"scene": replace(scene, landmarks=()), **run.make("cells", "automaton", "wind")}
    try:
        path = UnpricedRun(run.settings, bare).plan.path
    except (InfeasibleError, DataError) as error:
        LOG.warning(
            "no rows '%s' and '%s': without landmarks there is no plan (%s)", NO_FIXES, BY_CHANCE, error
        )
        return ()
    return Way(NO_FIXES, path, DrawnFlights.held), Way(BY_CHANCE, path)


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
        "length_m": length_of(x),
    }


def replanned_controls(
    context: ReplanningContext, way: Way, wind: DrawnFlights, number: int
) -> tuple[FloatArray, FloatArray, int]:
    """Controls (T, 2) [m/s], means (T+1, 2) [m] and the number of new plans taken, for one flight."""
    if (tree := way.branching) is not None:
        return branch_controls(context, way, tree, wind, number)
    *_, last = controls_by_fix(context, way, wind, number)
    return last


def controls_by_fix(
    context: ReplanningContext, way: Way, wind: DrawnFlights, number: int
) -> Iterator[tuple[FloatArray, FloatArray, int]]:
    """As :func:`replanned_controls`: with no new plan, with the one of the first step, of two steps, ..."""
    run, since, taken = context.run, 0, 0
    u, x = way.path.u, way.path.x
    yield u, x, taken
    for step in way.steps:
        new = None if step >= len(u) else new_plan(context, way, wind, number, (run, u, x, since, step))
        if new is not None and step + len(new.plan.path.u) <= wind.problem.horizon:
            run, since, taken = new, step, taken + 1
            u, x = (
                np.concatenate([old[:step], own]) for old, own in ((u, new.plan.path.u), (x, new.plan.path.x))
            )
        yield u, x, taken


def new_plan(
    context: ReplanningContext,
    way: Way,
    wind: DrawnFlights,
    number: int,
    now: tuple[Run, FloatArray, FloatArray, int, int],
) -> Run | None:
    """The run with the new plan of a step; None if the plan goes on.

    ``now`` is the run with the plan that is flown, the controls (T, 2) [m/s] and means (T+1, 2) [m] from the
    departure on, the step at which its plan begins, and the step of the new plan.
    """
    run, u, x, since, step = now
    settings, sd = context.run.settings, context.run.settings[ReplanningConfig].fix_sd
    fixes: tuple[Fix, ...] = ()
    if step in way.fixes:
        there = way.pilot(wind, u, x)[0, step]
        error = sd * stream_at(settings, FIXES, number, step).standard_normal(2)
        fixes = (Fix(there + error, sd, step - since),)
    newer = context.cycles(context.run, wind, number, step) if step in way.forecasts else None
    try:
        done = replanned(run, run.problem.motion.dt * (step - since), fixes, wind=newer)
    except (ConfigError, InfeasibleError):  # complete, failed, or no new plan: the plan continues
        return None
    except DataError as fault:
        LOG.warning("flight %d flies on without the forecast of step %d: %s", number, step, fault)
        return None
    return None if done.advice == "old" else done.run


def branch_controls(
    context: ReplanningContext, way: Way, tree: Branching, wind: DrawnFlights, number: int
) -> tuple[FloatArray, FloatArray, int]:
    """As :func:`replanned_controls`, of a plan that branches: its fixes have the errors of a new plan's."""
    u, x, taken = way.path.u, way.path.x, 0
    then: Branching | None = tree
    while then is not None:
        fix, k = then.fix, then.fix.step
        there = way.pilot(wind, u, x)[:, k]
        rng = stream_at(context.run.settings, FIXES, number, k)
        y = there + fix.sd * rng.standard_normal(2)
        if not bool(fix.inside(there)[0]) or rng.random() >= fix.available:
            break
        branch = then.branches[int(then.chosen(y)[0])]
        u, x = np.concatenate([u[:k], branch.path.u]), np.concatenate([x[:k], branch.path.x])
        if fix.rejoin:
            u = rejoining(wind.problem, then, fix.changes(y[0], wind.problem.motion.dt), u)
        taken, then = taken + 1, branch.then
    return u, x, taken


def stream_at(settings: Settings, stream: str, number: int, step: int) -> Generator:
    """The random numbers of ``stream`` at ``step`` of flight ``number``."""
    state = stage_seeds(settings.seed, stream).generate_state(2).tolist()
    return np.random.default_rng([*state, number, step])


# --- newer forecasts -------------------------------------------------------------------------------


def law_cycle(run: Run, wind: DrawnFlights, number: int, step: int) -> NewWind:
    """A forecast that begins at ``step``, drawn from the law of the plan given the wind of the flight."""
    moment = step * run.problem.motion.dt
    rng = stream_at(run.settings, FORECASTS, number, step)
    newer = newer_forecast(run.wind, wind.problem.modes, wind.draws.theta[:, 0], moment, rng)
    return newer.later(moment)


def require_cycles(field: WindField) -> None:
    """Raise ConfigError unless the field has errors of forecasts, which a later cycle reduces."""
    modes, known = field.modes, bool(np.isfinite(field.leads).any())
    if modes is None or not known or not np.isin(modes.part, list(FORECAST_PARTS.values())).any():
        raise ConfigError(
            "replanning.forecasts: the wind of this run is not a forecast with known leads, so that a later "
            "cycle cannot improve it: take such a source, e.g. wind=noaa, or leave it null"
        )


def newer_forecast(
    field: WindField, modes: kd.Modes, theta: Float32Array, since: float, rng: Generator
) -> WindField:
    """The forecast that begins ``since`` [s after departure], for the flight with the coefficients ``theta``.

    ``theta`` (epochs, 2, P) are the true coefficients in the epochs of ``modes``. Under the law of a field,
    a part of the error of forecasts in slot k is ψ_k' θ_k with the variance σ²(L_k). A cycle that begins T
    later has the variance σ²(L_k - T) there. With s = 1 - σ²(L_k - T) / σ²(L_k), the new field is

        μ_k + s ψ_k' θ_k + √(s (1 - s)) ψ_k' ξ_k,

    where ξ persists as θ does: its error has the variance (1 - s) σ²(L_k), is independent of the new field,
    and its modes are √(1 - s) ψ_k. A part whose variance does not grow with the lead keeps its error.
    """
    found = field.modes
    assert found is not None
    mean, latent, psi = field.mean.copy(), field.latent_var.copy(), found.psi.copy()
    nodes, shape = field.lattice.nodes(), mean.shape[1:3]
    for number, part in forecast_parts(field.error):
        chosen = found.part == number
        xi = rng.standard_normal((2, int(chosen.sum())))
        for k, share in enumerate(revealed_shares(field, part, since).tolist()):
            if k:
                rho = float(part.persistence(field.leads[k - 1], field.times[k] - field.times[k - 1]))
                xi = rho * xi + math.sqrt(1.0 - rho * rho) * rng.standard_normal(xi.shape)
            steps = np.flatnonzero(modes.slot == k)
            if share <= 0.0 or not len(steps):
                continue
            known = theta[modes.epoch[steps[0]]][:, chosen].astype(float)
            observed = share * known + math.sqrt(share * (1.0 - share)) * xi
            for c in (0, 1):
                here = found.between(psi[k, :, :, c][..., chosen].astype(float), nodes)
                mean[k, ..., c] += (here @ observed[c]).reshape(shape)
                lost = share * (here**2).sum(axis=1).reshape(shape)
                latent[k, ..., c] = np.maximum(latent[k, ..., c] - lost, 0.0)
            psi[k][..., chosen] *= np.float32(math.sqrt(1.0 - share))
    leads = np.where(field.times >= since, np.maximum(field.leads - since, 0.0), field.leads)
    return replace(
        field, mean=mean, latent_var=latent, modes=replace(found, psi=psi), leads=leads, evidence=None,
        source=f"a forecast {since / HOUR:g} h newer than {field.source}",
    )  # fmt: skip


def revealed_shares(field: WindField, part: LawPart, since: float) -> FloatArray:
    """s (K,): the share of the variance of a part that a cycle ``since`` [s] later removes."""
    late = np.isfinite(field.leads) & (field.times >= since)
    before = part.variance(np.where(late, field.leads, 0.0))
    after = part.variance(np.where(late, np.maximum(field.leads - since, 0.0), 0.0))
    share = 1.0 - after / np.maximum(before, 1e-300)
    return np.asarray(np.where(late & (before > 0.0), np.clip(share, 0.0, 1.0), 0.0), float)


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
        row: Columns = {"way": name, "law": law, "flights": len(failed)} | rate_columns("failure", failed)
        row |= interval_columns("difference", *paired_difference(alone, failed))
        row |= {key: float(np.mean([one[key] for one in own])) for key in ("new_plans", "length_m")}
        rows.append(row)
    numbers = {
        f"replanning_{name}_{k}": float(row[name])
        for k, row in enumerate(rows)
        for name in ("failure", "failure_low", "failure_high", "difference", "length_m", "new_plans")
    }
    each = [
        {"flight": i, "way": name} | {k: int(v) if isinstance(v, bool) else v for k, v in row.items()}
        for name, own in flown.items()
        for i, row in enumerate(own)
    ]
    numbers |= {"replanning_flights": float(len(alone))}
    text = _text(rows, title)
    if AT_THE_BRANCH in flown:
        branched = next(name for name in flown if name.endswith(BRANCHES))
        told = (np.array([row["failed"] for row in flown[name]], bool) for name in (branched, AT_THE_BRANCH))
        share = contingency(alone, *told)
        numbers |= dict(zip(("contingency", "contingency_low", "contingency_high"), share, strict=True))
        if math.isfinite(share[0]):
            middle, low, high = (f"{100 * part:.0f}" for part in share)
            text += (
                f"\nOf what new plans at the same fixes save, {branched} save {middle} % (95 %, of "
                f"{RESAMPLED:,} resamplings of the flights: {low} to {high} %).\n"
            )
    return Study({"replanning": rows, "replanning_flights": each}, numbers, text)


def contingency(alone: BoolArray, branched: BoolArray, replanned: BoolArray) -> tuple[float, float, float]:
    """The part of the gain of new plans that branches have, and its 95 % interval.

    (p - p_branches) / (p - p_replanned), all (N,) of the same flights, which are resampled for the interval
    (B. Efron, Annals of Statistics 7, 1979). NaN if new plans save nothing.
    """
    table = np.stack([alone, branched, replanned]).astype(float)
    n = table.shape[1]
    weight = np.random.default_rng(20261128).multinomial(n, np.full(n, 1.0 / n), RESAMPLED) / n

    def part(p: FloatArray) -> FloatArray:
        gain = p[0] - p[2]
        return np.where(gain > 0.0, (p[0] - p[1]) / np.where(gain > 0.0, gain, 1.0), np.nan)

    middle = float(part(table.mean(axis=1)))
    drawn = part(table @ weight.T)
    drawn = drawn[np.isfinite(drawn)]
    if not math.isfinite(middle) or not len(drawn):
        return math.nan, math.nan, math.nan
    low, high = np.quantile(drawn, [0.025, 0.975])
    return middle, float(low), float(high)


def _text(rows: Sequence[Columns], title: str) -> str:
    def difference(row: Columns) -> str:
        gap, low, high = (100.0 * row[f"difference{end}"] for end in ("", "_low", "_high"))
        return "-" if row is rows[0] else f"{gap:+.1f} [{low:+.1f}, {high:+.1f}]"

    return markdown_table(
        f"{title}; 95 % intervals, the difference from the first row by pairs",
        {
            "way": "way",
            "failed": lambda row: rate_cell(row, "failure"),
            "difference [points]": difference,
            "new plans a flight": lambda row: f"{row['new_plans']:.1f}",
            "length [km]": lambda row: f"{row['length_m'] / 1e3:.0f}",
        },
        rows,
    )


# --- in later fields ------------------------------------------------------------------------------


def field_cycle(
    known: DepartureWinds, task: Mission, run: Run, _wind: DrawnFlights, _number: int, step: int
) -> NewWind:
    """The forecasts of the files that have become available at ``step`` of a flight of ``task``."""
    return known.readings(task, step * run.problem.motion.dt)


def run_replan_test(settings: Settings, _: Run, directory: Path, progress: Progress = None) -> Study:
    """Fly the missions of ``settings.forecast_test`` in the ways of ``settings.replanning``."""
    cfg, ways = replace(settings[ForecastTestConfig], known="departure"), settings[ReplanningConfig]
    settings = settings.with_sections(half_the_cores(settings[EvaluationConfig]))
    known = forecast_test.known_of_files(settings, cfg, directory)
    key = [TEST_STREAM, ways.fixes, ways.every, ways.forecasts, ways.fix_sd, EFFORT]
    return missions_study(forecast_test.work_missions(known, mission_part, key, progress))


def mission_part(known: DepartureWinds, k: int) -> Columns:
    """Mission ``k`` flown once in each way; the reason if it has no plan."""
    settings, cfg = known.settings, known.cfg
    task = known.task(k)
    run = known.run_of(task, forecast_test.mission_settings(settings, cfg, task, settings.fidelity))
    try:
        run.make("plan")
    except (InfeasibleError, DataError) as error:
        return {"reason": str(error), "flown": {}}
    stream = stage_seeds(settings.seed + k, TEST_STREAM)
    winds = draw_flights(known.reality(run), known.law_of_reality, 1, stream)
    ways = ways_of(settings[ReplanningConfig], run)
    context = ReplanningContext(run, winds, ways, partial(field_cycle, known, task))
    about = {"mission": k, "formula": task.formula, "departure": task.scene.time_zero}
    about |= {"situation": task.situation}
    flown = {way.name: about | fly_way(context, way, 0) for way in ways}
    return {"reason": "", "flown": flown}


def missions_study(results: Sequence[Mapping[str, Any]]) -> Study:
    """The rates of all missions that have a plan; InfeasibleError if none has."""
    planned = [result["flown"] for result in results if result["flown"]]
    if not planned:
        raise InfeasibleError(
            f"none of {len(results)} random missions has a plan ({results[0]['reason']}); lower "
            "forecast_test.side, or raise robot.u_max or planner.epsilon"
        )
    flown = {name: [flights[name] for flights in planned] for name in planned[0]}
    weather = len({flight["situation"] for flight in flown[next(iter(flown))]})
    study = replanning_study(
        flown, LATER,
        f"{len(planned)} of {len(results)} random missions with a plan, each flown once through the later "
        f"fields of {weather} weather situations, which the intervals ignore",
    )  # fmt: skip
    counts = {"missions": float(len(results)), "missions_planned": float(len(planned))}
    return replace(study, numbers={**study.numbers, **counts})
