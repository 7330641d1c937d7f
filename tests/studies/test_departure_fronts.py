"""Fronts compared: failure at common lengths, what chance explains, and which starts are planned again."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.random import Generator

from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl_apps.studies.departure_fronts import (
    LEAST_VARIANCE,
    FlownFront,
    SeedSpread,
    common_lengths,
    compare_fronts,
    failure_ratio,
    flight_variance,
    flown_front,
    map_lengths,
    pooled_front,
    rates_at,
    score,
    seed_spread,
    starts_to_repeat,
)

LENGTHS = np.array([100.0, 110.0, 125.0, 150.0])
RATES = np.array([0.3, 0.12, 0.05, 0.02])
NO_SPREAD = SeedSpread(0.0, 0)


def flags(counts: list[int], n: int = 1000) -> BoolArray:
    """Flights of which the first ``counts`` fail."""
    return np.arange(n) < np.array(counts)[:, None]


def synthetic(rng: Generator, draws: FloatArray, rates: FloatArray, shared: float = 0.7) -> FlownFront:
    """A front with true ``rates``; a share of the flights fail by the common ``draws`` (n,)."""
    own = rng.random((1, len(draws)))
    used = np.where(rng.random(len(draws)) < shared, draws, own)
    return flown_front(LENGTHS, used < rates[:, None])


# --- one front ---------------------------------------------------------------------------------


@given(st.integers(0, 10_000))
def test_a_front_has_the_paths_that_no_other_beats(seed: int) -> None:
    rng = np.random.default_rng(seed)
    length, failed = rng.choice(50, 8, replace=False).astype(float), rng.random((8, 40)) < rng.random((8, 1))
    front = flown_front(length, failed)
    kept = [
        i for i in np.argsort(length)
        if not any(failed[j].sum() <= failed[i].sum() for j in range(8) if length[j] < length[i])
    ]  # fmt: skip
    np.testing.assert_array_equal(front.length, length[kept])
    np.testing.assert_array_equal(front.failed, failed[kept])


def test_failure_between_two_paths_is_interpolated_in_the_logarithm() -> None:
    front = flown_front(np.array([100.0, 200.0]), flags([400, 100]))
    rates = rates_at(front, np.array([99.0, 100.0, 150.0, 300.0]))
    assert np.isnan(rates[0]).all()
    np.testing.assert_allclose(rates[1:, 0], [0.4, 0.2, 0.1])  # √(0.4 x 0.1) = 0.2
    assert ((rates[1:, 1] < rates[1:, 0]) & (rates[1:, 0] < rates[1:, 2])).all()


def test_the_score_is_the_mean_logarithm_with_certain_failure_below_the_shortest_path() -> None:
    front = flown_front(np.array([100.0, 200.0]), flags([400, 100]))
    known = [math.log(400.5 / 1001), 0.5 * math.log(400.5 / 1001) + 0.5 * math.log(100.5 / 1001)]
    assert score(front, np.array([90.0, 100.0, 150.0])) == pytest.approx((0.0 + sum(known)) / 3)


def test_seeds_together_have_the_best_paths_of_each() -> None:
    one, two = (
        flown_front(LENGTHS, flags([300, 120, 50, 20])),
        flown_front(LENGTHS, flags([290, 130, 40, 30])),
    )
    assert pooled_front([one, two]).failed.sum(axis=1).tolist() == [290, 120, 40, 20]


def test_common_lengths_reach_from_the_longest_shortest_to_the_median_longest_path() -> None:
    ends = {0.0: (100.0, 180.0), 1.0: (120.0, 200.0), 2.0: (110.0, 400.0)}
    fronts = {time: [flown_front(np.array(span), flags([300, 20]))] for time, span in ends.items()}
    limits = common_lengths(fronts)
    assert (limits[0], limits[-1]) == (120.0, 200.0)
    heat = map_lengths(fronts)
    assert np.allclose(np.diff(heat), 5.0)  # 100 km in at most 24 rows
    assert (heat[0], heat[-1]) == (100.0, 200.0)


# --- two fronts --------------------------------------------------------------------------------


def test_the_variance_of_a_difference_is_that_of_resampled_flights() -> None:
    """1,500 bootstrap samples give a standard deviation within 10 %: five times its own standard error."""
    rng = np.random.default_rng(3)
    draws = rng.random(2000)
    first, second = (synthetic(rng, draws, scale * RATES) for scale in (1.0, 1.4))
    limits = np.linspace(100.0, 150.0, 5)

    def difference(rows: FloatArray) -> float:
        return score(FlownFront(second.length, second.failed[:, rows]), limits) - score(
            FlownFront(first.length, first.failed[:, rows]), limits
        )

    again = [difference(rng.integers(0, 2000, 2000)) for _ in range(1500)]
    assert math.sqrt(flight_variance(first, second, limits)) == pytest.approx(float(np.std(again)), rel=0.1)


def test_the_ratio_is_the_geometric_mean_over_lengths() -> None:
    first, second = (
        flown_front(LENGTHS, flags(counts)) for counts in ([300, 120, 50, 20], [400, 200, 60, 25])
    )
    gaps = [math.log((b + 0.5) / (a + 0.5)) for a, b in ((300, 400), (120, 200), (50, 60), (20, 25))]
    ratio, low, high = failure_ratio([first], [second], LENGTHS, NO_SPREAD, 1)
    assert ratio == pytest.approx(math.exp(sum(gaps) / 4))
    assert low * high == pytest.approx(ratio**2)


def test_starts_without_a_failure_do_not_differ() -> None:
    first, second = (flown_front(LENGTHS[:1], flags([count], 400)) for count in (0, 1))
    ratio, low, high = failure_ratio([first], [second], LENGTHS[:1], NO_SPREAD, 1)
    assert ratio == pytest.approx(3.0)
    assert low < 1.0 < high


def test_variances_of_the_least_of_normal_numbers_are_those_of_their_densities() -> None:
    from scipy.special import ndtr

    x = np.linspace(-9.0, 9.0, 20_001)
    for count, told in enumerate(LEAST_VARIANCE, 1):
        density = count * (1.0 - ndtr(x)) ** (count - 1) * np.exp(-0.5 * x**2) / math.sqrt(2.0 * math.pi)
        mean = np.trapezoid(x * density, x)
        assert told == pytest.approx(np.trapezoid((x - mean) ** 2 * density, x), abs=1e-5)


def test_the_spread_between_seeds_is_that_within_starts() -> None:
    counts = {0.0: [100, 200, 150], 1.0: [20, 30], 2.0: [400]}
    fronts = {time: [flown_front(LENGTHS[:1], flags([k])) for k in own] for time, own in counts.items()}
    logs = [np.log((np.array(own) + 0.5) / 1001) for own in counts.values()]
    expected = math.sqrt((2 * np.var(logs[0], ddof=1) + np.var(logs[1], ddof=1)) / 3)
    spread = seed_spread(fronts, LENGTHS[:1])
    assert (spread.sd, spread.freedom) == (pytest.approx(expected), 3)


def studied(rng: Generator, scale: float, seeds: int, n: int = 1500) -> tuple[float, float, float]:
    """The ratio of one of four starts to the first, with lucky and unlucky seeds and random winds."""
    draws = rng.random(n)
    luck = np.exp(0.2 * rng.standard_normal((4, seeds)))
    worse = np.array([1.0, scale, 1.0, 1.0])[:, None] * luck
    fronts = {
        float(start): [synthetic(rng, draws, np.minimum(factor * RATES, 1.0)) for factor in own]
        for start, own in enumerate(worse)
    }
    spread = seed_spread(fronts, LENGTHS)
    return failure_ratio(fronts[0.0], fronts[1.0], LENGTHS, spread, 1)


@pytest.mark.parametrize("seeds", [2, 3])
def test_the_interval_of_a_ratio_covers_the_true_one(seeds: int) -> None:
    """Of 300 studies at least 263 cover it: with a coverage of 95 % fewer have a chance of 2e-7."""
    rng = np.random.default_rng(seeds)
    ends = np.array([studied(rng, 1.5, seeds) for _ in range(300)])
    assert ((ends[:, 1] <= 1.5) & (ends[:, 2] >= 1.5)).sum() >= 263


# --- all starts --------------------------------------------------------------------------------


def certain(time_rates: dict[float, list[list[int]]]) -> dict[float, list[FlownFront]]:
    """Fronts of starts with these failures of 20,000 flights, by seed."""
    return {
        time: [flown_front(LENGTHS[: len(counts)], flags(counts, 20_000)) for counts in own]
        for time, own in time_rates.items()
    }


def test_a_start_that_fails_less_at_every_length_is_recommended_alone() -> None:
    good, bad = [[6000, 2400, 1000, 400]] * 2, [[12_000, 4800, 2000, 800]] * 2
    comparison = compare_fronts(certain({0.0: bad, 1.0: good, 2.0: bad}))
    assert comparison.alike == (1.0,)
    assert comparison.ratios[0.0][0] == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize("best", [0.0, 1.0, 2.0])
def test_of_starts_that_do_not_differ_the_earliest_is_recommended_whichever_seems_best(best: float) -> None:
    """Which start seems best is luck of the seed; the recommendation must not follow it."""
    lucky, usual = [[560, 230], [700, 290]], [[620, 250], [740, 300]]
    comparison = compare_fronts(certain({time: lucky if time == best else usual for time in (0.0, 1.0, 2.0)}))
    assert (comparison.best, comparison.recommended) == (best, 0.0)
    assert comparison.alike == (0.0, 1.0, 2.0)


def test_a_start_that_seems_worse_is_not_recommended_for_being_early() -> None:
    """The first start may be as good, but its estimate is 1.4 times the estimate of the second."""
    few = {time: [flown_front(LENGTHS[:1], flags([k], 400))] for time, k in ((0.0, 28), (1.0, 20))}
    few[0.0][0] = flown_front(LENGTHS[:1], np.roll(few[0.0][0].failed, 20, axis=1))
    comparison = compare_fronts(few)
    assert comparison.alike == (0.0, 1.0)
    assert comparison.recommended == 1.0


def test_a_longer_plan_does_not_win_by_its_length() -> None:
    """The second start has the least failure of all, with a path that the first one could make longer too."""
    fronts = certain({0.0: [[2000, 900, 400]], 1.0: [[4000, 1800, 800, 390]]})
    comparison = compare_fronts(fronts)
    assert comparison.best == 0.0


def test_the_better_half_is_planned_again_and_then_what_may_be_the_best() -> None:
    worst, middle, good = [9000, 4000], [5000, 2200], [2000, 900]
    once = certain({0.0: [worst], 1.0: [middle], 2.0: [good], 3.0: [good]})
    assert starts_to_repeat(once, 3) == (2.0, 3.0)
    twice = certain({0.0: [worst], 1.0: [middle], 2.0: [good] * 2, 3.0: [good, [2040, 910]]})
    assert starts_to_repeat(twice, 3) == (2.0, 3.0)
    assert starts_to_repeat(twice, 2) == ()
    assert starts_to_repeat(once, 1) == ()
    assert starts_to_repeat(certain({0.0: [good]}), 3) == ()


def test_a_seed_without_a_plan_counts_as_certain_failure() -> None:
    fronts = certain({0.0: [[2000, 900]] * 2, 1.0: [[2000, 900]] * 2})
    fronts[1.0][1] = flown_front(np.zeros(0), np.zeros((0, 20_000), bool))
    assert compare_fronts(fronts).spread.sd > 1.0
