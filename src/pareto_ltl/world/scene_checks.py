"""Checks of a whole map in metres: names, outlines, bounds, overlaps."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_sketch import SceneSketch

if TYPE_CHECKING:
    import shapely

LEAST_SIDE, MOST_SIDE = 1e-3, 4.1e7  # of a map [m]; the Earth is 40,075 km round
RESERVED_WORDS = frozenset(  # of the formula language, not allowed as names of regions
    ["true", "false", "not", "and", "or", "xor", "next", "eventually", "until", *"XFUMGRW"]
)


def checked_scene(sketch: SceneSketch) -> Scene:
    """The scene of ``sketch``: outlines counter-clockwise, obstacles clipped at the bounds.

    Raises
    ------
    DataError
        If something is missing, degenerate, outside of the bounds, or overlaps.
    """
    if not sketch.regions:
        raise DataError(f"{sketch.where} has no regions; a mission needs at least one place to visit")
    if len(sketch.start) == 0:
        raise DataError(f"{sketch.where} has no start; add a Point with the property role: start")
    _check_size(sketch)
    for name, _ in sketch.regions:
        _check_region_name(sketch, name)
    for place in sketch.timed:
        _check_region_name(sketch, place.name)
        if place.name != place.region and place.name in dict(sketch.regions):
            raise DataError(
                f"{sketch.where}: window {place.name!r} of region {place.region!r} has the name of another "
                "region; rename it"
            )
    regions = {
        name: _simple_outline(sketch, f"region {shown_text(name)!r}", corners)
        for name, corners in sketch.regions
    }
    obstacles = [(what, _simple_outline(sketch, what, corners)) for what, corners in sketch.obstacles]
    _check_inside(sketch, "start", sketch.start[None])
    for name, corners in regions.items():
        _check_inside(sketch, f"region {shown_text(name)!r}", corners)
    clipped = [(what, part) for what, corners in obstacles for part in _clipped_obstacle(sketch, corners)]
    _check_start_free(sketch, clipped)
    _check_overlaps(sketch, regions, clipped)
    landmarks = [(what, _simple_outline(sketch, what, corners)) for what, corners in sketch.landmarks]
    _check_landmarks(sketch, landmarks, clipped)
    return Scene(
        bounds=sketch.bounds,
        start=sketch.start,
        regions=regions,
        obstacles=tuple(part for _, part in clipped),
        crs=sketch.crs,
        time_zero=sketch.time_zero,
        landmarks=tuple(corners for _, corners in landmarks),
    )


def _check_landmarks(
    sketch: SceneSketch,
    landmarks: Sequence[tuple[str, FloatArray]],
    obstacles: Sequence[tuple[str, FloatArray]],
) -> None:
    """Refuse a landmark outside of the bounds, one that is not convex, or one that overlaps an obstacle."""
    import shapely

    for what, corners in landmarks:
        _check_inside(sketch, what, corners)
        polygon = shapely.Polygon(corners)
        if shapely.convex_hull(polygon).area > polygon.area + sketch.tolerance * polygon.length:
            raise DataError(f"{sketch.where}: {what} is not convex; split it into convex landmarks")
        for name, outline in obstacles:
            common = shapely.intersection(polygon, shapely.Polygon(outline))
            if common.area > sketch.tolerance * polygon.length:
                at = shapely.get_coordinates(shapely.point_on_surface(common))[0]
                raise DataError(
                    f"{sketch.where}: {what} overlaps {name} at {sketch.show(at)}, where no robot can be; "
                    "move one, or cut the obstacle out of the landmark"
                )


def _check_size(sketch: SceneSketch) -> None:
    """Refuse a map that is larger than the Earth or smaller than any robot: a slip of units."""
    sides = sketch.bounds[1] - sketch.bounds[0]
    if not (sides.min() >= LEAST_SIDE and sides.max() <= MOST_SIDE):
        raise DataError(
            f"{sketch.where}: the map is {sides[0]:.3g} m x {sides[1]:.3g} m; expected sides between "
            f"{LEAST_SIDE:g} m and {MOST_SIDE:.3g} m: check scene.unit and the bounds"
        )


def _check_region_name(sketch: SceneSketch, name: str) -> None:
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        better = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "goal"
        better = better if not better[0].isdigit() else f"r{better}"
        raise DataError(
            f"{sketch.where}: region name {shown_text(name)!r} cannot stand in a formula; use letters, "
            f"digits and _, not a digit first, e.g. {better[:20]!r}"
        )
    if name in RESERVED_WORDS:
        raise DataError(
            f"{sketch.where}: region name {name!r} is an operator of the formula language; "
            f"rename it, e.g. {'region_' + name!r}"
        )


def _simple_outline(sketch: SceneSketch, what: str, corners: FloatArray) -> FloatArray:
    """``corners`` in counter-clockwise order; refuse a polygon that is degenerate or crosses itself."""
    import shapely

    if _is_flat(corners, sketch.tolerance):
        raise DataError(
            f"{sketch.where}: {what} is degenerate: all its corners lie on one line, from "
            f"{sketch.show(corners[0])} on; give it an inside, or remove it"
        )
    reason = shapely.is_valid_reason(shapely.Polygon(corners))
    if reason != "Valid Geometry":
        spot = re.search(r"\[(\S+) (\S+)\]", reason)
        at = np.array([float(v) for v in spot.groups()]) if spot else corners[0]
        raise DataError(
            f"{sketch.where}: {what} crosses or touches its own outline at {sketch.show(at)}; "
            f"list its corners in order along the outline"
        )
    return corners if shapely.is_ccw(shapely.LinearRing(corners)) else corners[::-1].copy()


def _is_flat(corners: FloatArray, tolerance: float) -> bool:
    """Whether all corners lie on one line, within ``tolerance`` [m]."""
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    return bool(spread[-1] <= tolerance)


def _check_inside(sketch: SceneSketch, what: str, points: FloatArray) -> None:
    (west, south), (east, north) = sketch.bounds.tolist()
    beyond = np.max(
        [west - points[:, 0], points[:, 0] - east, south - points[:, 1], points[:, 1] - north], axis=0
    )
    worst = int(np.argmax(beyond))
    if beyond[worst] > sketch.tolerance:
        low, high = sketch.show(sketch.bounds[0]), sketch.show(sketch.bounds[1])
        raise DataError(
            f"{sketch.where}: {what} lies outside the bounds at {sketch.show(points[worst])}; "
            f"the bounds reach from {low} to {high}: move it, or widen them"
        )


def _clipped_obstacle(sketch: SceneSketch, corners: FloatArray) -> list[FloatArray]:
    """The parts of an obstacle inside the bounds; the obstacle itself if it lies inside."""
    low, high = sketch.bounds
    if (corners >= low).all() and (corners <= high).all():
        return [corners]
    import shapely

    box: shapely.Polygon = shapely.box(*low, *high)
    pieces = shapely.get_parts(shapely.intersection(shapely.Polygon(corners), box))
    least = sketch.tolerance * math.sqrt(box.area)
    return [
        np.clip(shapely.get_coordinates(shapely.orient_polygons(piece))[:-1], low, high)
        for piece in pieces
        if piece.geom_type == "Polygon" and piece.area > least
    ]


def _check_start_free(sketch: SceneSketch, obstacles: Sequence[tuple[str, FloatArray]]) -> None:
    import shapely

    start = shapely.Point(sketch.start)
    for what, corners in obstacles:
        polygon = shapely.Polygon(corners)
        if polygon.contains(start) and polygon.exterior.distance(start) > sketch.tolerance:
            raise DataError(
                f"{sketch.where}: the start {sketch.show(sketch.start)} lies inside {what}; move either"
            )


def _check_overlaps(
    sketch: SceneSketch, regions: Mapping[str, FloatArray], obstacles: Sequence[tuple[str, FloatArray]]
) -> None:
    """Refuse an obstacle and a region with a common area larger than rounding errors."""
    import shapely

    names = list(regions)
    places = [shapely.Polygon(corners) for corners in regions.values()]
    tree = shapely.STRtree(places)
    for what, corners in obstacles:
        polygon = shapely.Polygon(corners)
        for hit in sorted(tree.query(polygon, predicate="intersects")):
            common = shapely.intersection(polygon, places[hit])
            if common.area > sketch.tolerance * max(polygon.length, places[hit].length):
                at = shapely.get_coordinates(shapely.point_on_surface(common))[0]
                raise DataError(
                    f"{sketch.where}: {what} overlaps region {names[hit]!r} at {sketch.show(at)}; "
                    f"they may touch, not overlap: cut the obstacle out of the region, or move one"
                )


__all__ = ["checked_scene"]
