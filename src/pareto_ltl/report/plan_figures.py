"""The pictures of a run: the mission on its map (the paper's Figure 1), the front, and the wind.

``plan`` shows what was planned and what came of it, ``front`` what it was chosen from, ``wind`` what was
known of the wind. A mission without an answer still has a map with the trees as far as they came.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from pareto_ltl.planning.records import Forest, Front, Objectives, Plan
from pareto_ltl.report import style
from pareto_ltl.settings import ReportConfig
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

VERTICES = 50_000  # tree vertices drawn, at most: more than that is one grey surface
ARROWS = 13  # wind arrows along the longer side of the map
ELLIPSES = 14  # covariance ellipses along a path, about
LINE = 0.15  # height of a line of small text [in]
LAW_NAMES = {"independent": "independent wind", "coherent": "coherent wind"}


def draw(
    folder: Path,
    cfg: ReportConfig,
    scene: Scene,
    decomposition: Decomposition,
    wind: WindField,
    forest: Forest | None,
    front: Front | None,
    plan: Plan | None,
    deployments: Mapping[str, Deployment] | None = None,
) -> tuple[Path, ...]:
    """Write ``plan``, ``front`` and ``wind``, each as .png and .svg, into ``folder``; return their paths.

    Without a front there is nothing to put into ``front``, and it is left out.

    Parameters
    ----------
    forest, front, plan : or None
        What a run without an answer has not made; the map says so.
    deployments : mapping of wind law to Deployment
        Of each law ``cfg.paths`` completed flights are drawn, and as many failed ones.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with style.styled():
        figures = {
            "plan": plan_figure(cfg, scene, decomposition, wind, forest, plan, deployments or {}),
            "wind": wind_figure(scene, wind, plan),
        }
        if front is not None and front.paths:
            figures["front"] = front_figure(scene, forest, front, plan)
        return tuple(
            path for name, figure in figures.items() for path in style.save(figure, folder, name, cfg.dpi)
        )


# --- the map -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Map:
    """Axes with equal scales on the scene's bounds, and the length unit of their ticks."""

    ax: Axes
    unit: str
    per_metre: float


def length_unit(scene: Scene) -> tuple[str, float]:
    """Kilometres, or metres for a scene less than 2 km wide; with units per metre."""
    return ("km", 1e-3) if np.ptp(scene.bounds, axis=0).max() >= 2000.0 else ("m", 1.0)


def plan_figure(
    cfg: ReportConfig,
    scene: Scene,
    decomposition: Decomposition,
    wind: WindField,
    forest: Forest | None,
    plan: Plan | None,
    deployments: Mapping[str, Deployment],
) -> Figure:
    """The paper's Figure 1: map, mean wind at mid-flight, trees, planned path with 95 % ellipses, flights."""
    title = _heading(plan, forest, deployments)
    keys = _keys(forest, plan, deployments, cfg.paths)
    if scene.landmarks:
        keys.append(Patch(fc="none", ec=style.PURPLE, lw=0.9, ls="--", label="landmark"))
    rows = (len(keys) + 1) // 2 + 1
    width, bottom, top = style.COLUMN, 0.42 + LINE * rows, 0.26 + LINE * len(title)
    west, east = 0.50, 0.42 if scene.crs else 0.12
    span = np.ptp(scene.bounds, axis=0)
    inner = width - west - east
    height = inner * float(np.clip(span[1] / span[0], 0.35, 1.6))
    figure = style.blank(width, bottom + height + top)
    chart = _map(scene, style.box(figure, west, bottom, inner, height))
    _geography(chart, scene)
    _ground(chart, scene, decomposition)
    if forest is not None:
        _trees(chart, forest)
    if plan is not None:
        _ellipses(chart, plan.path.x, plan.path.cov)
    for color, deployment in zip(_cycle(style.FLIGHTS, len(deployments)), deployments.values(), strict=True):
        _flights(chart, deployment, cfg.paths, color)
    if plan is not None:
        _line(chart, plan.path.x)
    _ends(chart, scene, plan)
    t, moment = flight_middle(scene, plan)
    _arrows(chart, scene, wind, t, f"expected wind {moment}", west, bottom - 0.40)
    figure.legend(
        handles=keys,
        ncols=2,
        loc="upper left",
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.6,
        columnspacing=1.2,
        labelspacing=0.35,
        bbox_to_anchor=((west - 0.02) / width, (bottom - 0.52) / figure.get_size_inches()[1]),
    )
    for row, line in enumerate(reversed(title)):
        style.note(figure, west, bottom + height + 0.24 + LINE * row, line, va="bottom")
    return figure


