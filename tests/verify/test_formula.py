"""The judge's reading of formulas, against the translator of the planner."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pareto_ltl.logic import FormulaError, translate
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.support.errors import DataError
from pareto_ltl_verify.formula import Dfa, covers, distances, first_difference, read_formula, read_hoa, unlike

ATOMS = ("a", "b", "c")
LETTERS = [frozenset(s) for n in range(4) for s in itertools.combinations(ATOMS, n)]
TEXTS = (
    "F(a & F b & F c)", "F(a & F(b & F c)) | F(a & F(c & F b))", "!b U a", "a & X !a & X X b", "(a U b) U c",
    "a M (b | X c)", "!(G !a)", "X a <-> X b", "a -> F b", "F(a xor b)", "true", "false", "a | !a",
    "X X true",
    "!(a W b)", "!(a R b) & F c", "F(a) && <>b || next c", "~a until (b and not c)",
    "a | b xor c", "a -> b <-> c", "a xor b & c", "1 U a & F tt", "◇(a ∧ ◇b)", "a => F b", "F(a /\\ X[!] b)",
    r"$\Diamond \left(a \land b\right) \lor \bigcirc c$", "a 𝒰 (b ∨ ⊥)", r"a \mathcal{U} \mathit{b}",
    "!globally a", "a implies finally c",
)  # fmt: skip

literals = st.sampled_from(["a", "!b", "c", "!a", "b", "true", "false"])


def larger(parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.builds("{}({})".format, st.sampled_from(["X", "F", "!"]), parts) | st.builds(
        "({}) {} ({})".format, parts, st.sampled_from(["&", "|", "U", "M", "->", "<->", "xor"]), parts
    )


formulas = st.recursive(literals, larger, max_leaves=6)
alphabets = st.lists(st.sampled_from(LETTERS), min_size=1, max_size=8, unique=True)


def as_dfa(automaton: Automaton) -> Dfa:
    return Dfa(
        automaton.letters, automaton.atoms, tuple(map(tuple, automaton.delta.tolist())), automaton.initial,
        tuple(automaton.accepting.tolist()),
    )  # fmt: skip


@pytest.mark.parametrize("text", TEXTS)
def test_the_automaton_of_the_translator_is_that_of_the_formula(text: str) -> None:
    automaton = translate(text)
    dfa = as_dfa(automaton)
    assert first_difference(dfa, text) is None
    assert distances(dfa).tolist() == automaton.distance.tolist()
    assert covers(dfa).tolist() == automaton.preorder.tolist()
    again = read_hoa(automaton.to_hoa(), dfa.letters)
    assert again == dfa
    assert unlike(dfa, again) is None


@given(formulas, alphabets)
@settings(max_examples=300)
def test_random_formulas_over_random_letters_have_the_automaton_of_the_translator(
    text: str, letters: list[frozenset[str]]
) -> None:
    try:
        automaton = translate(text, letters)
    except FormulaError:
        assume(False)
        return
    dfa = as_dfa(automaton)
    assert first_difference(dfa, text) is None
    assert unlike(dfa, read_hoa(automaton.to_hoa(), dfa.letters)) is None


@given(formulas, formulas)
@settings(max_examples=200)
def test_a_word_is_shown_on_which_two_missions_differ(one: str, other: str) -> None:
    try:
        first, second = (translate(f"({text}) & ((a | !a) & (b | !b) & (c | !c))") for text in (one, other))
    except FormulaError:
        assume(False)
        return
    word = unlike(as_dfa(first), as_dfa(second))
    assert (word is None) == (first == second)
    if word is not None:
        shown = (
            [] if word == "the empty word" else [set(filter(None, w[1:-1].split(","))) for w in word.split()]
        )
        assert first.accepts(shown) != second.accepts(shown)


@given(formulas, st.data())
@settings(max_examples=100)
def test_a_changed_transition_is_noticed(text: str, data: st.DataObject) -> None:
    try:
        automaton = translate(text)
    except FormulaError:
        assume(False)
        return
    dfa = as_dfa(automaton)
    assume(len(dfa.delta) > 1)
    q, i, target = (
        data.draw(st.integers(0, n - 1)) for n in (len(dfa.delta), len(dfa.letters), len(dfa.delta))
    )
    assume(dfa.delta[q][i] != target)
    rows = [list(row) for row in dfa.delta]
    rows[q][i] = target
    # The automaton is minimal and all its states are reached, so that no transition is idle.
    assert first_difference(replace(dfa, delta=tuple(map(tuple, rows))), text) is not None


@pytest.mark.parametrize("text", ["F(a", "F a)", "a b", "", "F", "a &", "G a", "a R b", "§"])
def test_what_is_no_mission_is_one_line(text: str) -> None:
    with pytest.raises(DataError) as caught:
        first_difference(as_dfa(translate("F a")), text)
    assert "\n" not in str(caught.value)


def test_a_formula_is_read_with_the_usual_strength_of_operators() -> None:
    assert read_formula("!a U b & c | d -> F e") == read_formula("(((!a) U b) & c | d) -> (F e)")
    assert read_formula("a U b U c") == read_formula("a U (b U c)")
    assert read_formula("X !a & b") == read_formula("(X (!a)) & b")
