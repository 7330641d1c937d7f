"""Decomposition of the free space of a scene into convex cells, and location of points in it.

All outlines are snapped to a grid with a step of 1e-12 of the map (1 µm on 1000 km), and their arrangement is
computed once on the grid. Neighbours then share corners exactly, and shared edges are identified by comparing
integers.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from careful_io.messages import shown_value
from careful_io.texts import listed_text
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.display import Displayed
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.world.polygons import GridRing, convex_parts, drop_flat, ring_edges, rotated_ring
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    import networkx as nx

GRID_FRACTION = 2.0**-40  # grid step over the size of the map
EDGE_FRACTION = 1e-11  # of the size of the map; a point this close to an edge counts as on it
BUCKETS = 64  # of the grid that finds the cell of a point, along each axis
THINNEST = 1024.0  # [grid steps], about 1e-9 of the map; thinner convex parts are rounding errors
SHORTEST_DOOR = 4.0  # [grid steps]; shorter contacts are rounding errors


@dataclass(frozen=True, repr=False)
class Decomposition(Displayed):
    """The free space of a scene as convex cells that do not overlap.

    Attributes
    ----------
    cells : tuple of (n, 2) float
        Convex, counter-clockwise [m]. Cells with more labels come first: for a point on the boundary of a
        region, the first cell that contains it lies in the region.
    labels : tuple of frozenset of str
        The regions that contain each cell.
    doors : (D, 2) int
        "Doors": pairs of cells (i < j) that share an edge of positive length.
    obstacles : tuple of (n, 2) float
        Convex parts of the obstacles, counter-clockwise.
    regions : mapping of name to tuple of (n, 2) float
        Convex parts of each region.
    """

    cells: tuple[FloatArray, ...]
    labels: tuple[frozenset[str], ...]
    doors: IntArray
    obstacles: tuple[FloatArray, ...]
    regions: Mapping[str, tuple[FloatArray, ...]]

    @cached_property
    def graph(self) -> nx.Graph:
        """The cells as nodes, with ``label``, ``area`` [m²] and ``centre`` [m], and the doors as edges."""
        import networkx as nx

        graph = nx.Graph()
        for number, (cell, label) in enumerate(zip(self.cells, self.labels, strict=True)):
            area, centre = moments(cell)
            graph.add_node(number, label=label, area=area, centre=centre)
        graph.add_edges_from(self.doors.tolist())
        return graph

    @property
    def letters(self) -> tuple[frozenset[str], ...]:
        """The labels that can occur, by size, then by name.

        The empty label is always included; obstacles and points outside the bounds have it.
        """
        return tuple(sorted({frozenset[str](), *self.labels}, key=lambda s: (len(s), sorted(s))))

    def facts(self) -> Mapping[str, str]:
        """Numbers of cells, doors and convex parts, and the names of the regions."""
        return {
            "cells": f"{len(self.cells):,}",
            "doors": f"{len(self.doors):,}",
            "convex parts of obstacles": f"{len(self.obstacles):,}",
            "regions": listed_text(self.regions),
        }


def decompose(scene: Scene) -> Decomposition:
    """Decompose the bounds minus the obstacles into convex cells with labels.

    The outlines of obstacles and regions cut the bounds into faces; each face outside all obstacles is split
    into convex cells. Overlapping regions give cells with several labels. Overlapping obstacles are not
    merged, since their union would need more convex parts; the risk bounds count their common area twice,
    which is conservative. An obstacle inside another is dropped.

    Raises
    ------
    DataError
        If the obstacles cover the whole map.
    """
    step = _grid_step(scene)
    obstacles = _snapped_obstacles(map(shapely.Polygon, scene.obstacles), step)
    regions = {name: _snapped_region(outlines, step) for name, outlines in scene.regions.items()}
    (west, south), (east, north) = scene.bounds.tolist()
    box = shapely.Polygon([(west, south), (east, south), (east, north), (west, north)])
    cells = _labelled_cells(_snapped_shape(box, step), obstacles, regions)
    if not cells:
        raise DataError(
            "the obstacles cover the whole map, no free space is left; remove one or widen the bounds"
        )
    return Decomposition(
        cells=tuple(_ring_in_metres(drop_flat(ring), step) for ring, _ in cells),
        labels=tuple(label for _, label in cells),
        doors=_shared_edges([ring for ring, _ in cells]),
        obstacles=_obstacle_parts(obstacles, step),
        regions={
            name: tuple(_ring_in_metres(ring, step) for ring in _convex_rings(polygon))
            for name, polygon in regions.items()
        },
    )


def convex_obstacles(scene: Scene, polygons: Iterable[shapely.Geometry]) -> tuple[FloatArray, ...]:
    """Convex parts (n, 2) [m] of ``polygons`` [m], snapped to the grid as the obstacles of ``scene``."""
    step = _grid_step(scene)
    return _obstacle_parts(_snapped_obstacles(polygons, step), step)


def convex_pieces(scene: Scene, polygons: Iterable[shapely.Geometry]) -> tuple[FloatArray, ...]:
    """Convex polygons (n, 2) [m], counter-clockwise, that tile ``polygons`` [m], which may have holes."""
    step = _grid_step(scene)
    return tuple(
        _ring_in_metres(ring, step)
        for shape in polygons
        for ring in _convex_rings(_snapped_shape(shape, step))
    )


def half_planes(polygon: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Outward unit normals a (n, 2) and offsets b (n,) [m] of a convex polygon: a' x <= b inside."""
    along = np.roll(polygon, -1, axis=0) - polygon
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    return normals, np.sum(normals * polygon, axis=1)


