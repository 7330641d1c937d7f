"""The figure of ``pipelines=convergence``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, NullFormatter

from pareto_ltl.report import style
from pareto_ltl.report.rate_axes import GRID_COLOUR, scale_rate_axis
from pareto_ltl.report.study_axes import (
    BOUND_COLOUR,
    BOUND_DASHES,
    FigureRow,
    Figures,
    column_values,
    decade_above,
    decade_below,
    hide_frame,
    law_keys,
    laws_of,
    legend_at,
    quartiles,
)
from pareto_ltl.settings import Settings

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study


def convergence_figures(_: Settings, study: Study) -> Figures:
    """``figure2``."""
    return {"figure2": lambda: convergence_figure(study.tables["convergence"], study.numbers)}


def convergence_figure(rows: Sequence[FigureRow], numbers: Mapping[str, float]) -> Figure:
    """Bound and failure rate, hypervolume, and share of seeds with a plan, against vertices per tree."""
    height, inner = 2.22, 1.72
    figure = style.blank_figure(style.PAGE_WIDTH, height)
    lefts = (0.62, 0.62 + inner + 0.66, 0.62 + 2 * (inner + 0.66))
    axes = [style.axes_at(figure, left, 0.38, inner, 1.45) for left in lefts]
    some = laws_of(rows)
    one = [row for row in rows if row["law"] == some[0]]
    _bound_and_failure(axes[0], rows, one, some)
    _quartile_band(axes[1], one, "hypervolume", style.GREEN)
    axes[1].set(ylabel="hypervolume of the front")
    axes[1].set_ylim(bottom=0.0)
    _planned_share(axes[2], one)
    for ax, title in zip(axes, ("(a) selected path", "(b) front", "(c) seeds with a plan"), strict=True):
        ax.set_xscale("log")
        ax.set_xlabel("vertices per tree")
        sizes = sorted({int(row["size"]) for row in rows})
        ax.set_xticks(sizes[:: -(-len(sizes) // 5)])
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.grid(color=GRID_COLOUR, lw=0.4)
        hide_frame(ax)
        left = ax.get_position().x0 * style.PAGE_WIDTH
        style.text_at(figure, left, 1.86, title, va="bottom", fontweight="bold")
    if math.isfinite(numbers["first_seconds"]):
        text = f"first answer of a forest:\n{1e3 * numbers['first_seconds']:.2g} ms (median)"
        axes[2].text(0.97, 0.08, text, transform=axes[2].transAxes, ha="right", va="bottom", fontsize=6.5)
    name = f"bound, {one[0]['planned_law']} winds"
    keys = [
        Line2D([], [], color=BOUND_COLOUR, lw=1.4, ls=BOUND_DASHES, label=name),
        *law_keys(some, "missed, ", ms=3, lw=1.2),
        Patch(fc="#00000022", label=f"quartiles over {one[0]['seeds']} seeds"),
    ]
    legend_at(figure, keys, (0.55, height - 0.05), len(keys))
    return figure


def _bound_and_failure(
    ax: Axes, rows: Sequence[FigureRow], one: Sequence[FigureRow], laws: Sequence[str]
) -> None:
    """Mission bound and simulated mission failure of the selected paths, cut at the end of the axis."""
    values = [
        column_values(one, "mission_bound_q25"),
        *(column_values(rows, f"missed_of_a_plan{end}") for end in ("", "_q25")),
    ]
    low = decade_below(np.concatenate(values))
    _quartile_band(ax, one, "mission_bound", BOUND_COLOUR, low, marker="")
    for law in laws:
        mine = [row for row in rows if row["law"] == law]
        _quartile_band(ax, mine, "missed_of_a_plan", style.law_colour(law), low, style.law_mark(law))
    scale_rate_axis(
        ax, "y", low, decade_above(np.concatenate([*values, column_values(one, "mission_bound_q75")]))
    )
    ax.set_ylabel("mission failure [%]")
    ax.set_xlim(column_values(one, "size").min() / 1.25, column_values(one, "size").max() * 1.25)


def _quartile_band(
    ax: Axes, rows: Sequence[FigureRow], name: str, colour: str, low: float | None = None, marker: str = "o"
) -> None:
    """Median of column ``name`` as a line, its quartiles as a band."""
    x = column_values(rows, "size")
    middle, bottom, top = quartiles(rows, name, low)
    ax.fill_between(x, bottom, top, color=colour, alpha=0.18, lw=0)
    ax.plot(x, middle, color=colour, lw=1.3, marker=marker, ms=3, ls="-" if marker else BOUND_DASHES)


def _planned_share(ax: Axes, rows: Sequence[FigureRow]) -> None:
    """Share of seeds with a plan and its 95 % interval."""
    x = column_values(rows, "size")
    low, high = column_values(rows, "planned_low"), column_values(rows, "planned_high")
    ax.fill_between(x, low, high, color=style.PURPLE, alpha=0.18, lw=0)
    ax.plot(x, column_values(rows, "planned"), color=style.PURPLE, lw=1.3, marker="o", ms=3, clip_on=False)
    ax.set(ylim=(0.0, 1.0), ylabel="share (95 % interval)")
