"""The ordered bound judged by a probabilistic model checker, Storm (doi:10.1007/s10009-021-00633-z).

A chain of independent random letters runs through a random automaton. Unrolled over its steps it is a Markov
chain, whose exact probability of not being accepted Storm works out; V must not lie below it.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from one_epoch import one_epoch, reading_of
from oracle import path_risk
from pareto_ltl.planning.pack_logic import Reading, empty_letters, follow_states, live_rows
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from plane_kernels.types import Cells, Corners, Faces
from plane_logic.ordered_bound import begin_bound, note_letters, read_letter

stormpy = pytest.importorskip("stormpy")

from stormpy import Rational  # noqa: E402
from stormpy.datastructures import SparseMatrixBuilder  # noqa: E402
from stormpy.models import SparseDtmc, SparseModelComponents, StateLabeling  # noqa: E402

CHAINS = 300
WHOLE = 10**6  # probabilities are whole numbers over this one, so that Storm can be exact
ROUNDING = 1e-12  # of the sums of V


# --- the truth --------------------------------------------------------------------------------


def failure_by_storm(delta: IntArray, goal: int, counts: IntArray) -> float:
    """Probability that letters of probability ``counts`` (T, S) / WHOLE, read from state 0, miss ``goal``.

    Exact in rational numbers. State (t, q) of the Markov chain has the number t Q + q; the last layer stays.
    """
    steps, states = len(counts), len(delta)
    builder = SparseMatrixBuilder[Rational](rows=(steps + 1) * states, columns=(steps + 1) * states)
    for t in range(steps):
        for q in range(states):
            row = np.bincount(delta[q], counts[t], states).astype(int)
            for target in np.flatnonzero(row).tolist():
                share = Rational(int(row[target])) / Rational(WHOLE)
                builder.add_next_value(t * states + q, (t + 1) * states + target, share)
    for q in range(steps * states, (steps + 1) * states):
        builder.add_next_value(q, q, Rational(1))
    labels = StateLabeling((steps + 1) * states)
    for name, state in (("init", 0), ("done", steps * states + goal)):
        labels.add_label(name)
        labels.add_label_to_state(name, state)
    chain = SparseDtmc[Rational](SparseModelComponents[Rational](builder.build(), labels))
    (formula,) = stormpy.parse_properties('P=? [F "done"]')
    return 1.0 - float(stormpy.model_checking(chain, formula).get_value(0))


# --- the bound --------------------------------------------------------------------------------


def language_inclusion(delta: IntArray, goal: int) -> BoolArray:
    """``[q, p]``: q accepts every word that p accepts; pairs that a word tells apart spread backwards."""
    n = len(delta)
    apart = np.zeros((n, n), bool)
    apart[:, goal] = np.arange(n) != goal
    while True:
        wider = apart | apart[delta[:, None], delta[None]].any(axis=2)
        if (wider == apart).all():
            return ~apart
        apart = wider


def logic_of(delta: IntArray, goal: int) -> Reading:
    """The automaton as kernels read it; the last letter is the empty label."""
    covers = language_inclusion(delta, goal)
    distance = np.where(np.arange(len(delta)) == goal, 0.0, 1.0)
    harmless = np.zeros(delta.shape, bool)
    none = Corners(
        np.zeros(0, np.int64), np.empty((0, 2)), np.empty(0), np.zeros(1, np.int64), np.empty((0, 2))
    )
    return reading_of(delta, distance, covers, harmless, harmless.copy(), none)


def bound_of_kernel(logic: Reading, goal: int, P: FloatArray) -> float:
    """V after the letters ``P`` (T, S), by the recursion that paths use."""
    none = Faces(np.zeros(1, np.int64), np.empty((0, 2)), np.empty(0))
    cells = Cells(0.0, 0.0, 1.0, 1.0, 1, np.zeros(2, np.int64), np.zeros(0, np.int64), none)
    letters = np.arange(P.shape[1] - 1)
    corners = Corners(letters, np.empty((0, 2)), np.empty(0), np.zeros(1, np.int64), np.empty((0, 2)))
    bound = follow_states(corners, cells, one_epoch(logic))
    rows, letters = live_rows(bound), empty_letters(bound)
    begin_bound(bound, rows, 0)
    for t in range(len(P)):
        letters.seen[:] = P[t]
        note_letters(bound, letters)
        read_letter(bound, letters, rows, t % 2, rows, (t + 1) % 2, goal)
    entries = slice(rows.first[len(P) % 2], rows.first[len(P) % 2] + rows.size[len(P) % 2])
    return float(min(rows.value[entries][logic.covers[rows.state[entries], goal]], default=1.0))


def bound_of_reference(logic: Reading, P: FloatArray, monkeypatch: pytest.MonkeyPatch) -> float:
    """The same by the readable formula."""
    problem: Any = SimpleNamespace(logic=logic, reading=lambda _: logic)
    columns = np.arange(P.shape[1])
    monkeypatch.setattr(path_risk, "label_probabilities", lambda *_: (columns, P))
    return path_risk.ordered_bound(problem, np.zeros((len(P), 2)), np.zeros((len(P), 2, 2)))


# --- random chains ----------------------------------------------------------------------------


def random_automaton(rng: np.random.Generator) -> IntArray:
    """A complete automaton of two to six states over two to four letters; its last state accepts for good."""
    states, letters = int(rng.integers(2, 7)), int(rng.integers(2, 5))
    delta: IntArray = rng.integers(0, states, (states, letters))
    delta[-1] = states - 1
    return delta


def counter(rng: np.random.Generator) -> IntArray:
    """An automaton whose states are ordered: each letter moves a random number of states ahead."""
    states, letters = int(rng.integers(2, 7)), int(rng.integers(2, 5))
    ahead = rng.integers(0, 3, letters)
    delta: IntArray = np.minimum(np.arange(states)[:, None] + ahead, states - 1)
    return delta


def random_letters(rng: np.random.Generator, steps: int, letters: int) -> IntArray:
    """Counts (T, S) of which every row adds up to ``WHOLE``; few letters are likely at one step."""
    return np.array([rng.multinomial(WHOLE, rng.dirichlet(np.full(letters, 0.3))) for _ in range(steps)])


def certain_but_one(rng: np.random.Generator, steps: int, letters: int, place: int) -> IntArray:
    """Letters that are known, but for the one at step ``place``."""
    counts = WHOLE * np.eye(letters, dtype=int)[rng.integers(0, letters, steps)]
    counts[place] = random_letters(rng, 1, letters)[0]
    return counts


def test_the_ordered_bound_is_never_below_the_truth_of_a_model_checker(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(20)
    informative = 0
    for _ in range(CHAINS):
        delta = random_automaton(rng)
        goal, steps = len(delta) - 1, int(rng.integers(1, 10))
        counts = random_letters(rng, steps, delta.shape[1])
        logic, P = logic_of(delta, goal), counts / WHOLE
        V, truth = bound_of_kernel(logic, goal, P), failure_by_storm(delta, goal, counts)
        assert abs(V - bound_of_reference(logic, P, monkeypatch)) < ROUNDING
        assert truth - V < ROUNDING
        informative += 1e-3 < V < 1.0
    assert informative > CHAINS / 4


@pytest.mark.parametrize("make", [random_automaton, counter])
def test_the_ordered_bound_is_exact_where_one_letter_is_uncertain(
    make: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is added twice then. What follows the letter must rank the states: it is the last letter, or
    the states are ordered."""
    rng = np.random.default_rng(21)
    between = 0
    for _ in range(CHAINS):
        delta = make(rng)
        goal, steps = len(delta) - 1, int(rng.integers(1, 10))
        place = int(rng.integers(steps)) if make is counter else steps - 1
        counts = certain_but_one(rng, steps, delta.shape[1], place)
        logic, P = logic_of(delta, goal), counts / WHOLE
        V, truth = bound_of_kernel(logic, goal, P), failure_by_storm(delta, goal, counts)
        assert abs(V - truth) < ROUNDING
        assert abs(bound_of_reference(logic, P, monkeypatch) - truth) < ROUNDING
        between += 1e-3 < truth < 1.0 - 1e-3
    assert between > CHAINS / 10
