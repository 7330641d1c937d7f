"""Lines of every class from a roadmap: all mission orders, all ways past the obstacles, without any tree.

Nodes are the start, the corners of obstacles moved outwards, and points of the regions; two nodes are joined
if they see each other. A best-first search over (automaton state, node) lengthens lines by one edge at a time
and keeps the class of each line: its mission order and, leg by leg, the reduced word of the rays that it
crosses (Bhattacharya, Likhachev and Kumar, Autonomous Robots 33, 2012, doi:10.1007/s10514-012-9304-1). The
bound is the exact shortest way left in the same graph, so that classes come in the order of their lengths.

The lines depend on the map and the mission alone: every seed starts from the same ones.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pareto_ltl.planning.pack_logic import helpful_delta
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.routes.path_classes import Word, crossed_rays, reduced_word
from pareto_ltl.planning.routes.search_map import blocked_area, meets, search_map, sights
from pareto_ltl.planning.routes.taut_lines import FACE_MARGIN, bend_places
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import shapely

CLEARANCES = (0.03, 0.01, 0.003)  # of the map's size: distances of a node from its corner, the first free one
DEPTH = 0.4  # share of the way from a region's corner to its middle at which a node lies
STRETCH = 1.7  # lines longer than this many times the shortest one, or one without a landmark, are left out
LED = 12  # lines that are led through landmarks, the shortest
PLACES = 2  # legs of a line in which a landmark is tried: the legs with the least detours
PER_NODE = 12  # classes of one leg that are lengthened at one node
MOST_NODES = 400  # the nodes of the least detour are kept
MAX_EDGES = 2_000_000  # of the product with the automaton; a larger one is not searched
MAX_STEPS = 20_000  # lines that are lengthened


class _Class(NamedTuple):
    """Automaton states entered, and the words of all legs, the last of which is not complete."""

    order: tuple[int, ...]
    words: tuple[Word, ...]


class _Line(NamedTuple):
    """A line to ``node``, in automaton state ``state``; ``before`` is the line without its last edge."""

    kind: _Class
    state: int
    node: int
    before: _Line | None

    def nodes(self) -> list[int]:
        line, found = self, [self.node]
        while line.before is not None:
            line = line.before
            found.append(line.node)
        return found[::-1]


@dataclass(frozen=True, slots=True)
class Roadmap:
    """A graph of lines of sight.

    Attributes
    ----------
    at : (N, 2) float
        Nodes [m]; the first is the start.
    edge : (E, 2) int
        Pairs of nodes that see each other, in both directions, in the order of the first node.
    length : (E,) float
        Length of each edge [m].
    first : (N+1,) int
        The first edge of each node, and the number of edges.
    """

    problem: Problem
    at: FloatArray
    edge: IntArray
    length: FloatArray
    first: IntArray
    _words: dict[int, dict[int, Word]] = field(default_factory=dict)

    def words(self, node: int) -> dict[int, Word]:
        """The rays that the edges of ``node`` cross, by the number of the edge counted from its first one."""
        if node not in self._words:
            ends = self.at[self.edge[self.first[node] : self.first[node + 1], 1]]
            begins = np.broadcast_to(self.at[node], ends.shape)
            self._words[node] = crossed_rays(self.problem.decomposition.obstacles, begins, ends)
        return self._words[node]


def roadmap_lines(problem: Problem, limit: int) -> list[FloatArray]:
    """Lines (n, 2) [m] of up to ``limit`` classes, shortest first; none where the search would be too large.

    The lines keep no distance from obstacles that depends on the wind: they are starts of a refinement.
    """
    roadmap = sight_graph(problem)
    ways = _Ways.of(roadmap)
    return [] if ways is None else [roadmap.at[line.nodes()] for line in ways.lines(limit)]


# --- through landmarks ------------------------------------------------------------------------


def led_lines(problem: Problem, lines: Sequence[FloatArray]) -> list[FloatArray]:
    """Each of the first ``lines`` (n, 2) [m] led through one landmark more, and those through another one.

    A line enters a landmark at its middle, in the legs where this is the least detour, and only where neither
    part of the leg meets an obstacle. Whether it still completes the mission is not checked.
    """
    if not len(problem.landmarks):
        return []
    blocked = blocked_area(problem)
    once = [led for line in lines[:LED] for led in _led(problem, blocked, line)]
    twice = [led for line in once[:LED] for led in _led(problem, blocked, line)]
    return [*once, *twice]


def _led(problem: Problem, blocked: shapely.Geometry, line: FloatArray) -> Iterator[FloatArray]:
    """``line`` through each landmark, in legs that do not cross it."""
    crossed = sights(problem, line)
    legs = np.linalg.norm(np.diff(line, axis=0), axis=1)
    for k, corners in enumerate(problem.landmarks):
        middle = corners.mean(axis=0)
        arms = np.linalg.norm(line - middle, axis=1)
        detour = arms[:-1] + arms[1:] - legs
        met = meets(blocked, line, np.broadcast_to(middle, line.shape))
        able = (legs.sum() + detour <= STRETCH * legs.sum()) & ~met[:-1] & ~met[1:] & ~crossed[:, k]
        for j in [j for j in np.argsort(detour, kind="stable").tolist() if able[j]][:PLACES]:
            yield np.insert(line, j + 1, middle, axis=0)


# --- the graph --------------------------------------------------------------------------------


def sight_graph(problem: Problem) -> Roadmap:
    """The nodes of the map of ``problem``, and which of them see each other."""
    blocked = blocked_area(problem)
    at = _nodes(problem, blocked)
    i, j = np.triu_indices(len(at), 1)
    clear = ~meets(blocked, at[i], at[j])
    edge = np.stack([i[clear], j[clear]], axis=1)
    edge = np.concatenate([edge, edge[:, ::-1]])
    edge = edge[np.lexsort((edge[:, 1], edge[:, 0]))]
    length = np.linalg.norm(at[edge[:, 1]] - at[edge[:, 0]], axis=1)
    first = np.searchsorted(edge[:, 0], np.arange(len(at) + 1))
    return Roadmap(problem, at, edge, length, first)


def _nodes(problem: Problem, blocked: shapely.Geometry) -> FloatArray:
    """The start, free places beside the corners of obstacles, and points of the regions of the mission."""
    drawn, scene = search_map(problem), problem.scene
    goals = np.vstack([_places_inside(part) for cells in drawn.shown.values() for part in cells.within])
    corners, out = bend_places(drawn.obstacles)
    size = float(np.ptp(scene.bounds, axis=0).mean())
    beside, left = np.empty((0, 2)), np.ones(len(corners), bool)
    for share in CLEARANCES:
        moved = corners[left] + share * size * out[left]
        free = _free(problem, blocked, moved)
        beside = np.vstack([beside, moved[free]])
        left[np.flatnonzero(left)[free]] = False
    goals = goals[_free(problem, blocked, goals)]
    beside = beside[np.argsort(_detours(scene.start, goals, beside), kind="stable")]
    return np.vstack([scene.start, goals, beside[: max(MOST_NODES - len(goals), 0)]])


def _places_inside(part: FloatArray) -> FloatArray:
    middle = part.mean(axis=0)
    return np.vstack([middle, part + DEPTH * (middle - part)])


def _free(problem: Problem, blocked: shapely.Geometry, points: FloatArray) -> BoolArray:
    """Which points (P, 2) lie on the map, outside obstacles."""
    import shapely

    low, high = problem.scene.bounds + np.array([[FACE_MARGIN], [-FACE_MARGIN]])
    inside = ((points >= low) & (points <= high)).all(axis=1)
    return np.asarray(inside & ~shapely.intersects_xy(blocked, points[:, 0], points[:, 1]), bool)


def _detours(start: FloatArray, goals: FloatArray, points: FloatArray) -> FloatArray:
    """The least detour (P,) [m] of a flight over each point between two of the start and the goals."""
    ends = np.vstack([start, goals])
    if len(points) <= MOST_NODES or len(ends) < 2:
        return np.arange(len(points), dtype=float)
    i, j = np.triu_indices(len(ends), 1)
    direct = np.linalg.norm(ends[i] - ends[j], axis=1)
    far = np.linalg.norm(points[:, None] - ends, axis=2)
    return np.asarray((far[:, i] + far[:, j] - direct).min(axis=1), float)


# --- the search -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Ways:
    """The product of a roadmap and the automaton, in its reachable states.

    ``delta`` (Q, N): the state after reading at a node, -1 where that may not be read; ``open`` (Q, E): edges
    that may be flown in a state; ``to_go`` (Q, N): shortest way to acceptance [m].
    """

    roadmap: Roadmap
    delta: IntArray
    open: BoolArray
    to_go: FloatArray

    @classmethod
    def of(cls, roadmap: Roadmap) -> _Ways | None:
        """The product; None if it has too many edges."""
        logic = roadmap.problem.logic
        if len(logic.distance) * len(roadmap.edge) > MAX_EDGES:
            return None
        cells = roadmap.problem.locate(roadmap.at)
        delta = helpful_delta(logic)[:, cells]
        delta = np.where(np.isfinite(logic.distance[delta]), delta, -1)
        delta[:, cells < 0] = -1
        allowed = _open_edges(roadmap)
        return cls(roadmap, delta, allowed, _ways_left(roadmap, delta, allowed))

    def lines(self, largest: int) -> Iterator[_Line]:
        """Accepted lines of different classes, shortest first."""
        logic, ticks, lengthened = self.roadmap.problem.logic, count(), Counter[tuple[int, int, int]]()
        state = int(self.delta[logic.initial, 0])
        if state < 0 or not np.isfinite(self.to_go[state, 0]):
            return
        limit, seen, found = STRETCH * self.to_go[state, 0], set[tuple[int, _Class]](), 0
        queue = [(self.to_go[state, 0], next(ticks), 0.0, _Line(_Class((state,), ((),)), state, 0, None))]
        for _ in range(MAX_STEPS):
            if not queue or found == largest:
                return
            _, _, length, line = heapq.heappop(queue)
            place = line.state, line.node, len(line.kind.order)
            accepted = logic.distance[line.state] == 0.0
            known = -1 if accepted else line.node, line.kind
            if known in seen or (lengthened[place] >= PER_NODE and not accepted):
                continue
            seen.add(known)
            lengthened[place] += 1
            if accepted:
                found += 1
                yield line
                continue
            for bound, further, longer in self._lengthened(line, length, limit):
                heapq.heappush(queue, (bound, next(ticks), further, longer))

    def _lengthened(self, line: _Line, length: float, limit: float) -> Iterator[tuple[float, float, _Line]]:
        """``line`` with one more edge: a bound on its whole length, its length so far [m], and it.

        Lines whose bound is above ``limit`` [m] are left out.
        """
        roadmap, state, (order, words) = self.roadmap, line.state, line.kind
        first, last = roadmap.first[line.node : line.node + 2].tolist()
        crossed = roadmap.words(line.node)
        for k in (np.flatnonzero(self.open[state, first:last])).tolist():
            node = int(roadmap.edge[first + k, 1])
            after = int(self.delta[state, node])
            further = length + float(roadmap.length[first + k])
            if after < 0 or (bound := further + float(self.to_go[after, node])) > limit:
                continue
            word = reduced_word(words[-1], crossed.get(k, ()))
            if len(word) > len(set(word)):  # its ray crossed twice in one direction: it is circled
                continue
            kind = _Class(order, (*words[:-1], word))
            if after != state:
                kind = _Class((*order, after), (*kind.words, ()))
            yield bound, further, _Line(kind, after, node, line)


def _open_edges(roadmap: Roadmap) -> BoolArray:
    """Edges (Q, E) whose letters lead to no worse state, and to a better one only at their end.

    A flight reads a region that it crosses, so a line that enters one where a visit helps must end there.
    """
    problem, logic = roadmap.problem, roadmap.problem.logic
    states = np.flatnonzero(np.isfinite(logic.distance))
    helps = logic.distance[helpful_delta(logic)][states, :-1] < logic.distance[states, None]
    spoils = (~logic.covers[logic.delta[:, states, :-1], states[:, None]]).any(axis=0) & ~helps
    inside = problem.locate(roadmap.at)[roadmap.edge[:, 1]]
    allowed = np.zeros((len(logic.distance), len(roadmap.edge)), bool)
    met: dict[bytes, BoolArray] = {}
    for q, helping, spoiling in zip(states, helps, spoils, strict=True):
        for cells in (helping, spoiling):
            if cells.tobytes() not in met:
                met[cells.tobytes()] = _meet_cells(roadmap, cells)
        allowed[q] = ~met[spoiling.tobytes()] & (~met[helping.tobytes()] | helping[inside])
    return allowed


def _meet_cells(roadmap: Roadmap, cells: BoolArray) -> BoolArray:
    """Which edges (E,) meet one of ``cells`` (C,)."""
    import shapely

    polygons = [shapely.Polygon(roadmap.problem.decomposition.cells[c]) for c in np.flatnonzero(cells)]
    begin, end = roadmap.at[roadmap.edge[:, 0]], roadmap.at[roadmap.edge[:, 1]]
    return meets(shapely.union_all(polygons), begin, end)


def _ways_left(roadmap: Roadmap, delta: IntArray, allowed: BoolArray) -> FloatArray:
    """Shortest way [m] from every state and node to acceptance, (Q, N); inf if there is none.

    Searched from acceptance backwards: edges lead from each (state, node), row state * N + node, to the ones
    from which it is reached.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    state, k = np.nonzero(allowed)
    nodes, there = len(roadmap.at), roadmap.edge[k, 1]
    after = delta[state, there]
    can = after >= 0
    rows, columns = after[can] * nodes + there[can], state[can] * nodes + roadmap.edge[k[can], 0]
    size = len(delta) * nodes
    # The edges are in the order of the nodes: equal lengths are never added up.
    backwards = csr_matrix((roadmap.length[k[can]], (rows, columns)), shape=(size, size))
    goals = np.flatnonzero(np.repeat(roadmap.problem.logic.distance == 0.0, nodes))
    found = dijkstra(backwards, indices=goals, min_only=True)
    return np.asarray(found, float).reshape(len(delta), nodes)
