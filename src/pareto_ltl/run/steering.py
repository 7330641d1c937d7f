"""``pareto_ltl.steer``: the path between two points in the wind of a plan, by the convex programme."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run.exporting import run_with_plan
from pareto_ltl.run.interface import PlanningResult
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import PROBLEM, SCENE, WIND, Records
from pareto_ltl.run.results import Results
from pareto_ltl.settings import MissionConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.world.scene import Scene

GOAL = "goal"  # name of the region about the end
WIDE = 0.5  # half side of that region, in full steps
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def steer(
    planned: PlanningResult | Results | str | Path, start: Sequence[float], end: Sequence[float],
    *, radius: float | None = None, weight: float = 10.0,
) -> PlannedPath:  # fmt: skip
    """The path from ``start`` to ``end`` on the map and in the wind of a plan, from its departure on.

    One convex programme bends lines past the obstacles; each segment keeps ``planner.epsilon``. Obstacles,
    border, forbidden regions and robot are taken from the plan; its mission has no effect.

    Parameters
    ----------
    planned : PlanningResult, Results or path
        What :func:`pareto_ltl.plan` returned, or a results directory.
    start, end : (2,) float
        Positions on the plane of the map [m].
    radius : float, optional
        The path ends in the square of this half side about ``end`` [m]; by default half a full step.
    weight : float
        Weight of mission risk + collision risk, beside the length in units of the shortest line.

    Raises
    ------
    ConfigError
        If a point lies outside the map or in an obstacle.
    InfeasibleError
        If no path leads there within the limits.
    """
    from pareto_ltl.planning.refine.smoothing import steered_path

    run = run_with_plan(planned)
    settings, scene, problem = run.settings, run.make(SCENE), run.make(PROBLEM)
    here, there = (_point(scene, name, at) for name, at in (("start", start), ("end", end)))
    wide = WIDE * problem.reach if radius is None else radius
    if not wide > 0.0:
        raise ConfigError(f"steer: radius must be above 0 m, got {wide:g}")
    settings = replace(
        settings,
        mission=MissionConfig(formula=f"F {GOAL}", start_time=scene.time_zero),
        robot=replace(settings.robot, dt=problem.motion.dt),
    )
    records = Records({SCENE: _towards(scene, here, there, wide), WIND: run.make(WIND)})
    leg = Run(settings, run.table, records).make(PROBLEM)
    return steered_path(leg, settings.smoothing, weight)


def _point(scene: Scene, name: str, at: Sequence[float]) -> FloatArray:
    import shapely

    place = np.asarray(at, float)
    if place.shape != (2,) or not np.isfinite(place).all():
        raise ConfigError(f"steer: {name} must be two numbers [m], got {at!r}")
    (west, south), (east, north) = scene.bounds
    if not (scene.bounds[0] <= place).all() or not (place <= scene.bounds[1]).all():
        raise ConfigError(
            f"steer: {name} {tuple(place.tolist())} lies outside the map, which reaches from "
            f"({west:g}, {south:g}) to ({east:g}, {north:g}) m"
        )
    for k, outline in enumerate(scene.obstacles):
        if shapely.Polygon(outline).covers(shapely.Point(place)):
            gap = shapely.Polygon(outline).exterior.distance(shapely.Point(place))
            raise ConfigError(
                f"steer: {name} lies {distance_text(gap)} deep in {scene.obstacle_title(k + 1)}; move it out"
            )
    return place


def _towards(scene: Scene, start: FloatArray, end: FloatArray, wide: float) -> Scene:
    """``scene`` from ``start``, with the square of half side ``wide`` about ``end`` as its only goal."""
    square = np.clip(end + wide * CORNERS, *scene.bounds)
    windows = {name: window for name, window in scene.windows.items() if name in scene.forbidden}
    hazards = {window.region for window in windows.values()}
    regions = {name: parts for name, parts in scene.regions.items() if name in hazards}
    return replace(scene, start=start, regions={**regions, GOAL: (square,)}, windows=windows)
