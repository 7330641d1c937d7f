"""Orders to an aircraft that banks: flown in small steps they lead through the planned positions."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from pareto_ltl.planning.turns import MOST, BankedTurns, TurnsOnTheSpot, turns_of
from pareto_ltl.settings import RobotConfig
from pareto_ltl.support.errors import ConfigError

GRAVITY = 9.80665
CESSNA = BankedTurns(math.radians(30.0), 7.0)
angles = st.floats(-3.1, 3.1)
speeds = st.floats(0.0, 15.0)


def plan(u, wind, dt):
    """Times, positions, controls and winds of a plan that turns on the spot."""
    u, wind = np.asarray(u, float), np.asarray(wind, float)
    x = np.concatenate([[[0.0, 0.0]], np.cumsum((u + wind) * dt, axis=0)])
    return dt * np.arange(len(u) + 1.0), x, u, wind


def vectors(directions, airspeed):
    return airspeed * np.column_stack([np.cos(directions), np.sin(directions)])


def flown(legs, wind, turns, step=0.01):
    """Positions at the ends of the legs, by the heading's own differential equation in small steps."""
    places, heading = [legs.x[0]], math.atan2(legs.u[0, 1], legs.u[0, 0])
    for u, duration, blown in zip(legs.u, np.diff(legs.t), wind, strict=True):
        airspeed, order = float(np.hypot(*u)), math.atan2(u[1], u[0])
        rate = GRAVITY * math.tan(turns.bank) / airspeed
        n = max(int(duration / step), 1)
        dt = duration / n
        left, air = math.remainder(order - heading, math.tau), np.zeros(2)
        for i in range(n):
            if (i + 0.5) * dt > turns.delay:
                change = math.copysign(min(rate * dt, abs(left)), left)
                heading, left = heading + change, left - change
            air += dt * airspeed * np.array([math.cos(heading), math.sin(heading)])
        places.append(places[-1] + air + duration * blown)
    return np.array(places)


@pytest.mark.parametrize("turn", [20.0, -75.0, 150.0, -140.0])
def test_orders_flown_in_small_steps_lead_through_the_planned_positions(turn):
    directions = np.deg2rad([10.0, 10.0, 10.0 + turn, 10.0 + turn, 40.0 + turn])
    wind = [[3.0, -4.0]] * 3 + [[-6.0, 2.0]] * 2
    t, x, u, wind = plan(vectors(directions, 50.0), wind, 120.0)
    legs = CESSNA.ordered(t, x, u, wind)
    np.testing.assert_allclose(legs.x, x, atol=1e-3)
    np.testing.assert_allclose(flown(legs, wind, CESSNA), x, atol=2.0)
    assert legs.late > 0.0
    np.testing.assert_allclose(np.hypot(*legs.u.T), 50.0)


def test_a_turn_on_the_spot_would_be_displaced_as_the_orders_allow_for():
    """A reversal loses the half circle, its delay twice, and swings out by the diameter of the circle."""
    t, x, u, wind = plan(vectors([0.0, math.radians(160.0)], 50.0), np.zeros((2, 2)), 300.0)
    legs = CESSNA.ordered(t, x, u, wind)
    radius = 50.0**2 / (GRAVITY * math.tan(CESSNA.bank))
    assert legs.swing == pytest.approx(2 * radius + 50.0 * 7.0 * math.sin(math.radians(20.0)), rel=0.15)
    assert legs.late == pytest.approx(math.radians(160.0) * radius / 50.0 + 2 * 7.0, rel=0.15)


def test_straight_flight_needs_no_allowance():
    t, x, u, wind = plan(vectors(np.full(6, 0.7), 20.0), [[1.0, 2.0]] * 6, 30.0)
    legs = BankedTurns(0.5, 2.0).ordered(t, x, u, wind)
    np.testing.assert_allclose(legs.t, t, atol=1e-6)
    np.testing.assert_allclose(legs.u, u, atol=1e-6)
    assert legs.late == pytest.approx(0.0, abs=1e-6)
    assert legs.swing < 1e-5


