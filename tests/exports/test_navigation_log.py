"""The log flown by hand on the ellipsoid leads where the plan expects."""

from __future__ import annotations

import numpy as np
from pyproj import Geod

from exported_plans import Flown
from pareto_ltl.extend import Frame
from pareto_ltl_apps.exports.navigation_log import expected_winds, navigation_log

PARTS = 60  # of a leg that is flown with one heading in one wind: a straight line of a map with true angles


def flown_places(flown: Flown) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the legs by heading, airspeed, wind and duration, each from the leg's expected start."""
    log = flown.exported.log
    heading = np.deg2rad(log.heading)
    over_ground = log.airspeed * np.stack([np.sin(heading), np.cos(heading)]) + log.wind.T
    course = np.rad2deg(np.arctan2(*over_ground))
    way = np.hypot(*over_ground) * log.duration / PARTS
    lon, lat = log.lon[:-1], log.lat[:-1]
    for _ in range(PARTS):
        lon, lat, _ = Geod(ellps="WGS84").fwd(lon, lat, course, way)
    return lon, lat


def test_each_leg_leads_to_the_next_position(flown: Flown) -> None:
    log = flown.exported.log
    lon, lat = flown_places(flown)
    _, _, off = Geod(ellps="WGS84").inv(lon, lat, log.lon[1:], log.lat[1:])
    assert (off < 0.003 * log.distance).all()  # the plane's scale, 0.25 % at its corners


def errors_of(flown: Flown) -> tuple[float, float, float]:
    """Standard deviations of the robot's airspeed [1], heading [rad] and clock [s]."""
    airspeed, heading, clock = flown.problem.laws["coherent"].errors.root.diagonal().tolist()
    return airspeed, heading, clock


def test_the_wind_is_what_controls_and_positions_leave(flown: Flown) -> None:
    path, log = flown.exported.plan.path, flown.exported.log
    wind = np.diff(path.x, axis=0) / flown.problem.motion.dt - path.u
    np.testing.assert_allclose(log.wind_speed, np.hypot(*wind.T), rtol=1e-9)
    turn = Frame(flown.exported.crs).convergence(log.lon[:-1], log.lat[:-1])
    blows_to = np.rad2deg(np.arctan2(*wind.T) + turn) % 360
    np.testing.assert_allclose((log.wind_from - blows_to) % 360, 180.0, atol=1e-9)
    towards = np.deg2rad(log.wind_from + 180.0)
    np.testing.assert_allclose(log.wind[:, 0], log.wind_speed * np.sin(towards), atol=1e-9)


def test_the_doubt_of_the_wind_is_that_of_simulated_flights(flown: Flown) -> None:
    """At the first step all flights are at the start, so their winds there are draws of one Gaussian.

    Beside the wind, the robot's errors of airspeed (along u) and heading (across it) move them.
    """
    from numpy.random import SeedSequence

    from pareto_ltl.extend import simulate_flights

    path, n = flown.exported.plan.path, 20_000
    x = simulate_flights(flown.problem, path.u, n, "coherent", SeedSequence(9), path.x).x
    u, (scale, turn, _) = path.u[0], errors_of(flown)
    met = (x[:, 1] - x[:, 0]) / flown.problem.motion.dt - u
    mean, variance = expected_winds(flown.problem, path)
    spread = variance[0] + (scale * u) ** 2 + (turn * u[::-1]) ** 2
    assert (np.abs(met.mean(axis=0) - mean[0]) < 5.4 * np.sqrt(spread / n)).all()
    np.testing.assert_allclose(met.var(axis=0), spread, rtol=5.4 * np.sqrt(2 / n))
    np.testing.assert_allclose(flown.exported.log.wind_sd[0], np.sqrt(variance[0].mean()), rtol=1e-9)


def test_the_heading_of_a_leg_is_that_of_the_plan_turned_by_half_its_way(flown: Flown) -> None:
    navigation, log = flown.exported.plan.navigation, flown.exported.log
    assert navigation is not None
    assert navigation.heading_true is not None
    gap = (log.heading - navigation.heading_true + 180) % 360 - 180
    turn = np.rad2deg(Frame(flown.exported.crs).convergence(log.lon, log.lat))
    np.testing.assert_allclose(gap, 0.5 * np.diff(turn), atol=2e-3)


def test_the_radius_grows_and_lies_between_the_axes(flown: Flown) -> None:
    log = flown.exported.log
    assert log.radius[0] == 0.0
    assert (log.radius >= 1.95 * log.major).all()
    assert (log.radius <= 2.4478 * log.major).all()
    assert (log.minor <= log.major).all()
    assert log.law == "coherent"
    again = navigation_log(flown.problem, flown.exported.plan.path)
    np.testing.assert_array_equal(again.radius, log.radius)
