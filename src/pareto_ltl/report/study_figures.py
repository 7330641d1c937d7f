"""The pictures of the studies: planners side by side, growing trees, one setting at a time, promise against
nature.

Rows come as plain mappings, the rows of the tables that lie beside the pictures as CSV.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from pareto_ltl.report import plan_figures as figures
from pareto_ltl.report import style
from pareto_ltl.report.records import Study
from pareto_ltl.settings import ReportConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

Row = Mapping[str, Any]
LAW_COLORS = {"independent": style.BLUE, "coherent": style.ORANGE}
LAW_MARKS = {"independent": "o", "coherent": "s"}
BOUND = style.VERMILLION  # the paper draws its bound in red
FLOOR = 1e-5  # rates below are drawn on the axis' end: no study flies enough to tell them from 0
GRID = "#E5E5E5"
PROMISED = (0, (3.0, 1.5))  # dashes of a promise
FACTORS = {
    "trees": "trees",
    "beta": "β, times the default",
    "epsilon": "ε, collision probability of a step",
    "n_max": "vertices a tree",
    "dt": "time step [s]",
    "kernel": "kernel of the wind's regression",
    "ball": "radius of the ball [sd]",
}
LOGARITHMIC = ("trees", "epsilon", "n_max", "dt")
PROMISES = {
    "bound_paper": "Theorem 2 + R, as planned",
    "bound_independent": "V + R, independent winds",
    "bound_coherent": "V + R, coherent winds",
    "simulated_independent": "simulated, independent winds",
    "simulated_coherent": "simulated, coherent winds",
}


def _saved(folder: Path, cfg: ReportConfig, made: Mapping[str, Callable[[], Figure]]) -> tuple[Path, ...]:
    folder.mkdir(parents=True, exist_ok=True)
    with style.styled():
        return tuple(
            path for name, make in made.items() for path in style.save(make(), folder, name, cfg.dpi)
        )


def laws_of(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row["law"] for row in rows))


def column(rows: Sequence[Row], name: str) -> FloatArray:
    return np.array([row[name] for row in rows], float)


def rate_axis(ax: Axes, axis: str, low: float = FLOOR, high: float = 1.0) -> None:
    """A logarithmic axis of probabilities, labelled in per cent; its end holds 0."""
    getattr(ax, f"set_{axis}scale")("log")
    getattr(ax, f"set_{axis}lim")(low, high)
    side = ax.xaxis if axis == "x" else ax.yaxis
    powers = [10.0**k for k in range(math.ceil(math.log10(low) - 1e-9), 1)]
    side.set_major_locator(FixedLocator(powers))
    side.set_major_formatter(FuncFormatter(lambda value, _: per_cent(value, low)))
    side.set_minor_formatter(NullFormatter())
    ax.grid(axis=axis, color=GRID, lw=0.4)  # type: ignore[arg-type]


def per_cent(value: float, low: float) -> str:
    return ("≤ " if value <= low * 1.01 else "") + f"{100 * value:g}"


def lowest(values: FloatArray) -> float:
    """The decade below the smallest value that is not 0, within what studies can tell."""
    seen = values[np.isfinite(values) & (values > FLOOR)]
    return max(FLOOR, 10.0 ** math.floor(math.log10(seen.min()))) if len(seen) else 1e-3


def highest(values: FloatArray) -> float:
    """The decade above the largest value."""
    seen = values[np.isfinite(values) & (values > 0)]
    return min(1.0, 10.0 ** math.ceil(math.log10(seen.max()) + 1e-9)) if len(seen) else 1.0


def _bare(ax: Axes) -> None:
    ax.spines[["top", "right"]].set_visible(False)


# --- compare ---------------------------------------------------------------------------------


def draw_comparison(
    folder: Path, cfg: ReportConfig, scene: Scene, decomposition: Decomposition, study: Study
) -> tuple[Path, ...]:
    """``figure1``: each method's plan and what became of it; ``outcomes``: failure and bound of all."""
    pictures = study.pictures
    return _saved(
        folder,
        cfg,
        {
            "figure1": lambda: panels_figure(cfg, scene, decomposition, pictures["wind"], pictures["panels"]),
            "outcomes": lambda: outcomes_figure(study.tables["compare"], study.tables["compare_seeds"]),
        },
    )


