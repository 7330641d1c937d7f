"""Checks of a complete map in metres (names, bounds, overlaps), and the scene made from it."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from careful_io.faults import Faults
from careful_io.messages import shown_text
from careful_io.texts import distance_text
from ltlf import name_fault
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.world import scene_shapes as draw
from pareto_ltl.world.cells import convex_pieces
from pareto_ltl.world.polygons import outlines_of
from pareto_ltl.world.projection import Frame
from pareto_ltl.world.scene import FixShape, Scene
from pareto_ltl.world.scene_heights import sketch_at_height
from pareto_ltl.world.scene_simplify import MANY_CORNERS, DrawnMap, simplified_map
from pareto_ltl.world.scene_sketch import DrawingRules, MissionUse, Place, SceneSketch
from pareto_ltl.world.windows import TimedPlace

LOG = logging.getLogger(__name__)

LARGE_ERROR, LARGEST_ERROR = 0.01, 0.05  # relative errors of lengths for a warning, and for an error
OUTSIDE = "the outside of the border"
POLAR = 66.0  # [deg] latitude beyond which maps are rare
LEAST_SIDE, MAX_SIDE = 1e-3, 4.1e7  # of a map [m]; the circumference of the Earth is 40,075 km


def checked_scene(sketch: SceneSketch, rules: DrawingRules) -> Scene:
    """Check ``sketch`` and make a scene of it: outlines counter-clockwise, obstacles clipped to the bounds.

    Buffers are included in the outlines. Buffers of obstacles are cut out of regions and landmarks. Polygons
    with many corners are simplified according to ``rules``.

    Raises
    ------
    DataError
        If something is missing, degenerate, outside the bounds, or overlaps.
    """
    faults = Faults(sketch.where, sketch.faults)
    if not sketch.regions and not sketch.faults:
        faults.add(f"{sketch.where} has no regions; a mission needs at least one place to visit")
    if len(sketch.start) == 0 and not sketch.faults:
        faults.add(f"{sketch.where} has no start; add a Point with the property role: start")
    sketch, drawn = _checked_drawing(sketch, rules, faults)
    drawn, farthest = simplified_map(sketch, rules, drawn)
    if farthest or any(place.buffer for place in sketch.obstacles):
        drawn = _apart(sketch, drawn)
    obstacles = [(what, outline) for what, part in drawn.obstacles for outline in outlines_of(part)]
    # numbers are no names; titles of exported maps, obstacle 3 (EFKU CTR), give the name again
    names = tuple(Scene.name_in_title(what.removeprefix("obstacle ")) for what, _ in obstacles)
    scene = Scene(
        bounds=sketch.bounds,
        start=sketch.start,
        regions={name: outlines_of(shape) for name, shape in drawn.regions.items()},
        obstacles=tuple(outline for _, outline in obstacles),
        crs=sketch.crs,
        time_zero=sketch.time_zero,
        simplified=max(farthest, sketch.simplified),
        obstacle_names=names if any(names) else (),
        absent=sketch.absent,
        room=sketch.room,
    )
    marks = list(_convex_landmarks(sketch, scene, drawn))
    fixes = tuple(fix for _, fix in marks)
    return replace(
        scene, landmarks=tuple(corners for corners, _ in marks), landmark_fixes=fixes if any(fixes) else ()
    )


def check_parts(sketch: SceneSketch) -> None:
    """Raise a DataError for the faults of a map that may lack its start or regions."""
    if len(sketch.start) and sketch.regions:
        checked_scene(sketch, DrawingRules())
        return
    faults = Faults(sketch.where, sketch.faults)
    if np.ptp(sketch.bounds, axis=0).min() == 0.0:  # a start alone
        faults.refuse()
        return
    _checked_drawing(sketch, DrawingRules(), faults)


def _checked_drawing(
    sketch: SceneSketch, rules: DrawingRules, faults: Faults
) -> tuple[SceneSketch, DrawnMap]:
    """``sketch`` at the height of the flight, and its shapes; DataError with ``faults`` and those found."""
    if not faults.each([_check_size, _check_distortion], lambda check: check(sketch))[1:]:
        faults.refuse()  # other checks could take long, or fail for the same reason
    faults.each(sketch.regions, lambda place: _check_region_name(sketch, place.name))
    faults.each(sketch.timed, lambda window: _check_window(sketch, window))
    with faults.noted():
        sketch = sketch_at_height(sketch, rules)
    with faults.noted():
        if sketch.fence is not None and rules.walled:
            sketch = replace(sketch, bounds=draw.straightened_bounds(sketch, sketch.fence))
    drawn = _checked_shapes(sketch, rules, faults)
    faults.refuse()
    return sketch, drawn


def _check_window(sketch: SceneSketch, window: TimedPlace) -> None:
    """Raise a DataError for a window with the name of another region."""
    _check_region_name(sketch, window.name)
    if window.name != window.region and any(place.name == window.name for place in sketch.regions):
        raise DataError(
            f"{sketch.where}: window {window.name!r} of region {window.region!r} has the name of another "
            "region; rename it"
        )


def _checked_shapes(sketch: SceneSketch, rules: DrawingRules, faults: Faults) -> DrawnMap:
    """The polygons of all places with their buffers; places are checked as drawn, without buffers."""
    drawn = faults.each(sketch.regions, lambda place: _drawn_region(sketch, place))
    shapes = faults.each(sketch.obstacles, lambda place: draw.drawn_shape(sketch, place))
    with faults.noted():
        _check_inside(sketch, "start", _start_points(sketch))
    checked = faults.each(drawn, lambda pair: _check_inside(sketch, pair[0].what, pair[1]))
    inside = [pair for pair, _ in checked]
    solid = [(place.what, part) for place, shape in shapes for part in draw.clipped_parts(sketch, shape)]
    with faults.noted():
        if sketch.fence is not None and rules.walled:
            solid += [(OUTSIDE, part) for part in draw.outside_parts(sketch, sketch.fence)]
    fenced = [pair for pair in solid if pair[0] == OUTSIDE]
    grown = faults.each(
        shapes,
        lambda pair: draw.clipped_parts(sketch, draw.with_buffer(sketch, *pair, outwards=True)),
    )
    wide = [(place.what, part) for (place, _), parts in grown for part in parts]
    with faults.noted():
        _check_start_free(sketch, [*wide, *fenced])
    free = {place.name: shape for place, shape in inside if not place.solid}
    for text in _overlaps(sketch, free, solid):
        faults.add(text)
    use = _use_of_regions(sketch, rules)
    kept_out = frozenset(
        place.name for place in sketch.regions if place.solid or (use and place.name not in use.visited)
    )
    reduced = faults.each(inside, lambda pair: _with_margin(sketch, *pair, use, kept_out))
    regions = {place.name: shape for (place, _), shape in reduced}
    marks = faults.each(sketch.landmarks, lambda place: _drawn_landmark(sketch, place, solid))
    landmarks = [(place.what, shape) for place, shape in marks]
    visited = use.visited - use.forbidden if use else frozenset[str]()
    return DrawnMap(regions, [*wide, *fenced], landmarks, kept_out, visited)


def _drawn_region(sketch: SceneSketch, place: Place) -> shapely.Geometry:
    """The shape of a region; an obstacle that is active for a limited time is clipped to the bounds."""
    shape = draw.drawn_shape(sketch, place)
    return shapely.union_all(draw.clipped_parts(sketch, shape)) if place.solid else shape


def _use_of_regions(sketch: SceneSketch, rules: DrawingRules) -> MissionUse | None:
    """How the mission uses the regions; None if it is not known or has no effect on the map."""
    careful = any(
        place.buffer or any(len(ring) > MANY_CORNERS for polygon in place.polygons for ring in polygon)
        for place in sketch.regions
    )
    use = rules.use() if careful else None
    if use is None:
        return None
    own = {window.name: window.region for window in sketch.timed}  # a window is visited in its region
    return MissionUse(*(frozenset(own.get(name, name) for name in names) for names in use))


def _with_margin(
    sketch: SceneSketch,
    place: Place,
    shape: shapely.Geometry,
    use: MissionUse | None,
    kept_out: frozenset[str],
) -> shapely.Geometry:
    """A region with its buffer: enlarged if the mission only avoids it (``kept_out``), else reduced."""
    if not place.buffer:
        return shape
    if place.polygons and use and place.name in use.visited & use.forbidden:
        raise DataError(
            f"{sketch.where}: {place.what} has a buffer, and the mission both visits and avoids it; "
            "draw two regions, one for each, or leave the buffer out"
        )
    found = draw.with_buffer(sketch, place, shape, outwards=place.name in kept_out)
    if place.name in kept_out:
        return shapely.union_all(draw.clipped_parts(sketch, found))
    _check_inside(sketch, place.what, found)
    return found


def _apart(sketch: SceneSketch, drawn: DrawnMap) -> DrawnMap:
    """``drawn`` with the enlarged obstacles cut out of visited regions and landmarks."""
    barriers, faults = np.array([polygon for _, polygon in drawn.obstacles]), Faults(sketch.where)

    def rest(what: str, shape: shapely.Geometry) -> shapely.Geometry:
        near = barriers[shapely.intersects(shape, barriers)] if len(barriers) else barriers
        common = shapely.area(shapely.intersection(shape, near)) > sketch.tolerance * shapely.length(shape)
        if not common.any():
            return shape
        left = shapely.difference(shape, shapely.union_all(near[common]))
        if shapely.area(left) <= sketch.tolerance * shapely.length(shape):
            raise DataError(
                f"{sketch.where}: nothing is left of {what} outside of the buffers of the obstacles; make it "
                "larger, or the buffers smaller"
            )
        return left

    regions = faults.each(
        drawn.regions.items(),
        lambda pair: pair[1] if pair[0] in drawn.kept_out else rest(f"region {pair[0]!r}", pair[1]),
    )
    landmarks = faults.each(drawn.landmarks, lambda pair: rest(*pair))
    faults.refuse()
    return replace(
        drawn,
        regions={name: shape for (name, _), shape in regions},
        landmarks=[(what, shape) for (what, _), shape in landmarks],
    )


def _drawn_landmark(
    sketch: SceneSketch, place: Place, obstacles: Sequence[tuple[str, Any]]
) -> shapely.Geometry:
    """A landmark reduced by its buffer; DataError if it is outside the bounds or overlaps an obstacle."""
    shape = draw.drawn_shape(sketch, place)
    for name, outline in obstacles:
        common = shapely.intersection(shape, outline)
        if common.area > sketch.tolerance * shapely.length(shape):
            at = shapely.get_coordinates(shapely.point_on_surface(common))[0]
            raise DataError(
                f"{sketch.where}: {place.what} overlaps {name} at {sketch.show(at)}, where no robot can be; "
                "move one, or cut the obstacle out of the landmark"
            )
    found = draw.with_buffer(sketch, place, shape, outwards=False)
    _check_inside(sketch, place.what, shape)
    _check_inside(sketch, place.what, found)
    return found


def _convex_landmarks(
    sketch: SceneSketch, scene: Scene, drawn: DrawnMap
) -> Iterator[tuple[FloatArray, FixShape | None]]:
    """Landmarks as convex polygons, with the errors of their fixes; those that are not convex are split."""
    for place, (what, shape) in zip(sketch.landmarks, drawn.landmarks, strict=True):
        fix = place.fix and place.fix.in_area(sketch.where, what, shape)
        for part in shapely.get_parts(shape).tolist():
            convex = shapely.convex_hull(part).area <= part.area + sketch.tolerance * part.length
            pieces = outlines_of(part) if convex else convex_pieces(scene, [part])
            yield from ((corners, fix) for corners in pieces)


def _check_size(sketch: SceneSketch) -> None:
    """Raise a DataError for a map larger than the Earth or smaller than any robot: an error of units."""
    sides = sketch.bounds[1] - sketch.bounds[0]
    if not (sides.min() >= LEAST_SIDE and sides.max() <= MAX_SIDE):
        raise DataError(
            f"{sketch.where}: the map is {sides[0]:.3g} m x {sides[1]:.3g} m; expected sides between "
            f"{LEAST_SIDE:g} m and {MAX_SIDE:.3g} m: check scene.unit and the bounds"
        )


def _check_distortion(sketch: SceneSketch) -> None:
    """Raise a DataError for a map that is too large for its plane; warn if lengths are wrong by over 1 %."""
    if sketch.crs is None:
        return
    error = Frame(sketch.crs).scale_error(sketch.bounds)
    sides = " x ".join(distance_text(float(side)) for side in sketch.bounds[1] - sketch.bounds[0])
    text = f"the map is {sides}, and lengths in its plane are up to {100 * error:.1f} % wrong at its corners"
    if error > LARGEST_ERROR:
        raise DataError(
            f"{sketch.where}: {text}; at most {100 * LARGEST_ERROR:g} % are allowed: plan on a smaller map "
            "or in parts (if it should be small: are longitude and latitude swapped somewhere?)"
        )
    if error > LARGE_ERROR:
        LOG.warning("%s: %s", sketch.where, text)


def _check_region_name(sketch: SceneSketch, name: str) -> None:
    if fault := name_fault(name):
        raise DataError(
            f"{sketch.where}: region name {shown_text(name)!r} cannot stand in a formula: {fault}; rename it"
        )


def _start_points(sketch: SceneSketch) -> shapely.MultiPoint:
    """The start, or no point if the map has none."""
    return shapely.MultiPoint(sketch.start.reshape(-1, 2))


def _check_inside(sketch: SceneSketch, what: str, shape: shapely.Geometry) -> None:
    points: FloatArray = shapely.get_coordinates(shape)
    if not len(points):
        return
    (west, south), (east, north) = sketch.bounds.tolist()
    beyond = np.max(
        [west - points[:, 0], points[:, 0] - east, south - points[:, 1], points[:, 1] - north], axis=0
    )
    worst = int(np.argmax(beyond))
    if beyond[worst] > sketch.tolerance:
        low, high = sketch.show(sketch.bounds[0]), sketch.show(sketch.bounds[1])
        raise DataError(
            f"{sketch.where}: {what} lies outside the bounds at {sketch.show(points[worst])}; "
            f"the bounds reach from {low} to {high}: "
            f"{_swap_question(sketch, points[worst])}move it, or widen them"
        )


def _swap_question(sketch: SceneSketch, point: FloatArray) -> str:
    """A question for the message if longitude and latitude of ``point`` (2,) [m] may be swapped, else "".

    They may be if the point is near a pole, or within the bounds after exchanging them.
    """
    if sketch.crs is None:
        return ""
    (lon,), (lat,) = Frame(sketch.crs).to_geographic(point)
    polar = abs(lat) > POLAR
    if not polar and abs(lon) <= 90.0:
        (swapped,) = Frame(sketch.crs).to_plane(lat, lon)
        polar = bool(np.all((sketch.bounds[0] <= swapped) & (swapped <= sketch.bounds[1])))
    return "are longitude and latitude swapped (GeoJSON has longitude first)? Else " if polar else ""


def _check_start_free(sketch: SceneSketch, obstacles: Sequence[tuple[str, Any]]) -> None:
    start = _start_points(sketch)
    for what, polygon in obstacles:
        if polygon.contains(start) and polygon.boundary.distance(start) > sketch.tolerance:
            if what == OUTSIDE:
                raise DataError(
                    f"{sketch.where}: the start {sketch.show(sketch.start)} lies outside the border: "
                    f"{_swap_question(sketch, sketch.start)}move it, or widen the border"
                )
            wide = any(place.what == what and place.buffer for place in sketch.obstacles)
            raise DataError(
                f"{sketch.where}: the start {sketch.show(sketch.start)} lies inside {what}"
                f"{' or its buffer' if wide else ''}; move either"
            )


def _overlaps(
    sketch: SceneSketch, regions: Mapping[str, shapely.Geometry], obstacles: Sequence[tuple[str, Any]]
) -> Iterator[str]:
    """Messages about obstacles and regions that have a common area beyond rounding errors."""
    names, places = list(regions), list(regions.values())
    tree, outside = shapely.STRtree(places), set[int]()
    for what, polygon in obstacles:
        for hit in sorted(tree.query(polygon, predicate="intersects")):
            common = shapely.intersection(polygon, places[hit])
            if common.area > sketch.tolerance * max(shapely.length(polygon), shapely.length(places[hit])):
                at = shapely.get_coordinates(shapely.point_on_surface(common))[0]
                if what != OUTSIDE:
                    yield (
                        f"{sketch.where}: {what} overlaps region {names[hit]!r} at {sketch.show(at)}; "
                        f"they may touch, not overlap: cut the obstacle out of the region, or move one"
                    )
                elif hit not in outside:
                    outside.add(hit)
                    yield (
                        f"{sketch.where}: region {names[hit]!r} lies outside the border at "
                        f"{sketch.show(at)}; move it, or widen the border"
                    )
