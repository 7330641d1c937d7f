"""Bounds on the probability of meeting an obstacle: at each step, and what the steps add to R."""

from __future__ import annotations

import math
from typing import NamedTuple

from pareto_ltl.kernels.data import (
    CollisionBound,
    CollisionMemory,
    Cov,
    Faces,
    Gaussian,
    Nearby,
    PathBound,
    PathMemory,
    StepBound,
)
from pareto_ltl.kernels.gaussian import tail, variance_along
from pareto_ltl.kernels.geometry import look_around
from pareto_ltl.kernels.jit import by_type, implements, inlined, kernel

# Standard deviations beyond which an obstacle, at below 3e-7, is not looked at (growth runs a sixth
# faster than with seven).
FAR_DEVIATIONS = 5.0


class Leg(NamedTuple):
    """One step between two positions; farther than ``far_here``, ``far_there`` [m] nothing is looked at."""

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
    """The step from ``here`` to ``there``; ``deviations`` are those that count as far."""
    return Leg(here, there, deviations * largest_sd(here.cov), deviations * largest_sd(there.cov))


@kernel
def leg_of_start(here: Gaussian, deviations: float) -> Leg:
    """The start as a step on the spot, whose risk counts once: before it there was nothing."""
    return Leg(here, here, -math.inf, deviations * largest_sd(here.cov))


@inlined
def look_around_leg(nearby: Nearby, leg: Leg) -> tuple[int, float]:
    """:func:`look_around` for a step, as far as its uncertainty counts."""
    return look_around(nearby, leg.here.mean, leg.there.mean, max(leg.far_here, leg.far_there))


# --- at each step, Eqs. (9) and (10) ----------------------------------------------------------


@kernel
def step_is_clear(bound: StepBound, here: Gaussian, there: Gaussian) -> bool:
    """Whether one face of every obstacle is cleared, c' x - d >= z √(c' Σ c) of Eq. (10), at both ends.

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
    """Whether a position is outside face k with the probability that Eq. (10) asks for."""
    nx, ny, z = bound.barriers.normal[k, 0], bound.barriers.normal[k, 1], bound.z
    gap = nx * here.mean.x + ny * here.mean.y - bound.barriers.offset[k]
    return bool((gap >= 0.0 or z < 0.0) and gap >= z * math.sqrt(variance_along(nx, ny, here.cov)))


# --- along a path -----------------------------------------------------------------------------


class Run(NamedTuple):
    """Steps in a row with one separating face: Σ p, least gap [m], largest variance [m²]."""

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
    """The run of polygon ``j`` in a row of ``memory``; its face is -1 where none costs anything."""
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
    """Store a run behind the ``kept`` ones of a row, or in place of the cheapest; how many there are then.

    A run that is left out begins anew at the next step, so that R may be larger and is never smaller.
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
    """Risk at the end of a step, and what R of the path grows by.

    Both ends must lie beyond one face of every obstacle; the steps in a row that have the same face are a
    run, and a run costs min(Σ p, 2 Φ(-least gap / largest σ)). Of the faces that serve the step the one
    that adds least is taken. Row ``now`` of ``new`` gets the runs that cost something; row ``before`` of
    ``last`` has those of the step before. The first figure is Σ_j p_tj <= epsilon, inf where an obstacle
    has no common face.

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
    """The run past obstacle ``j`` that adds least to R: risk at the end of the step, what it adds, run."""
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
            cost = run.total  # of two terms 2 Φ(-least / √widest) is never less
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
