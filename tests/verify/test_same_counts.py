"""The test that two samples of counts have one distribution: its level and its power."""

from __future__ import annotations

import numpy as np

from pareto_ltl_verify.flights import RARE, same_counts


def test_samples_of_one_distribution_differ_no_more_often_than_the_level_says():
    """400 pairs of counts of paths that fail together: p < 0.01 in at most 17 of them (chance 1e-6)."""
    rng = np.random.default_rng(3)
    chances = []
    for _ in range(400):
        rate = rng.beta(0.3, 2.0, size=3000)
        failed = rng.binomial(10, rate)
        chances.append(same_counts(failed[:2000], failed[2000:]))
    assert sum(chance < 0.01 for chance in chances) <= 17
    assert min(chances) > RARE


def test_failures_of_unlike_winds_are_told_from_failures_in_the_same_ones():
    rng = np.random.default_rng(4)
    together = rng.binomial(10, rng.beta(0.3, 8.0, size=4000))
    apart = rng.binomial(10, together.mean() / 10, size=2000)
    assert same_counts(together[:2000], together[2000:]) > RARE
    assert same_counts(apart, together[2000:]) < RARE


def test_flights_that_never_fail_are_alike():
    assert same_counts(np.zeros(5, int), np.zeros(7, int)) == 1.0
