"""The figures of ``pipelines=ablation``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator

from pareto_ltl.report import style
from pareto_ltl.report.rate_axes import scale_rate_axis
from pareto_ltl.report.study_axes import (
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
from pareto_ltl.settings.studies import FACTOR_TITLES
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study

FACTOR_LABELS = FACTOR_TITLES | {
    "epsilon": "ε, collision probability of a step",
    "kernel": "kernel of the wind regression",
}
LOG_FACTORS = ("trees", "epsilon", "n_max", "dt")


def ablation_figures(_: Settings, study: Study) -> Figures:
    """One figure per factor, and ``ablation`` with all factors."""
    rows = study.tables["ablation"]
    factors = list(dict.fromkeys(row["factor"] for row in rows))
    made: Figures = {f"ablation_{factor}": partial(ablation_figure, rows, [factor]) for factor in factors}
    if len(factors) > 1:
        made["ablation"] = partial(ablation_figure, rows, factors)
    return made


def ablation_figure(rows: Sequence[FigureRow], factors: Sequence[str]) -> Figure:
    """Medians of failure rate and bound with quartiles over seeds, one panel per factor."""
    columns = min(4, len(factors))
    lines = -(-len(factors) // columns)
    width = style.PAGE_WIDTH if columns > 1 else style.COLUMN_WIDTH
    gap, west, tall = 0.20, 0.62, 1.30
    inner = (width - west - 0.1 - (columns - 1) * gap) / columns
    height = lines * (tall + 0.52) + 0.42
    figure = style.blank_figure(width, height)
    seen = [
        column_values(rows, f"{name}{end}") for name in ("failure_of_a_plan", "bound") for end in ("", "_q75")
    ]
    low, high = decade_below(np.concatenate(seen[::2])), decade_above(np.concatenate(seen))
    for k, factor in enumerate(factors):
        left = west + (k % columns) * (inner + gap)
        bottom = height - 0.42 - (k // columns + 1) * (tall + 0.52) + 0.52 - 0.10
        ax = style.axes_at(figure, left, bottom, inner, tall)
        _draw_factor(ax, [row for row in rows if row["factor"] == factor], factor, low, high)
        if k % columns:
            ax.tick_params(labelleft=False)
        else:
            ax.set_ylabel("failed, bound [%]")
    keys = law_keys(laws_of(rows), "failed, ", ms=3.5, lw=1.2)
    keys += [Line2D([], [], color=style.STONE, lw=1.0, ls=BOUND_DASHES, label="bound (V + R)")]
    keys += [Line2D([], [], color=style.STONE, lw=2.5, alpha=0.5, label="quartiles over seeds")]
    legend_at(figure, keys, (west - 0.05, height - 0.05), len(keys) if columns > 1 else 2)
    return figure


def _draw_factor(ax: Axes, rows: Sequence[FigureRow], factor: str, low: float, high: float) -> None:
    """Failure rate and bound against the values of one factor; a factor with names gets equal steps."""
    laws = laws_of(rows)
    one = [row for row in rows if row["law"] == laws[0]]
    named = isinstance(one[0]["shown"], str)
    x = np.arange(len(one), dtype=float) if named or factor == "beta" else column_values(one, "shown")
    for law in laws:
        mine = [row for row in rows if row["law"] == law]
        colour = style.law_colour(law)
        ax.plot(x, np.clip(column_values(mine, "bound"), low, high), color=colour, lw=1.0, ls=BOUND_DASHES)
        _quartile_bars(ax, x, mine, "failure_of_a_plan", law, low)
    if factor in LOG_FACTORS:
        ax.set_xscale("log")
        ax.xaxis.set_minor_locator(FixedLocator([]))
    ax.xaxis.set_major_locator(FixedLocator(list(x)))
    labels = [row["shown"] if named else f"{row['shown']:g}" for row in one]
    if named and len(labels) > 3:  # long names would overlap: every second one is a line lower
        labels = [f"\n{label}" if k % 2 else label for k, label in enumerate(labels)]
    ax.set_xticks(x, labels, fontsize=6.0)
    if named or factor == "beta":
        ax.set_xlim(-0.5, len(one) - 0.5)
    scale_rate_axis(ax, "y", low, high)
    ax.set_xlabel(FACTOR_LABELS[factor])
    hide_frame(ax)


def _quartile_bars(
    ax: Axes, x: FloatArray, rows: Sequence[FigureRow], name: str, law: str, low: float
) -> None:
    """Median of column ``name`` as a line, its quartiles as vertical bars, not below ``low``."""
    colour = style.law_colour(law)
    middle, bottom, top = quartiles(rows, name, low)
    for place, a, b in zip(x, bottom, top, strict=True):
        ax.plot([place, place], [a, b], color=colour, lw=2.5, alpha=0.35, solid_capstyle="butt")
    ax.plot(x, middle, color=colour, lw=1.1, marker=style.law_mark(law), ms=4, clip_on=False)
