"""Pull and walk: taut lines through the map, flown in the fewest steps."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.planning.pack import pack_faces
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.planning.reference import wind_at_place
from pareto_ltl.planning.refine.obligations import face_deviations
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.world.cells import half_planes

FACE_MARGIN = 2.0  # [m] kept from every face: larger than the solver's rounding error
CAP = 0.999  # share of u_max planned with: the wind is not quite linear over a trust region
BESIDE = 1.3  # a gate lies within this many margins of both its obstacles
TOUCH = 1e-3  # [m] a place this much too near still lies on the margin
ANCHOR = 0.02  # how far from a region's rim towards its middle a line may touch it


def walk_line(problem: Problem, line: FloatArray) -> FloatArray | None:
    """Means (T+1, 2) along ``line`` (n, 2) through all its corners, in steps as long as the wind allows.

    None where the wind is too strong, or known no longer.
    """
    motion = problem.motion
    x, last = [line[0]], problem.horizon
    for corner in line[1:]:
        while np.linalg.norm(corner - x[-1]) > FACE_MARGIN:
            if len(x) > last:
                return None
            s = _longest_share(motion, x[-1], corner, wind_at_place(problem.wind, len(x) - 1, x[-1]))
            if s <= 1e-3:
                return None
            x.append(corner if s >= 1.0 else x[-1] + s * (corner - x[-1]))
        x[-1] = corner
    return np.array(x)


def _longest_share(motion: kd.Motion, x: FloatArray, goal: FloatArray, wind: FloatArray) -> float:
    """Largest s ≤ 1 such that one step reaches x + s (goal - x): ‖c + s g‖ ≤ u_max is a quadratic."""
    c = motion.b_inv @ (x - motion.a @ x - motion.dt * wind) / motion.dt
    g = motion.b_inv @ (goal - x) / motion.dt
    aa, bb, cc = float(g @ g), float(g @ c), float(c @ c) - (CAP * motion.u_max) ** 2
    disc = bb * bb - aa * cc
    return 0.0 if disc < 0.0 else min(1.0, (math.sqrt(disc) - bb) / aa)


def _bend_places(polygons: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Where a taut line may bend: corners, and vectors v such that corner + r v clears both faces by r."""
    at, out = [np.empty((0, 2))], [np.empty((0, 2))]
    for polygon in polygons:
        normal = half_planes(polygon)[0]
        pair = np.stack([np.roll(normal, 1, axis=0), normal], axis=1)
        sharp = np.abs(np.linalg.det(pair)) > 1e-6
        at.append(polygon[sharp])
        out.append(np.linalg.solve(pair[sharp], np.ones((int(sharp.sum()), 2, 1)))[..., 0])
    return np.vstack(at), np.vstack(out)


def _gates(faces: kd.Faces, widest: float) -> tuple[FloatArray, FloatArray]:
    """Where a taut line may bend in a gap too narrow for the corners themselves.

    With the distance r to keep, the gap between two obstacles is the meeting of half planes ``c' x ≥ d + r``,
    and a taut line bends where two of their rims cross: at p + r v for one pair of faces. Kept are the
    crossings beside both obstacles and clear of all, for some r up to ``widest``.
    """
    owner = np.repeat(np.arange(len(faces.ptr) - 1), np.diff(faces.ptr))
    k, m = np.nonzero(owner[:, None] < owner)
    pair = np.stack([faces.normal[k], faces.normal[m]], axis=1)
    cross = np.abs(np.linalg.det(pair)) > 0.1
    k, m, pair = k[cross], m[cross], pair[cross]
    at = np.linalg.solve(pair, np.stack([faces.offset[k], faces.offset[m]], axis=1)[..., None])[..., 0]
    grow = np.linalg.solve(pair, np.ones((len(pair), 2, 1)))[..., 0]
    kept = np.zeros(len(at), bool)
    for r in (0.4 * widest, 0.7 * widest, widest):
        gap = (at + r * grow) @ faces.normal.T - faces.offset
        depth = np.maximum.reduceat(gap, faces.ptr[:-1], axis=1) if len(at) else np.empty((0, 1))
        rows = np.arange(len(at))
        beside = (depth[rows, owner[k]] <= BESIDE * r) & (depth[rows, owner[m]] <= BESIDE * r)
        kept |= beside & (depth >= r - TOUCH).all(axis=1)
    return at[kept], grow[kept]