def _cycle(colors: Sequence[str], n: int) -> list[str]:
    return [colors[i % len(colors)] for i in range(n)]


def _map(scene: Scene, ax: Axes) -> Map:
    unit, per_metre = length_unit(scene)
    (west, south), (east, north) = scene.bounds * per_metre
    ax.set(xlim=(west, east), ylim=(south, north), xlabel=f"east [{unit}]", ylabel=f"north [{unit}]")
    ax.set_aspect("equal", adjustable="box", anchor="SW")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    return Map(ax, unit, per_metre)


def _geography(chart: Map, scene: Scene) -> None:
    """Where meridians meet the northern edge and parallels the eastern one."""
    if scene.crs is None:
        return
    from pareto_ltl.world.projection import to_geographic

    (west, south), (east, north) = scene.bounds
    x, y = np.linspace(west, east, 101), np.linspace(south, north, 101)
    lon = np.unwrap(to_geographic(scene.crs, np.column_stack([x, np.full_like(x, north)]))[0], period=360.0)
    lat = to_geographic(scene.crs, np.column_stack([np.full_like(y, east), y]))[1]
    meridians = [
        (p, style.degrees((d + 180.0) % 360.0 - 180.0, "E", "W")) for p, d in style.crossings(x, lon)
    ]
    parallels = [(p, style.degrees(d, "N", "S")) for p, d in style.crossings(y, lat)]
    for axis, marks in (
        (chart.ax.secondary_xaxis("top").xaxis, meridians),
        (chart.ax.secondary_yaxis("right").yaxis, parallels),
    ):
        axis.set_ticks([place * chart.per_metre for place, _ in marks], [text for _, text in marks])
        axis.set_tick_params(pad=1.5, colors=style.STONE, labelsize=6.0)


def _ground(chart: Map, scene: Scene, decomposition: Decomposition) -> None:
    """Cells faint, obstacles solid, regions with their names."""
    ax, k = chart.ax, chart.per_metre
    ax.add_collection(
        PolyCollection(
            [c * k for c in decomposition.cells],
            facecolors="none",
            edgecolors=style.MIST,
            linewidths=0.35,
            linestyles=":",
            zorder=1.5,
        ),
        autolim=False,
    )
    ax.add_collection(
        PolyCollection(
            [o * k for o in scene.obstacles],
            facecolors="#6E6E6E",
            edgecolors="#4A4A4A",
            linewidths=0.5,
            zorder=3,
        ),
        autolim=False,
    )
    ax.add_collection(
        PolyCollection(
            [mark * k for mark in scene.landmarks],
            facecolors="none",
            edgecolors=style.PURPLE,
            linewidths=0.9,
            linestyles="--",
            zorder=2.6,
        ),
        autolim=False,
    )
    ax.add_collection(
        PolyCollection(
            [r * k for r in scene.regions.values()],
            facecolors=style.GREEN + "30",
            edgecolors=style.GREEN,
            linewidths=1.0,
            zorder=2.5,
        ),
        autolim=False,
    )
    for name, polygon in scene.regions.items():
        x, y = label_place(decomposition.regions.get(name, (polygon,))) * k
        ax.text(
            x,
            y,
            name,
            ha="center",
            va="center",
            fontsize=8.5,
            fontweight="bold",
            color="#00523C",
            zorder=9,
            path_effects=style.halo(2.0),
            parse_math=False,
        )


def label_place(parts: Sequence[FloatArray]) -> FloatArray:
    """Centroid of the largest convex part: always inside the region, wherever it is hollow."""
    best, place = -1.0, parts[0].mean(axis=0)
    for part in parts:
        x, y = (part - part[0]).T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        area = cross.sum() / 2.0
        if area > best and area > 0.0:
            best = area
            place = part[0] + ((part - part[0] + np.roll(part - part[0], -1, axis=0)) * cross[:, None]).sum(
                axis=0
            ) / (6 * area)
    return np.asarray(place, float)


