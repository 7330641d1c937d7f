"""Planned from a few readings, flown through the real thing: the one test in which nature draws the wind.

From full fields (GFS, one degree) a small table of readings is thinned, as a user would have. Random missions
are planned from it; the controls are then flown through the full fields, which no fit saw at most of their
points. Gusts of the fitted size are added to them, for what is smaller than their grid. Every promise of a
plan, its bounds and its own simulations, is held against the share of flights that failed: a reliability
diagram.
"""

from __future__ import annotations

import math
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
from pareto_ltl.run.records import AUTOMATON, DECOMPOSITION, FRONT, PROBLEM, SCENE, WIND, Records
from pareto_ltl.settings import PRESETS, IngestConfig, MissionConfig, Settings, WindConfig, preset
from pareto_ltl.studies import true_fields as nature
from pareto_ltl.studies.parts import Part, PartsProgress, part_key, work_parts
from pareto_ltl.studies.planning import fly_seeded, study_run
from pareto_ltl.studies.random_missions import Mission, mission
from pareto_ltl.studies.statistics import Columns, mean_chance_columns
from pareto_ltl.studies.tables import markdown_table, number_or_nan, rate_cell
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import probability_text
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl.support.files import write_text
from pareto_ltl.support.fingerprints import file_fingerprint
from pareto_ltl.wind import sources
from pareto_ltl.wind.ingest import common_nodes, winds_at
from pareto_ltl.wind.readings import Readings, iso
from pareto_ltl.wind.records import WindField
from pareto_ltl.wind.sources.grib_apart import read_grib_apart

RIM = 4.0  # readings are kept so far outside ``hindcast.area``, for scenes at its edge [deg]
NORMAL_90 = 1.6448536269514722  # a standard normal stays within with probability 0.9
HALF_HOUR = 1800.0  # time step of robot.dt=auto here [s]


@dataclass(frozen=True, slots=True)
class HindcastContext:
    settings: Settings
    readings: Readings
    tables: Mapping[str, Path]
    spells: tuple[nature.Spell, ...]


def run_hindcast(settings: Settings, directory: Path, progress: PartsProgress | None = None) -> Study:
    """Plan and fly ``hindcast.missions`` missions."""
    cfg = settings.hindcast
    files = full_fields(cfg.truth, nature.true_fields_folder(cfg))
    readings = read_grib_apart(files, settings.wind.max_speed)
    spells = tuple(nature.spells(readings, cfg))
    tables = {spell.name: thinned(settings, readings, spell, directory) for spell in spells}
    context = HindcastContext(settings, readings, tables, spells)
    base = part_key(
        settings, "hindcast", _hindcast_inputs(settings), [file_fingerprint(file) for file in files]
    )
    todo = [Part(f"mission-{k}", (k,), part_key(settings, base, k)) for k in range(cfg.missions)]
    results = work_parts(settings.evaluation, directory, hindcast_part, context, todo, progress)
    return _collect_hindcast(settings, results)


def full_fields(asked: str | None, folder: Path) -> tuple[Path, ...]:
    """The data files of the folder."""
    files = tuple(sorted(f for f in folder.iterdir() if f.is_file() and sources.is_data_file(f)))
    if not files:
        raise DataError(f"hindcast.truth={asked or folder}: the folder holds no GRIB2 file")
    return files


def _hindcast_inputs(settings: Settings) -> Columns:
    """Settings of this study on which a mission depends."""
    kept = asdict(settings.hindcast)
    for name in ("truth", "missions", "bins"):
        kept.pop(name)
    return kept | {"laws": settings.evaluation.laws}


