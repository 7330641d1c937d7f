"""Random missions flown through full wind fields: common functions of ``hindcast`` and ``forecast_test``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import AUTOMATON, DECOMPOSITION, PROBLEM, SCENE, WIND, Records
from pareto_ltl.settings import FieldMissionsConfig, MissionConfig, Settings, WindConfig, preset
from pareto_ltl.studies import true_fields as nature
from pareto_ltl.studies.planning import fly_seeded, study_run
from pareto_ltl.studies.random_missions import Mission
from pareto_ltl.studies.statistics import Columns
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl.wind import sources
from pareto_ltl.wind.readings import Readings

RIM = 4.0  # [deg] around the area of the missions in which readings are kept, for scenes at its edge
HALF_HOUR = 1800.0  # time step of robot.dt=auto here [s]
UNIMPORTANT = ("truth", "missions", "bins")  # settings that do not change a single mission


def full_fields(cfg: FieldMissionsConfig, folder: Path) -> tuple[Path, ...]:
    """The data files of the folder."""
    files = tuple(sorted(f for f in folder.iterdir() if f.is_file() and sources.is_data_file(f)))
    if not files:
        raise DataError(f"{cfg.section}.truth={cfg.truth or folder}: the folder holds no GRIB2 file")
    return files


def rim_outline(cfg: FieldMissionsConfig) -> list[list[float]]:
    """Corners of the area with a rim of ``RIM`` degrees."""
    import shapely

    rim = shapely.Polygon(cfg.area).buffer(RIM)
    return [list(map(float, corner)) for corner in rim.exterior.coords[:-1]]


def mission_inputs(cfg: FieldMissionsConfig, settings: Settings) -> Columns:
    """Settings of a study on which a mission depends."""
    kept = {key: value for key, value in asdict(cfg).items() if key not in UNIMPORTANT}
    return kept | {"laws": settings.evaluation.laws, "border": settings.border}


def mission_row(task: Mission) -> Columns:
    """The columns that describe a mission, for the tables."""
    return {
        "formula": task.formula,
        "departure": task.scene.time_zero,
        "latitude": task.latitude,
        "longitude": task.longitude,
        "side": float(np.ptp(task.scene.bounds[:, 0])),
        "obstacles": len(task.scene.obstacles),
    }


def mission_settings(
    settings: Settings, cfg: FieldMissionsConfig, task: Mission, fidelity: str, wind: WindConfig
) -> Settings:
    """The settings for planning the mission ``task``; flights end when the wind ends."""
    dt = HALF_HOUR if isinstance(settings.robot.dt, str) else settings.robot.dt  # one step for all maps
    steps = int(cfg.hours * 3600 // dt)
    return replace(
        settings,
        fidelity=preset(fidelity),
        seed=settings.seed + task.number,
        mission=MissionConfig(formula=task.formula, start_time=task.scene.time_zero),
        wind=wind,
        robot=replace(settings.robot, dt=dt),
        planner=replace(settings.planner, max_steps=min(settings.planner.max_steps, steps), threads=1),
        deployment=replace(settings.deployment, laws=list(settings.evaluation.laws)),
    )


def reality(cfg: FieldMissionsConfig, run: Run, readings: Readings) -> Problem:
    """The problem of ``run`` with the real wind."""
    real = nature.real_wind(cfg, run.settings.wind, readings, run.make(SCENE), run.make(WIND))
    models = preset("paper")  # without modes: the field is known, and gusts are independent at each step
    settings = replace(run.settings, fidelity=models)
    world = Records({SCENE: run.make(SCENE)})  # the map and the automaton do not depend on the fidelity
    world[DECOMPOSITION] = run.make(DECOMPOSITION)
    world[AUTOMATON] = run.make(AUTOMATON)
    return study_run(settings, world.replaced(WIND, real)).make(PROBLEM)


def realised(
    cfg: FieldMissionsConfig, settings: Settings, real: Problem, path: PlannedPath, seed: int
) -> Columns:
    """The outcomes of the flights of a plan in the real wind."""
    runs = settings.deployment.runs if cfg.gusts > 0 else 1
    flights = fly_seeded(real, path.u, runs, "independent", seed, path.x)
    return {
        "failure": float(flights.failed.mean()),
        "missed": float((~flights.accepted).mean()),
        "collided": float(flights.collided.mean()),
        "off_map": float(flights.off_map.mean()),
        "miss_m": float(np.linalg.norm(flights.x[:, -1].mean(axis=0) - path.x[-1])),
        "sd_m": float(np.sqrt(np.trace(path.cov[-1]) / 2)),
    }


def simulated_failure(model: Problem, path: PlannedPath, runs: int, law: str, seed: int) -> float:
    """Share of flights that fail in winds drawn from the model of the planner."""
    flights = fly_seeded(model, path.u, runs, law, seed, path.x)
    return float(flights.failed.mean())


# --- missions without a plan -----------------------------------------------------------------


def refuse_no_plans(cfg: FieldMissionsConfig, results: Sequence[Mapping[str, Any]]) -> None:
    """Raise an InfeasibleError if no mission has a plan."""
    if not any(result["plans"] for result in results):
        raise InfeasibleError(
            f"none of {len(results)} random missions has a plan ({reason_of(results[0])}); raise "
            f"planner.n_max or robot.u_max, or lower {cfg.section}.side"
        )


def unplanned_rows(results: Sequence[Mapping[str, Any]]) -> list[Columns]:
    """Missions without a plan, and why."""
    return [{"mission": k, "reason": reason_of(r)} for k, r in enumerate(results) if not r["plans"]]


def reason_of(result: Mapping[str, Any]) -> str:
    """Why a mission has no plan."""
    return next((str(value) for name, value in result.items() if name.startswith("reason_")), "no plan")
