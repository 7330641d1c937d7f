"""Numbers as people read them."""

from __future__ import annotations

import doctest
import math
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pareto_ltl.support import atmosphere, display, levels
from pareto_ltl.support.display import interval_text, probability_text, rate_text, round_up
from pareto_ltl_apps.formats import speed_units


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0 %"),
        (1.0, "100 %"),
        (1.3, "100 %"),
        (0.0123, "1.2 %"),
        (0.4567, "45.7 %"),
        (0.0995, "10.0 %"),
        (0.99982, "99.98 %"),
        (1 - 1e-9, "99.99 %"),
        (3.21e-5, "0.0032 %"),
        (3.21e-7, "3.2e-5 %"),
        (2e-8, "2e-6 %"),
        (1e-12, "< 1e-7 %"),
        (math.nan, "-"),
    ],
)
def test_a_probability_has_the_digits_that_matter(value: float, text: str) -> None:
    assert probability_text(value) == text


@given(st.floats(1e-9, 1.0))
def test_the_text_of_a_probability_is_never_wrong_by_more_than_a_twentieth(value: float) -> None:
    told = float(probability_text(value).removesuffix(" %")) / 100
    assert told == pytest.approx(value, rel=0.05)
    assert (told < 1.0) == (value < 1.0)
    assert "0.0000" not in probability_text(value)


def test_a_rate_stands_beside_its_interval() -> None:
    assert rate_text(0.162, 0.1312, 0.1969) == "16.2 % (95 %: 13.1 to 19.7 %)"
    assert interval_text(0.0, 1e-12) == "0 to < 1e-7 %"


@given(st.floats(1e-9, 0.99))
def test_a_limit_rounded_up_allows_the_probability_and_little_more(value: float) -> None:
    assert value <= round_up(value) <= 1.11 * value


@pytest.mark.parametrize(
    "module", [atmosphere, display, levels, speed_units], ids=lambda module: module.__name__
)
def test_the_examples_in_docstrings_are_true(module: ModuleType) -> None:
    failed, tried = doctest.testmod(module)
    assert failed == 0
    assert tried > 0
