"""Polygons of very many corners become simpler ones before anything is planned, on the careful side.

Obstacles and regions that the mission only keeps out of get larger, regions that it only visits smaller: what
completes the mission on the simplified map does so on the true one. A region that it both visits and keeps
out of stays as it is drawn.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pareto_ltl.support.display import distance_text
from pareto_ltl.world.outlines import Room, corner_count, narrowed_polygon, widened_polygon
from pareto_ltl.world.scene_shapes import clipped_parts
from pareto_ltl.world.scene_sketch import DrawingRules, SceneSketch

if TYPE_CHECKING:
    import shapely

LOG = logging.getLogger(__name__)

MANY_CORNERS = 40  # of a polygon: only polygons with more are simplified
MAP_SHARE = 0.002  # of the longer side of the map: how far outlines move with simplify=auto
TRIES = 4  # tolerances, each half of the one before
SPARED = 0.1  # of the area of a region or landmark: as much may be lost to what gets larger
LOST = 0.25  # of its area: as much may be lost where it gets smaller itself


@dataclass(frozen=True, slots=True)
class DrawnMap:
    """What is drawn, as polygons [m]: regions by name, obstacles and landmarks as messages call them.

    ``kept_out`` are the regions that may get larger, ``visited`` those that may get smaller.
    """

    regions: dict[str, shapely.Geometry]
    obstacles: list[tuple[str, Any]]
    landmarks: list[tuple[str, shapely.Geometry]]
    kept_out: frozenset[str] = frozenset()
    visited: frozenset[str] = frozenset()


def simplified_map(sketch: SceneSketch, rules: DrawingRules, drawn: DrawnMap) -> tuple[DrawnMap, float]:
    """``drawn`` with fewer corners, and how far its outlines have moved [m]; logs what was simplified."""
    places = [*drawn.regions.values(), *(shape for _, shape in (*drawn.obstacles, *drawn.landmarks))]
    if rules.simplify == 0 or not any(_has_many_corners(place) for place in places):
        return drawn, 0.0
    work = _Simplifier.of(sketch, rules, drawn)
    obstacles = [(what, part) for what, polygon in drawn.obstacles for part in work.widened(what, polygon)]
    regions = {name: work.region(drawn, name, shape) for name, shape in drawn.regions.items()}
    landmarks = [(what, work.narrowed(what, shape)) for what, shape in drawn.landmarks]
    return DrawnMap(regions, obstacles, landmarks, drawn.kept_out, drawn.visited), work.farthest


def _has_many_corners(shape: shapely.Geometry) -> bool:
    import shapely

    return any(corner_count(part) > MANY_CORNERS for part in shapely.get_parts(shape).tolist())


@dataclass(slots=True)
class _Simplifier:
    """Simplifies polygons of one map, none by more than ``most`` [m]; ``spared`` must stay reachable."""

    sketch: SceneSketch
    room: Room
    most: float
    start: shapely.Geometry
    spared: list[shapely.Geometry]
    farthest: float = 0.0

    @classmethod
    def of(cls, sketch: SceneSketch, rules: DrawingRules, drawn: DrawnMap) -> _Simplifier:
        import shapely

        size = float((sketch.bounds[1] - sketch.bounds[0]).max())
        start, border = shapely.Point(sketch.start), shapely.box(*sketch.bounds.ravel()).exterior
        shapes = [*drawn.regions.values(), *(shape for _, shape in (*drawn.obstacles, *drawn.landmarks))]
        parts = [part for shape in shapes for part in shapely.get_parts(shape).tolist()]
        spared = [shape for name, shape in drawn.regions.items() if name not in drawn.kept_out]
        most = MAP_SHARE * size if isinstance(rules.simplify, str) else float(rules.simplify)
        room = Room.of([*parts, start, border], size)
        return cls(sketch, room, most, start, [*spared, *(shape for _, shape in drawn.landmarks)])

    def region(self, drawn: DrawnMap, name: str, shape: shapely.Geometry) -> shapely.Geometry:
        """A region on the careful side, or as it is where both sides matter."""
        import shapely

        what = f"region {name!r}"
        if name in drawn.kept_out:
            parts = [part for one in shapely.get_parts(shape).tolist() for part in self.widened(what, one)]
            return parts[0] if len(parts) == 1 else shapely.union_all(parts)
        if name in drawn.visited:
            return self.narrowed(what, shape)
        if _has_many_corners(shape):
            LOG.info("%s keeps its %s corners: the mission visits it and keeps out of it", what,
                     f"{corner_count(shape):,}")  # fmt: skip
        return shape

    def widened(self, what: str, polygon: Any) -> Sequence[Any]:
        """Polygons that cover ``polygon`` within the bounds."""
        before = corner_count(polygon)
        if before <= MANY_CORNERS:
            return [polygon]
        tolerance = self.room.tolerance(polygon, self.most)
        for _ in range(TRIES):
            found = widened_polygon(polygon, tolerance)
            if corner_count(found) >= before:
                break
            if self._harmless(polygon, found):
                self._note(what, before, corner_count(found), tolerance, "outwards")
                return clipped_parts(self.sketch, found)
            tolerance /= 2
        return [polygon]

    def narrowed(self, what: str, shape: shapely.Geometry) -> shapely.Geometry:
        """``shape`` with each part of many corners replaced by what lies inside it."""
        import shapely

        parts = shapely.get_parts(shape).tolist()
        for k, part in enumerate(parts):
            before = corner_count(part)
            if before <= MANY_CORNERS:
                continue
            tolerance = self.room.tolerance(part, self.most)
            for _ in range(TRIES):
                found = narrowed_polygon(part, tolerance)
                if corner_count(found) >= before:
                    break
                if shapely.area(found) >= (1 - LOST) * part.area:
                    parts[k] = found
                    self._note(what, before, corner_count(found), tolerance, "inwards")
                    break
                tolerance /= 2
        return parts[0] if len(parts) == 1 else shapely.union_all(parts)

    def _harmless(self, polygon: Any, found: Any) -> bool:
        """Whether the start and most of what is visited still lie outside of the larger polygon."""
        import shapely

        if found.intersects(self.start) and not polygon.intersects(self.start):
            return False
        grown = shapely.difference(found, polygon)
        return not any(
            shapely.area(shapely.intersection(grown, other)) > SPARED * shapely.area(other)
            for other in self.spared
            if grown.intersects(other)
        )

    def _note(self, what: str, before: int, after: int, tolerance: float, side: str) -> None:
        self.farthest = max(self.farthest, tolerance)
        LOG.info(
            "%s: %s corners simplified to %s, at most %s %s (scene.simplify)",
            what, f"{before:,}", f"{after:,}", distance_text(tolerance), side,
        )  # fmt: skip


__all__ = ["DrawnMap", "simplified_map"]
