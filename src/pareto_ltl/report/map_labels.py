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
    """
    part, centre = _largest_part(parts)
    places = _places_inside(part, centre, half)
    if len(places) == 0:
        places = _places_around(part, half, bounds)
    if taken is None or len(taken) == 0:
        return np.asarray(places[np.argmin(np.linalg.norm(places - centre, axis=1))], float)
    gap = (np.abs(places[:, None] - taken) - half).max(axis=2).min(axis=1)
    score = np.minimum(gap, half.min()) - 1e-3 * np.linalg.norm(places - centre, axis=1)
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
    """Eight places (n, 2) beside ``part``; those inside of ``bounds``, if there are any."""
    low, high = part.min(axis=0) - half, part.max(axis=0) + half
    middle = (low + high) / 2
    columns = np.array([[low[0], middle[0], high[0]], [low[1], middle[1], high[1]]])
    grid = [(columns[0, i], columns[1, j]) for i in (1, 2, 0) for j in (2, 0, 1) if (i, j) != (1, 1)]
    places = np.array(grid)
    if bounds is None:
        return places
    within = ((places - half >= bounds[0]) & (places + half <= bounds[1])).all(axis=1)
    return places[within] if within.any() else places


def dense_path(x: FloatArray, pieces: int = 8) -> FloatArray:
    """Points (n, 2) along the segments between the positions ``x`` (T+1, 2) [m]."""
    share = np.arange(pieces)[:, None, None] / pieces
    between = (1.0 - share) * x[:-1] + share * x[1:]
    return np.vstack([between.reshape(-1, 2), x[-1:]])
