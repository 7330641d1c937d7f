"""The local plane: positions there and back, and the direction of north in it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from careful_io.errors import DataError
from flight_quantities import frames
from flight_quantities.frames import Frame

EARTH = 6_371_008.8  # mean radius [m]
centres = st.tuples(st.floats(-70, 70), st.floats(-180, 180))
offsets = st.tuples(st.floats(-6, 6), st.floats(-6, 6))
DEGREE = 1e-5  # step of the finite differences [deg], about 1 m


def near(centre, offset):
    lat, lon = centre[0] + offset[0], centre[1] + offset[1]
    return np.array([(lon + 180) % 360 - 180]), np.array([lat])


@given(centres, offsets)
@settings(deadline=None, max_examples=50)
def test_a_position_comes_back_from_the_plane(centre, offset):
    crs = frames.local_plane(*centre)
    lon, lat = near(centre, offset)
    back_lon, back_lat = Frame(crs).to_geographic(Frame(crs).to_plane(lon, lat))
    np.testing.assert_allclose(back_lat, lat, atol=1e-9)
    np.testing.assert_allclose((back_lon - lon + 180) % 360 - 180, 0, atol=1e-8)


@given(centres, offsets)
@settings(deadline=None, max_examples=50)
def test_a_wind_from_the_south_moves_along_the_drawn_meridian(centre, offset):
    crs = frames.local_plane(*centre)
    lon, lat = near(centre, offset)
    moved = Frame(crs).to_plane(lon, lat + DEGREE) - Frame(crs).to_plane(lon, lat - DEGREE)
    (turn,) = Frame(crs).convergence(lon, lat)
    north = np.array([[-np.sin(turn), np.cos(turn)]])
    np.testing.assert_allclose(north, moved / np.linalg.norm(moved), atol=1e-6)


@given(centres, offsets)
@settings(deadline=None, max_examples=50)
def test_the_plane_is_conformal(centre, offset):
    """One angle serves all directions only if east stays at right angles to north, at the same scale."""
    crs = frames.local_plane(*centre)
    lon, lat = near(centre, offset)
    north = Frame(crs).to_plane(lon, lat + DEGREE) - Frame(crs).to_plane(lon, lat - DEGREE)
    east = Frame(crs).to_plane(lon + DEGREE, lat) - Frame(crs).to_plane(lon - DEGREE, lat)
    cross = abs(float((north * east).sum())) / np.linalg.norm(north) / np.linalg.norm(east)
    assert cross < 1e-6


@pytest.mark.parametrize("bearing", [0.0, 1.0, 2.5, 4.0])
def test_lengths_are_true_to_the_promised_scale(bearing):
    """700 km from the centre, (r / 2R)² = 0.3 %: against the distance on the ellipsoid."""
    from pyproj import Geod

    crs = frames.local_plane(37.0, -92.0)
    end = 700e3 * np.array([[np.cos(bearing), np.sin(bearing)]])
    lon, lat = Frame(crs).to_geographic(end)
    *_, ground = Geod(ellps="WGS84").inv(-92.0, 37.0, lon[0], lat[0])
    assert abs(700e3 / ground - 1) <= 1.1 * (700e3 / (2 * EARTH)) ** 2


def test_the_centre_is_the_origin_and_its_north_points_up():
    crs = frames.local_plane(37.0, 268.0)  # 92 W, counted eastwards
    lon, lat = np.array([-92.0]), np.array([37.0])
    np.testing.assert_allclose(Frame(crs).to_plane(lon, lat), [[0.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(Frame(crs).convergence(lon, lat), [0.0], atol=1e-12)
    assert crs == frames.local_plane(37.0, -92.0)


def test_meridians_lean_towards_the_pole_on_both_sides_of_the_centre():
    crs = frames.local_plane(37.0, -92.0)
    west, east = Frame(crs).convergence(np.array([-110.0, -80.0]), np.array([40.0, 40.0]))
    assert west < 0 < east  # clockwise in the west, counter-clockwise in the east


@pytest.mark.parametrize(
    ("crs", "words"),
    [
        ("EPSG:4326", "degrees"),
        ("+proj=nonsense", "PROJ does not know crs"),
        ("somewhere", "PROJ does not know crs"),
    ],
)
def test_a_plane_that_is_none_is_refused(crs, words):
    with pytest.raises(DataError, match=words):
        Frame(crs).to_plane(np.array([0.0]), np.array([0.0]))


def test_a_place_that_is_none_is_refused():
    with pytest.raises(DataError, match=r"latitude 95, longitude 0"):
        frames.local_plane(95.0, 0.0)


def test_the_far_side_of_the_earth_cannot_be_drawn():
    with pytest.raises(DataError, match="too far"):
        Frame(frames.local_plane(0.0, 0.0)).to_plane(np.array([180.0]), np.array([0.0]))


def test_a_frame_without_a_place_on_earth_says_so():
    assert not Frame(None).on_earth
    with pytest.raises(DataError, match="no place on Earth"):
        Frame(None).north(np.zeros((1, 2)))


def test_a_program_names_the_projection_and_the_cure_in_its_words():
    class Chart(Frame):
        __slots__ = ()
        CRS, UNPLACED = "chart.plane", "set chart.plane"

    assert Chart.at(37.0, -92.0) == Chart(frames.local_plane(37.0, -92.0))
    with pytest.raises(DataError, match=r"^chart\.plane 'EPSG:4326' is in degrees"):
        Chart("EPSG:4326").north(np.zeros((1, 2)))
    with pytest.raises(DataError, match=r"^set chart\.plane$"):
        Chart(None).north(np.zeros((1, 2)))
