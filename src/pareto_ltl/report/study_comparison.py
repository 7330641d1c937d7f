"""The figures of ``pipelines=compare``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pareto_ltl.report import style
from pareto_ltl.report.map import ground_keys
from pareto_ltl.report.map_labels import dense_path
from pareto_ltl.report.map_layers import MapAxes, draw_flights, draw_ground, map_axes, name_regions
from pareto_ltl.report.rate_axes import scale_rate_axis
from pareto_ltl.report.study_axes import (
    BOUND_COLOUR,
    FigureRow,
    Figures,
    column_values,
    decade_below,
    hide_frame,
    law_keys,
    laws_of,
    legend_at,
)
from pareto_ltl.report.wind import draw_wind_arrows
from pareto_ltl.settings import ReportConfig, Settings
from pareto_ltl.support.display import distance_text, probability_text
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study

MOST_KEYS = 6  # in a line of the legend of the panels


def comparison_figures(
    settings: Settings, study: Study, scene: Scene, decomposition: Decomposition
) -> Figures:
    """``figure1``, a map per method, and ``outcomes``, failure rates and bounds."""
    cfg, pictures = settings.report, study.pictures
    return {
        "figure1": lambda: comparison_figure(cfg, scene, decomposition, pictures["wind"], pictures["panels"]),
        "outcomes": lambda: outcomes_figure(study.tables["compare"], study.tables["compare_seeds"]),
    }


def comparison_figure(
    cfg: ReportConfig, scene: Scene, decomposition: Decomposition, wind: Any, panels: Sequence[FigureRow]
) -> Figure:
    """Planned path and simulated flights, one panel per method, as in Figure 1 of the paper."""
    columns = 3 if len(panels) not in (1, 2, 4) else min(2, len(panels))
    rows = -(-len(panels) // columns)
    lines = 1 + max(len(_panel_caption(panel)) for panel in panels)
    keys = _panel_keys(cfg, scene, panels)
    second = 0.14 if len(keys) > MOST_KEYS else 0.0  # height of a second line of the legend
    gap, west, top, foot = 0.12, 0.50, 0.12 + 0.11 * lines, 0.78 + second
    inner = (style.PAGE_WIDTH - west - 0.08 - (columns - 1) * gap) / columns
    span = np.ptp(scene.bounds, axis=0)
    height = inner * float(np.clip(span[1] / span[0], 0.35, 1.6))
    figure = style.blank_figure(style.PAGE_WIDTH, foot + rows * (height + top))
    for k, panel in enumerate(panels):
        left, row = west + (k % columns) * (inner + gap), rows - 1 - k // columns
        bottom = foot + row * (height + top)
        chart = map_axes(scene, style.axes_at(figure, left, bottom, inner, height))
        last = k + columns >= len(panels)
        _draw_panel(chart, cfg, scene, decomposition, panel)
        chart.ax.set(
            xlabel=chart.ax.get_xlabel() if last else "",
            ylabel=chart.ax.get_ylabel() if k % columns == 0 else "",
        )
        chart.ax.tick_params(labelbottom=last, labelleft=k % columns == 0)
        if wind is not None:
            key = (west, 0.30 + second) if k == 0 else (-9.0, -9.0)  # one key for all
            draw_wind_arrows(chart, scene, wind, 0.0, "expected wind at departure", *key)
        caption = [f"({chr(97 + k)}) {panel['title']}", *_panel_caption(panel)]
        for line, text in enumerate(reversed(caption)):
            look: dict[str, Any] = {"fontweight": "bold"} if line == len(caption) - 1 else {"fontsize": 6.0}
            style.text_at(figure, left, bottom + height + 0.03 + 0.11 * line, text, va="bottom", **look)
    legend_at(figure, keys, (west - 0.02, 0.04), min(len(keys), MOST_KEYS), "lower left")
    return figure


def _draw_panel(
    chart: MapAxes, cfg: ReportConfig, scene: Scene, decomposition: Decomposition, panel: FigureRow
) -> None:
    """The map of one method: its planned path and flights of the first wind law."""
    draw_ground(chart, scene, decomposition)
    name_regions(chart, scene, dense_path(panel["x"]) if panel["planned"] else None)
    if panel["planned"]:
        flights = next(iter(panel["flights"].values()))  # flights of two laws would cover each other
        draw_flights(chart, flights, cfg.paths)
        chart.ax.plot(
            *panel["x"].T,
            color=style.BLACK,
            lw=1.1,
            ls=(0, (3.5, 1.5)),
            zorder=6,
            path_effects=style.white_halo(1.8),
        )
    chart.ax.plot(*scene.start, marker="o", ms=4, mfc="white", mec="black", mew=0.9, zorder=8)


def _panel_caption(panel: FigureRow) -> list[str]:
    """Length, and the failure rate in each wind law, one a line."""
    if not panel["planned"]:
        return ["no plan"]
    length = distance_text(panel["length_m"])
    rates = {law: float(f.failed.mean()) for law, f in panel["flights"].items()}
    return [length, *(f"failed in {law} winds: {probability_text(rate)}" for law, rate in rates.items())]


def _panel_keys(cfg: ReportConfig, scene: Scene, panels: Sequence[FigureRow]) -> list[Artist]:
    """Entries of the legend below the panels."""
    laws = list(dict.fromkeys(next(iter(panel["flights"])) for panel in panels if panel["planned"]))
    keys: list[Artist] = [
        Line2D([], [], color=style.BLACK, lw=1.1, ls=(0, (3.5, 1.5)), label="planned (mean)")
    ]
    for law in laws:
        look: dict[str, Any] = {"color": style.law_colour(law), "ls": style.law_dashes(law), "lw": 0.9}
        keys.append(Line2D([], [], **look, label=f"first {cfg.paths} flights, {law} winds"))
    failed = Line2D([], [], color=style.FAILED, marker="x", ms=3.2, mew=0.7, lw=0.9, label="... that failed")
    return [*keys, failed, *ground_keys(scene)]


def outcomes_figure(rows: Sequence[FigureRow], each: Sequence[FigureRow]) -> Figure:
    """Failure rate of each method with its 95 % interval, single plans as dashes, and the mean bound.

    Parameters
    ----------
    rows : sequence of mappings
        One row per method and wind law.
    each : sequence of mappings
        One row per method, wind law and seed.
    """
    methods, laws = list(dict.fromkeys(row["method"] for row in rows)), laws_of(rows)
    width, top = style.COLUMN_WIDTH * 1.35, 0.22 + 0.15 * (len(laws) > 1)
    height = 0.38 + top + len(methods) * (0.15 + 0.13 * len(laws))
    figure = style.blank_figure(width, height)
    ax = style.axes_at(figure, 1.22, 0.36, width - 1.42, height - 0.36 - top)
    low = decade_below(np.concatenate([column_values(rows, "failure_low"), column_values(rows, "bound")]))
    gap = 0.62 / max(1, len(laws))
    for place, name in enumerate(methods):
        for k, law in enumerate(laws):
            dots = [row["failure"] for row in each if row["method"] == name and row["law"] == law]
            row = next(row for row in rows if row["method"] == name and row["law"] == law)
            _draw_outcome(ax, place + (k - (len(laws) - 1) / 2) * gap, row, dots, low)
        bound = next(row["bound_mean"] for row in rows if row["method"] == name)
        if math.isfinite(bound):
            look: dict[str, Any] = {"marker": "|", "ms": 13, "mew": 1.6, "color": BOUND_COLOUR}
            ax.plot(max(bound, low), place, **look, zorder=5, clip_on=False)
    scale_rate_axis(ax, "x", low)
    ax.set(ylim=(len(methods) - 0.5, -0.5), xlabel="flights that failed [%]")
    ax.set_yticks(range(len(methods)), [_method_title(rows, name) for name in methods])
    ax.tick_params(axis="y", length=0)
    hide_frame(ax)
    keys = _outcome_keys(laws)
    legend_at(figure, keys, (0.2, height - 0.05), 2 if len(keys) > 3 else 3)
    return figure


def _draw_outcome(ax: Axes, y: float, row: FigureRow, dots: Sequence[float], low: float) -> None:
    """One method in one wind law at height ``y``; rates below ``low`` are drawn there."""
    colour, marker = style.law_colour(row["law"]), style.law_mark(row["law"])
    dash: dict[str, Any] = {"color": colour, "alpha": 0.35, "ms": 5, "mew": 0.8, "clip_on": False}
    ax.plot(np.maximum(dots, low), np.full(len(dots), y), "|", **dash)
    ends = [max(row["failure_low"], low), max(row["failure_high"], low)]
    ax.plot(ends, [y, y], color=colour, lw=2.2, solid_capstyle="butt", zorder=3)
    look: dict[str, Any] = {"color": colour, "ms": 4.5, "mec": "white", "mew": 0.6}
    ax.plot(max(row["failure"], low), y, marker, **look, zorder=4, clip_on=False)


def _outcome_keys(laws: Sequence[str]) -> list[Artist]:
    return [
        *law_keys(laws, "", ", 95 %", ms=4.5, mec="white", lw=2.2),
        Line2D([], [], ls="", marker="|", ms=5, mew=0.8, color=style.STONE, label="one plan"),
        Line2D([], [], ls="", marker="|", ms=9, mew=1.6, color=BOUND_COLOUR, label="V + R as planned (mean)"),
    ]


def _method_title(rows: Sequence[FigureRow], method: str) -> str:
    return next(str(row["title"]) for row in rows if row["method"] == method)
