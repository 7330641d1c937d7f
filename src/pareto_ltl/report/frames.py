"""Simulated flights as a strip of maps, one for each of a few moments."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pareto_ltl.report import style
from pareto_ltl.report.map import shown_probability
from pareto_ltl.report.map_layers import (
    MapAxes,
    draw_endpoints,
    draw_ground,
    draw_lines,
    map_axes,
    name_regions,
)
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.windows import hours_text

EDGE, GAP, TOP, FOOT = 0.06, 0.08, 0.36, 0.20  # [in]
TAIL = 6  # steps behind a flight that are drawn


def frames_figure(scene: Scene, deployment: Deployment, times: FloatArray, frames: int, count: int) -> Figure:
    """The first ``count`` flights at ``frames`` moments, evenly spaced from soon after departure to the end.

    Parameters
    ----------
    times : (T+1,) float
        Times of the steps [s after departure].
    """
    steps = np.linspace(0, len(times) - 1, frames + 1).round().astype(int)[1:]
    inner = (style.PAGE_WIDTH - 2 * EDGE - (frames - 1) * GAP) / frames
    span = np.ptp(scene.bounds, axis=0)
    height = inner * float(np.clip(span[1] / span[0], 0.35, 1.6))
    figure = style.blank_figure(style.PAGE_WIDTH, FOOT + height + TOP)
    for k, step in enumerate(steps):
        left = EDGE + k * (inner + GAP)
        chart = map_axes(scene, style.axes_at(figure, left, FOOT, inner, height))
        chart.ax.set(xlabel="", ylabel="", xticks=[], yticks=[])
        draw_ground(chart, scene, None)
        name_regions(chart, scene, None, times=False)
        _draw_moment(chart, deployment, int(step), count)
        draw_endpoints(chart, scene, None)
        when = f"{hours_text(float(times[step]))} after departure"
        style.text_at(figure, left, FOOT + height + 0.04, when, va="bottom")
    _write_heading(figure, deployment, count, FOOT + height + 0.20)
    _write_foot(figure, scene, deployment, count)
    return figure


def _draw_moment(chart: MapAxes, deployment: Deployment, step: int, count: int) -> None:
    """Tails and positions of the flights at ``step``; failing flights are dark, with a cross."""
    x, failed = deployment.x[:count, : step + 1], deployment.failed[:count]
    for lost, colour, mark, size in (
        (False, style.law_colour(deployment.law), "o", 1.0),
        (True, style.FAILED, "x", 2.4),
    ):
        flights = x[failed == lost]
        draw_lines(chart, flights, colors=colour, linewidths=0.25, alpha=0.25, zorder=4)
        draw_lines(chart, flights[:, -TAIL:], colors=colour, linewidths=0.4, alpha=0.7, zorder=4.5)
        places = flights[:, -1] * chart.per_metre
        chart.ax.plot(*places.T, mark, color=colour, ms=size, mew=0.6, zorder=6 + lost)


def _write_heading(figure: Figure, deployment: Deployment, count: int, bottom: float) -> None:
    shown, law = deployment.failed[:count], deployment.law
    rate = shown_probability(float(deployment.failed.mean()))
    text = f"{len(shown):,} of {len(deployment.failed):,} simulated flights of one plan, {law} winds"
    text += f"; {int(shown.sum())} of those drawn fail, {rate} of all"
    style.text_at(figure, EDGE, bottom, text, va="bottom", fontweight="bold")


def _write_foot(figure: Figure, scene: Scene, deployment: Deployment, count: int) -> None:
    law = deployment.law
    width = float(np.ptp(scene.bounds[:, 0]))
    keys = [
        Line2D([], [], color=style.law_colour(law), marker="o", ms=2.4, lw=0.6, label="flight"),
        Line2D([], [], color=style.FAILED, marker="x", ms=3.2, mew=0.7, lw=0.6, label="flight that fails"),
    ]
    keys = keys if deployment.failed[:count].any() else keys[:1]
    w, h = figure.get_size_inches()
    figure.legend(
        handles=keys, ncols=2, loc="lower left", bbox_to_anchor=(EDGE / w, 0.03 / h),
        borderaxespad=0.0, borderpad=0.0, columnspacing=1.2, handlelength=1.6,
    )  # fmt: skip
    style.text_at(
        figure,
        w - EDGE,
        0.05,
        f"each map is {distance_text(width, 0)} wide",
        va="bottom",
        ha="right",
        fontsize=6.5,
    )
