"""Mission margins of many flights at a time, vectorised over flights.

Loops over rows are vectorised, while branches on single flights are mispredicted. Only segments with a hazard
near are judged flight by flight, which :mod:`plane_logic.claim_lists` does for all, unless all hazards
bar the way.
"""

from __future__ import annotations

from typing import NamedTuple

from plane_kernels.boxes import least_gaps, place_end, segment_box
from plane_kernels.clearance import CERTAIN, segment_clearance
from plane_kernels.geometry import locate_cell
from plane_kernels.types import BoolArray, FloatArray, IntArray, Point
from plane_logic.claim_lists import Claims, cross_hazards
from plane_logic.letters import epoch_at
from plane_logic.margin_events import (
    NOWHERE,
    MarginModel,
    Near,
    Scratch,
    hazard_number,
    letter_number,
    mission_margins,
)  # fmt: skip
from typed_kernels.jit import implements, kernel

BLOCK = 256  # flights at a time: their rows fit into the L1 cache


class Rows(NamedTuple):
    """W(p) of all claims at one step (Q, n): ``margin`` [m] and the numbers ``event`` of the binding events.

    Only rows with ``live`` (Q,) are valid.
    """

    margin: FloatArray
    event: IntArray
    live: BoolArray


class ClaimRows(NamedTuple):
    """Scratch memory: rows ``before`` and ``after`` a step, and temporary rows.

    ``shown`` (M, n): margins of the letters for which ``near`` (M,) is true [m]. ``margin`` (2, n) and
    ``event`` (n,) are temporary: values of one polygon, and of a claim behind an edge. With hazards,
    ``state`` (n,) is the automaton state of each flight, and ``ends`` (4, n) and ``flight`` are temporary:
    the segments of one step, and the claims of one flight. ``useful`` (T+1, Q) are the claims after each step
    from which the letters near later steps lead to acceptance.
    """

    before: Rows
    after: Rows
    shown: FloatArray
    near: BoolArray
    margin: FloatArray
    event: IntArray
    state: IntArray
    ends: FloatArray
    flight: Claims
    useful: BoolArray


@kernel
def fill_row(margin: FloatArray, event: IntArray, margins: FloatArray, events: IntArray) -> None:
    """Copy ``margins`` and ``events`` into ``margin`` and ``event`` (n,)."""
    for i in range(len(margin)):
        margin[i], event[i] = margins[i], events[i]


@kernel
def lower_to_face(
    normal: FloatArray, offset: float, mean: FloatArray, x: FloatArray, y: FloatArray, margins: FloatArray
) -> None:
    """Lower ``margins`` (n,) to the distances of ``mean`` + (``x``, ``y``) from a face, positive inside."""
    nx, ny, east, north = normal[0], normal[1], mean[0], mean[1]
    for i in range(len(margins)):
        slack = offset - nx * (east + x[i]) - ny * (north + y[i])
        margins[i] = min(margins[i], slack)


@kernel
def raise_row(margins: FloatArray, others: FloatArray) -> None:
    """Raise each of ``margins`` (n,) to the value in ``others`` if it is larger."""
    for i in range(len(margins)):
        margins[i] = max(margins[i], others[i])


@kernel
def read_shown(
    model: MarginModel, near: Near, t: int, mean: FloatArray, x: FloatArray, y: FloatArray, rows: ClaimRows
) -> None:
    """Fill ``rows.shown`` and ``rows.near`` at step ``t``, for n positions ``mean`` (2,) + (``x``, ``y``)."""
    faces, n = model.shown, len(x)
    rows.near[:] = False
    for k in range(near.shown_first[t], near.shown_first[t + 1]):
        letter = model.letter[near.shown[k]]
        margins = rows.margin[0, :n] if rows.near[letter] else rows.shown[letter, :n]
        margins[:] = CERTAIN
        for j in range(faces.ptr[near.shown[k]], faces.ptr[near.shown[k] + 1]):
            lower_to_face(faces.normal[j], faces.offset[j], mean, x, y, margins)
        if rows.near[letter]:
            raise_row(rows.shown[letter, :n], margins)
        rows.near[letter] = True


