"""The figure of ``pipelines=forecast_test``: reliability, regions, sharpness."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from pareto_ltl.report import style
from pareto_ltl.report.rate_axes import GRID_COLOUR
from pareto_ltl.report.study_axes import BOUND_COLOUR, FigureRow, column_values, hide_frame, save_figures
from pareto_ltl.settings import ReportConfig, preset
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study

HEIGHT, PANEL, WEST, GAP, BASE, TOP = 2.5, 1.82, 0.5, 0.52, 0.4, 0.3  # [in]
TICKS = (0.0, 0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 1.0)
EDGES = np.array([0.0, 0.01, 0.025, 0.05, 0.1, 0.175, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0])
REGION_COLOURS = (style.VERMILLION, style.GREEN, style.PURPLE)
REGION_MARKS = ("^", "D", "v")


def draw_forecast_test(folder: Path, cfg: ReportConfig, study: Study) -> tuple[Path, ...]:
    """Write ``forecast_test_F`` for each planning fidelity F; return the paths."""
    plans = study.tables["forecast_test"]
    made = {}
    for name in dict.fromkeys(row["fidelity"] for row in plans):
        promise = f"simulated_{preset(name).law}"
        bins, regions = (
            [row for row in study.tables[table] if row["fidelity"] == name and row["promise"] == promise]
            for table in ("reliability", "regions")
        )
        mine = [row for row in plans if row["fidelity"] == name]
        made[f"forecast_test_{name}"] = partial(forecast_test_figure, bins, regions, mine, promise)
    return save_figures(folder, cfg, made)


def forecast_test_figure(
    bins: Sequence[FigureRow], regions: Sequence[FigureRow], plans: Sequence[FigureRow], promise: str
) -> Figure:
    """Realised against promised failure rate, by promise and by region, and a histogram of the promises."""
    figure = style.blank_figure(style.PAGE_WIDTH, HEIGHT)
    height, law = HEIGHT - BASE - TOP, promise.partition("_")[2]
    places = [WEST + k * (PANEL + GAP) for k in range(3)]
    axes = [style.axes_at(figure, left, BASE, PANEL, height) for left in places]
    for left, title in zip(places, ("(a) by promise", "(b) by region", "(c) promises made"), strict=True):
        style.text_at(figure, left, HEIGHT - TOP + 0.08, title, va="bottom", fontweight="bold")
    colour = style.law_colour(law)
    _draw_diagonal(axes[0], law)
    axes[0].scatter(
        column_values(plans, promise), column_values(plans, "failure"), s=4, color=style.MIST, lw=0
    )
    for row in bins:
        _draw_rate(axes[0], row, colour, "o", "")
    _draw_diagonal(axes[1], law)
    for row, shade, mark in zip(regions, REGION_COLOURS, REGION_MARKS, strict=False):
        _draw_rate(axes[1], row, shade, mark, f"{row['region']} ({row['missions']})")
    axes[1].legend(
        loc="lower right", handlelength=1.0, borderaxespad=0.2, labelspacing=0.3, frameon=True,
        framealpha=0.8, edgecolor="none",
    )  # fmt: skip
    axes[0].set_ylabel("failed in the later full fields [%]")
    _draw_histogram(axes[2], column_values(plans, promise), law, colour)
    return figure


def _draw_diagonal(ax: Axes, law: str) -> None:
    """Axes of both rates, their diagonal, and the side on which a promise is broken."""
    ax.fill_between([0.0, 1.0], [0.0, 1.0], [1.0, 1.0], color=BOUND_COLOUR, alpha=0.06, lw=0)
    line = np.linspace(0.0, 1.0, 100)
    ax.plot(line, line, color=style.STONE, lw=0.8, ls=(0, (3, 2)))
    _scale(ax, "x")
    _scale(ax, "y")
    ax.grid(color=GRID_COLOUR, lw=0.4)
    ax.set_xlabel(f"promised, {law} winds [%]")
    ax.text(
        0.04, 0.96, "fails more often\nthan promised", transform=ax.transAxes, va="top", fontsize=6.0,
        color=BOUND_COLOUR, path_effects=style.white_halo(1.6), zorder=6,
    )  # fmt: skip
    hide_frame(ax)


def _scale(ax: Axes, axis: str) -> None:
    """A square-root axis of rates, on which both small and large ones can be read."""
    getattr(ax, f"set_{axis}scale")("function", functions=(_root, np.square))
    getattr(ax, f"set_{axis}lim")(0.0, 1.0)
    side = ax.xaxis if axis == "x" else ax.yaxis
    side.set_major_locator(FixedLocator(TICKS))
    side.set_minor_locator(NullLocator())
    side.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:.3g}"))


def _root(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.maximum(values, 0.0)), float)


def _draw_rate(ax: Axes, row: FigureRow, colour: str, mark: str, label: str) -> None:
    """A group of missions with the interval of its rate; hollow if its promise is broken."""
    x, y = row["promised"], row["realised"]
    ax.plot([x, x], [row["realised_low"], row["realised_high"]], color=colour, lw=1.2, zorder=3)
    face = colour if row["kept"] else "white"
    ax.plot(
        x, y, mark, mfc=face, mec=colour, ms=4.5, mew=0.9, ls="", zorder=4, clip_on=False, label=label or None
    )


def _draw_histogram(ax: Axes, promised: FloatArray, law: str, colour: str) -> None:
    counts, _ = np.histogram(promised, EDGES)
    ax.bar(EDGES[:-1], counts, np.diff(EDGES), align="edge", color=colour, alpha=0.75, lw=0.5, ec="white")
    _scale(ax, "x")
    ax.set_xlabel(f"promised, {law} winds [%]")
    ax.set_ylabel("plans")
    ax.set_ylim(0, max(1, counts.max()) * 1.05)
    hide_frame(ax)
