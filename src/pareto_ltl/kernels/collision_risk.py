"""Bounds on the collision probability: the constraint of each step, and the increase of R in one step."""

from __future__ import annotations

import math
from typing import NamedTuple

from pareto_ltl.kernels.bounds import CollisionBound, CollisionMemory, PathBound, PathMemory, StepBound
from pareto_ltl.kernels.data import Cov, Faces, Gaussian, Nearby
from pareto_ltl.kernels.gaussian import tail, variance_along
from pareto_ltl.kernels.geometry import look_around
from pareto_ltl.kernels.jit import by_type, implements, inlined, kernel

# Obstacles more standard deviations away, of a probability below 3e-7, are skipped (with 7 instead of 5,
# growth takes a sixth longer).
FAR_DEVIATIONS = 5.0


class Leg(NamedTuple):
    """One step between two positions; faces farther than ``far_here``, ``far_there`` [m] add no risk."""

    here: Gaussian
    there: Gaussian
    far_here: float
    far_there: float


@inlined
def largest_sd(cov: Cov) -> float:
    """An upper bound of the largest standard deviation (Gershgorin) [m]."""
    return math.sqrt(max(cov.xx, cov.yy) + abs(cov.xy))


@kernel
def leg_between(here: Gaussian, there: Gaussian, deviations: float) -> Leg:
    """The step from ``here`` to ``there``; faces are far beyond ``deviations`` standard deviations."""
    return Leg(here, there, deviations * largest_sd(here.cov), deviations * largest_sd(there.cov))


@kernel
def leg_of_start(here: Gaussian, deviations: float) -> Leg:
    """The start as a step of length 0, of which only the end adds risk."""
    return Leg(here, here, -math.inf, deviations * largest_sd(here.cov))


@inlined
def look_around_leg(nearby: Nearby, leg: Leg) -> tuple[int, float]:
    """:func:`look_around` for a step, up to the distance at which faces are far."""
    return look_around(nearby, leg.here.mean, leg.there.mean, max(leg.far_here, leg.far_there))


# --- at each step, Eqs. (9) and (10) ----------------------------------------------------------


@kernel
def step_is_clear(bound: StepBound, here: Gaussian, there: Gaussian) -> bool:
    """Whether every obstacle has one face with c' x - d >= z √(c' Σ c), Eq. (10), at both ends of a step.

    Then both ends satisfy Eq. (9), and the segment between their means meets no obstacle.

    Eq. (M39) of docs/mathematics.md.
    """
    ptr, z = bound.barriers.ptr, bound.z
    nearby = bound.nearby
    row, far = look_around_leg(nearby, leg_between(here, there, max(z, 0.0)))
    for i in range(nearby.order.shape[1]):
        if nearby.gap[row, i] >= far:
            break
        j, clear = nearby.order[row, i], False
        for k in range(ptr[j], ptr[j + 1]):
            if clears_face(bound, k, there) and clears_face(bound, k, here):
                clear = True
                break
        if not clear:
            return False
    return True


@kernel
def clears_face(bound: StepBound, k: int, here: Gaussian) -> bool:
    """Whether a position is outside face k with the probability that Eq. (10) requires."""
    nx, ny, z = bound.barriers.normal[k, 0], bound.barriers.normal[k, 1], bound.z
    gap = nx * here.mean.x + ny * here.mean.y - bound.barriers.offset[k]
    return bool((gap >= 0.0 or z < 0.0) and gap >= z * math.sqrt(variance_along(nx, ny, here.cov)))


# --- along a path -----------------------------------------------------------------------------


class Run(NamedTuple):
    """Consecutive steps with one separating face: Σ p, smallest gap [m], largest variance [m²]."""

    face: int
    total: float
    least: float
    widest: float


@inlined
def run_cost(run: Run) -> float:
    """min(Σ p, 2 Φ(-least / √widest)).

    Eq. (M40) of docs/mathematics.md.
    """
    if run.total <= 0.0 or run.widest <= 0.0:
        return run.total
    return min(run.total, 2.0 * tail(run.least, run.widest))


@kernel
def run_of(nearby: Nearby, memory: PathMemory, row: int, j: int) -> Run:
    """The run of polygon ``j`` in a row of ``memory``; its face is -1 if no run is stored."""
    face, total, least, widest = -1, 0.0, 0.0, 0.0
    for i in range(memory.face.shape[1]):
        if memory.face[row, i] < 0:
            break
        if nearby.owner[memory.face[row, i]] == j:
            face, total = memory.face[row, i], memory.run[row, i, 0]
            least, widest = memory.run[row, i, 1], memory.run[row, i, 2]
            break
    return Run(face, total, least, widest)


