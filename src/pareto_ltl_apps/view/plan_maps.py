"""Further maps of a plan: what limits it, where a beacon helps, a watched flight, a strip of moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, MaxNLocator

from careful_io.texts import distance_text, probability_text
from careful_io.times import hours_text
from flight_quantities.medium import AIR, Medium
from pareto_ltl import Scene
from pareto_ltl.extend import Deployment, Plan, SegmentLimits
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import allowed_text
from pareto_ltl_apps.view import map_layers, style
from pareto_ltl_apps.view.axes import hide_frame, scale_rate_axis
from pareto_ltl_apps.view.land import draw_land
from pareto_ltl_apps.view.limits import PlanLimits, PriceRow, points_text, priced_obstacles
from pareto_ltl_apps.view.map import (
    LEFT,
    SCALE_BELOW,
    WEST,
    column_map,
    draw_route,
    draw_scale,
    promise_lines,
    shown_probability,
    taken_points,
)
from pareto_ltl_apps.view.map_layers import draw_lines, draw_text, inches_per_metre

if TYPE_CHECKING:
    from pareto_ltl_apps.flight.beacon_map import BeaconMap
from pareto_ltl_apps.view.records import DrawnRun

BARS = 6  # prices that are shown, at most
DECADES = 3  # of collision probability below epsilon that colours distinguish
PLAIN_BELOW = 0.44  # below a map without a scale [in]
BAR, BARS_LEFT, BARS_RIGHT = 0.29, 1.62, 0.40  # height of a bar with its gap, left and right margins [in]
BARS_BELOW, BARS_ABOVE = 0.36, 0.32  # below the bars for their axis, above them for their heading [in]
NUMBER_SIZE = 8.0  # of the numbers of obstacles [pt]
COLOURS = {"region": style.GREEN, "airspeed": style.BLUE, "length": style.BLUE}  # of bars; others: BARRIER
BARRIER, GREY = "#6E6E6E", "#5F5F5F"
CHANGE_SIZE = 6.0  # of the changes beside the bars [pt]


def limits_figure(run: DrawnRun, plan: Plan) -> Figure:
    """Map with the path coloured by the collision probability of its segments, above bars of its prices.

    A plan without limits, or far from them, has a black path, one without prices no bars.
    """
    reported = PlanLimits(run.scene, plan, run.medium)
    rows = reported.prices(BARS)
    below = BARS_BELOW + BAR * len(rows) + BARS_ABOVE if rows else 0.06
    heading = [f"What limits the plan of {plan.formula}", *promise_lines(plan, run.medium.flows)]
    coloured = plan.limits is not None and bool((plan.limits.probability > faintest(plan)).any())
    if plan.limits is not None and not coloured:
        most = allowed_text(float(plan.limits.probability.max()), plan.epsilon)
        heading.append(f"No segment comes near its limit: likeliest collision {most}")
    figure, chart = column_map(run.scene, heading, below + (SCALE_BELOW if coloured else PLAIN_BELOW))
    draw_route(chart, run.scene, plan)
    _number_priced(chart, run.scene, plan)
    if coloured:
        assert plan.limits is not None
        _colour_path(chart, plan, plan.limits, reported.law)
    if rows:
        _draw_bars(figure, rows)
        text = f"What a small change of one limit saves, {reported.law}:"
        style.text_at(figure, LEFT, below - BARS_ABOVE + 0.08, text, va="bottom")
    return figure


def faintest(plan: Plan) -> float:
    """The collision probability of a segment below which all have the darkest colour."""
    return min(plan.epsilon, 1.0) * 10.0**-DECADES


def _number_priced(chart: Axes, scene: Scene, plan: Plan) -> None:
    """The numbers of the obstacles that have a price, inside of them, away from the path."""
    look: dict[str, Any] = {
        "color": "white", "fontweight": "bold", "fontsize": NUMBER_SIZE, "clip_on": True,
        "path_effects": [withStroke(linewidth=1.6, foreground=style.INK)],
    }  # fmt: skip
    for number in priced_obstacles(plan):
        half = map_layers.label_half_size([(str(number), NUMBER_SIZE)], 1.0 / inches_per_metre(chart))
        area = map_layers.area_on_map([scene.obstacles[number - 1]], scene.bounds)
        if not area.is_empty:
            place = map_layers.label_position(area, half, scene.bounds, taken_points(scene, plan))
            draw_text(chart, place, str(number), **look)


def _colour_path(chart: Axes, plan: Plan, limits: SegmentLimits, law: str) -> None:
    """Segments in the colour of their collision probability, from ``DECADES`` below epsilon to epsilon."""
    limit = min(plan.epsilon, 1.0)
    ticks = [limit * 10.0**-k for k in range(DECADES, -1, -1)]
    x, order = plan.path.x, np.argsort(limits.probability, kind="stable")  # the largest on top
    lines = list(np.stack([x[:-1], x[1:]], axis=1)[order])
    casing = LineCollection(lines, colors=style.BLACK, linewidths=3.6, capstyle="round", zorder=6.1)
    segments = LineCollection(
        lines, cmap="viridis", norm=LogNorm(ticks[0], limit), linewidths=2.4, capstyle="round", zorder=6.2
    )
    segments.set_array(np.clip(limits.probability[order], ticks[0], limit))
    for layer in (casing, segments):
        chart.add_collection(layer, autolim=False)
    first, *middle, last = (f"{100.0 * tick:.3g}" for tick in ticks)
    above = bool((limits.probability > limit * 1.0001).any())
    texts = [f"≤ {first}", *middle, "≥ " * above + last + " (limit)" * (plan.epsilon < 1.0)]
    label = f"collision probability of a segment, {law} [%]"
    draw_scale(chart, segments, dict(zip(ticks, texts, strict=True)), label)


def _draw_bars(figure: Figure, rows: Sequence[PriceRow]) -> None:
    """Savings in percentage points, the largest at the top, each with its limit, time and change."""
    width = style.COLUMN_WIDTH - BARS_LEFT - BARS_RIGHT
    ax = style.axes_at(figure, BARS_LEFT, BARS_BELOW, width, BAR * len(rows))
    points = [100.0 * row.saving for row in rows]
    up = np.arange(len(rows))[::-1]
    ax.barh(up, points, height=0.62, color=[COLOURS.get(row.kind, BARRIER) for row in rows])
    ax.set(xlim=(0.0, max(points)), ylim=(-0.5, len(rows) - 0.5), yticks=[])
    ax.set_xlabel("fewer failures [percentage points]")
    ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    hide_frame(ax)
    for y, row, value in zip(up, rows, points, strict=True):
        _write_beside(ax, (value, y), points_text(row.saving), (2.0, -2.2), ha="left", fontsize=6.5)
        _write_beside(ax, (0.0, y), _bar_name(row), (-4.0, 1.0), ha="right")
        _write_beside(ax, (0.0, y), row.change, (-4.0, -6.5), ha="right", fontsize=CHANGE_SIZE, color=GREY)


def _write_beside(
    ax: Axes, at: tuple[float, float], text: str, off: tuple[float, float], **look: Any
) -> None:
    """``text`` whose baseline is at ``off`` [pt] from the point ``at`` of the data."""
    look |= {"va": "baseline", "parse_math": False, "annotation_clip": False}
    ax.annotate(text, at, off, textcoords="offset points", **look)


def _bar_name(row: PriceRow) -> str:
    """The limit, cut to the space beside its bar, and its time."""
    size, time = float(style.RC_SETTINGS["font.size"]), f", {row.time}" if row.time else ""
    width = BARS_LEFT - LEFT - 0.06 - (style.text_width(time, size) if time else 0.0)
    return style.fitted_lines(row.limit.removeprefix("the "), width, size, most=1)[0] + time


# --- beacons --------------------------------------------------------------------------------------


def beacons_figure(scene: Scene, plan: Plan, found: BeaconMap, medium: Medium = AIR) -> Figure:
    """Map with the failure rate of the plan for a beacon at each place; circles are the best beacons."""
    without, last = found.without, found.sites[-1].rate.failure
    beacons = "beacon" if len(found.sites) == 1 else f"{len(found.sites)} beacons"
    heading = [
        f"Where a beacon helps the plan of {plan.formula}",
        f"{probability_text(without.failure)} fail without, {probability_text(last)} with the {beacons} of "
        f"the map, {without.law} {medium.flows}",
    ]
    figure, chart = column_map(scene, heading, SCALE_BELOW)
    draw_route(chart, scene, plan)
    percent = 100.0 * np.maximum(found.failure, 0.5 / found.flights)
    low, high = float(percent.min()), float(percent.max())
    wide = high > 3.0 * low
    norm = LogNorm(low, high) if wide else Normalize(low, max(high, low + 1e-9))
    order = np.argsort(-percent, kind="stable")  # the best on top
    look: dict[str, Any] = {"linewidths": 0.4, "edgecolors": "white", "zorder": 6.5, "cmap": "viridis_r"}
    x, y = found.places.at[order].T
    dots = chart.scatter(x, y, 16.0, percent[order], norm=norm, **look)
    for count, site in enumerate(found.sites, 1):
        x, y = found.places.at[site.number]
        ring: dict[str, Any] = {"fill": False, "edgecolor": style.BLACK, "linewidth": 1.2, "zorder": 6.8}
        chart.add_patch(Circle((x, y), found.radius, **ring))
        chart.annotate(
            str(count), (x, y), (8.0, 6.0), textcoords="offset points", fontweight="bold", zorder=9,
            path_effects=style.white_halo(2.0),
        )  # fmt: skip
    ticks = np.geomspace(low, high, 4) if wide else np.linspace(low, high, 4)
    named = {tick: f"{tick:.2g}" for tick in ticks.tolist()}
    draw_scale(chart, dots, named, f"failures with one beacon there, {without.law} {medium.flows} [%]")
    return figure


# --- a watched flight -----------------------------------------------------------------------------

CHART, BETWEEN, FOOT = 1.15, 0.62, 0.45  # heights of the chart, of the gap above it, below it [in]
MOST = 12  # ellipses that are drawn
LEAST = 1e-4  # smaller rates are drawn here

Event = Mapping[str, Any]


def watch_figure(scene: Scene, plan: Plan, events: Sequence[Event], medium: Medium = AIR) -> Figure:
    """Map with the plan and the believed track, and the failure rate of the rest over time."""
    status = [event for event in events if event["event"] in ("status", "end")]
    law, promised = status[-1]["law"], status[-1]["promised"]
    heading = [
        f"Flight of {plan.formula}, watched until {status[-1]['time'] / 3600:.2f} h",
        f"{probability_text(status[-1]['failure'])} of the flights of the rest fail, {law} {medium.flows}"
        + ("" if promised is None else f"; promised at departure {probability_text(promised)}"),
    ]
    figure, chart = column_map(scene, heading, FOOT + CHART + BETWEEN)
    draw_route(chart, scene, plan)
    _draw_track(chart, events, status)
    inner = chart.get_position(original=True).width * style.COLUMN_WIDTH
    _draw_promise(style.axes_at(figure, WEST + 0.1, FOOT, inner - 0.1, CHART), events, status, promised)
    return figure


def _draw_track(chart: Axes, events: Sequence[Event], status: Sequence[Event]) -> None:
    """The believed positions with ellipses of 95 %, and the position fixes."""
    track = np.array([[event["x"], event["y"]] for event in status])
    chart.plot(*track.T, color=style.ORANGE, linewidth=1.4, zorder=7, label="believed")
    area: dict[str, Any] = {"facecolor": style.ORANGE, "alpha": 0.25, "linewidth": 0, "zorder": 6.6}
    for event in status[:: -(-len(status) // MOST)]:
        middle, axes = (event["x"], event["y"]), (2.0 * event["major"], 2.0 * event["minor"])
        chart.add_patch(Ellipse(middle, *axes, angle=np.degrees(event["angle"]), **area))
    look: dict[str, Any] = {"edgecolors": "white", "linewidths": 0.5, "zorder": 8}
    for refused, marker, colour in ((False, "P", style.GREEN), (True, "X", style.VERMILLION)):
        fixes = [e["place"] for e in events if e["event"] == "fix" and (e["use"] == "refused") == refused]
        if fixes:
            x, y = np.array(fixes).T
            chart.scatter(x, y, 24.0, color=colour, marker=marker, **look)


def _draw_promise(ax: Axes, events: Sequence[Event], status: Sequence[Event], promised: float | None) -> None:
    hours = np.array([event["time"] for event in status]) / 3600.0
    given = np.array([[event[key] for event in status] for key in ("failure", "low", "high")])
    rates = np.maximum(given, LEAST)
    shown = rates if promised is None else np.append(rates, max(promised, LEAST))
    ax.fill_between(hours, rates[1], rates[2], color=style.ORANGE, alpha=0.25, linewidth=0)
    ax.plot(hours, rates[0], color=style.ORANGE, linewidth=1.4)
    if promised is not None:
        ax.axhline(max(promised, LEAST), color=style.BLACK, linewidth=0.8, linestyle=(0, (4, 2)))
    looks = {"fix": (style.GREEN, "-"), "alarm": (style.VERMILLION, ":")}
    for event in events:
        if event["event"] in looks:
            colour, dashes = looks[event["event"]]
            ax.axvline(event["time"] / 3600.0, color=colour, linewidth=0.8, linestyle=dashes)
    low = 10.0 ** np.floor(np.log10(shown.min()))
    scale_rate_axis(ax, "y", low, min(1.0, 1.5 * shown.max()), hidden=bool((given[0] < LEAST).any()))
    ax.set(xlabel="time after departure [h]", ylabel="rest fails [%]", xlim=(0.0, max(hours[-1], 1e-3)))


# --- moments --------------------------------------------------------------------------------------

EDGE, GAP, TOP, BOTTOM = 0.06, 0.08, 0.36, 0.20  # [in]
TAIL = 6  # steps behind a flight that are drawn


def frames_figure(scene: Scene, deployment: Deployment, times: FloatArray, frames: int, count: int) -> Figure:
    """The first ``count`` flights at ``frames`` moments, evenly spaced from soon after departure to the end.

    Parameters
    ----------
    times : (T+1,) float
        Times of the steps [s after departure].
    """
    steps = np.linspace(0, len(times) - 1, frames + 1).round().astype(int)[1:]
    inner = (style.PAGE_WIDTH - 2 * EDGE - (frames - 1) * GAP) / frames
    span = np.ptp(scene.bounds, axis=0)
    height = inner * float(np.clip(span[1] / span[0], 0.35, 1.6))
    figure = style.blank_figure(style.PAGE_WIDTH, BOTTOM + height + TOP)
    for k, step in enumerate(steps):
        left = EDGE + k * (inner + GAP)
        chart = map_layers.map_axes(scene, style.axes_at(figure, left, BOTTOM, inner, height))
        chart.set(xlabel="", ylabel="", xticks=[], yticks=[])
        draw_land(chart, scene, cities=False)
        map_layers.draw_ground(chart, scene, None)
        map_layers.name_regions(chart, scene, times=False)
        _draw_moment(chart, deployment, int(step), count)
        map_layers.draw_endpoints(chart, scene, None)
        when = f"{hours_text(float(times[step]))} after departure"
        style.text_at(figure, left, BOTTOM + height + 0.04, when, va="bottom")
    law, shown = deployment.law, deployment.failed[:count]
    text = (
        f"{len(shown):,} of {len(deployment.failed):,} simulated flights of one plan, {law} winds; "
        f"{int(shown.sum())} of those drawn fail, {shown_probability(float(deployment.failed.mean()))} of all"
    )
    style.text_at(figure, EDGE, BOTTOM + height + 0.20, text, va="bottom", fontweight="bold")
    keys = [Line2D([], [], color=style.law_colour(law), marker="o", ms=2.4, lw=0.6, label="flight")]
    if shown.any():
        failed = "flight that fails"
        keys.append(Line2D([], [], color=style.FAILED, marker="x", ms=3.2, mew=0.7, lw=0.6, label=failed))
    style.legend_at(figure, keys, (EDGE, 0.03), 2, loc="lower left", columnspacing=1.2, handlelength=1.6)
    width = f"each map is {distance_text(float(span[0]), 0)} wide"
    style.text_at(figure, style.PAGE_WIDTH - EDGE, 0.05, width, va="bottom", ha="right", fontsize=6.5)
    return figure


def _draw_moment(chart: Axes, deployment: Deployment, step: int, count: int) -> None:
    """Tails and positions of the flights at ``step``; failing flights are dark, with a cross."""
    x, failed = deployment.x[:count, : step + 1], deployment.failed[:count]
    for lost, colour, mark, size in (
        (False, style.law_colour(deployment.law), "o", 1.0),
        (True, style.FAILED, "x", 2.4),
    ):
        flights = x[failed == lost]
        draw_lines(chart, flights, colors=colour, linewidths=0.25, alpha=0.25, zorder=4)
        draw_lines(chart, flights[:, -TAIL:], colors=colour, linewidths=0.4, alpha=0.7, zorder=4.5)
        chart.plot(*flights[:, -1].T, mark, color=colour, ms=size, mew=0.6, zorder=6 + lost)
