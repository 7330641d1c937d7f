"""Figures of single records, for notebooks: ``plan.plot()``, ``front.plot()``, ``wind.plot()``."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from pareto_ltl.planning.records import Forest, Front, Plan
from pareto_ltl.report import style
from pareto_ltl.report.flown_front import flown_front_figure
from pareto_ltl.report.front import collision_risk_label, mission_risk_label
from pareto_ltl.report.map import plan_figure
from pareto_ltl.report.map_layers import tree_edges
from pareto_ltl.report.rate_axes import scale_rate_axis
from pareto_ltl.report.records import DrawnRun
from pareto_ltl.settings import ReportConfig
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

KILOMETRE = 1e-3


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure that a notebook shows without pyplot.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        To be changed at will.
    """

    figure: Figure

    def _repr_png_(self) -> bytes:
        with style.report_style():
            image = io.BytesIO()
            self.figure.savefig(image, format="png", dpi=160, metadata={"Software": None})
        return image.getvalue()

    def save(self, path: Path | str, dpi: int = 200) -> Path:
        """Write the figure in the format of the suffix of ``path``; return the path."""
        with style.report_style():
            self.figure.savefig(path, dpi=dpi)
        return Path(path)


def draw_record(record: Any, scene: Scene | None = None) -> Drawing:
    """The figure of a plan, front, forest, wind field or scene; ``scene`` is the map to draw under it.

    Raises
    ------
    TypeError
        If there is no figure of this type of record.
    """
    with style.report_style():
        if isinstance(record, Front):
            chart = (
                flown_front_figure(record, None, ("km", KILOMETRE)) if record.rates else _front_chart(record)
            )
            return Drawing(chart)
        figure = style.blank_figure(style.COLUMN_WIDTH, 3.1)
        ax = style.axes_at(figure, 0.5, 0.4, 2.85, 2.55)
        if isinstance(record, WindField):
            _draw_wind(figure, ax, record)
        elif isinstance(record, Forest):
            _draw_edges(ax, record)
        elif isinstance(record, Plan):
            _draw_path(ax, record)
        elif isinstance(record, Scene):
            scene = record
        else:
            raise TypeError(f"there is no figure of a {type(record).__name__}")
        if scene is not None:
            _draw_scene(ax, scene)
        ax.set(xlabel="east [km]", ylabel="north [km]", aspect="equal")
        ax.autoscale_view()
        return Drawing(figure)


def mission_drawing(
    scene: Scene,
    decomposition: Decomposition,
    wind: WindField,
    forest: Forest | None = None,
    plan: Plan | None = None,
    deployments: Mapping[str, Deployment] | None = None,
) -> Drawing:
    """The map with trees, plan and flights, as ``figures/plan.png`` of a run shows it."""
    drawn = DrawnRun(scene, decomposition, wind, forest, None, plan, deployments or {})
    with style.report_style():
        return Drawing(plan_figure(ReportConfig(), drawn))


def _draw_scene(ax: Axes, scene: Scene) -> None:
    drawn = {style.GREEN: list(scene.region_outlines), style.STONE: list(scene.obstacles)}
    for color, polygons in drawn.items():
        scaled = [KILOMETRE * polygon for polygon in polygons]
        ax.add_collection(PolyCollection(scaled, facecolors=color, edgecolors=color, alpha=0.45, zorder=1))
    for name, outlines in scene.regions.items():
        for polygon in outlines[:1]:
            x, y = KILOMETRE * polygon.mean(axis=0)
            ax.text(x, y, name, ha="center", va="center", parse_math=False)
    ax.plot(*(KILOMETRE * scene.start), "s", color=style.INK, ms=4)
    (west, south), (east, north) = KILOMETRE * scene.bounds
    ax.set(xlim=(west, east), ylim=(south, north))


def _draw_path(ax: Axes, plan: Plan) -> None:
    """The expected positions, with the 95 % ellipse of every fourth."""
    rings = KILOMETRE * style.confidence_ellipses(plan.path.x[::4], plan.path.cov[::4])
    ax.add_collection(PolyCollection(list(rings), facecolors="none", edgecolors=style.SKY, lw=0.6, zorder=2))
    ax.plot(*(KILOMETRE * plan.path.x.T), color=style.BLACK, lw=1.2, zorder=3)
    ax.plot(*(KILOMETRE * plan.path.x[-1]), "s", mfc="white", mec="black", ms=4, zorder=4)


def _draw_edges(ax: Axes, forest: Forest) -> None:
    ax.add_collection(LineCollection(list(KILOMETRE * tree_edges(forest)), colors=style.MIST, lw=0.3))


def _draw_wind(figure: Figure, ax: Axes, wind: WindField) -> None:
    """Speed of the expected wind at the first time, and arrows."""
    mean = wind.mean[0]
    x, y = (KILOMETRE * (wind.origin[k] + wind.spacing * np.arange(mean.shape[k])) for k in (0, 1))
    speed = np.hypot(mean[..., 0], mean[..., 1])
    image = ax.pcolormesh(x, y, speed.T, shading="nearest", cmap="viridis", rasterized=True)
    step = max(1, len(x) // 16)
    u, v = (mean[::step, ::step, k].T for k in (0, 1))
    ax.quiver(x[::step], y[::step], u, v, color="white", width=0.004)
    figure.colorbar(image, ax=ax, label="expected wind [m/s]", shrink=0.8)


def _front_chart(front: Front) -> Figure:
    """Mission risk against length of every path, the collision risk as color."""
    figure = style.blank_figure(style.COLUMN_WIDTH, 2.6)
    ax = style.axes_at(figure, 0.6, 0.42, 2.1, 1.95)
    rows: FloatArray = np.array(
        [[o.length, o.mission_risk, o.collision_risk] for o in (path.objectives for path in front.paths)]
    ).reshape(-1, 3)
    low, hidden = style.log_axis_end(rows[:, 1])
    points = ax.scatter(
        KILOMETRE * rows[:, 0], np.maximum(rows[:, 1], low), c=100 * rows[:, 2], cmap="cividis", s=18
    )
    scale_rate_axis(ax, "y", low, hidden=hidden)
    ax.set(xlabel="path length [km]", ylabel=mission_risk_label(front.models))
    bar = figure.colorbar(points, cax=style.axes_at(figure, 2.82, 0.42, 0.09, 1.95))
    bar.set_label(collision_risk_label(front.models))
    return figure
