"""Conservative simplification of polygons with very many corners, before planning.

Obstacles and regions that the mission only avoids are enlarged, regions that it only visits are
reduced: a path that completes the mission on the simplified map also completes it on the original map. A
region that the mission both visits and avoids is not changed.

An outline is moved by half of the tolerance, outwards or inwards, and simplified by less than that (Douglas
and Peucker, 1973, doi:10.3138/FM57-6770-U75U-7727), so that it cannot reach the original outline again.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from careful_io.texts import distance_text
from pareto_ltl.world.scene_shapes import clipped_parts
from pareto_ltl.world.scene_sketch import DrawingRules, SceneSketch

LOG = logging.getLogger(__name__)

ARC = 4  # segments of a quarter circle around a moved corner; they reduce its radius by up to 2 %
WITHIN = 0.9  # tolerance of the simplification, as a share of the distance moved
HALVINGS = 8  # how often a tolerance that closes a bay is halved
CLOSED = 1e-5  # narrower gaps, as a share of the size of the map, count as closed
OWN_SHARE = 0.05  # largest move of an outline, as a share of the square root of the polygon's area
GAP_SHARE = 0.25  # largest move of an outline, as a share of the gap to the next outline or to the start
MANY_CORNERS = 40  # only polygons with more corners are simplified
MAP_SHARE = 0.002  # tolerance of simplify=auto, as a share of the longer side of the map
TRIES = 4  # number of tolerances tried, each half of the previous one
SPARED = 0.1  # largest share of a region or landmark that an enlarged polygon may cover
LOST = 0.25  # largest share of its area that a polygon may lose when it is reduced


@dataclass(frozen=True, slots=True)
class DrawnMap:
    """The shapes of a map [m]: regions by name, obstacles and landmarks by their names in messages.

    ``kept_out`` are the regions that may be enlarged, ``visited`` those that may be reduced.
    """

    regions: dict[str, shapely.Geometry]
    obstacles: list[tuple[str, Any]]
    landmarks: list[tuple[str, shapely.Geometry]]
    kept_out: frozenset[str] = frozenset()
    visited: frozenset[str] = frozenset()

    @property
    def shapes(self) -> list[Any]:
        """The shapes of all places."""
        return [*self.regions.values(), *(shape for _, shape in (*self.obstacles, *self.landmarks))]


def simplified_map(sketch: SceneSketch, rules: DrawingRules, drawn: DrawnMap) -> tuple[DrawnMap, float]:
    """``drawn`` with fewer corners, and the largest distance that an outline moved [m]; logs each change."""
    if rules.simplify == 0 or not any(map(_has_many_corners, drawn.shapes)):
        return drawn, 0.0
    work = _Simplifier(sketch, rules, drawn)
    obstacles = [(what, part) for what, polygon in drawn.obstacles for part in work.widened(what, polygon)]
    regions = {name: work.region(name, shape) for name, shape in drawn.regions.items()}
    landmarks = [(what, work.narrowed(what, shape)) for what, shape in drawn.landmarks]
    return replace(drawn, regions=regions, obstacles=obstacles, landmarks=landmarks), work.farthest


def _has_many_corners(shape: shapely.Geometry) -> bool:
    return any(corner_count(part) > MANY_CORNERS for part in shapely.get_parts(shape).tolist())


class _Simplifier:
    """Simplifies the polygons of one map; ``farthest`` is the largest distance that an outline moved [m]."""

    def __init__(self, sketch: SceneSketch, rules: DrawingRules, drawn: DrawnMap) -> None:
        size = sketch.size
        border = shapely.box(*sketch.bounds.ravel()).exterior
        parts = [part for shape in drawn.shapes for part in shapely.get_parts(shape).tolist()]
        self.sketch, self.drawn, self.farthest = sketch, drawn, 0.0
        self.start = shapely.Point(sketch.start)
        self.room = Room.of([*parts, self.start, border], size)
        self.most = MAP_SHARE * size if isinstance(rules.simplify, str) else float(rules.simplify)
        self.spared = [shape for name, shape in drawn.regions.items() if name not in drawn.kept_out]
        self.spared += [shape for _, shape in drawn.landmarks]  # that must not be covered

    def region(self, name: str, shape: shapely.Geometry) -> shapely.Geometry:
        """A region enlarged, reduced, or unchanged if the mission both visits and avoids it."""
        what = f"region {name!r}"
        if name in self.drawn.kept_out:
            parts = [part for one in shapely.get_parts(shape).tolist() for part in self.widened(what, one)]
            return parts[0] if len(parts) == 1 else shapely.union_all(parts)
        if name in self.drawn.visited:
            return self.narrowed(what, shape)
        if _has_many_corners(shape):
            LOG.info("%s keeps its %s corners: the mission both visits and avoids it", what,
                     f"{corner_count(shape):,}")  # fmt: skip
        return shape

    def widened(self, what: str, polygon: Any) -> Sequence[Any]:
        """Simpler polygons that cover the part of ``polygon`` within the bounds; itself if there are none."""
        found = self._simpler(what, polygon, widened_polygon, self._harmless, "outwards")
        return [polygon] if found is polygon else clipped_parts(self.sketch, found)

    def narrowed(self, what: str, shape: shapely.Geometry) -> shapely.Geometry:
        """``shape`` with each part with many corners replaced by a simpler one inside it."""

        def large(part: Any, found: Any) -> bool:
            return bool(shapely.area(found) >= (1 - LOST) * part.area)

        parts = [
            self._simpler(what, part, narrowed_polygon, large, "inwards")
            for part in shapely.get_parts(shape).tolist()
        ]
        return parts[0] if len(parts) == 1 else shapely.union_all(parts)

    def _simpler(
        self,
        what: str,
        polygon: Any,
        make: Callable[[Any, float], Any],
        allowed: Callable[[Any, Any], bool],
        side: str,
    ) -> Any:
        """The result of ``make`` with the largest ``allowed`` tolerance; ``polygon`` if there is none."""
        before = corner_count(polygon)
        if before <= MANY_CORNERS:
            return polygon
        tolerance = self.room.tolerance(polygon, self.most)
        for _ in range(TRIES):
            found = make(polygon, tolerance)
            if corner_count(found) >= before:
                break
            if allowed(polygon, found):
                self.farthest = max(self.farthest, tolerance)
                LOG.info(
                    "%s: %s corners simplified to %s, at most %s %s (scene.simplify)",
                    what, f"{before:,}", f"{corner_count(found):,}", distance_text(tolerance), side,
                )  # fmt: skip
                return found
            tolerance /= 2
        return polygon

    def _harmless(self, polygon: Any, found: Any) -> bool:
        """Whether the start and most of each spared shape remain outside the enlarged polygon."""
        if found.intersects(self.start) and not polygon.intersects(self.start):
            return False
        grown = shapely.difference(found, polygon)
        return not any(
            shapely.area(shapely.intersection(grown, other)) > SPARED * shapely.area(other)
            for other in self.spared
            if grown.intersects(other)
        )


# --- simpler outlines -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Room:
    """The shapes on a map of ``size`` [m], whose gaps limit how far an outline may move."""

    tree: shapely.STRtree
    size: float

    @classmethod
    def of(cls, shapes: Iterable[shapely.Geometry], size: float) -> Room:
        """Make the record of ``shapes`` on a map of ``size`` [m]."""
        return cls(shapely.STRtree(list(shapes)), size)

    def tolerance(self, shape: shapely.Polygon, limit: float) -> float:
        """How far [m] the outline of ``shape`` may move, at most ``limit``, so that all gaps stay open."""
        widest = min(limit, OWN_SHARE * math.sqrt(shape.area))
        near = self.tree.query(shape, predicate="dwithin", distance=widest / GAP_SHARE)
        gaps = shapely.distance(shape, self.tree.geometries[near])
        return min(widest, GAP_SHARE * float(np.min(gaps[gaps > CLOSED * self.size], initial=math.inf)))


def corner_count(shape: shapely.Geometry) -> int:
    """Number of corners of all rings of a shape."""
    return int(shapely.get_num_coordinates(shape)) - len(shapely.get_rings(shapely.get_parts(shape)))


def widened_polygon(polygon: shapely.Polygon, tolerance: float) -> shapely.Polygon:
    """A simpler polygon that contains ``polygon`` and extends at most ``tolerance`` [m] beyond it.

    Small bays and holes are filled. If a larger bay would be closed, the tolerance is halved until it stays
    open.
    """
    polygon = without_pools(polygon, tolerance)
    for _ in range(HALVINGS):
        found = without_pools(_moved(polygon, 0.5 * tolerance), tolerance)
        if len(found.interiors) == len(polygon.interiors):
            return found
        tolerance /= 2
    return polygon


def narrowed_polygon(polygon: shapely.Polygon, tolerance: float) -> shapely.Geometry:
    """A polygon inside ``polygon`` whose outline is at most ``tolerance`` [m] away, except in bottlenecks.

    Parts that are narrower than the tolerance are removed, so the result may have several parts. If nothing
    remains, ``polygon`` is returned.
    """
    found = _moved(polygon, -0.5 * tolerance)
    return polygon if found.is_empty else found


def without_pools(polygon: shapely.Polygon, size: float) -> shapely.Polygon:
    """``polygon`` without the holes whose area is at most the area of a circle with radius ``size`` [m]."""
    holes = [ring for ring in polygon.interiors if shapely.Polygon(ring).area > math.pi * size**2]
    return shapely.Polygon(polygon.exterior, holes)


def _moved(polygon: shapely.Polygon, distance: float) -> Any:
    """``polygon`` with its outline moved outwards by ``distance`` [m], and simplified by less than that.

    GEOS (3.12 and later) also removes the first corner of a ring if it is near the simplified outline, which
    may then deviate by twice the tolerance. If this breaks a guarantee, half the tolerance is used.
    """
    moved, limit = shapely.buffer(polygon, distance, quad_segs=ARC), WITHIN * abs(distance)
    found = shapely.simplify(moved, limit)
    outer, inner = (found, polygon) if distance > 0.0 else (polygon, found)
    if outer.covers(inner) and not shapely.hausdorff_distance(moved, found) > limit:
        return found
    return shapely.simplify(moved, limit / 2)
