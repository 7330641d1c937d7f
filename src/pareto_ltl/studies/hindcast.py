"""Plans made from a few readings, flown through the full fields of the same times: a test of interpolation.

Full fields (GFS, one degree) are thinned to a small table of readings, as a user may have. Random missions
are planned from it; the controls are then flown through the full fields, most nodes of which the fit did not
use. Gusts of the fitted size are added, for variations smaller than the grid. Every promise of a plan, its
bounds and its simulated rates, is compared with the share of flights that failed: a reliability diagram.

Planning knows readings of the whole flight, also those of times after departure. In ``forecast_test`` it does
not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.planning.evaluate import forecast
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Front, PlannedPath
from pareto_ltl.report.records import Study
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import FRONT, PLAN, PROBLEM, SCENE, WIND, Records
from pareto_ltl.settings import PRESETS, IngestConfig, Settings, WindConfig
from pareto_ltl.studies import calibration
from pareto_ltl.studies import field_missions as shared
from pareto_ltl.studies import true_fields as nature
from pareto_ltl.studies.parts import Part, PartsProgress, part_key, work_parts
from pareto_ltl.studies.planning import study_run
from pareto_ltl.studies.random_missions import Mission, mission
from pareto_ltl.studies.statistics import Columns
from pareto_ltl.studies.tables import number_or_nan
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import probability_text
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl.support.files import write_text
from pareto_ltl.support.fingerprints import file_fingerprint
from pareto_ltl.wind.ingest import common_nodes, winds_at
from pareto_ltl.wind.readings import Readings, iso
from pareto_ltl.wind.records import WindField
from pareto_ltl.wind.sources.grib_apart import read_grib_apart

NORMAL_90 = 1.6448536269514722  # P(|z| <= this) = 0.9 for a standard normal z


@dataclass(frozen=True, slots=True)
class HindcastContext:
    """Data for all parts of the study: settings, full fields, tables of thinned readings by spell, spells."""

    settings: Settings
    readings: Readings
    tables: Mapping[str, Path]
    spells: tuple[nature.Spell, ...]


def run_hindcast(settings: Settings, directory: Path, progress: PartsProgress | None = None) -> Study:
    """Plan and fly ``hindcast.missions`` missions."""
    cfg = settings.hindcast
    files = shared.full_fields(cfg, nature.true_fields_folder(cfg))
    readings = read_grib_apart(files, settings.wind.max_speed)
    spells = tuple(nature.spells(readings, cfg))
    tables = {spell.name: thinned(settings, readings, spell, directory) for spell in spells}
    context = HindcastContext(settings, readings, tables, spells)
    inputs = shared.mission_inputs(cfg, settings)
    base = part_key(settings, "hindcast", inputs, [file_fingerprint(file) for file in files])
    todo = [Part(f"mission-{k}", (k,), part_key(settings, base, k)) for k in range(cfg.missions)]
    results = work_parts(settings.evaluation, directory, hindcast_part, context, todo, progress)
    return _collect_hindcast(settings, results)


def thinned(settings: Settings, readings: Readings, spell: nature.Spell, directory: Path) -> Path:
    """The file of thinned readings of one spell for planning, as ``pipelines=ingest`` writes it."""
    cfg = settings.hindcast
    out = directory / f"readings_{spell.name}.csv"
    kept = np.arange(spell.first, spell.last + 1)
    nodes = common_nodes(readings, kept, IngestConfig(points=cfg.points, area=shared.rim_outline(cfg)))
    lines = ["time,lat,lon,u,v"]
    for k in kept:
        winds = winds_at(readings, int(k), nodes)
        lines += [
            f"{iso(readings.times[k])},{lat:g},{lon:g},{u:.2f},{v:.2f}"
            for (lon, lat), (u, v) in zip(nodes.tolist(), winds.tolist(), strict=True)
        ]
    write_text(out, "\n".join(lines) + "\n")
    return out


# --- one mission -----------------------------------------------------------------------------


def hindcast_part(context: HindcastContext, k: int) -> Columns:
    """A mission, the plans made for it with each fidelity, and the outcomes of their flights."""
    settings = context.settings
    task = mission(settings.hindcast, settings.seed, k, context.spells, settings.border)
    row = shared.mission_row(task)
    plans: list[Columns] = []
    for fidelity in PRESETS:
        run = mission_run(context, task, fidelity)
        try:
            front, chosen = run.make(FRONT), run.make(PLAN)
        except (InfeasibleError, DataError) as error:
            row |= {f"reason_{fidelity}": str(error)}
            continue
        real = shared.reality(context.settings.hindcast, run, context.readings)
        row |= calibration_columns(context, run)
        models = believed(context, task)
        paths = [(calibration.FRONT, path) for path in picked(front, context.settings.hindcast.plans)]
        plans += [
            {"fidelity": fidelity, "kind": kind} | _flown(context, task, path, real, models)
            for kind, path in [*paths, (calibration.CHOSEN, chosen.path)]
        ]
    return row | {"plans": plans}


def mission_run(context: HindcastContext, task: Mission, fidelity: str) -> Run:
    """The run of the planner, with only the thinned readings."""
    settings = context.settings
    wind = seen(settings.wind, context.tables[task.spell.name])
    mine = shared.mission_settings(settings, settings.hindcast, task, fidelity, wind)
    return study_run(mine, Records({SCENE: task.scene}))


def seen(wind: WindConfig, table: Path) -> WindConfig:
    """Settings of a wind that is read from ``table``, without holding the last field."""
    return replace(wind, source="csv", path=str(table), hold_last=False)


def believed(context: HindcastContext, task: Mission) -> Problem:
    """The problem in which plans are simulated: ``fidelity=full``, all wind laws."""
    return mission_run(context, task, "full").make(PROBLEM)


def calibration_columns(context: HindcastContext, run: Run) -> Columns:
    """Calibration of the fit inside the map: sd of z = (truth - mean)/sd, and share of |z| within 90 %."""
    scene, wind = run.make(SCENE), run.make(WIND)
    z = scores(context.readings, scene, wind)
    return {"z_sd": float(np.sqrt((z**2).mean())), "coverage_90": float((np.abs(z) <= NORMAL_90).mean())}


def scores(readings: Readings, scene: Any, wind: WindField) -> FloatArray:
    """z = (truth - mean) / sd of the full fields at the nodes inside the map, (K, nodes, 2)."""
    points = wind.lattice.nodes()
    inside = np.all((points >= scene.bounds[0]) & (points <= scene.bounds[1]), axis=1)
    truth = nature.at_times(readings, scene, wind.times, points[inside])
    flat = (len(wind.times), -1, 2)
    sd = np.sqrt(wind.latent_var.reshape(flat)[:, inside] + wind.gust_var[:, None])
    return np.asarray((truth - wind.mean.reshape(flat)[:, inside]) / sd, float)


def picked(front: Front, count: int) -> list[PlannedPath]:
    """Paths spread evenly along the front, from the safest to the shortest."""
    rows = np.unique(np.linspace(0, len(front.paths) - 1, min(count, len(front.paths))).astype(int))
    return [front.paths[k] for k in rows]


def _flown(
    context: HindcastContext, task: Mission, path: PlannedPath, real: Problem, models: Problem
) -> Columns:
    settings, seed = context.settings, context.settings.seed + task.number
    promised = {}
    for law in settings.evaluation.laws:
        runs = settings.deployment.runs
        promised[f"simulated_{law}"] = shared.simulated_failure(models, path, runs, law, seed)
        said = forecast(models, path.u, law)
        promised[f"bound_{law}"] = min(1.0, said.mission_risk + said.collision_risk)
    return {
        "origin": path.origin,
        "objectives": asdict(path.objectives),
        "steps": len(path.u),
        "promised": promised,
    } | shared.realised(settings.hindcast, settings, real, path, seed)


# --- all missions ----------------------------------------------------------------------------


def plan_rows(results: Sequence[Mapping[str, Any]]) -> list[Columns]:
    """One row for each plan: its mission, its promises, the realised rates."""
    rows = []
    for k, result in enumerate(results):
        for plan in result["plans"]:
            costs = {name: number_or_nan(value) for name, value in plan["objectives"].items()}
            row = {"mission": k} | {
                name: result[name] for name in ("formula", "departure", "latitude", "longitude")
            }
            row |= {name: plan[name] for name in ("fidelity", "kind", "steps")}
            row |= {"length_m": costs["length"]}
            row |= {"bound_paper": min(1.0, costs["mission_risk_paper"] + costs["collision_risk"])}
            row |= dict(sorted(plan["promised"].items()))
            rows.append(
                row
                | {
                    name: plan[name]
                    for name in ("failure", "missed", "collided", "off_map", "miss_m", "sd_m")
                }
            )
    return rows


def _collect_hindcast(settings: Settings, results: Sequence[Mapping[str, Any]]) -> Study:
    shared.refuse_no_plans(settings.hindcast, results)
    rows = plan_rows(results)
    fits = [result for result in results if "z_sd" in result]
    cards = calibration.scorecard(rows)
    numbers = {
        "missions": float(len(results)),
        "missions_planned": float(sum(bool(result["plans"]) for result in results)),
        "plans": float(len(rows)),
        "z_sd": float(np.sqrt(np.mean([fit["z_sd"] ** 2 for fit in fits]))),
        "coverage_90": float(np.mean([fit["coverage_90"] for fit in fits])),
    }
    for card in cards:
        planner = card["fidelity"] + ("_chosen" if card["kind"] == calibration.CHOSEN else "")
        name = f"{planner}_{card['promise']}"
        numbers |= {f"{name}_promised": card["promised"], f"{name}_brier": card["brier"]}
        numbers |= {f"{planner}_realised{end}": card[f"realised{end}"] for end in ("", "_low", "_high")}
    tables = {
        "hindcast": rows,
        "reliability": calibration.reliability(rows, settings.hindcast.bins),
        "scorecard": cards,
        "no_plan": shared.unplanned_rows(results),
    }
    return Study(
        {name: tuple(table) for name, table in tables.items()},
        numbers,
        _hindcast_text(settings, cards, numbers),
    )


def _hindcast_text(settings: Settings, cards: Sequence[Columns], numbers: Mapping[str, float]) -> str:
    title = (
        f"A test of interpolation: {numbers['plans']:.0f} plans for {numbers['missions_planned']:.0f} of "
        f"{numbers['missions']:.0f} random missions, flown through the full fields; a mission is one trial "
        "for the 95 % interval"
    )
    return calibration.score_table(title, cards) + (
        "\nPlanning knew thinned readings of the whole flight, also of times after departure: this tests "
        "interpolation in space, not forecasts (pipelines=forecast_test tests those). 'front' are plans "
        "spread along each front, 'chosen' is the plan that selection picks.\n"
        f"\nThe fit against the full fields inside the maps: z-score sd {numbers['z_sd']:.2f}, "
        f"90 % intervals hold {probability_text(numbers['coverage_90'])}; "
        f"gusts x {settings.hindcast.gusts:g}.\n"
    )
