"""The figure of a watched flight: the map with the believed track, and the promise of the rest over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from pareto_ltl.planning.records import Plan
from pareto_ltl.report import style
from pareto_ltl.report.map import LEFT, TEXT_LINE, WEST, draw_route, fitted_heading, map_size
from pareto_ltl.report.map_layers import MapAxes, map_axes
from pareto_ltl.report.rate_axes import scale_rate_axis
from pareto_ltl.support.display import probability_text
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

CHART, BETWEEN, FOOT = 1.15, 0.62, 0.45  # heights of the chart, of the gap above it, below it [in]
MOST = 12  # ellipses that are drawn
LEAST = 1e-4  # smaller rates are drawn here

Event = Mapping[str, Any]


def watch_figure(scene: Scene, decomposition: Decomposition, plan: Plan, events: Sequence[Event]) -> Figure:
    """Map with the plan and the believed track, and the failure rate of the rest over time."""
    status = [event for event in events if event["event"] in ("status", "end")]
    law, promised = status[-1]["law"], status[-1]["promised"]
    heading = fitted_heading([
        f"Flight of {plan.formula}, watched until {status[-1]['time'] / 3600:.2f} h",
        f"{probability_text(status[-1]['failure'])} of the flights of the rest fail, {law} winds"
        + ("" if promised is None else f"; promised at departure {probability_text(promised)}"),
    ])  # fmt: skip
    inner, tall = map_size(scene)
    base = FOOT + CHART + BETWEEN
    figure = style.blank_figure(style.COLUMN_WIDTH, base + tall + 0.26 + TEXT_LINE * len(heading))
    chart = map_axes(scene, style.axes_at(figure, WEST, base, inner, tall))
    draw_route(chart, scene, decomposition, plan)
    _draw_track(chart, events, status)
    for line, text in enumerate(reversed(heading)):
        style.text_at(figure, LEFT, base + tall + 0.22 + TEXT_LINE * line, text, va="bottom")
    _draw_promise(style.axes_at(figure, WEST + 0.1, FOOT, inner - 0.1, CHART), events, status, promised)
    return figure


def _draw_track(chart: MapAxes, events: Sequence[Event], status: Sequence[Event]) -> None:
    """The believed positions with ellipses of 95 %, and the position fixes."""
    track = chart.per_metre * np.array([[event["x"], event["y"]] for event in status])
    chart.ax.plot(*track.T, color=style.ORANGE, linewidth=1.4, zorder=7, label="believed")
    for event in status[:: -(-len(status) // MOST)]:
        chart.ax.add_patch(
            Ellipse(
                (chart.per_metre * event["x"], chart.per_metre * event["y"]),
                2.0 * chart.per_metre * event["major"], 2.0 * chart.per_metre * event["minor"],
                angle=np.degrees(event["angle"]), facecolor=style.ORANGE, alpha=0.25, linewidth=0, zorder=6.6,
            )
        )  # fmt: skip
    for use, marker in (("learnt", "P"), ("restarted", "P"), ("refused", "X")):
        fixes = [event["place"] for event in events if event["event"] == "fix" and event["use"] == use]
        if fixes:
            x, y = chart.per_metre * np.array(fixes).T
            colour = style.VERMILLION if use == "refused" else style.GREEN
            chart.ax.scatter(
                x, y, 24.0, color=colour, marker=marker, edgecolors="white", linewidths=0.5, zorder=8
            )


def _draw_promise(ax: Any, events: Sequence[Event], status: Sequence[Event], promised: float | None) -> None:
    hours = np.array([event["time"] for event in status]) / 3600.0
    given = np.array([[event[key] for event in status] for key in ("failure", "low", "high")])
    rates = np.maximum(given, LEAST)
    ax.fill_between(hours, rates[1], rates[2], color=style.ORANGE, alpha=0.25, linewidth=0)
    ax.plot(hours, rates[0], color=style.ORANGE, linewidth=1.4)
    if promised is not None:
        ax.axhline(max(promised, LEAST), color=style.BLACK, linewidth=0.8, linestyle=(0, (4, 2)))
    for event in events:
        if event["event"] == "fix":
            ax.axvline(event["time"] / 3600.0, color=style.GREEN, linewidth=0.8)
        elif event["event"] == "alarm":
            ax.axvline(event["time"] / 3600.0, color=style.VERMILLION, linewidth=0.8, linestyle=":")
    shown = rates if promised is None else np.append(rates, max(promised, LEAST))
    low = 10.0 ** np.floor(np.log10(shown.min()))
    scale_rate_axis(ax, "y", low, min(1.0, 1.5 * shown.max()), hidden=bool((given[0] < LEAST).any()))
    ax.set(xlabel="time after departure [h]", ylabel="rest fails [%]", xlim=(0.0, max(hours[-1], 1e-3)))
