"""The tables from which margins of flights are computed (:mod:`plane_logic.margin`)."""

from __future__ import annotations

from bisect import bisect_left
from typing import NamedTuple

import numpy as np

from pareto_ltl.planning.pack import pack_faces
from pareto_ltl.planning.pack_logic import LIVE, pack_corners
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from plane_kernels.clearance import CERTAIN
from plane_kernels.types import Corners
from plane_logic.claim_lists import ClaimLists, Claims
from plane_logic.claim_rows import BLOCK, ClaimRows, Rows
from plane_logic.margin_events import Guards, MarginModel, Met, Near, Scratch
from plane_logic.types import Logic

# States of an automaton, or hazards, above which only the order of a path is polished: 0.75 x the CPU time
# with many states, 0.65 x with 47 hazards.
ORDERED = 16
BATCH = 1024  # states whose edges are found together
MAX_LETTERS = 62  # that fit as bits into a 64-bit integer


def margin_model(problem: Problem) -> MarginModel:
    """Polygons that show letters, transitions between claims, barriers and hazards of ``problem``."""
    logic, polygons = problem.logic, problem.decomposition.cells
    letters = shown_letters(problem)
    first = np.concatenate([[0], np.cumsum([len(cells) for cells in letters])]).astype(np.int64)
    hazards, column = logic.hazards.cell.tolist(), [int(cells[0]) for cells in letters]
    return MarginModel(
        shown=pack_faces([polygons[c] for cells in letters for c in cells]),
        first=first,
        letter=np.repeat(np.arange(len(letters)), np.diff(first)),
        column=np.array(column, np.int64),
        guards=pack_guards(logic, column),
        faces=problem.barriers,
        corners=_barrier_corners(problem),
        hazards=pack_faces([polygons[c] for c in hazards]),
        cells=problem.cells,
        logic=logic,
    )


def margin_scratch(model: MarginModel, runs: int, steps: int) -> Scratch:
    """Memory for the margins of ``runs`` flights of at most ``steps`` steps.

    Flights are processed in blocks if there are few claims.
    """
    few = len(model.logic.distance) <= LIVE
    barriers, hazards = len(model.corners.radius), len(model.logic.hazards.cell)
    near = Near(
        np.empty((steps + 1, 4)),
        np.empty(steps + 2, np.int64), np.empty((steps + 1) * len(model.letter), np.int64),
        np.empty(steps + 1, np.int64), np.empty(steps * barriers, np.int64),
        np.empty(steps + 1, np.int64), np.empty(steps * hazards, np.int64),
    )  # fmt: skip
    met = Met(np.empty(runs, np.int64), *(np.empty(runs) for _ in "xys"))
    claims = _claim_rows(model, min(runs, BLOCK), steps) if few else claim_lists(model, steps)
    return Scratch(
        claims, near, np.empty(runs), np.empty(runs, np.int64), met, np.empty((4, runs)), np.empty(runs)
    )


def _claim_rows(model: MarginModel, runs: int, steps: int) -> ClaimRows:
    states, letters = len(model.logic.distance), len(model.first) - 1
    before, after = (
        Rows(np.empty((states, runs)), np.empty((states, runs), np.int64), np.zeros(states, np.bool_))
        for _ in "ba"
    )
    return ClaimRows(
        before, after, np.empty((letters, runs)), np.zeros(letters, np.bool_), np.empty((2, runs)),
        np.empty(runs, np.int64), np.empty(runs, np.int64), np.empty((4, runs)), _no_claims(states),
        np.empty((steps + 1, states), np.bool_),
    )  # fmt: skip


def claim_lists(model: MarginModel, steps: int) -> ClaimLists:
    """Memory for flights of at most ``steps`` steps, one at a time."""
    before, after = (_no_claims(len(model.logic.distance)) for _ in "ba")
    return ClaimLists(before, after, np.empty(len(model.first) - 1), np.zeros(steps + 1, np.int64))


def _no_claims(states: int) -> Claims:
    none = np.full(states, -CERTAIN)
    return Claims(none, np.empty(states, np.int64), np.empty(states, np.int64), np.zeros(1, np.int64))


def shown_letters(problem: Problem) -> list[IntArray]:
    """The cells of each letter that differs from the empty letter for some state of the automaton."""
    delta, atoms = problem.logic.delta, set(problem.atoms)
    groups: dict[frozenset[str], list[int]] = {}
    for cell, label in enumerate(problem.labels):
        if (delta[:, :, cell] != delta[:, :, -1]).any():
            groups.setdefault(label & atoms, []).append(cell)
    return [np.array(cells, np.int64) for cells in groups.values()]


def ordered(model: MarginModel) -> bool:
    """Whether only the order of a path is polished: with many states or hazards, which bar the way."""
    limit = max(len(model.logic.distance), len(model.logic.hazards.cell))
    return limit > ORDERED and model.guards.barring


