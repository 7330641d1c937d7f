"""The margin of a flight in plain NumPy, claim by claim: the readable form of ``plane_logic.margin``.

W_t(p) is the margin [m] of the claim "after step t the state is at least as good as p". Before the first
letter it is +∞ for q₀ and -∞ for every other claim; then, with S_t the segment to x_t,

    W_t(p) = max_q min(W'_t(q), margin of {s : δ(q, s) ≥ p} at x_t),
    W'_t(q) = min(W_{t-1}(q), distance of S_t from every hazard that loses q),

without the hazards where S_t begins or ends, which are read as letters of steps. The state of the flight
itself is known, so its W' is also at least the smaller of W_{t-1} of the state before and, over the hazards
harmful in it, the distance by which S_t misses the hazard or the depth to which it meets it. The mission
margin is the largest W_T(p) of an accepting p.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from oracle.segments import state_on_the_way
from pareto_ltl.planning.pack_logic import Reading
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.cells import half_planes, inside_depth


def flight_margin(problem: Problem, x: FloatArray) -> float:
    """How far the flight ``x`` (T+1, 2) is from failing [m]; negative if it fails."""
    return min(mission_margin(problem, x), path_clearance(problem, x))


# --- distances --------------------------------------------------------------------------------


def segment_distance(polygon: FloatArray, start: FloatArray, end: FloatArray) -> float:
    """Distance of a segment from a convex polygon [m]; negative, minus the depth of overlap, where they meet.

    Two disjoint convex sets are separated along a face of one of them; the faces of a segment are its two
    sides.
    """
    normals = half_planes(polygon)[0]
    (east, north), length = end - start, float(np.linalg.norm(end - start))
    if length > 0.0:
        across = np.array([-north, east]) / length
        normals = np.vstack([normals, across, -across])
    ends = np.vstack([start, end])
    gap = float(((ends @ normals.T).min(axis=0) - (polygon @ normals.T).max(axis=0)).max())
    if gap <= 0.0:
        return gap
    edges = zip(polygon, np.roll(polygon, -1, axis=0), strict=True)
    to_edges = [_distance(point, p, q) for p, q in edges for point in ends]
    return min(to_edges + [_distance(corner, start, end) for corner in polygon])


def _distance(point: FloatArray, p: FloatArray, q: FloatArray) -> float:
    """Distance of a point from the segment p q."""
    size = float((q - p) @ (q - p))
    share = np.clip((point - p) @ (q - p) / size, 0.0, 1.0) if size > 0.0 else 0.0
    return float(np.linalg.norm(point - p - share * (q - p)))


def path_clearance(problem: Problem, x: FloatArray) -> float:
    """Least distance [m] of the segments of ``x`` (T+1, 2) from obstacles and from a walled border."""
    clear = [
        segment_distance(obstacle, start, end)
        for obstacle in problem.decomposition.obstacles
        for start, end in pairwise(x)
    ]
    if problem.scene.walled:
        west_south, east_north = problem.scene.bounds
        clear.append(float(np.minimum(x - west_south, east_north - x).min()))
    return min(clear, default=np.inf)


# --- the mission ------------------------------------------------------------------------------


def mission_margin(problem: Problem, x: FloatArray) -> float:
    """Largest W_T(p) of an accepting p.

    Eq. (M53) of docs/mathematics_methods.md.
    """
    logic, cell = problem.logic, problem.locate(x)
    depth = np.array([inside_depth(polygon, x) for polygon in problem.decomposition.cells]).T
    state = int(logic.initial)
    W = np.full(len(logic.distance), -np.inf)
    W[state] = np.inf
    for t in range(len(x)):
        if t > 0:
            ends = x[t - 1 : t + 1], (int(cell[t - 1]), int(cell[t]))
            W, state = _after_the_way(problem, t, *ends, W, state)
        W = _after_the_letter(problem.reading(t), depth[t], W)
        state = int(problem.reading(t).delta[state, cell[t]])
    return float(W[logic.distance == 0.0].max(initial=-np.inf))


def _after_the_letter(logic: Reading, depth: FloatArray, W: FloatArray) -> FloatArray:
    """W_t from W'_t; ``depth`` (C,) of the position in each cell."""
    after = np.full(len(W), -np.inf)
    for q in range(len(W)):
        for p in range(len(W)):
            good = logic.covers[logic.delta[q], p]  # (C + 1,), the last one for no label
            if good[-1]:
                margin = -depth[~good[:-1]].max(initial=-np.inf)
            else:
                margin = depth[good[:-1]].max(initial=-np.inf)
            after[p] = max(after[p], min(W[q], margin))
    return after


def _after_the_way(
    problem: Problem, t: int, ends: FloatArray, cells: tuple[int, int], W: FloatArray, state: int
) -> tuple[FloatArray, int]:
    """W'_t and the state of the flight before the letter of x_t is read."""
    logic = problem.reading(t)
    after, own = W.copy(), W[state]
    read = problem.reading(t - 1).delta[state, cells[0]] == state
    for hazard in logic.hazards.cell:
        if hazard in cells:
            continue
        distance = segment_distance(problem.decomposition.cells[hazard], *ends)
        loses = logic.loses[:, hazard]
        after[loses] = np.minimum(after[loses], distance)
        if read and logic.harm[state, hazard]:
            own = min(own, abs(distance))
    state = state_on_the_way(problem, state, ends, cells, t)
    after[state] = max(after[state], own)
    return after, state
