"""Probabilities of a Gaussian position, and the bounds on mission failure and collision."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, owens_t

from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl_verify.geometry import Convex

ROUNDING = 1e-13  # below this the computed probability of a polygon is only rounding error
ON_EDGE = 1e-6  # [m] a point this far outside an edge still counts as on it
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


def ordered(
    masses: Masses, read: Sequence[Sequence[Mapping[frozenset[str], int]]], covers: Sequence[Sequence[bool]],
    initial: int, accepting: Sequence[bool], way: Way,
) -> float:  # fmt: skip
    """V: a bound on the probability that the mission fails, by induction over steps and automaton states.

    V_t(p) = min(1, min_q [V_{t-1}(q) + P(reading the label in q does not reach p) + P(a cell between the
    steps loses q)]). A label that loses q is counted only in the second probability.
    ``read[t][q]`` is the state after each label.
    """
    states = range(len(covers))
    V = [0.0 if covers[initial][p] else 1.0 for p in states]
    for t, seen in enumerate(masses):
        V = [
            min(
                1.0,
                *(
                    V[q]
                    + way.cost[t][q]
                    + sum(
                        m for s, m in seen.items() if not covers[read[t][q][s]][p] and s not in way.lost[t][q]
                    )
                    for q in states
                ),
            )
            for p in states
        ]
    return min([1.0] + [V[p] for p in states if accepting[p]])


@dataclass(frozen=True, slots=True)
class Way:
    """Risks between steps: for each step and state the risk to lose the state, and labels that lose it."""

    cost: list[list[float]]
    lost: Sequence[Sequence[Collection[frozenset[str]]]]


def way_risks(
    cells: Sequence[tuple[Convex, Sequence[Sequence[bool]]]], x: FloatArray, cov: FloatArray, states: int
) -> list[list[float]]:
    """For each step and state, ``[t][q]``, the risk of meeting a cell that loses the state then.

    It is the sum over those ``cells`` of a bound on P(cell met).
    """
    costs = []
    for t in range(len(x)):
        met = [crossing(part, x[max(t - 1, 0) : t + 1], cov[max(t - 1, 0) : t + 1]) for part, _ in cells]
        costs.append(
            [sum(m for m, (_, loses) in zip(met, cells, strict=True) if loses[t][q]) for q in range(states)]
        )
    return costs


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
    n, faces = gap.shape
    risk = beyond(gap, sd)
    cheapest = np.full(n, math.inf)
    for s in range(n):
        before = 0.0 if s == 0 else float(cheapest[s])
        if before < 1.0:
            for k in range(faces):
                beside = gap[s:, k] >= -ON_EDGE
                end = s + (len(beside) if beside.all() else int(np.argmin(beside)))
                cost = _run_costs(gap[s:end, k], sd[s:end, k], risk[s:end, k], grows[k, s:end, s:end])
                first = s if n == 1 else s + 1
                cheapest[first:end] = np.minimum(cheapest[first:end], before + cost[first - s :])
    return float(cheapest[-1])


def _run_costs(gap: FloatArray, sd: FloatArray, risk: FloatArray, grows: BoolArray) -> FloatArray:
    """Cost of the runs from the first step to each step."""
    union = np.cumsum(np.where(sd > 0, risk, 0.0))
    widest, least = np.maximum.accumulate(sd), np.minimum.accumulate(gap)
    ordered_pairs = grows | ~np.triu(np.ones(grows.shape, bool), 1)
    free = np.logical_and.accumulate(ordered_pairs.all(axis=0)) & (widest > 0)
    return np.where(free, np.minimum(union, 2 * beyond(least, widest)), union)


def growing(part: Convex, cross: FloatArray, share: float) -> BoolArray:
    """(faces, r, t): n' Cov(e_t, e_r) n >= (1 - share) n' Var(e_r) n."""
    both = np.einsum("ki,trij,kj->krt", part.normals, cross, part.normals)
    own = np.einsum("krr->kr", both)
    found: BoolArray = both >= own[:, :, None] * (1 - share)
    return found


def step_margin(obstacles: Sequence[Convex], x: FloatArray, cov: FloatArray, z: float) -> float:
    """Least over steps and obstacles of the best common face's gap - z σ at both ends [m].

    Eqs. (9) and (10) hold if it is >= 0.
    """
    least = math.inf
    for part in obstacles:
        gap, sd = face_gaps(part, x, cov)
        room = gap - z * sd
        shared = np.minimum(room[:-1], room[1:]) if len(room) > 1 else room
        least = min(least, float(shared.max(axis=1).min()))
    return least


def step_risk(obstacles: Sequence[Convex], x: FloatArray, cov: FloatArray) -> float:
    """Largest over steps of Σ_j min over faces common to a step of P(beyond); inf if no face is common."""
    total = np.zeros(max(len(x) - 1, 1))
    for part in obstacles:
        gap, sd = face_gaps(part, x, cov)
        risk = np.where(gap >= -ON_EDGE, beyond(gap, sd), math.inf)
        ends = np.where(np.isfinite(risk[:-1]), risk[1:], math.inf) if len(risk) > 1 else risk
        total += ends.min(axis=1)
    return float(total.max(initial=0.0))
