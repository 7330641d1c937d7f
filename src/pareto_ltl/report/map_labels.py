"""Places of names on a map: inside their area, away from the path; beside an area that is too small."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from pareto_ltl.report.style import text_width
from pareto_ltl.support.arrays import FloatArray

PLACES = 30  # places tried along each side of a grid
PAD = 0.03  # space around a name and around the marks at the ends of a path [in]
LEADING = 1.15  # distance of lines, in font sizes
SPACE = 0.3  # around a name beside its area, in half heights of the name
COVERED = 4.0  # weight of covering a point, beside missing space
NEARNESS = 0.06  # space that is given up for each unit of length nearer to the area
SIDES = np.array([(0, 1), (0, -1), (1, 1), (1, -1), (1, 0), (-1, 1), (-1, -1), (-1, 0)], float)  # of a box
MOST_POINTS = 40  # of a polygon along a side, at most

Lines = Sequence[tuple[str, float]]  # texts and their font sizes [pt]


def label_half_size(lines: Lines, metres_per_inch: float) -> FloatArray:
    """Half of width and height (2,) [m] of ``lines``, with some space."""
    width = max(text_width(text, size) for text, size in lines) * 1.08
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
    counts = np.clip(np.ceil((high - low) / half), 1, MOST_POINTS).astype(int) + 1
    lattice = _grid(low, high, *counts)
    edge = dense_path(np.vstack([outline, outline[:1]]))
    return np.vstack([edge, lattice[shapely.contains_xy(shapely.Polygon(outline), lattice)]])


def dense_path(x: FloatArray, pieces: int = 8) -> FloatArray:
    """Points (n, 2) along the segments between the positions ``x`` (T+1, 2) [m]."""
    share = np.arange(pieces)[:, None, None] / pieces
    between = (1.0 - share) * x[:-1] + share * x[1:]
    return np.vstack([between.reshape(-1, 2), x[-1:]])
