"""Numbers as people read them."""

from __future__ import annotations

import doctest
import math
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pareto_ltl.support import atmosphere, display, levels
from pareto_ltl.support.display import (
    NEGLIGIBLE,
    allowed_text,
    answer_text,
    branched_text,
    distance_text,
    energy_text,
    flights_text,
    headline_text,
    in_kilometres,
    interval_text,
    listed_text,
    plain_power,
    probability_text,
    promised_text,
    rate_text,
    round_up,
    speed_digits,
)
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


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.99, "99.0 %"), (0.0995, "10.0 %"), (1e-5, "0.0010 %"), (NEGLIGIBLE, "1e-7 %")],
)
def test_a_probability_at_a_limit_has_the_digits_of_larger_ones(value: float, text: str) -> None:
    assert probability_text(value) == text


@pytest.mark.parametrize(
    ("rate", "low", "high", "shown", "interval"),
    [
        (0.6, 0.59, 0.614, "60 of 100", "59 to 61"),  # an interval of 2.4 flights
        (0.6, 0.59, 0.604, "60.0 of 100", "59.0 to 60.4"),
        (0.25, 0.0, 0.02, "25 of 100", "0 to 2.0"),  # of 2
        (0.0995, 0.0, 0.5, "10 of 100", "0 to 50"),
        (0.01, 0.0, 0.5, "1.0 of 100", "0 to 50"),
        (0.99, 0.5, 0.999, "99 of 100", "50 to 99.90"),
        (0.99999, 0.5, 1.5, "99.99 of 100", "50 to 100"),
        (1.5, 0.5, 1.5, "100 of 100", "50 to 100"),
        (0.00995, 0.0, 0.5, "1 of 100", "0 to 50"),
        (0.0099, 0.0, 0.5, "99 of 10,000", "0 to 5000"),
        (0.0000995, 0.0, 0.001, "1 of 10,000", "0 to 10"),
        (0.000099, 0.0, 0.0002, "99 of 1,000,000", "0 to 200"),
        (0.0, 0.0, 0.01, "0 of 100", "0 to 1.0"),  # by the end of the interval
        (1e-10, 1e-9, 0.0001, "less than 0.001 of 1,000,000", "0.001 to 100"),
    ],
)
def test_flights_are_counted_in_a_hundred_or_more(
    rate: float, low: float, high: float, shown: str, interval: str
) -> None:
    assert flights_text(rate, low, high) == (f"{shown} flights", interval)


def test_a_rate_at_the_floor_of_the_law_is_not_below_it() -> None:
    assert "fewer" not in branched_text("x", 0.02, 0.02)
    assert "fewer than 2.0 of 100" in branched_text("x", 0.019, 0.02)
    assert answer_text(0.02, 0.01, 0.03, "w", 0.02).startswith("2.0 of 100 flights fail (1.0 to 3.0)")
    assert answer_text(0.019, 0.01, 0.03, "w", 0.02).startswith("fewer than 2.0 of 100 flights fail")
    assert headline_text(0.02, 0.01, 0.03, "w", "s", 0.02)[0] == "2.0 of 100 flights"
    shown, note = headline_text(0.019, 0.01, 0.03, "w", "s", 0.02)
    assert shown == "fewer than 2.0 of 100 flights"
    assert note == "in w: the law's data cannot say less; of s 1.9 % (95 %: 1.0 to 3.0 %) fail"
    assert promised_text(0.02, 0.02) == "2.0 %"
    assert promised_text(0.019, 0.02).startswith("below 2.0 %")


def test_a_limit_allows_what_equals_it_in_three_digits() -> None:
    assert allowed_text(0.5 * 1.0005, 0.5) == "50.0 % of 50.0 % allowed"
    assert allowed_text(0.5007, 0.5) == "50.1 %, above the 50.0 % allowed"
    assert allowed_text(0.5, 1.0) == "50.0 %, without a limit"
    assert allowed_text(0.5, 0.999) == "50.0 % of 99.90 % allowed"


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
