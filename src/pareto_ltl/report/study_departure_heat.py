"""The heat map of ``pipelines=departure``: failure against departure and length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import NullLocator

from pareto_ltl.report import style
from pareto_ltl.report.rate_axes import set_rate_ticks
from pareto_ltl.report.study_axes import LOWEST_RATE, FigureRow
from pareto_ltl.support.arrays import FloatArray

LEFT, BASE, ROW, TOP = 0.52, 0.62, 0.17, 0.42  # [in]
BAR, GAP, RIGHT = 0.1, 0.12, 0.45  # [in]
MARK, WORDS = 0.08, 0.2  # height of marks and of their meaning above the map [in]
COLOURS = "cividis_r"  # light: few failures; the same to all kinds of colour vision
LEAST_CELL = 0.33  # width of a cell [in] that its number fits into
MOST_COLUMN = 0.62  # [in]
DARK = 0.53  # luminance below which numbers are white
SECONDS_PER_HOUR = 3600.0


def heat_figure(rows: Sequence[FigureRow], limits: FloatArray, rates: FloatArray) -> Figure:
    """Failure rates (starts, G) of the starts ``rows`` at the lengths ``limits`` (G,) [m].

    A cell without a path is blank. The number of the start that fails least at a length is bold.
    """
    space = style.PAGE_WIDTH - LEFT - GAP - BAR - RIGHT
    width = min(space, MOST_COLUMN * len(rows))
    height = ROW * len(limits)
    figure = style.blank_figure(LEFT + width + GAP + BAR + RIGHT, BASE + height + TOP)
    ax = style.axes_at(figure, LEFT, BASE, width, height)
    norm = _scale(rates)
    edges = np.arange(len(rows) + 1) - 0.5, _edges(limits / 1e3)
    mesh = ax.pcolormesh(*edges, np.ma.masked_invalid(rates.T), norm=norm, cmap=COLOURS, rasterized=True)
    if width / len(rows) >= LEAST_CELL:
        _write_numbers(ax, limits, rates, norm)
    _mark_starts(ax, rows, edges[1])
    _name_axes(ax, rows, limits)
    bar = figure.colorbar(mesh, cax=style.axes_at(figure, LEFT + width + GAP, BASE, BAR, height))
    bar.outline.set_visible(False)
    set_rate_ticks(bar.ax.yaxis, float(norm.vmin or 0.0), float(norm.vmax or 1.0), hidden=False)
    bar.ax.yaxis.set_minor_locator(NullLocator())
    law = next(str(row["law"]) for row in rows if row["planned"])
    bar.set_label(f"failed flights [%], {law} winds")
    return figure


def _scale(rates: FloatArray) -> LogNorm:
    known = rates[np.isfinite(rates)]
    low = max(float(known.min(initial=1.0)), LOWEST_RATE)
    return LogNorm(low, max(float(known.max(initial=0.0)), 1.5 * low))


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


def _name_axes(ax: Axes, rows: Sequence[FigureRow], limits: FloatArray) -> None:
    stride = max(1, math.ceil(0.3 * len(rows) / max(ax.figure.get_figwidth() - 1.2, 1.0)))  # type: ignore[union-attr]
    shown = range(0, len(rows), stride)
    ax.set_xticks(shown, clock_labels([rows[k]["time"] for k in shown]))
    ax.tick_params(length=0)
    ax.set_yticks(limits[::2] / 1e3, [f"{limit / 1e3:,g}" for limit in limits[::2]])
    ax.spines[:].set_visible(False)
    ax.set_xlabel("departure, UTC")
    ax.set_ylabel("length [km]")
    ax.text(
        0.0, 1.0 + WORDS / (ROW * len(limits)),
        "◆ recommended   ○ no difference beyond the noise   bold: least at this length",
        transform=ax.transAxes, fontsize=6.2, va="bottom",
    )  # fmt: skip
