"""The automaton against the formula's semantics, by a road that shares nothing with the translator.

A co-safe formula holds on an infinite word exactly when some prefix is good. So it is evaluated on lasso
words u v v v ... by fixed points over the positions of u v, and the automaton must accept a prefix of
the same word exactly then; |u| + |v| |Q| letters are enough, since states repeat after that.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ltlf import Formula, FormulaError, parse_formula, positive_normal_form, translate

ATOMS = ("a", "b")
LETTERS = [frozenset(s) for n in range(3) for s in itertools.combinations(ATOMS, n)]

literals = st.sampled_from([Formula("name", name=n) for n in ATOMS]).flatmap(
    lambda p: st.sampled_from([p, Formula("!", (p,))])
)
leaves = literals | st.sampled_from([Formula("true"), Formula("false")])


def branches(trees):
    return (
        st.builds(lambda op, p: Formula(op, (p,)), st.sampled_from("XF"), trees)
        | st.builds(lambda op, p, q: Formula(op, (p, q)), st.sampled_from("UM&|"), trees, trees)
    )  # fmt: skip


formulas = st.recursive(leaves, branches, max_leaves=6)
words = st.lists(st.sampled_from(LETTERS), max_size=4)
loops = st.lists(st.sampled_from(LETTERS), min_size=1, max_size=3)


def holds(f: Formula, word: list[frozenset[str]], back: int) -> np.ndarray:
    """Truth of ``f`` at every position of a lasso word that returns to position ``back``."""
    n = len(word)
    after = [*range(1, n), back]
    args = [holds(g, word, back) for g in f.args]
    if f.op in ("true", "false"):
        return np.full(n, f.op == "true")
    if f.op == "name":
        return np.array([f.name in letter for letter in word])
    if f.op == "!":
        return ~args[0]
    if f.op in "&|":
        return (np.logical_and if f.op == "&" else np.logical_or).reduce(args)
    if f.op == "X":
        return args[0][after]
    stay, goal = {
        "F": lambda: (np.ones(n, bool), args[0]),
        "U": lambda: (args[0], args[1]),
        "M": lambda: (args[1], args[0] & args[1]),  # p M q: q up to and including a p
    }[f.op]()
    truth = np.zeros(n, bool)
    for _ in range(n + 1):  # least fixed point
        truth = goal | (stay & truth[after])
    return truth


@settings(max_examples=400)
@given(formulas, words, loops)
def test_a_prefix_is_accepted_exactly_when_the_formula_holds(f, u, v):
    automaton = translate(str(f), LETTERS)
    unrolled = u + v * (automaton.n_states + 1)
    assert automaton.accepts(unrolled) == holds(f, u + v, len(u))[0]


@settings(max_examples=150)
@given(formulas, words)
def test_a_word_that_is_not_accepted_can_still_go_wrong(f, u):
    """Good prefixes only: from a state that is not accepting some word never reaches acceptance."""
    automaton = translate(str(f), LETTERS)
    assume(not automaton.accepts(u))
    state = automaton.initial
    for letter in u:
        state = automaton.step(state, letter)
    spoilt = u[:]
    for _ in range(automaton.n_states):  # the letter after which most words are still not accepted
        ahead = [automaton.step(state, letter) for letter in LETTERS]
        doomed = [k for k, q in enumerate(ahead) if not automaton.accepting[q]]
        assert doomed
        state = ahead[doomed[0]]
        spoilt.append(LETTERS[doomed[0]])
    assert not automaton.accepts(spoilt)


@settings(max_examples=150)
@given(formulas)
def test_the_automaton_is_minimal_complete_and_its_acceptance_absorbing(f):
    automaton = translate(str(f), LETTERS)
    n, delta = automaton.n_states, automaton.delta
    assert delta.shape == (n, len(automaton.letters))
    assert ((delta >= 0) & (delta < n)).all()
    assert (automaton.accepting[delta[automaton.accepting]]).all()
    apart = automaton.accepting[:, None] != automaton.accepting[None, :]  # pairs told apart by some word
    for _ in range(n):
        apart |= apart[delta[:, None, :], delta[None, :, :]].any(axis=2)
    assert apart[~np.eye(n, dtype=bool)].all()
    reached = {automaton.initial}
    for _ in range(n):
        reached |= {int(q) for p in reached for q in delta[p]}
    assert reached == set(range(n))


@settings(max_examples=150)
@given(formulas)
def test_distance_and_preorder_are_what_they_say(f):
    automaton = translate(str(f), LETTERS)
    n, delta, accepting = automaton.n_states, automaton.delta, automaton.accepting
    distance = np.where(accepting, 0.0, np.inf)
    inclusion = ~(accepting[None, :] & ~accepting[:, None])  # [p, q]: what q accepts now, p does
    for _ in range(n * n):
        distance = np.minimum(distance, 1.0 + distance[delta].min(axis=1))
        inclusion = inclusion & inclusion[delta[:, None, :], delta[None, :, :]].all(axis=2)
    np.testing.assert_array_equal(automaton.distance, distance)
    np.testing.assert_array_equal(automaton.preorder, inclusion)


@given(formulas, formulas)
def test_equal_languages_give_equal_automata(f, g):
    one, two = translate(f"({f}) & ({g})", LETTERS), translate(f"({g}) & ({f})", LETTERS)
    np.testing.assert_array_equal(one.delta, two.delta)
    np.testing.assert_array_equal(one.accepting, two.accepting)


@pytest.mark.parametrize(
    ("formula", "word", "accepted"),
    [
        ("X a", ["b", "a"], True),
        ("X a", ["b"], False),
        ("X true", [], True),  # a tautology, and so good before its first letter
        ("!X a", ["b", "b"], True),
        ("!X a", ["b", "a"], False),
        ("F(a & F b)", ["b", "a", "b"], True),
        ("F(a & F b)", ["b", "a"], False),
        ("F(a & F b)", ["ab"], True),  # one letter may serve twice
        ("!b U a", ["", "a"], True),
        ("!b U a", ["b", "a"], False),
        ("a | !a", [], True),
        ("a M b", ["b", "ab"], True),
        ("a M b", ["b", "a"], False),
    ],
)
def test_semantics_on_the_edges(formula, word, accepted):
    assert translate(formula, LETTERS).accepts([frozenset(letter) for letter in word]) is accepted


@pytest.mark.parametrize("operator", ["G a", "a R b", "a W b", "!F a", "!(a U b)"])
def test_formulas_that_promise_for_ever_are_refused_with_their_place(operator):
    with pytest.raises(FormulaError, match="for ever") as caught:
        positive_normal_form(parse_formula(f"F b & ({operator})"))
    assert caught.value.column is not None


def test_regions_that_never_overlap_need_no_letters_for_overlaps():
    goals = [f"p{i}" for i in range(8)]
    alone = [frozenset(), *(frozenset({g}) for g in goals)]
    automaton = translate(" & ".join(f"F {g}" for g in goals), alone)
    assert automaton.n_states == 2**8
    assert automaton.delta.shape == (2**8, 9)
    assert automaton.distance[automaton.initial] == 8
