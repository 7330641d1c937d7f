"""Corridors hold what they say, judged on flights that did not make them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.random import SeedSequence
from scipy.stats import beta, binom

from exported_plans import Flown
from pareto_ltl.extend import simulate_flights
from pareto_ltl_apps.exports.corridor import SHARES, ellipse_sizes, held_sizes
from pareto_ltl_apps.exports.geojson import leg_hulls
from problems import RARE

FRESH = 20_000


@pytest.fixture(scope="module")
def fresh(flown: Flown) -> np.ndarray:
    path = flown.exported.plan.path
    return simulate_flights(flown.problem, path.u, FRESH, "coherent", SeedSequence(77), path.x).x


def limits(share: float, runs: int, chance: float) -> tuple[float, float]:
    """The least and the most of FRESH flights that an honest size holds, but for ``chance``.

    The share that the k-th smallest of n sizes holds is Beta(k, n + 1 - k), whatever the law.
    """
    k = int(np.ceil((runs + 1) * share - 1e-9))
    low, high = beta.ppf([chance / 4, 1 - chance / 4], k, runs + 1 - k)
    return float(binom.ppf(chance / 4, FRESH, low)) / FRESH, float(
        binom.ppf(1 - chance / 4, FRESH, high)
    ) / FRESH


@pytest.mark.statistical
def test_at_each_time_the_ellipse_holds_its_share_of_fresh_flights(flown: Flown, fresh: np.ndarray) -> None:
    corridor = flown.exported.corridor
    sizes = ellipse_sizes(fresh, corridor.mean, corridor.cov)[:, 1:]
    for level, share in enumerate(SHARES):
        held = (sizes <= corridor.at_time[level, 1:]).mean(axis=0)
        low, high = limits(share, corridor.runs, RARE / sizes.shape[1])
        assert low <= held.min()
        assert held.max() <= high


@pytest.mark.statistical
def test_the_tube_holds_its_share_of_whole_fresh_flights(flown: Flown, fresh: np.ndarray) -> None:
    corridor = flown.exported.corridor
    largest = ellipse_sizes(fresh, corridor.mean, corridor.cov).max(axis=1)
    for level, share in enumerate(SHARES):
        low, high = limits(share, corridor.runs, RARE)
        assert low <= (largest <= corridor.whole[level]).mean() <= high
    at_95 = ellipse_sizes(fresh, corridor.mean, corridor.cov) <= corridor.at_time[SHARES.index(0.95)]
    assert at_95.all(axis=1).mean() < 0.9  # why a corridor at a time is none of whole flights


def test_a_flight_inside_all_ellipses_never_leaves_the_hulls_of_its_legs(
    flown: Flown, fresh: np.ndarray
) -> None:
    corridor = flown.exported.corridor
    size = corridor.whole[SHARES.index(0.95)]
    inside = fresh[(ellipse_sizes(fresh, corridor.mean, corridor.cov) <= size).all(axis=1)][:200]
    hulls = leg_hulls(corridor.outlines(np.full(len(corridor.mean), size)))
    for k, hull in enumerate(hulls):
        legs = shapely.linestrings(inside[:, k : k + 2])
        assert shapely.covers(shapely.buffer(hull, 1e-3), legs).all()


def test_sizes_are_the_order_statistics_of_exchangeable_draws() -> None:
    sizes = np.arange(1.0, 100.0)[:, None]  # 99 of them: p of 100 is the (100 p)-th
    np.testing.assert_array_equal(held_sizes(sizes, np.array(SHARES))[:, 0], [50, 90, 95, 99])
    assert held_sizes(sizes[:10], np.array([0.99])) == 10.0  # too few: the largest


def test_levels_are_nested_and_whole_flights_need_more_room(flown: Flown) -> None:
    corridor = flown.exported.corridor
    assert (np.diff(corridor.at_time, axis=0) >= 0).all()
    assert (np.diff(corridor.whole) > 0).all()
    assert (corridor.whole[:, None] >= corridor.at_time).all()
