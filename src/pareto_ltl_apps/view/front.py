"""The figure of the Pareto front: of risks, or of failure rates (``fidelity.judge=flights``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from pareto_ltl.extend import FailureRate, Front, Objectives, Plan, accepted_rows
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.axes import hide_frame, scale_rate_axis, set_rate_ticks
from pareto_ltl_apps.view.map_layers import length_unit
from pareto_ltl_apps.view.records import DrawnRun

FRONT_HEIGHT = 2.75  # height of the figure of risks [in]
RING: dict[str, Any] = {
    "marker": "o", "ms": 8.5, "mfc": "none", "mec": style.VERMILLION, "mew": 1.3, "ls": "", "clip_on": False,
}  # fmt: skip
CHOSEN = style.mark_key("chosen plan", "o", 7.0, "none", style.VERMILLION, 1.3)


def front_figure(run: DrawnRun, front: Front) -> Figure:
    """The figure of a front: of failure rates if it has them, else of risks."""
    if front.rates:
        return flown_front_figure(run, front)
    figure = style.blank_figure(style.COLUMN_WIDTH, FRONT_HEIGHT)
    ax = style.axes_at(figure, 0.58, 0.38, 2.22, 1.82)
    keys = draw_risks(ax, run, front, style.axes_at(figure, 2.86, 0.38, 0.09, 1.82))
    style.legend_at(figure, keys, (0.52, 2.28), 2, loc="lower left", handletextpad=0.3, columnspacing=1.2)
    return figure


def draw_front(ax: Axes, run: DrawnRun, front: Front) -> None:
    """A front on axes of the reader, with a legend inside."""
    if front.rates:
        draw_rates(ax, run, front)
        keys = [*chain.from_iterable(_flown_keys(run, front))]
    else:
        keys = draw_risks(ax, run, front)
    for text in ax.legend(handles=keys).get_texts():
        text.set_parse_math(False)


def draw_risks(ax: Axes, run: DrawnRun, front: Front, bar: Axes | None = None) -> list[Line2D]:
    """Mission risk against path length, collision risk as colour, before and after smoothing; the legend.

    Where the front has the mission risk of trees, accepted vertices are a cloud of dots. The path of the plan
    is marked with a ring. The scale of the colours is ``bar``, or takes some space of ``ax``.
    """
    plan, (unit, per_metre) = run.plan, length_unit(run.scene)
    after = _front_rows([path.objectives for path in front.paths]) * [per_metre, 1.0, 1.0]
    before = _front_rows(front.raw) * [per_metre, 1.0, 1.0]
    of_trees = (front.models.law, front.models.mission_bound) == ("independent", "theorem2")
    vertices = accepted_rows(run.forest) if run.forest is not None and of_trees else np.empty((0, 2))
    cloud = vertices[:, [-1, 0]] * [per_metre, 1.0]  # length and mission risk
    low, hidden = style.log_axis_end(np.concatenate([after[:, 1], before[:, 1], cloud[:, 1]]))
    low, high = shown_ends(ax, low, 1.0)
    up = np.maximum(cloud[:, 1], low)
    ax.scatter(cloud[:, 0], up, s=2.0, c=style.MIST, alpha=0.5, lw=0, rasterized=True, zorder=1)
    law = f"{front.models.law} {run.medium.flows} [%]"
    _scatter_risks(ax, (before, after), low, f"collision risk R, {law}", bar)
    if plan is not None:
        cost = plan.path.objectives
        ax.plot(cost.length * per_metre, max(cost.mission_risk, low), **RING, zorder=5)
    scale_rate_axis(ax, "y", low, high, hidden=hidden)
    if hidden:
        ax.axhline(low, color=style.STONE, lw=1.0, ls=(0, (2, 2)), zorder=2, clip_on=False)
        ax.spines["bottom"].set_visible(False)
    hide_frame(ax)
    ax.set(xlabel=f"path length [{unit}]", ylabel=f"mission risk {front.models.mission_symbol}, {law}")
    ax.xaxis.set_major_locator(MaxNLocator(5))
    keys = [style.mark_key("front after smoothing", "o", 4.9, "#7C7B78", "black")]
    keys += [style.mark_key("front before", "s", 3.6, "#7C7B78", style.STONE)] * bool(len(before))
    keys += [CHOSEN] * (plan is not None)
    if len(cloud):
        keys.append(style.mark_key(f"{len(cloud):,} accepted vertices", "o", 2.5, style.MIST, style.MIST))
    return keys


def _scatter_risks(
    ax: Axes, fronts: tuple[FloatArray, FloatArray], low: float, label: str, place: Axes | None
) -> None:
    """Rows (length, mission risk, collision risk) before and after smoothing, and the bar of the colours.

    Mission risks below ``low`` are drawn at the end of the axis.
    """
    risks = np.concatenate([rows[:, 2] for rows in fronts])
    least, hidden = style.log_axis_end(risks)
    limit = max(10.0 ** np.ceil(np.log10(max(float(risks.max(initial=0.0)), least)) - 1e-9), 10.0 * least)
    norm = LogNorm(least, limit)
    marks = ("s", 13.0, style.STONE, 3), ("o", 24.0, "black", 4)
    for rows, (marker, size, edge, order) in zip(fronts, marks, strict=True):
        dots = ax.scatter(
            rows[:, 0], np.maximum(rows[:, 1], low), size, np.maximum(rows[:, 2], least), marker=marker,
            edgecolors=edge, zorder=order, norm=norm, cmap="cividis", linewidths=0.6, clip_on=False,
        )  # fmt: skip
    bar = ax.figure.colorbar(dots, cax=place, ax=None if place else ax, label=label)
    bar.outline.set_linewidth(0.5)
    set_rate_ticks(bar.ax.yaxis, least, limit, hidden=hidden)


def _front_rows(objectives: Sequence[Objectives]) -> FloatArray:
    """Length [m], judged mission risk and collision risk of each path, shape (n, 3)."""
    rows = [[o.length, o.mission_risk, o.collision_risk] for o in objectives]
    return np.array(rows, float).reshape(-1, 3)


# --- failure rates --------------------------------------------------------------------------------

LEFT, BOTTOM, WIDTH, TALL = 0.62, 0.38, 2.76, 1.8  # of the axes [in]
ROW, GAP = 0.119, 0.05  # height of a line of the legend, and the space above and below it [in]
BESIDE = 0.25  # of the lengths of the front: points of the trees that are longer are not drawn
LOOKS = (
    (style.BLUE, "o"), (style.ORANGE, "s"), (style.GREEN, "D"), (style.PURPLE, "^"), (style.SKY, "v"),
)  # fmt: skip
OTHERS = ("#4D4D4D", "P")  # look of all further orders
OTHER_ORDERS = "other orders"
LEAST = 1e-6  # lower rates cannot be distinguished from 0 with the flights of a front
NARROWEST = 3.0  # least ratio of the ends of the axis of rates


def flown_front_figure(run: DrawnRun, front: Front) -> Figure:
    """The figure of a front of failure rates, with its legend above."""
    keys = _flown_keys(run, front)
    rows = max(map(len, keys))
    figure = style.blank_figure(style.COLUMN_WIDTH, BOTTOM + TALL + ROW * rows + 2 * GAP)
    draw_rates(style.axes_at(figure, LEFT, BOTTOM, WIDTH, TALL), run, front)
    look: dict[str, Any] = {"handletextpad": 0.4, "labelspacing": 0.3, "handlelength": 1.2}
    top = BOTTOM + TALL + ROW * rows + GAP
    for left, column in zip((LEFT - 0.06, LEFT + 1.28), keys, strict=True):
        style.legend_at(figure, column, (left, top), 1, **look)
    return figure


def _flown_keys(run: DrawnRun, front: Front) -> tuple[list[Line2D], list[Line2D]]:
    """Entries of the legend: the mission orders, and all other marks."""
    shortest_first = sorted(front.paths, key=lambda path: path.objectives.length)
    return order_keys(order_looks([path.order for path in shortest_first])), other_keys(front, run.plan)


def draw_rates(ax: Axes, run: DrawnRun, front: Front) -> None:
    """Failure rate against path length of every path, with 95 % intervals, the mission order as colour.

    The path of the plan is marked with a ring, its fresh flights with a bar.
    """
    plan, (unit, per_metre) = run.plan, length_unit(run.scene)
    lengths = per_metre * np.array([path.objectives.length for path in front.paths])
    order = np.argsort(lengths, kind="stable")
    looks = order_looks([front.paths[k].order for k in order])
    after, before = rate_rows(front.rates), rate_rows(front.raw_rates)
    raw = per_metre * np.array([o.length for o in front.raw][: len(before)])
    low, high, hidden = rate_ends(np.concatenate([after, before]))
    low, high = shown_ends(ax, low, high)
    ax.scatter(raw, np.clip(before[:, 0], low, high), marker="x", s=10.0, c=style.STONE, lw=0.7, zorder=2)
    line = [k for k in order if after[k, 0] < after[lengths < lengths[k], 0].min(initial=np.inf)]
    ax.plot(lengths[line], np.maximum(after[line, 0], low), color=style.STONE, lw=0.8, zorder=3)
    for k in order:
        (colour, mark), (rate, least, upper) = looks[front.paths[k].order], np.maximum(after[k], low)
        ax.plot([lengths[k]] * 2, [least, upper], color=colour, lw=0.9, zorder=4, clip_on=False)
        ax.plot(lengths[k], rate, mark, ms=3.8, mfc=colour, mec="white", mew=0.4, zorder=5, clip_on=False)
    if plan is not None:
        _mark_plan(ax, front, plan, per_metre, low)
    scale_rate_axis(ax, "y", low, high, hidden=hidden)
    law = f"{front.rates[0].law} {run.medium.flows}"
    ax.set(xlabel=f"path length [{unit}]", ylabel=f"failed flights, {law} [%]")
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.set_xlim(*_length_ends(lengths))
    hide_frame(ax)


def _length_ends(lengths: FloatArray) -> tuple[float, float]:
    """Ends of the axis of lengths, by the front alone."""
    low, high = float(lengths.min()), float(lengths.max())
    span = max(high - low, 0.02 * high)
    return low - 0.05 * span, high + BESIDE * span


def shown_ends(ax: Axes, low: float, high: float) -> tuple[float, float]:
    """Ends of the axis of rates for ``low`` to ``high`` and what the axes of the reader show already."""
    shown = ax.get_ylim() if ax.has_data() else (low, high)
    return min(low, shown[0]), max(high, shown[1])


def rate_rows(rates: Sequence[FailureRate]) -> FloatArray:
    """Rate and both ends of its interval, (P, 3)."""
    return np.array([[rate.failure, rate.low, rate.high] for rate in rates]).reshape(-1, 3)


def rate_ends(rows: FloatArray) -> tuple[float, float, bool]:
    """Ends of a logarithmic axis for ``rows`` (rate, low, high), and whether some rates lie below it."""
    known = rows[:, :2][rows[:, :2] >= LEAST]
    hidden = bool((rows[:, 0] < LEAST).any())
    low = style.round_below(float(known.min()) if len(known) else float(rows[:, 2].min()))
    low = max(low / 10.0 if hidden else low, LEAST)
    high = min(1.0, max(float(rows[:, 2].max()), NARROWEST * low))
    return low, high, hidden


def order_looks(orders: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Colour and mark of each mission order, in the order of their first path."""
    different = list(dict.fromkeys(orders))
    return {order: LOOKS[k] if k < len(LOOKS) else OTHERS for k, order in enumerate(different)}


