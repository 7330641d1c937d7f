"""What the API shows of a finished plan: its front, one point of it in degrees, and the wind."""

from __future__ import annotations

import csv
import io
import math
import threading
from collections.abc import Callable
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from careful_io.messages import shown_value
from careful_io.reading import read_json, read_text
from flight_quantities.medium import medium_of
from pareto_ltl import Scene, WindField, choose, export, load_results
from pareto_ltl.extend import Deployment, Front, cost_named
from pareto_ltl.support.errors import DataError, InfeasibleError, NotFoundError
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.wind_levels import wind_levels
from pareto_ltl_apps.exports.kinds import format_names
from pareto_ltl_apps.flight.rest_of_flight import issued
from pareto_ltl_apps.view.limits import PlanLimits, chosen_number
from pareto_ltl_apps.view.page.content import shown_tree
from pareto_ltl_apps.view.page.ground import map_places, rounded, shown_wind
from pareto_ltl_apps.view.page.points import flown_path, shown_flights, shown_path, shown_points
from pareto_ltl_apps.view.records import ShownRun
from pareto_ltl_apps.view.showing import shown_results
from pareto_ltl_apps.view.trade import Trade

KEPT_RUNS = 3  # results in memory
FLIGHTS = 60  # that are shown of a point
LONGEST = 7 * 86400.0  # [s] for which the wind is shown
DEGREES = 6
Shown = TypeVar("Shown")
_ONE_AT_A_TIME = threading.RLock()  # records are read on first access


def one_at_a_time(make: Callable[..., Shown]) -> Callable[..., Shown]:
    """``make``, which no two threads run at once."""

    def locked(*given: Any) -> Shown:
        with _ONE_AT_A_TIME:
            return make(*given)

    return locked


@one_at_a_time
def front_view(directory: Path) -> dict[str, Any]:
    """The points of the front as ``front.csv`` has them, the number of the plan, and the wind law.

    A plan that was made after an alarm has no points: ``planned`` is its path, ``alarms`` are the reasons.
    """
    run = _shown(directory)
    front, alarmed = run.front, run.plan is not None and run.plan.alarmed
    return {
        "planned": map_places(run.scene, run.plan.path.x) if alarmed and run.plan is not None else [],
        "alarms": read_json(directory / "replan.json")["alarms"] if alarmed else [],
        "points": [] if front is None else _rows(front),
        "trades": [] if front is None else Trade.of(run.scene, front, run.plan).paragraphs(),
        "chosen": chosen_number(front, run.plan),
        "promise": None
        if run.plan is None or run.plan.promise is None
        else asdict(run.plan.promise.rate)
        | {
            "floor": run.plan.promise.floor,
            "branched": None if run.plan.branching is None else asdict(run.plan.branching.rate),
        },
        "law": "" if front is None else front.models.law,
        "formula": "" if run.automaton is None else run.automaton.formula,
    }


def _rows(front: Front) -> list[dict[str, Any]]:
    """The points with their numbers, and further costs under the names that ``front.csv`` has."""
    costs = [path.objectives.further_costs.items() for path in front.paths]
    further = [{cost_named(name).column: value for name, value in items} for items in costs]
    rows = zip(shown_points(front), further, strict=True)
    return [{"point": k, **row, **more} for k, (row, more) in enumerate(rows)]


@one_at_a_time
def point_view(directory: Path, number: int) -> dict[str, Any]:
    """Path, log, 95 % ellipses, flights and risk over time of a point; what limits it if it is the plan.

    Raises
    ------
    NotFoundError
        If the front has no such point.
    DataError
        If the map has no place on Earth.
    """
    run = _shown(directory)
    if run.front is None or run.problem is None or not 0 <= number < len(run.front.paths):
        raise NotFoundError(f"{directory.name}: the front has no point {number}")
    if run.scene.crs is None:
        raise DataError(f"{directory.name}: the map has no place on Earth; open report.html of its directory")
    path, chosen = run.front.paths[number], chosen_number(run.front, run.plan)
    given = run.deployments.get(run.problem.fidelity.law) if number == chosen else None
    flown = given or flown_path(run, run.problem, path)
    return {
        "point": number,
        "chosen": number == chosen,
        **shown_path(run, run.problem, path, flown),
        "tree": _tree(run, number, chosen),
        "limits": PlanLimits(run.scene, run.plan, run.medium).tables()
        if run.plan is not None and number == chosen
        else None,
        "causes": list(Deployment.CAUSES),
        "flights": shown_flights(run.scene, run.problem, flown, FLIGHTS),
    }


