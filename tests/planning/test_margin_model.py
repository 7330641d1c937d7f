"""Edges between claims: those that are left out bring nothing."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pareto_ltl.kernels.margin_events import Guards
from pareto_ltl.planning.epochs import Reading
from pareto_ltl.planning.margin_model import pack_guards, shown_letters
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray
from problems import box, make_problem, make_scene
from strategies import formulas

REGIONS = {"a": box(2, 8, 6, 12), "b": box(4, 10, 9, 15), "c": box(12, 8, 16, 12)}  # a and b overlap


@cache
def task(formula: str) -> Problem:
    return make_problem(formula, make_scene(REGIONS))


def letter_margins(rng: np.random.Generator, letters: int, steps: int) -> FloatArray:
    """Margins (T, M) of letters that places show one of, or none."""
    shown = -rng.exponential(1.0, (steps, letters))
    for t in range(steps):
        if letters and rng.random() < 0.7:
            inside = rng.integers(letters)
            depth = -shown[t, inside]
            shown[t] = np.minimum(shown[t], -depth)  # cells do not overlap: the others are as far away
            shown[t, inside] = depth
    return shown


def by_all_claims(logic: Reading, column: list[int], shown: FloatArray) -> FloatArray:
    """W_T(p) by the definition; the margin of a set of letters without the empty one is its best letter's."""
    W = np.full(len(logic.delta), -np.inf)
    W[logic.initial] = np.inf
    for now in shown:
        after = np.full_like(W, -np.inf)
        for q in range(len(W)):
            for p in range(len(W)):
                good = logic.covers[logic.delta[q, [*column, -1]], p]
                inside = now[good[:-1]].max(initial=-np.inf)
                outside = -now[~good[:-1]].max(initial=-np.inf)
                after[p] = max(after[p], min(W[q], outside if good[-1] else inside))
        W = after
    return W


def by_guards(guards: Guards, initial: int, states: int, shown: FloatArray) -> FloatArray:
    W = np.full(states, -np.inf)
    W[initial] = np.inf
    for now in shown:
        after = np.full_like(W, -np.inf)
        for e, (q, p) in enumerate(zip(guards.source, guards.target, strict=True)):
            listed = now[guards.letter[guards.ptr[e] : guards.ptr[e + 1]]].max(initial=-np.inf)
            after[p] = max(after[p], min(W[q], -listed if guards.spared[e] else listed))
        W = after
    return W


@settings(deadline=None, max_examples=150)
@given(formulas("abc"), st.integers(0, 2**32 - 1), st.integers(1, 6))
@example("X b U !a M !c", 1, 3)
def test_edges_that_are_left_out_change_no_margin_of_acceptance(formula: str, seed: int, steps: int) -> None:
    problem, rng = task(formula), np.random.default_rng(seed)
    logic = problem.logic
    column = [int(cells[0]) for cells in shown_letters(problem)]
    guards, accepting = pack_guards(logic, column), logic.distance == 0.0
    for _ in range(5):
        shown = letter_margins(rng, len(column), steps)
        wanted = by_all_claims(problem.reading(0), column, shown)[accepting].max(initial=-np.inf)
        found = by_guards(guards, logic.initial, len(logic.distance), shown)[accepting].max(initial=-np.inf)
        assert found == wanted


@pytest.mark.parametrize(
    ("formula", "patient"),
    [("F(a & F b)", True), ("X X F a", False), ("F(a & X b)", False), ("!b U a", True)],
)
def test_patient_edges_leave_every_claim_as_it_is_where_nothing_is_shown(formula: str, patient: bool) -> None:
    problem = task(formula)
    logic, letters = problem.logic, shown_letters(problem)
    guards = pack_guards(logic, [int(cells[0]) for cells in letters])
    assert guards.patient == patient
    far = np.full((1, len(letters)), -np.inf)
    for q in np.flatnonzero(np.isfinite(logic.distance)):
        held = by_guards(guards, int(q), len(logic.distance), far)
        assert (held[q] == np.inf) or not patient