def edges(forest: Forest, limit: int = VERTICES) -> FloatArray:
    """Edges (n, 2, 2) [m] of all trees, each as it was when all together had ``limit`` vertices."""
    share = max(1, limit // max(1, len(forest.trees)))
    pieces = []
    for tree in forest.trees:
        child = np.flatnonzero(tree.parent[:share] >= 0)
        pieces.append(np.stack([tree.x[tree.parent[child]], tree.x[child]], axis=1))
    return np.concatenate(pieces) if pieces else np.empty((0, 2, 2))


def _trees(chart: Map, forest: Forest) -> None:
    lines = edges(forest) * chart.per_metre
    alpha = float(np.clip(2500.0 / max(1, len(lines)), 0.10, 0.5))  # as many as there are, about as dark
    chart.ax.add_collection(
        LineCollection(
            list(lines), colors=style.STONE, linewidths=0.3, alpha=alpha, rasterized=True, zorder=1.0
        ),
        autolim=False,
    )


def _ellipses(chart: Map, x: FloatArray, cov: FloatArray) -> None:
    """Every few steps, the last one always."""
    stride = max(1, -(-(len(x) - 1) // ELLIPSES))
    rows = np.arange(len(x) - 1, 0, -stride)
    outlines = style.ellipses(x[rows], cov[rows]) * chart.per_metre
    chart.ax.add_collection(
        PolyCollection(
            list(outlines), facecolors=style.BLUE + "14", edgecolors=style.BLUE, linewidths=0.5, zorder=5
        ),
        autolim=False,
    )


def _flights(chart: Map, deployment: Deployment, count: int, color: str) -> None:
    """The first ``count`` flights, so that those which failed are seen as often as they are."""
    good = (deployment.accepted & ~deployment.collided)[:count]
    for rows, shade, z in ((good, color, 4.5), (~good, style.VERMILLION, 4.6)):
        lines = deployment.x[: len(good)][rows] * chart.per_metre
        chart.ax.add_collection(
            LineCollection(list(lines), colors=shade, linewidths=0.45, alpha=0.6, rasterized=True, zorder=z),
            autolim=False,
        )


def _line(chart: Map, x: FloatArray) -> None:
    chart.ax.plot(
        *(x * chart.per_metre).T,
        color=style.BLUE,
        lw=1.3,
        zorder=6,
        path_effects=style.halo(2.2),
        solid_joinstyle="round",
    )


def _ends(chart: Map, scene: Scene, plan: Plan | None) -> None:
    marks = [(scene.start, "o", 4.0)] + ([(plan.path.x[-1], "s", 4.0)] if plan is not None else [])
    for place, marker, size in marks:
        chart.ax.plot(
            *(place * chart.per_metre),
            marker=marker,
            ms=size,
            mfc="white",
            mec="black",
            mew=0.9,
            zorder=8,
            clip_on=False,
        )


def _keys(
    forest: Forest | None, plan: Plan | None, deployments: Mapping[str, Deployment], count: int
) -> list[Artist]:
    """What the symbols mean, and how many of each are drawn where that is not all."""
    keys: list[Artist] = []
    if plan is not None:
        keys.append(Line2D([], [], color=style.BLUE, lw=1.3, label="planned path (mean)"))
        keys.append(Patch(fc=style.BLUE + "14", ec=style.BLUE, lw=0.5, label="95 % of positions"))
    for color, (law, d) in zip(_cycle(style.FLIGHTS, len(deployments)), deployments.items(), strict=True):
        name = f"{law} winds: " if len(deployments) > 1 else "flights: "
        keys.append(Line2D([], [], color=color, lw=0.8, label=f"{name}{min(count, len(d.x))} of {len(d.x)}"))
    if deployments:
        bad = " and ".join(str(int((~d.accepted | d.collided).sum())) for d in deployments.values())
        runs = max(len(d.x) for d in deployments.values())
        keys.append(Line2D([], [], color=style.VERMILLION, lw=0.8, label=f"failed: {bad} of {runs}"))
    keys.append(Patch(fc=style.GREEN + "30", ec=style.GREEN, lw=1.0, label="region"))
    keys.append(Patch(fc="#6E6E6E", ec="#4A4A4A", lw=0.5, label="obstacle"))
    if forest is not None:
        total = sum(map(len, forest.trees))
        label = f"{total:,} vertices" if total <= VERTICES else f"{VERTICES:,} of {total:,} vertices"
        keys.append(Line2D([], [], color=style.STONE, lw=0.6, alpha=0.8, label=label))
    keys.append(Line2D([], [], color=style.MIST, lw=0.7, ls=":", label="cells"))
    keys.append(Line2D([], [], ls="", marker="o", ms=4, mfc="white", mec="black", mew=0.9, label="start"))
    if plan is not None:
        keys.append(Line2D([], [], ls="", marker="s", ms=4, mfc="white", mec="black", mew=0.9, label="end"))
    return keys


def _heading(plan: Plan | None, forest: Forest | None, deployments: Mapping[str, Deployment]) -> list[str]:
    """The formula, and what is promised; or that there is no plan."""
    if plan is None:
        grown = (
            ""
            if forest is None
            else f" ({len(forest.trees)} trees, {sum(map(len, forest.trees)):,} vertices)"
        )
        return [
            "No plan: no path completes the mission"
            if forest is None or not len(forest.accepted)
            else "No plan: no path satisfies the selection rule",
            f"Trees as far as they came{grown}",
        ]
    o = plan.path.objectives
    mission, collision = percent(mission_risk(o, plan)), percent(o.collision_risk)
    promise = f"length {o.length / 1000:,.0f} km, mission risk ≤ {mission}, collision risk ≤ {collision}"
    return [*textwrap.wrap(plan.formula, 52, max_lines=2, placeholder=" …"), *textwrap.wrap(promise, 62)]


# --- wind --------------------------------------------------------------------------------------


def flight_middle(scene: Scene, plan: Plan | None) -> tuple[float, str]:
    """Half-way through the flight [s since time_zero], departure without one; and that in words."""
    t = 0.0 if plan is None else float(plan.path.t[0] + plan.path.t[-1]) / 2.0
    words = (
        "at departure"
        if plan is None
        else f"at mid-flight ({t / 3600:.1f} h)"
        if t >= 3600
        else f"at mid-flight ({t:.0f} s)"
    )
    return t, words


def clock(scene: Scene, t: float) -> str:
    """``9 October 2018 12:30 UTC`` for ``t`` [s since time_zero], empty on a map without a clock."""
    if scene.time_zero is None:
        return ""
    when = datetime.fromisoformat(scene.time_zero) + timedelta(seconds=t)
    return f"{when.day} {when:%b %Y, %H:%M} UTC"


def between(times: FloatArray, values: FloatArray, t: float) -> FloatArray:
    """``values`` (K, ...) at ``t`` [s], linear between slots and constant outside of them."""
    t = float(np.clip(t, times[0], times[-1]))
    k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(0, len(times) - 2)))
    if len(times) == 1:
        return np.asarray(values[0], float)
    w = (t - times[k]) / (times[k + 1] - times[k])
    mixed: FloatArray = (1.0 - w) * values[k] + w * values[k + 1]
    return mixed


def _nodes(wind: WindField) -> tuple[FloatArray, FloatArray]:
    nx, ny = wind.mean.shape[1:3]
    return wind.origin[0] + wind.spacing * np.arange(nx), wind.origin[1] + wind.spacing * np.arange(ny)


def _every(nodes: FloatArray, low: float, high: float, gap: float) -> IntArray:
    """Indices of nodes between ``low`` and ``high``, about ``gap`` apart and centred."""
    inside = np.flatnonzero((nodes >= low - 1e-6) & (nodes <= high + 1e-6))
    if len(inside) < 2:
        return inside
    stride = max(1, round(gap / (nodes[1] - nodes[0])))
    return inside[(len(inside) - 1) % stride // 2 :: stride]


def _arrows(
    chart: Map, scene: Scene, wind: WindField, t: float, text: str, left: float, bottom: float
) -> None:
    """The mean wind on a part of the lattice's own nodes, and beneath the map what an arrow stands for.

    The longest arrow spans nine tenths of the gap between two.
    """
    figure, ax = chart.ax.figure, chart.ax
    assert isinstance(figure, Figure)
    (west, south), (east, north) = scene.bounds
    x, y = _nodes(wind)
    gap = max(east - west, north - south) / ARROWS
    i, j = _every(x, west + gap / 4, east - gap / 4, gap), _every(y, south + gap / 4, north - gap / 4, gap)
    field = between(wind.times, wind.mean, t)[np.ix_(i, j)]
    speed = np.hypot(field[..., 0], field[..., 1])
    if speed.size == 0 or not speed.max() > 0:
        style.note(figure, left, bottom, f"{text}: calm", va="center", fontsize=6.5)
        return
    inches = ax.get_position().width * figure.get_size_inches()[0] * gap / (east - west)
    scale = float(speed.max()) / (0.95 * inches)
    quiver = ax.quiver(
        *(np.meshgrid(x[i] * chart.per_metre, y[j] * chart.per_metre, indexing="ij")),
        field[..., 0],
        field[..., 1],
        color=style.SKY,
        pivot="mid",
        scale=scale,
        scale_units="inches",
        units="inches",
        width=0.009,
        headwidth=3.6,
        headlength=4.2,
        headaxislength=3.8,
        minshaft=1.5,
        zorder=2.8,
    )
    w, h = figure.get_size_inches()
    unit = style.nice(float(speed.max()))
    ax.quiverkey(
        quiver, (left + unit / scale / 2) / w, bottom / h, unit, "", coordinates="figure", color=style.SKY
    )
    style.note(figure, left + unit / scale + 0.06, bottom, f"{unit:g} m/s, {text}", va="center", fontsize=6.5)


def wind_figure(scene: Scene, wind: WindField, plan: Plan | None) -> Figure:
    """Expected wind with its direction, and the standard deviation of a prediction, on the whole lattice."""
    t, moment = flight_middle(scene, plan)
    mean, latent = between(wind.times, wind.mean, t), between(wind.times, wind.latent_var, t)
    gust = between(wind.times, wind.gust_var, t)
    x, y = _nodes(wind)
    inner, west = 2.35, 0.48
    height = inner * float(np.clip(np.ptp(y) / max(np.ptp(x), 1.0), 0.35, 1.6))
    figure = style.blank(style.PAGE, height + 0.85)
    deviation = np.sqrt((latent + gust).mean(axis=-1))  # of one component, averaged over both
    panels = (
        ("(a) Expected wind", "speed [m/s]", np.hypot(mean[..., 0], mean[..., 1]), "viridis"),
        ("(b) Standard deviation of a component", "standard deviation [m/s]", deviation, "cividis"),
    )
    for n, (title, label, values, cmap) in enumerate(panels):
        left = west + n * style.PAGE / 2
        chart = _map(scene, style.box(figure, left, 0.42, inner, height))
        _surface(chart, wind, values, cmap)
        _outlines(chart, scene)
        if n == 0:
            _streams(chart, wind, mean)
        bar = figure.colorbar(
            chart.ax.images[0], cax=style.box(figure, left + inner + 0.08, 0.42, 0.09, height)
        )
        bar.set_label(label)
        bar.outline.set_linewidth(0.5)
        style.note(figure, left, 0.42 + height + 0.05, title, va="bottom", fontweight="bold")
    when = ", ".join(
        text for text in (clock(scene, t), moment, f"source: {wind.source}" if wind.source else "") if text
    )
    style.note(figure, west, 0.42 + height + 0.22, when[:1].upper() + when[1:], va="bottom")
    return figure


def _surface(chart: Map, wind: WindField, values: FloatArray, cmap: str) -> None:
    """``values`` (NX, NY) as colour, bilinear as the planner reads them; axes reach as far as the lattice."""
    x, y = (nodes * chart.per_metre for nodes in _nodes(wind))
    half = wind.spacing * chart.per_metre / 2.0
    extent = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-3:  # a constant field: a scale that shows it as such
        low, high = low - 0.5 if low >= 0.5 else 0.0, high + 0.5
    chart.ax.imshow(
        values.T,
        origin="lower",
        extent=extent,
        cmap=cmap,
        norm=Normalize(low, high),
        interpolation="bilinear",
        zorder=0,
    )
    chart.ax.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))