def panels_figure(
    cfg: ReportConfig, scene: Scene, decomposition: Decomposition, wind: Any, panels: Sequence[Row]
) -> Figure:
    """The paper's Figure 1: planned path, flights through the wind, one panel a method."""
    columns = 3 if len(panels) not in (1, 2, 4) else min(2, len(panels))
    rows = -(-len(panels) // columns)
    gap, west, top, foot = 0.12, 0.50, 0.34, 0.78
    inner = (style.PAGE - west - 0.08 - (columns - 1) * gap) / columns
    span = np.ptp(scene.bounds, axis=0)
    height = inner * float(np.clip(span[1] / span[0], 0.35, 1.6))
    figure = style.blank(style.PAGE, foot + rows * (height + top))
    for k, panel in enumerate(panels):
        left, row = west + (k % columns) * (inner + gap), rows - 1 - k // columns
        bottom = foot + row * (height + top)
        chart = figures._map(scene, style.box(figure, left, bottom, inner, height))
        last = k + columns >= len(panels)
        _panel(chart, cfg, scene, decomposition, panel)
        chart.ax.set(
            xlabel=chart.ax.get_xlabel() if last else "",
            ylabel=chart.ax.get_ylabel() if k % columns == 0 else "",
        )
        chart.ax.tick_params(labelbottom=last, labelleft=k % columns == 0)
        if wind is not None:
            key = (west, 0.30) if k == 0 else (-9.0, -9.0)  # one key for all
            figures._arrows(chart, scene, wind, 0.0, "expected wind at departure", *key)
        style.note(
            figure,
            left,
            bottom + height + 0.15,
            f"({chr(97 + k)}) {panel['title']}",
            va="bottom",
            fontweight="bold",
        )
        style.note(figure, left, bottom + height + 0.03, _caption(panel), va="bottom", fontsize=6.0)
    _panel_keys(figure, cfg, panels, west)
    laws = next((list(panel["flights"]) for panel in panels if panel["planned"]), [])
    if len(laws) > 1:
        style.note(
            figure, style.PAGE / 2, 0.30, f"failed: {' / '.join(laws)} winds", va="center", fontsize=6.5
        )
    return figure


def _panel(
    chart: figures.Map, cfg: ReportConfig, scene: Scene, decomposition: Decomposition, panel: Row
) -> None:
    figures._ground(chart, scene, decomposition)
    if panel["planned"]:
        law, flights = next(iter(panel["flights"].items()))  # one law: two would cover each other
        n = cfg.paths
        first = replace(
            flights, x=flights.x[:n], accepted=flights.accepted[:n], collided=flights.collided[:n]
        )
        figures._flights(chart, first, n, LAW_COLORS.get(law, style.PURPLE))
        chart.ax.plot(
            *(panel["x"] * chart.per_metre).T,
            color=style.BLACK,
            lw=1.1,
            ls=(0, (3.5, 1.5)),
            zorder=6,
            path_effects=style.halo(1.8),
        )
    chart.ax.plot(
        *(scene.start * chart.per_metre), marker="o", ms=4, mfc="white", mec="black", mew=0.9, zorder=8
    )


def _caption(panel: Row) -> str:
    if not panel["planned"]:
        return "no plan"
    lost = " / ".join(f"{100 * (~f.accepted | f.collided).mean():.1f}" for f in panel["flights"].values())
    return f"{panel['length_m'] / 1e3:,.0f} km; {lost} % failed"


def _panel_keys(figure: Figure, cfg: ReportConfig, panels: Sequence[Row], left: float) -> None:
    laws = list(dict.fromkeys(next(iter(panel["flights"])) for panel in panels if panel["planned"]))
    keys: list[Artist] = [
        Line2D([], [], color=style.BLACK, lw=1.1, ls=(0, (3.5, 1.5)), label="planned (mean)")
    ]
    keys += [
        Line2D(
            [],
            [],
            color=LAW_COLORS.get(law, style.PURPLE),
            lw=0.9,
            label=f"first {cfg.paths} flights, {law} winds",
        )
        for law in laws
    ]
    keys += [
        Line2D([], [], color=style.VERMILLION, lw=0.9, label="... that failed"),
        Patch(fc=style.GREEN + "30", ec=style.GREEN, lw=1.0, label="region"),
        Patch(fc="#6E6E6E", ec="#4A4A4A", lw=0.5, label="obstacle"),
    ]
    w, h = figure.get_size_inches()
    figure.legend(
        handles=keys,
        ncols=len(keys),
        loc="lower left",
        bbox_to_anchor=((left - 0.02) / w, 0.04 / h),
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.8,
        columnspacing=1.1,
    )


def outcomes_figure(rows: Sequence[Row], each: Sequence[Row]) -> Figure:
    """Failure of each method's flights with 95 % intervals, each plan as a dot, and the promise."""
    methods, laws = list(dict.fromkeys(row["method"] for row in rows)), laws_of(rows)
    height = 0.60 + 0.15 * (len(laws) > 1) + len(methods) * (0.15 + 0.13 * len(laws))
    figure = style.blank(style.COLUMN * 1.35, height)
    ax = style.box(figure, 1.22, 0.36, style.COLUMN * 1.35 - 1.42, height - 0.58 - 0.15 * (len(laws) > 1))
    low = lowest(np.concatenate([column(rows, "failure_low"), column(rows, "bound")]))
    gap = 0.62 / max(1, len(laws))
    for place, name in enumerate(methods):
        for k, law in enumerate(laws):
            y = place + (k - (len(laws) - 1) / 2) * gap
            color = LAW_COLORS.get(law, style.PURPLE)
            dots = [row["failure"] for row in each if row["method"] == name and row["law"] == law]
            ax.plot(
                np.maximum(dots, low),
                np.full(len(dots), y),
                "|",
                color=color,
                alpha=0.35,
                ms=5,
                mew=0.8,
                clip_on=False,
            )
            row = next(row for row in rows if row["method"] == name and row["law"] == law)
            ends = [max(row["failure_low"], low), max(row["failure_high"], low)]
            ax.plot(ends, [y, y], color=color, lw=2.2, solid_capstyle="butt", zorder=3)
            ax.plot(
                max(row["failure"], low),
                y,
                LAW_MARKS.get(law, "D"),
                color=color,
                ms=4.5,
                mec="white",
                mew=0.6,
                zorder=4,
                clip_on=False,
            )
        promise = next(row["bound_mean"] for row in rows if row["method"] == name)
        if math.isfinite(promise):
            ax.plot(
                max(promise, low), place, marker="|", ms=13, mew=1.6, color=BOUND, zorder=5, clip_on=False
            )
    rate_axis(ax, "x", low)
    ax.set(ylim=(len(methods) - 0.5, -0.5), xlabel="flights that failed [%]")
    ax.set_yticks(range(len(methods)), [_title(rows, name) for name in methods])
    ax.tick_params(axis="y", length=0)
    _bare(ax)
    keys = [
        Line2D(
            [],
            [],
            color=LAW_COLORS.get(law, style.PURPLE),
            marker=LAW_MARKS.get(law, "D"),
            ms=4.5,
            mec="white",
            lw=2.2,
            label=f"{law} winds, 95 %",
        )
        for law in laws
    ]
    keys += [
        Line2D([], [], ls="", marker="|", ms=5, mew=0.8, color=style.STONE, label="one plan"),
        Line2D([], [], ls="", marker="|", ms=9, mew=1.6, color=BOUND, label="promised (V + R, mean)"),
    ]
    _over(figure, keys, height, left=0.2, columns=2 if len(keys) > 3 else 3)
    return figure


def _title(rows: Sequence[Row], method: str) -> str:
    return next(str(row["title"]) for row in rows if row["method"] == method)


def _over(figure: Figure, keys: Sequence[Artist], height: float, left: float, columns: int) -> None:
    """A legend along the upper edge."""
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


# --- convergence -----------------------------------------------------------------------------


def draw_convergence(folder: Path, cfg: ReportConfig, study: Study) -> tuple[Path, ...]:
    """``figure2``: bound and failure, hypervolume, and seeds with a plan, against vertices a tree."""
    return _saved(
        folder, cfg, {"figure2": lambda: convergence_figure(study.tables["convergence"], study.numbers)}
    )


def convergence_figure(rows: Sequence[Row], numbers: Mapping[str, float]) -> Figure:
    height, inner = 2.22, 1.72
    figure = style.blank(style.PAGE, height)
    lefts = (0.62, 0.62 + inner + 0.66, 0.62 + 2 * (inner + 0.66))
    axes = [style.box(figure, left, 0.38, inner, 1.45) for left in lefts]
    some = laws_of(rows)
    one = [row for row in rows if row["law"] == some[0]]
    _bound_and_failure(axes[0], rows, one, some)
    band(axes[1], one, "hypervolume", style.GREEN)
    axes[1].set(ylabel="hypervolume of the front")
    axes[1].set_ylim(bottom=0.0)
    _share(axes[2], one)
    for ax, title in zip(axes, ("(a) selected path", "(b) front", "(c) seeds with a plan"), strict=True):
        ax.set_xscale("log")
        ax.set_xlabel("vertices a tree")
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
        ax.grid(color=GRID, lw=0.4)
        _bare(ax)
        left = ax.get_position().x0 * style.PAGE
        style.note(figure, left, 1.86, title, va="bottom", fontweight="bold")
    if math.isfinite(numbers["first_seconds"]):
        text = f"first answer of a forest:\n{1e3 * numbers['first_seconds']:.2g} ms (median)"
        axes[2].text(0.97, 0.08, text, transform=axes[2].transAxes, ha="right", va="bottom", fontsize=6.5)
    keys: list[Artist] = [Line2D([], [], color=BOUND, lw=1.4, label="bound on mission failure")]
    keys += [
        Line2D(
            [],
            [],
            color=LAW_COLORS.get(law, style.PURPLE),
            marker=LAW_MARKS.get(law, "D"),
            ms=3,
            lw=1.2,
            label=f"missions missed, {law} winds",
        )
        for law in some
    ]
    keys += [Patch(fc="#00000022", label=f"quartiles over {one[0]['seeds']} seeds")]
    _over(figure, keys, height, left=0.55, columns=len(keys))
    return figure


def _bound_and_failure(ax: Axes, rows: Sequence[Row], one: Sequence[Row], laws: Sequence[str]) -> None:
    values = [
        column(one, "mission_bound_q25"),
        *(column(rows, f"missed_of_a_plan{end}") for end in ("", "_q25")),
    ]
    low = lowest(np.concatenate(values))
    band(ax, one, "mission_bound", BOUND, low, marker="")
    for law in laws:
        mine = [row for row in rows if row["law"] == law]
        band(ax, mine, "missed_of_a_plan", LAW_COLORS.get(law, style.PURPLE), low, LAW_MARKS.get(law, "D"))
    rate_axis(ax, "y", low, highest(np.concatenate([*values, column(one, "mission_bound_q75")])))
    ax.set_ylabel("mission failure [%]")
    ax.set_xlim(column(one, "size").min() / 1.25, column(one, "size").max() * 1.25)


def band(
    ax: Axes, rows: Sequence[Row], name: str, color: str, low: float | None = None, marker: str = "o"
) -> None:
    """Median as a line, quartiles as a band."""
    x = column(rows, "size")
    middle, bottom, top = (column(rows, f"{name}{end}") for end in ("", "_q25", "_q75"))
    if low is not None:
        middle, bottom, top = (np.maximum(values, low) for values in (middle, bottom, top))
    ax.fill_between(x, bottom, top, color=color, alpha=0.18, lw=0)
    ax.plot(x, middle, color=color, lw=1.3, marker=marker, ms=3)


def _share(ax: Axes, rows: Sequence[Row]) -> None:
    x = column(rows, "size")
    ax.fill_between(
        x, column(rows, "planned_low"), column(rows, "planned_high"), color=style.PURPLE, alpha=0.18, lw=0
    )
    ax.plot(x, column(rows, "planned"), color=style.PURPLE, lw=1.3, marker="o", ms=3)
    ax.set(ylim=(-0.02, 1.02), ylabel="share (95 % interval)")


# --- ablation --------------------------------------------------------------------------------


def draw_ablation(folder: Path, cfg: ReportConfig, study: Study) -> tuple[Path, ...]:
    """One figure a factor, and ``ablation`` with all."""
    rows = study.tables["ablation"]
    factors = list(dict.fromkeys(row["factor"] for row in rows))
    made = {f"ablation_{factor}": partial(ablation_figure, rows, [factor]) for factor in factors}
    if len(factors) > 1:
        made["ablation"] = partial(ablation_figure, rows, factors)
    return _saved(folder, cfg, made)


def ablation_figure(rows: Sequence[Row], factors: Sequence[str]) -> Figure:
    """Median failure and bound with quartiles, one panel a factor."""
    columns = min(4, len(factors))
    lines = -(-len(factors) // columns)
    width = style.PAGE if columns > 1 else style.COLUMN
    gap, west, tall = 0.20, 0.62, 1.30
    inner = (width - west - 0.1 - (columns - 1) * gap) / columns
    height = lines * (tall + 0.52) + 0.42
    figure = style.blank(width, height)
    seen = [column(rows, f"{name}{end}") for name in ("failure_of_a_plan", "bound") for end in ("", "_q75")]
    low, high = lowest(np.concatenate(seen[::2])), highest(np.concatenate(seen))
    for k, factor in enumerate(factors):
        left = west + (k % columns) * (inner + gap)
        bottom = height - 0.42 - (k // columns + 1) * (tall + 0.52) + 0.52 - 0.10
        ax = style.box(figure, left, bottom, inner, tall)
        _factor(ax, [row for row in rows if row["factor"] == factor], factor, low, high)
        if k % columns:
            ax.tick_params(labelleft=False)
        else:
            ax.set_ylabel("failed, promised [%]")
    laws = laws_of(rows)
    keys: list[Artist] = [
        Line2D(
            [],
            [],
            color=LAW_COLORS.get(law, style.PURPLE),
            marker=LAW_MARKS.get(law, "D"),
            ms=3.5,
            lw=1.2,
            label=f"failed, {law} winds",
        )
        for law in laws
    ]
    keys += [Line2D([], [], color=style.STONE, lw=1.0, ls=PROMISED, label="promised (V + R)")]
    keys += [Line2D([], [], color=style.STONE, lw=2.5, alpha=0.5, label="quartiles over seeds")]
    _over(figure, keys, height, left=west - 0.05, columns=len(keys) if columns > 1 else 2)
    return figure


def _factor(ax: Axes, rows: Sequence[Row], factor: str, low: float, high: float) -> None:
    laws = laws_of(rows)
    one = [row for row in rows if row["law"] == laws[0]]
    named = isinstance(one[0]["shown"], str)
    x = np.arange(len(one), dtype=float) if named or factor == "beta" else column(one, "shown")
    for law in laws:
        mine = [row for row in rows if row["law"] == law]
        color = LAW_COLORS.get(law, style.PURPLE)
        ax.plot(x, np.clip(column(mine, "bound"), low, high), color=color, lw=1.0, ls=PROMISED)
        _bars(ax, x, mine, "failure_of_a_plan", color, low, LAW_MARKS.get(law, "D"))
    if factor in LOGARITHMIC:
        ax.set_xscale("log")
        ax.xaxis.set_minor_locator(FixedLocator([]))
    ax.xaxis.set_major_locator(FixedLocator(list(x)))
    labels = [row["shown"] if named else f"{row['shown']:g}" for row in one]
    ax.set_xticks(x, labels, fontsize=6.0)
    if named or factor == "beta":
        ax.set_xlim(-0.5, len(one) - 0.5)
    rate_axis(ax, "y", low, high)
    ax.set_xlabel(FACTORS[factor])
    _bare(ax)


def _bars(
    ax: Axes, x: FloatArray, rows: Sequence[Row], name: str, color: str, low: float, marker: str
) -> None:
    middle, bottom, top = (np.maximum(column(rows, f"{name}{end}"), low) for end in ("", "_q25", "_q75"))
    for place, a, b in zip(x, bottom, top, strict=True):
        ax.plot([place, place], [a, b], color=color, lw=2.5, alpha=0.35, solid_capstyle="butt")
    ax.plot(x, middle, color=color, lw=1.1, marker=marker, ms=4, clip_on=False)


# --- hindcast --------------------------------------------------------------------------------


def draw_hindcast(folder: Path, cfg: ReportConfig, study: Study) -> tuple[Path, ...]:
    """``reliability_F`` for each fidelity F of planning: promised against realised failure."""
    groups, plans = study.tables["reliability"], study.tables["hindcast"]
    made = {
        f"reliability_{name}": partial(
            reliability_figure,
            [row for row in groups if row["fidelity"] == name],
            [row for row in plans if row["fidelity"] == name],
        )
        for name in dict.fromkeys(row["fidelity"] for row in groups)
    }
    return _saved(folder, cfg, made)


def reliability_figure(groups: Sequence[Row], plans: Sequence[Row]) -> Figure:
    """Groups of plans by what they were promised, one panel a promise; the interval takes a mission as one
    trial."""
    order = [name for name in PROMISES if any(row["promise"] == name for row in groups)]
    columns = 3 if len(order) > 4 else len(order)
    rows = -(-len(order) // columns)
    gap, west, above = 0.26, 0.62, 0.62
    inner = min(2.1, (style.PAGE - west - 0.1 - (columns - 1) * gap) / columns)
    width, height = west + columns * (inner + gap), rows * (inner + above) - 0.02
    figure, low = style.blank(width, height), 1e-4
    for k, name in enumerate(order):
        left, bottom = (
            west + (k % columns) * (inner + gap),
            (rows - 1 - k // columns) * (inner + above) + 0.38,
        )
        ax = style.box(figure, left, bottom, inner, inner)
        mine = [row for row in groups if row["promise"] == name]
        _reliability(ax, mine, [row for row in plans if name in row], name, low)
        ax.set_xlabel("promised [%]")
        if k % columns:
            ax.tick_params(labelleft=False)
        else:
            ax.set_ylabel("failed in the full fields [%]")
        style.note(figure, left, bottom + inner + 0.04, PROMISES[name], va="bottom", fontweight="bold")
    return figure


def _reliability(ax: Axes, groups: Sequence[Row], plans: Sequence[Row], name: str, low: float) -> None:
    ax.fill_between([low, 1.0], [low, 1.0], [1.0, 1.0], color=BOUND, alpha=0.06, lw=0)
    ax.plot([low, 1.0], [low, 1.0], color=style.STONE, lw=0.8, ls=(0, (3, 2)))
    ax.scatter(
        np.maximum(column(plans, name), low),
        np.maximum(column(plans, "failure"), low),
        s=3,
        color=style.MIST,
        lw=0,
        zorder=2,
        clip_on=False,
    )
    color = LAW_COLORS.get(name.partition("_")[2], style.BLACK)
    for row in groups:
        x, y = max(row["promised"], low), max(row["realised"], low)
        ax.plot(
            [x, x],
            [max(row["realised_low"], low), max(row["realised_high"], low)],
            color=color,
            lw=1.2,
            zorder=3,
        )
        ax.plot(x, y, "o", color=color, ms=4.5, mec="white", mew=0.6, zorder=4, clip_on=False)
    rate_axis(ax, "x", low)
    rate_axis(ax, "y", low)
    ax.text(
        0.04,
        0.96,
        "fails more often\nthan promised",
        transform=ax.transAxes,
        va="top",
        fontsize=6.0,
        color=BOUND,
        path_effects=style.halo(1.6),
        zorder=6,
    )
    _bare(ax)


__all__ = ["draw_ablation", "draw_comparison", "draw_convergence", "draw_hindcast"]
