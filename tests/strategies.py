"""Hypothesis strategies for polygons, maps and formulas, shared by the suites.

Two kinds of map: ``scenes`` has outlines anywhere, which may overlap; ``lattice_scenes`` has all corners on a
small lattice, so that outlines often touch, share edges and have corners of 180 degrees.
"""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import assume
from hypothesis import strategies as st

from ltlf import Formula
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.scene import Scene

NAMES = "abcdef"
SIDE = 1000.0  # of the maps [m]


def _circle(angles: FloatArray, radii: FloatArray) -> FloatArray:
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)


@st.composite
def star_polygons(draw, centre=None, least=20.0, most=250.0, corners=12) -> FloatArray:
    """Simple polygon (n, 2), counter-clockwise, star-shaped about its centre; mostly not convex."""
    n = draw(st.integers(3, corners))
    jitter = np.array(draw(st.lists(st.floats(-0.35, 0.35), min_size=n, max_size=n)))
    radii = np.array(draw(st.lists(st.floats(least, most), min_size=n, max_size=n)))
    middle = np.array(draw(_points()) if centre is None else centre)
    return middle + _circle(2 * np.pi * (np.arange(n) + jitter) / n, radii)


@st.composite
def convex_polygons(draw, centre=None, least=20.0, most=250.0, corners=12) -> FloatArray:
    """Convex polygon (n, 2), counter-clockwise, with its corners on an ellipse."""
    n = draw(st.integers(3, corners))
    jitter = np.array(draw(st.lists(st.floats(-0.35, 0.35), min_size=n, max_size=n)))
    axes = np.array([draw(st.floats(least, most)), draw(st.floats(least, most))])
    middle = np.array(draw(_points()) if centre is None else centre)
    return middle + axes * _circle(2 * np.pi * (np.arange(n) + jitter) / n, np.ones(n))


def _points():
    return st.tuples(st.floats(0, SIDE), st.floats(0, SIDE))


def _within_bounds(polygons: list[FloatArray], side: float = SIDE) -> list[FloatArray]:
    """The largest part of each polygon within the map, as after reading a scene."""
    clipped = (shapely.intersection(shapely.Polygon(p), shapely.box(0, 0, side, side)) for p in polygons)
    largest = [max(shapely.get_parts(c), key=shapely.area, default=None) for c in clipped]
    kept = [p for p in largest if p is not None and p.area > 1e-3 * side]
    return [shapely.get_coordinates(shapely.orient_polygons(p).exterior)[:-1] for p in kept]


@st.composite
def scenes(draw, obstacles=5, regions=3) -> Scene:
    """A square map with obstacles and regions anywhere, which may overlap."""
    shapes = st.one_of(star_polygons(), convex_polygons())
    walls = _within_bounds(draw(st.lists(shapes, max_size=obstacles)))
    places = _within_bounds(draw(st.lists(shapes, min_size=1, max_size=regions)))
    assume(places)
    return _scene(walls, places, SIDE)


@st.composite
def lattice_scenes(draw, obstacles=6, regions=3, side=8) -> Scene:
    """A square map whose outlines have all corners on an integer lattice."""
    walls = draw(st.lists(lattice_polygons(side), max_size=obstacles))
    places = draw(st.lists(lattice_polygons(side), min_size=1, max_size=regions))
    return _scene(walls, places, float(side))


@st.composite
def lattice_polygons(draw, side=8) -> FloatArray:
    """Triangles, boxes and L shapes with integer corners."""
    coordinate = st.integers(0, side)
    kind = draw(st.sampled_from(["triangle", "box", "corner"]))
    if kind == "triangle":
        corners = np.array(draw(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=3)), float)
    else:
        xs = sorted(draw(st.lists(coordinate, min_size=3, max_size=3, unique=True)))
        ys = sorted(draw(st.lists(coordinate, min_size=3, max_size=3, unique=True)))
        box = [(xs[0], ys[0]), (xs[2], ys[0]), (xs[2], ys[2]), (xs[0], ys[2])]
        notch = [
            (xs[0], ys[0]),
            (xs[2], ys[0]),
            (xs[2], ys[1]),
            (xs[1], ys[1]),
            (xs[1], ys[2]),
            (xs[0], ys[2]),
        ]
        corners = np.array(box if kind == "box" else notch, float)
    ring = shapely.Polygon(corners)
    assume(ring.area > 0)
    return corners if shapely.is_ccw(ring.exterior) else corners[::-1]


def _scene(walls: list[FloatArray], places: list[FloatArray], side: float) -> Scene:
    """The start lies in free space; maps without free space are left out."""
    free = shapely.box(0, 0, side, side) - shapely.union_all([shapely.Polygon(w) for w in walls])
    assume(free.area > 1e-3 * side**2)
    largest = max(shapely.get_parts(free), key=shapely.area)
    return Scene(
        bounds=np.array([[0.0, 0.0], [side, side]]),
        start=shapely.get_coordinates(shapely.point_on_surface(largest))[0],
        regions=dict(zip(NAMES, places, strict=False)),
        obstacles=tuple(walls),
    )


@st.composite
def formulas(draw, names) -> str:
    """Any co-safe formula over ``names``."""
    literals = st.sampled_from(names).flatmap(
        lambda n: st.sampled_from([Formula("name", name=n), Formula("!", (Formula("name", name=n),))])
    )

    def grown(trees):
        one = st.builds(lambda op, p: Formula(op, (p,)), st.sampled_from("XFF"), trees)
        two = st.builds(lambda op, p, q: Formula(op, (p, q)), st.sampled_from("UM&|&"), trees, trees)
        return one | two

    return str(draw(st.recursive(literals, grown, max_leaves=5)))