def _streams(chart: Map, wind: WindField, mean: FloatArray) -> None:
    """Directions; the length of an arrow goes with speed, which the colour tells exactly."""
    x, y = _nodes(wind)
    gap = max(np.ptp(x), np.ptp(y)) / ARROWS
    i, j = _every(x, x[0], x[-1], gap), _every(y, y[0], y[-1], gap)
    field = mean[np.ix_(i, j)]
    top = float(np.hypot(field[..., 0], field[..., 1]).max())
    if top > 0:
        chart.ax.quiver(
            *np.meshgrid(x[i] * chart.per_metre, y[j] * chart.per_metre, indexing="ij"),
            field[..., 0],
            field[..., 1],
            color="white",
            pivot="mid",
            angles="xy",
            scale=top / (0.95 * gap * chart.per_metre),
            scale_units="xy",
            units="inches",
            width=0.011,
            headwidth=3.6,
            headlength=4.2,
            headaxislength=3.8,
            minshaft=1.5,
            zorder=4,
        )


def _outlines(chart: Map, scene: Scene) -> None:
    """Bounds, obstacles and regions as thin lines, to find one's way."""
    (west, south), (east, north) = scene.bounds
    frame = np.array([[west, south], [east, south], [east, north], [west, north]])
    for polygons, width in (([frame], 0.9), ([*scene.obstacles, *scene.regions.values()], 0.5)):
        chart.ax.add_collection(
            PolyCollection(
                [p * chart.per_metre for p in polygons],
                facecolors="none",
                edgecolors="black",
                linewidths=width,
                zorder=3,
            ),
            autolim=False,
        )
    for name, polygon in scene.regions.items():
        x, y = polygon.mean(axis=0) * chart.per_metre
        chart.ax.text(
            x,
            y,
            name,
            ha="center",
            va="center",
            fontweight="bold",
            zorder=9,
            path_effects=style.halo(1.6),
            parse_math=False,
        )


