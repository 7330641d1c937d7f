"""Plans made from forecasts available at departure, flown through the later fields: a test of the promise.

At a departure, planning knows the cycles that began at least ``forecast_test.delay`` before it: their
analyses and, as far as they reach, their forecasts. After the last of these the last field is held, with the
error of a held field. The plan that selection picks is flown through the later analyses (and short
forecasts between them) with gusts of the fitted size. The promise of the plan, the share of failed flights
simulated under its own law, is compared with the share that failed: a mission is one trial.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.report.records import Study
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import PLAN, PROBLEM, READINGS, SCENE, Records
from pareto_ltl.settings import IngestConfig, Settings, WindConfig, preset
from pareto_ltl.studies import calibration
from pareto_ltl.studies import field_missions as shared
from pareto_ltl.studies import true_fields as nature
from pareto_ltl.studies.parts import Part, PartsProgress, part_key, work_parts
from pareto_ltl.studies.planning import study_run
from pareto_ltl.studies.random_missions import Mission, mission
from pareto_ltl.studies.statistics import Columns
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import probability_text
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl.support.fingerprints import file_fingerprint
from pareto_ltl.wind.area import GeoBox, box_of
from pareto_ltl.wind.ingest import common_nodes, winds_at
from pareto_ltl.wind.observations import FIT_RADIUS
from pareto_ltl.wind.readings import HOUR, Readings, seconds
from pareto_ltl.wind.snapshots import Snapshot, known_at, latest_readings
from pareto_ltl.wind.sources.grib_apart import read_grib_snapshots

REGIONS = {"west of 105 W": -105.0, "105 to 90 W": -90.0, "east of 90 W": 180.0}  # eastern ends [deg]
REGION_KEYS = ("fidelity", "region")
ENOUGH = 20  # least number of missions of a bin that counts in the numbers


@dataclass(frozen=True, slots=True)
class ForecastTestContext:
    """Data for all missions.

    Attributes
    ----------
    snapshots : tuple of Snapshot
        All cycles; planning gets those known at departure.
    truth : Readings
        The newest wind of each time.
    nodes : mapping of the name of a spell to (n, 2) float
        Longitude and latitude of the readings for planning [deg]; empty for every node.
    """

    settings: Settings
    snapshots: tuple[Snapshot, ...]
    truth: Readings
    spells: tuple[nature.Spell, ...]
    nodes: Mapping[str, FloatArray]


def run_forecast_test(settings: Settings, directory: Path, progress: PartsProgress | None = None) -> Study:
    """Plan ``forecast_test.missions`` missions from forecasts and fly them through the later fields."""
    cfg = settings.forecast_test
    files = shared.full_fields(cfg, nature.true_fields_folder(cfg))
    area = needed_area(settings)
    snapshots = read_grib_snapshots(files, settings.wind.max_speed, settings.wind.level, area)
    context = shared_context(settings, snapshots, files)
    inputs = shared.mission_inputs(cfg, settings)
    base = part_key(settings, "forecast_test", inputs, [file_fingerprint(file) for file in files])
    todo = [Part(f"mission-{k}", (k,), part_key(settings, base, k)) for k in range(cfg.missions)]
    results = work_parts(settings.evaluation, directory, forecast_part, context, todo, progress)
    return collect_forecast_test(settings, results)


def needed_area(settings: Settings) -> GeoBox:
    """The part of the fields that missions can need: for the lattice of a scene at the edge, and readings."""
    cfg = settings.forecast_test
    margin = cfg.side[1] / 2 + settings.wind.padding + FIT_RADIUS
    return box_of(np.array(shared.rim_outline(cfg))).widened(margin)


def shared_context(
    settings: Settings, snapshots: tuple[Snapshot, ...], files: tuple[Path, ...]
) -> ForecastTestContext:
    """The context of all missions, from the winds of all cycles."""
    cfg = settings.forecast_test
    truth = latest_readings(snapshots, files)
    spells = tuple(nature.spells(truth, cfg))
    nodes = {}
    if cfg.points is not None:
        ingest = IngestConfig(points=cfg.points, area=shared.rim_outline(cfg))
        for spell in spells:
            nodes[spell.name] = common_nodes(truth, np.arange(spell.first, spell.last + 1), ingest)
    return ForecastTestContext(settings, snapshots, truth, spells, nodes)


# --- one mission -----------------------------------------------------------------------------


def known_readings(context: ForecastTestContext, task: Mission) -> Readings:
    """The readings known at departure: in its spell, the newest wind of each time, thinned."""
    cfg = context.settings.forecast_test
    departure = seconds(str(task.scene.time_zero))
    known = known_at(context.snapshots, departure, HOUR * cfg.delay)
    readings = latest_readings([snap for snap in known if snap.time >= task.spell.start], context.truth.files)
    if cfg.points is None:
        return readings
    nodes = context.nodes[task.spell.name]
    count = len(readings.times)
    thinned = tuple(winds_at(readings, k, nodes) for k in range(count))
    return replace(readings, points=(nodes,) * count, winds=thinned)


def held_wind(
    wind: WindConfig, folder: Path, readings: Readings, departure: float, hours: float
) -> WindConfig:
    """Settings under which the last known field is held to the end of the mission."""
    longest = max(wind.max_gap, (departure - float(readings.times[-1])) / HOUR + hours)
    return replace(wind, source="grib", path=str(folder), hold_last=True, max_gap=longest)


def mission_run(context: ForecastTestContext, task: Mission, fidelity: str) -> Run:
    """The run of the planner, with only the readings known at departure."""
    settings, cfg = context.settings, context.settings.forecast_test
    readings = known_readings(context, task)
    folder = readings.files[0].parent
    wind = held_wind(settings.wind, folder, readings, seconds(str(task.scene.time_zero)), cfg.hours)
    mine = shared.mission_settings(settings, cfg, task, fidelity, wind)
    scene = replace(task.scene, border=mine.border)  # that of the fidelity, where scene.border is auto
    return study_run(mine, Records({SCENE: scene, READINGS: readings}))


def forecast_part(context: ForecastTestContext, k: int) -> Columns:
    """A mission, the plan chosen for it with each fidelity, and the outcomes of its flights."""
    settings, cfg = context.settings, context.settings.forecast_test
    task = mission(cfg, settings.seed, k, context.spells, settings.border)
    row, plans = shared.mission_row(task), []
    for fidelity in cfg.fidelities:
        run = mission_run(context, task, fidelity)
        try:
            path = run.make(PLAN).path
        except (InfeasibleError, DataError) as error:
            row |= {f"reason_{fidelity}": str(error)}
            continue
        seed, law = settings.seed + k, run.settings.fidelity.law
        promised = shared.simulated_failure(run.make(PROBLEM), path, settings.deployment.runs, law, seed)
        bound = min(1.0, path.objectives.mission_risk + path.objectives.collision_risk)
        real = shared.reality(cfg, run, context.truth)
        plans.append(
            {
                "fidelity": fidelity,
                "origin": path.origin,
                "objectives": asdict(path.objectives),
                "steps": len(path.u),
                "known_hours": _hours_known(run, task),
                "promised": {f"simulated_{law}": promised, f"bound_{law}": bound},
            }
            | shared.realised(cfg, settings, real, path, seed)
        )
    return row | {"plans": plans}


def _hours_known(run: Run, task: Mission) -> float:
    """Time of the last field that planning knew [h after departure]; negative if before departure."""
    return float(run.make(READINGS).times[-1] - seconds(str(task.scene.time_zero))) / HOUR


# --- all missions ----------------------------------------------------------------------------


def region_of(longitude: float) -> str:
    """The region of the contiguous United States that a mission belongs to."""
    return next(name for name, end in REGIONS.items() if longitude < end)


def chosen_rows(settings: Settings, results: Sequence[Mapping[str, Any]]) -> list[Columns]:
    """One row for each plan: its mission, its promise, what was realised."""
    points = settings.forecast_test.points
    unknown = dict.fromkeys(sorted({n for r in results for p in r["plans"] for n in p["promised"]}), math.nan)
    rows = []
    for k, result in enumerate(results):
        for plan in result["plans"]:
            row: Columns = {"mission": k, "readings": "every node" if points is None else points}
            row |= {name: result[name] for name in ("formula", "departure", "latitude", "longitude")}
            row |= {"region": region_of(result["longitude"]), "kind": calibration.CHOSEN}
            row |= {name: plan[name] for name in ("fidelity", "known_hours", "steps")}
            row |= {"length_m": plan["objectives"]["length"]} | unknown | plan["promised"]
            names = ("failure", "missed", "collided", "off_map", "miss_m", "sd_m")
            rows.append(row | {name: plan[name] for name in names})
    return rows


def collect_forecast_test(settings: Settings, results: Sequence[Mapping[str, Any]]) -> Study:
    """Tables, numbers and text of the missions' results."""
    cfg = settings.forecast_test
    shared.refuse_no_plans(cfg, results)
    rows = chosen_rows(settings, results)
    cards = calibration.scorecard(rows)
    groups = calibration.reliability(rows, cfg.bins)
    regions = calibration.scorecard(sorted(rows, key=_region_order), REGION_KEYS)
    numbers = {
        "missions": float(len(results)),
        "missions_planned": float(sum(bool(result["plans"]) for result in results)),
    }
    for card in _own(cards):
        name = card["fidelity"]
        numbers |= {f"{name}_{key}": card[key] for key in ("promised", "promised_sd", "brier", "log_score")}
        numbers |= {f"{name}_realised{end}": card[f"realised{end}"] for end in ("", "_low", "_high")}
        bins = [g for g in _own(groups) if g["fidelity"] == name and g["missions"] >= ENOUGH]
        numbers |= {
            f"{name}_bins": float(len(bins)),
            f"{name}_bins_kept": float(sum(g["kept"] for g in bins)),
        }
    tables = {
        "forecast_test": rows,
        "reliability": groups,
        "regions": regions,
        "scorecard": cards,
        "no_plan": shared.unplanned_rows(results),
    }
    text = _forecast_text(settings, numbers, cards, groups, regions)
    return Study({name: tuple(table) for name, table in tables.items()}, numbers, text)