def test_a_leg_that_is_too_short_for_its_turn_is_made_good_by_those_after_it():
    directions = [0.0, 0.0, 2.6, 2.6, 2.6, 2.6]
    t, x, u, wind = plan(vectors(directions, 50.0), np.zeros((6, 2)), 15.0)
    legs = CESSNA.ordered(t, x, u, wind)
    off = np.linalg.norm(legs.x - x, axis=1)
    assert off[3] > 100.0
    assert off[-1] < 1e-3
    np.testing.assert_allclose(flown(legs, wind, CESSNA), legs.x, atol=2.0)


def test_no_order_turns_by_so_much_that_an_autopilot_might_turn_the_other_way():
    t, x, u, wind = plan(vectors([0.0, 3.0, 3.0, 3.0], 50.0), np.zeros((4, 2)), 200.0)
    legs = CESSNA.ordered(t, x, u, wind)
    headings = np.arctan2(legs.u[:, 1], legs.u[:, 0])
    turns = [abs(math.remainder(b - a, math.tau)) for a, b in pairwise(headings)]
    assert max(turns) <= MOST + 1e-9
    np.testing.assert_allclose(legs.x[3:], x[3:], atol=1e-3)
    np.testing.assert_allclose(flown(legs, wind, CESSNA), legs.x, atol=2.0)


def shortest(turns, way, airspeed, wind):
    """Time of the shortest leg from heading 0, by every root along the angle of the turn; None without."""
    rate = GRAVITY * math.tan(turns.bank) / airspeed
    radius = airspeed / rate

    def rest(angle):
        side, busy = np.sign(angle), turns.delay + np.abs(angle) / rate
        end_x = airspeed * turns.delay + radius * np.sin(np.abs(angle)) + busy * wind[0]
        end_y = side * radius * (1.0 - np.cos(angle)) + busy * wind[1]
        return way[0] - end_x, way[1] - end_y, busy

    def over_ground(angle):
        return airspeed * np.cos(angle) + wind[0], airspeed * np.sin(angle) + wind[1]

    def gap(angle):
        (x, y, _), (u, v) = rest(angle), over_ground(angle)
        return x * v - y * u

    found, grid = [], np.linspace(-MOST, MOST, 20_001)
    for k in np.flatnonzero(np.diff(np.sign(gap(grid))) != 0.0):
        angle = brentq(gap, grid[k], grid[k + 1])
        (x, y, busy), (u, v) = rest(angle), over_ground(angle)
        if (more := (x * u + y * v) / (u * u + v * v)) >= 0.0:
            found.append(busy + more)
    return min(found, default=None)


@given(st.floats(60.0, 400.0), angles, angles, speeds)
def test_the_leg_found_is_the_shortest_of_all_that_reach_the_place(dt, turn, blown, speed):
    wind = vectors([blown], speed)[0]
    t, x, u, winds = plan(vectors([0.0, turn], 50.0), [wind, wind], dt)
    wanted = shortest(CESSNA, x[2] - x[1], 50.0, wind)
    legs = CESSNA.ordered(t, x, u, winds)
    if wanted is None:  # no room, or only by an order that an autopilot might take the other way
        assert np.linalg.norm(legs.x[2] - x[2]) > 1e-3 or abs(turn) > 2.5
    else:
        assert legs.t[2] - legs.t[1] == pytest.approx(wanted, abs=1e-3)
        np.testing.assert_allclose(legs.x[2], x[2], atol=1e-3)


def test_without_a_bank_the_orders_are_the_plan():
    t, x, u, wind = plan(vectors([0.0, 3.0], 50.0), np.ones((2, 2)), 60.0)
    legs = TurnsOnTheSpot().ordered(t, x, u, wind)
    assert (legs.t is t, legs.x is x, legs.u is u, legs.late, legs.swing) == (True, True, True, 0.0, 0.0)
    assert isinstance(turns_of(RobotConfig()), TurnsOnTheSpot)


def test_a_robot_that_can_stop_does_not_bank():
    with pytest.raises(ConfigError, match=r"robot\.bank needs robot\.u_min > 0"):
        RobotConfig(bank=30.0)
    with pytest.raises(ConfigError, match=r"robot\.a and robot\.b to be the identity"):
        RobotConfig(bank=30.0, u_min=10.0, b=[[1.0, 0.0], [0.0, 2.0]])
    assert turns_of(RobotConfig(bank=30.0, u_min=10.0, turn_delay=2.0)) == BankedTurns(
        math.radians(30.0), 2.0
    )
