"""Four planners on the benchmark: ``python -m published.entries OUT`` in ``benchmarks``.

``calm`` plans in calm air, ``mean`` in the mean of the last known winds over the map, ``buffer`` in the same
with obstacles grown and regions shrunk by ``BUFFER``; none of them knows an error of the wind. ``ours`` is
pareto_ltl with the known winds and the law of their errors. OUT/PLANNER has the tables that
``published.score`` reads; ``ours`` has promises too.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pareto_ltl import Run, Scene, Settings
from pareto_ltl.run.plan_run import UnpricedRun
from pareto_ltl.settings.building import build_settings
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl.wind.sources import read_readings
from pareto_ltl.world import projection
from published.dataset import FOLDER, Mission, missions

BUFFER = 10_000.0  # [m]
QUICK: Mapping[str, Any] = {
    "planner": "quick",
    "refine": {"flights": 400, "sweep_flights": 100, "classes": 2, "points": 6},
    "selection": {"draws": 2000, "runs": 4000},
}


class Entry(NamedTuple):
    """Controls (T, 2) [m/s] of steps of ``dt`` [s] along the path (T+1, 2) [m] of a plan, and its promise."""

    crs: str
    dt: float
    u: FloatArray
    x: FloatArray
    promised: float


def settings_of(mission: Mission, folder: Path, wind: Mapping[str, Any]) -> Settings:
    """The settings for a mission."""
    return build_settings(
        {
            **QUICK,
            "mission": {"formula": mission.formula, "start_time": mission.departure},
            "scene": {"file": str(folder / mission.map), "border": "open"},
            "robot": {"dt": mission.dt, "u_min": mission.u_min, "u_max": mission.u_max},
            "wind": dict(wind),
            "planner": {"trees": 4, "n_max": 1000, "max_steps": mission.most_steps, "threads": 1},
        }
    )


def known(mission: Mission, folder: Path) -> dict[str, Any]:
    """The settings of the known winds, the last of which is held."""
    return {
        "source": "csv", "path": str(folder / mission.known), "hold_last": True, "max_gap": 24.0,
        "max_points": 120,
    }  # fmt: skip


def entry(run: Run) -> Entry:
    """The plan of a run."""
    path, promise = run.plan.path, run.plan.promise
    promised = 0.0 if promise is None else float(promise.rate.failure)
    return Entry(str(run.scene.crs), float(run.settings.robot.dt), path.u, path.x, promised)


def ours(mission: Mission, folder: Path) -> Entry:
    """The plan of pareto_ltl."""
    return entry(UnpricedRun(settings_of(mission, folder, known(mission, folder))))


def calm(mission: Mission, folder: Path) -> Entry:
    """A plan in calm air."""
    return entry(UnpricedRun(settings_of(mission, folder, {"source": "calm"})))


def mean(mission: Mission, folder: Path, buffer: float = 0.0) -> Entry:
    """A plan in the mean of the last known winds over the map; ``buffer`` [m] around all edges."""
    settings = settings_of(mission, folder, {**known(mission, folder), "forecast_error": "none"})
    readings, scene = read_readings(settings.wind), Run(settings).scene
    lon, lat = readings.points[-1].T
    x = projection.to_plane(str(scene.crs), lon, lat)
    inside = ((x >= scene.bounds[0]) & (x <= scene.bounds[1])).all(axis=1)
    near = np.argsort(np.hypot(*(x - scene.bounds.mean(axis=0)).T))[:4]
    wind = readings.winds[-1][inside if inside.sum() >= len(near) else near].mean(axis=0)
    same = replace(readings, winds=tuple(np.tile(wind, (len(each), 1)) for each in readings.winds))
    world = {"readings": same, "scene": buffered(scene, buffer)}
    return entry(UnpricedRun(settings, world))


def buffered(scene: Scene, buffer: float) -> Scene:
    """The scene with obstacles grown and regions shrunk by ``buffer`` [m]."""
    import shapely

    def moved(corners: FloatArray, by: float) -> FloatArray:
        shape = shapely.Polygon(corners).buffer(by, join_style="mitre", mitre_limit=2.0)
        ring = shapely.get_coordinates(shapely.convex_hull(shape))[:-1]
        return np.asarray(ring if shapely.LinearRing(ring).is_ccw else ring[::-1], float)

    if buffer == 0.0:
        return scene
    regions = {name: tuple(moved(part, -buffer) for part in parts) for name, parts in scene.regions.items()}
    return replace(scene, regions=regions, obstacles=tuple(moved(each, buffer) for each in scene.obstacles))


PLANNERS: dict[str, Callable[[Mission, Path], Entry]] = {
    "calm": calm,
    "mean": mean,
    "buffer": lambda mission, folder: mean(mission, folder, BUFFER),
    "ours": ours,
}


def write_table(path: Path, plan: Entry) -> None:
    """True headings halfway along each step, and airspeeds."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["duration_s", "heading_true_deg", "airspeed_m_s"])
        lon, lat = projection.to_geographic(plan.crs, (plan.x[:-1] + plan.x[1:]) / 2)
        turned = projection.rotate_vectors(plan.u, -projection.meridian_convergence(plan.crs, lon, lat))
        for east, north in turned:
            heading = np.rad2deg(np.arctan2(east, north)) % 360.0
            table.writerow([f"{plan.dt:g}", f"{heading:.3f}", f"{np.hypot(east, north):.3f}"])


def main(argv: list[str] | None = None) -> int:
    """Write the plans of all planners."""
    parser = argparse.ArgumentParser(prog="python -m published.entries", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--data", type=Path, default=FOLDER, help=argparse.SUPPRESS)
    asked = parser.parse_args(argv)
    for name, planner in PLANNERS.items():
        (asked.out / name).mkdir(parents=True, exist_ok=True)
        promises = {}
        for mission in missions(asked.data):
            try:
                plan = planner(mission, asked.data)
            except (InfeasibleError, DataError) as error:
                print(f"{name} {mission.name}: {error}", file=sys.stderr)
                continue
            write_table(asked.out / name / f"{mission.name}.csv", plan)
            promises[mission.name] = round(plan.promised, 6)
        if name == "ours":
            text = json.dumps(promises, indent=1) + "\n"
            (asked.out / name / "promises.json").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
