"""Missions in words."""

from __future__ import annotations

import pytest
from hypothesis import given

from ltlf.patterns import key_door, patrol, sequence
from pareto_ltl_apps.view.in_words import LONGEST, mission_in_words
from strategies import formulas

WORDS = {
    "F a": "reach a",
    "F(a & F b & F c)": "reach a, then b and c in any order",
    "F(a & F(b & F c)) | F(a & F(d & F c))": "either reach a, then b, then c, or reach a, then d, then c",
    "F(a & F((b | d) & F c))": "reach a, then b or d, then c",
    "F a & F b & F c": "reach a, b and c, in any order",
    "F(springfield & F cairo) & F memphis": "reach springfield, then cairo; and reach memphis",
    "!x U a": "stay out of x until a is reached",
    "!(x | y) U (a & F b)": "stay out of x or y until a, then b is reached",
    "F(a & X F b)": "reach a, then at a later step b",
    "F(a & !b)": "reach a and outside b",
    "a U b": "be in a until be in b",
    "F[0,6h] a": "reach a within 6 h of departure",
    "F[90min,2.5h] a & F b & F c": (
        "reach b and c, in any order; and reach a between 1.5 h and 2.5 h after departure"
    ),
    "G[0,2h] !x & F a": "be outside x between 0 s and 2 h after departure; and reach a",
    "X a": "at the next step, be in a",
}


@pytest.mark.parametrize("formula", WORDS)
def test_a_mission_has_words(formula: str) -> None:
    assert mission_in_words(formula) == WORDS[formula]


def test_patterns_have_words() -> None:
    assert mission_in_words(patrol("a", "b")) == "reach a, then b, then a"
    assert mission_in_words(sequence("a", "b", "c")) == "reach a, then b, then c"
    assert mission_in_words(key_door(("k", "d"))) == "stay out of d until k is reached; and reach d"


def test_what_cannot_be_read_or_is_long_has_none() -> None:
    assert mission_in_words("F(") == ""
    assert mission_in_words(" & ".join(f"F a{n}" for n in range(200))) == ""


@given(formulas(("a", "b", "c")))
def test_every_formula_has_words_or_none(formula: str) -> None:
    assert len(mission_in_words(formula)) <= LONGEST
