"""The figures of ``pipelines=replanning``, ``replan_test`` and ``sitl``: rates, tracks and distances."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pareto_ltl.report import map_layers, style
from pareto_ltl.report.axes import GRID_COLOUR, FigureRow, Figures, column_values, hide_frame
from pareto_ltl.report.records import Study
from pareto_ltl.settings import Settings
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

LEFT, BASE, ROW, TOP, RIGHT = 1.2, 0.45, 0.28, 0.12, 0.22  # of the figure of replanning [in]


def replanning_figures(_: Settings, study: Study) -> Figures:
    """``replanning``."""
    return {"replanning": partial(replanning_figure, study.tables["replanning"])}


replan_test_figures = replanning_figures


def replanning_figure(rows: Sequence[FigureRow]) -> Figure:
    """One line for each way to fly, from the first at the top: failure rate and 95 % interval."""
    tall = ROW * len(rows)
    figure = style.blank_figure(style.COLUMN_WIDTH, BASE + tall + TOP)
    ax = style.axes_at(figure, LEFT, BASE, style.COLUMN_WIDTH - LEFT - RIGHT, tall)
    law = str(rows[0]["law"])
    rate, low, high = (100.0 * column_values(rows, f"failure{end}") for end in ("", "_low", "_high"))
    y = -np.arange(len(rows), dtype=float)
    ax.hlines(y, low, high, color=style.law_colour(law), lw=2.0, alpha=0.5)
    ax.plot(rate, y, ls="none", marker=style.law_mark(law), ms=4.5, color=style.law_colour(law))
    ax.set_yticks(y, [str(row["way"]).replace(", ", ",\n") for row in rows])
    ax.set_ylim(-len(rows) + 0.5, 0.5)
    ax.set_xlim(0.0, 100.0 if high.max() > 50.0 else max(1.0, 1.15 * float(high.max())))
    ax.set_xlabel(f"failed in {rows[0]['flights']} {law} winds [%]")
    ax.grid(axis="x", color=GRID_COLOUR, lw=0.4)
    hide_frame(ax)
    return figure


# --- sitl --------------------------------------------------------------------------------------


def sitl_figures(settings: Settings, study: Study, scene: Scene, decomposition: Decomposition) -> Figures:
    """The figure ``sitl``."""
    return {"sitl": lambda: sitl_figure((scene, decomposition), study, settings.sitl.drawn)}


def sitl_figure(world: tuple[Scene, Decomposition], study: Study, drawn: int) -> Figure:
    """The map with ``drawn`` tracks of each, and the distance between both at the end of every leg."""
    flown, numbers = study.pictures["flights"], study.numbers
    scene, decomposition = world
    figure = style.blank_figure(style.PAGE_WIDTH, 3.1)
    chart = map_layers.map_axes(scene, style.axes_at(figure, 0.55, 0.45, 2.9, 2.3))
    map_layers.draw_graticule(chart, scene)
    map_layers.draw_ground(chart, scene, decomposition)
    keys: list[Artist] = []
    for k, (flights, colour, words, name) in enumerate((
        (flown.steps, style.BLUE, "our steps", "sitl_steps"),
        (flown.aircraft, style.VERMILLION, "JSBSim, c172x", "sitl"),
    )):  # fmt: skip
        look: dict[str, Any] = {"colors": colour, "linewidths": 0.6, "alpha": 0.55, "zorder": 4 + k}
        map_layers.draw_lines(chart, flights.x[:drawn], **look)
        label = f"{words}: {100 * numbers[f'{name}_failure']:.1f} % fail"
        keys.insert(0, Line2D([], [], color=colour, label=label))
    map_layers.draw_endpoints(chart, scene, None)
    map_layers.name_regions(chart, scene, flown.steps.x.mean(axis=0))
    figure.legend(handles=keys, loc="upper left", bbox_to_anchor=(0.06, 1.0), ncol=2, frameon=False)
    law = flown.aircraft.law
    figure.text(0.63, 0.955, f"{len(flown.tracks)} pairs of flights, {law} winds", fontsize=7)
    ax, minutes = style.axes_at(figure, 4.25, 0.45, 2.3, 2.3), np.cumsum(flown.orders.duration) / 60.0
    for row in flown.apart:
        ax.plot(minutes, row / 1e3, color=style.MIST, lw=0.4, zorder=1)
    for share, line, label in ((0.5, "-", "median"), (0.95, "--", "95 % of flights")):
        apart = np.quantile(flown.apart, share, axis=0) / 1e3
        ax.plot(minutes, apart, color="black", lw=1.2, ls=line, label=label)
    ax.set(xlabel="time of flight [min]", ylabel="JSBSim and our steps apart [km]")
    ax.set_xlim(0.0, float(minutes[-1]))
    ax.set_ylim(bottom=0.0)
    ax.legend(loc="upper left", frameon=False)
    return figure
