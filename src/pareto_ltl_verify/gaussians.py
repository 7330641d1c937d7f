"""Probabilities of a Gaussian position, and the bounds on mission failure and collision."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, owens_t

from pareto_ltl_verify.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl_verify.geometry import Convex

ROUNDING = 1e-13  # below this the computed probability of a polygon is only rounding error
ON_EDGE = 1e-6  # [m] a point this far outside an edge still counts as on it
DIRECTIONS, FINER = 1440, 41  # of the first sweep, and of the second about its best one
LEAST_VARIANCE = 0.1  # [m²] that the planner adds to every variance
CERTAIN = 40.0  # standard deviations that count as certainty
NEAR_LINE = 6.0  # standard deviations up to which the lines of a segment are faces of the bound R
BEHIND = 1e-3  # [m] by which a polygon may reach over a line and still be behind it
Masses = list[dict[frozenset[str], float]]  # for each step P(label)


def beyond(gap: FloatArray, sd: FloatArray) -> FloatArray:
    """P(N(0, sd²) > gap); 0 or 1 if sd = 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        chance = np.where(sd > 0, ndtr(-gap / sd), np.where(gap >= 0, 0.0, 1.0))
    return np.asarray(chance, float)


def spread_along(normals: FloatArray, cov: FloatArray) -> FloatArray:
    """√(n' Σ n) for every row of ``normals`` [m]."""
    variance = np.einsum("ij,jk,ik->i", normals, cov, normals)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), float)


def left_out(part: Convex, x: FloatArray, cov: FloatArray) -> float:
    """Σ_j P(beyond face j), which bounds P(x not in ``part``)."""
    return float(beyond(part.offsets - part.normals @ x, spread_along(part.normals, cov)).sum())


def in_polygon(part: Convex, x: FloatArray, cov: FloatArray) -> float:
    """P(N(x, cov) in ``part``): over the triangles from the whitened mean to each edge, by Owen's T."""
    bound = float(beyond(part.normals @ x - part.offsets, spread_along(part.normals, cov)).min())
    if cov[0, 0] <= 0 or cov[1, 1] <= 0:
        return float(part.depth(x[None])[0] >= -ON_EDGE)
    if bound <= ROUNDING:
        return bound
    root = np.linalg.cholesky(cov + 1e-12 * np.trace(cov) * np.eye(2))
    here = np.linalg.solve(root, (part.corners - x).T).T
    ahead = np.roll(here, -1, axis=0)
    total = 0.0
    for p, q in zip(here, ahead, strict=True):
        along = (q - p) / math.dist(p, q)
        h = p[0] * along[1] - p[1] * along[0]
        size = max(abs(h), 1e-300)
        ends = np.array([p @ along, q @ along]) / size
        wedge = np.arctan(ends) / (2 * math.pi) - owens_t(size, ends)
        total += math.copysign(float(wedge[1] - wedge[0]), h)
    return min(max(total, 0.0), 1.0)


# --- the mission ------------------------------------------------------------------------------


def theorem2(
    regions: Sequence[tuple[str, Sequence[Convex]]],
    x: FloatArray,
    cov: FloatArray,
    labels: Sequence[frozenset[str]],
) -> float:
    """f_o = Σ_i min over visits t of region i of Σ_j (1 - Φ((b_ij - a_ij' x̂_t) / σ_ij)), at most 1."""
    total = 0.0
    for name, parts in regions:
        visits = [t for t, label in enumerate(labels) if name in label]
        if visits:
            total += min(1.0, *(left_out(part, x[t], cov[t]) for t in visits for part in parts), 1.0)
    return min(total, 1.0)


