"""Axes that figures share: rates in per cent, panels side by side, columns of tables, wind laws."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.settings import ReportConfig

FigureRow = Mapping[str, Any]
Figures = dict[str, Callable[[], Figure]]  # functions that draw figures, by name
BOUND_COLOUR = style.BLACK  # not used for a law
LOWEST_RATE = 1e-5  # smaller rates are drawn here: studies have too few flights to resolve them
BOUND_DASHES = (0, (3.0, 1.5))  # line style of a bound
GRID_COLOUR = "#E5E5E5"
MAX_TICKS = 6  # of an axis of rates


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

    ``west``, ``base`` and ``top`` are the margins, ``gap`` lies between two panels. The second line of a
    title is a note in small letters.
    """
    figure, axes = style.blank_figure(style.PAGE_WIDTH, height), []
    for k, (title, _, note) in enumerate(text.partition("\n") for text in titles):
        left, up = west + k * (width + gap), height - top + above
        axes.append(style.axes_at(figure, left, base, width, height - base - top))
        style.text_at(figure, left, up, title, va="bottom", fontweight="bold")
        if note:
            style.text_at(figure, left, up - 0.13, note, va="bottom", fontsize=6.0)
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


# --- rates in per cent ---------------------------------------------------------------------------


def scale_rate_axis(ax: Axes, axis: str, low: float, high: float = 1.0, *, hidden: bool = True) -> None:
    """Make ``axis`` (x or y) a logarithmic axis of probabilities from ``low`` to ``high``, in per cent.

    If ``hidden`` values lie below ``low``, its tick has a ``≤``.
    """
    getattr(ax, f"set_{axis}scale")("log")
    getattr(ax, f"set_{axis}lim")(low, high)
    set_rate_ticks(ax.xaxis if axis == "x" else ax.yaxis, low, high, hidden=hidden)
    ax.grid(axis=axis, color=GRID_COLOUR, lw=0.4)  # type: ignore[arg-type]


def set_rate_ticks(side: Axis, low: float, high: float, *, hidden: bool) -> None:
    """Ticks at round percentages between ``low`` and ``high``."""
    side.set_major_locator(FixedLocator(rate_ticks(low, high)))
    side.set_major_formatter(FuncFormatter(lambda value, _: rate_tick_text(value, low if hidden else 0.0)))
    side.set_minor_formatter(NullFormatter())


def rate_ticks(low: float, high: float) -> list[float]:
    """Powers of ten from ``low`` to ``high``: every n-th if they are many, with 2 and 5 times if few."""
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    if last - first >= 2:
        stride = -(-(last - first + 1) // MAX_TICKS)
        ticks = [10.0**k for k in range(last, first - 1, -stride)][::-1]
        return ticks if math.isclose(ticks[0], low, rel_tol=1e-6) else [low, *ticks]
    fine = [m * 10.0**k for k in range(first - 1, last + 1) for m in (1.0, 2.0, 5.0)]
    return [tick for tick in fine if low * (1 - 1e-9) <= tick <= high * (1 + 1e-9)]


def rate_tick_text(value: float, low: float = 0.0) -> str:
    """``value`` in per cent; with ``≤`` at the end ``low`` of the axis."""
    percent = 100.0 * value
    text = f"{percent:g}"
    if percent < 0.999e-3:
        text = "10" + str(round(math.log10(percent))).translate(style.SUPERSCRIPTS)
    return ("≤ " if value <= low * 1.01 else "") + text


def set_percent_axis(ax: Axes, axis: str, ticks: Sequence[float]) -> None:
    """Make ``axis`` (x or y) an axis of rates from 0 to 1 with ``ticks``, in per cent."""
    getattr(ax, f"set_{axis}lim")(0.0, 1.0)
    side = ax.xaxis if axis == "x" else ax.yaxis
    side.set_major_locator(FixedLocator(ticks))
    side.set_minor_locator(NullLocator())
    side.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:.3g}"))