def _mark_plan(ax: Axes, front: Front, plan: Plan, per_metre: float, low: float) -> None:
    """A ring about the point of the plan, and the rate of its fresh flights with its interval."""
    x = per_metre * plan.path.objectives.length
    claims = [r for r, path in zip(front.rates, front.paths, strict=True) if path.origin == plan.path.origin]
    claimed = plan.promise.claimed if plan.promise else next(iter(claims), None)
    if plan.promise is not None:
        rate = plan.promise.rate
        ends = np.maximum([rate.low, rate.failure, rate.high], low)
        look = {"color": style.VERMILLION, "zorder": 6, "clip_on": False}
        ax.plot(np.full(3, x), ends, "_-", ms=5.0, mew=1.2, lw=1.2, **look)  # type: ignore[arg-type]
    if claimed is not None:
        ax.plot(x, max(claimed.failure, low), **RING, zorder=6)


def order_keys(looks: Mapping[str, tuple[str, str]]) -> list[Line2D]:
    """Entries of the legend for mission orders; orders with the look ``OTHERS`` share one entry."""
    named = {order_text(order) if look != OTHERS else OTHER_ORDERS: look for order, look in looks.items()}
    return [style.mark_key(label, mark, 3.8, colour, "white", 0.4) for label, (colour, mark) in named.items()]


