"""Rates, tests and intervals against their formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl_apps.studies import tables
from pareto_ltl_apps.studies.compare import _points


@given(st.lists(st.booleans()))
def test_flags_survive_being_written(values: list[bool]) -> None:
    assert tables.text_to_flags(tables.flags_to_text(np.array(values, bool))).tolist() == values


@given(st.integers(0, 40), st.integers(0, 40))
def test_mcnemar_is_twice_the_smaller_binomial_tail(b: int, c: int) -> None:
    n = b + c
    tail = sum(math.comb(n, k) for k in range(min(b, c) + 1)) / 2**n
    assert tables.mcnemar_test(b, c) == pytest.approx(min(1.0, 2 * tail) if b != c else 1.0)


def test_mcnemar_of_no_difference_is_one() -> None:
    assert tables.mcnemar_test(0, 0) == 1.0


@given(st.integers(0, 30), st.integers(1, 30))
def test_a_share_of_whole_counts_has_the_interval_of_the_counts(k: int, more: int) -> None:
    n = k + more
    row = tables.mean_chance_columns("p", float(k), n)
    assert (row["p_low"], row["p_high"]) == clopper_pearson(k, n)


def test_a_share_between_counts_has_the_wider_ends() -> None:
    row = tables.mean_chance_columns("p", 2.4, 10)
    assert row["p"] == pytest.approx(0.24)
    assert row["p_low"] == clopper_pearson(2, 10)[0]
    assert row["p_high"] == clopper_pearson(3, 10)[1]


@pytest.mark.statistical
def test_the_interval_of_a_share_holds_the_mean_at_least_as_often_as_it_says() -> None:
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(400):
        chances = rng.beta(0.3, 1.2, 60)  # mean 0.2
        row = tables.mean_chance_columns("p", float(chances.sum()), 60)
        held += row["p_low"] <= 0.2 <= row["p_high"]
    assert held >= 0.95 * 400 - 5 * math.sqrt(400 * 0.95 * 0.05)


def test_the_interval_of_a_mean_is_students() -> None:
    from scipy.stats import t

    values = np.array([0.1, 0.4, 0.35, 0.8])
    expected = t.interval(0.95, 3, loc=values.mean(), scale=values.std(ddof=1) / 2)
    assert tables.mean_interval(values) == pytest.approx(expected)
    assert all(math.isnan(end) for end in tables.mean_interval(values[:1]))


def test_quartiles_leave_out_what_is_not_known() -> None:
    row = tables.quartile_columns("x", [3.0, math.nan, 1.0, 2.0])
    assert (row["x_q25"], row["x"], row["x_q75"]) == (1.5, 2.0, 2.5)
    assert math.isnan(tables.quartile_columns("x", [])["x"])


def test_a_rate_of_nothing_is_not_zero() -> None:
    assert math.isnan(tables.rate_columns("f", np.empty(0, bool))["f"])


def test_a_markdown_table_has_as_many_columns_in_every_line() -> None:
    text = tables.markdown_table("What it is", {"one": str, "two": lambda n: str(n + 1)}, [1, 3])
    lines = text.strip().splitlines()
    assert lines[0] == "**What it is**"
    assert {line.count("|") for line in lines[2:]} == {3}


def test_a_difference_of_one_seed_is_written_without_an_interval() -> None:
    row = {"difference": -0.128, "difference_low": math.nan, "difference_high": math.nan}
    assert _points(row) == "-12.80 %"
    known = row | {"difference_low": -0.2, "difference_high": -0.1}
    assert _points(known) == "-12.80 % (-20.00 to -10.00)"