def thinned(settings: Settings, readings: Readings, spell: nature.Spell, directory: Path) -> Path:
    """The table of readings that planning sees of one spell, as ``pipelines=ingest`` would thin it."""
    import shapely

    cfg = settings.hindcast
    rim = shapely.Polygon(cfg.area).buffer(RIM)
    outline = [list(map(float, corner)) for corner in rim.exterior.coords[:-1]]
    out = directory / f"readings_{spell.name}.csv"
    kept = np.arange(spell.first, spell.last + 1)
    nodes = common_nodes(readings, kept, IngestConfig(points=cfg.points, area=outline))
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
    """A mission, the plans made for it in each fidelity, and what became of them."""
    task = mission(context.settings.hindcast, context.settings.seed, k, context.spells)
    row: Columns = {
        "formula": task.formula,
        "departure": task.scene.time_zero,
        "latitude": task.latitude,
        "longitude": task.longitude,
        "side": float(np.ptp(task.scene.bounds[:, 0])),
        "obstacles": len(task.scene.obstacles),
    }
    plans: list[Columns] = []
    for fidelity in PRESETS:
        run = mission_run(context, task, fidelity)
        try:
            front = run.make(FRONT)
        except (InfeasibleError, DataError) as error:
            row |= {f"reason_{fidelity}": str(error)}
            continue
        real = reality(context, run)
        row |= calibration(context, run)
        models = believed(context, task)
        plans += [
            _flown(context, task, fidelity, path, real, models)
            for path in picked(front, context.settings.hindcast.plans)
        ]
    return row | {"plans": plans}


def mission_run(context: HindcastContext, task: Mission, fidelity: str) -> Run:
    """The planner, which knows the thinned readings and no more."""
    settings, cfg = context.settings, context.settings.hindcast
    dt = HALF_HOUR if isinstance(settings.robot.dt, str) else settings.robot.dt  # one step for all maps
    steps = int(cfg.hours * 3600 // dt)
    mine = replace(
        settings,
        fidelity=preset(fidelity),
        seed=settings.seed + task.number,
        mission=MissionConfig(formula=task.formula, start_time=task.scene.time_zero),
        wind=seen(settings.wind, context.tables[task.spell.name]),
        robot=replace(settings.robot, dt=dt),
        planner=replace(settings.planner, max_steps=min(settings.planner.max_steps, steps), threads=1),
        deployment=replace(settings.deployment, laws=list(settings.evaluation.laws)),
    )
    return study_run(mine, Records({SCENE: task.scene}))


def seen(wind: WindConfig, table: Path) -> WindConfig:
    return replace(wind, source="csv", path=str(table), hold_last=False)


def believed(context: HindcastContext, task: Mission) -> Problem:
    """The model that plans are simulated in: everything that is modelled, all laws."""
    return mission_run(context, task, "full").make(PROBLEM)


def reality(context: HindcastContext, run: Run) -> Problem:
    """The same map in the wind that there was."""
    cfg, scene = context.settings.hindcast, run.make(SCENE)
    real = nature.real_wind(cfg, run.settings.wind, context.readings, scene, run.make(WIND))
    settings = replace(run.settings, fidelity=preset("paper"))
    return study_run(settings, _world(run).replaced(WIND, real)).make(PROBLEM)


def _world(run: Run) -> Records:
    """Map and automaton of ``run``, which do not depend on the fidelity."""
    world = Records({SCENE: run.make(SCENE)})
    world[DECOMPOSITION] = run.make(DECOMPOSITION)
    world[AUTOMATON] = run.make(AUTOMATON)
    return world


def calibration(context: HindcastContext, run: Run) -> Columns:
    """How the fit predicts the full fields inside the map: sd of z = (truth - mean)/sd, share within 90 %."""
    scene, wind = run.make(SCENE), run.make(WIND)
    z = scores(context.readings, scene, wind)
    return {"z_sd": float(np.sqrt((z**2).mean())), "coverage_90": float((np.abs(z) <= NORMAL_90).mean())}


def scores(readings: Readings, scene: Any, wind: WindField) -> FloatArray:
    nodes = np.stack(np.meshgrid(*map(np.arange, wind.mean.shape[1:3]), indexing="ij"), axis=-1).reshape(
        -1, 2
    )
    points = wind.origin + wind.spacing * nodes
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
    context: HindcastContext, task: Mission, fidelity: str, path: PlannedPath, real: Problem, models: Problem
) -> Columns:
    settings, seed = context.settings, context.settings.seed + task.number
    runs = settings.deployment.runs
    flights = fly_seeded(
        real, path.u, runs if settings.hindcast.gusts > 0 else 1, "independent", seed, path.x
    )
    promised = {}
    for law in settings.evaluation.laws:
        model = fly_seeded(models, path.u, runs, law, seed, path.x)
        promised[f"simulated_{law}"] = float((~model.accepted | model.collided).mean())
        said = forecast(models, path.u, law)
        promised[f"bound_{law}"] = min(1.0, said.mission_risk + said.collision_risk)
    return {
        "fidelity": fidelity,
        "origin": path.origin,
        "objectives": asdict(path.objectives),
        "steps": len(path.u),
        "promised": promised,
        "failure": float((~flights.accepted | flights.collided).mean()),
        "missed": float((~flights.accepted).mean()),
        "collided": float(flights.collided.mean()),
        "miss_m": float(np.linalg.norm(flights.x[:, -1].mean(axis=0) - path.x[-1])),
        "sd_m": float(np.sqrt(np.trace(path.cov[-1]) / 2)),
    }


