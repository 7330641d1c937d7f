"""Tables of many states or letters, where code takes other roads than on the small ones of test_semantics."""

from __future__ import annotations

import numpy as np
import pytest

from ltlf import dfa, patterns, translate


def disjoint(names: list[str]) -> list[frozenset[str]]:
    return [frozenset[str](), *(frozenset({name}) for name in names)]


def greatest_inclusion(delta, distance):
    holds = distance[:, None] <= distance
    while True:
        kept = holds.copy()
        for after in delta.T:
            kept &= kept[after][:, after]
        if (kept == holds).all():
            return holds
        holds = kept


KEYS = patterns.key_door(("k", "d"), ("l", "e"), ("m", "f"))


@pytest.mark.parametrize(
    ("formula", "letters"),
    [
        (KEYS, None),
        (KEYS, disjoint(["k", "d", "l", "e", "m", "f"])),
        (patterns.coverage("a", "b", "c", "d", "e", "f", "g"), None),
        ("F(z & F a & F b & F c & F d & F(e & F z))", disjoint(["a", "b", "c", "d", "e", "z"])),
        ("F(a & X b) | F(b & X(c & X d)) & (!d U (a & X X c))", None),
        ("F(a & X(a & X(a & X a))) & F(!b & X !b)", None),  # a word can lead away from acceptance
    ],
)
def test_preorder_is_the_greatest_relation_that_all_letters_preserve(formula, letters):
    automaton = translate(formula, letters)
    np.testing.assert_array_equal(automaton.preorder, greatest_inclusion(automaton.delta, automaton.distance))


def test_coverage_has_a_state_for_each_set_of_places_and_a_pair_for_each_two_nested_sets():
    names = [f"p{i}" for i in range(10)]
    automaton = translate(patterns.coverage(*names), disjoint(names))
    assert automaton.n_states == 2**10
    assert automaton.preorder.sum() == 3**10


@pytest.mark.parametrize("special", [0, 1, 50, 51, 99])
def test_states_that_one_letter_of_many_tells_apart_stay_apart(special):
    delta = np.full((4, 100), 0)
    delta[1] = 1
    delta[2], delta[3] = 2, 3
    delta[1:3, special] = 3  # 0 is the trap, 3 accepts; 1 and 2 are equal
    accepting = np.array([False, False, False, True])
    block = dfa.refine_partition(delta, np.zeros(4, np.int64) + accepting)
    assert block[1] == block[2]
    assert len(np.unique(block)) == 3


@pytest.mark.parametrize("formula", [KEYS, "F(a & F b) & (!c U b) | F(c & X a)", "F a & F b & !c"])
def test_an_automaton_over_some_letters_is_that_over_all_as_far_as_these_lead(formula):
    whole = translate(formula)
    some = translate(formula, whole.letters[: len(whole.letters) // 2])
    for seed in range(50):
        word = np.random.default_rng(seed).choice(len(some.letters), 12)
        read = [some.letters[i] for i in word]
        assert some.accepts(read) or not whole.accepts(read)
