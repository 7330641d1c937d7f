"""Choice of the departure time: one mission planned for many starts, whose fronts are compared.

A start is a time of departure. Readings, cells and automaton do not depend on it and are made once. For each
start the wind is fitted from its departure on, and trees, front and plan are made as in a run with that
``mission.start_time``; with ``departure.quick`` by a coarser refinement (``flight/rest_of_flight.py``).
Starts that may be the best are planned with further seeds. The paths of all fronts are compared by fresh
flights that planning has not used; flights of the same number have the same draws at every start. The
recommended start is then planned in full, with all files of a run; its compared paths are judged with the
paths of the full plan.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.files import plain_data, write_json
from careful_io.times import HOUR, iso, seconds
from pareto_ltl import Readings, Run, Scene, Settings
from pareto_ltl.extend import Pipeline, PlannedPath, ProgressBar, Study, UnpricedRun, which_fail
from pareto_ltl.planning.selection_rules import within_capacity
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.support.seeds import named_child, stage_seeds
from pareto_ltl_apps.exports.navigation_log import expected_winds
from pareto_ltl_apps.flight.rest_of_flight import quick_settings
from pareto_ltl_apps.studies import departure_table as tables
from pareto_ltl_apps.studies.departure_fronts import (
    compare_fronts,
    flown_front,
    pooled_front,
    starts_to_repeat,
)
from pareto_ltl_apps.studies.departure_table import Found, folder_name
from pareto_ltl_apps.studies.parts import Part, Progress, half_the_cores, part_key, work_parts
from pareto_ltl_apps.studies.settings import DepartureConfig, EvaluationConfig
from pareto_ltl_apps.studies.tables import Columns, flags_to_text

STREAM = "departure"  # random stream of the flights that compare starts
STARTS, RECOMMENDED = "starts", "recommended"  # folders
MAX_STARTS = 1000
A_DAY = 24 * HOUR  # span of the starts in calm wind, which has no times
QUICK_RUNS = 2000  # upper limit of selection.runs: other flights compare the starts
BATCH = 2  # starts that are planned together in the search for the latest ones
TOO_FAST = 0.6  # of the fastest flight of the first start: flights of other starts are assumed to take longer
STAGES = (
    "readings", "scene", "decomposition", "automaton", "observations", "wind", "problem", "forest", "front",
    "plan",
)  # fmt: skip
FILES = ("forecasts", "deployment", "export", "report", "page")  # further stages of the recommended start
METRICS = ("energy_j",)  # metrics of a plan that become columns if a run has them


@dataclass(frozen=True, slots=True)
class DepartureContext:
    """Data for all starts."""

    settings: Settings
    world: Run
    directory: Path

    @property
    def folder(self) -> Path | None:
        """The folder of the results directories of starts; None to write none."""
        return self.directory / STARTS if self.settings[DepartureConfig].keep == "all" else None


def run_departure(settings: Settings, world: Run, directory: Path, progress: Progress = None) -> Study:
    """Plan the starts of ``settings.departure``, compare their fronts and plan the recommended one in full.

    Raises
    ------
    ConfigError
        If there is no start to plan.
    InfeasibleError
        If no start has a plan, or none arrives in time.
    """
    cfg = settings[DepartureConfig]
    times = candidate_starts(cfg, world.readings, settings.mission.start_time)
    context = DepartureContext(settings, world, directory)
    found = _planned_starts(context, times, progress)
    _require_one(settings, found)
    while again := starts_to_repeat(tables.fronts_in_time(cfg, found), cfg.seeds):
        results = _worked(context, [(time, len(found[time])) for time in again], progress)
        for time, result in zip(again, results, strict=True):
            found[time].append(result)
    _fetch_folders(context, found)
    fronts = tables.fronts_in_time(cfg, found)
    comparison = compare_fronts(fronts)
    time = comparison.recommended
    rows = tables.start_rows(settings, found, comparison)
    extra, place = tables.compared_paths(cfg, time, found), directory / RECOMMENDED
    run = plan_in_full(settings, world, time, place, extra)
    front = within_capacity(settings.selection, run.front, run.problem)
    seeds = stage_seeds(settings.seed, STREAM)
    failed = which_fail(run.problem, front.paths, cfg.flights, seeds)
    lengths = np.array([path.objectives.length for path in front.paths])
    delivered = tables.Delivered(run.plan, flown_front(lengths, failed), pooled_front(fronts[time]))
    document = tables.departures_document(settings, rows, comparison, delivered, RECOMMENDED)
    write_json(directory / "departures.json", document)
    return tables.departure_study(settings, rows, comparison, found, delivered)


# --- the times of departure ------------------------------------------------------------------


def candidate_starts(cfg: DepartureConfig, readings: Readings, departure: str | None) -> tuple[float, ...]:
    """Times of departure of the settings, increasing [s since 1970].

    They are every ``cfg.every`` hours, or every wind time except the last one, after which no wind is known.

    Parameters
    ----------
    departure : str or None
        ``mission.start_time``: the earliest start if ``cfg.first`` is not set.

    Raises
    ------
    ConfigError
        If there is none, or one lies outside the times of the wind.
    """
    known = np.asarray(readings.times, float)
    if not len(known) and not (cfg.first or departure or cfg.starts):
        raise ConfigError("calm wind has no times: give departure.first or departure.starts")

    def time_of(key: str, text: str) -> float:
        time = seconds(text)
        if len(known) and not known[0] <= time <= known[-1]:
            raise ConfigError(
                f"departure.{key}: departure {iso(time)} lies outside the wind of {readings.name} "
                f"({iso(known[0])} .. {iso(known[-1])}); choose a time inside, or add wind files"
            )
        return time

    if cfg.starts:
        return tuple(sorted({time_of("starts", text) for text in cfg.starts}))
    earliest = seconds(departure) if departure else None
    begin = time_of("first", cfg.first) if cfg.first else known[0] if earliest is None else earliest
    end = time_of("last", cfg.last) if cfg.last else known[-1] if len(known) else begin + A_DAY
    if cfg.every is not None:
        count = int((end - begin) / (HOUR * cfg.every) + 1e-9) + 1 if end >= begin else 0
        times: FloatArray = begin + HOUR * cfg.every * np.arange(min(count, MAX_STARTS + 1), dtype=float)
    else:
        times = known if len(known) else np.array([begin])
    if len(times) > 1 and len(known) and times[-1] == known[-1]:
        times = times[:-1]
    times = times[(times >= begin) & (times <= end)]
    if cfg.arrive_by is not None:
        times = times[times < seconds(cfg.arrive_by)]
    if not len(times):
        before = "" if cfg.arrive_by is None else f" and before departure.arrive_by = {cfg.arrive_by}"
        raise ConfigError(
            f"no start lies between {iso(begin)} and {iso(end)}{before}: move departure.first or last, or "
            "choose a smaller departure.every"
        )
    if len(times) > MAX_STARTS:
        raise ConfigError(
            f"departure.every = {cfg.every:g} h gives {len(times):,} starts, expected at most "
            f"{MAX_STARTS:,}: choose a larger one"
        )
    return tuple(times.tolist())


# --- one start -------------------------------------------------------------------------------


def start_settings(
    settings: Settings, time: float, *, quick: bool, files: bool = False, repeat: int = 0
) -> Settings:
    """The settings of a run with the departure ``time`` [s since 1970].

    ``quick`` takes a coarser refinement; ``files`` adds simulated flights, exports and figures; ``repeat``
    0 has the seeds of ``settings``, each other one another seed, also of its search.
    """
    stages = [*STAGES, *(FILES if files else ())]
    mine = replace(
        repeated(settings, repeat),
        mission=replace(settings.mission, start_time=iso(time)),
        pipelines=replace(settings.pipelines, stages=stages),
    )
    if not quick:
        return mine
    quicker = quick_settings(mine)
    return replace(quicker, selection=replace(mine.selection, runs=min(mine.selection.runs, QUICK_RUNS)))


def repeated(settings: Settings, repeat: int) -> Settings:
    """``settings`` with the seeds of the plan number ``repeat`` of a start."""
    if repeat == 0:
        return settings
    child = named_child(stage_seeds(settings.seed, STREAM), f"seed {repeat}")
    return settings.with_seed(int(child.generate_state(1)[0]))


def departure_part(context: DepartureContext, time: float, repeat: int) -> Columns:
    """The front of one start with one seed, its flights and its plan; or why there is no plan."""
    settings = start_settings(
        context.settings, time, quick=context.settings[DepartureConfig].quick, repeat=repeat
    )
    folder = context.folder if repeat == 0 else None
    try:
        run = world_at(settings, context.world, UnpricedRun if folder is None else Run)
        plan_start(run)
    except (InfeasibleError, DataError) as error:
        return {"planned": False, "reason": str(error)}
    if folder is not None:
        _make_rest(run, folder / folder_name(time))
    plan, problem = run.plan.path, run.problem
    paths = within_capacity(settings.selection, run.front, problem).paths
    seeds = stage_seeds(context.settings.seed, STREAM)
    flown = which_fail(problem, paths, settings[DepartureConfig].flights, seeds)
    numbers = run.metrics
    return {
        "planned": True,
        "law": problem.fidelity.law,
        "plan": next(k for k, path in enumerate(paths) if np.array_equal(path.x, plan.x)),
        "paths": [path_columns(path, failed) for path, failed in zip(paths, flown, strict=True)],
        "metrics": {name: numbers[name] for name in METRICS if name in numbers},
        "conditions": route_conditions(problem, plan),
    }


def path_columns(path: PlannedPath, failed: BoolArray) -> Columns:
    """A path of a front, and which of its flights fail."""
    return {
        "length_m": path.objectives.length,
        "duration_s": float(path.t[-1]),
        "steps": len(path.u),
        "order": path.order,
        "origin": path.origin,
        "failed": flags_to_text(failed),
        "x": path.x,
    }


def world_at(settings: Settings, world: Run, kind: type[Run] = UnpricedRun) -> Run:
    """A run of one start, with the readings and, if its map is the map of ``world``, cells and automaton.

    A map can depend on the time, for example by windows in UTC; then each start has another map.
    """
    run = kind(settings, {"readings": world.readings})
    if same_map(run.scene, world.scene):
        run.records |= world.make("cells", "automaton")
    return run


def same_map(one: Scene, other: Scene) -> bool:
    """Whether two maps differ only in the time of departure."""
    first, second = (plain_data(replace(scene, time_zero=None).document()) for scene in (one, other))
    return bool(first == second)


def plan_start(run: Run) -> None:
    """Make the plan of ``run``.

    If no tree reaches acceptance before the wind ends, no other settings are tried: to find out which one
    would help takes as long as ten plans.
    """
    forest = run.forest
    if not len(forest.accepted) and any(tree.reach["beyond"] for tree in forest.trees):
        problem = run.problem
        hours = problem.horizon * problem.motion.dt / 3600.0
        raise InfeasibleError(
            f"no flight is short enough: the wind is known for {hours:.1f} h from there"
            f"{f' ({problem.wind_ends})' if problem.wind_ends else ''}, and no tree completes the mission in "
            "that time"
        )
    run.make("plan")


def plan_in_full(
    settings: Settings, world: Run, time: float, place: Path, extra: Sequence[tables.ExtraPath]
) -> Run:
    """The recommended start as a separate run, with exports and figures; ``extra`` paths are judged too."""
    mine = start_settings(settings, time, quick=False, files=True)
    if extra:
        file = str(place.absolute() / tables.EXTRA_FILE)
        mine = replace(mine, selection=replace(mine.selection, extra_paths=file))
    return _make_rest(world_at(mine, world), place, extra)


def _make_rest(run: Run, place: Path, extra: Sequence[tables.ExtraPath] = ()) -> Run:
    """Make what is left of ``run`` in the results directory ``place``, and return the run of all stages."""
    mine = Run(run.settings, dict(run.records), place, ProgressBar(False), dict(run.seconds))
    checked = Pipeline.of(run.settings)
    with checked.claimed(place):
        if extra:
            tables.write_extra_paths(place / tables.EXTRA_FILE, extra)
        checked.complete(mine)
    return mine


def route_conditions(problem: Any, path: PlannedPath) -> dict[str, float]:
    """Means along the route of wind speed, its standard deviation and the tail wind [m/s].

    ``end_sd_m`` is the standard deviation of the position at the end [m].
    """
    wind, variance = expected_winds(problem, path)
    leg = np.diff(path.x, axis=0)
    ahead = leg / np.maximum(np.linalg.norm(leg, axis=1), 1e-9)[:, None]
    return {
        "wind_speed": float(np.linalg.norm(wind, axis=1).mean()),
        "wind_sd": float(np.sqrt(variance.mean())),
        "tail_wind": float((wind * ahead).sum(axis=1).mean()),
        "end_sd_m": float(np.sqrt(np.trace(path.cov[-1]) / 2.0)),
    }


# --- all starts ------------------------------------------------------------------------------


def _planned_starts(context: DepartureContext, times: Sequence[float], progress: Progress) -> Found:
    """Each start planned once; with ``arrive_by``, the latest that arrive in time and later ones."""
    cfg = context.settings[DepartureConfig]

    def once(some: Sequence[float], shown: Progress = None) -> Found:
        results = _worked(context, [(time, 0) for time in some], shown)
        return {time: [result] for time, result in zip(some, results, strict=True)}

    if cfg.arrive_by is None:
        return once(times, progress)
    limit = seconds(cfg.arrive_by)
    found = once(times[:1])
    paths = found[times[0]][0].get("paths", [])
    fastest = TOO_FAST * min((path["duration_s"] for path in paths), default=0.0)
    left = [time for time in times[1:] if time + fastest <= limit]
    enough = cfg.most - int(tables.on_time(times[0], found[times[0]], limit))
    while left and enough > 0:
        batch, left = left[-BATCH:], left[:-BATCH]
        new = once(batch)
        enough -= sum(tables.on_time(time, results, limit) for time, results in new.items())
        found |= new
        if progress is not None:
            progress(len(found), len(found) + len(left))
    return dict(sorted(found.items()))


def _worked(
    context: DepartureContext, pieces: Sequence[tuple[float, int]], progress: Progress
) -> list[Columns]:
    """Results of pairs (departure, number of the seed)."""
    settings, cfg = context.settings, context.settings[DepartureConfig]
    parts = []
    for time, repeat in pieces:
        mine = start_settings(settings, time, quick=cfg.quick, repeat=repeat)
        key = part_key(mine, STREAM, settings.seed, cfg.flights, cfg.keep)
        parts.append(Part(f"start-{folder_name(time)}-{repeat}", (time, repeat), key))
    shared = half_the_cores(settings[EvaluationConfig])
    return work_parts(shared, context.directory, departure_part, context, parts, progress)


def _require_one(settings: Settings, found: Found) -> None:
    """Raise InfeasibleError if no start has a plan, or none arrives in time."""
    planned = {time: results for time, results in found.items() if results[0]["planned"]}
    if not planned:
        time, results = next(iter(found.items()))
        raise InfeasibleError(
            f"none of the {len(found)} starts has a plan; departure at {iso(time)}: {results[0]['reason']}"
        )
    if (limit := settings[DepartureConfig].arrive_by) is None:
        return
    if not any(tables.on_time(time, results, seconds(limit)) for time, results in planned.items()):
        arrival, time = min(
            (time + tables.planned_path(own)["duration_s"], time) for time, own in planned.items()
        )
        raise InfeasibleError(
            f"no start arrives by departure.arrive_by = {limit}: the earliest arrival found is "
            f"{iso(arrival)}, leaving at {iso(time)}; choose a later one, or an earlier departure.first"
        )


def _fetch_folders(context: DepartureContext, found: Found) -> None:
    """Copy the directories of starts that an earlier run has planned (``evaluation.resume``)."""
    resume = context.settings[EvaluationConfig].resume
    if context.folder is None or resume is None:
        return
    for name in (folder_name(time) for time, results in found.items() if results[0]["planned"]):
        known, place = Path(resume).expanduser() / STARTS / name, context.folder / name
        if not place.exists() and known.is_dir():
            shutil.copytree(known, place)