# --- the front ---------------------------------------------------------------------------------


def mission_risk(objectives: Objectives, plan: Plan | None) -> float:
    """The bound a plan was chosen by: V for full fidelity, Theorem 2's f_o for the paper's."""
    full = plan is not None and plan.fidelity == "full"
    return objectives.mission_risk if full else objectives.mission_risk_paper


def percent(probability: float) -> str:
    """``0.62 %``; what is smaller than any promise about the wind is worth comes as a bound."""
    if probability < 1e-9:
        return "10⁻⁷\N{NO-BREAK SPACE}%"
    if probability < 1e-5:
        mantissa, power = f"{100 * probability:.1e}".split("e")
        raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"{mantissa}·10{raised}\N{NO-BREAK SPACE}%"
    return f"{100 * probability:.2g}\N{NO-BREAK SPACE}%"


def front_figure(scene: Scene, forest: Forest | None, front: Front, plan: Plan | None) -> Figure:
    """Mission risk against length, collision risk as colour: accepted vertices, both fronts."""
    unit, per_metre = length_unit(scene)
    after, before = (
        np.array([[o.length * per_metre, mission_risk(o, plan), o.collision_risk] for o in rows]).reshape(
            -1, 3
        )
        for rows in ([p.objectives for p in front.paths], front.raw)
    )
    cloud = accepted(forest, plan is not None and plan.fidelity == "full") * [per_metre, 1.0]
    figure = style.blank(style.COLUMN, 2.75)
    ax = style.box(figure, 0.58, 0.38, 2.22, 1.82)
    low, hidden = style.floor_of(np.concatenate([after[:, 1], before[:, 1], cloud[:, 1]]))
    norm, lowest = _collision_scale(np.concatenate([after[:, 2], before[:, 2]]))
    ax.scatter(
        cloud[:, 0],
        np.maximum(cloud[:, 1], low),
        s=2.0,
        c=style.MIST,
        alpha=0.5,
        lw=0,
        rasterized=True,
        zorder=1,
    )
    for rows, marker, size, edge, z in ((before, "s", 13.0, style.STONE, 3), (after, "o", 24.0, "black", 4)):
        ax.scatter(
            rows[:, 0],
            np.maximum(rows[:, 1], low),
            c=np.maximum(rows[:, 2], float(norm.vmin or 0.0)),
            norm=norm,
            cmap="cividis",
            marker=marker,
            s=size,
            edgecolors=edge,
            linewidths=0.6,
            zorder=z,
            clip_on=False,
        )
    if plan is not None:
        o = plan.path.objectives
        ax.plot(
            o.length * per_metre,
            max(mission_risk(o, plan), low),
            marker="o",
            ms=8.5,
            mfc="none",
            mec=style.VERMILLION,
            mew=1.3,
            ls="",
            zorder=5,
            clip_on=False,
        )
    _risk_axis(ax, low, hidden)
    ax.set(xlabel=f"path length [{unit}]", ylabel="mission risk (bound)")
    ax.xaxis.set_major_locator(MaxNLocator(5))
    _collision_bar(figure, ax, lowest)
    _front_legend(figure, cloud, before, plan)
    return figure