# --- all missions ----------------------------------------------------------------------------


def plan_rows(results: Sequence[Mapping[str, Any]]) -> list[Columns]:
    """One row a plan: its mission, its promises, what was realised."""
    rows = []
    for k, result in enumerate(results):
        for plan in result["plans"]:
            costs = {name: number_or_nan(value) for name, value in plan["objectives"].items()}
            row = {"mission": k} | {
                name: result[name] for name in ("formula", "departure", "latitude", "longitude")
            }
            row |= {"fidelity": plan["fidelity"], "length_m": costs["length"], "steps": plan["steps"]}
            row |= {"bound_paper": min(1.0, costs["mission_risk_paper"] + costs["collision_risk"])}
            row |= dict(sorted(plan["promised"].items()))
            rows.append(
                row | {name: plan[name] for name in ("failure", "missed", "collided", "miss_m", "sd_m")}
            )
    return rows


def promises(row: Columns) -> list[str]:
    """Columns that promise a probability of failure."""
    return [name for name in row if name.startswith(("bound_", "simulated_"))]


def reliability(rows: Sequence[Columns], bins: int) -> list[Columns]:
    """For every fidelity and promise, plans in ``bins`` groups of equal size, by what was promised.

    Flights of one mission share one wind, and its plans one map: a mission is one trial. Its plans in a group
    are averaged, and the interval is that of as many trials as there are missions.
    """
    table = []
    for fidelity in dict.fromkeys(row["fidelity"] for row in rows):
        mine = [row for row in rows if row["fidelity"] == fidelity]
        for name in promises(mine[0]):
            known = sorted((row for row in mine if math.isfinite(row[name])), key=lambda row: row[name])
            groups = np.array_split(np.arange(len(known)), max(1, min(bins, len(known))))
            table += [_group(fidelity, name, [known[k] for k in group]) for group in groups if len(group)]
    return table


def _group(fidelity: str, name: str, rows: Sequence[Columns]) -> Columns:
    chances: dict[int, list[float]] = {}
    for row in rows:
        chances.setdefault(row["mission"], []).append(row["failure"])
    total = math.fsum(float(np.mean(values)) for values in chances.values())
    promised = [row[name] for row in rows]
    group: Columns = {"fidelity": fidelity, "promise": name, "plans": len(rows), "missions": len(chances)}
    group |= {
        "promised": float(np.mean(promised)),
        "promised_least": promised[0],
        "promised_most": promised[-1],
    }
    return group | mean_chance_columns("realised", total, len(chances))


