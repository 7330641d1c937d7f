"""Axes, legends and colours shared by the figures of studies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pareto_ltl.report import style
from pareto_ltl.settings import ReportConfig
from pareto_ltl.support.arrays import FloatArray

FigureRow = Mapping[str, Any]
Figures = dict[str, Callable[[], Figure]]  # functions that draw figures, by name
BOUND_COLOUR = style.BLACK  # not used for a law
LOWEST_RATE = 1e-5  # smaller rates are drawn here: studies have too few flights to resolve them
BOUND_DASHES = (0, (3.0, 1.5))  # line style of a bound


def save_figures(folder: Path, cfg: ReportConfig, made: Figures) -> tuple[Path, ...]:
    """Draw the figures in ``made``, write each in ``report.formats`` into ``folder``, return the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    with style.report_style():
        return tuple(
            path
            for name, make in made.items()
            for path in style.save_figure(make(), folder, name, cfg.dpi, cfg.formats)
        )


def panel_row(
    titles: Sequence[str], *, height: float, width: float, west: float, gap: float, base: float, top: float,
    above: float = 0.08,
) -> tuple[Figure, list[Axes]]:  # fmt: skip
    """A figure of ``height`` with panels of ``width`` side by side, and their titles ``above`` them [in].

    ``west``, ``base`` and ``top`` are the margins, ``gap`` lies between two panels.
    """
    figure, axes = style.blank_figure(style.PAGE_WIDTH, height), []
    for k, title in enumerate(titles):
        left = west + k * (width + gap)
        axes.append(style.axes_at(figure, left, base, width, height - base - top))
        style.text_at(figure, left, height - top + above, title, va="bottom", fontweight="bold")
        hide_frame(axes[-1])
    return figure, axes


def laws_of(rows: Sequence[FigureRow]) -> list[str]:
    """The wind laws in ``rows``, in the order of their first occurrence."""
    return list(dict.fromkeys(row["law"] for row in rows))


def column_values(rows: Sequence[FigureRow], name: str) -> FloatArray:
    """One column of a table, shape (rows,)."""
    return np.array([row[name] for row in rows], float)


def decade_below(values: FloatArray) -> float:
    """The power of ten below the smallest value above ``LOWEST_RATE``; 1e-3 if there is none."""
    seen = values[np.isfinite(values) & (values > LOWEST_RATE)]
    return max(LOWEST_RATE, 10.0 ** math.floor(math.log10(seen.min()))) if len(seen) else 1e-3


def decade_above(values: FloatArray) -> float:
    """The power of ten above the largest value, at most 1."""
    seen = values[np.isfinite(values) & (values > 0)]
    return min(1.0, 10.0 ** math.ceil(math.log10(seen.max()) + 1e-9)) if len(seen) else 1.0


def hide_frame(ax: Axes) -> None:
    """Remove the upper and the right spine."""
    ax.spines[["top", "right"]].set_visible(False)


def quartiles(
    rows: Sequence[FigureRow], name: str, low: float | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Median and quartiles of column ``name``, not below ``low``, each (rows,)."""
    middle, bottom, top = (column_values(rows, f"{name}{end}") for end in ("", "_q25", "_q75"))
    if low is None:
        return middle, bottom, top
    return np.maximum(middle, low), np.maximum(bottom, low), np.maximum(top, low)


def law_keys(laws: Sequence[str], before: str, after: str = "", **look: Any) -> list[Artist]:
    """Entries of a legend: ``before``, the wind law, ``after``, in the colour and mark of the law."""
    return [
        Line2D(
            [], [], color=style.law_colour(law), marker=style.law_mark(law),
            label=f"{before}{law} winds{after}", **look,
        )
        for law in laws
    ]  # fmt: skip


def legend_at(
    figure: Figure,
    keys: Sequence[Artist],
    corner: tuple[float, float],
    columns: int,
    loc: Literal["upper left", "lower left"] = "upper left",
) -> None:
    """Legend with ``columns``, whose corner ``loc`` is at ``corner`` [in] of the figure."""
    w, h = figure.get_size_inches()
    figure.legend(
        handles=list(keys), ncols=columns, loc=loc, bbox_to_anchor=(corner[0] / w, corner[1] / h),
        borderaxespad=0.0, borderpad=0.0, handlelength=1.8, columnspacing=1.1, labelspacing=0.35,
    )  # fmt: skip