@kernel
def lower(margin: FloatArray, event: IntArray, limit: FloatArray, sign: float, number: int) -> None:
    """Lower ``margin`` (n,) to ``sign`` times ``limit``; where it is lowered, set ``event`` to ``number``."""
    for i in range(len(margin)):
        less = sign * limit[i] < margin[i]
        margin[i] = sign * limit[i] if less else margin[i]
        event[i] = number if less else event[i]


@kernel
def enter_row(rows: Rows, p: int, margin: FloatArray, event: IntArray) -> None:
    """Raise row ``p`` of ``rows`` to the new margins, flight by flight; the row becomes live."""
    n = len(margin)
    own, events = rows.margin[p, :n], rows.event[p, :n]
    if not rows.live[p]:
        rows.live[p] = True
        fill_row(own, events, margin, event)
        return
    for i in range(n):
        better = margin[i] > own[i]
        own[i] = margin[i] if better else own[i]
        events[i] = event[i] if better else events[i]


@kernel
def follow_edge(
    model: MarginModel, e: int, q: int, t: int, rows: ClaimRows, before: Rows, after: Rows, n: int
) -> None:
    """Raise the row of the target of edge ``e`` in ``after`` by the margins of claim ``q`` in ``before``.

    They are limited by the margin of the best letter of the edge or, for an edge that excludes its letters,
    by the margin of missing all of them.
    """
    guards, p, spared = model.guards, model.guards.target[e], model.guards.spared[e]
    own, events = before.margin[q, :n], before.event[q, :n]
    margin, event, lowered = rows.margin[1, :n], rows.event[:n], False
    for k in range(guards.ptr[e], guards.ptr[e + 1]):
        letter = guards.letter[k]
        if not rows.near[letter]:
            continue
        if not (spared and lowered):
            fill_row(margin, event, own, events)
        lowered = True
        sign = -1.0 if spared else 1.0
        lower(margin, event, rows.shown[letter, :n], sign, letter_number(model, t, letter, spared))
        if not spared:
            enter_row(after, p, margin, event)
    if spared and lowered:
        enter_row(after, p, margin, event)
    elif spared:
        enter_row(after, p, own, events)


@kernel
def measure_hazards(model: MarginModel, near: Near, t: int, rows: ClaimRows) -> None:
    """Fill ``rows.margin[1]`` with lower limits of the distances of ``rows.ends`` from near hazards."""
    gap, nearest, box = rows.margin[0], rows.margin[1], segment_box(near.box, t)
    nearest[:] = CERTAIN
    for k in range(near.crossed_first[t], near.crossed_first[t + 1]):
        least_gaps(model.hazards, near.crossed[k], box, rows.ends, gap)
        for i in range(len(nearest)):
            nearest[i] = min(nearest[i], gap[i])


@kernel
def limit_reach(claims: Rows, reach: float, within: FloatArray) -> None:
    """Fill ``within`` (n,) with the distances beyond which a hazard neither lowers a claim nor is met [m]."""
    within[:] = 0.0
    for p in range(len(claims.live)):
        if claims.live[p]:
            raise_row(within, claims.margin[p])
    for i in range(len(within)):
        within[i] = min(within[i], reach)


