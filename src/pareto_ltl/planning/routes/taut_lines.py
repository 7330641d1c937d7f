"""Taut lines through the map, and flights along them in the fewest steps.

The search space of a line is its course: for each transition in turn, where it may go and bend, and the
walls. It bends at corners of obstacles, and in gaps too narrow for these corners.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pareto_ltl.kernels.data import Motion
from pareto_ltl.planning.pack import pack_faces
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.routes.obligations import MissionOrder, face_deviations
from pareto_ltl.planning.routes.search_map import SearchMap, search_map
from pareto_ltl.planning.wind_lookup import interpolate
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.world.cells import inside_depth
from plane_kernels import types as kd
from plane_kernels.visibility import (
    BESIDE,
    TOUCH,
    Distances,
    Places,
    Walls,
    arrivals,
    clear_crossings,
    seen_places,
)  # fmt: skip

FACE_MARGIN = 2.0  # [m] distance from every face: larger than the solver's rounding error
ANCHOR = 0.02  # least fraction of the way from a region's rim to its middle at which a line touches it
SLIVER = 0.5  # of the depth of the deepest polygon: shallower ones are not worth a visit
SHARES = (0.4, 0.7, 1.0)  # of the largest distance to keep, for which a gap is tried
NEEDLE = 1e-12  # least 1 + cos of the angle between two normals at a corner
PAIRS_AT_ONCE = 100_000  # pairs of faces: their crossings take 20 MB
CAP = 0.999  # share of u_max to plan with: the wind is not exactly linear over a trust region


def walk_line(problem: Problem, line: FloatArray) -> FloatArray | None:
    """Means (T+1, 2) along ``line`` (n, 2) through all its corners, in steps as long as the wind allows.

    None if the wind is too strong, or not known for so long.
    """
    motion = problem.motion
    x, last = [line[0]], problem.horizon
    for corner in line[1:]:
        while np.linalg.norm(corner - x[-1]) > FACE_MARGIN:
            if len(x) > last:
                return None
            wind = interpolate(problem.wind, problem.wind.mean, len(x) - 1, x[-1])
            s = longest_share(motion, x[-1], corner, wind)
            if s <= 1e-3:
                return None
            x.append(corner if s >= 1.0 else x[-1] + s * (corner - x[-1]))
        x[-1] = corner
    return np.array(x)


def longest_share(motion: Motion, x: FloatArray, goal: FloatArray, wind: FloatArray) -> float:
    """Largest s ≤ 1 such that one step reaches x + s (goal - x): ‖c + s g‖ ≤ u_max is a quadratic."""
    c = motion.b_inv @ (x - motion.a @ x - motion.dt * wind) / motion.dt
    g = motion.b_inv @ (goal - x) / motion.dt
    aa, bb, cc = float(g @ g), float(g @ c), float(c @ c) - (CAP * motion.u_max) ** 2
    disc = bb * bb - aa * cc
    return 0.0 if disc < 0.0 else min(1.0, (math.sqrt(disc) - bb) / aa)


def taut_line(
    problem: Problem, plan: MissionOrder, x: FloatArray, cov: FloatArray, depth: float, z: float
) -> FloatArray | None:
    """The shortest line (n, 2) that visits in the given order and keeps z σ from every obstacle.

    Two places of the line see each other if, flown from one to the other in full steps of still air, every
    step has one face of every obstacle that is cleared at both its ends, as in (M39). The line bends at
    places ``x`` (n, 2) [m], at corners of obstacles that grow with the time of arrival (σ of ``cov``
    (T+1, 2, 2) [m²] at that step), and in regions. ``depth`` in [0, 1] says how deep into a region a visit
    goes: 0 the rim, 1 the middle. Polygons with many corners are simplified
    (:mod:`~pareto_ltl.planning.routes.search_map`).

    The search is A* over the places of all transitions; its heuristic is the way left without walls (Hart,
    Nilsson and Raphael, 1968, doi:10.1109/TSSC.1968.300136). None if there is no line.
    """
    drawn = search_map(problem)
    sd = np.sqrt(np.maximum(np.linalg.eigvalsh(cov)[:, -1], 0.0))
    corners, out = bend_places(drawn.obstacles)
    gaps, wider = gap_places(drawn.obstacles, drawn.barriers, z * float(sd.max()))
    bends = np.vstack([corners, gaps, x]), np.vstack([out, wider, np.zeros_like(x)])
    course = mission_course(problem, drawn, plan, bends, depth)
    bounds = problem.scene.bounds + np.array([[FACE_MARGIN], [-FACE_MARGIN]])
    search = _LineSearch.of(course, bounds, Distances(problem.reach, z * sd + FACE_MARGIN))
    queue = [(0.0, 0.0, 0)]
    while queue:
        _, length, here = heapq.heappop(queue)
        if length > search.best[here]:
            continue
        if course.awaited[here] == len(course.stages):
            return search.line_to(here)
        for entry in search.go_on(here):
            heapq.heappush(queue, entry)
    return None


@dataclass(frozen=True, slots=True)
class _LineSearch:
    """The shortest lines known to the places of a course.

    ``best`` (N,) [m] is the length of the line to place k, which comes from place ``came[k]``; the place then
    lies at ``where[k]`` and keeps ``kept[k]`` [m] from obstacles.
    """

    course: Course
    bounds: FloatArray
    distances: Distances
    best: FloatArray
    came: IntArray
    where: FloatArray
    kept: FloatArray

    @classmethod
    def of(cls, course: Course, bounds: FloatArray, distances: Distances) -> _LineSearch:
        n = len(course.awaited)
        best = np.full(n, np.inf)
        best[0] = 0.0
        kept = np.full(n, distances.keep[0])
        return cls(course, bounds, distances, best, np.full(n, -1), course.places.at.copy(), kept)

    def go_on(self, here: int) -> list[tuple[float, float, int]]:
        """Lengthen the line to ``here`` to every place where this makes the shortest one.

        Returns for each place a lower bound on the length of the whole line, the length so far [m], its
        index.
        """
        stage, x = self.course.stages[self.course.awaited[here]], self.where[here]
        own = stage.ahead
        places = Places(self.course.places.at[own], self.course.places.grow[own])
        rows, ends, keeps, total = arrivals(
            places, self.best[own], x, float(self.best[here]), self.distances, self.bounds
        )
        seen = seen_places(stage.walls, x, float(self.kept[here]), ends, keeps, self.distances.step)
        there, ends, total = own.start + rows[seen], ends[seen], total[seen]
        self.best[there], self.came[there] = total, here
        self.where[there], self.kept[there] = ends, keeps[seen]
        least = total + self.course.way_left(stage, there, ends)
        return list(zip(least.tolist(), total.tolist(), there.tolist(), strict=True))

    def line_to(self, here: int) -> FloatArray:
        """Places (n, 2) of the line to ``here``."""
        line = [self.where[here]]
        while self.came[here] >= 0:
            here = int(self.came[here])
            line.append(self.where[here])
        return np.array(line[::-1])


def _share_face(faces: kd.Faces, clear: BoolArray) -> BoolArray:
    """Which rows of ``clear`` (P, F) are true for some face of every obstacle."""
    if len(faces.ptr) == 1:
        return np.ones(len(clear), bool)
    return np.asarray(np.logical_or.reduceat(clear, faces.ptr[:-1], axis=1).all(axis=1), bool)


def pull_taut(problem: Problem, x: FloatArray, cov: FloatArray, keep: Sequence[int], z: float) -> FloatArray:
    """The shortest line through vertices of ``x`` (T+1, 2), with the first, the last and those in ``keep``.

    Vertices i < j may be joined if one face of every obstacle is cleared at both.
    """
    faces = problem.barriers
    clear = x @ faces.normal.T - faces.offset >= z * face_deviations(faces.normal, cov) - TOUCH
    stops = np.array(sorted({0, *keep}))
    cost, previous = np.zeros(len(x)), np.zeros(len(x), np.int64)
    for j in range(1, len(x)):
        first = stops[np.searchsorted(stops, j) - 1]
        joined = _share_face(faces, clear[first:j] & clear[j])
        joined[-1] = True  # as flown
        reach = cost[first:j] + np.linalg.norm(x[first:j] - x[j], axis=1)
        k = int(np.argmin(np.where(joined, reach, np.inf)))
        cost[j], previous[j] = reach[k], first + k
    rows = [len(x) - 1]
    while rows[-1] > 0:
        rows.append(int(previous[rows[-1]]))
    return x[rows[::-1]]


# --- the search space ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Stage:
    """Where a line may go while one transition is awaited: to ``places``, or to ``goals`` and on from there.

    Both are indices of places of the course; ``rest`` (G,) [m] is the way from each goal to the end without
    walls. The line keeps its distance from the ``walls`` that are obstacles, and must not cross the others.
    """

    places: slice
    goals: slice
    rest: FloatArray
    walls: Walls

    @property
    def ahead(self) -> slice:
        """Places, then goals."""
        return slice(self.places.start, self.goals.stop)


@dataclass(frozen=True, slots=True)
class Course:
    """All transitions in a row. Place 0 is the start, and at place k transition ``awaited[k]`` is next."""

    places: Places
    awaited: IntArray
    stages: tuple[Stage, ...]

    def way_left(self, stage: Stage, numbers: IntArray, points: FloatArray) -> FloatArray:
        """Length [m] of the way without walls from ``points`` (P, 2), where places ``numbers`` (P,) are."""
        way = least_way(points, self.places.at[stage.goals], stage.rest)
        arrived = numbers >= stage.goals.start
        way[arrived] = stage.rest[numbers[arrived] - stage.goals.start]
        return way


def least_way(points: FloatArray, goals: FloatArray, rest: FloatArray) -> FloatArray:
    """min_g ‖x - g‖ + rest_g for every row x of ``points``."""
    way = np.hypot(points[:, :1] - goals[:, 0], points[:, 1:] - goals[:, 1]) + rest
    return np.asarray(way.min(axis=1), float)


def mission_course(
    problem: Problem, drawn: SearchMap, plan: MissionOrder, bends: tuple[FloatArray, FloatArray], depth: float
) -> Course:
    """All transitions of ``plan``, each with the ``bends`` of every line, its walls' corners, its goals."""
    goals = [_anchors(drawn, label, depth) for label in plan.labels]
    rests = [np.zeros(len(goals[-1]))]
    for here, after in zip(goals[-2::-1], goals[:0:-1], strict=True):
        rests.insert(0, least_way(here, after, rests[0]))
    at, grow, awaited = [problem.scene.start[None]], [np.zeros((1, 2))], [0]
    stages: list[Stage] = []
    for s, (label, state) in enumerate(zip(plan.labels, plan.states, strict=True)):
        spoilers = _spoiling_polygons(problem, drawn, label, state)
        corners, out = bend_places(spoilers)
        at += [bends[0], corners + FACE_MARGIN * out, goals[s]]
        grow += [bends[1], np.zeros((len(corners) + len(goals[s]), 2))]
        first, count = len(awaited), len(bends[0]) + len(corners)
        awaited += [s] * count + [s + 1] * len(goals[s])
        places, ends = slice(first, first + count), slice(first + count, len(awaited))
        stages.append(Stage(places, ends, rests[s], _packed_walls(drawn, spoilers)))
    return Course(Places(np.vstack(at), np.vstack(grow)), np.array(awaited), tuple(stages))


