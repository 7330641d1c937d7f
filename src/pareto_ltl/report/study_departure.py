"""The figure of ``pipelines=departure``: failure, length and wind against the departure, and the routes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from pareto_ltl.report import style
from pareto_ltl.report.map_labels import dense_path
from pareto_ltl.report.map_layers import (
    draw_endpoints,
    draw_graticule,
    draw_ground,
    map_axes,
    name_regions,
    number_obstacles,
)
from pareto_ltl.report.rate_axes import GRID_COLOUR
from pareto_ltl.report.study_axes import FigureRow, Figures, column_values, hide_frame
from pareto_ltl.report.study_departure_heat import clock_labels, heat_figure
from pareto_ltl.settings import Settings
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study

LEFT, PANEL, MAP, GAP = 0.52, 2.85, 2.75, 0.62  # [in] across
BASE, HEIGHT, SPACE, TOP = 0.62, 0.95, 0.3, 0.24  # [in] up
MOST_TICKS = 7
RATIO_TICKS = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
HOUR = 3600.0


def departure_figures(_: Settings, study: Study, scene: Scene, decomposition: Decomposition) -> Figures:
    """``departures`` and ``departures_heat``."""
    rows, routes, limits, rates = (study.pictures[name] for name in ("rows", "routes", "limits", "rates"))
    return {
        "departures": lambda: departure_figure(scene, decomposition, rows, routes),
        "departures_heat": lambda: heat_figure(rows, limits, rates),
    }


def departure_figure(
    scene: Scene, decomposition: Decomposition, rows: Sequence[FigureRow], routes: Mapping[float, FloatArray]
) -> Figure:
    """Three panels over the time of departure, and a map of the routes in the colours of their departures."""
    total = BASE + 3 * HEIGHT + 2 * SPACE + TOP
    figure = style.blank_figure(style.PAGE_WIDTH, total)
    axes = [style.axes_at(figure, LEFT, BASE + k * (HEIGHT + SPACE), PANEL, HEIGHT) for k in (2, 1, 0)]
    titles = (
        f"(a) failure at equal length, {_law(rows)} winds",
        "(b) length of the plan",
        "(c) wind along the route",
    )
    for ax, title in zip(axes, titles, strict=True):
        ax.set_title(title, loc="left", fontweight="bold", pad=3.0)
        _time_axis(ax, rows, named=ax is axes[-1])
    planned = [row for row in rows if row["planned"]]
    _draw_failure(axes[0], planned)
    _draw_length(axes[1], planned)
    _draw_wind(axes[2], planned)
    for row in rows:
        if not row["planned"]:
            for ax in axes:
                ax.axvspan(*_slot(rows, row), color=style.MIST, alpha=0.25, lw=0, zorder=0)
    _draw_routes(figure, total, scene, decomposition, rows, routes)
    return figure


def _law(rows: Sequence[FigureRow]) -> str:
    """The wind law of the flights."""
    return next(str(row["law"]) for row in rows if row["planned"])


def _hours(rows: Sequence[FigureRow]) -> FloatArray:
    """Departures [h since 1970]."""
    return column_values(rows, "time") / HOUR


def _slot(rows: Sequence[FigureRow], row: FigureRow) -> tuple[float, float]:
    """The interval of the time axis around one departure [h]."""
    at, half = row["time"] / HOUR, 0.5 * _pitch(rows)
    return at - half, at + half


def _pitch(rows: Sequence[FigureRow]) -> float:
    """Least time between two departures [h]."""
    return float(np.diff(_hours(rows)).min()) if len(rows) > 1 else 3.0


def _time_axis(ax: Axes, rows: Sequence[FigureRow], *, named: bool) -> None:
    """Ticks at departures, with the day below where it changes."""
    hours = _hours(rows)
    ax.set_xlim(hours[0] - 0.5 * _pitch(rows), hours[-1] + 0.5 * _pitch(rows))
    shown = rows[:: -(-len(rows) // MOST_TICKS)]
    labels = clock_labels([row["time"] for row in shown])
    ax.set_xticks(_hours(shown), labels if named else [""] * len(shown))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.grid(color=GRID_COLOUR, lw=0.4)
    if named:
        ax.set_xlabel("departure, UTC")
    hide_frame(ax)


def _draw_failure(ax: Axes, rows: Sequence[FigureRow]) -> None:
    """Ratios to the best start with intervals, hollow where there is no difference beyond the noise."""
    hours, colour = _hours(rows), style.law_colour(_law(rows))
    low, high = (column_values(rows, f"ratio_{end}") for end in ("low", "high"))
    ax.vlines(hours, low, high, color=colour, lw=1.4)
    ax.axhline(1.0, color=style.STONE, lw=0.6)
    for row in rows:
        good, best = row["as_good"], row["recommended"]
        ax.plot(
            row["time"] / HOUR, row["ratio"], "D" if best else "o", mec=colour, ms=5.5 if best else 4,
            mfc=colour if best or not good else "white", mew=0.9, zorder=4, clip_on=False,
        )  # fmt: skip
    ratios = column_values(rows, "ratio")
    least = max(float(np.nanmin(low)), 0.1)
    ax.set_yscale("log")
    ax.set_ylim(0.8 * least, 1.25 * min(float(np.nanmax(high)), 10.0 * float(np.nanmax(ratios))))
    ticks = [tick for tick in RATIO_TICKS if ax.get_ylim()[0] <= tick <= ax.get_ylim()[1]]
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_ylabel("failure, best = 1")


def _draw_length(ax: Axes, rows: Sequence[FigureRow]) -> None:
    length = column_values(rows, "length_m") / 1e3
    ax.plot(_hours(rows), length, "o-", color=style.GREEN, ms=3.5, lw=0.9)
    spread = max(float(np.ptp(length)), 0.05 * float(length.max()))
    ax.set_ylim(float(length.min()) - 0.35 * spread, float(length.max()) + 0.35 * spread)
    ax.set_ylabel("length [km]")


def _draw_wind(ax: Axes, rows: Sequence[FigureRow]) -> None:
    """Mean speed, tail wind and standard deviation, each named at its last point."""
    hours = _hours(rows)
    lines = (
        ("wind_speed", "speed", style.SKY, "o"),
        ("tail_wind", "from behind", style.BLUE, "^"),
        ("wind_sd", "sd", style.VERMILLION, "s"),
    )
    for name, label, colour, mark in lines:
        ax.plot(hours, column_values(rows, name), f"{mark}-", color=colour, ms=3.2, lw=0.9, label=label)
    ax.axhline(0.0, color=style.STONE, lw=0.6)
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.3 * (high - low))
    ax.legend(loc="upper left", ncols=3, handlelength=1.4, columnspacing=1.0, borderaxespad=0.0)
    ax.set_ylabel("wind [m/s]")


def _draw_routes(
    figure: Figure, total: float, scene: Scene, decomposition: Decomposition, rows: Sequence[FigureRow],
    routes: Mapping[float, FloatArray],
) -> None:  # fmt: skip
    """The map; the recommended route is drawn last and wide, the others from light (early) to dark (late)."""
    import matplotlib

    left = LEFT + PANEL + GAP
    size = np.ptp(scene.bounds, axis=0)
    height = min(MAP * float(size[1] / size[0]), total - BASE - TOP - 0.25)
    bottom = total - TOP - 0.12 - height
    chart = map_axes(scene, style.axes_at(figure, left, bottom, MAP, height))
    draw_graticule(chart, scene)
    draw_ground(chart, scene, decomposition)
    number_obstacles(chart, scene, "white")
    shades = matplotlib.colormaps["viridis"](np.linspace(0.92, 0.08, max(len(routes), 1)))
    best = next(row["time"] for row in rows if row["recommended"])
    keys = []
    for shade, (time, x) in zip(shades, sorted(routes.items()), strict=True):
        wide = time == best
        chart.ax.plot(
            *x.T, color=shade, lw=2.2 if wide else 1.0, zorder=7 if wide else 6,
            path_effects=style.white_halo(3.4 if wide else 1.8), solid_joinstyle="round",
        )  # fmt: skip
        name = datetime.fromtimestamp(time, UTC).strftime("%d %HZ" if time % HOUR == 0 else "%d %H:%MZ")
        keys.append(
            Line2D([], [], color=shade, lw=2.2 if wide else 1.2, label=name + (" best" if wide else ""))
        )
    draw_endpoints(chart, scene, None)
    taken = np.concatenate([dense_path(x) for x in routes.values()])
    name_regions(chart, scene, taken, times=False)
    w, h = figure.get_size_inches()
    figure.legend(
        handles=keys[:12], ncols=4, loc="upper left", bbox_to_anchor=(left / w, (bottom - 0.36) / h),
        borderaxespad=0.0, handlelength=1.4, columnspacing=1.0,
    )  # fmt: skip
    _name_marks(figure)


def _name_marks(figure: Figure) -> None:
    """Write the meaning of the marks of the first panel below all panels."""
    text = "◆ recommended   ○ no difference beyond the noise   ● fails more   grey: no plan"
    style.text_at(figure, LEFT, 0.06, text, va="bottom", fontsize=6.2)