def inside_depth(polygon: FloatArray, points: FloatArray) -> FloatArray:
    """Depth of ``points`` (P, 2) [m] inside a convex polygon, shape (P,) [m]; negative outside.

    min_k (b_k - a_k' x)
    """
    normals, offsets = half_planes(polygon)
    return np.asarray((offsets - points @ normals.T).min(axis=1), float)


def cells_of_points(decomposition: Decomposition, points: FloatArray) -> IntArray:
    """The cell of each point, shape (P,); -1 outside the bounds and strictly inside an obstacle.

    It is the first cell that contains the point, so that an edge of a region belongs to the region. For a
    point outside all cells because of rounding, it is the cell with the largest :func:`inside_depth`.
    """
    points = np.asarray(points, float).reshape(-1, 2)
    corners = np.concatenate([*decomposition.cells, *decomposition.obstacles])
    close = EDGE_FRACTION * float(np.ptp(corners, axis=0).max())
    room = np.stack([inside_depth(cell, points) for cell in decomposition.cells], axis=1)
    holds, covered = room >= -close, np.zeros(len(points), bool)
    for part in decomposition.obstacles:
        covered |= inside_depth(part, points) >= 0
    found = np.where(holds.any(axis=1), holds.argmax(axis=1), room.argmax(axis=1))
    nowhere = ~holds.any(axis=1) & (covered | (room.max(axis=1) < -100 * close))
    return np.where(nowhere, -1, found)


def bucket_cells(decomposition: Decomposition, bounds: FloatArray) -> tuple[IntArray, IntArray]:
    """Candidate cells of each bucket of a 64 x 64 grid over ``bounds`` (2, 2) [m]: arrays ``ptr``, ``index``.

    Bucket (i, j), column i and row j, has the number k = 64 i + j and, in ascending order, the cells
    ``index[ptr[k]:ptr[k + 1]]``. A cell is a candidate unless a face of the cell or of the bucket separates
    the two (separating axis theorem). Buckets are enlarged by 1e-6, so that rounding does not exclude a cell.
    If the first candidate c contains the whole bucket, the number is ~c.
    """
    size = (bounds[1] - bounds[0]) / BUCKETS
    west_to_east, south_to_north = (bounds[0][:, None] + size[:, None] * (np.arange(BUCKETS) + 0.5)).tolist()
    middle = np.array([[x, y] for x in west_to_east for y in south_to_north])
    half = 0.5 * size * (1 + 1e-6)
    pairs = [_boxes_of_cell(cell, middle, half) for cell in decomposition.cells]
    near, whole = (np.stack(columns, axis=1) for columns in zip(*pairs, strict=True))
    ptr = np.concatenate([[0], np.cumsum(near.sum(axis=1))])
    bucket, index = np.nonzero(near)
    first = np.append(True, np.diff(bucket) > 0)[: len(bucket)]
    return ptr.astype(np.int64), np.where(first & whole[bucket, index], ~index, index).astype(np.int64)


