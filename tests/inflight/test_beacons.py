"""Beacons along a plan: what each is worth, and where the best ones are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from landmarks import LANDMARK_SCENE, LANDMARK_WAY, landmark_problem
from pareto_ltl.extend import which_fail
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.pack import disc
from pareto_ltl.settings import RobotConfig
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.flight.beacon_map import SHORTLIST, BeaconMap, beacon_places
from problems import KM

ROBOT = RobotConfig(dt=100.0, u_max=25.0, start_sd=300.0, fix_sd=50.0)
WAY = np.vstack([LANDMARK_WAY[:23], [[13.4 * KM, 13.4 * KM]]])  # ends just within the region


@pytest.fixture(scope="module")
def problem():
    return landmark_problem(replace(LANDMARK_SCENE, landmarks=()))


@pytest.fixture(scope="module")
def path(problem):
    return evaluate_path(problem, WAY, "")


def test_places_lie_on_and_beside_the_path_and_on_the_map(problem, path):
    places = beacon_places(problem, path, 1.0 * KM)
    on = places.aside == 0.0
    assert on.sum() >= 20
    assert (~on).sum() >= 20
    np.testing.assert_array_equal(places.at[on], path.x[places.step[on]])
    off = np.linalg.norm(places.at - path.x[places.step], axis=1)
    np.testing.assert_allclose(off, np.abs(places.aside), atol=1e-6)
    low, high = problem.scene.bounds
    assert ((places.at >= low + KM) & (places.at <= high - KM)).all()


def test_a_disc_is_a_polygon_of_its_area():
    import shapely

    shape = shapely.Polygon(disc(np.array([3.0, -2.0]), 5.0))
    assert shape.area == pytest.approx(np.pi * 25.0)
    assert shape.centroid.coords[0] == pytest.approx((3.0, -2.0))


@pytest.mark.statistical
def test_the_best_place_saves_what_a_landmark_there_saves(problem, path):
    found = BeaconMap.of(problem, ROBOT, path, 1.0 * KM, 2, 500, SeedSequence(5))
    one, two = found.sites
    assert found.failure[one.number] in np.sort(found.failure)[:SHORTLIST]
    assert found.failure.max() > 1.5 * found.failure.min()
    drawn = problem.with_beacons(ROBOT, found.places.at[[one.number]], 1.0 * KM)
    failed = [which_fail(p, [path], 8000, SeedSequence(99))[0] for p in (problem, drawn)]
    _, low, high = paired_difference(*failed)
    assert high < 0.0
    assert low - 0.02 < one.saved[0] < high + 0.02
    assert two.rate.failure < one.rate.failure + 0.005


def test_a_robot_that_takes_no_fixes_has_no_use_for_beacons():
    held = landmark_problem(replace(LANDMARK_SCENE, landmarks=()), feedback_time=60.0)
    with pytest.raises(ConfigError, match="feedback_time=null"):
        held.with_beacons(replace(ROBOT, feedback_time=60.0), np.array([[9.0, 9.0]]) * KM, KM)
