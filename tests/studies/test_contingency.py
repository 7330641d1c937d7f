"""The part of the gain of new plans that branches have."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pareto_ltl_apps.studies.replanning import contingency


def flights(*failed: int) -> list[np.ndarray]:
    """For each number, 400 flights of which so many fail, the first ones."""
    return [np.arange(400) < number for number in failed]


def test_branches_that_are_new_plans_have_the_whole_gain() -> None:
    alone, told = flights(80, 20)
    assert contingency(alone, told, told) == pytest.approx((1.0, 1.0, 1.0))


def test_branches_that_save_nothing_have_no_part() -> None:
    alone, replanned = flights(80, 20)
    assert contingency(alone, alone, replanned) == pytest.approx((0.0, 0.0, 0.0))


def test_the_interval_is_that_of_the_share_of_saved_flights() -> None:
    """Of 60 saved flights branches save 45: a binomial share of 3/4, within 15 % of its normal interval."""
    alone, branched, replanned = flights(80, 35, 20)
    middle, low, high = contingency(alone, branched, replanned)
    assert middle == pytest.approx(0.75)
    half = 1.96 * math.sqrt(0.75 * 0.25 / 60)
    assert middle - low == pytest.approx(half, rel=0.15)
    assert high - middle == pytest.approx(half, rel=0.15)


def test_without_a_gain_there_is_no_part() -> None:
    alone, branched, worse = flights(20, 10, 40)
    assert all(math.isnan(part) for part in contingency(alone, branched, worse))