class Spread(Protocol):
    """Places (T+1, 2) [m] that a line may bend at, and the covariance (T+1, 2, 2) [m²] at each step."""

    @property
    def x(self) -> FloatArray: ...

    @property
    def cov(self) -> FloatArray: ...


@dataclass(frozen=True, slots=True)
class MissionOrder:
    """A mission order: the label read at each transition, and the automaton state before it."""

    labels: tuple[frozenset[str], ...]
    states: tuple[int, ...]


def mission_order(problem: Problem, path: PlannedPath) -> MissionOrder | None:
    """The order in which ``path`` visits; None where a transition needs no region at all."""
    before = np.concatenate([[problem.world.logic.initial], path.q[:-1]])
    turns = np.flatnonzero(path.q != before)
    labels = tuple(path.label[t] & set(problem.atoms) for t in turns)
    return MissionOrder(labels, tuple(int(before[t]) for t in turns)) if all(labels) else None


def possible_orders(problem: Problem, most: int) -> list[MissionOrder]:
    """Orders that the automaton allows, every transition one nearer to acceptance; ``most`` at most.

    Trees find the order that suited their samples; another one may be better once smoothed.
    """
    logic, atoms = problem.world.logic, set(problem.atoms)
    shown = sorted(
        {(tuple(sorted(label & atoms)), c) for c, label in enumerate(problem.labels) if label & atoms}
    )
    column = dict(reversed([(frozenset(names), c) for names, c in shown]))
    found: list[MissionOrder] = []
    start = int(logic.delta[logic.initial, problem.locate(problem.scene.start[None])[0]])
    queue: list[tuple[tuple[frozenset[str], ...], tuple[int, ...], int]] = [((), (), start)]
    while queue and len(found) < most:
        labels, states, q = queue.pop(0)
        if logic.distance[q] == 0.0:
            if labels:
                found.append(MissionOrder(labels, states))
            continue
        for label, c in column.items():
            then = int(logic.delta[q, c])
            if logic.distance[then] < logic.distance[q]:
                queue.append(((*labels, label), (*states, q), then))
    return found


@dataclass(frozen=True, slots=True)
class _Stage:
    """Places to be at while one transition is awaited, and the walls in between.

    Place k lies at ``at[k] + r grow[k]`` where r is the distance to keep on arrival, and has ``room[k] +
    r more[k]`` to spare at each face; ``margin`` says which faces ask for r (those of obstacles).
    """

    at: FloatArray
    grow: FloatArray
    faces: kd.Faces
    margin: FloatArray
    room: FloatArray
    more: FloatArray
    first_goal: int


def _await_label(
    problem: Problem, at: FloatArray, grow: FloatArray, label: frozenset[str], state: int, depth: float
) -> _Stage:
    """Goals show ``label``; cells whose label spoils waiting in ``state`` are walls as obstacles are."""
    logic, polygons = problem.world.logic, problem.decomposition.cells
    spoils = ~logic.covers[logic.delta[state, :-1], state]
    walls = [
        cell for cell, shown, bad in zip(polygons, problem.labels, spoils, strict=True)
        if bad and shown and shown & set(problem.atoms) != label
    ]  # fmt: skip
    goals = _anchors(problem, label, depth)
    bends, out = _bend_places(walls)
    places = np.vstack([at, bends + FACE_MARGIN * out, goals])
    growth = np.vstack([grow, np.zeros((len(places) - len(grow), 2))])
    hard, soft = problem.barriers, pack_faces(walls)
    faces = kd.Faces(
        np.concatenate([hard.ptr, hard.ptr[-1] + soft.ptr[1:]]), np.vstack([hard.normal, soft.normal]),
        np.concatenate([hard.offset, soft.offset]),
    )  # fmt: skip
    margin = np.concatenate([np.ones(len(hard.offset)), np.zeros(len(soft.offset))])
    room, more = places @ faces.normal.T - faces.offset, growth @ faces.normal.T - margin
    return _Stage(places, growth, faces, margin, room, more, len(places) - len(goals))