@kernel
def cross_segment(
    model: MarginModel, near: Near, t: int, reach: float, rows: ClaimRows, claims: Rows, n: int
) -> None:
    """:func:`cross_hazards` from step ``t`` for the first n segments of ``rows.ends``.

    Only for those closer to a hazard than ``reach`` and the largest margin of their claims.
    """
    measure_hazards(model, near, t, rows)
    nearest, within, ends, one, begun = rows.margin[1], rows.margin[0, :n], rows.ends, rows.flight, False
    limit_reach(claims, reach, within)
    for i in range(n):
        if nearest[i] > within[i]:
            continue
        if not begun:
            begun = True
            for p in range(len(claims.live)):
                if not claims.live[p]:
                    claims.margin[p, :n] = -CERTAIN
                    claims.event[p, :n] = NOWHERE
        start, end = Point(ends[0, i], ends[1, i]), Point(ends[2, i], ends[3, i])
        one.size[0] = 0
        for p in range(len(claims.live)):
            one.margin[p], one.event[p] = claims.margin[p, i], claims.event[p, i]
            if one.margin[p] > -CERTAIN:
                one.live[one.size[0]] = p
                one.size[0] += 1
        cells = locate_cell(model.cells, start), locate_cell(model.cells, end)
        rows.state[i] = cross_hazards(model, t, start, end, cells, one, rows.state[i], near)
        for k in range(one.size[0]):
            p = one.live[k]
            claims.margin[p, i], claims.event[p, i] = one.margin[p], one.event[p]
            claims.live[p] = True


@kernel
def loses_any(loses: BoolArray, cell: int, live: BoolArray) -> bool:
    """Whether the label of ``cell`` loses one of the ``live`` claims (Q,); ``loses`` (Q, C + 1)."""
    found = False
    for q in range(len(live)):
        found = found or (live[q] and loses[q, cell])
    return found


@kernel
def bar_claims(
    model: MarginModel, near: Near, t: int, reach: float, rows: ClaimRows, claims: Rows, n: int
) -> None:
    """:func:`cross_segment` for hazards that bar the way.

    No automaton state is needed.
    """
    hazards, loses = model.logic.hazards, model.logic.loses[epoch_at(model.logic.epoch, t + 1)]
    gap, within, ends, box = rows.margin[0], rows.margin[1, :n], rows.ends, segment_box(near.box, t)
    limit_reach(claims, reach, within)
    for k in range(near.crossed_first[t], near.crossed_first[t + 1]):
        h = near.crossed[k]
        cell, number = hazards.cell[h], hazard_number(model, t, h, False)
        if not loses_any(loses, cell, claims.live):
            continue
        least_gaps(model.hazards, h, box, ends, gap)
        for i in range(n):
            if gap[i] >= within[i]:
                continue
            start, end = Point(ends[0, i], ends[1, i]), Point(ends[2, i], ends[3, i])
            margin = segment_clearance(model.hazards, hazards, h, t, start, end, within[i]).margin
            if margin <= 0.0 and cell in (locate_cell(model.cells, start), locate_cell(model.cells, end)):
                continue  # its label is read at the step
            for q in range(len(claims.live)):
                if claims.live[q] and loses[q, cell] and margin < claims.margin[q, i]:
                    claims.margin[q, i], claims.event[q, i] = margin, number


@kernel
def follow_states(model: MarginModel, t: int, rows: ClaimRows, n: int) -> None:
    """Read the labels of step ``t`` in ``rows.state``; the label is the empty one outside of all letters."""
    delta, column = model.logic.delta[epoch_at(model.logic.epoch, t)], rows.event
    column[:] = -1
    for letter in range(len(rows.near)):
        if rows.near[letter]:
            for i in range(n):
                column[i] = model.column[letter] if rows.shown[letter, i] >= 0.0 else column[i]
    for i in range(n):
        rows.state[i] = delta[rows.state[i], column[i]]


@kernel
def is_read(model: MarginModel, near: Near, t: int, e: int) -> bool:
    """Whether a polygon that shows a letter of edge ``e`` is near step ``t``."""
    guards = model.guards
    for k in range(near.shown_first[t], near.shown_first[t + 1]):
        for j in range(guards.ptr[e], guards.ptr[e + 1]):
            if model.letter[near.shown[k]] == guards.letter[j]:
                return True
    return False


