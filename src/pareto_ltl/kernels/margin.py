"""How far a flight is from failing: the margin of its mission and of its clearance, with derivatives.

The margin of a flight is positive if it succeeds, negative if it fails, and says how far the positions would
have to move [m] for the verdict to change:

    m = min(mission margin, clearance of every barrier on every segment).

The mission margin is a max-min over the automaton. W_t(p) is the margin of "after step t the state is at
least as good as p":

    W_t(p) = max_q min(W_{t-1}(q), clearance of the letters that lose q, margin of {s : δ(q, s) ≥ p} at x_t),

and the mission margin is the largest W_T(p) of an accepting p. The margin of a set of letters is the signed
distance to its nearest face. One event binds, so that m is the signed distance of one point of the flight
from one line or corner, and its gradient is the unit vector from there.

The plain counterpart is :mod:`pareto_ltl.planning.reference_margin`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pareto_ltl.kernels.clearance import CERTAIN, Event, beyond_reach, lesser, segment_clearance
from pareto_ltl.kernels.data import Cells, Corners, Faces, Logic, Point
from pareto_ltl.kernels.geometry import locate_cell
from pareto_ltl.kernels.jit import entry, inlined, kernel
from pareto_ltl.kernels.letters import meet_hazards
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

NOWHERE = -1  # number, and step, of no event
SATURATED = 12.0  # widths of the sigmoid: a margin below so many counts as -CERTAIN, as one of 6e-6 less


class Guards(NamedTuple):
    """Transitions between claims "the state is at least as good as p", and the letters that make them.

    Edge e leads from ``source`` to ``target`` (E,) on letters ``letter[ptr[e]:ptr[e + 1]]``; where
    ``spared`` (E,) is true, on all letters but these, the empty one among them. ``patient`` says that the
    empty letter leaves every claim as it is. Edges ``first[q]`` to ``first[q + 1]`` lead from q; ``needs``
    (Q,) has the bits of the letters that every way from q to acceptance reads, 0 in small automata.
    """

    source: IntArray
    target: IntArray
    spared: BoolArray
    ptr: IntArray
    letter: IntArray
    patient: bool
    first: IntArray
    needs: IntArray


class MarginModel(NamedTuple):
    """What margins are measured to; a polygon's face k leads from its corner k to the next.

    ``shown`` are convex polygons that show a letter, ``first`` (M + 1,) the first polygon of each letter.
    ``faces`` and ``corners`` are the barriers: obstacles, and walls as one face without corners. ``hazards``
    are the faces of the cells ``logic.hazards``.
    """

    shown: Faces
    first: IntArray
    guards: Guards
    faces: Faces
    corners: Corners
    hazards: Faces
    cells: Cells
    logic: Logic


class Claims(NamedTuple):
    """W(p) of all claims (Q,) at one step: the margin, and the number of the event that binds
    (:func:`letter_number`, :func:`hazard_number`). Whole events in their place took three times as long.
    ``live`` lists the ``size[0]`` claims of a margin above -CERTAIN, ascending."""

    margin: FloatArray
    event: IntArray
    live: IntArray
    size: IntArray


class Scratch(NamedTuple):
    """Memory: claims ``before`` and ``after`` a step, margins of the letters ``shown`` (M,), the bits of
    those that may be read ``later`` than each step (T+1,), and the ``margins`` (n,) of the flights, which are
    kept."""

    before: Claims
    after: Claims
    shown: FloatArray
    later: IntArray
    margins: FloatArray


class Slope(NamedTuple):
    """Of the smoothed failure: gradient (T+1, 2) [1/m] and Hessian blocks xx, xy, yy (T+1, 3) [1/m²]."""

    gradient: FloatArray
    hessian: FloatArray


@kernel
def letter_margin(model: MarginModel, letter: int, t: int, at: Point, floor: float) -> Event:
    """Signed distance to the nearest face of the polygon of ``letter`` that holds ``at``, or misses it least.

    Below ``floor`` [m] it is not looked at any further.
    """
    faces, best = model.shown, Event(-CERTAIN, t, 0.0, 0.0, 0.0)
    for k in range(model.first[letter], model.first[letter + 1]):
        least, row = CERTAIN, -1
        for j in range(faces.ptr[k], faces.ptr[k + 1]):
            slack = faces.offset[j] - faces.normal[j, 0] * at.x - faces.normal[j, 1] * at.y
            if slack < least:
                least, row = slack, j
                if least <= best.margin or least < floor:
                    break
        if least > best.margin and least >= floor:
            best = Event(least, t, -faces.normal[row, 0], -faces.normal[row, 1], 0.0)
    return best


@kernel
def barrier_clearance(model: MarginModel, t: int, start: Point, end: Point, so_far: Event) -> Event:
    """``so_far``, or the clearance of a barrier that is less."""
    least = so_far
    for part in range(len(model.faces.ptr) - 1):
        if beyond_reach(model.corners, part, start, end, least.margin):
            continue
        met = segment_clearance(model.faces, model.corners, part, t, start, end, least.margin)
        least = lesser(least, met)
    return least


# --- numbers of events ------------------------------------------------------------------------


@inlined
def letter_number(model: MarginModel, t: int, letter: int, spared: bool) -> int:
    """The number of "letter read, or spared, at step t"."""
    return 2 * (t * len(model.first) + letter) + (1 if spared else 0)


@inlined
def hazard_number(model: MarginModel, t: int, hazard: int, met: bool) -> int:
    """The number of "hazard missed, or met, on the way from step t"."""
    return -2 - 2 * (t * len(model.logic.hazards.cell) + hazard) - (1 if met else 0)


@kernel
def numbered_event(
    model: MarginModel, mean: FloatArray, off: FloatArray, margin: float, number: int
) -> Event:
    """The event of a number, in the flight ``mean`` + ``off`` (T+1, 2)."""
    if number == NOWHERE:
        return Event(margin, NOWHERE, 0.0, 0.0, 0.0)
    if number >= 0:
        t, letter = divmod(number // 2, len(model.first))
        at = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        found = letter_margin(model, letter, t, at, -CERTAIN)
    else:
        t, hazard = divmod((-2 - number) // 2, len(model.logic.hazards.cell))
        start = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        end = Point(mean[t + 1, 0] + off[t + 1, 0], mean[t + 1, 1] + off[t + 1, 1])
        found = segment_clearance(model.hazards, model.logic.hazards, hazard, t, start, end, CERTAIN)
    sign = -1.0 if number % 2 == 1 else 1.0
    return Event(margin, t, sign * found.nx, sign * found.ny, found.share)


# --- the mission ------------------------------------------------------------------------------


@kernel
def guard_margin(guards: Guards, e: int, shown: FloatArray) -> tuple[float, int]:
    """Margin of the letters of edge ``e`` and which of them binds; ``shown`` (M,) has that of each."""
    spared = guards.spared[e]
    margin, binding = CERTAIN if spared else -CERTAIN, -1
    for k in range(guards.ptr[e], guards.ptr[e + 1]):
        letter = guards.letter[k]
        if spared and -shown[letter] < margin:
            margin, binding = -shown[letter], letter
        elif not spared and shown[letter] > margin:
            margin, binding = shown[letter], letter
    return margin, binding


@kernel
def enter_claim(claims: Claims, p: int, margin: float, event: int) -> None:
    """Give a claim its margin, and a place in the list if it had none."""
    if claims.margin[p] == -CERTAIN:
        k = claims.size[0]
        while k > 0 and claims.live[k - 1] > p:
            claims.live[k] = claims.live[k - 1]
            k -= 1
        claims.live[k] = p
        claims.size[0] += 1
    claims.margin[p], claims.event[p] = margin, event


@inlined
def clear_claims(claims: Claims) -> None:
    """Forget all claims."""
    for k in range(claims.size[0]):
        claims.margin[claims.live[k]] = -CERTAIN
    claims.size[0] = 0


@kernel
def look_back(model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, later: IntArray) -> None:
    """Fill ``later``: the letters that may be read after each step, of at most 62."""
    seen = 0
    for t in range(len(mean) - 1, -1, -1):
        later[t] = seen
        at = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        for letter in range(len(model.first) - 1):
            if letter_margin(model, letter, t, at, floor).margin > -CERTAIN:
                seen |= 1 << letter


@kernel
def read_letters(
    model: MarginModel, t: int, at: Point, floor: float, before: Claims, after: Claims, scratch: Scratch
) -> bool:
    """W_t from W_{t-1} where no letter is met on the way; False where it stays as it was.

    Margins below ``floor`` count as certain failure. Claims that need a letter which the flight does not read
    any more are dropped. Where no letter is near, nothing is to be done: 0.7 instead of 2.1 ms for 300
    flights of 53 steps.
    """
    guards, none, shown = model.guards, model.guards.patient, scratch.shown
    for letter in range(len(shown)):
        shown[letter] = letter_margin(model, letter, t, at, floor).margin
        none = none and shown[letter] == -CERTAIN
    if none:
        return False
    clear_claims(after)
    for k in range(before.size[0]):
        q = before.live[k]
        for e in range(guards.first[q], guards.first[q + 1]):
            p = guards.target[e]
            if before.margin[q] <= after.margin[p] or guards.needs[p] & ~scratch.later[t] != 0:
                continue
            margin, letter = guard_margin(guards, e, shown)
            if before.margin[q] <= margin:
                enter_claim(after, p, before.margin[q], before.event[q])
            elif margin > after.margin[p]:
                enter_claim(after, p, margin, letter_number(model, t, letter, guards.spared[e]))
    return True


@kernel
def cross_hazards(
    model: MarginModel, t: int, start: Point, end: Point, ends: tuple[int, int], claims: Claims, state: int
) -> int:
    """Lower each claim to the clearance of what loses it; return the state in which the end is read.

    The flight's own ``state`` is followed through the hazards that it meets, and stays as certain as the
    nearest of them is from being missed, or met. ``ends`` are the cells of the segment's ends, which are
    read as letters of steps.
    """
    logic, cells = model.logic, model.logic.hazards.cell
    first, last = ends
    reads, own = logic.delta[state, first] == state, state  # otherwise the formula counts steps
    if reads and (first != last or first < 0):
        own = meet_hazards(model.cells, logic, state, start, first, end, last)
    held, event = claims.margin[state], claims.event[state]
    for h in range(len(cells)):
        if cells[h] == first or cells[h] == last:
            continue
        margin = segment_clearance(model.hazards, logic.hazards, h, t, start, end, CERTAIN).margin
        number = hazard_number(model, t, h, False)
        for k in range(claims.size[0]):
            q = claims.live[k]
            if logic.loses[q, cells[h]] and margin < claims.margin[q]:
                claims.margin[q], claims.event[q] = margin, number
        if reads and logic.harm[state, cells[h]] and abs(margin) < held:
            held, event = abs(margin), hazard_number(model, t, h, margin < 0.0)
    if held > claims.margin[own]:
        enter_claim(claims, own, held, event)
    return own


# --- whole flights ----------------------------------------------------------------------------


@kernel
def read_at_steps(
    model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, scratch: Scratch
) -> Claims:  # fmt: skip
    """W_T where no letter is read between steps."""
    before, after = scratch.before, scratch.after
    for t in range(len(mean)):
        at = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        if read_letters(model, t, at, floor, before, after, scratch):
            before, after = after, before
    return before


@kernel
def read_on_the_way(
    model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, scratch: Scratch
) -> Claims:  # fmt: skip
    """W_T where hazards are read between steps."""
    logic, before, after = model.logic, scratch.before, scratch.after
    at, cell, state = Point(mean[0, 0] + off[0, 0], mean[0, 1] + off[0, 1]), -1, int(logic.initial)
    for t in range(len(mean)):
        there = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        last = locate_cell(model.cells, there)
        if t > 0:
            state = cross_hazards(model, t - 1, at, there, (cell, last), before, state)
        state, cell, at = int(logic.delta[state, last]), last, there
        if read_letters(model, t, there, floor, before, after, scratch):
            before, after = after, before
    return before


@kernel
def mission_margin(
    model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, scratch: Scratch
) -> Event:  # fmt: skip
    """Largest W_T of an accepting claim of the flight ``mean`` + ``off`` (T+1, 2)."""
    logic = model.logic
    clear_claims(scratch.before)
    clear_claims(scratch.after)
    enter_claim(scratch.before, logic.initial, CERTAIN, NOWHERE)
    if model.guards.needs[logic.initial] != 0:
        look_back(model, mean, off, floor, scratch.later)
    if len(logic.hazards.cell) > 0:
        claims = read_on_the_way(model, mean, off, floor, scratch)
    else:
        claims = read_at_steps(model, mean, off, floor, scratch)
    margin, number = -CERTAIN, NOWHERE
    for k in range(claims.size[0]):
        p = claims.live[k]
        if logic.distance[p] == 0.0 and claims.margin[p] > margin:
            margin, number = claims.margin[p], claims.event[p]
    return numbered_event(model, mean, off, margin, number)


@kernel
def flight_clearance(model: MarginModel, mean: FloatArray, off: FloatArray, so_far: Event) -> Event:
    """``so_far``, or the least clearance of a barrier on any segment of the flight."""
    least, at = so_far, Point(mean[0, 0] + off[0, 0], mean[0, 1] + off[0, 1])
    for t in range(1, len(mean)):
        there = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        least = barrier_clearance(model, t - 1, at, there, least)
        at = there
    return least


@kernel
def add_slope(slope: Slope, event: Event, first: float, second: float) -> None:
    """Add first and second derivative of a function of the margin, at the ends of the binding segment.

    The block-diagonal Hessian w n n' at an end of weight w lies above the true one: w0² + w0 w1 = w0.
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


@entry
def smoothed_failure(
    model: MarginModel, mean: FloatArray, off: FloatArray, width: float, slope: Slope, scratch: Scratch
) -> float:
    """Mean of σ(-m / ``width``) over the flights ``mean`` (T+1, 2) + ``off`` (n, T+1, 2).

    Adds its derivatives with respect to ``mean`` to ``slope``, of the second only the convex part, and fills
    ``scratch.margins`` (n,) [m].
    """
    total, n = 0.0, len(off)
    for i in range(n):
        event = mission_margin(model, mean, off[i], -SATURATED * width, scratch)
        event = flight_clearance(model, mean, off[i], event)
        scratch.margins[i] = event.margin
        z = event.margin / width
        if abs(z) > 3.0 * SATURATED:
            total += 1.0 if z < 0.0 else 0.0
            continue
        f = 1.0 / (1.0 + math.exp(z))
        total += f
        if event.t >= 0:
            first = -f * (1.0 - f) / width
            add_slope(slope, event, first / n, -first * max(1.0 - 2.0 * f, 0.0) / width / n)
    return total / n