def _spoiling_polygons(
    problem: Problem, drawn: SearchMap, label: frozenset[str], state: int
) -> list[FloatArray]:
    """Cells whose label leads from ``state`` to a worse one while ``label`` is awaited: they act as walls."""
    logic, atoms = problem.logic, set(problem.atoms)
    spoils = (~logic.covers[logic.delta[:, state, :-1], state]).any(axis=0)
    bad = {shown & atoms for shown, spoiling in zip(problem.labels, spoils, strict=True) if spoiling}
    spoilers = [cells for shown, cells in drawn.shown.items() if shown and shown in bad and shown != label]
    return [polygon for cells in spoilers for polygon in cells.around]


def _packed_walls(drawn: SearchMap, spoilers: Sequence[FloatArray]) -> Walls:
    """Obstacles and walls of the border, then ``spoilers``."""
    hard, soft = drawn.barriers, pack_faces(spoilers)
    faces = kd.Faces(
        np.concatenate([hard.ptr, hard.ptr[-1] + soft.ptr[1:]]), np.vstack([hard.normal, soft.normal]),
        np.concatenate([hard.offset, soft.offset]),
    )  # fmt: skip
    sides = np.zeros((len(hard.offset) - sum(map(len, drawn.obstacles)), 2))
    asks = np.repeat([1.0, 0.0], [len(hard.ptr) - 1, len(spoilers)])
    return Walls(faces, np.vstack([np.empty((0, 2)), *drawn.obstacles, sides, *spoilers]), asks)


