"""Places of the names of regions: inside, away from the path; beside a region that is too small."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pareto_ltl.report.style import text_width
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.cells import half_planes, moments

PLACES = 15  # places tried along each side of a grid
PAD = 0.03  # space around a name and around the marks at the ends of a path [in]
LEADING = 1.15  # distance of lines, in font sizes
SPACE = 0.3  # around a name beside its region, in half heights of the name
COVERED = 4.0  # weight of covering a point, beside missing space
NEARNESS = 0.06  # space that is given up for each unit of length nearer to the region
# the sides and corners of a rectangle
SIDES = np.array(
    [(x, y) for x in (0, 1, -1) for y in (1, -1, 0) if (x, y) != (0, 0)], float
)  # of a rectangle
MOST_POINTS = 40  # of a polygon along a side, at most


def label_half_size(lines: Sequence[tuple[str, float]], metres_per_inch: float) -> FloatArray:
    """Half of width and height (2,) [m] of ``lines`` (text, font size [pt]), with some space."""
    width = max(text_width(text, size) for text, size in lines) * 1.08
    height = line_height([size for _, size in lines])
    return np.array([width / 2 + PAD, height / 2 + PAD]) * metres_per_inch


def line_height(sizes: Sequence[float]) -> float:
    """Height [in] of lines of letters of ``sizes`` [pt]; the last one has no space below."""
    return (LEADING * sum(sizes[:-1]) + 0.75 * sizes[-1]) / 72.0 if sizes else 0.0


def label_position(
    parts: Sequence[FloatArray],
    half: FloatArray,
    taken: FloatArray | None = None,
    bounds: FloatArray | None = None,
    blocked: FloatArray | None = None,
) -> FloatArray:
    """Centre (2,) [m] of a name in the largest convex part of a region, or beside it if it does not fit.

    Parameters
    ----------
    half : (2,) float
        Half of width and height of the name [m].
    taken : (n, 2) float, optional
        Points that the name should not cover [m].
    bounds : (2, 2) float, optional
        Corners of the map, which a name beside its region does not cross [m].
    blocked : (m, 2) float, optional
        Further points that a name beside its region should not cover, as other places and names [m].
    """
    part, centre = _largest_part(parts)
    places, wide, near = _places_inside(part, centre, half), half.min(), 1e-3
    if len(places) == 0:
        wide, near = SPACE * half.min(), NEARNESS
        places = _places_around(part, half, bounds)
        seen = [points for points in (taken, blocked) if points is not None and len(points)]
        taken = np.vstack(seen) if seen else None
    if taken is None or len(taken) == 0:
        return np.asarray(places[np.argmin(np.linalg.norm(places - centre, axis=1))], float)
    gap = (np.abs(places[:, None] - taken) - half).max(axis=2).min(axis=1)
    away = np.linalg.norm(places - centre, axis=1)
    score = np.minimum(gap, wide) + COVERED * np.minimum(gap, 0.0) - near * away
    return np.asarray(places[np.argmax(score)], float)


def fits_inside(parts: Sequence[FloatArray], half: FloatArray) -> bool:
    """Whether a name of half size ``half`` (2,) [m] fits into the largest convex part of a region."""
    return len(_places_inside(*_largest_part(parts), half)) > 0


def _largest_part(parts: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """The largest of ``parts`` and its centroid (2,) [m]."""
    part, (_, centre) = max(((part, moments(part)) for part in parts), key=lambda found: found[1][0])
    return part, centre


def _places_inside(part: FloatArray, centre: FloatArray, half: FloatArray) -> FloatArray:
    """Places (n, 2) at which the whole name lies in the convex polygon ``part``."""
    low, high = part.min(axis=0), part.max(axis=0)
    steps = np.linspace(0.0, 1.0, PLACES)
    lattice = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * (high - low) + low
    places = np.vstack([centre, lattice])
    normals, offsets = half_planes(part)
    fits = (offsets - np.abs(normals) @ half - places @ normals.T).min(axis=1) >= 0.0
    return np.asarray(places[fits], float)


def _places_around(part: FloatArray, half: FloatArray, bounds: FloatArray | None) -> FloatArray:
    """Places (n, 2) beside ``part``, as near as :data:`SPACE`; those inside of ``bounds``, if there are any.

    Without such a place, the middles of the sides and the corners of its rectangle.
    """
    from shapely import Polygon, box, distance

    space = SPACE * half.min()
    low, high = part.min(axis=0) - half - space, part.max(axis=0) + half + space
    steps = np.linspace(0.0, 1.0, 2 * PLACES + 1)
    places = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * (high - low) + low
    away = distance(box(*(places - half).T, *(places + half).T), Polygon(part))
    touching = SIDES * (np.ptp(part, axis=0) / 2 + half) + (part.min(axis=0) + part.max(axis=0)) / 2
    for some in (places[(away > 0.0) & (away <= 1.001 * space)], touching):
        within = np.ones(len(some), dtype=bool)
        if bounds is not None:
            within = ((some - half >= bounds[0]) & (some + half <= bounds[1])).all(axis=1)
        if within.any():
            return np.asarray(some[within], float)
    return np.asarray(touching, float)


def covering_points(outline: FloatArray, half: FloatArray) -> FloatArray:
    """Points (n, 2) of the polygon ``outline`` (m, 2), so dense that a name of ``half`` covers one."""
    from shapely import Polygon, contains_xy

    low, high = outline.min(axis=0), outline.max(axis=0)
    counts = np.clip(np.ceil((high - low) / half), 1, MOST_POINTS).astype(int) + 1
    axes = [np.linspace(low[i], high[i], counts[i]) for i in (0, 1)]
    lattice = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    edge = dense_path(np.vstack([outline, outline[:1]]))
    return np.vstack([edge, lattice[contains_xy(Polygon(outline), lattice)]])


def place_in_polygon(outline: FloatArray, half: FloatArray, bounds: FloatArray) -> FloatArray | None:
    """The place (2,) in ``outline`` (m, 2) and on the map that is nearest to its centre and holds a name.

    ``outline`` may be concave, and may extend beyond the ``bounds`` (2, 2) of the map. None if the name fits
    nowhere.
    """
    from shapely import Polygon, box, contains

    seen = Polygon(outline).buffer(0.0).intersection(box(*bounds.ravel()))
    if seen.is_empty:
        return None
    low, high = np.array(seen.bounds).reshape(2, 2)
    steps = np.linspace(0.0, 1.0, 2 * PLACES)
    lattice = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * (high - low) + low
    centre = np.array([seen.centroid.x, seen.centroid.y])
    places = np.vstack([centre, lattice])
    fits = contains(seen, box(*(places - half).T, *(places + half).T))
    if not fits.any():
        return None
    inside = places[fits]
    return np.asarray(inside[np.argmin(np.linalg.norm(inside - centre, axis=1))], float)


def dense_path(x: FloatArray, pieces: int = 8) -> FloatArray:
    """Points (n, 2) along the segments between the positions ``x`` (T+1, 2) [m]."""
    share = np.arange(pieces)[:, None, None] / pieces
    between = (1.0 - share) * x[:-1] + share * x[1:]
    return np.vstack([between.reshape(-1, 2), x[-1:]])
