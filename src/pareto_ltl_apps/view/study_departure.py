"""The figures of ``pipelines=departure``: numbers over the departure, routes, and a heat map over lengths."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import NullLocator

from pareto_ltl import Scene, Settings
from pareto_ltl.extend import Decomposition, Study
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import map_layers, style
from pareto_ltl_apps.view.axes import (
    GRID_COLOUR,
    LOWEST_RATE,
    FigureRow,
    Figures,
    column_values,
    hide_frame,
    set_rate_ticks,
)
from pareto_ltl_apps.view.land import draw_land

LEFT, BASE = 0.52, 0.62  # [in] of both figures
PANEL, MAP, GAP = 2.85, 2.75, 0.62  # [in] across
HEIGHT, SPACE, TOP = 0.95, 0.3, 0.24  # [in] up
MAX_TICKS = 7
RATIO_TICKS = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
MARKS = "◆ recommended   ○ no difference beyond the noise   "
SHORT_MARKS = "◆ recommended   ○ as good   bold: least"
HOUR = 3600.0
ROW, HEAT_TOP = 0.17, 0.42  # [in] of the heat map
BAR, BAR_GAP, RIGHT = 0.1, 0.12, 0.45  # [in]
MARK, WORDS = 0.08, 0.2  # height of marks and of their meaning above the heat map [in]
COLOURS = "cividis_r"  # light: few failures; the same to all kinds of colour vision
LEAST_CELL = 0.33  # width of a cell [in] that its number fits into
MAX_COLUMN = 0.62  # [in]
DARK = 0.53  # luminance below which numbers are white


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
    half = 0.5 * _pitch(rows)
    for at in [row["time"] / HOUR for row in rows if not row["planned"]]:
        for ax in axes:
            ax.axvspan(at - half, at + half, color=style.MIST, alpha=0.25, lw=0, zorder=0)
    _draw_routes(figure, total, scene, decomposition, rows, routes)
    style.text_at(figure, LEFT, 0.06, f"{MARKS}● fails more   grey: no plan", va="bottom", fontsize=6.2)
    return figure


def _law(rows: Sequence[FigureRow]) -> str:
    """The wind law of the flights."""
    return next(str(row["law"]) for row in rows if row["planned"])


def _hours(rows: Sequence[FigureRow]) -> FloatArray:
    """Departures [h since 1970]."""
    return column_values(rows, "time") / HOUR


def _pitch(rows: Sequence[FigureRow]) -> float:
    """Least time between two departures [h]."""
    return float(np.diff(_hours(rows)).min()) if len(rows) > 1 else 3.0


def _time_axis(ax: Axes, rows: Sequence[FigureRow], *, named: bool) -> None:
    """Ticks at departures, with the day below where it changes."""
    hours = _hours(rows)
    ax.set_xlim(hours[0] - 0.5 * _pitch(rows), hours[-1] + 0.5 * _pitch(rows))
    shown = rows[:: -(-len(rows) // MAX_TICKS)]
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
    left = LEFT + PANEL + GAP
    size = np.ptp(scene.bounds, axis=0)
    height = min(MAP * float(size[1] / size[0]), total - BASE - TOP - 0.25)
    bottom = total - TOP - 0.12 - height
    chart = map_layers.map_axes(scene, style.axes_at(figure, left, bottom, MAP, height))
    map_layers.draw_graticule(chart, scene)
    draw_land(chart, scene)
    map_layers.draw_ground(chart, scene, decomposition)
    map_layers.number_obstacles(chart, scene)
    shades = matplotlib.colormaps["viridis"](np.linspace(0.92, 0.08, max(len(routes), 1)))
    best = next(row["time"] for row in rows if row["recommended"])
    keys = []
    for shade, (time, x) in zip(shades, sorted(routes.items()), strict=True):
        wide = time == best
        chart.plot(
            *x.T, color=shade, lw=2.2 if wide else 1.0, zorder=7 if wide else 6,
            path_effects=style.white_halo(3.4 if wide else 1.8), solid_joinstyle="round",
        )  # fmt: skip
        name = datetime.fromtimestamp(time, UTC).strftime("%d %HZ" if time % HOUR == 0 else "%d %H:%MZ")
        label, width = (f"{name} best", 2.2) if wide else (name, 1.2)
        keys.append(Line2D([], [], color=shade, lw=width, label=label))
    map_layers.draw_endpoints(chart, scene, None)
    taken = np.concatenate([map_layers.dense_path(x) for x in routes.values()])
    map_layers.name_regions(chart, scene, taken, times=False)
    w, h = figure.get_size_inches()
    figure.legend(
        handles=keys[:12], ncols=4, loc="upper left", bbox_to_anchor=(left / w, (bottom - 0.36) / h),
        borderaxespad=0.0, handlelength=1.4, columnspacing=1.0,
    )  # fmt: skip


# --- the heat map ----------------------------------------------------------------------------


def heat_figure(
    rows: Sequence[FigureRow], limits: FloatArray, rates: FloatArray, names: Sequence[str] | None = None
) -> Figure:
    """Failure rates (starts, G) of the starts ``rows`` at the lengths ``limits`` (G,) [m].

    A cell without a path is blank. The number of the start that fails least at a length is bold. ``names``
    are the names of the columns, if they are levels instead of starts.
    """
    space = style.PAGE_WIDTH - LEFT - BAR_GAP - BAR - RIGHT
    width = min(space, MAX_COLUMN * len(rows))
    height = ROW * len(limits)
    figure = style.blank_figure(LEFT + width + BAR_GAP + BAR + RIGHT, BASE + height + HEAT_TOP)
    ax = style.axes_at(figure, LEFT, BASE, width, height)
    known = rates[np.isfinite(rates)]
    low = max(float(known.min(initial=1.0)), LOWEST_RATE)
    norm = LogNorm(low, max(float(known.max(initial=0.0)), 1.5 * low))
    edges = np.arange(len(rows) + 1) - 0.5, _edges(limits / 1e3)
    mesh = ax.pcolormesh(*edges, np.ma.masked_invalid(rates.T), norm=norm, cmap=COLOURS, rasterized=True)
    if width / len(rows) >= LEAST_CELL:
        _write_numbers(ax, limits, rates, norm)
    _mark_starts(ax, rows, edges[1])
    _name_axes(ax, rows, limits, names)
    bar = figure.colorbar(mesh, cax=style.axes_at(figure, LEFT + width + BAR_GAP, BASE, BAR, height))
    bar.outline.set_visible(False)
    set_rate_ticks(bar.ax.yaxis, low, float(norm.vmax or 1.0), hidden=False)
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.set_label(f"failed flights [%], {_law(rows)} winds")
    return figure


def _edges(values: FloatArray) -> FloatArray:
    """Edges of cells around increasing ``values``."""
    half = 0.5 * float(np.diff(values).min()) if len(values) > 1 else 0.5
    return np.append(values - half, values[-1] + half)


def _write_numbers(ax: Axes, limits: FloatArray, rates: FloatArray, norm: LogNorm) -> None:
    """The rate of each cell in per cent; bold where no other start fails less."""
    colours = matplotlib.colormaps[COLOURS]
    least = np.nanmin(np.where(np.isfinite(rates), rates, np.inf), axis=0)
    for (k, g), rate in np.ndenumerate(rates):
        if not math.isfinite(rate):
            continue
        dark = float(np.dot(colours(norm(rate))[:3], (0.299, 0.587, 0.114))) < DARK
        ax.text(
            k, float(limits[g]) / 1e3, _percent(rate), ha="center", va="center_baseline", fontsize=6.0,
            color="white" if dark else style.INK, fontweight="bold" if rate <= least[g] else "normal",
        )  # fmt: skip


def _percent(rate: float) -> str:
    percent = 100.0 * rate
    digits = 0 if percent >= 9.95 else 1 if percent >= 0.995 else 2
    return f"{percent:.{digits}f}"


def _mark_starts(ax: Axes, rows: Sequence[FigureRow], edges: FloatArray) -> None:
    """A frame around the recommended start, marks above it and equal ones, reasons for empty columns."""
    low, high, cells = float(edges[0]), float(edges[-1]), len(edges) - 1
    for k, row in enumerate(rows):
        if row["recommended"]:
            ax.add_patch(
                Rectangle((k - 0.5, low), 1.0, high - low, fill=False, ec=style.VERMILLION, lw=1.6,
                          clip_on=False, zorder=5)
            )  # fmt: skip
        if row["as_good"]:
            ax.plot(
                k, 1.0 + MARK / (ROW * cells), "D" if row["recommended"] else "o",
                transform=ax.get_xaxis_transform(),
                mfc=style.VERMILLION if row["recommended"] else "white", mec=style.VERMILLION, ms=4.5,
                mew=0.9, clip_on=False,
            )  # fmt: skip
        if not row["planned"]:
            ax.text(k, 0.5 * (low + high), "no plan", rotation=90, ha="center", va="center",
                    color=style.STONE, fontsize=6.5)  # fmt: skip
    ax.set_xlim(-0.5, len(rows) - 0.5)
    ax.set_ylim(low, high)


def clock_labels(times: Sequence[float]) -> list[str]:
    """Hours in UTC of ``times`` [s since 1970], with the day below the first of each day."""
    labels, before = [], ""
    for time in (datetime.fromtimestamp(t, UTC) for t in times):
        clock, day = time.strftime("%HZ" if time.minute == 0 else "%H:%MZ"), f"{time.day} {time:%b}"
        labels.append(clock if day == before else f"{clock}\n{day}")
        before = day
    return labels


def _name_axes(
    ax: Axes, rows: Sequence[FigureRow], limits: FloatArray, names: Sequence[str] | None = None
) -> None:
    stride = max(1, math.ceil(0.3 * len(rows) / max(ax.figure.get_figwidth() - 1.2, 1.0)))  # type: ignore[union-attr]
    shown = range(0, len(rows), stride)
    labels = clock_labels([rows[k]["time"] for k in shown]) if names is None else [names[k] for k in shown]
    ax.set_xticks(shown, labels)
    ax.tick_params(length=0)
    ax.set_yticks(limits[::2] / 1e3, [f"{limit / 1e3:,g}" for limit in limits[::2]])
    ax.spines[:].set_visible(False)
    ax.set_xlabel("departure, UTC" if names is None else "level")
    ax.set_ylabel("length [km]")
    ax.text(
        0.0, 1.0 + WORDS / (ROW * len(limits)),
        f"{MARKS}bold: least at this length" if names is None else SHORT_MARKS,
        transform=ax.transAxes, fontsize=6.2, va="bottom",
    )  # fmt: skip
