"""What is left of a mission accepts the words that complete it, whatever is read first."""

from __future__ import annotations

from itertools import product

import pytest

from pareto_ltl.logic import translate
from pareto_ltl.logic.automaton import Automaton

FORMULAS = ("F(a & F b)", "!b U a & F c", "F(a & X b)", "F a & F b & F c")


def reads(automaton: Automaton, word: tuple[int, ...], state: int) -> int:
    for letter in word:
        state = int(automaton.delta[state, letter])
    return state


@pytest.mark.parametrize("formula", FORMULAS)
def test_the_rest_accepts_what_completes_the_mission(formula: str) -> None:
    automaton = translate(formula)
    letters = range(len(automaton.letters))
    for state in range(automaton.n_states):
        rest = automaton.after(state)
        for first, word in product(letters, product(letters, repeat=2)):
            wanted = automaton.accepting[reads(automaton, word, state)]
            assert rest.accepting[reads(rest, (first, *word), rest.initial)] == wanted
        assert rest.initial == 0
        assert rest.formula == f"the rest of {formula}"