def model_of_order(model: MarginModel, states: IntArray) -> MarginModel:
    """``model`` with only the ``states`` that a path passes through, for large automata.

    The margin of a flight is then its margin of completing the mission in the order of this path: a lower
    limit of its margin in ``model``, and the same for flights near the path. Few claims are judged for many
    flights at once. ``model`` itself is returned where it is not :func:`ordered`, and where no state is
    accepting.

    Parameters
    ----------
    states : (S,) int
        Ascending, each once, with the initial one.
    """
    few = ordered(model) and len(states) <= LIVE
    if few and (model.logic.distance[states] == 0.0).any():
        return _with_states_only(model, states)
    return model


def _with_states_only(model: MarginModel, states: IntArray) -> MarginModel:
    logic, guards = model.logic, model.guards
    number = np.full(len(logic.distance), -1)
    number[states] = np.arange(len(states))
    edges = np.flatnonzero((number[guards.source] >= 0) & (number[guards.target] >= 0))
    lists = [guards.letter[guards.ptr[e] : guards.ptr[e + 1]] for e in edges]
    begun = np.column_stack([guards.first[:, states], guards.first[:, states[-1] + 1]])
    return model._replace(
        guards=Guards(
            number[guards.source[edges]], number[guards.target[edges]], guards.spared[edges],
            np.concatenate([[0], np.cumsum([len(row) for row in lists])]).astype(np.int64),
            np.concatenate([np.empty(0, np.int64), *lists]), guards.patient, guards.barring,
            np.searchsorted(edges, begun).astype(np.int64), np.zeros(len(states), np.int64),
        ),
        logic=logic._replace(
            distance=logic.distance[states], initial=int(number[logic.initial]),
            loses=np.ascontiguousarray(logic.loses[:, states]),
        ),
    )  # fmt: skip


def nearest_order(model: MarginModel, x: FloatArray) -> IntArray:
    """The states, ascending, of the order in which ``x`` (T+1, 2) is closest to completing the mission.

    A letter counts as read at the steps within a distance of its polygons, the smallest with which the
    mission is completed. Only the initial state is returned if there is none.
    """
    faces = model.shown
    depth = np.minimum.reduceat(faces.offset - x @ faces.normal.T, faces.ptr[:-1], axis=1)
    depth = np.maximum.reduceat(depth, model.first[:-1], axis=1)  # (T+1, M)
    letter = np.argsort(-depth, axis=1, kind="stable")
    depth = np.take_along_axis(depth, letter, axis=1)

    def states(limit: float) -> IntArray:
        return _states_read(model, letter, depth >= -limit)

    limits = np.unique(-depth).tolist()
    least = bisect_left(limits, True, key=lambda limit: len(states(limit)) > 0)
    return states(limits[least]) if least < len(limits) else np.array([model.logic.initial])


def _states_read(model: MarginModel, letter: IntArray, read: BoolArray) -> IntArray:
    """The states to acceptance if the ``letter`` (T+1, M) of each step that are ``read`` follow each other.

    A letter after which the mission is lost is not read. No states are returned without acceptance.
    """
    logic, state = model.logic, int(model.logic.initial)
    passed, at = [state], np.nonzero(read)
    epoch = logic.epoch[np.minimum(at[0], len(logic.epoch) - 1)]
    for e, column in zip(epoch.tolist(), model.column[letter[at]].tolist(), strict=True):
        after = int(logic.delta[e, state, column])
        if after != state and logic.distance[after] < np.inf:
            state = after
            passed.append(state)
            if logic.distance[state] == 0.0:
                return np.unique(passed)
    return np.empty(0, np.int64)


def pack_guards(logic: Logic, column: list[int]) -> Guards:
    """Edges between claims in every epoch, for the letters of ``column`` and, last, the empty letter.

    ``column`` holds indices of columns of ``logic.delta``. From a claim q edges lead to q itself and to the
    states that letters lead to: every other state p that a letter guarantees follows from one of these. An
    edge that another edge makes redundant is left out.
    """
    deltas = logic.delta[:, :, [*column, logic.delta.shape[2] - 1]]
    found = [_epoch_guards(logic, delta) for delta in deltas]
    source, target, spared, count, letters = (np.concatenate([part[k] for part in found]) for k in range(5))
    states, begun = np.arange(len(logic.distance) + 1), np.cumsum([0, *(len(part[0]) for part in found)])
    first = [np.searchsorted(part[0], states) + k for part, k in zip(found, begun, strict=False)]
    ptr = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    return Guards(
        source, target, spared, ptr, letters,
        bool((deltas[:, :, -1] == states[:-1]).all()), hazards_bar(logic), np.array(first, np.int64),
        needed_letters(deltas, logic.distance, np.isin(column, logic.hazards.cell)),
    )  # fmt: skip


