"""The figure of ``pipelines=sitl``: tracks of JSBSim's aircraft and of our steps, and their distance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pareto_ltl.report import style
from pareto_ltl.report.map_layers import (
    draw_endpoints,
    draw_graticule,
    draw_ground,
    draw_lines,
    map_axes,
    name_regions,
)
from pareto_ltl.report.study_axes import Figures
from pareto_ltl.settings import Settings

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study
    from pareto_ltl.world.cells import Decomposition
    from pareto_ltl.world.scene import Scene

STEPS_LOOK: dict[str, Any] = {"colors": style.BLUE, "linewidths": 0.6, "alpha": 0.55, "zorder": 4}
AIRCRAFT_LOOK: dict[str, Any] = {"colors": style.VERMILLION, "linewidths": 0.6, "alpha": 0.55, "zorder": 5}
SHARES = (0.5, 0.95)


def sitl_figures(settings: Settings, study: Study, scene: Scene, decomposition: Decomposition) -> Figures:
    """The figure ``sitl``."""
    return {"sitl": lambda: sitl_figure((scene, decomposition), study, settings.sitl.drawn)}


def sitl_figure(world: tuple[Scene, Decomposition], study: Study, drawn: int) -> Figure:
    """The map with ``drawn`` tracks of each, and the distance between both at the end of every leg."""
    flown, numbers = study.pictures["flights"], study.numbers
    scene, decomposition = world
    figure = style.blank_figure(style.PAGE_WIDTH, 3.1)
    chart = map_axes(scene, style.axes_at(figure, 0.55, 0.45, 2.9, 2.3))
    draw_graticule(chart, scene)
    draw_ground(chart, scene, decomposition)
    draw_lines(chart, flown.steps.x[:drawn], **STEPS_LOOK)
    draw_lines(chart, flown.aircraft.x[:drawn], **AIRCRAFT_LOOK)
    draw_endpoints(chart, scene, None)
    name_regions(chart, scene, flown.steps.x.mean(axis=0))
    rates = [f"{100 * numbers[f'{name}_failure']:.1f} %" for name in ("sitl", "sitl_steps")]
    keys = [
        Line2D([], [], color=style.VERMILLION, label=f"JSBSim, c172x: {rates[0]} fail"),
        Line2D([], [], color=style.BLUE, label=f"our steps: {rates[1]} fail"),
    ]
    figure.legend(handles=keys, loc="upper left", bbox_to_anchor=(0.06, 1.0), ncol=2, frameon=False)
    _draw_distances(style.axes_at(figure, 4.25, 0.45, 2.3, 2.3), flown.apart, flown.orders.duration)
    law = flown.aircraft.law
    figure.text(0.63, 0.955, f"{len(flown.tracks)} pairs of flights, {law} winds", fontsize=7)
    return figure


def _draw_distances(ax: Axes, apart: np.ndarray[Any, Any], duration: np.ndarray[Any, Any]) -> None:
    minutes = np.cumsum(duration) / 60.0
    for row in apart:
        ax.plot(minutes, row / 1e3, color=style.MIST, lw=0.4, zorder=1)
    for share, line in zip(SHARES, ("-", "--"), strict=True):
        label = "median" if share == 0.5 else f"{100 * share:.0f} % of flights"
        ax.plot(minutes, np.quantile(apart, share, axis=0) / 1e3, color="black", lw=1.2, ls=line, label=label)
    ax.set(xlabel="time of flight [min]", ylabel="JSBSim and our steps apart [km]")
    ax.set_xlim(0.0, float(minutes[-1]))
    ax.set_ylim(bottom=0.0)
    ax.legend(loc="upper left", frameon=False)
