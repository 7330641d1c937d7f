"""Mission margins, one flight at a time: for large automata."""

from __future__ import annotations

from typing import NamedTuple

from plane_kernels.clearance import CERTAIN, beyond_reach, segment_clearance
from plane_kernels.geometry import locate_cell
from plane_kernels.types import BoolArray, FloatArray, IntArray, Point
from plane_logic.letters import epoch_at, meet_hazards, rests
from plane_logic.margin_events import (
    NOWHERE,
    Guards,
    MarginModel,
    Near,
    Scratch,
    hazard_number,
    letter_number,
    mission_margins,
    part_margin,
)  # fmt: skip
from typed_kernels.jit import implements, inlined, kernel


class Claims(NamedTuple):
    """W(p) of all claims (Q,) at one step: ``margin`` [m], and the number ``event`` of the binding event.

    Event numbers come from :func:`letter_number` and :func:`hazard_number`; storing whole events takes
    three times as long. ``live`` (Q,) lists the ``size[0]`` claims with a margin above -CERTAIN, ascending.
    """

    margin: FloatArray
    event: IntArray
    live: IntArray
    size: IntArray


class ClaimLists(NamedTuple):
    """Scratch memory: claims ``before`` and ``after`` a step, and margins of letters.

    ``shown`` (M,): margin of each letter at the current step [m]; ``later`` (T+1,): bit set of the letters
    that may be read after each step.
    """

    before: Claims
    after: Claims
    shown: FloatArray
    later: IntArray


@kernel
def letter_margins(
    model: MarginModel, t: int, at: Point, floor: float, lists: ClaimLists, near: Near
) -> bool:
    """Fill ``lists.shown`` with the margins of all letters at step ``t``; True if any is above ``floor`` [m].

    The other margins are set to -``CERTAIN``.
    """
    shown, found = lists.shown, False
    for letter in range(len(shown)):
        shown[letter] = -CERTAIN
    for k in range(near.shown_first[t], near.shown_first[t + 1]):
        part = near.shown[k]
        letter = model.letter[part]
        least, _ = part_margin(model.shown, part, at, max(floor, shown[letter]))
        if least > -CERTAIN:
            shown[letter], found = least, True
    return found


@kernel
def guard_margin(guards: Guards, e: int, shown: FloatArray) -> tuple[float, int]:
    """Margin of edge ``e`` from the margins of letters, ``shown`` (M,), and the letter that binds, or -1."""
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
    """Set margin and event of claim ``p``; insert it into the list of live claims if it is not there."""
    if claims.margin[p] == -CERTAIN:
        k = claims.size[0]
        while k > 0 and claims.live[k - 1] > p:
            claims.live[k] = claims.live[k - 1]
            k -= 1
        claims.live[k] = p
        claims.size[0] += 1
    claims.margin[p], claims.event[p] = margin, event


@kernel
def is_needless(covers: BoolArray, claims: Claims, p: int, margin: float) -> bool:
    """Whether a live claim that covers ``p`` has at least the given margin."""
    for k in range(claims.size[0]):
        q = claims.live[k]
        if claims.margin[q] >= margin and covers[q, p]:
            return True
    return False


@kernel
def drop_needless(covers: BoolArray, claims: Claims) -> None:
    """Drop each claim that another one covers with at least its margin; of equal claims, one is kept."""
    count, kept = claims.size[0], 0
    for k in range(count):
        q = claims.live[k]
        margin = claims.margin[q]
        claims.margin[q] = -CERTAIN  # it is not compared with itself
        needless = False
        for j in range(count):
            p = claims.live[j]
            if (j < kept or j > k) and claims.margin[p] >= margin and covers[p, q]:
                needless = True
                break
        if not needless:
            claims.margin[q], claims.live[kept] = margin, q
            kept += 1
    claims.size[0] = kept


@inlined
def clear_claims(claims: Claims) -> None:
    """Remove all claims."""
    for k in range(claims.size[0]):
        claims.margin[claims.live[k]] = -CERTAIN
    claims.size[0] = 0


@kernel
def look_back(
    model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, lists: ClaimLists, near: Near
) -> None:
    """Fill ``lists.later``: bit sets of the letters (at most 62) that may be read after each step."""
    seen = 0
    for t in range(len(mean) - 1, -1, -1):
        lists.later[t] = seen
        at = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        if letter_margins(model, t, at, floor, lists, near):
            for letter in range(len(lists.shown)):
                if lists.shown[letter] > -CERTAIN:
                    seen |= 1 << letter