def unreachable_regions(decomposition: Decomposition, scene: Scene, atoms: Iterable[str]) -> tuple[str, ...]:
    """Names in ``atoms`` whose regions no sequence of doors connects to the start.

    Raises
    ------
    ConfigError
        If a name is not a region of the scene.
    DataError
        If the start lies inside an obstacle.
    """
    import networkx as nx

    names = sorted(set(atoms))
    for name in names:
        if name not in scene.regions:
            guess = difflib.get_close_matches(name, scene.regions, n=1, cutoff=0.5)
            hint = (
                f"did you mean {guess[0]!r}?"
                if guess
                else "rename it in the formula, or draw it in the scene"
            )
            raise ConfigError(
                f"mission.formula names region {shown_value(name)}, which the scene does not have; "
                f"it has {', '.join(sorted(scene.regions))}: {hint}"
            )
    start = int(cells_of_points(decomposition, scene.start[None])[0])
    if start < 0:
        raise DataError(
            f"the start {scene.start.tolist()} [m] lies in no free cell; move it out of the obstacle"
        )
    reached = nx.node_connected_component(decomposition.graph, start)
    shown = frozenset[str]().union(*(decomposition.labels[i] for i in reached))
    return tuple(name for name in names if name not in shown)


# --- outlines on the grid ---------------------------------------------------------------------------


def _grid_step(scene: Scene) -> float:
    """Grid step [m], a power of two so that coordinates are exact; at least the resolution of floats."""
    size = float((scene.bounds[1] - scene.bounds[0]).max())
    step = 2.0 ** math.ceil(math.log2(size)) * GRID_FRACTION
    return max(step, 2.0 ** math.ceil(math.log2(16 * np.spacing(np.abs(scene.bounds).max()))))


def _snapped_region(outlines: Sequence[FloatArray], step: float) -> shapely.Geometry:
    """The union of the polygons of a region, in grid steps."""
    found = [_snapped_shape(polygon, step) for polygon in map(shapely.Polygon, outlines)]
    return found[0] if len(found) == 1 else shapely.union_all(found, grid_size=1.0)


def _snapped_shape(shape: shapely.Geometry, step: float) -> shapely.Geometry:
    """``shape`` [m] in grid steps, made valid if snapping made corners or edges coincide."""
    return shapely.set_precision(shapely.transform(shape, lambda corners: np.rint(corners / step)), 1.0)


def _snapped_obstacles(shapes: Iterable[shapely.Geometry], step: float) -> list[shapely.Geometry]:
    """``shapes`` [m] in grid steps, without those inside another one."""
    polygons = [_snapped_shape(shape, step) for shape in shapes]
    if not polygons:
        return []
    inner, outer = shapely.STRtree(polygons).query(polygons, predicate="covered_by")
    same = {(i, j) for i, j in zip(inner.tolist(), outer.tolist(), strict=True) if i != j}
    dropped = {i for i, j in same if (j, i) not in same or j < i}
    return [
        polygon for i, polygon in enumerate(polygons) if i not in dropped and not shapely.is_empty(polygon)
    ]


def _polygon_rings(face: Any) -> list[GridRing]:
    """Outline (counter-clockwise) and holes (clockwise) of a polygon, in grid steps."""
    face = shapely.orient_polygons(face)
    rings = [shapely.get_coordinates(ring)[:-1].tolist() for ring in (face.exterior, *face.interiors)]
    return [[(int(x), int(y)) for x, y in ring] for ring in rings]


def _convex_rings(polygon: shapely.Geometry) -> list[GridRing]:
    """Convex parts of a shape in grid steps, without flat corners."""
    found = []
    for piece in shapely.get_parts(polygon):
        outline, *holes = _polygon_rings(piece)
        found += [drop_flat(ring) for ring in convex_parts(outline, holes)]
    return [rotated_ring(ring, min(ring)) for ring in found if ring]


