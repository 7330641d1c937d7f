"""Random missions planned from a part of the winds and flown through full fields: a test of the promise.

With ``known=departure``, planning knows the cycles that began at least ``delay`` before departure: their
analyses and, as far as they reach, their forecasts. After the last of these the last field is held, with the
error of a held field. With ``known=all`` (``pipelines=hindcast``) it knows thinned readings of the whole
flight, also of times after departure, which tests interpolation only (``known_winds`` has both).

The plans are flown through the later analyses (and short forecasts between them) with gusts of the fitted
size. The promises of a plan, its bounds and its simulated rates, are compared with the share that failed: a
mission is one trial.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.fingerprints import file_fingerprint
from pareto_ltl import Run, Settings
from pareto_ltl.extend import FidelityConfig, Front, GeoBox, MissionConfig, PlannedPath, Snapshot, Study
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.wind.observations import FIT_RADIUS
from pareto_ltl_apps.formats.settings import IngestConfig
from pareto_ltl_apps.formats.snapshots import latest_readings
from pareto_ltl_apps.formats.wind_table import common_nodes
from pareto_ltl_apps.studies import calibration, random_missions, strata
from pareto_ltl_apps.studies.calibration import CHOSEN
from pareto_ltl_apps.studies.known_winds import KNOWN_WINDS, KnownWinds
from pareto_ltl_apps.studies.parts import Part, PartWork, Progress, part_key, work_parts
from pareto_ltl_apps.studies.planning import fly_seeded
from pareto_ltl_apps.studies.point_winds import PointWinds
from pareto_ltl_apps.studies.random_missions import Mission
from pareto_ltl_apps.studies.settings import EvaluationConfig, ForecastTestConfig, HindcastConfig
from pareto_ltl_apps.studies.tables import Columns
from pareto_ltl_apps.wind_errors.full_winds import full_winds

REGION_KEYS, SURFACE_KEYS = ("fidelity", "region"), ("fidelity", "surface")
LEAD_KEYS = ("fidelity", "season", "lead")
SEASONS = ("Dec to Feb", "Mar to May", "Jun to Aug", "Sep to Nov")
LEADS = (6.0, 12.0, 24.0, 48.0)  # ends of the groups by lead [h]
HELD = "held field"
ENOUGH = 20  # least number of missions of a bin that counts in the numbers
RIM = 4.0  # [deg] around the area of the missions in which readings are used, for scenes at its edge
WHOLE_EARTH = 300.0  # [deg] of longitude
HALF_HOUR = 1800.0  # time step of robot.dt=auto here [s]
UNIMPORTANT = ("truth", "missions", "bins")  # settings that do not change a single mission
PLACE = ("formula", "departure", "situation", "latitude", "longitude")  # of a mission, in the table of plans
KNOWN = ("known_hours", "cycle_hours")
OUTCOMES = ("failure", "missed", "collided", "off_map", "miss_m", "sd_m", "spread_m")
ENDS = ("", "_low", "_high")


def run_forecast_test(settings: Settings, _: Run, directory: Path, progress: Progress = None) -> Study:
    """Plan and fly the missions of ``settings.forecast_test``."""
    return fly_missions(settings, settings[ForecastTestConfig], directory, progress)


def run_hindcast(settings: Settings, _: Run, directory: Path, progress: Progress = None) -> Study:
    """Plan and fly the missions of ``settings.hindcast``: the same test with ``known=all``."""
    return fly_missions(settings, settings[HindcastConfig], directory, progress)


def fly_missions(settings: Settings, cfg: ForecastTestConfig, directory: Path, progress: Progress) -> Study:
    """Plan ``cfg.missions`` missions and fly them through the full fields."""
    known = known_of_files(settings, cfg, directory)
    known.prepare()
    return missions_study(
        known, work_missions(known, mission_part, settings[EvaluationConfig].laws, progress)
    )


def work_missions(known: KnownWinds, work: PartWork, more: Any, progress: Progress) -> list[dict[str, Any]]:
    """Results of ``work(known, k)`` for each mission k; they depend on ``more`` too."""
    settings, cfg = known.settings, known.cfg
    inputs = {key: value for key, value in asdict(cfg).items() if key not in UNIMPORTANT}
    files = [file_fingerprint(file) for file in known.truth.files]
    base = part_key(settings, cfg.section, inputs, settings.border, more, files)
    todo = [Part(f"mission-{k}", (k,), part_key(settings, base, k)) for k in range(cfg.missions)]
    return work_parts(settings[EvaluationConfig], known.folder, work, known, todo, progress)


def known_of_files(settings: Settings, cfg: ForecastTestConfig, directory: Path) -> KnownWinds:
    """The winds of all missions, from the full fields that ``cfg`` names."""
    full = full_winds(random_missions.full_fields(cfg), settings.wind, needed_area(settings, cfg))
    if full.places is None:
        return known_winds(settings, cfg, directory, full.winds, full.files)
    if cfg.known != "departure":
        raise ConfigError(
            f"{cfg.section}.truth={cfg.truth} is a table of forecasts at places, which tests forecasts only: "
            f"set {cfg.section}.known=departure, or name a folder of fields"
        )
    truth = full.truth()
    spells = tuple(random_missions.spells(truth, cfg))
    return PointWinds(settings, cfg, directory, full.winds, truth, spells, {}, full.places)


def needed_area(settings: Settings, cfg: ForecastTestConfig) -> GeoBox:
    """The part of the fields that missions can need: for the lattice of a scene at the edge, and readings."""
    if np.ptp(np.array(cfg.area)[:, 0]) >= WHOLE_EARTH:
        return GeoBox(-180.0, -90.0, 360.0, 90.0)
    margin = cfg.side[1] / 2 + settings.wind.padding + FIT_RADIUS
    return GeoBox.around(np.array(_rim_outline(cfg))).widened(margin)


def _rim_outline(cfg: ForecastTestConfig) -> list[list[float]]:
    """Corners of the area with a rim of ``RIM`` degrees."""
    import shapely

    rim = shapely.Polygon(cfg.area).buffer(RIM)
    return [list(map(float, corner)) for corner in rim.exterior.coords[:-1]]


def known_winds(
    settings: Settings, cfg: ForecastTestConfig, folder: Path, snapshots: tuple[Snapshot, ...],
    files: tuple[Path, ...],
) -> KnownWinds:  # fmt: skip
    """The winds of all missions, from the winds of all cycles."""
    truth = latest_readings(snapshots, files)
    spells = tuple(random_missions.spells(truth, cfg))
    nodes = {}
    if cfg.points is not None:
        ingest = IngestConfig(points=cfg.points, area=_rim_outline(cfg))
        for spell in spells:
            nodes[spell.name] = common_nodes(truth, np.arange(spell.first, spell.last + 1), ingest)
    return KNOWN_WINDS[cfg.known](settings, cfg, folder, snapshots, truth, spells, nodes)


# --- one mission -----------------------------------------------------------------------------


def mission_part(known: KnownWinds, k: int) -> Columns:
    """A mission, its plans with each fidelity, and the outcomes of their flights."""
    settings, cfg = known.settings, known.cfg
    task = known.task(k)
    row: Columns = {
        "formula": task.formula,
        "departure": task.scene.time_zero,
        "situation": task.situation,
        "latitude": task.latitude,
        "longitude": task.longitude,
        "side": float(np.ptp(task.scene.bounds[:, 0])),
        "obstacles": len(task.scene.obstacles),
    }
    plans: list[Columns] = []
    for fidelity in cfg.fidelities:
        run = known.run_of(task, mission_settings(settings, cfg, task, Settings.preset(fidelity)))
        try:
            chosen = run.plan.path
        except (InfeasibleError, DataError) as error:
            row |= {f"reason_{fidelity}": str(error)}
            continue
        row |= known.run_columns(run)
        paths = [(calibration.FRONT, path) for path in picked(run.front, cfg.plans)]
        flown = _flown_plans(known, run, [*paths, (CHOSEN, chosen)], settings.seed + k)
        plans += [{"fidelity": fidelity} | plan for plan in flown]
    return row | {"plans": plans}


def mission_settings(
    settings: Settings, cfg: ForecastTestConfig, task: Mission, fidelity: FidelityConfig
) -> Settings:
    """The settings for planning the mission ``task``; flights end when the wind ends."""
    dt = HALF_HOUR if isinstance(settings.robot.dt, str) else settings.robot.dt  # one step for all maps
    steps = int(cfg.hours * 3600 // dt)
    return replace(
        settings,
        fidelity=fidelity,
        seed=settings.seed + task.number,
        mission=MissionConfig(formula=task.formula, start_time=task.scene.time_zero),
        robot=replace(settings.robot, dt=dt),
        planner=replace(settings.planner, max_steps=min(settings.planner.max_steps, steps), threads=1),
        deployment=replace(settings.deployment, laws=list(settings[EvaluationConfig].laws)),
    )


def picked(front: Front, count: int) -> list[PlannedPath]:
    """Paths spread evenly along the front, from the safest to the shortest."""
    rows = np.unique(np.linspace(0, len(front.paths) - 1, min(count, len(front.paths))).astype(int))
    return [front.paths[k] for k in rows]


def _flown_plans(
    known: KnownWinds, run: Run, paths: Sequence[tuple[str, PlannedPath]], seed: int
) -> Iterator[Columns]:
    """Each path with its promises and the outcomes of its flights in the real wind."""
    runs, real = (known.settings.deployment.runs if known.cfg.gusts > 0 else 1), known.reality(run)
    promises = known.promised(run, [path for _, path in paths], seed)
    for (kind, path), promised in zip(paths, promises, strict=True):
        flights = fly_seeded(real, path.u, runs, known.law_of_reality, seed, path.x)
        yield {
            "kind": kind,
            "origin": path.origin,
            "objectives": path.objectives.as_dict(),
            "steps": len(path.u),
            "hours": len(path.u) * float(run.settings.robot.dt) / 3600.0,
            "promised": promised,
            "failure": float(flights.failed.mean()),
            "missed": float((~flights.accepted).mean()),
            "collided": float(flights.collided.mean()),
            "off_map": float(flights.off_map.mean()),
            "miss_m": float(np.linalg.norm(flights.x[:, -1].mean(axis=0) - path.x[-1])),
            "sd_m": float(np.sqrt(np.trace(path.cov[-1]) / 2)),
            "spread_m": float(np.sqrt(flights.x[:, -1].var(axis=0).mean())),
        }


# --- all missions ----------------------------------------------------------------------------


def season_of(departure: str) -> str:
    """The season of a departure, as its months: ``2018-10-09T12:00:00Z`` is in ``Sep to Nov``."""
    return SEASONS[int(departure[5:7]) % 12 // 3]


def lead_of(hours: float, known_hours: float, cycle_hours: float) -> str:
    """The lead of the forecast at the end of a flight of ``hours``, as a range; or that a field was held.

    ``known_hours`` and ``cycle_hours`` are the last field and the newest cycle [h after departure].
    """
    if known_hours < hours:
        return HELD
    lead = hours - cycle_hours
    if (place := int(np.searchsorted(LEADS, lead))) == len(LEADS):
        return f"above {LEADS[-1]:g} h"
    return f"{[0.0, *LEADS][place]:g} to {LEADS[place]:g} h"


def plan_rows(cfg: ForecastTestConfig, results: Sequence[Mapping[str, Any]]) -> list[Columns]:
    """One row for each plan: its mission, its promises, the realised failures."""
    unknown = dict.fromkeys(sorted({n for r in results for p in r["plans"] for n in p["promised"]}), math.nan)
    rows = []
    for k, result in enumerate(results):
        place = result["longitude"], result["latitude"]
        region, surface = strata.region_of(cfg, *place), strata.surface_of(*place, result.get("side", 0.0))
        for plan in result["plans"]:
            row: Columns = {"mission": k, "readings": "every node" if cfg.points is None else cfg.points}
            row |= {name: result.get(name, "") for name in PLACE} | {"region": region}
            row |= {"surface": surface}
            row |= {name: plan[name] for name in ("kind", "fidelity")}
            row |= {name: result[name] for name in KNOWN if name in result} | {"steps": plan["steps"]}
            if cfg.known == "departure":
                row |= {"season": season_of(result["departure"])}
                row |= {"lead": lead_of(plan["hours"], *(result[name] for name in KNOWN))}
            row |= {"length_m": plan["objectives"]["length"]} | unknown | plan["promised"]
            rows.append(row | {name: plan.get(name, 0.0) for name in OUTCOMES})
    return rows


def missions_study(known: KnownWinds, results: Sequence[Mapping[str, Any]]) -> Study:
    """Tables, numbers and text of the missions' results; InfeasibleError if no mission has a plan."""
    cfg, planned = known.cfg, [bool(result["plans"]) for result in results]
    if not any(planned):
        raise InfeasibleError(
            f"none of {len(results)} random missions has a plan ({_reason_of(results[0])}); raise "
            f"planner.n_max or robot.u_max, or lower {cfg.section}.side"
        )
    rows = plan_rows(cfg, results)
    chosen = sorted(filter(_is_chosen, rows), key=lambda row: strata.region_order(row["region"]))
    tables = {
        cfg.section: rows,
        "reliability": calibration.reliability(rows, cfg.bins),
        "regions": calibration.scorecard(chosen, REGION_KEYS),
        "scorecard": calibration.scorecard(rows),
    }
    if cfg.known == "departure":
        tables["leads"] = calibration.scorecard(chosen, LEAD_KEYS)
        tables["surfaces"] = calibration.scorecard(chosen, SURFACE_KEYS)
        tables["promise_levels"] = strata.level_table(list(filter(_of_own_law, rows)))
        tables["conformal_limits"] = strata.limit_table(chosen)
    reasons = {k: _reason_of(result) for k, result in enumerate(results) if not planned[k]}
    tables["no_plan"] = [{"mission": k, "reason": reason} for k, reason in reasons.items()]
    numbers = {"missions": float(len(results)), "missions_planned": float(sum(planned))}
    numbers |= {"plans": float(len(rows))}
    if fits := [result for result in results if "z_sd" in result]:  # planning knows all times
        numbers["z_sd"] = float(np.sqrt(np.mean([fit["z_sd"] ** 2 for fit in fits])))
        numbers["coverage_90"] = float(np.mean([fit["coverage_90"] for fit in fits]))
    numbers |= {name: float(value) for name, value in _score_numbers(cfg, tables).items()}
    return Study(tables, numbers, _test_text(known, tables, numbers))


