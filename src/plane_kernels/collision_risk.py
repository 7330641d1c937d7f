"""The chance constraint of one step of a Gaussian position past convex polygons, under each bound of it."""

from __future__ import annotations

import math
from typing import NamedTuple

from plane_kernels.gaussian import tail, variance_along
from plane_kernels.geometry import look_around
from plane_kernels.types import CollisionBound, Cov, Faces, Gaussian, Nearby, PathBound, StepBound
from typed_kernels.jit import by_type, implements, inlined, kernel

FAR_DEVIATIONS = 5.0  # obstacles more standard deviations away, of a probability below 3e-7, are skipped


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


@inlined
def look_around_leg(nearby: Nearby, leg: Leg) -> tuple[int, float]:
    """:func:`look_around` for a step, up to the distance at which faces are far."""
    return look_around(nearby, leg.here.mean, leg.there.mean, max(leg.far_here, leg.far_there))


# --- each barrier by itself -------------------------------------------------------------------


@kernel
def step_is_clear(bound: StepBound, here: Gaussian, there: Gaussian) -> bool:
    """Whether every obstacle has one face with c' x - d >= z √(c' Σ c) at both ends of a step.

    Then each end is in an obstacle with a probability of at most epsilon / m, and the segment between the
    means meets none.

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
    """Whether a position is outside face k with a probability of at least 1 - epsilon / m."""
    nx, ny, z = bound.barriers.normal[k, 0], bound.barriers.normal[k, 1], bound.z
    gap = nx * here.mean.x + ny * here.mean.y - bound.barriers.offset[k]
    return bool((gap >= 0.0 or z < 0.0) and gap >= z * math.sqrt(variance_along(nx, ny, here.cov)))


# --- under either bound -----------------------------------------------------------------------


@by_type
def step_allowed(bound: CollisionBound, before: Gaussian, here: Gaussian) -> bool:
    """Whether the step from ``before`` to ``here`` satisfies the chance constraint of a bound.

    The first step of a path begins and ends at its start.
    """
    raise NotImplementedError


@implements(step_allowed, StepBound)
def _step_keeps_faces(bound: StepBound, before: Gaussian, here: Gaussian) -> bool:
    return step_is_clear(bound, before, here)


@implements(step_allowed, PathBound)
def _step_keeps_epsilon(bound: PathBound, before: Gaussian, here: Gaussian) -> bool:
    return step_risk(bound, leg_between(before, here, FAR_DEVIATIONS)) <= bound.epsilon


@kernel
def step_risk(bound: PathBound, leg: Leg) -> float:
    """Σ_j p_j at the end of a step, p_j the least over the faces of obstacle j beyond which both ends lie.

    It is inf if there is no such face of some obstacle.

    Eq. (M40) of docs/mathematics.md.
    """
    faces, nearby, total = bound.barriers, bound.nearby, 0.0
    row, far = look_around_leg(nearby, leg)
    for i in range(nearby.order.shape[1]):
        if nearby.gap[row, i] >= far:
            break
        total += least_beyond(faces, int(nearby.order[row, i]), leg)
    return total


@kernel
def least_beyond(faces: Faces, j: int, leg: Leg) -> float:
    """The least probability to be inside a face of obstacle ``j`` that separates both ends; inf for none."""
    (x0, y0), (x1, y1), least = leg.here.mean, leg.there.mean, math.inf
    for k in range(faces.ptr[j], faces.ptr[j + 1]):
        nx, ny, d = faces.normal[k, 0], faces.normal[k, 1], faces.offset[k]
        there = nx * x1 + ny * y1 - d
        if nx * x0 + ny * y0 - d < 0.0 or there < 0.0:
            continue
        if there >= leg.far_there > 0.0:
            return 0.0
        least = min(least, tail(there, variance_along(nx, ny, leg.there.cov)))
    return least
