"""The automaton on the letters that cells show, and the states that the ordered bound V tracks.

Epochs are spans of consecutive steps in which the same time windows are open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ltlf import Letter
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.logic.timed import letter_of
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.windows import Window
from plane_kernels.types import Cells, Corners
from plane_logic.types import Letters, LiveRows, Logic, Ordered, StateLists

LIVE = 64  # V follows all states of automata with at most so many, and is exact
PATH_LIVE = 256  # entries of V retained along a path of a larger one


def pack_corners(cell: Sequence[int], corners: Sequence[FloatArray]) -> Corners:
    """Polygons as corners, with a circle around each."""
    middle = np.array([polygon.mean(axis=0) for polygon in corners]).reshape(-1, 2)
    radius = [np.linalg.norm(polygon - m, axis=1).max() for polygon, m in zip(corners, middle, strict=True)]
    return Corners(
        np.array(cell, np.int64), middle, np.array(radius, float),
        np.concatenate([[0], np.cumsum([len(polygon) for polygon in corners])]).astype(np.int64),
        np.vstack([np.empty((0, 2)), *corners]),
    )  # fmt: skip


def pack_logic(
    automaton: Automaton, decomposition: Decomposition, epoch: IntArray, epochs: Sequence[Epoch]
) -> Logic:
    """The automaton in each of ``epochs``: one column for each cell (not each letter) and one for no label.

    ``epoch`` (S + 1,) is the index of the epoch of each step.
    """
    tables = [_epoch_tables(automaton, decomposition, one) for one in epochs]
    delta, way, harm, loses = (_stacked(rows) for rows in zip(*tables, strict=True))
    hazards = np.flatnonzero(harm[:, :, :-1].any(axis=(0, 1))).tolist()
    distance = np.asarray(automaton.distance, float)
    return Logic(
        epoch, delta, way, harm, loses, letters_ahead(delta, distance), distance,
        np.ascontiguousarray(automaton.preorder, bool), int(automaton.initial),
        pack_corners(hazards, [decomposition.cells[c] for c in hazards]),
    )  # fmt: skip


def _stacked(rows: Sequence[Any]) -> Any:
    """The tables of all epochs as one array; the table of a single epoch is not copied."""
    return np.ascontiguousarray(rows[0])[None] if len(rows) == 1 else np.stack(rows)


def _epoch_tables(
    automaton: Automaton, decomposition: Decomposition, epoch: Epoch
) -> tuple[IntArray, IntArray, BoolArray, BoolArray]:
    """``delta``, ``way``, ``harm`` and ``loses`` of :class:`Logic`."""
    now, way = (letter_columns(automaton, decomposition.labels, holding) for holding in epoch)
    delta = np.asarray(automaton.delta[:, now], np.int64)
    passing = delta if (way == now).all() else np.asarray(automaton.delta[:, way], np.int64)
    harm, loses = harmful_letters(automaton, int(way[-1]))
    return delta, passing, harm[:, way], loses[:, way]


def letters_ahead(delta: IntArray, distance: FloatArray) -> FloatArray:
    """The fewest letters to acceptance among those that an epoch and later ones show, (E, Q).

    ``delta`` (E, Q, C + 1); ``distance`` (Q,) is the same number if all letters were shown.

    Eq. (M32) of docs/mathematics.md.
    """
    if len(delta) == 1:
        return distance[None].copy()
    later = np.where(distance == 0.0, 0.0, np.inf)
    rows = []
    for table in delta[::-1]:
        while True:
            nearer = np.minimum(later, 1.0 + later[table].min(axis=1))
            if (nearer == later).all():
                break
            later = nearer
        rows.append(later)
    return np.ascontiguousarray(rows[::-1])


def helpful_delta(logic: Logic) -> IntArray:
    """State after each label (Q, C + 1), in the first of the epochs where it leads nearest to acceptance."""
    best = logic.distance[logic.delta].argmin(axis=0)
    return np.ascontiguousarray(np.take_along_axis(logic.delta, best[None], axis=0)[0])


def harmful_letters(automaton: Automaton, nothing: int) -> tuple[BoolArray, BoolArray]:
    """Letters that are harmful in q, so read between steps, and letters that lose q; both (Q, letters).

    A letter is harmful in q if it leads to the trap, or if the state it leads to does not accept all that is
    accepted after the empty letter, which has the index ``nothing``. It loses q if it is harmful in some
    state s ≥ q and takes s to a state that is not ≥ q.

    Eq. (M33) of docs/mathematics.md.
    """
    delta, covers = automaton.delta, np.asarray(automaton.preorder, bool)
    trap = np.isinf(automaton.distance)
    worse = ~covers[delta, delta[:, nothing][:, None]]
    worse[:, nothing] = False
    harm = (trap[delta] & ~trap[:, None]) | worse
    loses = np.zeros(harm.shape, bool)
    for letter in np.flatnonzero(harm.any(axis=0)).tolist():
        for s in np.flatnonzero(harm[:, letter]).tolist():
            loses[:, letter] |= covers[s] & ~covers[delta[s, letter]]
    return np.asarray(harm, bool), loses


# --- the ordered bound ------------------------------------------------------------------------


def pack_ordered(decomposition: Decomposition, cells: Cells, logic: Logic) -> Ordered:
    """The ordered bound: the cells with a label, as corners in their order, and the states it tracks."""
    cell = [c for c, label in enumerate(decomposition.labels) if label]
    return follow_states(pack_corners(cell, [decomposition.cells[c] for c in cell]), cells, logic)


def follow_states(labelled: Corners, cells: Cells, logic: Logic) -> Ordered:
    """The ordered bound, with the states p for which V_t(p) is computed from the entry of each state."""
    states, last = len(logic.distance), logic.delta.shape[2] - 1
    losses = np.concatenate(logic.loses, axis=1)
    kind = np.unique(losses, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)
    if states > LIVE:
        none = StateLists(np.zeros(states + 1, np.int64), np.empty(0, np.int64))
        return Ordered(labelled, cells, logic, none, np.array([logic.initial]), kind)
    better = logic.covers & (kind[:, None] == kind)
    letters = np.unique(np.concatenate(logic.delta[:, :, [*labelled.cell.tolist(), last]], axis=1), axis=1)
    reached = logic.covers[letters].transpose(0, 2, 1)  # (Q, Q, L): l leads from q to a state ≥ p
    lists = [needed_states(better, reach) for reach in reached]
    ptr = np.concatenate([[0], np.cumsum([len(row) for row in lists])]).astype(np.int64)
    first = np.flatnonzero(logic.covers[logic.initial])
    begin = first[needed_states(better[np.ix_(first, first)], np.zeros((len(first), 0), bool))]
    return Ordered(labelled, cells, logic, StateLists(ptr, np.concatenate(lists)), begin, kind)


def needed_states(better: BoolArray, reach: BoolArray) -> IntArray:
    """States p such that no better one is reached whenever p is, ``reach`` (Q, L) by each letter.

    ``better[i, p]``: state i is worth as much as p. Of equal states the first is kept.
    """
    more = ~(reach[None] & ~reach[:, None]).any(axis=2)  # [i, p]: i is reached whenever p is
    instead = better & more
    np.fill_diagonal(instead, False)
    first = np.arange(len(better))[:, None] < np.arange(len(better))
    return np.asarray(np.flatnonzero(~(instead & (~instead.T | first)).any(axis=0)), np.int64)


def live_rows(bound: Ordered) -> LiveRows:
    """Two scratch rows for twice as many entries of V as are retained, at most ``PATH_LIVE``."""
    limit = min(len(bound.logic.distance), PATH_LIVE)
    return LiveRows(
        2 * limit * np.arange(2, dtype=np.int64), np.zeros(2, np.int32), np.zeros(4 * limit, np.int32),
        np.zeros(4 * limit), limit,
    )  # fmt: skip


def empty_letters(bound: Ordered) -> Letters:
    """Scratch for the letters that may be read in one step."""
    parts, hazards = len(bound.labelled.cell), len(bound.logic.hazards.cell)
    return Letters(
        np.zeros(parts + 1), np.zeros(hazards), np.zeros(parts, np.int64), np.zeros(hazards, np.int64),
        np.zeros(2, np.int64), np.full(len(bound.logic.distance), -1, np.int32), np.zeros(1, np.int64),
    )  # fmt: skip


# --- epochs -----------------------------------------------------------------------------------------


class Epoch(NamedTuple):
    """Names of the windows open at a step (``now``) and at some time of the segment before it (``way``)."""

    now: frozenset[str]
    way: frozenset[str]


class Reading(NamedTuple):
    """The automaton at one step, for code outside the kernels.

    ``delta`` (Q, C + 1), the last column for no label (obstacles, off the map); ``distance`` (Q,) the fewest
    letters to acceptance among those that this and later epochs show, inf where it cannot be reached.

    On the segment between two steps, letters that lead away from acceptance are read as well: they take q to
    ``way`` (Q, C + 1). They are read only in states that the label of the first step leaves unchanged.
    ``harm`` (Q, C + 1): the label is worse in q than no label, or ends in the trap; ``loses`` (Q, C + 1):
    meeting the label may take a state as good as q to one that is not.
    """

    delta: IntArray
    way: IntArray
    harm: BoolArray
    loses: BoolArray
    distance: FloatArray
    covers: BoolArray
    initial: int
    hazards: Corners


def epochs_of(windows: Mapping[str, Window], dt: float, steps: int) -> tuple[IntArray, tuple[Epoch, ...]]:
    """Index of the epoch of each step 0 to ``steps`` of ``dt`` [s], (S + 1,), and the epochs in order."""
    if not windows:
        nothing = frozenset[str]()
        return np.zeros(steps + 1, np.int64), (Epoch(nothing, nothing),)
    epochs: list[Epoch] = []
    number = np.empty(steps + 1, np.int64)
    for t in range(steps + 1):
        first, last = dt * max(t - 1, 0), dt * t
        epoch = Epoch(
            frozenset(name for name, window in windows.items() if window.holds_at(last)),
            frozenset(name for name, window in windows.items() if window.meets(first, last)),
        )
        if not epochs or epochs[-1] != epoch:
            epochs.append(epoch)
        number[t] = len(epochs) - 1
    return number, tuple(epochs)


def step_epochs(epoch: IntArray, count: int) -> IntArray:
    """Epoch of each of the first ``count`` steps; ``epoch`` (S + 1,) as in :class:`Logic`."""
    return epoch[np.minimum(np.arange(count), len(epoch) - 1)]


def letter_columns(automaton: Automaton, labels: Sequence[Letter], holding: frozenset[str]) -> IntArray:
    """Automaton column of each label and, last, of no label, while the windows ``holding`` are open."""
    letters = [letter_of(label, automaton.windows, holding) for label in (*labels, Letter())]
    return np.array([automaton.letter_index(letter) for letter in letters], np.int64)
