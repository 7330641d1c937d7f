"""Taut lines through the map, and flights along them in the fewest steps."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.kernels.visibility import TOUCH, Distances, Places, arrivals, seen_places
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.routes.course import FACE_MARGIN, Course, bend_places, gap_places, mission_course
from pareto_ltl.planning.routes.obligations import MissionOrder, face_deviations
from pareto_ltl.planning.routes.search_map import search_map
from pareto_ltl.planning.wind_lookup import interpolate
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

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


def longest_share(motion: kd.Motion, x: FloatArray, goal: FloatArray, wind: FloatArray) -> float:
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
