"""The margin of a flight: its distance from failure or from success, with derivatives.

The margin [m] is positive if the flight succeeds and negative if it fails. Its size is the distance by which
positions would have to move to change that:

    m = min(mission margin, clearance of every barrier on every segment).

The mission margin is a max-min over the automaton. W_t(p) is the margin of "after step t the state is at
least as good as p":

    W_t(p) = max_q min(W_{t-1}(q), clearance of the letters that lose q, margin of {s : δ(q, s) ≥ p} at x_t),

and the mission margin is the largest W_T(p) of an accepting p. The margin of a set of letters is the signed
distance to its nearest face. In these minima and maxima one event binds: m is the signed distance of one
point of the flight from one line or corner, and its gradient is the unit vector from there.

``tests/oracle/margin.py`` is the same in plain Python.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from plane_kernels.boxes import enclose, least_gaps, list_entered, list_met, place_end, segment_box
from plane_kernels.clearance import CERTAIN, Event, segment_clearance
from plane_kernels.types import FloatArray, Point
from plane_logic import claim_lists, claim_rows
from plane_logic.margin_events import (
    NOWHERE,
    SATURATED,
    MarginModel,
    Scratch,
    mission_margins,
    numbered_event,
)  # fmt: skip
from typed_kernels.jit import kernel, shared_entry

FLAT = 3.0 * SATURATED  # widths: beyond, a smoothed failure has no slope
MODELS = (claim_lists.ClaimLists, claim_rows.ClaimRows)  # types of memory that select :func:`mission_margins`


class Slope(NamedTuple):
    """Gradient (T+1, 2) [1/m] and diagonal Hessian blocks xx, xy, yy (T+1, 3) [1/m²] of smoothed failure."""

    gradient: FloatArray
    hessian: FloatArray


@kernel
def add_failure_slope(slope: Slope, event: Event, f: float, width: float, runs: float) -> None:
    """Add the derivatives of f / ``runs``, with f = σ(-m / ``width``) of the margin m of ``event``."""
    first = -f * (1.0 - f) / width
    add_slope(slope, event, first / runs, -first * max(1.0 - 2.0 * f, 0.0) / width / runs)


@kernel
def add_slope(slope: Slope, event: Event, first: float, second: float) -> None:
    """Add the derivatives ``first`` and ``second`` of a function of the margin to both ends of the segment.

    The block-diagonal Hessian w n n' at an end of weight w is an upper bound of the exact one, as
    w0² + w0 w1 = w0.

    Eq. (M55) of docs/mathematics_methods.md.
    """
    nx, ny = event.nx, event.ny
    for end in range(2):
        w = event.share if end == 1 else 1.0 - event.share
        if w > 0.0:
            t = event.t + end
            slope.gradient[t, 0] += first * w * nx
            slope.gradient[t, 1] += first * w * ny
            slope.hessian[t, 0] += second * w * nx * nx
            slope.hessian[t, 1] += second * w * nx * ny
            slope.hessian[t, 2] += second * w * ny * ny


@kernel
def barrier_clearances(model: MarginModel, mean: FloatArray, off: FloatArray, scratch: Scratch) -> None:
    """Lower ``scratch.margins`` to the distance from near barriers; ``scratch.met`` gets the binding ones.

    Distances from faces, in vectorised loops, exclude all but a few of the flights.
    """
    near, margins, met, ends, gap = scratch.near, scratch.margins, scratch.met, scratch.ends, scratch.gap
    met.t[:] = NOWHERE
    for t in range(len(mean) - 1):
        first, last = near.met_first[t], near.met_first[t + 1]
        if first == last:
            continue
        box = segment_box(near.box, t)
        for end in range(2):
            place_end(mean[t + end], off[t + end, 0], off[t + end, 1], ends[2 * end : 2 * end + 2])
        for k in range(first, last):
            part = near.met[k]
            least_gaps(model.faces, part, box, ends, gap)
            for i in range(len(margins)):
                if gap[i] >= margins[i]:
                    continue
                at, there = Point(ends[0, i], ends[1, i]), Point(ends[2, i], ends[3, i])
                event = segment_clearance(model.faces, model.corners, part, t, at, there, margins[i])
                if event.margin < margins[i]:
                    margins[i], met.t[i] = event.margin, t
                    met.nx[i], met.ny[i], met.share[i] = event.nx, event.ny, event.share


@shared_entry
def smoothed_failure(
    model: MarginModel, mean: FloatArray, off: FloatArray, width: float, slope: Slope, scratch: Scratch
) -> float:
    """Mean of σ(-m / ``width``) over the flights ``mean`` (T+1, 2) + ``off`` (T+1, 2, n).

    Adds its gradient with respect to ``mean`` and the convex part of its Hessian to ``slope``, and fills
    ``scratch.margins`` (n,) [m].

    Eqs. (M54) and (M55) of docs/mathematics_methods.md.
    """
    n, near, margins, met, limit = off.shape[2], scratch.near, scratch.margins, scratch.met, -CERTAIN
    enclose(mean, off, near.box)
    list_entered(model.shown, -SATURATED * width, near.box, near.shown_first, near.shown)
    hazards, crossed = model.logic.hazards, near.crossed  # farther hazards have no effect
    list_met(model.hazards, hazards, SATURATED * width, near.box, near.crossed_first, crossed)
    mission_margins(scratch.claims, model, mean, off, -SATURATED * width, scratch)
    for i in range(n):
        limit = max(limit, margins[i])
    list_met(model.faces, model.corners, limit, near.box, near.met_first, near.met)
    barrier_clearances(model, mean, off, scratch)
    total = 0.0
    for i in range(n):
        z = margins[i] / width
        if abs(z) > FLAT:
            total += 1.0 if z < 0.0 else 0.0
            continue
        f = 1.0 / (1.0 + math.exp(z))
        total += f
        event = Event(margins[i], met.t[i], met.nx[i], met.ny[i], met.share[i])
        if event.t == NOWHERE:
            event = numbered_event(model, mean, off[:, :, i], margins[i], scratch.event[i])
        if event.t != NOWHERE:
            add_failure_slope(slope, event, f, width, n)
    return float(total / n)
