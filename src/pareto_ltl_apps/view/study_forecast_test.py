"""The figures of ``pipelines=forecast_test``, ``hindcast`` and ``pareto-ltl scores``: promises of plans."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pareto_ltl import Settings
from pareto_ltl.extend import Study
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.axes import (
    BOUND_COLOUR,
    GRID_COLOUR,
    FigureRow,
    Figures,
    column_values,
    hide_frame,
    panel_row,
    scale_rate_axis,
    set_percent_axis,
)
from pareto_ltl_apps.view.records import PromiseDiagrams

TICKS = (0.0, 0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 1.0)
EDGES = np.array([0.0, 0.01, 0.025, 0.05, 0.1, 0.175, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0])
REGION_LOOKS = ((style.VERMILLION, "^"), (style.GREEN, "D"), (style.PURPLE, "v"))
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


def forecast_test_figures(_: Settings, study: Study) -> Figures:
    """``forecast_test_F`` for each planning fidelity F, of the plans that selection picks."""
    plans = [row for row in study.tables["forecast_test"] if row["kind"] == CHOSEN]
    made: Figures = {}
    for name in dict.fromkeys(row["fidelity"] for row in plans):
        promise = f"simulated_{Settings.preset(name).law}"
        bins, regions = (
            [row for row in _of(study.tables[table], name) if row["promise"] == promise]
            for table in ("reliability", "regions")
        )
        chosen = [row for row in bins if row["kind"] == CHOSEN]
        made[f"forecast_test_{name}"] = partial(
            forecast_test_figure, chosen, regions, _of(plans, name), promise
        )
    return made


def hindcast_figures(_: Settings, study: Study) -> Figures:
    """``reliability_F`` for each planning fidelity F, of all plans and promises."""
    groups, plans = study.tables["reliability"], study.tables["hindcast"]
    return {
        f"reliability_{name}": partial(reliability_figure, _of(groups, name), _of(plans, name))
        for name in dict.fromkeys(row["fidelity"] for row in groups)
    }


def _of(rows: Sequence[FigureRow], fidelity: str) -> list[FigureRow]:
    return [row for row in rows if row["fidelity"] == fidelity]


def forecast_test_figure(
    bins: Sequence[FigureRow], regions: Sequence[FigureRow], plans: Sequence[FigureRow], promise: str
) -> Figure:
    """Realised against promised failure rate, by promise and by region, and a histogram of the promises."""
    figure, axes = panel_row(
        ("(a) by promise", "(b) by region", "(c) promises made"), height=2.5, width=1.82, west=0.5, gap=0.52,
        base=0.4, top=0.3,
    )  # fmt: skip
    law = promise.partition("_")[2]
    colour = style.law_colour(law)
    _draw_diagonal(axes[0], law)
    axes[0].scatter(
        column_values(plans, promise), column_values(plans, "failure"), s=4, color=style.MIST, lw=0
    )
    for row in bins:
        _draw_rate(axes[0], row, colour, **_verdict_mark(row, colour))
    _draw_diagonal(axes[1], law)
    for row, (shade, mark) in zip(regions, REGION_LOOKS, strict=False):
        label = f"{row['region']} ({row['missions']})"
        _draw_rate(axes[1], row, shade, **_verdict_mark(row, shade) | {"marker": mark}, label=label)
    legend = axes[1].legend(
        loc="lower right", handlelength=1.0, borderaxespad=0.2, labelspacing=0.3, frameon=True,
        framealpha=0.8, edgecolor="none",
    )  # fmt: skip
    legend.set_zorder(2)  # below intervals and marks
    axes[0].set_ylabel("failed in the later full fields [%]")
    _draw_histogram(axes[2], column_values(plans, promise), law, colour)
    return figure


def _draw_diagonal(ax: Axes, law: str) -> None:
    """Axes of both rates, their diagonal, and the side on which a promise is broken."""
    _draw_broken_side(ax, np.linspace(0.0, 1.0, 100), "promised")
    _scale(ax, "x")
    _scale(ax, "y")
    ax.grid(color=GRID_COLOUR, lw=0.4)
    ax.set_xlabel(f"promised, {law} winds [%]")


def _draw_broken_side(ax: Axes, rates: FloatArray, word: str) -> None:
    """The line on which a promise is exact, through ``rates``, and the side on which it is broken."""
    ends = rates[[0, -1]]
    ax.fill_between(ends, ends, [1.0, 1.0], color=BOUND_COLOUR, alpha=0.06, lw=0)
    ax.plot(rates, rates, color=style.STONE, lw=0.8, ls=(0, (3, 2)))
    ax.text(
        0.04, 0.96, f"fails more often\nthan {word}", transform=ax.transAxes, va="top", fontsize=6.0,
        color=BOUND_COLOUR, path_effects=style.white_halo(1.6), zorder=6,
    )  # fmt: skip


def _scale(ax: Axes, axis: str) -> None:
    """A square-root axis of rates, on which both small and large ones can be read."""
    getattr(ax, f"set_{axis}scale")("function", functions=(_root, np.square))
    set_percent_axis(ax, axis, TICKS)


def _root(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.maximum(values, 0.0)), float)


def _verdict_mark(row: FigureRow, colour: str) -> dict[str, Any]:
    """The mark of a group of missions: hollow if its promise is broken."""
    return {"marker": "o", "mfc": colour if row["kept"] else "white", "ms": 4.5, "mew": 0.9, "ls": ""}


def _draw_rate(ax: Axes, row: FigureRow, colour: str, low: float = 0.0, **mark: Any) -> None:
    """A group of missions with the interval of its rate; rates below ``low`` are drawn there."""
    ends = ("promised", "realised", "realised_low", "realised_high")
    x, y, bottom, top = (max(row[end], low) for end in ends)
    ax.plot([x, x], [bottom, top], color=colour, lw=1.2, zorder=3)
    ax.plot(x, y, **{"mfc": colour, "mec": colour} | mark, zorder=4, clip_on=False)


def _draw_histogram(ax: Axes, promised: FloatArray, law: str, colour: str) -> None:
    counts, _ = np.histogram(promised, EDGES)
    ax.bar(EDGES[:-1], counts, np.diff(EDGES), align="edge", color=colour, alpha=0.75, lw=0.5, ec="white")
    _scale(ax, "x")
    ax.set_xlabel(f"promised, {law} winds [%]")
    ax.set_ylabel("plans")
    ax.set_ylim(0, max(1, counts.max()) * 1.05)


# --- all promises ----------------------------------------------------------------------------


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
        left = west + (k % columns) * (inner + gap)
        bottom = (rows - 1 - k // columns) * (inner + above) + 0.38
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
        ax = figure.axes[0]
        for label, look in (("along the front", FRONT_MARK), ("chosen", CHOSEN_MARK)):
            ax.plot([], [], **{"mfc": style.BLACK, "mec": style.BLACK} | look, label=label)
        box: dict[str, Any] = {"handlelength": 1.0, "labelspacing": 0.3, "frameon": True, "edgecolor": "none"}
        ax.legend(loc="lower right", **box).set_zorder(7)
    return figure


def _prediction_label(name: str, rows: Sequence[FigureRow]) -> str:
    """Title of a panel: the prediction and its wind law; R of a plan is in the law it was planned in."""
    law = Settings.preset(rows[0].get("fidelity", "paper")).law
    if name == "bound_paper" and law != "independent":
        return f"f_o, independent, + R, {law} winds"
    return PREDICTION_LABELS[name]


def _draw_reliability(
    ax: Axes, groups: Sequence[FigureRow], plans: Sequence[FigureRow], name: str, low: float
) -> None:
    _draw_broken_side(ax, np.array([low, 1.0]), "foreseen")
    x, y = (np.maximum(column_values(plans, column), low) for column in (name, "failure"))
    ax.scatter(x, y, s=3, color=style.MIST, lw=0, zorder=2, clip_on=False)
    colour = style.LAW_COLOURS.get(name.partition("_")[2], style.BLACK)
    for row in groups:
        mark = CHOSEN_MARK if row.get("kind") == CHOSEN else FRONT_MARK
        _draw_rate(ax, row, colour, low, **mark)
    scale_rate_axis(ax, "x", low)
    scale_rate_axis(ax, "y", low)
    hide_frame(ax)


# --- promises of a finished test ---------------------------------------------------------------

NOTES = (
    "line: isotonic rates; grey: 90 % range if exact",
    "the area below a curve is the Brier score",
    "with 95 % intervals for each threshold",
)
BAR = 0.17  # height of the histogram of promises, as a share of panel (a)
OTHER_LOOKS: tuple[dict[str, Any], ...] = (  # best constant, persistence, another test
    {"color": style.STONE, "ls": (0, (4, 2)), "lw": 1.0},
    {"color": style.GREEN, "ls": (0, (1, 1.2)), "lw": 1.0},
    {"color": style.BLUE, "ls": (0, (5, 1, 1, 1)), "lw": 1.2},
)
DPI = 300
QUARTERS = (0.0, 0.25, 0.5, 0.75, 1.0)


def draw_promises(folder: Path, shown: PromiseDiagrams) -> tuple[Path, ...]:
    """Write ``scores_F.png`` and ``.svg``, F the fidelity, into ``folder``; return the paths."""
    with style.report_style():
        return style.save_figure(promises_figure(shown), folder, f"scores_{shown.fidelity}", DPI)


def promises_figure(shown: PromiseDiagrams) -> Figure:
    """Three panels: reliability without bins, elementary scores, differences of them."""
    titles = (
        "(a) reliability",
        "(b) Murphy diagram",
        f"(c) {next(iter(shown.curves))} minus {shown.difference.name}",
    )
    width, gap = 1.82, 0.52
    figure, axes = panel_row(
        [
            f"{style.fitted_lines(title, width + gap / 2, 7.0, most=1)[0]}\n{note}"
            for title, note in zip(titles, NOTES, strict=True)
        ],
        height=2.62, width=width, west=0.5, gap=gap, base=0.4, top=0.42, above=0.2,
    )  # fmt: skip
    _draw_isotonic(axes[0], shown)
    _draw_murphy(axes[1], shown)
    _draw_difference(axes[2], shown)
    return figure


def _draw_isotonic(ax: Axes, shown: PromiseDiagrams) -> None:
    """The isotonic rates over the range of exact promises, each plan, and a histogram of the promises."""
    law = Settings.preset(shown.fidelity).law
    colour = style.law_colour(law)
    p = shown.promised
    ax.fill_between(p, shown.low, shown.high, color=style.MIST, alpha=0.45, lw=0)
    ax.plot([0, 1], [0, 1], color=style.STONE, lw=0.8, ls=(0, (3, 2)))
    ax.plot(p, shown.realised, ".", ms=3.0, color=style.STONE, mew=0, clip_on=False, zorder=3)
    ax.plot(p, shown.isotonic, color=colour, lw=1.4, zorder=4)
    counts, edges = np.histogram(p, np.linspace(0.0, 1.0, 21))
    heights = BAR * counts / max(1, counts.max())
    ax.bar(edges[:-1], heights, np.diff(edges), align="edge", color=colour, alpha=0.3, lw=0, zorder=1)
    ax.text(
        0.04, 0.97, "\n".join(f"{name} {value:.3f}" for name, value in shown.parts.items()),
        transform=ax.transAxes, va="top", fontsize=6.0, linespacing=1.25,
        path_effects=style.white_halo(1.6), zorder=6,
    )  # fmt: skip
    ax.set_xlabel(f"promised, {law} winds [%]")
    ax.set_ylabel("failed in the later full fields [%]")
    set_percent_axis(ax, "x", QUARTERS)
    set_percent_axis(ax, "y", QUARTERS)


def _draw_murphy(ax: Axes, shown: PromiseDiagrams) -> None:
    """Mean elementary scores; the area below a curve is the Brier score."""
    own = {"color": style.law_colour(Settings.preset(shown.fidelity).law), "lw": 1.4, "zorder": 4}
    for (name, curve), look in zip(shown.curves.items(), (own, *OTHER_LOOKS), strict=False):
        ax.plot(shown.thresholds, curve, label=name if len(name) <= 24 else f"{name[:21]}...", **look)
    ax.set_xlabel("threshold of a decision [%]")
    ax.set_ylabel("mean elementary score")
    set_percent_axis(ax, "x", QUARTERS)
    ax.set_ylim(0.0, 1.45 * max(float(curve.max()) for curve in shown.curves.values()))
    ax.legend(loc="upper left", handlelength=1.8, borderaxespad=0.2, labelspacing=0.3)


def _draw_difference(ax: Axes, shown: PromiseDiagrams) -> None:
    """Differences of the elementary scores with their 95 % intervals, threshold by threshold."""
    colour = style.law_colour(Settings.preset(shown.fidelity).law)
    low, high = (np.nan_to_num(ends) for ends in (shown.difference.curve_low, shown.difference.curve_high))
    ax.fill_between(shown.thresholds, low, high, color=colour, alpha=0.25, lw=0)
    ax.axhline(0.0, color=style.STONE, lw=0.8, ls=(0, (3, 2)))
    ax.plot(shown.thresholds, shown.difference.curve, color=colour, lw=1.2)
    end = 1.3 * max(1e-3, float(np.abs([low, high]).max()))
    ax.set_ylim(-end, end)
    for place, text, va in ((0.97, "worse", "top"), (0.03, "better", "bottom")):
        ax.text(
            0.04, place, text, transform=ax.transAxes, va=va, fontsize=6.0, color=BOUND_COLOUR,
            path_effects=style.white_halo(1.6),
        )  # fmt: skip
    ax.set_xlabel("threshold of a decision [%]")
    ax.set_ylabel("difference of elementary scores")
    set_percent_axis(ax, "x", QUARTERS)
