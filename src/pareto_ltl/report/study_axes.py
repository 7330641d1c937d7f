"""Axes, legends and colours shared by the figures of studies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pareto_ltl.report import style
from pareto_ltl.settings import ReportConfig
from pareto_ltl.support.arrays import FloatArray

FigureRow = Mapping[str, Any]
BOUND_COLOUR = style.BLACK  # not used for a law
LOWEST_RATE = 1e-5  # smaller rates are drawn here: studies have too few flights to resolve them
BOUND_DASHES = (0, (3.0, 1.5))  # line style of a bound


def save_figures(
    folder: Path, cfg: ReportConfig, made: Mapping[str, Callable[[], Figure]]
) -> tuple[Path, ...]:
    """Draw the figures in ``made``, write each in ``report.formats`` into ``folder``, return the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    with style.report_style():
        return tuple(
            path
            for name, make in made.items()
            for path in style.save_figure(make(), folder, name, cfg.dpi, cfg.formats)
        )


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


def legend_above(figure: Figure, keys: Sequence[Artist], height: float, left: float, columns: int) -> None:
    """Legend along the upper edge of a figure of ``height`` [in], from ``left`` [in], with ``columns``."""
    w, h = figure.get_size_inches()
    figure.legend(
        handles=list(keys),
        ncols=columns,
        loc="upper left",
        bbox_to_anchor=(left / w, (height - 0.05) / h),
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.8,
        columnspacing=1.1,
        labelspacing=0.35,
    )
