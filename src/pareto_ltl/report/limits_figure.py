"""The figure of what limits a plan: collision probability along its path, and the largest prices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, MaxNLocator

from pareto_ltl.planning.costs import SegmentLimits
from pareto_ltl.planning.records import Plan
from pareto_ltl.report import style
from pareto_ltl.report.limits import PriceRow, points_text, price_rows, priced_obstacles
from pareto_ltl.report.map import (
    LEFT,
    TEXT_LINE,
    WEST,
    draw_route,
    draw_scale,
    fitted_heading,
    map_size,
    promise_lines,
    taken_points,
)
from pareto_ltl.report.map_labels import label_half_size, label_position
from pareto_ltl.report.map_layers import MapAxes, map_axes, metres_per_inch
from pareto_ltl.report.records import DrawnRun
from pareto_ltl.report.study_axes import hide_frame
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.cells import convex_pieces
from pareto_ltl.world.scene import Scene

BARS = 6  # prices that are shown, at most
DECADES = 3  # of collision probability below epsilon that colours distinguish
BAR, BARS_LEFT, BARS_RIGHT = 0.29, 1.62, 0.40  # height of a bar with its gap, left and right margins [in]
BARS_BELOW, BARS_ABOVE = 0.36, 0.32  # below the bars for their axis, above them for their heading [in]
SCALE_BELOW = 0.84  # below the map for its axis and the colour scale [in]
NUMBER_SIZE = 8.0  # of the numbers of obstacles [pt]
COLOURS = {"region": style.GREEN, "airspeed": style.BLUE, "length": style.BLUE}  # of bars; others: BARRIER
BARRIER, GREY = "#6E6E6E", "#5F5F5F"
CHANGE_SIZE = 6.0  # of the changes beside the bars [pt]


def limits_figure(run: DrawnRun, plan: Plan) -> Figure:
    """Map with the path coloured by the collision probability of its segments, above bars of its prices.

    A plan without limits has a black path, one without prices no bars.
    """
    rows, heading = price_rows(run.scene, plan, BARS), fitted_heading(_heading(plan, run.medium.flows))
    inner, tall = map_size(run.scene)
    below = BARS_BELOW + BAR * len(rows) + BARS_ABOVE if rows else 0.06
    bottom = below + (0.44 if plan.limits is None else SCALE_BELOW)
    figure = style.blank_figure(style.COLUMN_WIDTH, bottom + tall + 0.26 + TEXT_LINE * len(heading))
    chart = map_axes(run.scene, style.axes_at(figure, WEST, bottom, inner, tall))
    _draw_map(chart, run, plan)
    if plan.limits is not None:
        segments = _colour_path(chart, plan, plan.limits)
        _colour_scale(figure, segments, plan, (WEST, bottom - 0.50, inner))
    if rows:
        _draw_bars(figure, rows)
        text = f"What a small change of one limit saves, {plan.models.law} winds:"
        style.text_at(figure, LEFT, below - BARS_ABOVE + 0.08, text, va="bottom")
    for line, text in enumerate(reversed(heading)):
        style.text_at(figure, LEFT, bottom + tall + 0.22 + TEXT_LINE * line, text, va="bottom")
    return figure


def _heading(plan: Plan, flows: str) -> list[str]:
    return [f"What limits the plan of {plan.formula}", *promise_lines(plan.promise, flows)]


# --- map ----------------------------------------------------------------------------------------


def _draw_map(chart: MapAxes, run: DrawnRun, plan: Plan) -> None:
    draw_route(chart, run.scene, run.decomposition, plan)
    _number_obstacles(chart, run.scene, plan)


def _number_obstacles(chart: MapAxes, scene: Scene, plan: Plan) -> None:
    """The numbers of the obstacles that have a price, inside of them, away from the path."""
    look: dict[str, Any] = {
        "ha": "center", "va": "center", "color": "white", "fontweight": "bold", "fontsize": NUMBER_SIZE,
        "path_effects": [withStroke(linewidth=1.6, foreground=style.INK)], "zorder": 9, "clip_on": True,
    }  # fmt: skip
    for number in priced_obstacles(plan):
        half = label_half_size([(str(number), NUMBER_SIZE)], metres_per_inch(chart))
        parts = _parts_on_map(scene, scene.obstacles[number - 1])
        x, y = label_position(parts, half, taken_points(scene, plan), scene.bounds) * chart.per_metre
        chart.ax.text(x, y, str(number), **look)


def _parts_on_map(scene: Scene, outline: FloatArray) -> Sequence[FloatArray]:
    """Convex parts of the area of ``outline`` that lies on the map."""
    from shapely import Polygon, box

    return convex_pieces(scene, [Polygon(outline).intersection(box(*scene.bounds.ravel()))]) or [outline]


def _colour_path(chart: MapAxes, plan: Plan, limits: SegmentLimits) -> LineCollection:
    """Segments in the colour of their collision probability, from ``DECADES`` below epsilon to epsilon."""
    limit = min(plan.epsilon, 1.0)
    least = limit * 10.0**-DECADES
    x = plan.path.x * chart.per_metre
    order = np.argsort(limits.probability, kind="stable")  # the largest on top
    lines = np.stack([x[:-1], x[1:]], axis=1)[order]
    look: dict[str, Any] = {"linewidths": 2.4, "capstyle": "round", "zorder": 6.2}
    casing = LineCollection(list(lines), colors=style.BLACK, **{**look, "linewidths": 3.6, "zorder": 6.1})
    segments = LineCollection(list(lines), cmap="viridis", norm=LogNorm(least, limit), **look)
    segments.set_array(np.clip(limits.probability[order], least, limit))
    for layer in (casing, segments):
        chart.ax.add_collection(layer, autolim=False)
    return segments


def _colour_scale(
    figure: Figure, segments: LineCollection, plan: Plan, at: tuple[float, float, float]
) -> None:
    """The scale of the colours with its axis below, at ``at`` (left, bottom, width) [in]."""
    high = min(plan.epsilon, 1.0)
    ticks = [high * 10.0**-k for k in range(DECADES, -1, -1)]
    texts = [f"{100.0 * tick:.3g}" for tick in ticks]
    above = plan.limits is not None and bool((plan.limits.probability > high * 1.0001).any())
    last = "≥ " * above + texts[-1] + " (limit)" * (plan.epsilon < 1.0)
    named = dict(zip(ticks, [f"≤ {texts[0]}", *texts[1:-1], last], strict=True))
    label = f"collision probability of a segment, {plan.models.law} winds [%]"
    draw_scale(figure, segments, at, named, label)


# --- bars ---------------------------------------------------------------------------------------


def _draw_bars(figure: Figure, rows: Sequence[PriceRow]) -> None:
    """Savings in percentage points, the largest at the top, each with its limit, time and change."""
    width = style.COLUMN_WIDTH - BARS_LEFT - BARS_RIGHT
    ax = style.axes_at(figure, BARS_LEFT, BARS_BELOW, width, BAR * len(rows))
    points = [100.0 * row.saving for row in rows]
    up = np.arange(len(rows))[::-1]
    ax.barh(up, points, height=0.62, color=[COLOURS.get(row.kind, BARRIER) for row in rows])
    ax.set(xlim=(0.0, max(points)), ylim=(-0.5, len(rows) - 0.5), yticks=[])
    ax.set_xlabel("fewer failures [percentage points]")
    ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    hide_frame(ax)
    for y, row, value in zip(up, rows, points, strict=True):
        _write_beside(ax, (value, y), points_text(row.saving), (2.0, -2.2), ha="left", fontsize=6.5)
        _write_beside(ax, (0.0, y), _bar_name(row), (-4.0, 1.0), ha="right")
        _write_beside(ax, (0.0, y), row.change, (-4.0, -6.5), ha="right", fontsize=CHANGE_SIZE, color=GREY)


def _write_beside(
    ax: Axes, at: tuple[float, float], text: str, off: tuple[float, float], **look: Any
) -> None:
    """``text`` whose baseline is at ``off`` [pt] from the point ``at`` of the data."""
    ax.annotate(
        text, at, off, textcoords="offset points", va="baseline", parse_math=False, annotation_clip=False,
        **look,
    )  # fmt: skip


def _bar_name(row: PriceRow) -> str:
    """The limit, cut to the space beside its bar, and its time."""
    size, time = float(style.RC_SETTINGS["font.size"]), f", {row.time}" if row.time else ""
    width = BARS_LEFT - LEFT - 0.06 - (style.text_width(time, size) if time else 0.0)
    return style.fitted_lines(row.limit.removeprefix("the "), width, size, most=1)[0] + time
