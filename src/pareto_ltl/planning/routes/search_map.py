"""The map for the search of lines: outlines with many corners are replaced by simpler ones.

A line is only a start: every path made from it is checked with the true outlines. So obstacles and cells to
be avoided may be a little larger here, and cells to be visited a little smaller.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from pareto_ltl.planning.pack import pack_barriers, pack_faces
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.world import scene_simplify as outline
from pareto_ltl.world.cells import convex_obstacles, convex_pieces
from pareto_ltl.world.scene import Scene
from plane_kernels import types as kd

if TYPE_CHECKING:
    import shapely

LOG = logging.getLogger(__name__)

MANY_CORNERS = 16  # only outlines with more corners are simplified
MANY_CELLS = 64  # cells of one label are united and simplified only if they have more corners in all
MAP_SHARE = 0.002  # of the size of the map: largest distance of a simplified outline from the true one
UNION_GRID = 1e-9  # of the size of the map: corners of cells closer than this coincide

Change: TypeAlias = "Callable[[shapely.Polygon, float], shapely.Geometry]"


@dataclass(frozen=True, slots=True)
class ShownCells:
    """Labelled cells that show the same propositions of the mission.

    Attributes
    ----------
    cells : (n,) int
        Their indices.
    within, around : tuple of (k, 2) float
        Convex polygons inside the cells, and convex polygons that cover them.
    united : bool
        Whether the polygons describe the union of the cells; if not, they are the cells themselves.
    """

    cells: IntArray
    within: tuple[FloatArray, ...]
    around: tuple[FloatArray, ...]
    united: bool


@dataclass(frozen=True, slots=True)
class SearchMap:
    """Convex polygons (n, 2) [m], counter-clockwise, for the search of lines.

    Attributes
    ----------
    obstacles : tuple of (n, 2) float
        Polygons that cover the obstacles.
    barriers : Faces
        The half planes of ``obstacles`` and, where the border is a wall, of its sides.
    shown : mapping of propositions to ShownCells
        The labelled cells by the propositions of the mission that they show; cells that show only other
        propositions are under the empty set.
    witness : Faces
        A polygon inside every convex part of ``problem.theorem2``.
    """

    obstacles: tuple[FloatArray, ...]
    barriers: kd.Faces
    shown: Mapping[frozenset[str], ShownCells]
    witness: kd.Faces


_KNOWN: WeakKeyDictionary[Problem, SearchMap] = WeakKeyDictionary()


def search_map(problem: Problem) -> SearchMap:
    """The map on which lines of ``problem`` are searched, made once."""
    found = _KNOWN.get(problem)
    if found is None:
        _KNOWN[problem] = found = _simplified_map(problem)
    return found


def blocked_area(problem: Problem) -> shapely.Geometry:
    """The union of the obstacles of the map on which lines are searched."""
    import shapely

    return shapely.union_all([shapely.Polygon(part) for part in search_map(problem).obstacles])


def meets(shape: shapely.Geometry, begin: FloatArray, end: FloatArray) -> BoolArray:
    """Which of the segments (S, 2) meet ``shape``."""
    import shapely

    shapely.prepare(shape)
    return np.asarray(shapely.intersects(shape, shapely.linestrings(np.stack([begin, end], axis=1))), bool)


def _simplified_map(problem: Problem) -> SearchMap:
    scene, tally = problem.scene, _Simplifier.of(problem.scene)
    obstacles = _covering_parts(problem, tally)
    barriers = problem.barriers
    if obstacles is not problem.decomposition.obstacles:
        barriers = pack_barriers(scene, pack_faces(obstacles))
    labelled: dict[frozenset[str], list[int]] = {}
    for number, label in enumerate(problem.labels):
        if label:
            labelled.setdefault(label & set(problem.atoms), []).append(number)
    shown = {names: tally.shown(problem, cells) for names, cells in labelled.items()}
    parts = [part for name in problem.atoms for part in problem.decomposition.regions.get(name, ())]
    witness = pack_faces([tally.convex_part(part) for part in parts])
    if tally.before:
        LOG.info(
            "the search of lines uses simplified outlines, %d corners instead of %d, at most %.3g m from the "
            "true outlines; every check uses the true ones",
            tally.after, tally.before, tally.farthest,
        )  # fmt: skip
    return SearchMap(obstacles, barriers, shown, witness)


def _covering_parts(problem: Problem, tally: _Simplifier) -> tuple[FloatArray, ...]:
    """Convex parts that cover the obstacles."""
    import shapely

    scene, outlines = problem.scene, []
    for corners in scene.obstacles:
        polygon = shapely.Polygon(corners)
        found = tally.simpler(polygon, outline.widened_polygon) if len(corners) > MANY_CORNERS else polygon
        outlines.append(found)
    if not tally.before:
        return problem.decomposition.obstacles
    return convex_obstacles(scene, outlines)


@dataclass(slots=True)
class _Simplifier:
    """Simplifies polygons of one map, and counts their corners ``before`` and ``after``."""

    scene: Scene
    room: outline.Room
    before: int = 0
    after: int = 0
    farthest: float = 0.0

    @classmethod
    def of(cls, scene: Scene) -> _Simplifier:
        import shapely

        outlines = [shapely.Polygon(p) for p in (*scene.obstacles, *scene.region_outlines)]
        size = float(np.ptp(scene.bounds, axis=0).max())
        return cls(scene, outline.Room.of([*outlines, shapely.Point(scene.start)], size))

    @property
    def size(self) -> float:
        """The longer side of the map [m]."""
        return self.room.size

    def simpler(self, shape: shapely.Polygon, change: Change) -> shapely.Geometry:
        """``shape`` after ``change``, or ``shape`` itself if that does not reduce its corners."""
        tolerance = self.room.tolerance(shape, MAP_SHARE * self.size)
        found = change(shape, tolerance)
        before, after = outline.corner_count(shape), outline.corner_count(found)
        if after >= before:
            return shape
        self.before, self.after = self.before + before, self.after + after
        self.farthest = max(self.farthest, tolerance)
        return found

    def shown(self, problem: Problem, numbers: Sequence[int]) -> ShownCells:
        """The union of cells, simplified; the cells themselves if they have few corners."""
        import shapely

        cells = tuple(problem.decomposition.cells[k] for k in numbers)
        if sum(map(len, cells)) <= MANY_CELLS:
            return ShownCells(np.array(numbers), cells, cells, united=False)
        union = shapely.union_all([shapely.Polygon(cell) for cell in cells], grid_size=UNION_GRID * self.size)
        parts = [
            outline.without_pools(part, outline.CLOSED * self.size)
            for part in shapely.get_parts(union).tolist()
        ]
        within, around = (
            convex_pieces(self.scene, [self.simpler(part, change) for part in parts])
            for change in (outline.narrowed_polygon, outline.widened_polygon)
        )
        return ShownCells(np.array(numbers), within, around, united=True)

    def convex_part(self, part: FloatArray) -> FloatArray:
        """A convex polygon inside ``part``; the part itself if it has few corners."""
        import shapely

        if len(part) <= MANY_CORNERS:
            return part
        found = self.simpler(shapely.Polygon(part), outline.narrowed_polygon)
        return shapely.get_coordinates(shapely.orient_polygons(found))[:-1]


def sights(problem: Problem, x: FloatArray) -> BoolArray:
    """Whether each leg of the means ``x`` (T+1, 2) [m] crosses each landmark, (T, K)."""
    import shapely

    crossed = np.zeros((max(len(x) - 1, 0), len(problem.landmarks)), bool)
    for k, corners in enumerate(problem.landmarks):
        crossed[:, k] = meets(shapely.Polygon(corners), x[:-1], x[1:])
    return crossed
