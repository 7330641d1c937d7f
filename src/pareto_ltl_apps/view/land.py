"""Land, lakes, borders and cities below the layers of a map figure."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from matplotlib.axes import Axes

from pareto_ltl import Scene
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.geography import geography_around
from pareto_ltl_apps.view.map_layers import (
    draw_lines,
    draw_polygons,
    draw_text,
    inches_per_metre,
    label_half_size,
)

SEA, LAND, SHORE, FRONTIER, CITY = "#E6EFF4", "#FAF8F3", "#9FB2BD", "#B9A58C", "#6B6B6B"
BESIDE = 0.15  # of what is projected around a map, in sides of the map
LONGEST = 0.5  # [deg] of an edge
CITY_SIZE = 5.0  # of names of cities [pt]
CITIES = 9  # names of a map, at most


def draw_land(chart: Axes, scene: Scene, taken: FloatArray | None = None, *, cities: bool = True) -> None:
    """What lies on the map of ``scene``; names of cities cover no region and no point ``taken`` (n, 2) [m].

    Nothing for a map without a place on Earth, or around a pole.
    """
    found = geography_around(scene, BESIDE)
    if found is None:
        return

    def plane(lines: list[FloatArray]) -> Iterator[FloatArray]:
        for line in lines:
            dense = shapely.segmentize(shapely.LineString(line), LONGEST)  # a parallel is no straight line
            try:
                yield scene.frame.to_plane(*np.asarray(dense.coords).T)
            except DataError:  # too far from the centre of the plane
                continue

    chart.set_facecolor(SEA)
    shore = {"ec": SHORE, "lw": 0.4}
    draw_polygons(chart, plane(found.land), fc=LAND, **shore, zorder=0.1)
    draw_polygons(chart, plane(found.lakes), fc=SEA, **shore, zorder=0.2)
    draw_polygons(chart, plane(found.islands), fc=LAND, **shore, zorder=0.3)
    draw_lines(
        chart, plane(found.states), colors=FRONTIER, linewidths=0.35, linestyles=(0, (3, 2)), zorder=0.4
    )
    draw_lines(chart, plane(found.borders), colors=FRONTIER, linewidths=0.6, zorder=0.5)
    if cities and found.cities:
        _name_cities(chart, scene, found.cities, taken)


def _name_cities(
    chart: Axes, scene: Scene, cities: list[tuple[str, float, float]], taken: FloatArray | None
) -> None:
    """Names of the largest cities that have room, each to the right of its mark."""
    xy = scene.frame.to_plane([lon for _, lon, _ in cities], [lat for _, _, lat in cities])
    scale = 1.0 / inches_per_metre(chart)
    drawn = shapely.union_all([shapely.Polygon(line).buffer(0.0) for line in _outlines(scene)])
    busy = np.empty((0, 2)) if taken is None else taken
    boxes: list[FloatArray] = []
    for (name, _, _), place in zip(cities, xy, strict=True):
        half = label_half_size([(name, CITY_SIZE)], scale)
        gap = np.array([0.02 * scale, half[1]])
        box = np.array([place - gap, place + np.array([2.0 * half[0], half[1]])])
        inside = (box[0] > scene.bounds[0]).all() and (box[1] < scene.bounds[1]).all()
        covers = _within(busy, box).any() or drawn.intersects(shapely.box(*box.ravel()))
        if not inside or covers or any(_overlap(box, other) for other in boxes):
            continue
        boxes.append(box)
        chart.plot(*place, ".", ms=1.8, color=style.STONE, zorder=2.0)
        at = place + np.array([1.02 * half[0], 0.0])
        look = {"color": CITY, "zorder": 2.0, "path_effects": style.white_halo(1.0)}
        draw_text(chart, at, name, fontsize=CITY_SIZE, **look)
        if len(boxes) == CITIES:
            return


def _outlines(scene: Scene) -> tuple[FloatArray, ...]:
    return (*scene.obstacles, *scene.region_outlines)


def _within(points: FloatArray, box: FloatArray) -> FloatArray:
    """Whether each of ``points`` (n, 2) lies in ``box`` (2, 2)."""
    return np.asarray(((points >= box[0]) & (points <= box[1])).all(axis=1))


def _overlap(one: FloatArray, other: FloatArray) -> bool:
    return bool((one[0] < other[1]).all() and (other[0] < one[1]).all())