@kernel
def note_run(memory: PathMemory, row: int, kept: int, run: Run) -> int:
    """Store a run after the ``kept`` runs of a row; in a full row, replace the one with the least Σ p.

    Returns the number of runs in the row. A run that is not stored starts again at the next step, which can
    make R larger, never smaller.
    """
    most = memory.face.shape[1]
    at = kept
    if kept == most:
        at = 0
        for i in range(1, most):
            if memory.run[row, i, 0] < memory.run[row, at, 0]:
                at = i
        if memory.run[row, at, 0] >= run.total:
            return kept
    memory.face[row, at] = run.face
    memory.run[row, at, 0], memory.run[row, at, 1] = run.total, run.least
    memory.run[row, at, 2] = run.widest
    return kept + 1 if kept < most else most


@kernel
def pass_obstacles(
    bound: PathBound, leg: Leg, last: PathMemory, before: int, new: PathMemory, now: int
) -> tuple[float, float]:
    """Collision risk at the end of a step, and the increase of R of the path.

    Both ends must lie beyond one face of every obstacle. Consecutive steps with the same face are a run,
    which costs min(Σ p, 2 Φ(-smallest gap / largest σ)). Of the faces that separate both ends, the one that
    adds least is chosen. Row ``now`` of ``new`` gets the runs with a cost above 0; row ``before`` of ``last``
    has the runs of the previous step. The first result, Σ_j p_tj, is to be compared with epsilon; both are
    inf if no face of some obstacle separates both ends.

    Eq. (M40) of docs/mathematics.md.
    """
    faces, nearby = bound.barriers, bound.nearby
    row, far = look_around_leg(nearby, leg)
    at_step, grows, kept = 0.0, 0.0, 0
    for i in range(nearby.order.shape[1]):
        if nearby.gap[row, i] >= far:
            break
        j = int(nearby.order[row, i])
        old = run_of(nearby, last, before, j)
        if old.face >= 0:
            k = old.face
            ahead = faces.normal[k, 0] * leg.there.mean.x + faces.normal[k, 1] * leg.there.mean.y
            if ahead - faces.offset[k] >= max(leg.far_there, 0.0):
                kept = note_run(new, now, kept, old)
                continue
        own, cost, run = pass_obstacle(faces, j, leg, old)
        if cost == math.inf:
            return math.inf, math.inf
        at_step += own
        grows += cost
        if run.total > 0.0:
            kept = note_run(new, now, kept, run)
    if kept < new.face.shape[1]:
        new.face[now, kept] = -1
    return at_step, grows


@kernel
def pass_obstacle(faces: Faces, j: int, leg: Leg, old: Run) -> tuple[float, float, Run]:
    """The run past obstacle ``j`` that adds least to R.

    Returns the risk at the end of the step, the increase of R (inf if there is no such run) and the run.
    """
    x0, y0 = leg.here.mean
    x1, y1 = leg.there.mean
    best, own, chosen = math.inf, 0.0, old
    for k in range(faces.ptr[j], faces.ptr[j + 1]):
        nx, ny, d = faces.normal[k, 0], faces.normal[k, 1], faces.offset[k]
        here, there = nx * x0 + ny * y0 - d, nx * x1 + ny * y1 - d
        if here < 0.0 or there < 0.0:
            continue
        p, v = 0.0, 0.0
        if there < leg.far_there or leg.far_there <= 0.0:
            v = variance_along(nx, ny, leg.there.cov)
            p = tail(there, v)
        if k == old.face:
            least = min(old.least, there) if v > 0.0 else old.least
            run = Run(int(k), old.total + p, least, max(old.widest, v))
            cost = run_cost(run) - run_cost(old)
        else:
            run = Run(int(k), p, there if v > 0.0 else math.inf, v)
            if here < leg.far_here:
                u = variance_along(nx, ny, leg.here.cov)
                run = Run(int(k), p + tail(here, u), min(run.least, here), max(v, u))
            cost = run.total  # for two terms, 2 Φ(-least / √widest) is never smaller
        if cost < best:
            best, own, chosen = cost, p, run
            if cost == 0.0:
                break
    return own, best, chosen


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
def _step_keeps_faces(bound: StepBound, _memory: None, _t: int, before: Gaussian, here: Gaussian) -> bool:
    return step_is_clear(bound, before, here)


@implements(step_allowed, PathBound)
def _step_keeps_epsilon(
    bound: PathBound, memory: PathMemory, t: int, before: Gaussian, here: Gaussian
) -> bool:
    leg = leg_between(before, here, FAR_DEVIATIONS) if t > 0 else leg_of_start(here, FAR_DEVIATIONS)
    risk, _ = pass_obstacles(bound, leg, memory, (t + 1) % 2, memory, t % 2)
    return risk <= bound.epsilon