def _tree(run: ShownRun, number: int, chosen: int | None) -> dict[str, Any] | None:
    """The branches of the plan, if point ``number`` is the plan or was bent to it; else None."""
    plan = run.plan
    if plan is None or plan.branching is None:
        return None
    own = plan.branching.point if chosen is None else chosen
    return shown_tree(run.scene, plan) if number == own else None


@one_at_a_time
def limits_view(directory: Path, number: int) -> dict[str, Any]:
    """Prices and tight segments of a point of the front, as they would be if it were the plan."""
    run = choose(load_results(directory), point=number)
    medium = medium_of(run.settings.robot.level, run.wind.level)
    return PlanLimits(run.scene, run.plan, medium).tables()


@one_at_a_time
def wind_view(directory: Path) -> dict[str, Any]:
    """The wind at some times on a lattice: places, expected vectors and their deviation [m/s].

    ``issued`` is the start of its latest forecast (UTC), null if it is not known.
    """
    results = load_results(directory)
    wind, scene = results.wind, results.scene
    if scene.crs is None:
        raise DataError(f"{directory.name}: the map has no place on Earth")
    start = issued(wind)
    dated = scene.frame.utc(np.array([start])) if math.isfinite(start) else None
    return _map_wind(scene, wind) | {"issued": dated and dated[0]}


def _map_wind(scene: Scene, wind: WindField) -> dict[str, Any]:
    return shown_wind(scene, wind, float(min(wind.known_until, LONGEST)))


def levels_view(folder: DeskFolder, directory: Path) -> dict[str, Any]:
    """The wind at the other levels of the files of a plan (:func:`.wind_levels.wind_levels`)."""
    return _levels_at(folder, directory, (directory / "run.json").stat().st_mtime_ns)


@lru_cache(maxsize=KEPT_RUNS)
def _levels_at(folder: DeskFolder, directory: Path, _written: int) -> dict[str, Any]:
    with _ONE_AT_A_TIME:
        results = load_results(directory)
        scene, wind = results.scene, results.wind
        shown = _map_wind(scene, wind)
    return wind_levels(folder, results.settings.wind, scene, wind, shown)  # reads files, and holds up nobody


@one_at_a_time
def beacons_view(directory: Path) -> dict[str, Any]:
    """The places of ``beacons.csv`` [deg], the failure with a beacon at each, and the summary."""
    folder, scene = directory / "beacons", load_results(directory).scene
    if not (folder / "beacons.txt").is_file():
        raise NotFoundError(f"there is no search for a beacon in {directory.name}: start one with POST")
    rows = list(csv.DictReader(io.StringIO(read_text(folder / "beacons.csv"))))
    places = np.array([[float(row["x_m"]), float(row["y_m"])] for row in rows])
    return {
        "at": None if scene.crs is None else rounded(scene.frame.lonlat(places), DEGREES - 1),
        "failure": [float(row["failure"]) for row in rows],
        "said": read_text(folder / "beacons.txt").splitlines(),
    }


def check_view(directory: Path) -> dict[str, Any]:
    """What ``pareto-ltl check`` wrote last: GO or not (None: no check), the newer forecast, and the lines."""
    folder = directory / "check"
    if not (folder / "check.txt").is_file():
        how = f"There is none yet: pareto-ltl check {directory} --wind FILE limits.failure=0.05"
        return {"go": None, "wind": None, "said": [how]}
    found = read_json(folder / "check.json")
    return {
        "go": bool(found["go"]),
        "wind": Path(str(found["wind"])).name,
        "said": read_text(folder / "check.txt").splitlines(),
    }


@one_at_a_time
def export_view(directory: Path, kind: str, number: int | None) -> tuple[str, bytes]:
    """Name and content of an export of the plan, or of the point ``number`` of its front."""
    if kind not in format_names():
        raise NotFoundError(f"there is no format {shown_value(kind)}; there are {', '.join(format_names())}")
    folder = directory / ("exports" if number is None else f"exports_point_{number}")
    written = export(load_results(directory), folder, [kind], point=number)
    if not written:
        raise InfeasibleError(f"{kind} cannot be written for this plan")
    return written[0].name, written[0].read_bytes()


@lru_cache(maxsize=KEPT_RUNS)
def _shown_at(directory: Path, _written: int) -> ShownRun:
    return shown_results(load_results(directory), unfinished=True)


def _shown(directory: Path) -> ShownRun:
    """The records of a result; read again when its run has ended, or was made again."""
    return _shown_at(directory, (directory / "run.json").stat().st_mtime_ns)
