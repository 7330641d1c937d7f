"""The ordered bound of live states: exact in small automata, never below V where entries are left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltlf.dfa import acceptance_distances, language_inclusion
from one_epoch import one_epoch, reading_of
from oracle.live_bound import keep_live, live_bound, read_live_letter
from pareto_ltl.planning.pack_logic import Reading, empty_letters, follow_states, live_rows
from plane_kernels.types import Cells, Corners, Faces
from plane_logic.ordered_bound import (
    begin_bound,
    note_letters,
    read_letter,
    stays,
)
from plane_logic.types import StateLists

some = settings(deadline=None, max_examples=150)


class Case(NamedTuple):
    """An automaton on cells that show labels, and what may be read at each step."""

    logic: Reading
    seen: np.ndarray  # (T, L + 1)
    met: np.ndarray  # (T, H)


def corners_of(cells) -> Corners:
    cells = np.array(cells, np.int64)
    n = len(cells)
    return Corners(cells, np.zeros((n, 2)), np.zeros(n), np.zeros(n + 1, np.int64), np.empty((0, 2)))


def logic_of(rng, states, letters, hazards) -> Reading:
    """A random automaton; labels of the hazards lose random states."""
    delta = rng.integers(0, states, (states, letters + 1))
    stay = rng.random(delta.shape) < 0.4
    delta = np.where(stay, np.arange(states)[:, None], delta)
    delta[-1] = states - 1
    distance = acceptance_distances(delta, np.arange(states) == states - 1)
    covers = language_inclusion(delta, distance)
    loses = np.zeros(delta.shape, bool)
    cells = rng.choice(letters, min(hazards, letters), replace=False)
    loses[:, cells] = rng.random((states, len(cells))) < 0.4
    return reading_of(delta, distance, covers, loses.copy(), loses, corners_of(np.sort(cells)))


@st.composite
def cases(draw, most=9):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    letters = draw(st.integers(1, 4))
    logic = logic_of(rng, draw(st.integers(2, most)), letters, draw(st.integers(0, 2)))
    steps = draw(st.integers(1, 9))
    seen = rng.dirichlet(np.full(letters + 1, 0.4), steps)
    seen[:, :-1][rng.random((steps, letters)) < 0.5] = 0.0
    seen[:, -1] = np.clip(1.0 - seen[:, :-1].sum(axis=1), 0.0, 1.0)
    met = rng.random((steps, len(logic.hazards.cell))) ** 4
    met[rng.random(met.shape) < 0.5] = 0.0
    return Case(logic, seen, met)


def bound_of(logic: Reading):
    none = Faces(np.zeros(1, np.int64), np.empty((0, 2)), np.empty(0))
    cells = Cells(0.0, 0.0, 1.0, 1.0, 1, np.zeros(2, np.int64), np.zeros(0, np.int64), none)
    labelled = corners_of(np.arange(logic.delta.shape[1] - 1))
    return follow_states(labelled, cells, one_epoch(logic))


def dense_step(case: Case, V, t):
    """The recursion over all pairs of states; terms in the order in which the kernel adds them."""
    logic = case.logic
    after = np.ones(len(V))
    for q, value in enumerate(V):
        to_none = logic.covers[logic.delta[q, -1]]
        v = np.full(len(V), value)
        v[~to_none] += case.seen[t, -1]
        for label in range(case.seen.shape[1] - 1):
            if not logic.loses[q, label]:
                v[~logic.covers[logic.delta[q, label]]] += case.seen[t, label]
        for h, cell in enumerate(logic.hazards.cell):
            if logic.loses[q, cell]:
                v += case.met[t, h]
        after = np.minimum(after, v)
    return after


def live_value(bound, rows, row, p):
    """V(p) of a row: the least V of its entries whose state is ≥ p, or 1."""
    entries = range(rows.first[row], rows.first[row] + rows.size[row])
    return min((rows.value[k] for k in entries if bound.logic.covers[rows.state[k], p]), default=1.0)


def rows_after(case: Case, bound, rows, letters, planned=-1):
    """The rows of V step by step, as entries of the current row."""
    begin_bound(bound, rows, 0)
    for t in range(len(case.seen)):
        letters.seen[:], letters.met[:] = case.seen[t], case.met[t]
        note_letters(bound, letters)
        read_letter(bound, letters, rows, t % 2, rows, (t + 1) % 2, planned)
        yield t, (t + 1) % 2


@some
@given(cases())
def test_the_entries_of_a_small_automaton_say_v_to_the_last_bit(case):
    bound = bound_of(case.logic)
    rows, letters = live_rows(bound), empty_letters(bound)
    V = np.where(case.logic.covers[0], 0.0, 1.0)
    for t, row in rows_after(case, bound, rows, letters, 0):
        V = dense_step(case, V, t)
        found = [live_value(bound, rows, row, p) for p in range(len(V))]
        np.testing.assert_array_equal(found, V)
        assert np.all(letters.place == -1)


@some
@given(cases(), st.integers(1, 4), st.integers(0, 8))
def test_left_out_entries_raise_v_and_nothing_else(case, most, planned):
    logic = case.logic
    planned %= len(logic.delta)
    bound = bound_of(logic)
    none = StateLists(np.zeros(len(logic.delta) + 1, np.int64), np.empty(0, np.int64))
    bound = bound._replace(targets=none, begin=np.zeros(1, np.int64))
    wide = live_rows(bound)
    rows = wide._replace(most=min(most, wide.most), first=2 * wide.most * np.arange(2))
    letters = empty_letters(bound)
    column = np.arange(logic.delta.shape[1])
    V, entries, exact = np.where(logic.covers[0], 0.0, 1.0), {0: 0.0}, True
    for t, row in rows_after(case, bound, rows, letters, planned):
        V = dense_step(case, V, t)
        after = read_live_letter(logic, entries, column, case.seen[t], case.met[t])
        exact &= len(after) <= 2 * rows.most  # beyond, entries are left out before all are known
        entries = keep_live(logic, bound.kind, after, rows.most, planned)
        found = np.array([live_value(bound, rows, row, p) for p in range(len(V))])
        assert rows.size[row] <= rows.most
        assert np.all(found >= V)
        if exact:
            assert found == pytest.approx([live_bound(logic, entries, p) for p in range(len(V))], rel=1e-12)


@some
@given(cases())
def test_a_row_that_the_empty_letter_leaves_alone_is_v_after_it(case):
    bound = bound_of(case.logic)
    rows, letters = live_rows(bound), empty_letters(bound)
    for _, row in rows_after(case, bound, rows, letters, 0):
        if stays(bound, letters, rows, row):
            before = [live_value(bound, rows, row, p) for p in range(len(case.logic.delta))]
            letters.seen[:], letters.met[:] = 0.0, 0.0
            letters.seen[-1] = 1.0
            assert not note_letters(bound, letters)
            read_letter(bound, letters, rows, row, rows, 1 - row, 0)
            after = [live_value(bound, rows, 1 - row, p) for p in range(len(case.logic.delta))]
            np.testing.assert_array_equal(after, before)
        break
