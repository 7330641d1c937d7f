"""The figure of the air that a flight needs: volumes on the map, and their size against a fixed buffer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from careful_io.texts import plain_power
from pareto_ltl import Scene
from pareto_ltl.extend import Plan
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.axes import hide_frame
from pareto_ltl_apps.view.map import LEFT, TEXT_LINE, WEST, column_map, draw_route
from pareto_ltl_apps.view.map_layers import draw_polygons

HOUR = 3600.0
LEAST = 0.1  # of its level: smaller rates are drawn here
COLOURS = ("#5FA3D3", "#A9CCE8", "#DCE9F5")  # of levels, from the largest probability to the least
EDGE = "#2F6C9C"
CHART, FOOT, GAP = 1.25, 0.42, 0.62  # height of the chart, below it, and above it to the map [in]
UNITS = (
    (1e12 * HOUR, "10⁶ km² h"), (1e9 * HOUR, "10³ km² h"), (1e6 * HOUR, "km² h"), (1e3 * HOUR, "10³ m² h"),
    (HOUR, "m² h"),
)  # fmt: skip
Levels = Sequence[tuple[float, Sequence[FloatArray]]]  # per flight hour, and the outlines of the legs [m]
Rows = Sequence[tuple[float, float, float, float, float]]


def containment_figure(
    scene: Scene, plan: Plan, heading: str, levels: Levels, rows: Rows, floor: float = 0.0
) -> Figure:
    """Map with the volumes of each level, above their area and time against fixed buffers.

    A row has the level, the rate per flight hour of the volumes and their area and time [m² s], and the same
    two of the fixed buffer. Rates below ``floor`` per flight hour are beyond the data of the law.
    """
    keys = [
        Patch(fc=_colour(n), ec=EDGE, lw=0.4, label=f"{plain_power(level)} per flight hour")
        for n, (level, _) in enumerate(levels)
    ]
    legend = TEXT_LINE * -(-len(keys) // 2) + 0.08
    below = FOOT + CHART + GAP + legend
    figure, chart = column_map(scene, [heading], below)
    draw_route(chart, scene, plan)
    for n, (_, outlines) in reversed(list(enumerate(levels))):
        draw_polygons(chart, outlines, fc="none", ec=EDGE, lw=0.7, zorder=2.2 - 0.2 * n)
        draw_polygons(chart, outlines, fc=_colour(n), ec=_colour(n), lw=0.2, zorder=2.25 - 0.2 * n)
    style.legend_at(figure, keys, (LEFT, below - 0.38), 2, handlelength=1.4, columnspacing=1.2)
    _draw_chart(figure, rows, floor)
    return figure


def _colour(n: int) -> str:
    return COLOURS[min(n, len(COLOURS) - 1)]


def _draw_chart(figure: Figure, rows: Rows, floor: float) -> None:
    """Area and time against the rate per flight hour, of volumes and fixed buffers."""
    ax = style.axes_at(figure, WEST, FOOT, style.COLUMN_WIDTH - WEST - 0.14, CHART)
    table = np.array([row[1:] for row in rows])
    least = LEAST * np.array([row[0] for row in rows])  # a rate of no flight has no logarithm
    table[:, [0, 2]] = np.maximum(table[:, [0, 2]], least[:, None])
    top = float(table[:, [1, 3]].max())
    unit, name = next((scale, text) for scale, text in UNITS if top >= scale)
    sets = (
        (2, 3, style.STONE, "s", "fixed buffer of equal containment"),
        (0, 1, style.BLACK, "o", "volumes"),
    )
    for rate, size, colour, mark, _ in sets:
        ax.plot(table[:, rate], table[:, size] / unit, color=colour, lw=0.9, marker=mark, ms=3.2)
    ax.set(xscale="log", xlabel="flights that leave per flight hour", ylabel=f"area × time [{name}]")
    top /= unit
    ax.set_ylim(0.0, 1.12 * top)
    if floor > 0.0:
        low = min(ax.get_xlim()[0], 0.5 * float(table[:, [0, 2]].min()))
        ax.set_xlim(low, None)
        ax.axvspan(low, floor, color=style.MIST, alpha=0.35, lw=0.0, zorder=0)
        ax.text(floor, 1.08 * top, "for comparison only ", ha="right", va="top", fontsize=6.0, clip_on=True)
    keys = [
        Line2D([], [], color=colour, marker=mark, ms=3.2, lw=0.9, label=label)
        for _, _, colour, mark, label in reversed(sets)
    ]
    style.legend_at(figure, keys, (WEST - 0.04, FOOT + CHART + 0.2), 2, handlelength=1.8, columnspacing=1.2)
    hide_frame(ax)
