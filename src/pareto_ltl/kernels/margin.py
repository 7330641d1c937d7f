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

from pareto_ltl.kernels.data import Cells, Corners, Faces, Logic, Point
from pareto_ltl.kernels.geometry import locate_cell
from pareto_ltl.kernels.jit import entry, inlined, kernel
from pareto_ltl.kernels.letters import meet_hazards
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

CERTAIN = 1e18  # [m] margin of what cannot fail
TINY = 1e-300
NOWHERE = -1  # number, and step, of no event
SATURATED = 12.0  # widths of the sigmoid: a margin below so many counts as -CERTAIN, as one of 6e-6 less


class Guards(NamedTuple):
    """Transitions between claims "the state is at least as good as p", and the letters that make them.

    Edge e leads from ``source`` to ``target`` (E,) on letters ``letter[ptr[e]:ptr[e + 1]]``; where
    ``spared`` (E,) is true, on all letters but these, the empty one among them. ``patient`` says that the
    empty letter leaves every claim as it is.
    """

    source: IntArray
    target: IntArray
    spared: BoolArray
    ptr: IntArray
    letter: IntArray
    patient: bool


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


class Event(NamedTuple):
    """A signed distance [m] and what it is measured by: the unit ``normal`` (nx, ny) at the point ``share``
    of the way from step ``t`` to the next."""

    margin: float
    t: int
    nx: float
    ny: float
    share: float


class Claims(NamedTuple):
    """W(p) of all claims (Q,) at one step: the margin, and the number of the event that binds
    (:func:`letter_number`, :func:`hazard_number`). Whole events in their place took three times as long."""

    margin: FloatArray
    event: IntArray


class Scratch(NamedTuple):
    """Memory: claims ``before`` and ``after`` a step, margins of the letters ``shown`` (M,), and the
    ``margins`` (n,) of the flights, which are kept."""

    before: Claims
    after: Claims
    shown: FloatArray
    margins: FloatArray


class Slope(NamedTuple):
    """Of the smoothed failure: gradient (T+1, 2) [1/m] and Hessian blocks xx, xy, yy (T+1, 3) [1/m²]."""

    gradient: FloatArray
    hessian: FloatArray


@kernel
def lesser(one: Event, other: Event) -> Event:
    """The event of the smaller margin."""
    return other if other.margin < one.margin else one


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
def face_clearance(
    faces: Faces, part: int, t: int, start: Point, end: Point, enough: float
) -> tuple[Event, int]:
    """Distance of a segment from the best separating face, and that face; stops at ``enough``."""
    best, row = Event(-CERTAIN, t, 0.0, 0.0, 0.0), -1
    for j in range(faces.ptr[part], faces.ptr[part + 1]):
        nx, ny = faces.normal[j, 0], faces.normal[j, 1]
        a = nx * start.x + ny * start.y - faces.offset[j]
        b = nx * end.x + ny * end.y - faces.offset[j]
        if min(a, b) > best.margin:
            best, row = Event(a, t, nx, ny, 0.0) if a < b else Event(b, t, nx, ny, 1.0), j
            if best.margin >= enough:
                break
    return best, row


@kernel
def beside_edge(corners: Corners, part: int, edge: int, at: Point) -> bool:
    """Whether the point of an edge's line that is nearest to ``at`` lies on the edge."""
    first = corners.ptr[part] + edge
    last = first + 1 if first + 1 < corners.ptr[part + 1] else corners.ptr[part]
    px, py = corners.corner[first, 0], corners.corner[first, 1]
    ex, ey = corners.corner[last, 0] - px, corners.corner[last, 1] - py
    along = ex * (at.x - px) + ey * (at.y - py)
    return bool(0.0 <= along <= ex * ex + ey * ey)


