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
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from careful_io.texts import distance_text, listed_text
from careful_io.times import hours_text
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
from pareto_ltl.support.departure import seconds_after
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.automaton_picture import automaton_figure, draw_automaton
from pareto_ltl_apps.view.axes import Figures, save_figures
from pareto_ltl_apps.view.front import draw_front, front_figure
from pareto_ltl_apps.view.lattice import lattice_nodes
from pareto_ltl_apps.view.map import draw_map, plan_figure
from pareto_ltl_apps.view.map_layers import draw_mean_path
from pareto_ltl_apps.view.plan_maps import frames_figure, limits_figure
from pareto_ltl_apps.view.records import DrawnRun
from pareto_ltl_apps.view.settings import FIGURE_FORMATS, ReportConfig
from pareto_ltl_apps.view.wind import draw_wind, utc_text, wind_figure, wind_panels

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


def draw_record(
    record: Any, scene: Scene | None = None, ax: Axes | None = None, **options: Any
) -> Drawing | Axes:  # fmt: skip
    """The figure of a record, or ``ax`` with the record drawn on it.

    Parameters
    ----------
    scene : Scene, optional
        The map to draw it on.
    ax : matplotlib.axes.Axes, optional
        Axes of the reader. The record is drawn without heading, a map also without legend, of a wind the
        expected wind. What the axes show already stays in view.
    options
        ``time`` of a wind field (seconds after departure, or ``"6h"``), ``plan`` of a front (the path to
        mark), ``count`` of simulated flights (how many are drawn), and their ``frames`` with ``plan`` (a map
        for each of so many moments), ``deployments`` of a run (simulated flights by wind law).

    Raises
    ------
    TypeError
        If there is no figure of this type of record, or none with such an option.
    """
    for kind, make in FIGURES.items():
        if isinstance(record, kind):
            known = list(signature(make).parameters)[3:]
            if unknown := sorted(options.keys() - {*known}):
                those = listed_text(["scene", "ax", *known])
                raise TypeError(f"the figure of a {kind.__name__} has no option {unknown[0]!r}, but {those}")
            return _drawn_on(ax, partial(make, record, scene, **options))
    kinds = ", ".join(kind.__name__ for kind in FIGURES)
    raise TypeError(f"there is no figure of a {type(record).__name__}; expected one of {kinds}")


def replanned_drawing(
    plan: Plan, rest: PlannedPath, scene: Scene | None = None, ax: Axes | None = None
) -> Drawing | Axes:  # fmt: skip
    """The map with a new plan, and the rest of the old one dashed."""

    def make(ax: Axes | None) -> Axes:
        chart = _plan_chart(plan, scene or _ground_around(plan.path.x, rest.x), ax)
        (line,) = chart.plot(*rest.x.T, **REST_LOOK, zorder=5.5)
        chart.legend(handles=[line], labels=["rest of the old plan"], frameon=True, edgecolor="none")
        return chart

    return _drawn_on(ax, make)


def _drawn_on(ax: Axes | None, make: Callable[[Axes | None], Axes]) -> Drawing | Axes:
    """What ``make`` draws, on ``ax`` if there is one: its limits then include those that it had."""
    with style.report_style():
        if ax is None:
            figure = make(None).get_figure(root=True)
            assert figure is not None
            return Drawing(figure)
        before = (ax.get_xlim(), ax.get_ylim()) if ax.has_data() else None
        make(ax)
        if before is not None:
            x, y = (*before[0], *ax.get_xlim()), (*before[1], *ax.get_ylim())
            ax.set(xlim=(min(x), max(x)), ylim=(min(y), max(y)))
        return ax


# --- figures by type of record: the axes with the record, of ``ax`` or of a figure ----------------


def _map_chart(heading: list[str] | None, scene: Scene, ax: Axes | None, **records: Any) -> Axes:
    """A map with some of the records of a run."""
    return _run_map(ReportConfig(), DrawnRun(scene, **records), heading, ax)


def _run_map(cfg: ReportConfig, run: DrawnRun, heading: list[str] | None, ax: Axes | None) -> Axes:
    if ax is None:
        return plan_figure(cfg, run, heading=heading).axes[0]
    draw_map(ax, cfg, run)
    return ax


def _run_chart(
    run: Run, scene: Scene | None, ax: Axes | None, deployments: Mapping[str, Deployment] | None = None
) -> Axes:
    """The map with trees, plan and flights, the same as ``figures/plan.png`` of a run."""
    if deployments is None and run.stored is None:
        deployments = run.records.get("deployments")
    records = {"decomposition": run.cells, "wind": run.wind, "forest": run.forest, "plan": run.plan}
    return _map_chart(None, scene or run.scene, ax, **records, deployments=deployments or {})


def _plan_chart(plan: Plan, scene: Scene | None, ax: Axes | None) -> Axes:
    return _map_chart(None, scene or _ground_around(plan.path.x), ax, plan=plan)