def label_masses(cells: Sequence[tuple[Convex, frozenset[str]]], x: FloatArray, cov: FloatArray) -> Masses:
    """P(label of x_t) for every step; each of ``cells`` has a label, the first has a shared edge."""
    masses: Masses = []
    for mean, spread in zip(x, cov, strict=True):
        seen: dict[frozenset[str], float] = {}
        known = spread[0, 0] <= 0 or spread[1, 1] <= 0
        for part, label in cells:
            if known and seen:
                break
            if p := in_polygon(part, mean, spread):
                seen[label] = seen.get(label, 0.0) + p
        seen[frozenset()] = min(max(1.0 - sum(seen.values()), 0.0), 1.0)
        masses.append(seen)
    return masses


class Step(NamedTuple):
    """A step and the way to it, for labels s and states q.

    Attributes
    ----------
    mass : (s,) float
        P(label).
    after : (q, s) int
        State after each label.
    lost : (q, s) bool
        Whether a cell with the label between the steps loses the state.
    cost : (q,) float
        Bound on the probability that the way meets such a cell.
    """

    mass: FloatArray
    after: IntArray
    lost: BoolArray
    cost: FloatArray


def ordered(steps: Iterable[Step], covers: BoolArray, initial: int, accepting: Sequence[bool]) -> float:
    """V: a bound on the probability that the mission fails, by induction over steps and automaton states.

    V_t(p) = min(1, min_q [V_{t-1}(q) + P(reading the label in q does not reach p) + P(a cell between the
    steps loses q)]). A label that loses q is counted only in the second probability.
    """
    V = np.where(covers[initial], 0.0, 1.0)
    for step in steps:
        missed = ~covers[step.after] & ~step.lost[:, :, None]  # (q, s, p)
        V = np.minimum((V + step.cost + np.einsum("s,qsp->pq", step.mass, missed)).min(axis=1), 1.0)
    return float(V[np.array(accepting)].min(initial=1.0))


def crossing(part: Convex, x: FloatArray, cov: FloatArray) -> float:
    """P(segment between the positions meets ``part``) ≤ least over lines of Σ P(an end not beyond it).

    The lines are the lines of its faces, and two that touch it parallel to the segment of the means.
    ``x`` (2, 2) [m], or (1, 2) for a single place.
    """
    middle, along = part.corners.mean(axis=0), x[-1] - x[0]
    size = float(np.linalg.norm(part.corners - middle, axis=1).max())
    spread = max(float(np.trace(c)) for c in cov)
    far = size + float(np.linalg.norm(along)) / 2 + 8.0 * math.sqrt(spread)
    if len(x) > 1 and math.dist(middle, (x[0] + x[-1]) / 2) > far:
        return 0.0
    normals, offsets = part.normals, part.offsets
    if along.any():
        across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        normals = np.vstack([normals, across, -across])
        offsets = np.append(offsets, [(part.corners @ across).max(), -(part.corners @ across).min()])
    total = np.zeros(len(offsets))
    for mean, c in zip(x, cov, strict=True):
        total += beyond(normals @ mean - offsets, spread_along(normals, c))
    return min(1.0, float(total.min()))


# --- obstacles --------------------------------------------------------------------------------