def _anchors(drawn: SearchMap, label: frozenset[str], depth: float) -> FloatArray:
    """Points of the cells that show ``label``: corners and middles of edges, drawn towards the middle.

    Where polygons together make one shape, slivers along its rim are left out.
    """
    group = drawn.shown[label]
    room = [float(inside_depth(polygon, polygon.mean(axis=0)[None])[0]) for polygon in group.within]
    least = SLIVER * max(room) if group.united and depth > 0.0 else 0.0
    found = []
    for polygon in (one for one, own in zip(group.within, room, strict=True) if own >= least):
        middle = polygon.mean(axis=0)
        rim = np.vstack([polygon, (polygon + np.roll(polygon, -1, axis=0)) / 2])
        found.append(rim + max(depth, ANCHOR) * (middle - rim) if depth < 1 else middle[None])
    return np.vstack(found)


# --- places where a line may bend -------------------------------------------------------------------


def bend_places(polygons: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Corners (n, 2) and vectors v (n, 2) such that corner + r v clears both its faces by r.

    Corners whose two faces are parallel are left out: those with an angle of 180 degrees, and the ends of
    needles, whose v is longer than any map.
    """
    corners, pair, _ = _corner_faces(polygons)
    sharp = np.abs(np.linalg.det(pair)) > 1e-6
    out = np.linalg.solve(pair[sharp], np.ones((int(sharp.sum()), 2, 1)))[..., 0]
    return corners[sharp], out


def _corner_faces(polygons: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, IntArray]:
    """All corners (n, 2), normals before and after each (n, 2, 2), first corner of each polygon."""
    corners, faces = np.vstack([np.empty((0, 2)), *polygons]), pack_faces(polygons)
    before = np.arange(len(corners)) - 1
    before[faces.ptr[:-1]] = faces.ptr[1:] - 1
    return corners, np.stack([faces.normal[before], faces.normal], axis=1), faces.ptr[:-1]


def gap_places(
    polygons: Sequence[FloatArray], faces: kd.Faces, widest: float
) -> tuple[FloatArray, FloatArray]:
    """Bend points p + r v of taut lines in gaps narrower than the clearance r; returns p and v.

    With the distance r to keep, the gap between two obstacles is the intersection of half planes
    ``c' x ≥ d + r``, and a taut line bends where two of their rims cross: at p + r v for one pair of faces.
    Returned are the crossings beside both obstacles and clear of all, for some r up to ``widest`` [m].
    ``faces`` are first the faces of ``polygons``, then single half planes.
    """
    at, grow = [np.empty((0, 2))], [np.empty((0, 2))]
    distances = widest * np.array(SHARES)
    for beside in _face_pairs(faces.ptr, _near_pairs(polygons, len(faces.ptr) - 1, widest)):
        pair = np.stack([faces.normal[beside[0]], faces.normal[beside[1]]], axis=1)
        cross = np.abs(np.linalg.det(pair)) > 0.1
        k, m, first, second = (row[cross] for row in beside)
        pair = pair[cross]
        p = np.linalg.solve(pair, np.stack([faces.offset[k], faces.offset[m]], axis=1)[..., None])[..., 0]
        v = np.linalg.solve(pair, np.ones((len(pair), 2, 1)))[..., 0]
        clear = clear_crossings(faces, first, second, p, v, distances)
        at.append(p[clear])
        grow.append(v[clear])
    return np.vstack(at), np.vstack(grow)


def _near_pairs(polygons: Sequence[FloatArray], count: int, widest: float) -> IntArray:
    """Pairs (n, 2) of polygons close enough for a place beside both, and pairs of a polygon and a half plane.

    A place beside a polygon lies in the outline that has moved outwards by ``BESIDE`` * ``widest``; a pair is
    near if the boxes around these outlines meet.
    """
    import shapely

    pairs = [(i, j) for j in range(len(polygons), count) for i in range(j)]
    if polygons:
        at, pair, first = _corner_faces(polygons)
        # v = (a + b) / (1 + a' b) of bend_places, also at flat corners; at the end of a needle it is limited.
        grow = pair.sum(axis=1) / np.maximum(1.0 + pair.prod(axis=1).sum(axis=1), NEEDLE)[:, None]
        moved = at + BESIDE * widest * grow
        low, high = np.minimum.reduceat(moved, first), np.maximum.reduceat(moved, first)
        boxes = np.asarray(shapely.box(*low.T, *high.T))
        near = shapely.STRtree(boxes).query(boxes, predicate="intersects").T
        pairs += [(i, j) for i, j in near.tolist() if i < j]
    return np.array(sorted(pairs), np.int64).reshape(-1, 2)


def _face_pairs(ptr: IntArray, pairs: IntArray) -> Iterator[tuple[IntArray, IntArray, IntArray, IntArray]]:
    """Pairs of faces of near polygons, about ``PAIRS_AT_ONCE`` at once, and their polygons."""
    counts = np.diff(ptr)[pairs].prod(axis=1)
    chunk = np.cumsum(counts) // PAIRS_AT_ONCE
    for number in np.unique(chunk):
        rows = pairs[chunk == number]
        sizes = np.diff(ptr)[rows]
        total = sizes.prod(axis=1)
        owner = np.repeat(np.arange(len(rows)), total)
        inner = np.arange(len(owner)) - np.repeat(np.cumsum(total) - total, total)
        first, second = rows[owner].T
        k, m = ptr[first] + inner // sizes[owner, 1], ptr[second] + inner % sizes[owner, 1]
        yield k, m, first, second
