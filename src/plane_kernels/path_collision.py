"""The collision bound R of a path of Gaussians: the cheapest division of its steps into runs beside one face.

R bounds the probability that a path whose positions are jointly normal meets one of many convex polygons.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plane_kernels.collision_risk import leg_between, look_around_leg
from plane_kernels.gaussian import SQRT_HALF, tail
from plane_kernels.geometry import SLACK
from plane_kernels.types import BoolArray, Cov, Faces, FloatArray, Gaussian, IntArray, Nearby, Point
from typed_kernels.jit import allocating, inlined, kernel

ALL_DEVIATIONS = 8.3  # standard deviations; farther obstacles have probability below 1e-16
SUM_ONLY, REFLECT, REFLECT_WHERE_GROWING = range(3)  # whether the form 2 Φ is used: never, always, by cross
UNKNOWN = -2  # not computed yet
ROUNDING = 1e-9  # largest relative difference of sums in another order


class GaussianPath(NamedTuple):
    """Means ``x`` (T+1, 2) [m] and covariances ``cov`` (T+1, 3) = (xx, xy, yy) [m²].

    ``reflect`` says when the form 2 Φ is valid; with ``REFLECT_WHERE_GROWING``, ``cross`` (T+1, T+1, 2, 2) =
    Cov(e_t, e_s) [m²] decides.
    """

    x: FloatArray
    cov: FloatArray
    cross: FloatArray
    reflect: int


class Beside(NamedTuple):
    """The k faces of one obstacle along a path of n positions.

    All (k, n): ``gap`` [m]; ``variance`` along the normal [m²]; ``beyond``, the probability of being inside
    the face; ``shrunk``, the last step before t whose variance exceeds its covariance with t. ``cost`` (k,):
    the least Σ p_t of divisions whose last run is beside each face.
    """

    gap: FloatArray
    variance: FloatArray
    beyond: FloatArray
    shrunk: IntArray
    cost: FloatArray


@allocating
def collision_bound(obstacles: Faces, nearby: Nearby, path: GaussianPath) -> float:
    """The collision bound R of a path; it may exceed 1.

        R = Σ over (obstacle, run of steps with one separating face) of min(Σ_t p_t, 2 Φ(-min d / max σ))

    Two runs share the position where the face changes, because both ends of every step must clear one face.
    The cheapest division into runs is found by dynamic programming over the steps. The form 2 Φ is valid
    while Cov(e_s, e_t) >= Var e_s for s <= t along the normal of the face: always if
    e_t is a sum of independent parts, one for each step before, otherwise as ``path.cross`` shows.

    The best division with sums only takes one pass along the path. Its cost limits the search for runs that
    the form 2 Φ makes cheaper, of which there are as many as pairs of steps. Obstacles that are far from all
    steps cost less than 1e-15 and are skipped.

    Eq. (M40) of docs/mathematics.md.
    """
    close = np.zeros(len(obstacles.ptr) - 1, np.bool_)
    _note_close(nearby, path, close)
    ptr, n, largest = obstacles.ptr, len(path.x), 0
    for j in range(len(ptr) - 1):
        largest = max(largest, ptr[j + 1] - ptr[j])
    beside = Beside(
        np.empty((largest, n)), np.empty((largest, n)), np.empty((largest, n)),
        np.empty((largest, n), np.int64),
        np.empty(largest),
    )  # fmt: skip
    cheapest, total = np.empty(n), 0.0
    for j in range(len(ptr) - 1):
        if not close[j]:
            continue
        faces = ptr[j + 1] - ptr[j]
        _look_beside(obstacles, ptr[j], faces, path, beside)
        cost = _cost_of_sums(beside, faces)
        if path.reflect != SUM_ONLY and cost > 0.0 and n > 1:
            limit = min(cost, 1.0) * (1.0 + ROUNDING)
            cheapest[:] = math.inf
            for s in range(n - 1):
                before = 0.0 if s == 0 else cheapest[s]
                if before > limit or (s < n - 2 and cheapest[s + 1] <= before):
                    continue  # a run that begins a step later costs no more
                for k in range(faces):
                    row = obstacles.normal[ptr[j] + k]
                    _runs_from(Point(row[0], row[1]), k, path, beside, s, limit, cheapest)
            cost = cheapest[-1]
        total += min(cost, 1.0)
    return total


@kernel
def _note_close(nearby: Nearby, path: GaussianPath, close: BoolArray) -> None:
    """Fill ``close``: whether any step is near each obstacle."""
    for t in range(len(path.x)):
        leg = leg_between(_position(path, max(t - 1, 0)), _position(path, t), ALL_DEVIATIONS)
        row, far = look_around_leg(nearby, leg)
        for i in range(len(close)):
            if nearby.gap[row, i] >= far:
                break
            close[nearby.order[row, i]] = True


@inlined
def _position(path: GaussianPath, t: int) -> Gaussian:
    x, cov = path.x, path.cov
    return Gaussian(Point(x[t, 0], x[t, 1]), Cov(cov[t, 0], cov[t, 1], cov[t, 2]))


@kernel
def _look_beside(obstacles: Faces, first: int, faces: int, path: GaussianPath, beside: Beside) -> None:
    """Fill ``beside`` for the ``faces`` faces from row ``first`` on."""
    x, cov = path.x, path.cov
    for k in range(faces):
        nx, ny = obstacles.normal[first + k, 0], obstacles.normal[first + k, 1]
        for t in range(len(x)):
            gap = nx * x[t, 0] + ny * x[t, 1] - obstacles.offset[first + k]
            v = nx * nx * cov[t, 0] + 2.0 * nx * ny * cov[t, 1] + ny * ny * cov[t, 2]
            beside.gap[k, t], beside.variance[k, t], beside.shrunk[k, t] = gap, v, UNKNOWN
            beside.beyond[k, t] = tail(gap, v) if v > 0.0 and gap >= -SLACK else 0.0


@kernel
def _cost_of_sums(beside: Beside, faces: int) -> float:
    """The least Σ p_t over all divisions into runs; inf if there is no division."""
    now, before = 0.0, 0.0
    for t in range(beside.gap.shape[1]):
        now = math.inf
        for k in range(faces):
            cost = math.inf
            if beside.gap[k, t] >= -SLACK:
                p = beside.beyond[k, t]
                if t == 0:
                    cost = p
                elif beside.gap[k, t - 1] >= -SLACK:
                    cost = min(beside.cost[k], before + beside.beyond[k, t - 1]) + p
            beside.cost[k] = cost
            now = min(now, cost)
        before = now if t > 0 else 0.0
    return now


@kernel
def _runs_from(
    at: Point, k: int, path: GaussianPath, beside: Beside, s: int, limit: float, cheapest: FloatArray
) -> None:
    """Lower ``cheapest[t]``, the cost of steps 0 to t, by runs beside face k from step s on.

    ``at`` is the normal of the face. Longer runs cost more, so the search ends above ``limit``. The form 2 Φ,
    which is at least 2 max p, is computed only if it can be the cheapest.
    """
    gap, variance, beyond = beside.gap[k], beside.variance[k], beside.beyond[k]
    before = 0.0 if s == 0 else cheapest[s]
    least, widest, total, largest = math.inf, 0.0, 0.0, 0.0
    form, stale, grows, seen = math.inf, True, True, s
    for t in range(s, len(gap)):
        if gap[t] < -SLACK:
            break
        if gap[t] < least or variance[t] > widest:
            least, widest, stale = min(least, gap[t]), max(widest, variance[t]), True
        total += beyond[t]
        largest = max(largest, beyond[t])
        if t == s:
            continue
        cost = floor = total
        if grows and 2.0 * largest < total:
            floor = 2.0 * largest
            if before + floor <= cheapest[t]:
                if stale:
                    form, stale = math.erfc(SQRT_HALF * least / math.sqrt(widest)), False
                while form < total and grows and path.reflect != REFLECT and seen < t:
                    seen += 1
                    grows = _last_shrunk(at, k, path, beside, s, seen) < s
                if grows:
                    cost = min(cost, form)
                floor = cost
        cheapest[t] = min(cheapest[t], before + cost)
        if before + floor > limit:
            break


@kernel
def _last_shrunk(at: Point, k: int, path: GaussianPath, beside: Beside, s: int, t: int) -> int:
    """The last step r with s <= r < t and n' Cov(e_t, e_r) n < n' Var(e_r) n; -1 if there is none.

    It is computed once for each t and stored: later runs begin at later steps.
    """
    if beside.shrunk[k, t] == UNKNOWN:
        beside.shrunk[k, t] = -1
        for r in range(t - 1, s - 1, -1):
            cross = path.cross[t, r]
            both = at.x * at.x * cross[0, 0] + at.x * at.y * (cross[0, 1] + cross[1, 0])
            both += at.y * at.y * cross[1, 1]
            if both < beside.variance[k, r] * (1.0 - 1e-9):
                beside.shrunk[k, t] = r
                break
    return int(beside.shrunk[k, t])