def other_keys(front: Front, plan: Plan | None) -> list[Line2D]:
    """Entries of the legend for all other marks."""
    runs = front.rates[0].runs
    keys = [Line2D([], [], color=style.INK, lw=0.9, label=f"95 % interval, {runs:,} flights")]
    if front.raw_rates:
        longest = _length_ends(np.array([path.objectives.length for path in front.paths]))[1]
        beyond = sum(cost.length > longest for cost in front.raw[: len(front.raw_rates)])
        label = "trees alone"
        if beyond:  # and not drawn
            label += f": all {beyond} are longer" if beyond == len(front.raw_rates) else f", {beyond} longer"
        keys.append(style.mark_key(label, "x", 3.4, style.STONE, style.STONE, 0.7))
    if plan is not None:
        keys.append(CHOSEN)
        if plan.promise is not None:
            rate = plan.promise.rate
            label = f"its {rate.runs:,} {'weighted' if rate.weighted else 'fresh'} flights"
            keys.append(style.mark_key(label, "_", 5.0, style.VERMILLION, style.VERMILLION, 1.2))
    return keys


def order_text(order: str) -> str:
    """A mission order as a legend shows it, cut to the width of its column."""
    size = float(style.RC_SETTINGS["legend.fontsize"])
    return style.fitted_lines(order.replace(">", " → ") or "no visit", 1.2, size, most=1)[0]
