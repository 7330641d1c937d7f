"""Numbers and lists as people read them."""

from __future__ import annotations

import doctest
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from careful_io import texts
from careful_io.texts import (
    NEGLIGIBLE,
    distance_text,
    energy_text,
    in_kilometres,
    interval_text,
    listed_text,
    plain_power,
    probability_text,
    rate_text,
    round_up,
    speed_digits,
)


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
    ("value", "text"),
    [(0.99, "99.0 %"), (0.0995, "10.0 %"), (1e-5, "0.0010 %"), (NEGLIGIBLE, "1e-7 %")],
)
def test_a_probability_at_a_limit_has_the_digits_of_larger_ones(value: float, text: str) -> None:
    assert probability_text(value) == text


def test_units_change_where_it_is_said() -> None:
    assert [plain_power(v) for v in (0.1, 0.0999, 0.0)] == ["0.1", "1e-1", "0"]
    assert [energy_text(3600.0 * h) for h in (999.94, 999.95, -999.94)] == ["999.9 Wh", "1 kWh", "-999.9 Wh"]
    assert [energy_text(3600.0 * h) for h in (999_940.0, 999_950.0)] == ["999.9 kWh", "1,000 kWh"]
    assert [in_kilometres(d) for d in (1999.9, 2000.0, 2500.0)] == [False, True, True]
    assert [distance_text(d) for d in (1999.9, 2000.0, 2.5e6)] == ["1,999.9 m", "2.0 km", "2,500.0 km"]
    assert [speed_digits(v) for v in (2.9, 3.0, 4.0)] == [2, 1, 1]


@given(st.lists(st.sampled_from("abc"), max_size=12), st.integers(1, 9))
def test_a_list_has_so_many_names_and_says_whether_there_are_more(names: list[str], limit: int) -> None:
    shown = listed_text(iter(names), limit)
    if not names:
        assert shown == "none"
    else:
        *first, last = shown.split(", ")
        assert len(first) + (last != "...") == min(len(names), limit)
        assert (last == "...") == (len(names) > limit)
    assert listed_text("abcdefgh") == "a, b, c, d, e, f, g, h"
    assert listed_text("abcdefghi") == "a, b, c, d, e, f, g, h, ..."


def test_the_examples_in_docstrings_are_true() -> None:
    failed, tried = doctest.testmod(texts)
    assert failed == 0
    assert tried > 0