def _obstacle_parts(polygons: Sequence[shapely.Geometry], step: float) -> tuple[FloatArray, ...]:
    """Convex parts [m] of shapes in grid steps, without slivers beside thicker parts of the same shape."""
    found: list[GridRing] = []
    for polygon in polygons:
        rings = _convex_rings(polygon)
        found += [ring for ring in rings if _thickness(ring) >= THINNEST] or rings
    return tuple(_ring_in_metres(ring, step) for ring in found)


def _thickness(ring: GridRing) -> float:
    """Twice the area over the longest edge [grid steps]: at most twice the width of a convex ring."""
    corners = np.array(ring, float)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max()
    return 2 * moments(corners)[0] / float(longest)


def _ring_in_metres(ring: GridRing, step: float) -> FloatArray:
    return np.array(ring, float) * step


# --- cells ------------------------------------------------------------------------------------------


def _labelled_cells(
    box: shapely.Geometry, obstacles: Sequence[shapely.Geometry], regions: dict[str, shapely.Geometry]
) -> list[tuple[GridRing, frozenset[str]]]:
    """Convex rings with all shared corners, and their labels, sorted by number of labels, names, position."""
    outlines = shapely.boundary([box, *obstacles, *regions.values()])
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(outlines, grid_size=1.0)]))
    inside = shapely.point_on_surface(faces)
    free = _points_within([box], inside) & ~_points_within(obstacles, inside)
    holds = {name: _points_within([polygon], inside) for name, polygon in regions.items()}
    found = []
    for k in np.flatnonzero(free):
        label = frozenset(name for name, held in holds.items() if held[k])
        outline, *holes = _polygon_rings(faces[k])
        parts = [ring for ring in convex_parts(outline, holes) if drop_flat(ring)]
        found += [(rotated_ring(ring, min(ring)), label) for ring in parts]
    return sorted(found, key=lambda cell: (-len(cell[1]), sorted(cell[1]), cell[0]))


def _points_within(polygons: Sequence[shapely.Geometry], points: Any) -> BoolArray:
    """Which ``points`` (shapely points) lie in any of ``polygons``, (P,)."""
    inside = np.zeros(len(points), bool)
    if len(polygons):
        inside[shapely.STRtree(polygons).query(points, predicate="intersects")[0]] = True
    return inside


def _shared_edges(rings: Sequence[GridRing]) -> IntArray:
    """Pairs (D, 2) of cells with a common edge, which they traverse in opposite directions."""
    owner = {edge: i for i, ring in enumerate(rings) for edge in ring_edges(ring)}
    width: dict[tuple[int, int], float] = {}
    for (a, b), i in owner.items():
        j = owner.get((b, a), -1)
        if i < j:
            width[i, j] = width.get((i, j), 0.0) + math.dist(a, b)
    doors = sorted(pair for pair, length in width.items() if length > SHORTEST_DOOR)
    return np.array(doors, np.int64).reshape(-1, 2)


# --- points -----------------------------------------------------------------------------------------


def _boxes_of_cell(cell: FloatArray, middle: FloatArray, half: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Which boxes ``middle`` (B, 2) ± ``half`` (2,) touch a convex cell, and which lie in it, (B,) each."""
    normals, offsets = half_planes(cell)
    at, reach = middle @ normals.T, np.abs(normals) @ half
    sides = (middle + half >= cell.min(axis=0)) & (middle - half <= cell.max(axis=0))
    touches: BoolArray = (at - reach <= offsets).all(axis=1) & sides.all(axis=1)
    within: BoolArray = np.all(at + reach <= offsets, axis=1)
    return touches, within


def moments(polygon: FloatArray) -> tuple[float, FloatArray]:
    """Area [m²] and centroid (2,) [m] of a simple polygon, by triangles from its first corner."""
    spokes = polygon[1:] - polygon[0]
    twice = spokes[:-1, 0] * spokes[1:, 1] - spokes[:-1, 1] * spokes[1:, 0]
    centroid = polygon[0] + (twice[:, None] * (spokes[:-1] + spokes[1:])).sum(axis=0) / (3 * twice.sum())
    return float(twice.sum() / 2), centroid
