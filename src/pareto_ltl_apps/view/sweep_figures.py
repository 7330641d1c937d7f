"""The figure of a sweep: one dot per job; median and quartiles as a line and a band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.axes import hide_frame
from pareto_ltl_apps.view.metric_names import cost_in_column, is_probability, metric_label

SERIES_COLOURS = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY, style.INK)
SERIES_MARKS = ("o", "s", "^", "D", "v", "P", "X")
SWEEP_WIDTH, SWEEP_HEIGHT = 5.2, 3.0  # [in]
DOT_SPREAD = 0.32  # half width over which dots of one value are spread, relative to the distance of values

SweepSeries = Mapping[str, Sequence[tuple[str, float]]]


def draw_sweep_figure(
    folder: Path, x: str, y: str, by: str | None, series: SweepSeries, dpi: int = 200, *, missing: int = 0
) -> str:
    """Write metric ``y`` over setting ``x`` as PNG and SVG into ``folder``; return the SVG element.

    Parameters
    ----------
    by : str or None
        The setting that distinguishes the series; it is the title of the legend.
    series : mapping of name to sequence of (value of x, value of y)
        One entry per series.
    missing : int
        Jobs of the sweep that have no such value; the figure says so.
    """
    scale = axis_scale(y)
    series = {name: [(at, scale * value) for at, value in points] for name, points in series.items()}
    named = by is not None and len(series) <= 12
    with style.report_style():
        figure = style.blank_figure(SWEEP_WIDTH, SWEEP_HEIGHT)
        axes = style.axes_at(figure, 0.62, 0.4, SWEEP_WIDTH - 0.8, SWEEP_HEIGHT - (0.85 if named else 0.5))
        across = Across.of([value for points in series.values() for value, _ in points])
        for index, (name, points) in enumerate(series.items()):
            _draw_series(axes, across, (index, len(series)), name, points, joined=not _is_unordered(x))
        axes.set_xlabel(axis_label(x), parse_math=False)
        axes.set_ylabel(axis_label(y), parse_math=False)
        _scale_axes(axes, across, np.array([value for points in series.values() for _, value in points]))
        if missing:
            jobs = f"{missing} job{'s' * (missing > 1)}"
            style.text_at(
                figure, SWEEP_WIDTH - 0.1, 0.03, f"{jobs} without {y} not shown", ha="right", fontsize=6.0
            )
        if named:
            axes.legend(
                title=by, alignment="left", loc="lower left", bbox_to_anchor=(0.0, 1.0),
                ncols=min(len(series), 5), borderaxespad=0.2, handletextpad=0.2, columnspacing=1.2,
            )  # fmt: skip
        _, svg = style.save_figure(figure, folder, f"{y}_over_{x}".replace("/", "-").replace(" ", "_"), dpi)
    text = svg.read_text(encoding="utf-8")
    return text[text.index("<svg") :]


def _is_unordered(x: str) -> bool:
    """Whether values of ``x`` have no meaningful order, so that no line may join them."""
    return x == "job" or x.rpartition(".")[2] == "seed"


def axis_label(name: str) -> str:
    """Label of an axis: words and unit of known names, else the name itself; probabilities in per cent."""
    return f"{metric_label(name)} [%]" if is_probability(name) else metric_label(name)


def axis_scale(name: str) -> float:
    """Factor from a metric to what its axis shows."""
    if is_probability(name):
        return 100.0
    if name == "duration_s":
        return 1 / 3600
    cost = cost_in_column(name)
    return 1.0 if cost is None else cost.scale


@dataclass(frozen=True, slots=True)
class Across:
    """The values of the horizontal axis: numbers at their value, words one after the other.

    Attributes
    ----------
    places : mapping of str to float
        Position of each value.
    words : bool
        Whether a value is no number.
    """

    places: Mapping[str, float]
    words: bool

    @classmethod
    def of(cls, values: Sequence[str]) -> Across:
        """The positions of ``values``."""
        try:
            return cls({value: float(value) for value in values}, words=False)
        except ValueError:
            return cls({value: float(i) for i, value in enumerate(dict.fromkeys(values))}, words=True)

    @property
    def columns(self) -> FloatArray:
        """The positions, increasing."""
        return np.unique(list(self.places.values()))

    @property
    def spans_decade(self) -> bool:
        """Whether the values are positive numbers that span more than a factor of ten."""
        at = self.columns
        return not self.words and bool(at[0] > 0 and at[-1] / at[0] > 10)


def _draw_series(
    axes: Axes, across: Across, place: tuple[int, int], name: str, points: Sequence[tuple[str, float]],
    *, joined: bool,
) -> None:  # fmt: skip
    """One series; ``place`` is its number, and the number of all."""
    index, of = place
    colour, mark = SERIES_COLOURS[index % len(SERIES_COLOURS)], SERIES_MARKS[index % len(SERIES_MARKS)]
    at = np.array([across.places[value] for value, _ in points])
    up = np.array([value for _, value in points])
    columns = np.unique(at)
    repeated = len(columns) < len(at)
    apart = np.diff(across.columns)
    lane = DOT_SPREAD * (float(apart.min()) if len(apart) else 1.0)
    shift = (index - (of - 1) / 2) * 2 * lane / of
    width = lane / max(of, 1)
    if repeated:
        quartiles = np.array([np.quantile(up[at == column], [0.25, 0.5, 0.75]) for column in columns])
        if across.words:
            _draw_boxes(axes, columns + shift, quartiles, width, colour)
        else:
            band = quartiles[:, 0], quartiles[:, 2]
            axes.fill_between(columns, *band, color=colour, alpha=0.16, linewidth=0)
            axes.plot(columns, quartiles[:, 1], color=colour, linewidth=1.1)
    elif not joined:
        low, middle, high = np.quantile(up, [0.25, 0.5, 0.75])
        axes.axhspan(low, high, color=colour, alpha=0.1, linewidth=0)
        axes.axhline(middle, color=colour, linewidth=1.0)
    elif not across.words and len(columns) > 1:
        order = np.argsort(at)
        axes.plot(at[order], up[order], color=colour, linewidth=0.9, alpha=0.6)
    if across.words:
        moved = at + shift + _jitter(at, up, columns, width)
    else:  # shift series a little against each other, except on a logarithmic axis
        moved = at + (0.12 * shift if repeated and not across.spans_decade else 0.0)
    axes.plot(
        moved, up, mark, color=colour, markersize=3.2, markeredgecolor="white", markeredgewidth=0.35,
        linestyle="none", alpha=0.85, label=name or None, clip_on=False,
    )  # fmt: skip


def _draw_boxes(axes: Axes, at: FloatArray, quartiles: FloatArray, width: float, colour: str) -> None:
    for x, (low, middle, high) in zip(at, quartiles, strict=True):
        axes.fill_between([x - width, x + width], low, high, color=colour, alpha=0.16, linewidth=0)
        axes.plot([x - width, x + width], [middle, middle], color=colour, linewidth=1.3)


def _jitter(at: FloatArray, up: FloatArray, columns: FloatArray, width: float) -> FloatArray:
    """Horizontal shifts (n,) that place the dots of one column side by side, in the order of their values."""
    shift = np.zeros(len(at))
    for column in columns:
        members = np.flatnonzero(at == column)
        rank = np.argsort(np.argsort(up[members], kind="stable"), kind="stable")
        golden = np.mod(rank * 0.6180339887498949, 1.0) - 0.5  # low-discrepancy sequence
        shift[members] = 1.6 * width * golden if len(members) > 1 else 0.0
    return shift


def _scale_axes(axes: Axes, across: Across, up: FloatArray) -> None:
    """Scales and ticks for the values ``across`` and ``up``."""
    axes.grid(axis="y", color="#E6E6E6", linewidth=0.5)
    hide_frame(axes)
    if len(up) and up.min() > 0 and up.max() / up.min() > 30:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(numticks=8))
    elif len(up) and up.min() >= 0 and up.min() < 0.5 * up.max():
        axes.set_ylim(bottom=0.0)
    columns = across.columns.tolist()
    if across.words:
        labels = list(across.places) if len(columns) <= 40 else []
        axes.set_xticks(columns[: len(labels)], labels, parse_math=False)
        axes.set_xlim(-0.6, len(columns) - 0.4)
        if max(map(len, labels), default=0) * len(columns) > 70:
            axes.tick_params(axis="x", labelrotation=30)
        return
    if across.spans_decade:
        axes.set_xscale("log")
    if len(columns) <= 8:
        axes.set_xticks(columns, [f"{column:g}" for column in columns])
        axes.tick_params(axis="x", which="minor", length=0)