@kernel
def mark_useful(model: MarginModel, near: Near, useful: BoolArray) -> None:
    """Fill ``useful`` (T+1, Q), backwards from the accepting claims at the end.

    All claims are useful with hazards that do not bar the way: meeting one may lead to acceptance. With 47
    that do, a flight takes 23 instead of 62 ns a step: hazards that only lose other claims are left out.
    """
    guards, last = model.guards, len(near.box) - 1
    useful[:] = len(model.logic.hazards.cell) > 0 and not guards.barring
    for q in range(len(model.logic.distance)):
        useful[last, q] = model.logic.distance[q] == 0.0
    for t in range(last, 0, -1):
        edges = guards.first[epoch_at(model.logic.epoch, t)]
        for q in range(len(model.logic.distance)):
            for e in range(edges[q], edges[q + 1]):
                if useful[t, guards.target[e]] and (guards.spared[e] or is_read(model, near, t, e)):
                    useful[t - 1, q] = True


@kernel
def claims_at_end(
    model: MarginModel, near: Near, mean: FloatArray, off: FloatArray, first: int, n: int, reach: float,
    rows: ClaimRows,
) -> Rows:  # fmt: skip
    """W_T of flights ``first`` to ``first + n`` of ``mean`` (T+1, 2) + ``off`` (T+1, 2, N).

    Hazards at least ``reach`` [m] from a segment have no effect.
    """
    before, after, guards, last = rows.before, rows.after, model.guards, first + n
    before.live[:] = False
    before.live[model.logic.initial] = True
    before.margin[model.logic.initial, :n] = CERTAIN
    before.event[model.logic.initial, :n] = NOWHERE
    rows.state[:] = model.logic.initial
    hazardous, crossed = len(model.logic.hazards.cell) > 0, False
    for t in range(len(mean)):
        x, y = off[t, 0, first:last], off[t, 1, first:last]
        if crossed:
            place_end(mean[t], x, y, rows.ends[2:])
            if guards.barring:
                bar_claims(model, near, t - 1, reach, rows, before, n)
            else:
                cross_segment(model, near, t - 1, reach, rows, before, n)
        shown = near.shown_first[t] < near.shown_first[t + 1]
        crossed = hazardous and t + 1 < len(mean) and near.crossed_first[t] < near.crossed_first[t + 1]
        if crossed:
            place_end(mean[t], x, y, rows.ends[:2])
        if not shown and guards.patient:
            for q in range(len(before.live)):
                before.live[q] = before.live[q] and rows.useful[t, q]
            continue
        edges = guards.first[epoch_at(model.logic.epoch, t)]
        read_shown(model, near, t, mean[t], x, y, rows)
        if hazardous and not guards.barring:
            follow_states(model, t, rows, n)
        after.live[:] = False
        for q in range(len(before.live)):
            if before.live[q]:
                for e in range(edges[q], edges[q + 1]):
                    if rows.useful[t, guards.target[e]]:
                        follow_edge(model, e, q, t, rows, before, after, n)
        before, after = after, before
    return before


@implements(mission_margins, ClaimRows)
def _in_blocks(
    claims: ClaimRows, model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, scratch: Scratch
) -> None:
    mark_useful(model, scratch.near, claims.useful)
    for first in range(0, off.shape[2], BLOCK):
        last = min(first + BLOCK, off.shape[2])
        margins, events = scratch.margins[first:last], scratch.event[first:last]
        margins[:] = -CERTAIN
        events[:] = NOWHERE
        rows = claims_at_end(model, scratch.near, mean, off, first, last - first, -floor, claims)
        for p in range(len(rows.live)):
            if not rows.live[p] or model.logic.distance[p] != 0.0:
                continue
            for i in range(last - first):
                if rows.margin[p, i] > margins[i] and rows.margin[p, i] >= floor:
                    margins[i], events[i] = rows.margin[p, i], rows.event[p, i]
