"""Layers of a map figure: scene, cells, trees, paths, flights, names. The axes of a map are in metres."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.figure import SubFigure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from careful_io.texts import in_kilometres
from careful_io.times import hours_text
from pareto_ltl import Scene
from pareto_ltl.extend import Decomposition, Deployment, Forest, Plan, Window
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.branches import COLORS
from pareto_ltl_apps.exports.ellipses import axes_of, ellipse_scale
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.lattice import oldest_edges

DRAWN_VERTICES = 12_000  # tree vertices drawn, at most: a second for 50,000, which merge into one grey area
NAME_SIZE, TIME_SIZE = 8.5, 6.0  # font sizes of a region's name, and of its times [pt]
FORBIDDEN = re.compile("(?<=^forbidden) ")
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])  # of a label, in its half sizes
DRAWN_ELLIPSES = 14  # approximate number of covariance ellipses along a path
REGION_LOOK: dict[str, Any] = {"fc": style.GREEN + "30", "ec": style.GREEN, "lw": 1.0}
OBSTACLE_LOOK: dict[str, Any] = {"fc": "#6E6E6E", "ec": "#4A4A4A", "lw": 0.5}
TIMED_LOOK: dict[str, Any] = {"fc": "#6E6E6E40", "ec": "#4A4A4A", "lw": 0.8, "ls": "--", "hatch": "/////"}
LANDMARK_LOOK: dict[str, Any] = {"fc": "none", "ec": style.PURPLE, "lw": 0.9, "ls": "--"}
START_LOOK: dict[str, Any] = {"marker": "o", "ls": "", "ms": 4, "mfc": "white", "mec": "black", "mew": 0.9}
END_LOOK = START_LOOK | {"marker": "s"}

Lines = Sequence[tuple[str, float]]  # texts and their font sizes [pt]


def inches_per_metre(chart: Axes) -> float:
    """Size in the figure of a metre of a map."""
    figure, (west, east) = chart.figure, chart.get_xlim()
    if isinstance(figure, SubFigure):
        return float(chart.get_window_extent().width) / figure.dpi / (east - west)
    return chart.get_position().width * float(figure.get_size_inches()[0]) / (east - west)


def length_unit(scene: Scene) -> tuple[str, float]:
    """Name of the length unit of a map, and units per metre: m if the scene is smaller than 2 km, else km."""
    return ("km", 1e-3) if in_kilometres(float(np.ptp(scene.bounds, axis=0).max())) else ("m", 1.0)


def map_axes(scene: Scene, ax: Axes) -> Axes:
    """Set limits, labels and ticks of ``ax`` for the bounds of ``scene``."""
    unit, per_metre = length_unit(scene)
    (west, south), (east, north) = scene.bounds
    ax.set(xlim=(west, east), ylim=(south, north), xlabel=f"east [{unit}]", ylabel=f"north [{unit}]")
    ax.set_aspect("equal", adjustable="box", anchor="SW")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
        axis.set_major_formatter(
            FuncFormatter(lambda x, _: f"{x * per_metre:.6g}".replace("-", "\N{MINUS SIGN}"))
        )
    return ax


def draw_graticule(chart: Axes, scene: Scene) -> None:
    """Ticks of longitude on the northern edge and of latitude on the eastern edge, for a scene with a CRS."""
    if scene.crs is None:
        return

    (west, south), (east, north) = scene.bounds
    x, y = np.linspace(west, east, 101), np.linspace(south, north, 101)
    lon = np.unwrap(scene.frame.to_geographic(np.column_stack([x, np.full_like(x, north)]))[0], period=360.0)
    lat = scene.frame.to_geographic(np.column_stack([np.full_like(y, east), y]))[1]
    for axis, along, degrees, signs in (
        (chart.secondary_xaxis("top").xaxis, x, lon, ("E", "W")),
        (chart.secondary_yaxis("right").yaxis, y, lat, ("N", "S")),
    ):
        order, (low, high) = np.argsort(degrees), (degrees.min(), degrees.max())
        ticks = MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(low, high) if high > low else np.empty(0)
        marks = np.array([tick for tick in ticks if low <= tick <= high])
        texts = [_degree_text((round(mark, 6) + 180.0) % 360.0 - 180.0, signs) for mark in marks]
        axis.set_ticks(np.interp(marks, degrees[order], along[order]), texts)
        axis.set_tick_params(pad=1.5, colors=style.STONE, labelsize=6.0)


def _degree_text(value: float, signs: tuple[str, str]) -> str:
    """``92°W`` for -92 and the signs of east and west."""
    side = "" if value == 0.0 else signs[0] if value > 0.0 else signs[1]
    return f"{abs(value):g}°{side}"


def draw_polygons(chart: Axes, polygons: Iterable[FloatArray], **look: Any) -> None:
    """``polygons`` (n, 2) [m] each, with the properties ``look`` of a PolyCollection."""
    chart.add_collection(PolyCollection(list(polygons), **look), autolim=False)


def draw_lines(chart: Axes, lines: Iterable[FloatArray], **look: Any) -> None:
    """``lines`` (n, 2) [m] each, as pixels in vector files, with the properties ``look``."""
    chart.add_collection(LineCollection(list(lines), rasterized=True, **look), autolim=False)


def draw_text(chart: Axes, place: FloatArray, text: str, **look: Any) -> None:
    """``text`` centred at ``place`` (2,) [m]."""
    plain: dict[str, Any] = {"ha": "center", "va": "center", "zorder": 9, "parse_math": False}
    x, y = place.tolist()
    chart.text(x, y, text, **(plain | look))


def draw_ground(chart: Axes, scene: Scene, decomposition: Decomposition | None) -> None:
    """Cells dotted, obstacles filled (hatched if for a time), landmarks dashed, regions outlined."""
    cells = () if decomposition is None else decomposition.cells
    draw_polygons(chart, cells, fc="none", ec=style.MIST, lw=0.35, ls=":", zorder=1.5)
    draw_polygons(chart, scene.obstacles, **OBSTACLE_LOOK, zorder=3)
    draw_polygons(chart, timed_obstacles(scene), **TIMED_LOOK, zorder=2.9)
    draw_polygons(chart, scene.landmarks, **LANDMARK_LOOK, zorder=2.6)
    draw_polygons(chart, visited_outlines(scene), **REGION_LOOK, zorder=2.5)


def number_obstacles(chart: Axes, scene: Scene) -> None:
    """The name of each obstacle in which it fits, or else its number, by which texts name it too."""
    scale = 1.0 / inches_per_metre(chart)
    names = scene.obstacle_names or ("",) * len(scene.obstacles)
    for number, (outline, name) in enumerate(zip(scene.obstacles, names, strict=True), 1):
        area = area_on_map([outline], scene.bounds)
        for text in filter(None, (name, str(number))):
            half = label_half_size([(text, TIME_SIZE)], scale)
            if len(places_inside(area, half)):
                place = label_position(area, half, scene.bounds)
                draw_text(chart, place, text, color="white", fontsize=TIME_SIZE, zorder=3.1, clip_on=True)
                break


def name_regions(chart: Axes, scene: Scene, taken: FloatArray | None = None, *, times: bool = True) -> None:
    """Names and times of the regions, at places that do not cover the points ``taken`` (n, 2) [m].

    Without ``times`` only the names are drawn, for a map of several departures.
    """
    scale = 1.0 / inches_per_metre(chart)
    smallest = label_half_size([("a", TIME_SIZE)], scale)
    blocked = [
        covering_points(outline, smallest)
        for outline in (*scene.obstacles, *timed_obstacles(scene), *visited_outlines(scene), *scene.landmarks)
    ]
    areas = {name: area_on_map(there, scene.bounds, scene.obstacles) for name, there in scene.regions.items()}
    texts = {
        name: [(name, NAME_SIZE)] + [(text, TIME_SIZE) for text in _short_lines(scene, name) if times]
        for name, area in areas.items() if not area.is_empty
    }  # fmt: skip
    outside = {
        name: not len(places_inside(areas[name], label_half_size(lines[:1], scale)))
        for name, lines in texts.items()
    }
    for name in sorted(texts, key=outside.__getitem__):  # the others avoid those that are inside
        lines, area = texts[name], areas[name]
        whole, first = label_half_size(lines, scale), label_half_size(lines[:1], scale)
        if outside[name] or len(lines) == 1 or len(places_inside(area, whole)):
            place = label_position(area, whole, scene.bounds, taken, np.vstack(blocked))
        else:  # only the first line lies inside
            place = label_position(area, first, scene.bounds, taken) - [0.0, whole[1] - first[1]]
            low, high = scene.bounds
            place = np.clip(place, low + whole, np.maximum(low, high - whole))
        blocked.append(covering_points(place + whole * CORNERS, smallest))
        _write_lines(chart, place, lines, "#333333" if name in scene.forbidden else "#00523C")


def _short_lines(scene: Scene, name: str) -> list[str]:
    """The times of a region, with ``forbidden`` on a separate line: long names rarely find a free place."""
    return [part for line in time_lines(scene, name) for part in FORBIDDEN.split(line, maxsplit=1)]


def _write_lines(chart: Axes, place: FloatArray, lines: Lines, colour: str) -> None:
    """``lines`` centred at ``place`` (2,) [m], the first of them bold."""
    sizes = [size for _, size in lines]
    for k, (text, size) in enumerate(lines):
        above = line_height(sizes) / 2 - LEADING * sum(sizes[:k]) / 72.0 - 0.375 * size / 72.0
        there = place + np.array([0.0, above / inches_per_metre(chart)])
        look = {"fontsize": size, "fontweight": "normal" if k else "bold", "color": colour}
        draw_text(chart, there, text, path_effects=style.white_halo(1.4 if k else 2.0), **look)


def draw_trees(chart: Axes, forest: Forest) -> None:
    """Edges to the oldest ``DRAWN_VERTICES`` vertices of all trees; the more, the more transparent."""
    lines = oldest_edges(forest, DRAWN_VERTICES)
    alpha = float(np.clip(2500.0 / max(1, len(lines)), 0.10, 0.5))
    draw_lines(chart, lines, colors=style.STONE, linewidths=0.3, alpha=alpha, zorder=1.0)


def draw_covariances(chart: Axes, x: FloatArray, cov: FloatArray) -> None:
    """95 % ellipses of about ``DRAWN_ELLIPSES`` steps, the last one included."""
    stride = max(1, -(-(len(x) - 1) // DRAWN_ELLIPSES))
    rows = np.arange(len(x) - 1, 0, -stride)
    major, minor, azimuth = axes_of(cov[rows])
    scale, turns = 2.0 * ellipse_scale(0.95), 90.0 - np.rad2deg(azimuth)
    look: dict[str, Any] = {"fc": style.INK + "10", "ec": style.INK, "lw": 0.5, "zorder": 5}
    look |= {"units": "xy", "offsets": x[rows], "offset_transform": chart.transData}
    chart.add_collection(EllipseCollection(scale * major, scale * minor, turns, **look), autolim=False)


def draw_flights(chart: Axes, deployment: Deployment, count: int) -> None:
    """The first ``count`` flights in the colour and dashes of their law; failed ones dark, with a cross.

    The flights are not selected: the share of failed ones in the figure estimates the failure rate.
    """
    law, flights, failed = deployment.law, deployment.x[:count], deployment.failed[:count]
    dashes: dict[str, Any] = {"linestyles": [style.law_dashes(law)]}
    colour = style.law_colour(law)
    draw_lines(chart, flights[~failed], **dashes, colors=colour, linewidths=0.45, alpha=0.6, zorder=4.5)
    draw_lines(chart, flights[failed], **dashes, colors=style.FAILED, linewidths=0.5, alpha=0.7, zorder=4.6)
    chart.plot(*flights[failed][:, -1].T, "x", color=style.FAILED, ms=3.2, mew=0.7, zorder=6.5)


def draw_mean_path(chart: Axes, x: FloatArray) -> None:
    """The expected positions ``x`` (T+1, 2) [m] as a line."""
    look: dict[str, Any] = {"path_effects": style.white_halo(2.2), "solid_joinstyle": "round"}
    chart.plot(*x.T, color=style.BLACK, lw=1.3, zorder=6, **look)


def draw_branches(chart: Axes, plan: Plan) -> None:
    """The expected positions of each branch in its colour, its letter at the end, a diamond at each fix.

    What is flown after a second fix has the colour of the branch that it belongs to, in dots.
    """
    if plan.branching is None:
        return
    look: dict[str, Any] = {"path_effects": style.white_halo(1.6), "zorder": 5.9}
    for tree, branch in plan.branching.all_branches():
        x, again = branch.path.x, len(branch.name) > 1
        chart.plot(*x.T, color=branch_colour(branch.name), lw=1.1, ls=(0, (1, 1.2)) if again else "-", **look)
        chart.plot(*tree.fix.place, "D", color=style.ORANGE, mec=style.BLACK, mew=0.6, ms=4.0, zorder=9.4)


def branch_colour(name: str) -> str:
    """The colour of a branch and of the branches of it: the one of the card."""
    return COLORS["ABCD".index(name[0])]


def draw_endpoints(chart: Axes, scene: Scene, plan: Plan | None) -> None:
    """A circle at the start, and a square at the last expected position of ``plan``."""
    chart.plot(*scene.start, **START_LOOK, zorder=9.5, clip_on=False)
    if plan is not None:
        chart.plot(*plan.path.x[-1], **END_LOOK, zorder=9.5, clip_on=False)


# --- regions and obstacles that are active for a limited time ------------------------------------


def timed_obstacles(scene: Scene) -> tuple[FloatArray, ...]:
    """Outlines of all regions that are forbidden for a limited time."""
    barred = {scene.windows[name].region for name in scene.forbidden}
    return tuple(outline for name in scene.regions if name in barred for outline in scene.regions[name])


def visited_outlines(scene: Scene) -> tuple[FloatArray, ...]:
    """Outlines of the regions that a mission can visit: all that are not forbidden for a limited time."""
    free = (name for name in scene.regions if name not in scene.forbidden)
    return tuple(outline for name in free for outline in scene.regions[name])


def time_lines(scene: Scene, region: str) -> list[str]:
    """When ``region`` is active or forbidden, one line for each window.

    Examples are ``until 6 h`` and ``forbidden 3 to 5 h``. The line of a window that makes a proposition of
    another name begins with that name.
    """
    lines = []
    for name, window in scene.windows.items():
        if window.region == region:
            use = "forbidden" if name in scene.forbidden else name if name != region else ""
            lines.append(f"{use} {short_span(window)}".strip())
    return lines


def short_span(window: Window) -> str:
    """The times of a window after departure, abbreviated: ``3 to 5 h``, ``until 6 h``, ``from 90 min``."""
    if window.begin <= 0.0 and math.isinf(window.end):
        return "at any time"
    if window.begin <= 0.0:
        return f"until {hours_text(window.end)}"
    if math.isinf(window.end):
        return f"from {hours_text(window.begin)}"
    first, last = hours_text(window.begin), hours_text(window.end)
    unit = last.rpartition(" ")[2]
    return f"{first.removesuffix(f' {unit}')} to {last}"


# --- places of names: inside their area, away from the path; beside an area that is too small -----

PLACES = 30  # places tried along each side of a grid
PAD = 0.03  # space around a name and around the marks at the ends of a path [in]
LEADING = 1.15  # distance of lines, in font sizes
SPACE = 0.3  # around a name beside its area, in half heights of the name
COVERED = 4.0  # weight of covering a point, beside missing space
NEARNESS = 0.06  # space that is given up for each unit of length nearer to the area
SIDES = np.array([(0, 1), (0, -1), (1, 1), (1, -1), (1, 0), (-1, 1), (-1, -1), (-1, 0)], float)  # of a box
MAX_POINTS = 40  # of a polygon along a side, at most


def label_half_size(lines: Lines, metres_per_inch: float) -> FloatArray:
    """Half of width and height (2,) [m] of ``lines``, with some space."""
    width = max(style.text_width(text, size) for text, size in lines) * 1.08
    height = line_height([size for _, size in lines])
    return np.array([width / 2 + PAD, height / 2 + PAD]) * metres_per_inch


def line_height(sizes: Sequence[float]) -> float:
    """Height [in] of lines of letters of ``sizes`` [pt]; the last one has no space below."""
    return (LEADING * sum(sizes[:-1]) + 0.75 * sizes[-1]) / 72.0 if sizes else 0.0


def area_on_map(
    outlines: Sequence[FloatArray], bounds: FloatArray, obstacles: Sequence[FloatArray] = ()
) -> Any:
    """The largest shapely polygon of the union of ``outlines``, (n, 2) [m] each, that lies on the map.

    Where there is some place beside the ``obstacles``, without them. It is empty if nothing lies within the
    ``bounds`` (2, 2) [m].
    """
    union, barred = (
        shapely.union_all([shapely.Polygon(outline).buffer(0.0) for outline in some])
        for some in (outlines, obstacles)
    )
    seen = union.intersection(shapely.box(*bounds.ravel()))
    free = seen.difference(barred)
    parts = shapely.get_parts(seen if free.is_empty else free)
    return max(parts, key=shapely.area, default=shapely.Polygon())


def places_inside(area: Any, half: FloatArray) -> FloatArray:
    """Places (n, 2) at which a name of ``half`` (2,) [m] lies in ``area``; the centre of the area first."""
    if area.is_empty:
        return np.empty((0, 2))
    shapely.prepare(area)
    low, high = np.array(area.bounds).reshape(2, 2)
    places = np.vstack([shapely.get_coordinates(area.centroid), _grid(low, high, PLACES)])
    return np.asarray(places[shapely.contains(area, _boxes(places, half))], float)


def label_position(
    area: Any,
    half: FloatArray,
    bounds: FloatArray,
    taken: FloatArray | None = None,
    blocked: FloatArray | None = None,
) -> FloatArray:
    """Centre (2,) [m] of a name in ``area``, or beside it if it does not fit.

    Parameters
    ----------
    half : (2,) float
        Half of width and height of the name [m].
    bounds : (2, 2) float
        Corners of the map, which a name beside its area does not cross [m].
    taken : (n, 2) float, optional
        Points that the name should not cover [m].
    blocked : (m, 2) float, optional
        Further points that a name beside its area should not cover, as other places and names [m].
    """
    places, wide, near = places_inside(area, half), half.min(), 1e-3
    if len(places):
        blocked = None
    else:
        places, wide, near = _places_around(area, half, bounds), SPACE * half.min(), NEARNESS
    points = np.vstack([np.empty((0, 2)), *(some for some in (taken, blocked) if some is not None)])
    away = np.linalg.norm(places - shapely.get_coordinates(area.centroid), axis=1)
    gap = (np.abs(places[:, None] - points) - half).max(axis=2).min(axis=1, initial=np.inf)
    score = np.minimum(gap, wide) + COVERED * np.minimum(gap, 0.0) - near * away
    return np.asarray(places[np.argmax(score)], float)


def _places_around(area: Any, half: FloatArray, bounds: FloatArray) -> FloatArray:
    """Places (n, 2) beside ``area``, as near as :data:`SPACE`; those inside of ``bounds``, if there are any.

    Without such a place, the middles of the sides and the corners of its rectangle.
    """
    space, (low, high) = SPACE * half.min(), np.array(area.bounds).reshape(2, 2)
    places = _grid(low - half - space, high + half + space, PLACES + 1)
    away = shapely.distance(_boxes(places, half), area)
    touching = SIDES * ((high - low) / 2 + half) + (low + high) / 2
    for some in (places[(away > 0.0) & (away <= 1.001 * space)], touching):
        within = ((some - half >= bounds[0]) & (some + half <= bounds[1])).all(axis=1)
        if within.any():
            return np.asarray(some[within], float)
    return np.asarray(touching, float)


def _grid(low: FloatArray, high: FloatArray, *counts: int) -> FloatArray:
    """Points (n, 2) of a regular grid from ``low`` to ``high`` (2,), with ``counts`` along the sides."""
    sides = [np.linspace(low[i], high[i], counts[i % len(counts)]) for i in (0, 1)]
    return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)


def _boxes(places: FloatArray, half: FloatArray) -> Any:
    return shapely.box(*(places - half).T, *(places + half).T)


def covering_points(outline: FloatArray, half: FloatArray) -> FloatArray:
    """Points (n, 2) of the polygon ``outline`` (m, 2), so dense that a name of ``half`` covers one."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    counts = np.clip(np.ceil((high - low) / half), 1, MAX_POINTS).astype(int) + 1
    lattice = _grid(low, high, *counts)
    edge = dense_path(np.vstack([outline, outline[:1]]))
    return np.vstack([edge, lattice[shapely.contains_xy(shapely.Polygon(outline), lattice)]])


def dense_path(x: FloatArray, pieces: int = 8) -> FloatArray:
    """Points (n, 2) along the segments between the positions ``x`` (T+1, 2) [m]."""
    share = np.arange(pieces)[:, None, None] / pieces
    between = (1.0 - share) * x[:-1] + share * x[1:]
    return np.vstack([between.reshape(-1, 2), x[-1:]])
