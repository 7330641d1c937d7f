"""The figures of studies that fly plans, except forecast tests and departures.

``compare``, ``convergence`` and ``ablation`` show planners by rates and bounds, ``replanning`` and
``replan_test`` ways to fly, ``sitl`` tracks and distances of two aircraft.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from careful_io.texts import distance_text, probability_text
from pareto_ltl import Scene, Settings
from pareto_ltl.extend import Decomposition, Study
from pareto_ltl_apps.view import axes as shared
from pareto_ltl_apps.view import map_layers, style
from pareto_ltl_apps.view.axes import GRID_COLOUR, FigureRow, Figures, column_values, scale_rate_axis
from pareto_ltl_apps.view.factors import FACTOR_TITLES
from pareto_ltl_apps.view.map import ground_keys
from pareto_ltl_apps.view.map_layers import dense_path, draw_flights, draw_ground, map_axes, name_regions
from pareto_ltl_apps.view.settings import ReportConfig
from pareto_ltl_apps.view.wind import draw_wind_arrows

MAX_KEYS = 6  # in a line of the legend of the panels
PLANNED: dict[str, Any] = {"color": style.BLACK, "lw": 1.1, "ls": (0, (3.5, 1.5))}  # look of a planned path
FACTOR_LABELS = FACTOR_TITLES | {
    "trees": "trees",
    "epsilon": "ε, collision probability of a step",
    "kernel": "kernel of the wind regression",
}
LOG_FACTORS = ("trees", "epsilon", "n_max", "dt")

# --- compare ---------------------------------------------------------------------------------


def comparison_figures(
    settings: Settings, study: Study, scene: Scene, decomposition: Decomposition
) -> Figures:
    """``figure1``, a map per method, and ``outcomes``, failure rates and bounds."""
    cfg, pictures = settings[ReportConfig], study.pictures
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
    second = 0.14 if len(keys) > MAX_KEYS else 0.0  # height of a second line of the legend
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
        chart.set(
            xlabel=chart.get_xlabel() if last else "",
            ylabel=chart.get_ylabel() if k % columns == 0 else "",
        )
        chart.tick_params(labelbottom=last, labelleft=k % columns == 0)
        if wind is not None:
            key = (west, 0.30 + second) if k == 0 else (-9.0, -9.0)  # one key for all
            draw_wind_arrows(chart, scene, wind, 0.0, "expected wind at departure", *key)
        caption = [f"({chr(97 + k)}) {panel['title']}", *_panel_caption(panel)]
        for line, text in enumerate(reversed(caption)):
            look: dict[str, Any] = {"fontweight": "bold"} if line == len(caption) - 1 else {"fontsize": 6.0}
            style.text_at(figure, left, bottom + height + 0.03 + 0.11 * line, text, va="bottom", **look)
    style.legend_at(figure, keys, (west - 0.02, 0.04), min(len(keys), MAX_KEYS), loc="lower left")
    return figure


def _draw_panel(
    chart: Axes, cfg: ReportConfig, scene: Scene, decomposition: Decomposition, panel: FigureRow
) -> None:
    """The map of one method: its planned path and flights of the first wind law."""
    draw_ground(chart, scene, decomposition)
    name_regions(chart, scene, dense_path(panel["x"]) if panel["planned"] else None)
    if panel["planned"]:
        flights = next(iter(panel["flights"].values()))  # flights of two laws would cover each other
        draw_flights(chart, flights, cfg.paths)
        halo = style.white_halo(1.8)
        chart.plot(*panel["x"].T, **PLANNED, zorder=6, path_effects=halo)
    start: dict[str, Any] = {"marker": "o", "ms": 4, "mfc": "white", "mec": "black", "mew": 0.9, "zorder": 8}
    chart.plot(*scene.start, **start)


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
    keys: list[Artist] = [Line2D([], [], **PLANNED, label="planned (mean)")]
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
    methods, laws = list(dict.fromkeys(row["method"] for row in rows)), shared.laws_of(rows)
    width, top = style.COLUMN_WIDTH * 1.35, 0.22 + 0.15 * (len(laws) > 1)
    height = 0.38 + top + len(methods) * (0.15 + 0.13 * len(laws))
    figure = style.blank_figure(width, height)
    ax = style.axes_at(figure, 1.22, 0.36, width - 1.42, height - 0.36 - top)
    low = shared.decade_below(np.append(column_values(rows, "failure_low"), column_values(rows, "bound")))
    gap = 0.62 / max(1, len(laws))
    for place, name in enumerate(methods):
        for k, law in enumerate(laws):
            dots = [row["failure"] for row in each if row["method"] == name and row["law"] == law]
            row = next(row for row in rows if row["method"] == name and row["law"] == law)
            _draw_outcome(ax, place + (k - (len(laws) - 1) / 2) * gap, row, dots, low)
        bound = next(row["bound_mean"] for row in rows if row["method"] == name)
        if math.isfinite(bound):
            look: dict[str, Any] = {"marker": "|", "ms": 13, "mew": 1.6, "color": shared.BOUND_COLOUR}
            ax.plot(max(bound, low), place, **look, zorder=5, clip_on=False)
    scale_rate_axis(ax, "x", low)
    ax.set(ylim=(len(methods) - 0.5, -0.5), xlabel="flights that failed [%]")
    titles = {row["method"]: str(row["title"]) for row in rows}
    ax.set_yticks(range(len(methods)), [titles[name] for name in methods])
    ax.tick_params(axis="y", length=0)
    shared.hide_frame(ax)
    keys = shared.law_keys(laws, "", ", 95 %", ms=4.5, mec="white", lw=2.2)
    for size, width, colour, label in (
        (5, 0.8, style.STONE, "one plan"),
        (9, 1.6, shared.BOUND_COLOUR, "V + R as planned (mean)"),
    ):
        keys.append(Line2D([], [], ls="", marker="|", ms=size, mew=width, color=colour, label=label))
    style.legend_at(figure, keys, (0.2, height - 0.05), 2 if len(keys) > 3 else 3)
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


# --- convergence -----------------------------------------------------------------------------


def convergence_figures(_: Settings, study: Study) -> Figures:
    """``figure2``."""
    return {"figure2": lambda: convergence_figure(study.tables["convergence"], study.numbers)}


def convergence_figure(rows: Sequence[FigureRow], numbers: Mapping[str, float]) -> Figure:
    """Bound and failure rate, hypervolume, and share of seeds with a plan, against vertices per tree."""
    height = 2.22
    figure, axes = shared.panel_row(
        ("(a) selected path", "(b) front", "(c) seeds with a plan"), height=height, width=1.72, west=0.62,
        gap=0.66, base=0.38, top=0.39, above=0.03,
    )  # fmt: skip
    some = shared.laws_of(rows)
    one = [row for row in rows if row["law"] == some[0]]
    _bound_and_failure(axes[0], rows, one, some)
    _quartile_band(axes[1], one, "hypervolume", style.GREEN)
    axes[1].set(ylabel="hypervolume of the front")
    axes[1].set_ylim(bottom=0.0)
    _planned_share(axes[2], one)
    sizes = sorted({int(row["size"]) for row in rows})
    for ax in axes:
        ax.set_xscale("log")
        ax.set_xlabel("vertices per tree")
        ax.set_xticks(sizes[:: -(-len(sizes) // 5)])
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.grid(color=GRID_COLOUR, lw=0.4)
    if math.isfinite(numbers["first_seconds"]):
        text = f"first answer of a forest:\n{1e3 * numbers['first_seconds']:.2g} ms (median)"
        axes[2].text(0.97, 0.08, text, transform=axes[2].transAxes, ha="right", va="bottom", fontsize=6.5)
    name = f"bound, {one[0]['planned_law']} winds"
    keys = [
        Line2D([], [], color=shared.BOUND_COLOUR, lw=1.4, ls=shared.BOUND_DASHES, label=name),
        *shared.law_keys(some, "missed, ", ms=3, lw=1.2),
        Patch(fc="#00000022", label=f"quartiles over {one[0]['seeds']} seeds"),
    ]
    style.legend_at(figure, keys, (0.55, height - 0.05), len(keys))
    return figure


def _bound_and_failure(
    ax: Axes, rows: Sequence[FigureRow], one: Sequence[FigureRow], laws: Sequence[str]
) -> None:
    """Mission bound and simulated mission failure of the selected paths, cut at the end of the axis."""
    missed = [column_values(rows, f"missed_of_a_plan{end}") for end in ("", "_q25")]
    values = np.concatenate([column_values(one, "mission_bound_q25"), *missed])
    low = shared.decade_below(values)
    _quartile_band(ax, one, "mission_bound", shared.BOUND_COLOUR, low, marker="")
    for law in laws:
        mine = [row for row in rows if row["law"] == law]
        _quartile_band(ax, mine, "missed_of_a_plan", style.law_colour(law), low, style.law_mark(law))
    high = shared.decade_above(np.append(values, column_values(one, "mission_bound_q75")))
    scale_rate_axis(ax, "y", low, high)
    ax.set_ylabel("mission failure [%]")
    sizes = column_values(one, "size")
    ax.set_xlim(sizes.min() / 1.25, sizes.max() * 1.25)


def _quartile_band(
    ax: Axes, rows: Sequence[FigureRow], name: str, colour: str, low: float | None = None, marker: str = "o"
) -> None:
    """Median of column ``name`` as a line, its quartiles as a band."""
    x = column_values(rows, "size")
    middle, bottom, top = shared.quartiles(rows, name, low)
    ax.fill_between(x, bottom, top, color=colour, alpha=0.18, lw=0)
    ax.plot(x, middle, color=colour, lw=1.3, marker=marker, ms=3, ls="-" if marker else shared.BOUND_DASHES)


def _planned_share(ax: Axes, rows: Sequence[FigureRow]) -> None:
    """Share of seeds with a plan and its 95 % interval."""
    x = column_values(rows, "size")
    low, high = column_values(rows, "planned_low"), column_values(rows, "planned_high")
    ax.fill_between(x, low, high, color=style.PURPLE, alpha=0.18, lw=0)
    ax.plot(x, column_values(rows, "planned"), color=style.PURPLE, lw=1.3, marker="o", ms=3, clip_on=False)
    ax.set(ylim=(0.0, 1.0), ylabel="share (95 % interval)")


# --- ablation --------------------------------------------------------------------------------


def ablation_figures(_: Settings, study: Study) -> Figures:
    """One figure per factor, and ``ablation`` with all factors."""
    rows = study.tables["ablation"]
    factors = list(dict.fromkeys(row["factor"] for row in rows))
    made: Figures = {f"ablation_{factor}": partial(ablation_figure, rows, [factor]) for factor in factors}
    if len(factors) > 1:
        made["ablation"] = partial(ablation_figure, rows, factors)
    return made


def ablation_figure(rows: Sequence[FigureRow], factors: Sequence[str]) -> Figure:
    """Medians of failure rate and bound with quartiles over seeds, one panel per factor."""
    columns = min(4, len(factors))
    lines = -(-len(factors) // columns)
    width = style.PAGE_WIDTH if columns > 1 else style.COLUMN_WIDTH
    gap, west, tall = 0.20, 0.62, 1.30
    inner = (width - west - 0.1 - (columns - 1) * gap) / columns
    height = lines * (tall + 0.52) + 0.42
    figure = style.blank_figure(width, height)
    names = ("failure_of_a_plan", "bound")
    seen = np.concatenate([column_values(rows, name) for name in names])
    low = shared.decade_below(seen)
    high = shared.decade_above(np.append(seen, [column_values(rows, f"{name}_q75") for name in names]))
    for k, factor in enumerate(factors):
        left = west + (k % columns) * (inner + gap)
        bottom = height - 0.42 - (k // columns + 1) * (tall + 0.52) + 0.52 - 0.10
        ax = style.axes_at(figure, left, bottom, inner, tall)
        _draw_factor(ax, [row for row in rows if row["factor"] == factor], factor, low, high)
        if k % columns:
            ax.tick_params(labelleft=False)
        else:
            ax.set_ylabel("failed, bound [%]")
    keys = shared.law_keys(shared.laws_of(rows), "failed, ", ms=3.5, lw=1.2)
    keys += [Line2D([], [], color=style.STONE, lw=1.0, ls=shared.BOUND_DASHES, label="bound (V + R)")]
    keys += [Line2D([], [], color=style.STONE, lw=2.5, alpha=0.5, label="quartiles over seeds")]
    style.legend_at(figure, keys, (west - 0.05, height - 0.05), len(keys) if columns > 1 else 2)
    return figure


def _draw_factor(ax: Axes, rows: Sequence[FigureRow], factor: str, low: float, high: float) -> None:
    """Failure rate with quartiles and bound over the values of a factor; names get equal steps."""
    laws = shared.laws_of(rows)
    one = [row for row in rows if row["law"] == laws[0]]
    named = isinstance(one[0]["shown"], str)
    x = np.arange(len(one), dtype=float) if named or factor == "beta" else column_values(one, "shown")
    for law in laws:
        mine = [row for row in rows if row["law"] == law]
        colour = style.law_colour(law)
        bound = np.clip(column_values(mine, "bound"), low, high)
        ax.plot(x, bound, color=colour, lw=1.0, ls=shared.BOUND_DASHES)
        middle, bottom, top = shared.quartiles(mine, "failure_of_a_plan", low)
        for place, *ends in zip(x, bottom, top, strict=True):
            ax.plot([place, place], ends, color=colour, lw=2.5, alpha=0.35, solid_capstyle="butt")
        ax.plot(x, middle, color=colour, lw=1.1, marker=style.law_mark(law), ms=4, clip_on=False)
    if factor in LOG_FACTORS:
        ax.set_xscale("log")
        ax.xaxis.set_minor_locator(FixedLocator([]))
    ax.xaxis.set_major_locator(FixedLocator(list(x)))
    labels = [row["shown"] if named else f"{row['shown']:g}" for row in one]
    if named and len(labels) > 3:  # long names would overlap: every second one is a line lower
        labels = [f"\n{label}" if k % 2 else label for k, label in enumerate(labels)]
    ax.set_xticks(x, labels, fontsize=6.0)
    if named or factor == "beta":
        ax.set_xlim(-0.5, len(one) - 0.5)
    scale_rate_axis(ax, "y", low, high)
    ax.set_xlabel(FACTOR_LABELS[factor])
    shared.hide_frame(ax)


# --- replanning --------------------------------------------------------------------------------

LEFT, BASE, ROW, TOP, RIGHT = 1.2, 0.45, 0.28, 0.12, 0.22  # of the figure of replanning [in]


def replanning_figures(_: Settings, study: Study) -> Figures:
    """``replanning``."""
    return {"replanning": partial(replanning_figure, study.tables["replanning"])}


def replanning_figure(rows: Sequence[FigureRow]) -> Figure:
    """One line for each way to fly, from the first at the top: failure rate and 95 % interval."""
    tall = ROW * len(rows)
    figure = style.blank_figure(style.COLUMN_WIDTH, BASE + tall + TOP)
    ax = style.axes_at(figure, LEFT, BASE, style.COLUMN_WIDTH - LEFT - RIGHT, tall)
    law = str(rows[0]["law"])
    rate, low, high = (100.0 * column_values(rows, f"failure{end}") for end in ("", "_low", "_high"))
    y = -np.arange(len(rows), dtype=float)
    ax.hlines(y, low, high, color=style.law_colour(law), lw=2.0, alpha=0.5)
    ax.plot(rate, y, ls="none", marker=style.law_mark(law), ms=4.5, color=style.law_colour(law))
    ax.set_yticks(y, [str(row["way"]).replace(", ", ",\n") for row in rows])
    ax.set_ylim(-len(rows) + 0.5, 0.5)
    ax.set_xlim(0.0, 100.0 if high.max() > 50.0 else max(1.0, 1.15 * float(high.max())))
    ax.set_xlabel(f"failed in {rows[0]['flights']} {law} winds [%]")
    ax.grid(axis="x", color=GRID_COLOUR, lw=0.4)
    shared.hide_frame(ax)
    return figure


# --- sitl --------------------------------------------------------------------------------------


def sitl_figures(_: Settings, study: Study, scene: Scene, decomposition: Decomposition) -> Figures:
    """The figure ``sitl``."""
    return {"sitl": lambda: sitl_figure((scene, decomposition), study)}


def sitl_figure(world: tuple[Scene, Decomposition], study: Study) -> Figure:
    """The map with some tracks of each, and the distance between both at the end of every leg."""
    flown, drawn, numbers = study.pictures["flights"], study.pictures["drawn"], study.numbers
    scene, decomposition = world
    figure = style.blank_figure(style.PAGE_WIDTH, 3.1)
    chart = map_axes(scene, style.axes_at(figure, 0.55, 0.45, 2.9, 2.3))
    map_layers.draw_graticule(chart, scene)
    draw_ground(chart, scene, decomposition)
    keys: list[Artist] = []
    for k, (flights, colour, words, name) in enumerate((
        (flown.steps, style.BLUE, "our steps", "sitl_steps"),
        (flown.aircraft, style.VERMILLION, "JSBSim, c172x", "sitl"),
    )):  # fmt: skip
        look: dict[str, Any] = {"colors": colour, "linewidths": 0.6, "alpha": 0.55, "zorder": 4 + k}
        map_layers.draw_lines(chart, flights.x[:drawn], **look)
        label = f"{words}: {100 * numbers[f'{name}_failure']:.1f} % fail"
        keys.insert(0, Line2D([], [], color=colour, label=label))
    map_layers.draw_endpoints(chart, scene, None)
    name_regions(chart, scene, flown.steps.x.mean(axis=0))
    figure.legend(handles=keys, loc="upper left", bbox_to_anchor=(0.06, 1.0), ncol=2, frameon=False)
    law = flown.aircraft.law
    figure.text(0.63, 0.955, f"{len(flown.tracks)} pairs of flights, {law} winds", fontsize=7)
    ax, minutes = style.axes_at(figure, 4.25, 0.45, 2.3, 2.3), np.cumsum(flown.orders.duration) / 60.0
    for row in flown.apart:
        ax.plot(minutes, row / 1e3, color=style.MIST, lw=0.4, zorder=1)
    for share, line, label in ((0.5, "-", "median"), (0.95, "--", "95 % of flights")):
        apart = np.quantile(flown.apart, share, axis=0) / 1e3
        ax.plot(minutes, apart, color="black", lw=1.2, ls=line, label=label)
    ax.set(xlabel="time of flight [min]", ylabel="JSBSim and our steps apart [km]")
    ax.set_xlim(0.0, float(minutes[-1]))
    ax.set_ylim(bottom=0.0)
    ax.legend(loc="upper left", frameon=False)
    return figure
