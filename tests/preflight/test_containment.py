"""Volumes hold what they say, rare rates agree with counts, and no fixed buffer is smaller."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from numpy.random import SeedSequence

from landmarks import LANDMARK_SCENE, LANDMARK_WAY, landmark_problem
from pareto_ltl.extend import plain_sample, weighted_samples
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.support.counts import binomial_tail
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.preflight.containment import Sizing, check_numbers, volume_event
from pareto_ltl_apps.preflight.leaving import Area, border_area, corridor_area, rarer_rate
from pareto_ltl_apps.preflight.volumes import (
    STARTS,
    Deviations,
    Shape,
    Volumes,
    buffer_distances,
    buffer_volume_time,
    polygon_area,
    smallest_shape,
)
from pareto_ltl_verify.claims.containment import leaves_volumes
from problems import KM, RARE

WAY = np.vstack([LANDMARK_WAY[:23], [[13.4 * KM, 13.4 * KM]]])
RUNS = 4000


@cache
def planned():
    """A problem without landmarks, and a straight path of it."""
    problem = landmark_problem(replace(LANDMARK_SCENE, landmarks=()))
    return problem, evaluate_path(problem, WAY, "")


@cache
def flown(runs: int = RUNS, seed: int = 1):
    """Plain flights of that path."""
    return plain_sample(*planned(), runs, SeedSequence(seed))


def sizing(runs: int = RUNS) -> Sizing:
    return Sizing(*planned(), flown(runs), SeedSequence(7).spawn(3))


# --- geometry ---------------------------------------------------------------------------------


def test_both_roads_agree_on_which_flights_leave_volumes():
    about = Deviations.of(flown().x, 100.0)
    volumes = about.volumes(Shape(1.5, 0.2, 0.3, 0.2, 0.1), 1.8)
    left = volumes.left_by(flown().x)
    np.testing.assert_array_equal(left, leaves_volumes(volumes.outlines, flown().x))
    assert 0.01 < left.mean() < 0.9


def test_the_size_of_volumes_is_the_sum_of_area_and_time():
    square = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0]])
    assert polygon_area(square) == pytest.approx(6.0)
    assert Volumes((square, 2.0 * square), 10.0).volume_time == pytest.approx(10.0 * (6.0 + 24.0))


def test_ellipses_hold_exactly_the_flights_of_their_size():
    about = Deviations.of(flown().x, 100.0)
    shape = Shape(1.3, 0.1, 0.2)
    sizes = about.sizes(shape, about.products(flown().x))
    off = flown().x - about.mean
    inverse = np.linalg.inv(about.ellipses(shape))
    slow = np.sqrt(np.einsum("nti,tij,ntj->nt", off, inverse, off)).max(axis=1)
    np.testing.assert_allclose(sizes, slow, rtol=1e-9)


def test_circles_of_one_radius_are_among_the_shapes():
    about = Deviations.of(flown().x, 100.0)
    axes = np.linalg.eigvalsh(about.ellipses(Shape(1.0, 1.0, 1.0)))
    np.testing.assert_allclose(axes, axes[0, 0], rtol=1e-9)


def test_the_radius_of_a_buffer_is_the_farthest_distance_from_the_leg_that_is_flown():
    route = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    x = np.array([[[0.0, 1.0], [10.0, 2.0], [13.0, 10.0]], [[-4.0, 0.0], [10.0, 0.0], [10.0, 10.0]]])
    np.testing.assert_allclose(buffer_distances(route, x), [3.0, 4.0])
    legs = [shapely.LineString(route[k : k + 2]).buffer(2.0, quad_segs=400) for k in (0, 1)]
    assert buffer_volume_time(route, 2.0, 5.0) == pytest.approx(5.0 * sum(leg.area for leg in legs), rel=1e-4)


def test_a_flight_that_cuts_a_corner_leaves_a_corridor_between_its_positions():
    route = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]) * KM
    area = corridor_area(route, 2.0 * KM)
    cuts = np.array([[[0.0, 0.0], [5.0, 0.0], [10.0, 6.0]], [[0.0, 0.0], [9.5, 0.0], [10.0, 6.0]]]) * KM
    np.testing.assert_array_equal(area.left_by(cuts), [True, False])


def test_an_area_may_change_from_step_to_step():
    west, east = shapely.box(0.0, 0.0, 6.0, 1.0), shapely.box(5.0, 0.0, 12.0, 1.0)
    area = Area("volume", (west, east))
    x = np.array([[[1.0, 0.5], [5.5, 0.5], [11.0, 0.5]], [[1.0, 0.5], [4.0, 0.5], [11.0, 0.5]]])
    np.testing.assert_array_equal(area.left_by(x), [False, True])


# --- rates ------------------------------------------------------------------------------------


@pytest.mark.statistical
def test_weighted_flights_leave_a_corridor_as_often_as_plain_ones():
    problem, path = planned()
    area = corridor_area(path.x, 9.6 * KM)
    many = plain_sample(problem, path, 40_000, SeedSequence(11))
    count = int(area.left_by(many.x).sum())
    assert 4 <= count <= 400
    rare = rarer_rate(problem, path, area.event(), flown(), SeedSequence(12))
    (sample,) = weighted_samples(problem, path, area.event(), RUNS, SeedSequence(13))
    weighted = sample.rate(area.left_by(sample.x))
    for rate in (rare, weighted):
        spread = 4.0 * (rate.high - rate.low)  # 16 standard errors, with the error of the count beside it
        low, high = max(rate.failure - spread, 1e-9), min(rate.failure + spread, 1.0)
        assert float(binomial_tail(count, len(many), high)) > RARE
        assert float(binomial_tail(len(many) - count, len(many), 1.0 - low)) > RARE
    assert weighted.high - weighted.low < 0.5 * weighted.failure


def test_the_weight_of_a_flight_is_one_in_the_mean():
    problem, path = planned()
    about = Deviations.of(flown().x, problem.motion.dt)
    event = volume_event(about, Shape(), about.products(flown().x), 1e-4)
    samples = weighted_samples(problem, path, event, RUNS, SeedSequence(5), 2)
    assert len(samples) == 2
    for sample in samples:
        assert abs(sample.weight.mean() - 1.0) < 6.0 * sample.weight.std() / math.sqrt(RUNS)
    assert not np.array_equal(samples[0].x, samples[1].x)


def test_a_wide_border_is_left_by_no_flight():
    problem, path = planned()
    bounds = problem.scene.bounds + np.array([[-1000.0 * KM], [1000.0 * KM]])
    rate = rarer_rate(problem, path, border_area(bounds, len(path.u)).event(), flown(), SeedSequence(3))
    assert rate.failure == 0.0
    assert not rate.weighted


# --- volumes ----------------------------------------------------------------------------------


@pytest.mark.statistical
def test_volumes_and_buffers_are_left_at_most_as_often_as_allowed():
    problem, path = planned()
    levels, skipped = sizing().levels([0.1, 1e-2, 1e-3])
    assert not skipped
    assert [level.rate.weighted for level in levels] == [False, True, True]
    many = plain_sample(problem, path, 40_000, SeedSequence(21)).x
    apart = buffer_distances(path.x, many)
    for level in levels:
        counts = int(level.volumes.left_by(many).sum()), int((apart > level.radius).sum())
        for count in counts:  # the limit is itself from flights: half as much again
            assert float(binomial_tail(count, len(many), 1.5 * level.in_all)) > RARE
        assert level.share < 1.02
    sizes = [level.volumes.volume_time for level in levels]
    assert sizes == sorted(sizes)


def test_the_same_seeds_give_the_same_volumes():
    one, other = (sizing().levels([0.1])[0][0] for _ in range(2))
    assert one.rate == other.rate
    for a, b in zip(one.volumes.outlines, other.volumes.outlines, strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_search_finds_no_larger_volumes_than_it_begins_with():
    about = Deviations.of(flown().x, 100.0)
    products = about.products(flown().x)

    def size(shape: Shape) -> float:
        sizes = np.sort(about.sizes(shape, products))
        return float(shapely.area(about.hulls(shape, float(sizes[-201]))).sum())

    found = size(smallest_shape(about, products, 0.05))
    assert found <= 1.001 * min(size(Shape.of(np.array(start))) for start in STARTS)


def test_levels_that_limit_nothing_are_named():
    problem, path = planned()
    hours = path.t[-1] / 3600.0
    assert hours < 1.0
    long = Sizing(problem, replace(path, t=path.t * 100.0), flown(), SeedSequence(7).spawn(3))
    levels, skipped = long.levels([0.1])
    assert levels == ()
    assert "limits nothing" in skipped[0]


@pytest.mark.parametrize(
    ("widths", "levels", "flights", "said"),
    [
        ([0.0], [1e-3], 1000, "corridor must be wider than 0"),
        ([1e9], [1e-3], 1000, "twice the map's diagonal"),
        ([], [0.5], 1000, "1e-6 to 0.1 per flight hour"),
        ([], [1e-9], 1000, "1e-6 to 0.1 per flight hour"),
        ([], [math.nan], 1000, "1e-6 to 0.1 per flight hour"),
        ([], [1e-3], 10, "flights must be 1,000"),
    ],
)
def test_numbers_out_of_range_are_named(widths, levels, flights, said):
    with pytest.raises(ConfigError, match=said):
        check_numbers(planned()[0].scene, widths, levels, flights)
