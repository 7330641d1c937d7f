"""All figures of one run, and figures of single records for notebooks: ``plan.plot()``, ``wind.plot()``.

The figures of a run are ``plan``, the plan and its simulated flights; ``limits``, what limits the plan;
``front``, the paths it was selected from; ``wind``, the wind field. A run without a plan still has a map with
its trees.

Most single records do not contain their map: ``scene=`` draws it as the background. Without it, the figure
covers the extent of the record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pareto_ltl import Run, Scene, WindField
from pareto_ltl.extend import (
    Automaton,
    Decomposition,
    Deployment,
    Forest,
    Front,
    Plan,
    PlannedPath,
    Problem,
    Tree,
)
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text, listed_text
from pareto_ltl.support.times import hours_text, seconds_after
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.automaton_picture import automaton_figure
from pareto_ltl_apps.view.axes import Figures, save_figures
from pareto_ltl_apps.view.front import front_figure
from pareto_ltl_apps.view.lattice import lattice_nodes
from pareto_ltl_apps.view.map import plan_figure
from pareto_ltl_apps.view.map_layers import draw_mean_path
from pareto_ltl_apps.view.plan_maps import frames_figure, limits_figure
from pareto_ltl_apps.view.records import DrawnRun
from pareto_ltl_apps.view.settings import FIGURE_FORMATS, ReportConfig
from pareto_ltl_apps.view.wind import utc_text, wind_figure, wind_panels

NOTEBOOK_DPI = 160
MARGIN = 0.06  # around a record without a map, as a share of its size
REST_LOOK: dict[str, Any] = {"color": style.VERMILLION, "lw": 1.2, "ls": (0, (3.5, 1.5))}


def draw_run_figures(folder: Path, cfg: ReportConfig, run: DrawnRun) -> tuple[Path, ...]:
    """Write the figures of ``run`` into ``folder``, each in ``report.formats``; return the paths.

    They are ``plan``, ``wind``, ``limits`` if the plan has limits or prices, and ``front`` if the run has a
    front that is not empty.
    """
    made: Figures = {"plan": partial(plan_figure, cfg, run)}
    if run.wind is not None:
        made["wind"] = partial(wind_figure, run.scene, run.wind, run.plan)
    if run.front is not None and len(run.front.paths) > 0:
        made["front"] = partial(front_figure, run, run.front)
    if run.plan is not None and (run.plan.limits is not None or run.plan.prices):
        made["limits"] = partial(limits_figure, run, run.plan)
    return save_figures(folder, cfg, made)


# --- figures of single records -------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure that a notebook shows without pyplot.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        The figure, which may be changed.
    """

    figure: Figure

    def _repr_png_(self) -> bytes:
        with style.report_style():
            return style.figure_bytes(self.figure, "png", NOTEBOOK_DPI)

    def save(self, path: Path | str, dpi: int = 200) -> Path:
        """Write the figure in the format of the suffix of ``path``; return the path."""
        kind = Path(path).suffix.lstrip(".").lower()
        with style.report_style():
            if kind in FIGURE_FORMATS:
                Path(path).write_bytes(style.figure_bytes(self.figure, kind, dpi))
            else:
                self.figure.savefig(path, dpi=dpi)
        return Path(path)


def draw_record(record: Any, scene: Scene | None = None, **options: Any) -> Drawing:
    """The figure of a record.

    Parameters
    ----------
    scene : Scene, optional
        The map to draw it on.
    options
        ``time`` of a wind field (seconds after departure, or ``"6h"``), ``plan`` of a front (the path to
        mark), ``count`` of simulated flights (how many are drawn), and their ``frames`` with ``plan`` (a map
        for each of so many moments).

    Raises
    ------
    TypeError
        If there is no figure of this type of record, or none with such an option.
    """
    if isinstance(record, Run):
        return _run_drawing(record, **options)
    for kind, make in FIGURES.items():
        if isinstance(record, kind):
            known = list(signature(make).parameters)[2:]
            if unknown := sorted(options.keys() - {*known}):
                those = listed_text(["scene", *known])
                raise TypeError(f"the figure of a {kind.__name__} has no option {unknown[0]!r}, but {those}")
            with style.report_style():
                return Drawing(make(record, scene, **options))
    kinds = ", ".join(kind.__name__ for kind in FIGURES)
    raise TypeError(f"there is no figure of a {type(record).__name__}; expected one of {kinds}")


def _run_drawing(run: Run, **options: Any) -> Drawing:
    """The map with trees and plan, and the simulated flights of a run in memory."""
    if run.stored is None:
        options = {"deployments": run.records.get("deployments")} | options
    return mission_drawing(run.scene, run.cells, run.wind, run.forest, run.plan, **options)


def mission_drawing(
    scene: Scene,
    decomposition: Decomposition,
    wind: WindField,
    forest: Forest | None = None,
    plan: Plan | None = None,
    deployments: Mapping[str, Deployment] | None = None,
) -> Drawing:
    """The map with trees, plan and flights, the same as ``figures/plan.png`` of a run."""
    drawn = DrawnRun(scene, decomposition, wind, forest, None, plan, deployments or {})
    with style.report_style():
        return Drawing(plan_figure(ReportConfig(), drawn))