def hazards_bar(logic: Logic) -> bool:
    """Whether each hazard is either harmless in a state, or loses it for good, as in ``(!h U a)``.

    The margin of a flight then follows from the hazards that lose each claim, without the automaton state of
    the flight. No letter may count steps: read twice, it leads to the same state.
    """
    cells, ends = logic.hazards.cell, np.isinf(logic.distance)
    again = np.take_along_axis(logic.delta, logic.delta, axis=1)
    harm, loses = logic.harm[:, ~ends][:, :, cells], logic.loses[:, ~ends][:, :, cells]
    lost = ends[logic.way[:, ~ends][:, :, cells]]
    return bool((again == logic.delta).all() and (harm == loses).all() and (lost | ~harm).all())


class _EpochEdges(NamedTuple):
    """Edges of one epoch, sources ascending: ends, ``spared``, numbers of letters, the letters."""

    source: IntArray
    target: IntArray
    spared: BoolArray
    listed: IntArray
    letter: IntArray


def _epoch_guards(logic: Logic, delta: IntArray) -> _EpochEdges:
    live = np.flatnonzero(np.isfinite(logic.distance))
    parts = [_guards_from(logic, delta, live[k : k + BATCH]) for k in range(0, max(len(live), 1), BATCH)]
    return _EpochEdges(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _guards_from(logic: Logic, delta: IntArray, sources: IntArray) -> _EpochEdges:
    """The edges from ``sources`` (S,), all at once."""
    reached = np.sort(np.column_stack([delta[sources], sources]), axis=1)
    usable = np.isfinite(logic.distance[reached])
    usable[:, 1:] &= reached[:, 1:] != reached[:, :-1]
    allowed = logic.covers[delta[sources][:, None], reached[:, :, None]]  # (S, claims, letters)
    better = logic.covers[reached[:, :, None], reached[:, None]]
    at, claim = np.nonzero(needed_claims(better, allowed, usable))
    on = allowed[at, claim]
    edge, letter = np.nonzero(on[:, :-1] != on[:, -1:])
    count = np.bincount(edge, minlength=len(on)).astype(np.int64)
    return _EpochEdges(sources[at], reached[at, claim], on[:, -1].copy(), count, letter.astype(np.int64))


def needed_letters(deltas: IntArray, distance: FloatArray, harmful: BoolArray) -> IntArray:
    """Bits of the letters without which acceptance cannot be reached, (Q,), for more than ``LIVE`` states.

    ``deltas`` (E, Q, M + 1) has a column for each letter and, last, for the empty one. A word that is
    accepted from a claim p is accepted from every state at least as good as p, so edges need these letters
    too. Letters that are ``harmful`` (M,) are read between steps as well, and are left out.
    """
    needs = np.zeros(len(distance), np.int64)
    letters = deltas.shape[2] - 1
    if len(distance) <= LIVE or letters > MAX_LETTERS:
        return needs
    for letter in np.flatnonzero(~harmful).tolist():
        reaches, others = distance == 0.0, np.concatenate(np.delete(deltas, letter, axis=2), axis=1)
        while True:
            more = reaches | reaches[others].any(axis=1)
            if (more == reaches).all():
                break
            reaches = more
        needs[~reaches & np.isfinite(distance)] |= 1 << letter
    return needs


def needed_claims(better: BoolArray, allowed: BoolArray, usable: BoolArray) -> BoolArray:
    """Which ``usable`` claims (S, N) a letter allows while no better claim is allowed by the same letters.

    ``better[s, i, k]``: claim i is at least as strong as k; ``allowed`` (S, N, letters). Of equal claims the
    first is kept.
    """
    number = np.arange(better.shape[1])
    stronger = better & (~better.transpose(0, 2, 1) | (number[:, None] < number))
    lacks = np.matmul(~allowed, allowed.transpose(0, 2, 1))  # [s, i, k]: k has a letter, i has not
    instead = stronger & ~lacks & usable[:, :, None]
    return np.asarray(usable & allowed.any(axis=2) & ~instead.any(axis=1), bool)


def _barrier_corners(problem: Problem) -> Corners:
    """Corners of the obstacles; a wall has none, and is never out of reach."""
    obstacles = list(problem.decomposition.obstacles)
    corners = pack_corners(range(len(obstacles)), obstacles)
    walls = len(problem.barriers.ptr) - 1 - len(obstacles)
    last = np.full(walls, corners.ptr[-1])
    return corners._replace(
        cell=np.arange(len(obstacles) + walls),
        middle=np.vstack([corners.middle, np.zeros((walls, 2))]),
        radius=np.append(corners.radius, np.full(walls, np.inf)),
        ptr=np.append(corners.ptr, last).astype(np.int64),
    )