def face_gaps(part: Convex, x: FloatArray, cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gap of every step to every face of an obstacle, positive outside, and its standard deviation.

    Both (T+1, n) [m].
    """
    gap = x @ part.normals.T - part.offsets
    return gap, np.array([spread_along(part.normals, spread) for spread in cov])


def path_bound(
    obstacles: Sequence[Convex], x: FloatArray, cov: FloatArray, grows: Sequence[BoolArray]
) -> float:
    """R = Σ over obstacles of the cheapest division of the path into runs of steps beyond one face.

    A run costs Σ_t p_t, or 2 Φ(-least gap / largest σ) if the deviation along the normal only grows:
    ``grows[j][k, r, t]`` is whether it does for face k of obstacle j and steps r < t.
    """
    total = 0.0
    for part, allowed in zip(obstacles, grows, strict=True):
        gap, sd = face_gaps(part, x, cov)
        total += min(1.0, _cheapest_runs(gap, sd, allowed))
    return min(total, 1.0)


def _cheapest_runs(gap: FloatArray, sd: FloatArray, grows: BoolArray) -> float:
    n = len(gap)
    risk, shrinks = np.where(sd > 0, beyond(gap, sd), 0.0), _last_that_shrinks(grows)
    cheapest = np.full(n, math.inf)
    for s in range(n):
        before = 0.0 if s == 0 else float(cheapest[s])
        if before < 1.0:
            cost = _run_costs(gap[s:], sd[s:], risk[s:], shrinks[s:] < s).min(axis=1, initial=math.inf)
            first = s if n == 1 else s + 1
            cheapest[first:] = np.minimum(cheapest[first:], before + cost[first - s :])
    return float(cheapest[-1])


def _last_that_shrinks(grows: BoolArray) -> IntArray:
    """For each step t and face, the last step r < t from which the deviation need not grow; -1 if none.

    All pairs of a run grow if this step lies before the run, so that no run looks at its pairs.
    """
    faces, n, _ = grows.shape
    shrinks = ~grows & np.triu(np.ones((n, n), bool), 1)
    last = n - 1 - np.argmax(shrinks[:, ::-1], axis=1)
    return np.where(shrinks.any(axis=1), last, -1).T.reshape(n, faces)


def _run_costs(gap: FloatArray, sd: FloatArray, risk: FloatArray, grows: BoolArray) -> FloatArray:
    """Cost of the runs from the first step to each step, beyond each face (n, faces); inf past its line."""
    union = np.cumsum(risk, axis=0)
    widest, least = np.maximum.accumulate(sd), np.minimum.accumulate(gap)
    free = np.logical_and.accumulate(grows) & (widest > 0)
    cost = union.copy()
    cost[free] = np.minimum(union[free], 2 * beyond(least[free], widest[free]))
    return np.where(np.logical_and.accumulate(gap >= -ON_EDGE), cost, math.inf)


def growing(part: Convex, cross: FloatArray, share: float) -> BoolArray:
    """(faces, r, t): n' Cov(e_t, e_r) n >= (1 - share) n' Var(e_r) n."""
    both = np.einsum("ki,trij,kj->krt", part.normals, cross, part.normals)
    own = np.einsum("krr->kr", both)
    found: BoolArray = both >= own[:, :, None] * (1 - share)
    return found


def step_margins(obstacles: Sequence[Convex], x: FloatArray, cov: FloatArray, z: float) -> FloatArray:
    """For each obstacle and step the best common face's gap - z σ at both ends (m, T) [m].

    Eqs. (9) and (10) hold if none is negative.
    """
    margins = np.empty((len(obstacles), max(len(x) - 1, 1)))
    for row, part in zip(margins, obstacles, strict=True):
        gap, sd = face_gaps(part, x, cov)
        room = gap - z * sd
        row[:] = (np.minimum(room[:-1], room[1:]) if len(room) > 1 else room).max(axis=1)
    return margins


def step_risk(obstacles: Sequence[Convex], x: FloatArray, cov: FloatArray) -> float:
    """Largest over steps of Σ_j min over faces common to a step of P(beyond); inf if no face is common."""
    total = np.zeros(max(len(x) - 1, 1))
    for part in obstacles:
        gap, sd = face_gaps(part, x, cov)
        risk = np.where(gap >= -ON_EDGE, beyond(gap, sd), math.inf)
        ends = np.where(np.isfinite(risk[:-1]), risk[1:], math.inf) if len(risk) > 1 else risk
        total += ends.min(axis=1)
    return float(total.max(initial=0.0))


# --- chance constraints of segments: a sweep of directions for the best supporting lines ---


def best_lines(part: Convex, x: FloatArray, cov: FloatArray) -> FloatArray:
    """For each segment of ``x`` (T+1, 2): z, the normal and the offset of the best line, (T, 4).

    ``cov`` (T+1, 2, 2) [m²]; z = min over the ends of (c'x - h) / √(c'Σc), h the largest c'v of the corners.
    """
    if not len(part.corners):  # a wall: the half plane beyond a side of the map
        normal, offset = part.normals[0], part.offsets[0]
        return np.column_stack([
            _deviations(normal[None], offset[None], x, cov)[:, 0],
            np.tile([*normal, offset], (len(x) - 1, 1)),
        ])  # fmt: skip
    angles = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
    normals = _units(angles)
    best = angles[_deviations(normals, (part.corners @ normals.T).max(axis=0), x, cov).argmax(axis=1)]
    return np.array([_refined(part, best[k], x[k : k + 2], cov[k : k + 2]) for k in range(len(best))])


def _refined(part: Convex, angle: float, x: FloatArray, cov: FloatArray) -> list[float]:
    """z, the normal and the offset of the best line of one segment, with a normal about ``angle``."""
    half, row = 4.0 * np.pi / DIRECTIONS, [0.0]
    for _ in range(3):
        angles = angle + np.linspace(-half, half, FINER)
        normals = _units(angles)
        reach = (part.corners @ normals.T).max(axis=0)
        z = _deviations(normals, reach, x, cov)[0]
        k = int(z.argmax())
        angle, half, row = float(angles[k]), 3.0 * half / FINER, [z[k], *normals[k], reach[k]]
    return row


def with_lines(part: Convex, x: FloatArray, cov: FloatArray) -> Convex:
    """``part`` with the best lines of its near segments as further half planes."""
    if not len(part.corners):  # a wall has only one line
        return part
    rows = best_lines(part, x, cov)
    rows = rows[(rows[:, 0] > 0.0) & (rows[:, 0] < NEAR_LINE)]
    return Convex(part.corners, np.vstack([part.normals, rows[:, 1:3]]), np.append(part.offsets, rows[:, 3]))


def _units(angles: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _deviations(normals: FloatArray, offsets: FloatArray, x: FloatArray, cov: FloatArray) -> FloatArray:
    """z of each segment and direction, (T, D)."""
    variance = np.einsum("di,tij,dj->td", normals, cov, normals)
    z = (x @ normals.T - offsets) / np.sqrt(np.maximum(variance, 0.0) + LEAST_VARIANCE)
    return np.asarray(np.minimum(np.minimum(z[:-1], z[1:]), CERTAIN), float)


def segment_risks(parts: Sequence[Convex], x: FloatArray, cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """z of each segment and part (T, m), and Σ_lines Q(z) of each segment (T,).

    A part behind the line of a closer one adds nothing.
    """
    lines = np.stack([best_lines(part, x, cov) for part in parts], axis=1)
    ends = [part.corners if len(part.corners) else _wall_ends(part, parts) for part in parts]
    risks = np.zeros(len(lines))
    for t, rows in enumerate(lines):
        left = list(np.argsort(rows[:, 0], kind="stable"))
        while left:
            z, normal, offset = rows[left[0], 0], rows[left[0], 1:3], rows[left[0], 3]
            risks[t] += ndtr(-z)
            left = [k for k in left[1:] if not _behind(parts[k], ends[k], normal, offset)]
    return lines[:, :, 0], risks


def _behind(part: Convex, ends: FloatArray, normal: FloatArray, offset: float) -> bool:
    """Whether a polygon reaches no farther along ``normal`` than ``offset`` [m].

    A wall has no end outwards, and begins at the border of the map between its ``ends`` (n, 2) [m].
    """
    if not len(ends) or (not len(part.corners) and part.normals[0] @ normal < 0.0):
        return False
    return bool((ends @ normal).max() <= offset + BEHIND)


def _wall_ends(wall: Convex, parts: Sequence[Convex]) -> FloatArray:
    """The corners of the map (n, 2) [m] at which ``wall`` meets the walls across it."""
    meet = [
        np.linalg.solve(np.vstack([wall.normals, part.normals]), np.append(wall.offsets, part.offsets))
        for part in parts
        if not len(part.corners) and abs(part.normals[0] @ wall.normals[0]) < 0.5
    ]
    return np.array(meet).reshape(-1, 2)