def replanned_drawing(plan: Plan, rest: PlannedPath, scene: Scene | None = None) -> Drawing:
    """The map with a new plan, and the rest of the old one dashed."""
    with style.report_style():
        ground = scene or _ground_around(plan.path.x, rest.x)
        figure = _plan_chart(plan, ground)
        chart = figure.axes[0]
        (line,) = chart.plot(*rest.x.T, **REST_LOOK, zorder=5.5)
        chart.legend(handles=[line], labels=["rest of the old plan"], frameon=True, edgecolor="none")
        return Drawing(figure)


# --- figures by type of record -------------------------------------------------------------------


def _map_chart(heading: list[str] | None, scene: Scene, **records: Any) -> Figure:
    """A map with some of the records of a run."""
    return plan_figure(ReportConfig(), DrawnRun(scene, **records), heading=heading)


def _plan_chart(plan: Plan, scene: Scene | None) -> Figure:
    return _map_chart(None, scene or _ground_around(plan.path.x), plan=plan)


def _path_chart(path: PlannedPath, scene: Scene | None) -> Figure:
    """The expected positions without ellipses: a path has no record of the wind law of its covariances."""
    ground = scene or _ground_around(path.x)
    figure = _map_chart([", ".join(f"{name} {value}" for name, value in path.facts().items())], ground)
    chart = figure.axes[0]
    draw_mean_path(chart, path.x)
    chart.plot(*path.x[-1], "s", mfc="white", mec="black", ms=4, mew=0.9, zorder=9.5)
    return figure


def _front_chart(front: Front, scene: Scene | None, plan: Plan | None = None) -> Figure:
    ground = scene or _ground_around(*(path.x for path in front.paths))
    return front_figure(DrawnRun(ground, plan=plan), front)


def _forest_chart(forest: Forest, scene: Scene | None) -> Figure:
    title = f"{len(forest.trees)} trees, {len(forest.accepted):,} vertices complete the mission"
    ground = scene or _ground_around(*(tree.x for tree in forest.trees))
    return _map_chart([title], ground, forest=forest)


def _tree_chart(tree: Tree, scene: Scene | None) -> Figure:
    forest = Forest((tree,), np.empty((0, 2), np.int64), tree.seconds)
    return _map_chart([f"a tree of {len(tree):,} vertices"], scene or _ground_around(tree.x), forest=forest)


def _flights_chart(
    deployment: Deployment,
    scene: Scene | None,
    count: int = 100,
    frames: int = 0,
    plan: Plan | None = None,
) -> Figure:
    """All flights on one map; with ``frames`` and the ``plan``, which has the times, a strip of maps."""
    ground = scene or _ground_around(deployment.x.reshape(-1, 2))
    if frames:
        if plan is None:
            raise TypeError("frames= needs plan=, which has the times of the steps")
        return frames_figure(ground, deployment, plan.path.t, frames, count)
    drawn = DrawnRun(ground, deployments={deployment.law: deployment})
    return plan_figure(ReportConfig(paths=count), drawn, heading=[])


def _scene_chart(scene: Scene, _: Scene | None) -> Figure:
    east, north = (distance_text(float(side)) for side in np.ptp(scene.bounds, axis=0))
    border = "leaving the map is a failure" if scene.walled else "leaving the map is no failure"
    return _map_chart([f"{east} x {north}, {border}", utc_text(scene, 0.0)], scene)


def _cells_chart(decomposition: Decomposition, scene: Scene | None) -> Figure:
    ground = scene or _ground_around(*decomposition.cells)
    title = f"{len(decomposition.cells):,} convex cells"
    return _map_chart([title], ground, decomposition=decomposition)


def _wind_chart(wind: WindField, scene: Scene | None, time: float | str = 0.0) -> Figure:
    ground = scene or _ground_around(np.column_stack([[side[0], side[-1]] for side in lattice_nodes(wind)]))
    t = seconds_after("time", time, ground.time_zero)
    return wind_panels(ground, wind, t, "at departure" if t == 0.0 else f"{hours_text(t)} after departure")


FIGURES: dict[type, Callable[..., Figure]] = {
    Plan: _plan_chart,
    PlannedPath: _path_chart,
    Front: _front_chart,
    Forest: _forest_chart,
    Tree: _tree_chart,
    Deployment: _flights_chart,
    Scene: _scene_chart,
    Decomposition: _cells_chart,
    Problem: lambda problem, _: _cells_chart(problem.decomposition, problem.scene),
    WindField: _wind_chart,
    Automaton: lambda automaton, _: automaton_figure(automaton),
}


def _ground_around(*points: FloatArray) -> Scene:
    """A map without regions around ``points`` (n, 2) [m] each; the first of them is the start."""
    rows = np.concatenate([piece for piece in points if len(piece)] or [np.zeros((1, 2))])
    low, high = rows.min(axis=0), rows.max(axis=0)
    margin = MARGIN * max(float((high - low).max()), 1.0)
    return Scene(np.array([low - margin, high + margin]), rows[0], {})
