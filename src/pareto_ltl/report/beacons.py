"""The figure of the value of a beacon: a map of the failure rate with one beacon at each of many places."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from pareto_ltl.planning.records import Plan
from pareto_ltl.report import style
from pareto_ltl.report.map import LEFT, TEXT_LINE, WEST, draw_route, draw_scale, fitted_heading, map_size
from pareto_ltl.report.map_layers import MapAxes, map_axes
from pareto_ltl.simulation.beacons import BeaconMap
from pareto_ltl.support.display import probability_text
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

SCALE_BELOW = 0.84  # below the map for its axis and the colour scale [in]


def beacons_figure(scene: Scene, decomposition: Decomposition, plan: Plan, found: BeaconMap) -> Figure:
    """Map with the failure rate of the plan for a beacon at each place; circles are the best beacons."""
    last = found.sites[-1].rate.failure
    heading = fitted_heading(
        [
            f"Where a beacon helps the plan of {plan.formula}",
            f"{probability_text(found.without.failure)} fail without, {probability_text(last)} with the "
            f"{'beacon' if len(found.sites) == 1 else f'{len(found.sites)} beacons'} of the map, "
            f"{found.without.law} winds",
        ]
    )
    inner, tall = map_size(scene)
    figure = style.blank_figure(style.COLUMN_WIDTH, SCALE_BELOW + tall + 0.26 + TEXT_LINE * len(heading))
    chart = map_axes(scene, style.axes_at(figure, WEST, SCALE_BELOW, inner, tall))
    draw_route(chart, scene, decomposition, plan)
    _draw_places(figure, chart, found, (WEST, SCALE_BELOW - 0.50, inner))
    for line, text in enumerate(reversed(heading)):
        style.text_at(figure, LEFT, SCALE_BELOW + tall + 0.22 + TEXT_LINE * line, text, va="bottom")
    return figure


def _draw_places(figure: Figure, chart: MapAxes, found: BeaconMap, at: tuple[float, float, float]) -> None:
    """Dots in the colour of the failure rate, the best beacons with their radius, the scale below."""
    points = found.places.at * chart.per_metre
    percent = 100.0 * np.maximum(found.failure, 0.5 / found.flights)
    low, high = float(percent.min()), float(percent.max())
    norm = LogNorm(low, high) if high > 3.0 * low else Normalize(low, max(high, low + 1e-9))
    order = np.argsort(-percent, kind="stable")  # the best on top
    x, y = points[order].T
    dots = chart.ax.scatter(
        x,
        y,
        16.0,
        percent[order],
        cmap="viridis_r",
        norm=norm,
        linewidths=0.4,
        edgecolors="white",
        zorder=6.5,
    )
    look: dict[str, Any] = {"fill": False, "edgecolor": style.BLACK, "linewidth": 1.2, "zorder": 6.8}
    for count, site in enumerate(found.sites, 1):
        x, y = points[site.number]
        chart.ax.add_patch(Circle((x, y), found.radius * chart.per_metre, **look))
        chart.ax.annotate(
            str(count), (x, y), (8.0, 6.0), textcoords="offset points", fontweight="bold", zorder=9,
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )  # fmt: skip
    ticks = np.geomspace(low, high, 4) if isinstance(norm, LogNorm) else np.linspace(low, high, 4)
    named = {tick: f"{tick:.2g}" for tick in ticks.tolist()}
    draw_scale(figure, dots, at, named, f"failures with one beacon there, {found.without.law} winds [%]")
