"""The messages of the package of formulas are plain; the planner gives them the words of flights and maps."""

from __future__ import annotations

import re

import pytest

import ltlf
from pareto_ltl.logic import FormulaError, translate
from pareto_ltl.logic.patterns import formula_of
from pareto_ltl.settings import MissionConfig
from pareto_ltl.support.errors import ConfigError

# Texts with an error, what the package recommends, and what the planner does.
ADVISED = [
    ("F a & G !b",
     "no finite word can satisfy it; a word is over when the formula holds: write '!b U (a & !b)' (column 7)",
     "no finite flight can complete it; a flight ends with its last visit: write '!b U (a & !b)', or draw b "
     "as an obstacle (column 7)"),
    ("G (!b & !c)", "write '(!b & !c) U goal', with what ends it as goal",
     "write '(!b & !c) U goal', with the region to visit as goal, or draw b, c as obstacles"),
    ("X F[0,6h] a", "spans count from the first letter: put it outside, as in F[0,6h] (a & b)",
     "spans count from departure: put it outside, as in F[0,6h] (a & b), or give the region a time window"),
    ("HOA: v1", "read it as an automaton", "name its file as mission.automaton"),
    ("P=? [ F a ]", "what stands between [ and ]", "between [ and ]; the failure probability is minimised"),
    ("E F a", "a formula is about one word, as in F a", "a mission is about one path, as in F a"),
    ("F x > 3", "write a proposition that holds where", "draw the set of positions as a region"),
    ("∀ x", "write one formula for each case", "write one formula for each region"),
]  # fmt: skip
PLANNING = re.compile(r"flight|region|obstacle|departure|mission\.|logic\.")


@pytest.mark.parametrize(("text", "plain", "planned"), ADVISED)
def test_the_advice_of_an_error_is_in_the_words_of_its_application(
    text: str, plain: str, planned: str
) -> None:
    with pytest.raises(ltlf.FormulaError) as of_package:
        ltlf.translate(text)
    with pytest.raises(FormulaError) as of_planner:
        translate(text)
    assert plain in str(of_package.value)
    assert not PLANNING.search(str(of_package.value))
    assert planned in str(of_planner.value)


def test_the_planner_keeps_column_and_caret_of_an_error() -> None:
    with pytest.raises(ltlf.FormulaError) as of_package:
        ltlf.translate("F(a & )")
    with pytest.raises(FormulaError) as of_planner:
        translate("F(a & )")
    assert of_planner.value.column == of_package.value.column == 6
    assert of_planner.value.__notes__ == of_package.value.__notes__ == ["F(a & )\n      ^"]


def test_too_many_states_are_allowed_by_the_argument_or_by_the_setting() -> None:
    text = "F a & F b & F c"
    with pytest.raises(ltlf.StatesError, match=r"more than 3 states.* or raise max_states$"):
        ltlf.translate(text, max_states=3)
    with pytest.raises(FormulaError, match=r"more than 3 states.* or raise logic\.max_states$"):
        translate(text, max_states=3)


def test_a_pattern_without_goals_is_a_wrong_setting() -> None:
    with pytest.raises(ltlf.PatternError, match=r"^patrol needs at least 2"):
        ltlf.patterns.patrol("a")
    with pytest.raises(ConfigError, match=r"^mission pattern patrol needs at least 2"):
        formula_of(MissionConfig(pattern="patrol", goals=["a"]))
    with pytest.raises(FormulaError, match="column 4"):
        formula_of(MissionConfig(pattern="sequence", goals=["a &"]))


def test_the_automaton_of_a_mission_is_that_of_its_formula() -> None:
    dfa, automaton = ltlf.translate("!b U a & F b"), translate("!b U a & F b")
    assert dfa == automaton
    assert hash(dfa) == hash(automaton)
    assert repr(dfa) == "Dfa(formula !b U a & F b, states 4, letters 4)"
    assert dfa.accepts([{"a"}, {"b"}])
    assert not dfa.accepts([{"b"}, {"a"}])
    assert 'tool: "ltlf"' in dfa.to_hoa()
    assert dfa.to_hoa().replace('"ltlf"', '"pareto_ltl"') == automaton.to_hoa()