def _score_numbers(cfg: ForecastTestConfig, tables: Mapping[str, Sequence[Columns]]) -> dict[str, float]:
    """The scores of each planner; scores of its promise carry only the planner's name.

    Where paths along the front are flown too (``plans``), ``_chosen`` names those that selection picks.
    """
    numbers: dict[str, float] = {}
    for card in tables["scorecard"]:
        name = card["fidelity"] + ("_chosen" if cfg.plans and _is_chosen(card) else "")
        promise = f"{name}_{card['promise']}"
        numbers |= {f"{promise}_promised": card["promised"], f"{promise}_brier": card["brier"]}
        numbers |= {f"{name}_realised{end}": card[f"realised{end}"] for end in ENDS}
        if _is_own(card):
            kept = [
                group["kept"]
                for group in filter(_is_own, tables["reliability"])
                if all(group[key] == card[key] for key in calibration.KEYS) and group["missions"] >= ENOUGH
            ]
            scores = ("promised", "promised_sd", "brier", "log_score")
            numbers |= {f"{name}_{key}": card[key] for key in scores}
            numbers |= {f"{name}_bins": len(kept), f"{name}_bins_kept": sum(kept)}
    return numbers


def _is_own(entry: Mapping[str, Any]) -> bool:
    """Whether the entry is about the promise of a plan: its simulated failure under the law of the plan."""
    return bool(entry["promise"] == f"simulated_{Settings.preset(entry['fidelity']).law}")


