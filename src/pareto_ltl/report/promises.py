"""The figure of ``pareto-ltl scores``: isotonic reliability, a Murphy diagram, differences of scores."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MultipleLocator

from pareto_ltl.report import style
from pareto_ltl.report.records import PromiseDiagrams
from pareto_ltl.report.study_axes import BOUND_COLOUR, hide_frame
from pareto_ltl.settings import preset

HEIGHT, PANEL, WEST, GAP, BASE, TOP = 2.62, 1.82, 0.5, 0.52, 0.4, 0.42  # [in]
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


def draw_promises(folder: Path, shown: PromiseDiagrams) -> tuple[Path, ...]:
    """Write ``scores_F.png`` and ``.svg``, F the fidelity, into ``folder``; return the paths."""
    with style.report_style():
        return style.save_figure(promises_figure(shown), folder, f"scores_{shown.fidelity}", DPI)


def promises_figure(shown: PromiseDiagrams) -> Figure:
    """Three panels: reliability without bins, elementary scores, differences of them."""
    figure = style.blank_figure(style.PAGE_WIDTH, HEIGHT)
    places = [WEST + k * (PANEL + GAP) for k in range(3)]
    axes = [style.axes_at(figure, left, BASE, PANEL, HEIGHT - BASE - TOP) for left in places]
    titles = ("(a) reliability", "(b) Murphy diagram", f"(c) {next(iter(shown.curves))} minus {shown.other}")
    for left, title, note in zip(places, titles, NOTES, strict=True):
        text = style.fitted_lines(title, PANEL + GAP / 2, 7.0, most=1)[0]
        style.text_at(figure, left, HEIGHT - TOP + 0.2, text, va="bottom", fontweight="bold")
        style.text_at(figure, left, HEIGHT - TOP + 0.07, note, va="bottom", fontsize=6.0)
    _draw_reliability(axes[0], shown)
    _draw_murphy(axes[1], shown)
    _draw_difference(axes[2], shown)
    for ax in axes:
        hide_frame(ax)
    return figure


def _draw_reliability(ax: Axes, shown: PromiseDiagrams) -> None:
    """The isotonic rates over the range of exact promises, each plan, and a histogram of the promises."""
    law = preset(shown.fidelity).law
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
    _per_cent(ax, "x")
    _per_cent(ax, "y")


def _draw_murphy(ax: Axes, shown: PromiseDiagrams) -> None:
    """Mean elementary scores; the area below a curve is the Brier score."""
    own = {"color": style.law_colour(preset(shown.fidelity).law), "lw": 1.4, "zorder": 4}
    for (name, curve), look in zip(shown.curves.items(), (own, *OTHER_LOOKS), strict=False):
        ax.plot(shown.thresholds, curve, label=_short(name), **look)
    ax.set_xlabel("threshold of a decision [%]")
    ax.set_ylabel("mean elementary score")
    _per_cent(ax, "x")
    ax.set_ylim(0.0, 1.45 * max(float(curve.max()) for curve in shown.curves.values()))
    ax.legend(loc="upper left", handlelength=1.8, borderaxespad=0.2, labelspacing=0.3)


def _draw_difference(ax: Axes, shown: PromiseDiagrams) -> None:
    """Differences of the elementary scores with their 95 % intervals, threshold by threshold."""
    colour = style.law_colour(preset(shown.fidelity).law)
    low, high = (np.nan_to_num(ends) for ends in (shown.difference_low, shown.difference_high))
    ax.fill_between(shown.thresholds, low, high, color=colour, alpha=0.25, lw=0)
    ax.axhline(0.0, color=style.STONE, lw=0.8, ls=(0, (3, 2)))
    ax.plot(shown.thresholds, shown.difference, color=colour, lw=1.2)
    end = 1.3 * max(1e-3, float(np.abs([low, high]).max()))
    ax.set_ylim(-end, end)
    for place, text, va in ((0.97, "worse", "top"), (0.03, "better", "bottom")):
        ax.text(
            0.04, place, text, transform=ax.transAxes, va=va, fontsize=6.0, color=BOUND_COLOUR,
            path_effects=style.white_halo(1.6),
        )  # fmt: skip
    ax.set_xlabel("threshold of a decision [%]")
    ax.set_ylabel("difference of elementary scores")
    _per_cent(ax, "x")


def _short(name: str) -> str:
    return name if len(name) <= 24 else f"{name[:21]}..."


def _per_cent(ax: Axes, axis: str) -> None:
    getattr(ax, f"set_{axis}lim")(0.0, 1.0)
    side = ax.xaxis if axis == "x" else ax.yaxis
    side.set_major_locator(MultipleLocator(0.25))
    side.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:.3g}"))
