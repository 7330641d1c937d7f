"""One step of a tree towards a target, within the airspeed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from pareto_ltl.kernels import tree as kernel
from pareto_ltl.planning.pack import pack_motion
from pareto_ltl.settings import RobotConfig
from plane_kernels.types import Point
from problems import KM

some = settings(deadline=None, max_examples=60)
within = st.floats(-50.0, 50.0)


def steered(motion, start, wind, target):
    """One step from ``start`` towards ``target`` in a given wind; the new point, the control, success."""
    free = motion.a @ start + motion.dt * np.array(wind)
    there, moved = kernel.steer(motion, Point(*start), Point(*free), motion.u_max, Point(*map(float, target)))
    u = motion.b_inv @ (np.array(there) - free) / motion.dt
    return np.array(there), u, moved


def robot(b=((1.0, 0.0), (0.0, 1.0)), a=((1.0, 0.0), (0.0, 1.0))):
    return pack_motion(RobotConfig(dt=100.0, u_max=10.0, a=[*map(list, a)], b=[*map(list, b)]), 2.0)


MODELS = [robot(), robot(b=((0.9, 0.2), (-0.1, 1.1)), a=((1.001, 0.002), (-0.003, 0.998)))]


@some
@given(
    st.sampled_from(MODELS), st.tuples(within, within), st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
    st.tuples(within, within),
)  # fmt: skip
def test_a_step_ends_on_the_line_at_the_target_or_at_full_airspeed(motion, start, wind, target):
    start, target = KM * np.array(start), KM * np.array(target)
    distance = math.dist(start, target)
    assume(distance > 1.0)
    end, u, moved = steered(motion, start, wind, target)
    if not moved:
        return
    along = (target - start) / distance
    progress = float((end - start) @ along)
    assert progress >= -1e-6
    np.testing.assert_allclose(end, start + progress * along, atol=1e-5)
    assert np.linalg.norm(u) <= motion.u_max * kernel.ROUNDING
    if abs(progress - distance) > 1e-6:
        assert np.linalg.norm(u) == pytest.approx(motion.u_max, rel=1e-9)
    if progress < distance - 1e-6:
        ahead = start + (progress + 1.0) * along  # one metre farther would be too fast
        beyond = motion.b_inv @ (ahead - motion.a @ start - motion.dt * np.array(wind)) / motion.dt
        assert np.linalg.norm(beyond) > motion.u_max


@some
@given(
    st.sampled_from(MODELS), st.tuples(st.floats(-9, 9), st.floats(-9, 9)), st.tuples(within, within),
    st.floats(0.1, 10.0), st.floats(0.0, 2.0),
)  # fmt: skip
@example(MODELS[0], (0.0, 1.123473692004358), (0.0, 2.0), 1.123473692004358, 0.0)  # stands still at u_min
def test_a_step_is_never_too_slow_and_ends_as_near_to_the_target_as_it_can(
    motion, wind, bearing, u_min, steps
):
    assume(np.linalg.norm(bearing) > 1.0)
    along = np.array(bearing) / np.linalg.norm(bearing)
    distance, start = max(steps * KM, 1.0), np.array([3.0, -2.0]) * KM
    slow = motion._replace(u_min=u_min)
    end, u, moved = steered(slow, start, wind, start + distance * along)
    far = np.arange(0.5, 3000.0, 1.0)  # [m] every metre of the line
    ahead = start + far[:, None] * along - motion.a @ start - motion.dt * np.array(wind)
    speed = np.linalg.norm(ahead @ motion.b_inv.T, axis=1) / motion.dt
    allowed = far[(speed >= u_min) & (speed <= motion.u_max)]
    if not moved:
        assert len(allowed) < 3
        return
    assert u_min / kernel.ROUNDING <= np.linalg.norm(u) <= motion.u_max * kernel.ROUNDING
    progress = float((end - start) @ along)
    np.testing.assert_allclose(end, start + progress * along, atol=1e-5)
    assert progress > 0.0
    if len(allowed) > 2:
        nearest = np.abs(allowed - distance).min()
        assert abs(progress - distance) <= nearest + 1e-6


def test_a_robot_that_cannot_hover_flies_past_a_near_target_or_against_the_wind():
    slow = robot()._replace(u_min=6.0)
    for wind, near, ends in (
        ((0.0, 0.0), 200.0, 600.0),  # beyond
        ((9.0, 0.0), 500.0, 300.0),  # against the wind, short of the target
        ((9.0, 0.0), 1200.0, 1500.0),  # with the wind
        ((0.0, 0.0), 700.0, 700.0),
    ):
        end, u, moved = steered(slow, np.zeros(2), wind, (near, 0.0))
        assert moved
        np.testing.assert_allclose(end, [ends, 0.0], atol=1e-6)
        assert 6.0 - 1e-9 <= np.linalg.norm(u) <= 10.0 + 1e-9


def test_a_reserve_for_feedback_that_leaves_no_airspeed_ends_the_extension():
    slow = robot()._replace(u_min=6.0)
    start, target = Point(0.0, 0.0), Point(5000.0, 0.0)
    assert kernel.steer(slow, start, start, 8.1, target)[1]  # 7.9 to 8.1 m/s
    assert not kernel.steer(slow, start, start, 7.9, target)[1]


def test_still_air_gives_a_full_step_and_tail_wind_a_longer_one():
    target = (100 * KM, 0.0)
    for wind, reach in (
        ((0.0, 0.0), 1000.0),
        ((4.0, 0.0), 1400.0),
        ((-4.0, 0.0), 600.0),
        ((0.0, 6.0), 800.0),
    ):
        end, _, moved = steered(robot(), np.zeros(2), wind, target)
        assert moved
        np.testing.assert_allclose(end, [reach, 0.0], atol=1e-6)


@pytest.mark.parametrize("wind", [(-10.5, 0.0), (0.0, 10.5), (-7.5, 7.5)])
def test_wind_that_cannot_be_stemmed_ends_the_extension(wind):
    assert not steered(robot(), np.zeros(2), wind, (100 * KM, 0.0))[2]


def test_strong_wind_from_behind_still_allows_steps_along_it():
    end, u, moved = steered(robot(), np.zeros(2), (15.0, 0.0), (100 * KM, 0.0))
    assert moved
    np.testing.assert_allclose(end, [2500.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(u, [10.0, 0.0], atol=1e-9)


def test_every_step_obeys_the_airspeed_even_where_the_wind_overshoots_the_target():
    """The wind carries the robot 1500 m, its motors hold back 1000 m: a target 100 m off is flown past."""
    end, u, moved = steered(robot(), np.zeros(2), (15.0, 0.0), (100.0, 0.0))
    assert moved
    assert np.linalg.norm(u) <= 10.0 * kernel.ROUNDING
    np.testing.assert_allclose(end, [500.0, 0.0], atol=1e-6)


def test_a_target_under_the_robot_is_no_move():
    assert not steered(robot(), np.array([5.0, 5.0]), (0.0, 0.0), (5.0, 5.0))[2]
