"""Bounds on the probability of meeting an obstacle: at each step, and on whole paths (R)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pareto_ltl.kernels.data import (
    CollisionBound,
    CollisionMemory,
    Cov,
    Faces,
    Gaussian,
    PathBound,
    PathMemory,
    StepBound,
    StepMemory,
)
from pareto_ltl.kernels.gaussian import SQRT_HALF, tail, variance_along
from pareto_ltl.kernels.geometry import SLACK
from pareto_ltl.kernels.jit import allocating, by_type, implements, inlined, kernel
from pareto_ltl.support.arrays import FloatArray, IntArray

# Standard deviations beyond which an obstacle, at below 3e-7, is not looked at (growth runs a sixth
# faster than with seven). R of a finished path leaves nothing out.
FAR_DEVIATIONS = 5.0


# --- at each step, Eqs. (9) and (10) ----------------------------------------------------------


@kernel
def clear_faces(obstacles: Faces, z: float, here: Gaussian, cleared: IntArray, row: int) -> bool:
    """Bit k of ``cleared[row, j]``: face k of obstacle j is cleared, c' x - d >= z √(c' Σ c), Eq. (10).

    Returns False at the first obstacle without a cleared face: the position breaks Eq. (9).
    """
    ptr, normal, offset = obstacles.ptr, obstacles.normal, obstacles.offset
    for j in range(len(ptr) - 1):
        mask = 0
        for k in range(ptr[j], ptr[j + 1]):
            nx, ny = normal[k, 0], normal[k, 1]
            gap = nx * here.mean.x + ny * here.mean.y - offset[k]
            if (gap >= 0.0 or z < 0.0) and gap >= z * math.sqrt(variance_along(nx, ny, here.cov)):
                mask |= 1 << (k - ptr[j])
        if mask == 0:
            return False
        cleared[row, j] = mask
    return True


# --- along a path -----------------------------------------------------------------------------


@inlined
def largest_sd(cov: Cov) -> float:
    """An upper bound of the largest standard deviation (Gershgorin) [m]."""
    return math.sqrt(max(cov.xx, cov.yy) + abs(cov.xy))


@inlined
def run_cost(total: float, least: float, widest: float) -> float:
    """min(Σ p, 2 Φ(-least / √widest)) of one run."""
    if total <= 0.0 or widest <= 0.0:
        return total
    return min(total, 2.0 * tail(least, widest))


class Leg(NamedTuple):
    """One step between two positions; farther than ``far_here``, ``far_there`` [m] nothing is looked at."""

    here: Gaussian
    there: Gaussian
    far_here: float
    far_there: float


@kernel
def pass_obstacles(
    obstacles: Faces, here: Gaussian, there: Gaussian, last: PathMemory, before: int, new: PathMemory,
    now: int,
) -> tuple[float, float]:  # fmt: skip
    """Risk at the end of a step from ``here`` to ``there``, and what R of the path grows by.

    Both ends must lie beyond one face of every obstacle; the steps in a row that have the same face are a
    run, and a run costs min(Σ p, 2 Φ(-least gap / largest σ)). Of the faces that serve the step the one
    that adds least is taken. Row ``now`` of ``new.face`` and ``new.run`` gets them; row ``before`` of
    ``last`` is that of the step before. The first figure is Σ_j p_tj <= epsilon, inf where an obstacle
    has no common face.
    """
    leg = Leg(here, there, FAR_DEVIATIONS * largest_sd(here.cov), FAR_DEVIATIONS * largest_sd(there.cov))
    normal, offset = obstacles.normal, obstacles.offset
    at_step, grows = 0.0, 0.0
    for j in range(len(obstacles.ptr) - 1):
        old = last.face[before, j]
        if old >= 0:
            ahead = normal[old, 0] * there.mean.x + normal[old, 1] * there.mean.y - offset[old]
            if ahead >= leg.far_there and ahead >= 0.0:
                new.face[now, j] = old
                for i in range(3):
                    new.run[now, j, i] = last.run[before, j, i]
                continue
        own, cost = pass_obstacle(obstacles, j, leg, last, before, new, now)
        if cost == math.inf:
            return math.inf, math.inf
        at_step += own
        grows += cost
    return at_step, grows


@kernel
def pass_obstacle(
    obstacles: Faces, j: int, leg: Leg, last: PathMemory, before: int, new: PathMemory, now: int
) -> tuple[float, float]:
    """The face of obstacle ``j`` that adds least to R: its risk at the end of the step, and what it adds."""
    x0, y0 = leg.here.mean
    x1, y1 = leg.there.mean
    old, total, least, widest = last.face[before, j], 0.0, 0.0, 0.0
    if old >= 0:
        total, least = float(last.run[before, j, 0]), float(last.run[before, j, 1])
        widest = float(last.run[before, j, 2])
    best, own = math.inf, 0.0
    for k in range(obstacles.ptr[j], obstacles.ptr[j + 1]):
        nx, ny, d = obstacles.normal[k, 0], obstacles.normal[k, 1], obstacles.offset[k]
        here, there = nx * x0 + ny * y0 - d, nx * x1 + ny * y1 - d
        if here < 0.0 or there < 0.0:
            continue
        p, v = 0.0, 0.0
        if there < leg.far_there or leg.far_there <= 0.0:
            v = variance_along(nx, ny, leg.there.cov)
            p = tail(there, v)
        if old >= 0 and k == old:
            s, g, w = total + p, min(least, there) if v > 0.0 else least, max(widest, v)
            cost = run_cost(s, g, w) - run_cost(total, least, widest)
        else:
            s, g, w = p, there if v > 0.0 else math.inf, v
            if old >= 0 and here < leg.far_here:
                u = variance_along(nx, ny, leg.here.cov)
                s, g, w = s + tail(here, u), min(g, here), max(w, u)
            cost = s  # of two terms 2 Φ(-least / √widest) is never less
        if cost < best:
            best, own = cost, p
            new.face[now, j] = k
            new.run[now, j, 0], new.run[now, j, 1], new.run[now, j, 2] = s, g, w
            if cost == 0.0:
                break
    return own, best


# --- the constraint on a step of a given path -------------------------------------------------


@by_type
def step_allowed(
    bound: CollisionBound, memory: CollisionMemory, t: int, before: Gaussian, here: Gaussian
) -> bool:
    """Whether the step from ``before`` to ``here`` satisfies the chance constraint of a bound.

    Rows t and t - 1 of ``memory`` are taken modulo 2; step 0 begins and ends at ``here``.
    """
    raise NotImplementedError


@implements(step_allowed, StepBound)
def _step_keeps_faces(bound: StepBound, memory: StepMemory, t: int, before: Gaussian, here: Gaussian) -> bool:
    cleared, now = memory.cleared, t % 2
    if not clear_faces(bound.barriers, bound.z, here, cleared, now):
        return False
    if t > 0:
        for j in range(cleared.shape[1]):
            if cleared[now, j] & cleared[1 - now, j] == 0:
                return False
    return True


@implements(step_allowed, PathBound)
def _step_keeps_epsilon(
    bound: PathBound, memory: PathMemory, t: int, before: Gaussian, here: Gaussian
) -> bool:
    risk, _ = pass_obstacles(bound.barriers, before, here, memory, (t + 1) % 2, memory, t % 2)
    return risk <= bound.epsilon


# --- R of a whole path ------------------------------------------------------------------------

SUM_ONLY, REFLECT, REFLECT_WHERE_GROWING = range(3)  # when the form 2 Φ may be used


class GaussianPath(NamedTuple):
    """Means ``x`` (T+1, 2), covariances ``cov`` (T+1, 3) = (xx, xy, yy); ``reflect`` says when the form
    2 Φ holds, ``cross`` (T+1, T+1, 2, 2) = Cov(e_t, e_s) decides where it is not known beforehand."""

    x: FloatArray
    cov: FloatArray
    cross: FloatArray
    reflect: int


@allocating
def collision_bound(obstacles: Faces, path: GaussianPath) -> float:
    """R = Σ over (obstacle, run of steps with one separating face) of min(Σ_t p_t, 2 Φ(-min d / max σ)), not
    cut at 1.

    Runs overlap in the step where the face changes, because both ends of every step must clear one face;
    the cheapest division into runs is found by dynamic programming over the steps. The second form holds
    while Cov(e_s, e_t) >= Var e_s for s <= t along the normal of the face: always where A - K = I under the
    independent law, and otherwise where ``path.cross`` says so.
    """
    total = 0.0
    cheapest = np.empty(len(path.x))
    for j in range(len(obstacles.ptr) - 1):
        cheapest[:] = math.inf
        for s in range(len(path.x)):
            before = 0.0 if s == 0 else cheapest[s]
            if before < 1.0:
                _runs_from(obstacles, j, path, s, before, cheapest)
        total += min(cheapest[-1], 1.0)
    return total


@kernel
def _runs_from(
    obstacles: Faces, j: int, path: GaussianPath, s: int, before: float, cheapest: FloatArray
) -> None:
    """Lower ``cheapest[t]``, the cost of steps 0 to t, by runs that begin at step s."""
    ptr, normal, offset = obstacles.ptr, obstacles.normal, obstacles.offset
    x, cov = path.x, path.cov
    for k in range(ptr[j], ptr[j + 1]):
        nx, ny = normal[k, 0], normal[k, 1]
        least, widest, total, grows = math.inf, 0.0, 0.0, path.reflect > 0
        for t in range(s, len(x)):
            gap = nx * x[t, 0] + ny * x[t, 1] - offset[k]
            if gap < -SLACK:
                break
            v = nx * nx * cov[t, 0] + 2.0 * nx * ny * cov[t, 1] + ny * ny * cov[t, 2]
            least, widest = min(least, gap), max(widest, v)
            if v > 0.0:
                total += 0.5 * math.erfc(SQRT_HALF * gap / math.sqrt(v))
            cost = total
            if path.reflect == REFLECT_WHERE_GROWING and grows and t > s:
                grows = _grows(path.cross, s, t, nx, ny)
            if grows and widest > 0.0:
                cost = min(cost, math.erfc(SQRT_HALF * least / math.sqrt(widest)))
            if t > s or len(x) == 1:
                cheapest[t] = min(cheapest[t], before + cost)


@kernel
def _grows(cross: FloatArray, s: int, t: int, nx: float, ny: float) -> bool:
    """Whether n' Cov(e_t, e_r) n >= n' Var(e_r) n for all r from s to t."""
    for r in range(s, t):
        both = nx * nx * cross[t, r, 0, 0] + nx * ny * (cross[t, r, 0, 1] + cross[t, r, 1, 0])
        both += ny * ny * cross[t, r, 1, 1]
        own = nx * nx * cross[r, r, 0, 0] + 2.0 * nx * ny * cross[r, r, 0, 1] + ny * ny * cross[r, r, 1, 1]
        if both < own * (1.0 - 1e-9):
            return False
    return True
