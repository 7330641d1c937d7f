"""The words for the choice of a rule."""

from __future__ import annotations

import pytest

from pareto_ltl.planning.selection_rules import selection_rule
from pareto_ltl.settings import SelectionConfig


@pytest.mark.parametrize(
    ("metres", "words"),
    [(160e3, "160 km"), (1.9e6, "1,900 km"), (116_930.0, "116.93 km"), (1500.0, "1,500 m"), (0.5, "0.5 m")],
)
def test_a_length_is_named_in_the_unit_that_fits_it(metres: float, words: str) -> None:
    cfg = SelectionConfig(rule="length", length=metres)
    told = selection_rule(cfg).in_words(cfg)
    assert told == f"the safest path of at most {words} (selection.length)"