def accepted(forest: Forest | None, full: bool = False) -> FloatArray:
    """Length [m] and f_o, or V of full fidelity, of every accepted vertex, shape (A, 2)."""
    if forest is None or not len(forest.accepted):
        return np.empty((0, 2))
    rows = []
    for tree_number in np.unique(forest.accepted[:, 0]):
        tree, vertices = forest.trees[tree_number], forest.accepted[forest.accepted[:, 0] == tree_number, 1]
        risk = tree.risk[vertices, 0] if full else tree.risk[vertices].sum(axis=1)
        rows.append(np.column_stack([tree.length[vertices], np.minimum(1.0, risk)]))
    return np.concatenate(rows)


def _risk_axis(ax: Axes, low: float, hidden: bool) -> None:
    """A logarithmic axis up to 1; where smaller values are drawn at its end, the end says ``≤``."""
    ax.set_yscale("log")
    ax.set_ylim(low, 1.0)
    ax.yaxis.set_major_locator(LogLocator(numticks=7))
    if hidden:
        ax.yaxis.set_major_locator(
            FixedLocator([low, *(t for t in ax.yaxis.get_majorticklocs() if low < t <= 1.0)])
        )
        ax.yaxis.set_major_formatter(
            FuncFormatter(lambda value, _: power_of_ten(value, bound=value <= low * 1.01))
        )
        ax.axhline(low, color=style.STONE, lw=1.0, ls=(0, (2, 2)), zorder=2, clip_on=False)
        ax.spines["bottom"].set_visible(False)
    ax.grid(axis="y", color="#E5E5E5", lw=0.4)
    ax.spines[["top", "right"]].set_visible(False)


