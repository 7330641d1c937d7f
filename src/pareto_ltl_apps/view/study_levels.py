"""The figures of ``pipelines=levels``: routes by level, and failure over level and length."""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pareto_ltl import Scene, Settings
from pareto_ltl.extend import Decomposition, Study
from pareto_ltl_apps.view import map_layers, style
from pareto_ltl_apps.view.axes import Figures
from pareto_ltl_apps.view.map import LEFT, TEXT_LINE, column_map
from pareto_ltl_apps.view.study_departure import heat_figure


def levels_figures(_: Settings, study: Study, scene: Scene, decomposition: Decomposition) -> Figures:
    """``levels`` (routes) and ``levels_heat``."""
    rows, limits, rates = (study.pictures[name] for name in ("rows", "limits", "rates"))
    names = [row["name"].replace(" ", "\n") for row in rows]
    return {
        "levels": lambda: routes_figure(scene, decomposition, study),
        "levels_heat": lambda: heat_figure(rows, limits, rates, names),
    }


def routes_figure(scene: Scene, decomposition: Decomposition, study: Study) -> Figure:
    """Map of the plans, the recommended one wide, from light (first level) to dark (last)."""
    rows, routes = study.pictures["rows"], study.pictures["routes"]
    columns = -(-len(routes) // 2)
    legend = TEXT_LINE * columns + 0.08
    figure, chart = column_map(scene, [study.pictures["heading"]], legend + 0.42)
    map_layers.draw_ground(chart, scene, decomposition)
    map_layers.number_obstacles(chart, scene)
    shades = matplotlib.colormaps["viridis"](np.linspace(0.92, 0.08, max(len(routes), 1)))
    keys = []
    for shade, (number, x) in zip(shades, sorted(routes.items()), strict=True):
        row = rows[int(number)]
        wide = row["recommended"]
        look = {"color": shade, "lw": 2.2 if wide else 1.0, "zorder": 7 if wide else 6}
        chart.plot(*x.T, path_effects=style.white_halo(3.4 if wide else 1.8), **look)
        label = f"{row['name']}{' (recommended)' if wide else ''}"
        keys.append(Line2D([], [], color=shade, lw=look["lw"], label=label))
    map_layers.draw_endpoints(chart, scene, None)
    taken = np.concatenate([map_layers.dense_path(x) for x in routes.values()])
    map_layers.name_regions(chart, scene, taken, times=False)
    style.legend_at(figure, keys, (LEFT, legend), 2, handlelength=1.6, columnspacing=1.2)
    return figure
