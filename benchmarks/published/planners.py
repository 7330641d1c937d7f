"""The planners whose plans are published: this one, and three that do not know how uncertain the wind is.

calm    the shortest plan in calm air
mean    the shortest plan in the expected wind of this planner, as if it were certain
buffer  the same, with obstacles grown and regions shrunk by ``BUFFER``
ours    this planner: the plan of its choice, which promises a rate of failure
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl import Run, Scene, WindField
from pareto_ltl.extend import Frame
from pareto_ltl.run.plan_run import UnpricedRun
from pareto_ltl.settings import Settings
from pareto_ltl.simulation.flights import simulate_flights
from pareto_ltl.support.arrays import FloatArray, rotate_vectors
from published.dataset import Mission
from published.plans import COLUMNS

PLANNERS = ("ours", "buffer", "mean", "calm")
BUFFER = 10e3  # [m], of regions at most a third of their radius
FLIGHTS = 20_000  # of a promise
SETTINGS: dict[str, Any] = {
    "pipelines": "plan", "planner": "quick",
    "refine": {"points": 6, "classes": 2, "flights": 400, "sweep_flights": 100},
    "selection": {"draws": 2000, "runs": 4000},
}  # fmt: skip


@dataclass(frozen=True)
class Planned:
    """A plan: true headings [deg] and airspeeds [m/s] of its steps (T, 2), and its promise, if it has one."""

    orders: FloatArray
    dt: float
    promise: float | None

    def write(self, folder: Path, name: str) -> float | None:
        """Write the table of legs; return the promise."""
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(COLUMNS)
            table.writerows([f"{self.dt:g}", f"{a % 360.0:.3f}", f"{v:.3f}"] for a, v in self.orders.tolist())
        return self.promise


def plan(mission: Mission, planner: str, data: Path) -> Planned:
    """The plan of one of ``PLANNERS`` for a mission in the folder ``data``."""
    wind: Any = {
        "source": "csv", "path": str(data / mission.known), "level": "10m", "hold_last": True,
        "max_gap": 24.0, "max_points": 150, "forecast_error": "gfs",
    }  # fmt: skip
    if planner == "calm":
        return orders_of(run_of(mission, data, "calm"), promises=False)
    run = run_of(mission, data, wind)
    if planner == "ours":
        return orders_of(run, promises=True)
    given: dict[str, Any] = {"wind": certain(run.wind)}
    if planner == "buffer":
        given["scene"] = buffered(run.scene)
    return orders_of(run_of(mission, data, wind, given), promises=False)


def run_of(mission: Mission, data: Path, wind: Any, given: Mapping[str, Any] | None = None) -> Run:
    """The planner on the map of a mission."""
    settings = Settings.of(
        SETTINGS
        | {
            "scene": {"file": str(data / mission.map), "border": "open"},
            "mission": {"formula": mission.formula, "start_time": mission.departure},
            "robot": {
                "dt": mission.dt, "u_min": mission.u_min, "u_max": mission.u_max, "airspeed_sd": None,
                "heading_sd": None, "clock_sd": None,
            },
            "wind": wind,
        }
    )  # fmt: skip
    planner = replace(settings.planner, max_steps=mission.most_steps, threads=1)
    return UnpricedRun(replace(settings, planner=planner), dict(given or {}))


def certain(field: WindField) -> WindField:
    """The expected wind without uncertainty."""
    return replace(
        field, latent_var=np.zeros_like(field.latent_var), gust_var=np.zeros_like(field.gust_var), modes=None,
        error=None, evidence=None,
    )  # fmt: skip


def buffered(scene: Scene) -> Scene:
    """Obstacles grown and regions shrunk by ``BUFFER``, of regions at most a third of their size."""
    import shapely

    def corners(shape: Any) -> FloatArray:
        return np.array(shapely.geometry.polygon.orient(shape).exterior.coords[:-1])

    def shrunk(one: FloatArray) -> FloatArray:
        shape = shapely.Polygon(one)
        return corners(shape.buffer(-min(BUFFER, np.sqrt(shape.area / np.pi) / 3.0), join_style="mitre"))

    def grown(one: FloatArray) -> FloatArray:
        return corners(shapely.Polygon(one).buffer(BUFFER, join_style="mitre").convex_hull)

    regions = {name: tuple(map(shrunk, parts)) for name, parts in scene.regions.items()}
    return replace(scene, obstacles=tuple(map(grown, scene.obstacles)), regions=regions)


def orders_of(run: Run, *, promises: bool) -> Planned:
    """The legs of the plan of ``run``; true north halfway along each."""
    path, crs = run.plan.path, str(run.scene.crs)
    lon, lat = Frame(crs).to_geographic(0.5 * (path.x[1:] + path.x[:-1]))
    angle = Frame(crs).convergence(lon, lat)
    u = rotate_vectors(path.u, -angle)
    orders = np.column_stack([np.degrees(np.arctan2(u[:, 0], u[:, 1])), np.hypot(*u.T)])
    return Planned(orders, float(run.settings.robot.dt), promise_of(run) if promises else None)


def promise_of(run: Run) -> float:
    """The rate of failure of flights in the winds of the plan."""
    path = run.plan.path
    flown = simulate_flights(run.problem, path.u, FLIGHTS, "coherent", SeedSequence(1), path.x)
    return float(flown.failed.mean())