@kernel
def read_letters(
    model: MarginModel,
    t: int,
    at: Point,
    floor: float,
    before: Claims,
    after: Claims,
    lists: ClaimLists,
    near: Near,
) -> bool:
    """Fill ``after`` with W_t from W_{t-1} in ``before``, by the letters at step ``t``.

    Returns False, and leaves ``after`` as it is, if W does not change. Letter margins that are not above
    ``floor`` [m] count as certain failure. Dropped are claims that need a letter which the flight does not
    read later and, without hazards, claims that another one covers with at least their margin: for a mission
    that visits n regions, n + 1 claims remain of 2^n. (With hazards, a hazard may lose only the covering
    claim.) Steps without a letter near are skipped.
    """
    guards, shown, covers = model.guards, lists.shown, model.logic.covers
    edges = guards.first[epoch_at(model.logic.epoch, t)]
    free = len(model.logic.hazards.cell) == 0
    if not letter_margins(model, t, at, floor, lists, near) and guards.patient:
        return False
    clear_claims(after)
    for k in range(before.size[0]):
        q = before.live[k]
        for e in range(edges[q], edges[q + 1]):
            p = guards.target[e]
            if before.margin[q] <= after.margin[p] or guards.needs[p] & ~lists.later[t] != 0:
                continue
            margin, letter = guard_margin(guards, e, shown)
            event = before.event[q]
            if margin < before.margin[q]:
                event = letter_number(model, t, letter, guards.spared[e])
            margin = min(margin, before.margin[q])
            if margin > after.margin[p] and not (free and is_needless(covers, after, p, margin)):
                enter_claim(after, p, margin, event)
    if free:
        drop_needless(covers, after)
    return True


@kernel
def cross_hazards(
    model: MarginModel, t: int, start: Point, end: Point, ends: tuple[int, int], claims: Claims, state: int,
    near: Near,
) -> int:  # fmt: skip
    """Lower the margin of each claim to the distance from the hazards that lose it, between two steps.

    Returns the automaton state of the flight at ``end``, before the label there is read. This state follows
    from ``state`` by the hazards that the segment meets; its margin is the smallest distance by which one of
    the hazards would be missed, or met. ``ends`` are the cells of the two ends, which are read as labels of
    steps. Hazards that are far from all flights, or farther than all margins that they could lower, are
    skipped.
    """
    logic, cells, e = model.logic, model.logic.hazards.cell, epoch_at(model.logic.epoch, t + 1)
    first, last = ends
    reads, own = rests(logic, t + 1, state, first), state  # otherwise the formula counts steps
    if reads and (first != last or first < 0):
        own = meet_hazards(model.cells, logic, e, state, start, first, end, last)
    held, event = claims.margin[state], claims.event[state]
    limit = held
    for k in range(claims.size[0]):
        limit = max(limit, claims.margin[claims.live[k]])
    for i in range(near.crossed_first[t], near.crossed_first[t + 1]):
        h = near.crossed[i]
        if cells[h] == first or cells[h] == last or beyond_reach(logic.hazards, h, start, end, limit):
            continue
        margin = segment_clearance(model.hazards, logic.hazards, h, t, start, end, CERTAIN).margin
        number = hazard_number(model, t, h, False)
        for k in range(claims.size[0]):
            q = claims.live[k]
            if logic.loses[e, q, cells[h]] and margin < claims.margin[q]:
                claims.margin[q], claims.event[q] = margin, number
        if reads and logic.harm[e, state, cells[h]] and abs(margin) < held:
            held, event = abs(margin), hazard_number(model, t, h, margin < 0.0)
    if held > claims.margin[own]:
        enter_claim(claims, own, held, event)
    return own


# --- whole flights ----------------------------------------------------------------------------


@kernel
def read_at_steps(
    model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, lists: ClaimLists, near: Near
) -> Claims:  # fmt: skip
    """W_T of a mission without hazards, whose letters are read only at the steps."""
    before, after = lists.before, lists.after
    for t in range(len(mean)):
        at = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        if read_letters(model, t, at, floor, before, after, lists, near):
            before, after = after, before
    return before


@kernel
def read_on_the_way(
    model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, lists: ClaimLists, near: Near
) -> Claims:  # fmt: skip
    """W_T of a mission with hazards, which are also read between steps."""
    logic, before, after = model.logic, lists.before, lists.after
    at, cell, state = Point(mean[0, 0] + off[0, 0], mean[0, 1] + off[0, 1]), -1, int(logic.initial)
    for t in range(len(mean)):
        there = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        last = locate_cell(model.cells, there)
        if t > 0:
            state = cross_hazards(model, t - 1, at, there, (cell, last), before, state, near)
        state, cell, at = int(logic.delta[epoch_at(logic.epoch, t), state, last]), last, there
        if read_letters(model, t, there, floor, before, after, lists, near):
            before, after = after, before
    return before


@kernel
def mission_margin(
    model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, lists: ClaimLists, near: Near
) -> tuple[float, int]:  # fmt: skip
    """Largest W_T [m] of an accepting claim of the flight ``mean`` + ``off`` (T+1, 2), and its event."""
    logic = model.logic
    clear_claims(lists.before)
    clear_claims(lists.after)
    enter_claim(lists.before, logic.initial, CERTAIN, NOWHERE)
    if model.guards.needs[logic.initial] != 0:
        look_back(model, mean, off, floor, lists, near)
    if len(logic.hazards.cell) > 0:
        claims = read_on_the_way(model, mean, off, floor, lists, near)
    else:
        claims = read_at_steps(model, mean, off, floor, lists, near)
    margin, number = -CERTAIN, NOWHERE
    for k in range(claims.size[0]):
        p = claims.live[k]
        if logic.distance[p] == 0.0 and claims.margin[p] > margin:
            margin, number = claims.margin[p], claims.event[p]
    return margin, number


@implements(mission_margins, ClaimLists)
def _one_by_one(
    claims: ClaimLists, model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, scratch: Scratch
) -> None:
    for i in range(off.shape[2]):
        found = mission_margin(model, mean, off[:, :, i], floor, claims, scratch.near)
        scratch.margins[i], scratch.event[i] = found
