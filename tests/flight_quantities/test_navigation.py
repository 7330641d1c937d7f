"""Times, positions on Earth and true headings of a course."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from flight_quantities.frames import Frame, local_plane

PLANE = local_plane(37.0, -92.0)
CONIC = "+proj=lcc +lat_0=38.5 +lon_0=-97.5 +lat_1=38.5 +lat_2=38.5 +R=6371229 +units=m +no_defs"
MAP = Frame(PLANE, "2018-10-09T06:00:00Z")
ANGLE = 1e-3  # [deg]


@settings(deadline=None, max_examples=100)
@given(
    lat=st.floats(-70, 70), lon=st.floats(-179, 179), course=st.floats(0, 360), speed=st.floats(0.1, 80),
    plane=st.sampled_from((None, CONIC)),
)  # fmt: skip
def test_a_heading_is_the_azimuth_of_a_point_ahead(lat, lon, course, speed, plane):
    """Against geodesics: the azimuth of the point that lies one metre ahead in the plane."""
    crs = plane or local_plane(np.clip(lat + 4, -89, 89), lon - 5)
    if plane:  # a place within the reach of the map
        lat, lon = 38.5 + lat / 10, -97.5 + lon / 10
    here = Frame(crs).to_plane(np.array([lon]), np.array([lat]))
    u = speed * np.array([[np.sin(np.deg2rad(course)), np.cos(np.deg2rad(course))]])
    there = Frame(crs).to_geographic(here + u / speed)
    geod = Geod(a=6371229, b=6371229) if plane else Geod(ellps="WGS84")
    azimuth = geod.inv(lon, lat, there[0][0], there[1][0])[0]
    heading = Frame(crs).heading(here, u)[0]
    assert 0.0 <= heading < 360.0
    assert abs((heading - azimuth + 180.0) % 360.0 - 180.0) < ANGLE


def test_a_step_without_airspeed_has_no_heading():
    u = np.array([[0.0, 10.0], [0.0, 0.0]])
    found = MAP.navigation(1800.0 * np.arange(3), np.zeros((3, 2)), u)
    assert found.heading_true[0] == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(found.heading_true[1])
    assert found.airspeed.tolist() == [10.0, 0.0]


def test_positions_return_to_the_plane():
    x = np.random.default_rng(1).uniform(-5e5, 5e5, (20, 2))
    found = MAP.navigation(1800.0 * np.arange(20), x, np.ones((19, 2)))
    np.testing.assert_allclose(Frame(PLANE).to_plane(found.lon, found.lat), x, atol=1e-5)
    assert found.crs == PLANE


def test_a_plane_without_place_on_earth_has_airspeeds_and_times_only():
    found = Frame(None, MAP.time_zero).navigation(np.zeros(1), np.zeros((1, 2)), np.empty((0, 2)))
    assert (found.crs, found.lat, found.lon, found.heading_true) == (None,) * 4
    assert found.time_utc == ("2018-10-09T06:00:00Z",)
    assert len(found.airspeed) == 0


@pytest.mark.parametrize("zero", ["2018-10-09T06:00:00Z", "2018-10-09T06:00:00", "2018-10-09T08:00:00+02:00"])
def test_times_count_from_the_departure_in_utc(zero):
    times = Frame(None, zero).utc(np.array([0.0, 5400.0, 86400.5]))
    assert times == ("2018-10-09T06:00:00Z", "2018-10-09T07:30:00Z", "2018-10-10T06:00:00.500000Z")
    assert all(datetime.fromisoformat(time).tzinfo for time in times)


def test_no_departure_and_no_calendar_give_no_times():
    assert Frame(None, None).utc(np.zeros(3)) is None
    assert Frame(None, "2018-10-09T06:00:00Z").utc(np.array([0.0, 1e12])) is None