def power_of_ten(value: float, bound: bool = False) -> str:
    exponent = round(float(np.log10(value)))
    return f"$\\leq10^{{{exponent}}}$" if bound else f"$10^{{{exponent}}}$"


def _collision_scale(risks: FloatArray) -> tuple[LogNorm, bool]:
    low, hidden = style.floor_of(risks)
    high = max(10.0 ** np.ceil(np.log10(max(float(risks.max(initial=0.0)), low)) - 1e-9), 10.0 * low)
    return LogNorm(low, high), hidden


def _collision_bar(figure: Figure, ax: Axes, hidden: bool) -> None:
    bar = figure.colorbar(ax.collections[-1], cax=style.box(figure, 2.92, 0.38, 0.09, 1.82))
    bar.set_label("collision risk (bound)")
    bar.outline.set_linewidth(0.5)
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
    low = float(bar.norm.vmin or 0.0)
    if hidden:
        bar.ax.yaxis.set_major_formatter(
            FuncFormatter(lambda value, _: power_of_ten(value, bound=value <= low * 1.01))
        )


def _front_legend(figure: Figure, cloud: FloatArray, before: FloatArray, plan: Plan | None) -> None:
    def mark(label: str, marker: str, size: float, face: str, edge: str, width: float = 0.6) -> Line2D:
        return Line2D([], [], ls="", marker=marker, ms=size, mfc=face, mec=edge, mew=width, label=label)

    keys = [mark("front after smoothing", "o", 4.9, "#7C7B78", "black")]
    if len(before):
        keys.append(mark("front before", "s", 3.6, "#7C7B78", style.STONE))
    if plan is not None:
        keys.append(mark("chosen plan", "o", 7.0, "none", style.VERMILLION, 1.3))
    if len(cloud):
        keys.append(mark(f"{len(cloud):,} accepted vertices", "o", 2.5, style.MIST, style.MIST))
    figure.legend(
        handles=keys,
        ncols=2,
        loc="lower left",
        bbox_to_anchor=(0.52 / style.COLUMN, 2.28 / 2.75),
        borderaxespad=0.0,
        borderpad=0.0,
        handletextpad=0.3,
        columnspacing=1.2,
        labelspacing=0.35,
    )


__all__ = ["draw", "front_figure", "plan_figure", "wind_figure"]
