"""The figure of the Pareto front."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from pareto_ltl.planning.records import Forest, Front, Objectives, Plan
from pareto_ltl.report import style
from pareto_ltl.report.flown_front import flown_front_figure
from pareto_ltl.report.map_layers import length_unit
from pareto_ltl.report.rate_axes import scale_rate_axis, set_rate_ticks
from pareto_ltl.settings import FidelityConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.scene import Scene

FRONT_HEIGHT = 2.75  # height of the figure [in]


def front_figure(scene: Scene, forest: Forest | None, front: Front, plan: Plan | None) -> Figure:
    """Mission risk against path length, collision risk as colour, before and after smoothing.

    A front of failure rates has another figure (:mod:`pareto_ltl.report.flown_front`).

    Parameters
    ----------
    forest : Forest or None
        Its accepted vertices are drawn as a cloud of dots.
    plan : Plan or None
        The selected path is marked with a ring.
    """
    unit, per_metre = length_unit(scene)
    if front.rates:
        return flown_front_figure(front, plan, (unit, per_metre))
    after = _front_rows([path.objectives for path in front.paths]) * [per_metre, 1.0, 1.0]
    before = _front_rows(front.raw) * [per_metre, 1.0, 1.0]
    cloud = accepted_vertices(forest, forest.mission_columns if forest is not None else 0) * [per_metre, 1.0]
    figure = style.blank_figure(style.COLUMN_WIDTH, FRONT_HEIGHT)
    ax = style.axes_at(figure, 0.58, 0.38, 2.22, 1.82)
    low, hidden = style.log_axis_end(np.concatenate([after[:, 1], before[:, 1], cloud[:, 1]]))
    norm, lowest = _collision_scale(np.concatenate([after[:, 2], before[:, 2]]))
    up = np.maximum(cloud[:, 1], low)
    ax.scatter(cloud[:, 0], up, s=2.0, c=style.MIST, alpha=0.5, lw=0, rasterized=True, zorder=1)
    _scatter_front(ax, before, low, norm, marker="s", s=13.0, edgecolors=style.STONE, zorder=3)
    _scatter_front(ax, after, low, norm, marker="o", s=24.0, edgecolors="black", zorder=4)
    if plan is not None:
        _ring_plan(ax, _front_rows([plan.path.objectives])[0] * [per_metre, 1.0, 1.0], low)
    _scale_risk_axis(ax, low, hidden)
    ax.set(xlabel=f"path length [{unit}]", ylabel=mission_risk_label(front.models))
    ax.xaxis.set_major_locator(MaxNLocator(5))
    _collision_bar(figure, ax, lowest, collision_risk_label(front.models))
    _front_legend(figure, cloud, before, plan)
    return figure


def _front_rows(objectives: Sequence[Objectives]) -> FloatArray:
    """Length [m], judged mission risk and collision risk of each path, shape (n, 3)."""
    rows = [[o.length, o.mission_risk, o.collision_risk] for o in objectives]
    return np.array(rows, float).reshape(-1, 3)


def _scatter_front(ax: Axes, rows: FloatArray, low: float, norm: LogNorm, **marks: Any) -> None:
    """Rows (length, mission risk, collision risk); risks below ``low`` are drawn at the end of the axis."""
    colour = np.maximum(rows[:, 2], float(norm.vmin or 0.0))
    up = np.maximum(rows[:, 1], low)
    ax.scatter(rows[:, 0], up, c=colour, norm=norm, cmap="cividis", linewidths=0.6, clip_on=False, **marks)


def _ring_plan(ax: Axes, row: FloatArray, low: float) -> None:
    ax.plot(
        row[0],
        max(row[1], low),
        marker="o",
        ms=8.5,
        mfc="none",
        mec=style.VERMILLION,
        mew=1.3,
        ls="",
        zorder=5,
        clip_on=False,
    )


def accepted_vertices(forest: Forest | None, columns: int) -> FloatArray:
    """Length [m] and mission risk of every accepted vertex, shape (A, 2).

    The mission risk is the sum of the first ``columns`` columns of ``Tree.risk``, at most 1.
    """
    if forest is None or not len(forest.accepted):
        return np.empty((0, 2))
    rows = []
    for tree_number in np.unique(forest.accepted[:, 0]):
        tree, vertices = forest.trees[tree_number], forest.accepted[forest.accepted[:, 0] == tree_number, 1]
        risk = tree.risk[vertices, :columns].sum(axis=1)
        rows.append(np.column_stack([tree.length[vertices], np.minimum(1.0, risk)]))
    return np.concatenate(rows)


def mission_risk_label(models: FidelityConfig) -> str:
    """Axis of the mission risk that paths are judged by, with its wind law."""
    return f"mission risk {models.mission_symbol}, {models.law} winds [%]"


def collision_risk_label(models: FidelityConfig) -> str:
    """Colour bar of the collision risk, with its wind law."""
    return f"collision risk R, {models.law} winds [%]"


def _scale_risk_axis(ax: Axes, low: float, hidden: bool) -> None:
    """Logarithmic axis from ``low`` to 1; if ``hidden``, smaller values are drawn at ``low``, with ``≤``."""
    scale_rate_axis(ax, "y", low, hidden=hidden)
    if hidden:
        ax.axhline(low, color=style.STONE, lw=1.0, ls=(0, (2, 2)), zorder=2, clip_on=False)
        ax.spines["bottom"].set_visible(False)
    ax.spines[["top", "right"]].set_visible(False)


def _collision_scale(risks: FloatArray) -> tuple[LogNorm, bool]:
    """Logarithmic colour scale of ``risks``, and whether some values lie below its end."""
    low, hidden = style.log_axis_end(risks)
    high = max(10.0 ** np.ceil(np.log10(max(float(risks.max(initial=0.0)), low)) - 1e-9), 10.0 * low)
    return LogNorm(low, high), hidden


def _collision_bar(figure: Figure, ax: Axes, hidden: bool, label: str) -> None:
    bar = figure.colorbar(ax.collections[-1], cax=style.axes_at(figure, 2.86, 0.38, 0.09, 1.82))
    bar.set_label(label)
    bar.outline.set_linewidth(0.5)
    set_rate_ticks(bar.ax.yaxis, float(bar.norm.vmin or 0.0), float(bar.norm.vmax or 1.0), hidden=hidden)


def _front_legend(figure: Figure, cloud: FloatArray, before: FloatArray, plan: Plan | None) -> None:
    def mark(label: str, marker: str, size: float, face: str, edge: str, width: float = 0.6) -> Line2D:
        return Line2D([], [], ls="", marker=marker, ms=size, mfc=face, mec=edge, mew=width, label=label)

    keys = [mark("front after smoothing", "o", 4.9, "#7C7B78", "black")]
    if len(before):
        keys.append(mark("front before", "s", 3.6, "#7C7B78", style.STONE))
    if plan is not None:
        keys.append(mark("chosen plan", "o", 7.0, "none", style.VERMILLION, 1.3))
    if len(cloud):
        keys.append(mark(f"{len(cloud):,} accepted vertices", "o", 2.5, style.MIST, style.MIST))
    figure.legend(
        handles=keys,
        ncols=2,
        loc="lower left",
        bbox_to_anchor=(0.52 / style.COLUMN_WIDTH, 2.28 / FRONT_HEIGHT),
        borderaxespad=0.0,
        borderpad=0.0,
        handletextpad=0.3,
        columnspacing=1.2,
        labelspacing=0.35,
    )
