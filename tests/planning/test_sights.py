"""Landmarks on the way: which are crossed, lines led through them, and what keeps a polish in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from landmarks import LANDMARK_SCENE, landmark_problem
from pareto_ltl.kernels.attraction import add_attraction
from pareto_ltl.planning.refine.starts import roadmap_starts
from pareto_ltl.planning.routes.roadmap import led_lines
from pareto_ltl.planning.routes.search_map import sights
from plane_logic.margin import Slope
from problems import KM, box

MARKS = (box(5, 9, 7, 11), box(10, 4, 12, 6))
WALL = box(6, 12, 18, 12.5)


@pytest.fixture(scope="module")
def problem():
    return landmark_problem(replace(LANDMARK_SCENE, landmarks=MARKS, obstacles=(WALL,)))


def test_legs_that_cross_a_landmark_are_found(problem):
    x = np.array([[2, 2], [6, 10], [6, 10.5], [11, 3], [11, 8]]) * KM
    expected = [
        [shapely.LineString(x[t : t + 2]).intersects(shapely.Polygon(mark)) for mark in MARKS]
        for t in range(len(x) - 1)
    ]
    np.testing.assert_array_equal(sights(problem, x), expected)
    assert sights(landmark_problem(replace(LANDMARK_SCENE, landmarks=())), x).shape == (4, 0)


def test_lines_are_led_through_each_landmark_and_through_both(problem):
    line = np.array([[2, 2], [16, 10]]) * KM
    led = led_lines(problem, [line])
    crossed = {tuple(sights(problem, x).any(axis=0).tolist()) for x in led}
    assert {(True, False), (True, True)} <= crossed
    for x in led:
        np.testing.assert_array_equal(x[[0, -1]], line[[0, -1]])
        assert not shapely.LineString(x).intersects(shapely.Polygon(WALL))


def test_a_line_is_led_through_one_landmark_on_both_ways(problem):
    """Out and back past one landmark: it is tried in each leg, and in both."""
    line = np.array([[2, 2], [16, 10], [2, 11.5]]) * KM
    first = np.array([sights(problem, x)[:, 0] for x in led_lines(problem, [line]) if len(x) == 5])
    assert any(crossed[:2].any() and crossed[2:].any() for crossed in first)


def test_a_landmark_behind_an_obstacle_is_not_entered_through_it(problem):
    behind = replace(LANDMARK_SCENE, landmarks=(box(11, 14, 13, 16),), obstacles=(box(1, 12, 19, 12.5),))
    assert led_lines(landmark_problem(behind), [np.array([[2, 2], [16, 10]]) * KM]) == []


@pytest.mark.parametrize("seed", range(4))
def test_the_slope_of_an_attraction_is_that_of_finite_differences(problem, seed):
    rng = np.random.default_rng(seed)
    x = np.linspace([2, 2], [14, 13], 13) * KM + rng.normal(0.0, 300.0, (13, 2))
    off = np.arange(13)[:, None, None] * 120.0 * rng.standard_normal((2, 400))  # one error for a flight
    marks = problem.laws["coherent"].landmarks

    def value(places, slope=None):
        slope = Slope(np.zeros((13, 2)), np.zeros((13, 3))) if slope is None else slope
        return add_attraction(marks, places, off, 900.0, 0.3, slope)

    here = Slope(np.zeros((13, 2)), np.zeros((13, 3)))
    assert value(x, here) > 0.0
    assert np.abs(here.gradient).max() > 0.0
    size = np.abs(here.gradient).max()
    for t in np.argsort(-np.linalg.norm(here.gradient, axis=1))[:3]:
        for c in (0, 1):
            up, down = x.copy(), x.copy()
            up[t, c] += 5.0
            down[t, c] -= 5.0
            slope = (value(up) - value(down)) / 10.0
            # Deviations of the two ends of a leg differ a little: slopes are close, not equal.
            assert here.gradient[t, c] == pytest.approx(slope, rel=0.25, abs=0.1 * size)
    assert (here.hessian[:, [0, 2]] >= 0.0).all()


def test_starts_lead_through_landmarks_and_past_them(problem):
    """A landmark cannot make a plan worse: paths without it compete."""
    seen = {sights(problem, start.x).any() for start in roadmap_starts(problem)}
    assert seen == {True, False}
