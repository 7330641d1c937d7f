"""The figure of ``pipelines=replanning``: how often each way to fly fails, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from pareto_ltl.report import style
from pareto_ltl.report.rate_axes import GRID_COLOUR
from pareto_ltl.report.study_axes import FigureRow, Figures, column_values, hide_frame
from pareto_ltl.settings import Settings

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study

LEFT, BASE, ROW, TOP, RIGHT = 1.2, 0.45, 0.28, 0.12, 0.22  # [in]


def replanning_figures(_: Settings, study: Study) -> Figures:
    """``replanning``."""
    return {"replanning": partial(replanning_figure, study.tables["replanning"])}


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