def _path_chart(path: PlannedPath, scene: Scene | None, ax: Axes | None) -> Axes:
    """The expected positions without ellipses: a path has no record of the wind law of its covariances."""
    ground = scene or _ground_around(path.x)
    chart = _map_chart([", ".join(f"{name} {value}" for name, value in path.facts().items())], ground, ax)
    draw_mean_path(chart, path.x)
    chart.plot(*path.x[-1], "s", mfc="white", mec="black", ms=4, mew=0.9, zorder=9.5)
    return chart


def _front_chart(front: Front, scene: Scene | None, ax: Axes | None, plan: Plan | None = None) -> Axes:
    drawn = DrawnRun(scene or _ground_around(*(path.x for path in front.paths)), plan=plan)
    if ax is None:
        return front_figure(drawn, front).axes[0]
    draw_front(ax, drawn, front)
    return ax


def _forest_chart(forest: Forest, scene: Scene | None, ax: Axes | None) -> Axes:
    title = f"{len(forest.trees)} trees, {len(forest.accepted):,} vertices complete the mission"
    ground = scene or _ground_around(*(tree.x for tree in forest.trees))
    return _map_chart([title], ground, ax, forest=forest)


def _tree_chart(tree: Tree, scene: Scene | None, ax: Axes | None) -> Axes:
    forest = Forest((tree,), np.empty((0, 2), np.int64), tree.seconds)
    title = f"a tree of {len(tree):,} vertices"
    return _map_chart([title], scene or _ground_around(tree.x), ax, forest=forest)


def _flights_chart(
    deployment: Deployment,
    scene: Scene | None,
    ax: Axes | None,
    count: int = 100,
    frames: int = 0,
    plan: Plan | None = None,
) -> Axes:
    """All flights on one map; with ``frames`` and the ``plan``, which has the times, a strip of maps."""
    ground = scene or _ground_around(deployment.x.reshape(-1, 2))
    if frames:
        if plan is None:
            raise TypeError("frames= needs plan=, which has the times of the steps")
        if ax is not None:
            raise TypeError("frames= makes several maps, which ax= cannot have; leave one of them out")
        return frames_figure(ground, deployment, plan.path.t, frames, count).axes[0]
    drawn = DrawnRun(ground, deployments={deployment.law: deployment})
    return _run_map(ReportConfig(paths=count), drawn, [], ax)


def _scene_chart(scene: Scene, _: Scene | None, ax: Axes | None) -> Axes:
    east, north = (distance_text(float(side)) for side in np.ptp(scene.bounds, axis=0))
    border = "leaving the map is a failure" if scene.walled else "leaving the map is no failure"
    return _map_chart([f"{east} x {north}, {border}", utc_text(scene, 0.0)], scene, ax)


def _cells_chart(decomposition: Decomposition, scene: Scene | None, ax: Axes | None) -> Axes:
    ground = scene or _ground_around(*decomposition.cells)
    title = f"{len(decomposition.cells):,} convex cells"
    return _map_chart([title], ground, ax, decomposition=decomposition)


def _problem_chart(problem: Problem, _: Scene | None, ax: Axes | None) -> Axes:
    return _cells_chart(problem.decomposition, problem.scene, ax)


def _wind_chart(
    wind: WindField, scene: Scene | None, ax: Axes | None, time: float | str = 0.0
) -> Axes:  # fmt: skip
    ground = scene or _ground_around(np.column_stack([[side[0], side[-1]] for side in lattice_nodes(wind)]))
    t = seconds_after("time", time, ground.time_zero)
    if ax is None:
        moment = "at departure" if t == 0.0 else f"{hours_text(t)} after departure"
        return wind_panels(ground, wind, t, moment).axes[0]
    draw_wind(ax, ground, wind, t)
    return ax


def _automaton_chart(automaton: Automaton, _: Scene | None, ax: Axes | None) -> Axes:
    if ax is None:
        return automaton_figure(automaton).axes[0]
    draw_automaton(ax, automaton)
    return ax


FIGURES: dict[type, Callable[..., Axes]] = {
    Run: _run_chart,
    Plan: _plan_chart,
    PlannedPath: _path_chart,
    Front: _front_chart,
    Forest: _forest_chart,
    Tree: _tree_chart,
    Deployment: _flights_chart,
    Scene: _scene_chart,
    Decomposition: _cells_chart,
    Problem: _problem_chart,
    WindField: _wind_chart,
    Automaton: _automaton_chart,
}


def _ground_around(*points: FloatArray) -> Scene:
    """A map without regions around ``points`` (n, 2) [m] each; the first of them is the start."""
    rows = np.concatenate([piece for piece in points if len(piece)] or [np.zeros((1, 2))])
    low, high = rows.min(axis=0), rows.max(axis=0)
    margin = MARGIN * max(float((high - low).max()), 1.0)
    return Scene(np.array([low - margin, high + margin]), rows[0], {})