def taut_line(
    problem: Problem, plan: MissionOrder, path: Spread, depth: float, z: float
) -> FloatArray | None:
    """The shortest line (n, 2) that visits in the given order and keeps z σ from every obstacle.

    Dijkstra over (transitions done, place) in a visibility graph of the vertices of ``path``, corners of
    obstacles that grow with the time of arrival (σ of the path at that step), and points of the regions.
    Two places see each other if one face of every obstacle is cleared at both (Section 4.5). ``depth`` in
    [0, 1] says how deep into a region a visit goes: 0 the rim, 1 the middle.
    """
    low, high = problem.scene.bounds + np.array([[FACE_MARGIN], [-FACE_MARGIN]])
    sd = np.sqrt(np.maximum(np.linalg.eigvalsh(path.cov)[:, -1], 0.0))
    at, grow = _bend_places(problem.decomposition.obstacles)
    gates, wider = _gates(problem.barriers, z * float(sd.max()))
    at, grow = np.vstack([at, gates, path.x]), np.vstack([grow, wider, np.zeros_like(path.x)])
    stages = [
        _await_label(problem, at, grow, label, state, depth)
        for label, state in zip(plan.labels, plan.states, strict=True)
    ]

    def keep(metres: FloatArray) -> FloatArray:
        step = np.minimum(metres / problem.reach, len(sd) - 1.0)
        return np.asarray(z * np.interp(step, np.arange(len(sd)), sd) + FACE_MARGIN, float)

    best: dict[tuple[int, int], float] = {(0, -1): 0.0}
    came: dict[tuple[int, int], tuple[int, int]] = {}
    where: dict[tuple[int, int], FloatArray] = {(0, -1): problem.scene.start}
    queue: list[tuple[float, tuple[int, int]]] = [(0.0, (0, -1))]
    while queue:
        length, here = heapq.heappop(queue)
        if length > best[here]:
            continue
        if here[0] == len(stages):
            return _trace(came, where, here)
        x, stage = where[here], stages[here[0]]
        ends = stage.at + stage.grow * keep(length + np.linalg.norm(stage.at - x, axis=1))[:, None]
        total = length + np.linalg.norm(ends - x, axis=1)
        own = (
            x @ stage.faces.normal.T - stage.faces.offset - keep(np.array([length])) * stage.margin >= -TOUCH
        )
        seen = _share_face(stage.faces, (stage.room + keep(total)[:, None] * stage.more >= -TOUCH) & own)
        seen &= np.all((ends >= low) & (ends <= high), axis=1)
        for k in np.flatnonzero(seen):
            there = (here[0] + int(k >= stage.first_goal), int(k))
            if total[k] < best.get(there, math.inf):
                best[there], came[there], where[there] = float(total[k]), here, ends[k]
                heapq.heappush(queue, (float(total[k]), there))
    return None


def _trace(
    came: dict[tuple[int, int], tuple[int, int]],
    where: dict[tuple[int, int], FloatArray],
    here: tuple[int, int],
) -> FloatArray:
    line = [where[here]]
    while here in came:
        here = came[here]
        line.append(where[here])
    return np.array(line[::-1])


def _anchors(problem: Problem, label: frozenset[str], depth: float) -> FloatArray:
    """Points of the cells that show ``label``: corners and middles of edges, drawn towards the middle."""
    found = []
    for cell, shown in zip(problem.decomposition.cells, problem.labels, strict=True):
        if shown & set(problem.atoms) == label:
            middle = cell.mean(axis=0)
            rim = np.vstack([cell, (cell + np.roll(cell, -1, axis=0)) / 2])
            found.append(rim + max(depth, ANCHOR) * (middle - rim) if depth < 1 else middle[None])
    return np.vstack(found)


def _share_face(faces: kd.Faces, clear: BoolArray) -> BoolArray:
    """Which rows of ``clear`` (P, F) have a face of every obstacle."""
    if len(faces.ptr) == 1:
        return np.ones(len(clear), bool)
    return np.asarray(np.logical_or.reduceat(clear, faces.ptr[:-1], axis=1).all(axis=1), bool)


def pull_taut(problem: Problem, x: FloatArray, cov: FloatArray, keep: Sequence[int], z: float) -> FloatArray:
    """The shortest line through vertices of ``x`` (T+1, 2) from the first to the last past those in ``keep``.

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