def _of_own_law(row: Mapping[str, Any]) -> bool:
    """Whether the row has the promise of its plan under the law it was planned in."""
    return math.isfinite(row.get(f"simulated_{Settings.preset(row['fidelity']).law}", math.nan))


def _is_chosen(entry: Mapping[str, Any]) -> bool:
    return bool(entry["kind"] == CHOSEN)


def _reason_of(result: Mapping[str, Any]) -> str:
    """Why a mission has no plan."""
    return next((str(value) for name, value in result.items() if name.startswith("reason_")), "no plan")


def _test_text(
    known: KnownWinds, tables: Mapping[str, Sequence[Columns]], numbers: Mapping[str, float]
) -> str:
    own = {
        name: [row for row in table if "promise" in row and _is_own(row)] for name, table in tables.items()
    }
    keys = calibration.KEYS if known.cfg.plans else ("fidelity",)
    bins = list(filter(_is_chosen, own["reliability"]))
    parts = [
        calibration.score_table(known.title(numbers), tables["scorecard"], keys),
        calibration.bin_table("By promise; kept: promised at least the lower end", bins),
        calibration.score_table("By region", own["regions"], REGION_KEYS),
    ]
    if leads := own.get("leads"):
        parts.append(
            calibration.score_table("By season, and lead at the end of the flight", leads, LEAD_KEYS)
        )
        parts.append(calibration.score_table("By land and sea", own["surfaces"], SURFACE_KEYS))
        parts += [strata.level_text(tables["promise_levels"]), strata.limit_text(tables["conformal_limits"])]
    parts += dict.fromkeys(filter(None, map(calibration.situations_text, own["scorecard"])))
    return "\n".join([*parts, f"{_verdict(known.cfg, numbers)} {known.explanation(numbers)}"])


def _verdict(cfg: ForecastTestConfig, numbers: Mapping[str, float]) -> str:
    """The number of bins that keep their promise."""
    chosen = "_chosen" if cfg.plans else ""
    bins = [
        f"{numbers[f'{name}{chosen}_bins_kept']:.0f} of {numbers[f'{name}{chosen}_bins']:.0f} bins of at "
        f"least {ENOUGH} missions keep their promise, simulated in {Settings.preset(name).law} winds "
        f"(fidelity={name})"
        for name in cfg.fidelities
        if f"{name}{chosen}_bins" in numbers
    ]
    return f"{'; '.join(bins)}."
