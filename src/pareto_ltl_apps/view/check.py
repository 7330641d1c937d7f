"""The figure of a plan in a newer forecast: the route, and where its headings lead now."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pareto_ltl import Scene
from pareto_ltl.extend import Plan
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.map import LEFT, TEXT_LINE, column_map, draw_route
from pareto_ltl_apps.view.map_layers import draw_lines

DRAWN = 60  # flights


def check_figure(
    scene: Scene, plan: Plan, heading: Sequence[str], drift: FloatArray | None, flown: FloatArray | None
) -> Figure:
    """Map with the route, the mean ``drift`` (T+1, 2) of its headings in the newer forecast, and flights."""
    legend = TEXT_LINE * 2 + 0.08
    figure, chart = column_map(scene, heading, legend + 0.42)
    draw_route(chart, scene, plan)
    keys = [Line2D([], [], color="black", lw=1.4, label="the plan")]
    if drift is not None and flown is not None:
        look: dict[str, Any] = {"color": style.VERMILLION, "zorder": 5.2}
        draw_lines(chart, flown[:DRAWN], colors=style.VERMILLION, linewidths=0.35, alpha=0.5, zorder=4.4)
        chart.plot(*drift.T, lw=1.4, ls=(0, (4.0, 1.5)), **look)
        keys += [
            Line2D([], [], lw=1.4, ls=(0, (4.0, 1.5)), label="its headings in the newer forecast", **look),
            Line2D([], [], color=style.VERMILLION, lw=0.5, alpha=0.6, label="flights in it"),
        ]
    style.legend_at(figure, keys, (LEFT, legend), 2, handlelength=2.0, columnspacing=1.2)
    return figure
