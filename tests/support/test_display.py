"""Numbers as people read them."""

from __future__ import annotations

import doctest
from types import ModuleType

import pytest

from pareto_ltl.support import display, levels
from pareto_ltl.support.display import (
    allowed_text,
    answer_text,
    branched_text,
    flights_text,
    headline_text,
    promised_text,
)
from pareto_ltl_apps.formats import speed_units


@pytest.mark.parametrize("module", [display, levels, speed_units], ids=lambda module: module.__name__)
def test_the_examples_in_docstrings_are_true(module: ModuleType) -> None:
    failed, tried = doctest.testmod(module)
    assert failed == 0
    assert tried > 0


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
