"""Chances of counts, against ``scipy.stats``."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, binomtest, hypergeom, norm

from pareto_ltl.support.counts import (
    binomial_tail,
    clopper_pearson,
    hypergeometric_tail,
    paired_difference,
)


@settings(deadline=None)
@given(st.integers(1, 5000), st.floats(0.0, 1.0), st.data())
def test_the_binomial_tail_is_that_of_the_law(runs: int, chance: float, data: st.DataObject) -> None:
    least = np.array(data.draw(st.lists(st.integers(-1, runs + 1), min_size=1, max_size=5)))
    expected = binom.sf(least - 1, runs, chance)
    np.testing.assert_allclose(binomial_tail(least, np.full(len(least), runs), chance), expected, rtol=1e-9)


@settings(deadline=None)
@given(st.integers(1, 100_000), st.data())
def test_the_hypergeometric_tail_is_that_of_the_law(total: int, data: st.DataObject) -> None:
    marked, drawn = (data.draw(st.integers(0, total)) for _ in "md")
    least = data.draw(st.integers(-1, min(marked, drawn) + 1))
    expected = hypergeom.sf(least - 1, total, marked, drawn)
    assert hypergeometric_tail(least, total, marked, drawn) == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_the_difference_of_pairs_has_an_interval_that_covers() -> None:
    """The true difference is 0.1; of 400 studies at least 355 cover it (chance of fewer at 95 %: 1e-7)."""
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(400):
        draws = rng.random(300)
        others = np.where(rng.random(300) < 0.5, draws, rng.random(300))  # half of the pairs share their draw
        _, low, high = paired_difference(draws < 0.1, others < 0.2)
        covered += low <= 0.1 <= high
    assert covered >= 355
    assert paired_difference(np.zeros(50, bool), np.zeros(50, bool))[0] == 0.0


@given(st.integers(0, 60), st.integers(0, 60), st.integers(0, 60))
def test_the_interval_of_pairs_is_the_normal_one_with_a_flight_more_of_each_kind(
    b: int, c: int, both: int
) -> None:
    n = b + c + both + 1
    first = np.array([False] * b + [True] * (c + both) + [False])
    second = np.array([True] * b + [False] * c + [True] * both + [False])
    middle, low, high = paired_difference(first, second)
    more = np.array([1] * (b + 1) + [-1] * (c + 1) + [0] * (n - b - c), float)
    half = norm.ppf(0.975) * more.std() / np.sqrt(n + 2)
    assert middle == pytest.approx(second.mean() - first.mean())
    assert low == pytest.approx(max(more.mean() - half, -1.0), abs=1e-6)
    assert high == pytest.approx(min(more.mean() + half, 1.0), abs=1e-6)


@pytest.mark.parametrize(
    ("failures", "runs"), [(0, 1), (1, 1), (0, 50), (3, 50), (49, 50), (50, 50), (87, 20_000)]
)
@pytest.mark.parametrize("confidence", [0.9, 0.95])
def test_the_exact_interval_is_the_one_of_scipy(failures: int, runs: int, confidence: float) -> None:
    expected = binomtest(failures, runs).proportion_ci(confidence, "exact")
    np.testing.assert_allclose(clopper_pearson(failures, runs, confidence), expected, rtol=1e-9)