def _region_order(row: Columns) -> int:
    return list(REGIONS).index(row["region"])


def _own(entries: Sequence[Columns]) -> list[Columns]:
    """The entries about what a plan promises: its simulated failure under its own law."""
    return [e for e in entries if e["promise"] == f"simulated_{preset(e['fidelity']).law}"]


def _forecast_text(
    settings: Settings,
    numbers: Mapping[str, float],
    cards: Sequence[Columns],
    groups: Sequence[Columns],
    regions: Sequence[Columns],
) -> str:
    cfg = settings.forecast_test
    seen = "every node" if cfg.points is None else f"{cfg.points} readings a time"
    title = (
        f"A forecast test: the chosen plans of {numbers['missions_planned']:.0f} of "
        f"{numbers['missions']:.0f} random missions, planned from {seen} of cycles at least {cfg.delay:g} h "
        "old and flown through the later fields; a mission is one trial for the 95 % interval"
    )
    parts = [
        calibration.score_table(title, cards, ("fidelity",)),
        calibration.bin_table("By promise; kept: promised at least the lower end", _own(groups)),
        calibration.score_table("By region", _own(regions), REGION_KEYS),
        what_is_tested(settings, numbers),
    ]
    return "\n".join(parts)


def what_is_tested(settings: Settings, numbers: Mapping[str, float]) -> str:
    """What the test covers and what it does not, in one paragraph."""
    cfg = settings.forecast_test
    bins = [
        f"{numbers[f'{name}_bins_kept']:.0f} of {numbers[f'{name}_bins']:.0f} bins of at least {ENOUGH} "
        f"missions keep their promise, simulated in {preset(name).law} winds (fidelity={name})"
        for name in cfg.fidelities
        if f"{name}_bins" in numbers
    ]
    planned = probability_text(numbers["missions_planned"] / numbers["missions"])
    return (
        f"{'; '.join(bins)}. Tested: the promise of a plan under its own law, wind.forecast_error="
        f"{settings.wind.forecast_error}, in the winds that came within {cfg.hours:g} h of departure; "
        f"{planned} of the missions have a plan. Covered: errors of forecasts and of the last known field, "
        f"of interpolation in space and time, level {settings.wind.level}. Not covered: what the fields "
        f"themselves have wrong, winds smaller than their grid beyond {cfg.gusts:g} times the fitted white "
        "part, other seasons; missions of one period share its weather, which the intervals ignore.\n"
    )
