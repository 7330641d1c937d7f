"""Depths of flights inside landmarks, and the slope of what keeps a path in them."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.kernels.data import Landmarks
from pareto_ltl.support.arrays import FloatArray, IntArray
from plane_kernels.clearance import CERTAIN, Event
from plane_kernels.types import Faces
from plane_logic.margin import FLAT, Slope, add_failure_slope
from typed_kernels.jit import allocating, kernel

NEAREST = 3  # legs of a path on which a flight may be deepest in a landmark
SHARES = (0.5, 1.0)  # of a leg, where that is evaluated


@kernel
def find_nearest_legs(x: FloatArray, px: float, py: float, legs: IntArray) -> int:
    """Fill ``legs`` with the legs of ``x`` (T+1, 2) nearest to (``px``, ``py``) [m]; return their number."""
    count = min(len(legs), len(x) - 1)
    for j in range(count):
        best, least = -1, math.inf
        for t in range(len(x) - 1):
            away = math.hypot(x[t, 0] - px, x[t, 1] - py) + math.hypot(x[t + 1, 0] - px, x[t + 1, 1] - py)
            taken = False
            for k in range(j):
                taken = taken or legs[k] == t
            if away < least and not taken:
                best, least = t, away
        legs[j] = best
    return count


@kernel
def depth_event(marks: Faces, part: int, legs: IntArray, count: int, x: FloatArray, off: FloatArray) -> Event:
    """Where the flight ``x`` + ``off`` (T+1, 2) is deepest in a landmark: the margin is that depth [m]."""
    deepest = Event(-CERTAIN, 0, 0.0, 0.0, 0.0)
    for j in range(count):
        t = legs[j]
        for share in SHARES:
            px = (1.0 - share) * (x[t, 0] + off[t, 0]) + share * (x[t + 1, 0] + off[t + 1, 0])
            py = (1.0 - share) * (x[t, 1] + off[t, 1]) + share * (x[t + 1, 1] + off[t + 1, 1])
            least = Event(CERTAIN, t, 0.0, 0.0, share)
            for k in range(marks.ptr[part], marks.ptr[part + 1]):
                nx, ny = marks.normal[k, 0], marks.normal[k, 1]
                depth = marks.offset[k] - nx * px - ny * py
                if depth < least.margin:
                    least = Event(depth, t, -nx, -ny, share)
                    if depth <= deepest.margin:
                        break
            if least.margin > deepest.margin:
                deepest = least
    return deepest


@kernel
def attract(
    marks: Landmarks, mean: FloatArray, off: FloatArray, width: float, worth: float, slope: Slope,
    legs: IntArray,
) -> float:  # fmt: skip
    """``worth`` / n Σ_ik σ(-m_ik / ``width``), m_ik the depth [m] of flight i in landmark k.

    The flights are ``mean`` (T+1, 2) + ``off`` (T+1, 2, n). The gradient and the convex part of the Hessian
    are added to ``slope``. ``legs`` (NEAREST,) is scratch.

    Eq. (M75) of docs/mathematics_methods.md.
    """
    total, n = 0.0, off.shape[2]
    for part in range(len(marks.disc)):
        count = find_nearest_legs(mean, marks.disc[part, 0], marks.disc[part, 1], legs)
        for i in range(n):
            event = depth_event(marks.faces, part, legs, count, mean, off[:, :, i])
            z = event.margin / width
            if abs(z) > FLAT:
                total += 1.0 if z < 0.0 else 0.0
                continue
            f = 1.0 / (1.0 + math.exp(z))
            total += f
            add_failure_slope(slope, event, f, width, n / worth)
    return float(worth * total / n)


@allocating
def add_attraction(
    marks: Landmarks, mean: FloatArray, off: FloatArray, width: float, worth: float, slope: Slope
) -> float:
    """:func:`attract` for callers in Python."""
    return float(attract(marks, mean, off, width, worth, slope, np.empty(NEAREST, np.int64)))
