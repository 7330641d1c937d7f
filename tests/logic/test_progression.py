"""Progression simplifies so well that small formulas need no minimisation; and its limit is exact."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ltlf import FormulaError, dfa, parse_formula, positive_normal_form
from ltlf.progression import DONE_STATE, LOST_STATE, Progression, ProgressionNode

ATOMS = ("a", "b", "c", "d")
LETTERS = np.arange(1 << len(ATOMS))
MANY = 10**5


def read(text: str, most: int = MANY) -> tuple[Progression, ProgressionNode]:
    progression = Progression(ATOMS, most)
    return progression, progression.read(positive_normal_form(parse_formula(text), text))


@pytest.mark.parametrize(
    ("text", "states", "op"),
    [
        ("F(a & F b)", 3, "U"), ("!b U a", 3, "U"), ("F(a & X b)", 3, "U"), ("F a & F b & F c", 8, "&"),
        ("F a | F b", 2, "U"), ("X X a", 5, "X"), ("X a & X b", 4, "X"), ("(a U b) | (a U c)", 3, "U"),
        ("F(a & F(b | c)) & F d", 6, "&"), ("!d U (a & F b) & F c", 7, "&"),
        ("F(a & F b) | F(a & F c)", 3, "U"), ("a U (b U c)", 4, "U"), ("F F a", 2, "U"),
        ("a U (a U b)", 3, "U"), ("F(a | F b)", 2, "U"), ("X(a | X a)", 5, "X"), ("(a & b) U c", 3, "U"),
        ("F(a & b) & F a", 2, "U"), ("F(a & b) | F a", 2, "U"), ("(a U b) & (c U b)", 3, "&"),
        ("(a U b) & F b", 3, "U"), ("(a U b) | F b", 2, "U"), ("F(a & X(b & X c))", 5, "U"),
        ("X F a", 3, "X"), ("a & !a", 1, "false"), ("a | !a", 1, "true"), ("F(a & !a)", 1, "false"),
        ("b M a", 3, "U"), ("F a & F(a & F b)", 3, "U"),
    ],
)  # fmt: skip
def test_a_small_formula_is_one_node_and_has_no_state_that_another_one_equals(
    text: str, states: int, op: str
) -> None:
    """As many states as the minimal automaton, whose number is known for each of these formulas."""
    progression, node = read(text)
    found = progression.explore(node, LETTERS)
    assert (len(found.delta), node.op) == (states, op)
    assert len(dfa.minimal_table(found)[0].delta) == states


@pytest.mark.parametrize(
    ("stronger", "weaker"),
    [
        ("a", "a | b"), ("a & b", "a"), ("a & b", "b | c"), ("a | b", "a | b | c"), ("X a", "X(a | b)"),
        ("X F a", "F a"), ("b U a", "F a"), ("a", "b U a"), ("(a & c) U b", "a U b"), ("a U b", "a | b"),
        ("a U (b & c)", "a U b"), ("a & F b", "F b"), ("X a & X b", "X a"), ("F(a & F b)", "F b"),
        ("F(a & F b)", "F a"), ("X X a", "X X(a | b)"),
    ],
)  # fmt: skip
def test_what_the_syntax_shows_to_be_stronger_implies_the_weaker_and_not_the_other_way(
    stronger: str, weaker: str
) -> None:
    progression, p = read(stronger)
    q = progression.read(positive_normal_form(parse_formula(weaker), weaker))
    assert progression.implies(p, q)
    assert not progression.implies(q, p)


@pytest.mark.parametrize(("p", "q"), list(itertools.permutations(["a", "X a", "b U c", "!a", "X b & d"], 2)))
def test_formulas_that_have_nothing_to_do_with_each_other_imply_nothing(p: str, q: str) -> None:
    progression, one = read(p)
    other = progression.read(positive_normal_form(parse_formula(q), q))
    assert not progression.implies(one, other)
    assert progression.implies(progression.false, one)
    assert progression.implies(one, progression.true)
    assert not progression.implies(progression.true, one)
    assert not progression.implies(one, progression.false)


OBLIGATIONS = ("F a", "F b", "F(a & F b)", "a U b", "c U b", "(a & c) U b", "X a", "X(a & b)")
clauses = st.sets(st.sampled_from(OBLIGATIONS), min_size=1, max_size=3)


def clause_of(progression: Progression, texts: set[str]) -> int:
    bits = [progression.read(positive_normal_form(parse_formula(text), text)).bit for text in sorted(texts)]
    return sum(set(bits))


@given(st.lists(clauses, min_size=1, max_size=4))
def test_a_disjunction_keeps_the_weakest_clauses_and_no_other(found: list[set[str]]) -> None:
    progression = Progression(ATOMS, MANY)
    given_clauses = [clause_of(progression, texts) for texts in found]
    closure, kept = progression.closure, progression.any([given_clauses])
    assert all(any(not one & ~closure(clause) for one in kept) for clause in given_clauses)
    assert {*kept} <= {progression.core(clause) for clause in given_clauses}
    for one, other in itertools.permutations(kept, 2):
        assert one & ~closure(other)
    for clause in given_clauses:  # the core of a clause says as much, and none of it follows from the rest
        core = progression.core(clause)
        assert closure(core) == closure(clause)
        bits = [bit for bit in (1 << k for k in range(core.bit_length())) if core & bit]
        assert all(bit & ~closure(core & ~bit) for bit in bits)


def test_what_is_true_at_once_is_done_and_nothing_is_lost() -> None:
    progression, node = read("F a")
    assert progression.any([[node.bit], [0]]) == DONE_STATE
    assert progression.any([]) == LOST_STATE
    assert progression.all([DONE_STATE, (node.bit,)]) == (node.bit,)
    assert progression.all([(node.bit,), LOST_STATE]) == LOST_STATE
    assert progression.all([]) == DONE_STATE


def test_as_many_clauses_as_states_are_allowed_and_one_more_is_refused() -> None:
    progression = Progression(ATOMS, 3)
    bits = [clause_of(progression, {text}) for text in ("X a", "X b", "X c", "X d")]
    assert set(progression.any([bits[:3]])) == set(bits[:3])
    with pytest.raises(FormulaError):
        progression.any([bits])


@pytest.mark.parametrize("text", ["F a & F b & F c", "F(a & F(b & F c))"])
def test_as_many_states_as_the_limit_are_made_and_one_less_is_refused(text: str) -> None:
    progression, node = read(text)
    states = len(progression.explore(node, LETTERS).delta)
    exact, same = read(text, states)
    assert len(exact.explore(same, LETTERS).delta) == states
    fewer, same = read(text, states - 1)
    with pytest.raises(FormulaError):
        fewer.explore(same, LETTERS)
