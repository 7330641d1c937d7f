"""Layers of a map figure: scene, cells, trees, paths, flights."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.ticker import MaxNLocator

from pareto_ltl.planning.records import Forest, Plan
from pareto_ltl.report import style
from pareto_ltl.report.map_labels import (
    LEADING,
    covering_points,
    fits_inside,
    label_half_size,
    label_position,
    line_height,
    place_in_polygon,
)
from pareto_ltl.report.timed_places import time_lines, timed_obstacles, visited_outlines
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import in_kilometres
from pareto_ltl.world.cells import Decomposition, convex_pieces
from pareto_ltl.world.scene import Scene

DRAWN_VERTICES = 12_000  # tree vertices drawn, at most: a second for 50,000, which merge into one grey area
NAME_SIZE, TIME_SIZE = 8.5, 6.0  # font sizes of a region's name, and of its times [pt]
FORBIDDEN = re.compile("(?<=^forbidden) ")
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])  # of a label, in its half sizes
DRAWN_ELLIPSES = 14  # approximate number of covariance ellipses along a path
REGION_LOOK: dict[str, Any] = {"fc": style.GREEN + "30", "ec": style.GREEN, "lw": 1.0}
OBSTACLE_LOOK: dict[str, Any] = {"fc": "#6E6E6E", "ec": "#4A4A4A", "lw": 0.5}
TIMED_LOOK: dict[str, Any] = {"fc": "#6E6E6E40", "ec": "#4A4A4A", "lw": 0.8, "ls": "--", "hatch": "/////"}
LANDMARK_LOOK: dict[str, Any] = {"fc": "none", "ec": style.PURPLE, "lw": 0.9, "ls": "--"}


@dataclass(frozen=True, slots=True)
class MapAxes:
    """Axes of a map with equal scales; ``per_metre`` is the number of ``unit`` in a metre."""

    ax: Axes
    unit: str
    per_metre: float


def length_unit(scene: Scene) -> tuple[str, float]:
    """Name of the length unit of a map, and units per metre: m if the scene is smaller than 2 km, else km."""
    return ("km", 1e-3) if in_kilometres(float(np.ptp(scene.bounds, axis=0).max())) else ("m", 1.0)


def map_axes(scene: Scene, ax: Axes) -> MapAxes:
    """Set limits, labels and ticks of ``ax`` for the bounds of ``scene``."""
    unit, per_metre = length_unit(scene)
    (west, south), (east, north) = scene.bounds * per_metre
    ax.set(xlim=(west, east), ylim=(south, north), xlabel=f"east [{unit}]", ylabel=f"north [{unit}]")
    ax.set_aspect("equal", adjustable="box", anchor="SW")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    return MapAxes(ax, unit, per_metre)


def draw_graticule(chart: MapAxes, scene: Scene) -> None:
    """Ticks of longitude on the northern edge and of latitude on the eastern edge, for a scene with a CRS."""
    if scene.crs is None:
        return
    from pareto_ltl.world.projection import to_geographic

    (west, south), (east, north) = scene.bounds
    x, y = np.linspace(west, east, 101), np.linspace(south, north, 101)
    lon = np.unwrap(to_geographic(scene.crs, np.column_stack([x, np.full_like(x, north)]))[0], period=360.0)
    lat = to_geographic(scene.crs, np.column_stack([np.full_like(y, east), y]))[1]
    meridians = [
        (p, style.degree_text((d + 180.0) % 360.0 - 180.0, "E", "W"))
        for p, d in style.round_crossings(x, lon)
    ]
    parallels = [(p, style.degree_text(d, "N", "S")) for p, d in style.round_crossings(y, lat)]
    for axis, marks in (
        (chart.ax.secondary_xaxis("top").xaxis, meridians),
        (chart.ax.secondary_yaxis("right").yaxis, parallels),
    ):
        axis.set_ticks([place * chart.per_metre for place, _ in marks], [text for _, text in marks])
        axis.set_tick_params(pad=1.5, colors=style.STONE, labelsize=6.0)


def draw_polygons(chart: MapAxes, polygons: Iterable[FloatArray], **look: Any) -> None:
    """``polygons`` (n, 2) [m] each, with the properties ``look`` of a PolyCollection."""
    collection = PolyCollection([polygon * chart.per_metre for polygon in polygons], **look)
    chart.ax.add_collection(collection, autolim=False)


def draw_lines(chart: MapAxes, lines: Iterable[FloatArray], **look: Any) -> None:
    """``lines`` (n, 2) [m] each, as pixels in vector files, with the properties ``look``."""
    chart.ax.add_collection(line_layer(lines, chart.per_metre, **look), autolim=False)


def line_layer(lines: Iterable[FloatArray], per_metre: float, **look: Any) -> LineCollection:
    """``lines`` (n, 2) [m] each in the unit of a map that has ``per_metre`` of them in a metre."""
    return LineCollection([line * per_metre for line in lines], rasterized=True, **look)


def draw_ground(chart: MapAxes, scene: Scene, decomposition: Decomposition | None) -> None:
    """Cells dotted, obstacles filled (hatched if for a time), landmarks dashed, regions outlined."""
    cells = () if decomposition is None else decomposition.cells
    draw_polygons(
        chart, cells, facecolors="none", edgecolors=style.MIST, linewidths=0.35, linestyles=":", zorder=1.5
    )
    draw_polygons(chart, scene.obstacles, **OBSTACLE_LOOK, zorder=3)
    draw_polygons(chart, timed_obstacles(scene), **TIMED_LOOK, zorder=2.9)
    draw_polygons(chart, scene.landmarks, **LANDMARK_LOOK, zorder=2.6)
    draw_polygons(chart, visited_outlines(scene), **REGION_LOOK, zorder=2.5)


def number_obstacles(chart: MapAxes, scene: Scene, colour: str) -> None:
    """The name of each obstacle in which it fits, or else its number, by which texts name it too."""
    scale = metres_per_inch(chart)
    names = scene.obstacle_names or ("",) * len(scene.obstacles)
    for number, (outline, name) in enumerate(zip(scene.obstacles, names, strict=True), 1):
        fitting = (
            (text, place) for text in (name, str(number))
            if text
            and (
                place := place_in_polygon(outline, label_half_size([(text, TIME_SIZE)], scale), scene.bounds)
            ) is not None
        )  # fmt: skip
        if (found := next(fitting, None)) is None:
            continue
        label, (x, y) = found[0], found[1] * chart.per_metre
        chart.ax.text(
            x,
            y,
            label,
            color=colour,
            fontsize=TIME_SIZE,
            ha="center",
            va="center",
            zorder=3.1,
            clip_on=True,
        )


def name_regions(
    chart: MapAxes,
    scene: Scene,
    decomposition: Decomposition | None,
    taken: FloatArray | None = None,
    *,
    times: bool = True,
) -> None:
    """Names and times of the regions, at places that do not cover the points ``taken`` (n, 2) [m].

    Without ``times`` only the names are drawn, for a map of several departures.
    """
    scale = metres_per_inch(chart)
    smallest = label_half_size([("a", TIME_SIZE)], scale)
    grounds = [
        covering_points(outline, smallest)
        for outline in (*scene.obstacles, *timed_obstacles(scene), *visited_outlines(scene), *scene.landmarks)
    ]
    written: list[FloatArray] = []
    named = {
        name: _convex_region(scene, decomposition, name) for name, there in scene.regions.items() if there
    }
    texts = {
        name: [(name, NAME_SIZE)] + [(text, TIME_SIZE) for text in _short_lines(scene, name) if times]
        for name in named
    }
    inside = {
        name: fits_inside(parts, label_half_size(texts[name][:1], scale)) for name, parts in named.items()
    }
    for name in sorted(named, key=lambda name: not inside[name]):  # the others avoid those that are inside
        lines, half = texts[name], label_half_size(texts[name], scale)
        blocked = np.vstack([*grounds, *written]) if grounds or written else None
        place = _label_place(named[name], lines, scale, taken, scene.bounds, blocked)
        written.append(covering_points(place + half * CORNERS, smallest))
        _write_lines(chart, place, lines, "#333333" if name in scene.forbidden else "#00523C")


def _short_lines(scene: Scene, name: str) -> list[str]:
    """The times of a region, with ``forbidden`` on a separate line: long names rarely find a free place."""
    return [part for line in time_lines(scene, name) for part in FORBIDDEN.split(line, maxsplit=1)]


def _label_place(
    parts: Sequence[FloatArray],
    lines: Sequence[tuple[str, float]],
    scale: float,
    taken: FloatArray | None,
    bounds: FloatArray,
    blocked: FloatArray | None,
) -> FloatArray:
    """Centre (2,) [m] of ``lines``: inside the region, or with only the first line inside, or beside it.

    ``scale`` is the scale of the map [m/in].
    """
    whole, first = label_half_size(lines, scale), label_half_size(lines[:1], scale)
    if len(lines) > 1 and not fits_inside(parts, whole) and fits_inside(parts, first):
        below = np.array([0.0, whole[1] - first[1]])
        place = label_position(parts, first, taken) - below
        return np.asarray(np.clip(place, bounds[0] + whole, np.maximum(bounds[0], bounds[1] - whole)), float)
    return label_position(parts, whole, taken, bounds, blocked)


def _convex_region(scene: Scene, decomposition: Decomposition | None, name: str) -> Sequence[FloatArray]:
    """Convex parts of a region, or its outlines if there are none."""
    if decomposition is not None:
        return decomposition.regions.get(name, scene.regions[name])
    from shapely import Polygon

    return convex_pieces(scene, map(Polygon, scene.regions[name])) or scene.regions[name]


def _write_lines(chart: MapAxes, place: FloatArray, lines: Sequence[tuple[str, float]], colour: str) -> None:
    """``lines`` (text, size [pt]) centred at ``place`` (2,) [m], the first of them bold."""
    sizes = [size for _, size in lines]
    look: dict[str, Any] = {"ha": "center", "color": colour, "parse_math": False, "zorder": 9}
    for k, (text, size) in enumerate(lines):
        below = line_height(sizes) / 2 - LEADING * sum(sizes[:k]) / 72.0 - 0.375 * size / 72.0
        x, y = (place + np.array([0.0, below]) * metres_per_inch(chart)) * chart.per_metre
        weight = "bold" if k == 0 else "normal"
        halo = style.white_halo(2.0 if k == 0 else 1.4)
        chart.ax.text(x, y, text, fontsize=size, fontweight=weight, va="center", path_effects=halo, **look)


def metres_per_inch(chart: MapAxes) -> float:
    """Metres on the map for an inch of the figure."""
    west, east = chart.ax.get_xlim()
    figure = chart.ax.figure
    inches = chart.ax.get_position().width * float(figure.get_size_inches()[0])  # type: ignore[union-attr]
    return (east - west) / chart.per_metre / inches


def tree_edges(forest: Forest, limit: int = DRAWN_VERTICES) -> FloatArray:
    """Edges (n, 2, 2) [m] of all trees; of each tree the oldest ``limit / trees`` vertices."""
    share = max(1, limit // max(1, len(forest.trees)))
    pieces = []
    for tree in forest.trees:
        child = np.flatnonzero(tree.parent[:share] >= 0)
        pieces.append(np.stack([tree.x[tree.parent[child]], tree.x[child]], axis=1))
    return np.concatenate(pieces) if pieces else np.empty((0, 2, 2))


def tree_layer(scene: Scene, forest: Forest) -> LineCollection:
    """All edges of :func:`tree_edges`; the more there are, the more transparent. 0.1 s for 25,000 of them."""
    lines = tree_edges(forest)
    alpha = float(np.clip(2500.0 / max(1, len(lines)), 0.10, 0.5))
    look: dict[str, Any] = {"colors": style.STONE, "linewidths": 0.3, "alpha": alpha, "zorder": 1.0}
    return line_layer(lines, length_unit(scene)[1], **look)


def draw_covariances(chart: MapAxes, x: FloatArray, cov: FloatArray) -> None:
    """95 % ellipses of about ``DRAWN_ELLIPSES`` steps, the last one included."""
    stride = max(1, -(-(len(x) - 1) // DRAWN_ELLIPSES))
    rows = np.arange(len(x) - 1, 0, -stride)
    outlines = style.confidence_ellipses(x[rows], cov[rows])
    draw_polygons(
        chart, outlines, facecolors=style.INK + "10", edgecolors=style.INK, linewidths=0.5, zorder=5
    )


def draw_flights(chart: MapAxes, deployment: Deployment, count: int) -> None:
    """The first ``count`` flights in the colour and dashes of their law; failed ones dark, with a cross.

    The flights are not selected: the share of failed ones in the figure estimates the failure rate.
    """
    law, flights = deployment.law, deployment.x[:count]
    good = ~deployment.failed[:count]
    flown: dict[str, Any] = {"colors": style.law_colour(law), "linestyles": [style.law_dashes(law)]}
    draw_lines(chart, flights[good], **flown, linewidths=0.45, alpha=0.6, zorder=4.5)
    failed: dict[str, Any] = {"colors": style.FAILED, "linestyles": [style.law_dashes(law)]}
    draw_lines(chart, flights[~good], **failed, linewidths=0.5, alpha=0.7, zorder=4.6)
    ends = flights[~good][:, -1] * chart.per_metre
    chart.ax.plot(*ends.T, "x", color=style.FAILED, ms=3.2, mew=0.7, zorder=6.5)


def draw_mean_path(chart: MapAxes, x: FloatArray) -> None:
    """The expected positions ``x`` (T+1, 2) [m] as a line."""
    chart.ax.plot(
        *(x * chart.per_metre).T,
        color=style.BLACK,
        lw=1.3,
        zorder=6,
        path_effects=style.white_halo(2.2),
        solid_joinstyle="round",
    )


def draw_endpoints(chart: MapAxes, scene: Scene, plan: Plan | None) -> None:
    """A circle at the start, and a square at the last expected position of ``plan``."""
    marks = [(scene.start, "o", 4.0)] + ([(plan.path.x[-1], "s", 4.0)] if plan is not None else [])
    for place, marker, size in marks:
        chart.ax.plot(
            *(place * chart.per_metre),
            marker=marker,
            ms=size,
            mfc="white",
            mec="black",
            mew=0.9,
            zorder=9.5,
            clip_on=False,
        )