def scorecard(rows: Sequence[Columns]) -> list[Columns]:
    """All plans of each fidelity: mean promise, mean realised, Brier score."""
    table = []
    for fidelity in dict.fromkeys(row["fidelity"] for row in rows):
        mine = [row for row in rows if row["fidelity"] == fidelity]
        for name in promises(mine[0]):
            known = [row for row in mine if math.isfinite(row[name])]
            if not known:
                continue
            entry = _group(fidelity, name, sorted(known, key=lambda row: float(row[name])))
            p, f = (np.array([row[key] for row in known]) for key in (name, "failure"))
            entry |= {"brier": float((f * (1 - p) ** 2 + (1 - f) * p**2).mean())}
            table.append(entry | {"above_promise": float((f > p).mean())})
    return table


def _collect_hindcast(settings: Settings, results: Sequence[Mapping[str, Any]]) -> Study:
    rows = plan_rows(results)
    planned = sum(bool(result["plans"]) for result in results)
    if not rows:
        raise InfeasibleError(
            f"none of {len(results)} random missions has a plan ({_reason(results[0])}); raise planner.n_max "
            "or robot.u_max, or lower hindcast.side"
        )
    fits = [result for result in results if "z_sd" in result]
    cards = scorecard(rows)
    numbers = {
        "missions": float(len(results)),
        "missions_planned": float(planned),
        "plans": float(len(rows)),
        "z_sd": float(np.sqrt(np.mean([fit["z_sd"] ** 2 for fit in fits]))),
        "coverage_90": float(np.mean([fit["coverage_90"] for fit in fits])),
    }
    for card in cards:
        name = f"{card['fidelity']}_{card['promise']}"
        numbers |= {f"{name}_promised": card["promised"], f"{name}_brier": card["brier"]}
        numbers |= {
            f"{card['fidelity']}_realised{end}": card[f"realised{end}"] for end in ("", "_low", "_high")
        }
    unplanned = [{"mission": k, "reason": _reason(r)} for k, r in enumerate(results) if not r["plans"]]
    tables = {
        "hindcast": rows,
        "reliability": reliability(rows, settings.hindcast.bins),
        "scorecard": cards,
        "no_plan": unplanned,
    }
    return Study(
        {name: tuple(table) for name, table in tables.items()},
        numbers,
        _hindcast_text(settings, cards, numbers),
    )


def _reason(result: Mapping[str, Any]) -> str:
    return next((str(value) for name, value in result.items() if name.startswith("reason_")), "no plan")


def _hindcast_text(settings: Settings, cards: Sequence[Columns], numbers: Mapping[str, float]) -> str:
    table = markdown_table(
        f"{numbers['plans']:.0f} plans for {numbers['missions_planned']:.0f} of {numbers['missions']:.0f} "
        "random missions, flown through the full fields; a mission is one trial for the 95 % interval",
        (
            "planner",
            "promise",
            "promised, mean",
            "failed in the full fields",
            "plans above their promise",
            "Brier score",
        ),
        (
            (
                card["fidelity"],
                promise_text(card["fidelity"], card["promise"]),
                probability_text(card["promised"]),
                rate_cell(card, "realised"),
                probability_text(card["above_promise"]),
                f"{card['brier']:.4f}",
            )
            for card in cards
        ),
    )
    return table + (
        f"\nThe fit against the full fields inside the maps: z-score sd {numbers['z_sd']:.2f}, "
        f"90 % intervals hold {probability_text(numbers['coverage_90'])}; "
        f"gusts x {settings.hindcast.gusts:g}.\n"
    )


def promise_text(fidelity: str, promise: str) -> str:
    """What a column of promises holds, with its wind law: ``V + R, coherent winds``."""
    kind, _, law = promise.partition("_")
    if promise == "bound_paper":
        planned = preset(fidelity).law
        same = planned == "independent"
        return "f_o + R, independent winds" if same else f"f_o, independent winds, + R, {planned} winds"
    return f"{'V + R' if kind == 'bound' else kind}, {law} winds"