@kernel
def segment_clearance(
    faces: Faces, corners: Corners, part: int, t: int, start: Point, end: Point, enough: float
) -> Event:
    """Distance of a segment from a convex polygon; where they meet, minus the depth to which they do.

    The depth is the least along a face or the segment's own normal. Apart, a corner is nearest, or one end of
    the segment beside an edge. The search stops where the distance is known to be ``enough``.
    """
    best, row = face_clearance(faces, part, t, start, end, enough)
    first, last = corners.ptr[part], corners.ptr[part + 1]
    if best.margin >= enough or first == last:
        return best
    dx, dy = end.x - start.x, end.y - start.y
    length = math.sqrt(dx * dx + dy * dy)
    dx, dy = (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)  # a point has every normal
    low, high, at_low, at_high = CERTAIN, -CERTAIN, 0.0, 0.0
    near, rx, ry, at_near = CERTAIN, 0.0, 0.0, 0.0
    for c in range(first, last):
        px, py = corners.corner[c, 0] - start.x, corners.corner[c, 1] - start.y
        across, along = dx * py - dy * px, dx * px + dy * py
        if across < low:
            low, at_low = across, along
        if across > high:
            high, at_high = across, along
        beyond = along - min(max(along, 0.0), length)
        square = across * across + beyond * beyond
        if square < near:
            near, rx, ry, at_near = square, beyond * dx - across * dy, beyond * dy + across * dx, along
    nearest = end if best.share > 0.0 else start
    if best.margin > 0.0 and beside_edge(corners, part, row - faces.ptr[part], nearest):
        return best
    length = max(length, TINY)
    if best.margin > 0.0 or low > 0.0 or high < 0.0:
        near = max(math.sqrt(near), TINY)
        return Event(near, t, -rx / near, -ry / near, min(max(at_near / length, 0.0), 1.0))
    if low > best.margin:  # the polygon lies to the left: the segment must stay right of it
        best = Event(low, t, dy, -dx, min(max(at_low / length, 0.0), 1.0))
    if -high > best.margin:
        best = Event(-high, t, -dy, dx, min(max(at_high / length, 0.0), 1.0))
    return best


@kernel
def beyond_reach(corners: Corners, part: int, start: Point, end: Point, reach: float) -> bool:
    """Whether a polygon is farther than ``reach`` from a segment, by its circle."""
    dx, dy = 0.5 * (end.x - start.x), 0.5 * (end.y - start.y)
    far = corners.radius[part] + math.sqrt(dx * dx + dy * dy) + max(reach, 0.0)
    ax, ay = corners.middle[part, 0] - start.x - dx, corners.middle[part, 1] - start.y - dy
    return bool(ax * ax + ay * ay > far * far)


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
def read_letters(
    model: MarginModel, t: int, at: Point, floor: float, before: Claims, after: Claims, shown: FloatArray
) -> bool:
    """W_t from W_{t-1} where no letter is met on the way; False where it stays as it was.

    Margins below ``floor`` count as certain failure; ``shown`` (M,) is scratch. Where no letter is near,
    nothing is to be done: 0.7 instead of 2.1 ms for 300 flights of 53 steps.
    """
    guards, none = model.guards, model.guards.patient
    for letter in range(len(shown)):
        shown[letter] = letter_margin(model, letter, t, at, floor).margin
        none = none and shown[letter] == -CERTAIN
    if none:
        return False
    for p in range(len(after.margin)):
        after.margin[p] = -CERTAIN
    for e in range(len(guards.source)):
        q, p = guards.source[e], guards.target[e]
        if before.margin[q] <= after.margin[p]:
            continue
        margin, letter = guard_margin(guards, e, shown)
        if before.margin[q] <= margin:
            after.margin[p], after.event[p] = before.margin[q], before.event[q]
        elif margin > after.margin[p]:
            after.margin[p], after.event[p] = margin, letter_number(model, t, letter, guards.spared[e])
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
        for q in range(len(claims.margin)):
            if logic.loses[q, cells[h]] and margin < claims.margin[q]:
                claims.margin[q], claims.event[q] = margin, number
        if reads and logic.harm[state, cells[h]] and abs(margin) < held:
            held, event = abs(margin), hazard_number(model, t, h, margin < 0.0)
    if held > claims.margin[own]:
        claims.margin[own], claims.event[own] = held, event
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
        if read_letters(model, t, at, floor, before, after, scratch.shown):
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
        if read_letters(model, t, there, floor, before, after, scratch.shown):
            before, after = after, before
    return before


@kernel
def mission_margin(
    model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, scratch: Scratch
) -> Event:  # fmt: skip
    """Largest W_T of an accepting claim of the flight ``mean`` + ``off`` (T+1, 2)."""
    logic, first = model.logic, scratch.before
    for p in range(len(first.margin)):
        first.margin[p], first.event[p] = -CERTAIN, NOWHERE
    first.margin[logic.initial] = CERTAIN
    if len(logic.hazards.cell) > 0:
        claims = read_on_the_way(model, mean, off, floor, scratch)
    else:
        claims = read_at_steps(model, mean, off, floor, scratch)
    margin, number = -CERTAIN, NOWHERE
    for p in range(len(claims.margin)):
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
