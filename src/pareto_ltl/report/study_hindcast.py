"""The figures of ``pipelines=hindcast``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pareto_ltl.report import style
from pareto_ltl.report.rate_axes import scale_rate_axis
from pareto_ltl.report.study_axes import (
    BOUND_COLOUR,
    FigureRow,
    column_values,
    hide_frame,
    save_figures,
)
from pareto_ltl.settings import ReportConfig, preset

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study

PREDICTION_LABELS = {
    "bound_paper": "f_o + R, independent winds",
    "bound_independent": "V + R, independent winds",
    "bound_coherent": "V + R, coherent winds",
    "simulated_independent": "simulated, independent winds",
    "simulated_coherent": "simulated, coherent winds",
}


CHOSEN = "chosen"  # kind of the plans that selection picks
FRONT_MARK: dict[str, Any] = {"marker": "o", "ms": 4.5, "mec": "white", "mew": 0.6, "ls": ""}
CHOSEN_MARK: dict[str, Any] = {"marker": "D", "ms": 3.2, "mfc": "white", "mew": 0.9, "ls": ""}


def draw_hindcast(folder: Path, cfg: ReportConfig, study: Study) -> tuple[Path, ...]:
    """Write ``reliability_F`` for each planning fidelity F; return the paths."""
    groups, plans = study.tables["reliability"], study.tables["hindcast"]
    made = {
        f"reliability_{name}": partial(
            reliability_figure,
            [row for row in groups if row["fidelity"] == name],
            [row for row in plans if row["fidelity"] == name],
        )
        for name in dict.fromkeys(row["fidelity"] for row in groups)
    }
    return save_figures(folder, cfg, made)


def reliability_figure(groups: Sequence[FigureRow], plans: Sequence[FigureRow]) -> Figure:
    """Realised against predicted failure of groups of plans, one panel per bound or simulation.

    Filled marks are plans along the fronts, hollow ones those that selection picks. The intervals count one
    trial per mission. Dots are single plans.
    """
    order = [name for name in PREDICTION_LABELS if any(row["promise"] == name for row in groups)]
    columns = 3 if len(order) > 4 else len(order)
    rows = -(-len(order) // columns)
    gap, west, above = 0.26, 0.62, 0.62
    inner = min(2.1, (style.PAGE_WIDTH - west - 0.1 - (columns - 1) * gap) / columns)
    width, height = west + columns * (inner + gap), rows * (inner + above) - 0.02
    figure, low = style.blank_figure(width, height), 1e-4
    for k, name in enumerate(order):
        left, bottom = (
            west + (k % columns) * (inner + gap),
            (rows - 1 - k // columns) * (inner + above) + 0.38,
        )
        ax = style.axes_at(figure, left, bottom, inner, inner)
        mine = [row for row in groups if row["promise"] == name]
        _draw_reliability(ax, mine, [row for row in plans if name in row], name, low)
        ax.set_xlabel("bound [%]" if name.startswith("bound") else "simulated [%]")
        if k % columns:
            ax.tick_params(labelleft=False)
        else:
            ax.set_ylabel("failed in the full fields [%]")
        title = _prediction_label(name, mine)
        style.text_at(figure, left, bottom + inner + 0.04, title, va="bottom", fontweight="bold")
    if any(row.get("kind") == CHOSEN for row in groups):
        _explain_marks(figure.axes[0])
    return figure


def _explain_marks(ax: Axes) -> None:
    """A legend of the two kinds of plans."""
    for label, look in (("along the front", FRONT_MARK), ("chosen", CHOSEN_MARK)):
        ax.plot([], [], **{"mfc": style.BLACK, "mec": style.BLACK} | look, label=label)
    box = ax.legend(loc="lower right", handlelength=1.0, labelspacing=0.3, frameon=True, edgecolor="none")
    box.set_zorder(7)


def _prediction_label(name: str, rows: Sequence[FigureRow]) -> str:
    """Title of a panel: the prediction and its wind law; R of a plan is that of the law it was planned in."""
    law = preset(rows[0].get("fidelity", "paper")).law
    if name == "bound_paper" and law != "independent":
        return f"f_o, independent, + R, {law} winds"
    return PREDICTION_LABELS[name]


def _draw_reliability(
    ax: Axes, groups: Sequence[FigureRow], plans: Sequence[FigureRow], name: str, low: float
) -> None:
    ax.fill_between([low, 1.0], [low, 1.0], [1.0, 1.0], color=BOUND_COLOUR, alpha=0.06, lw=0)
    ax.plot([low, 1.0], [low, 1.0], color=style.STONE, lw=0.8, ls=(0, (3, 2)))
    ax.scatter(
        np.maximum(column_values(plans, name), low),
        np.maximum(column_values(plans, "failure"), low),
        s=3,
        color=style.MIST,
        lw=0,
        zorder=2,
        clip_on=False,
    )
    colour = style.LAW_COLOURS.get(name.partition("_")[2], style.BLACK)
    for row in groups:
        x, y = max(row["promised"], low), max(row["realised"], low)
        ax.plot(
            [x, x],
            [max(row["realised_low"], low), max(row["realised_high"], low)],
            color=colour,
            lw=1.2,
            zorder=3,
        )
        look = CHOSEN_MARK if row.get("kind") == CHOSEN else FRONT_MARK
        ax.plot(x, y, **{"mfc": colour, "mec": colour} | look, zorder=4, clip_on=False)
    scale_rate_axis(ax, "x", low)
    scale_rate_axis(ax, "y", low)
    ax.text(
        0.04,
        0.96,
        "fails more often\nthan foreseen",
        transform=ax.transAxes,
        va="top",
        fontsize=6.0,
        color=BOUND_COLOUR,
        path_effects=style.white_halo(1.6),
        zorder=6,
    )
    hide_frame(ax)
