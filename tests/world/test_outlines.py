"""Polygons with fewer corners, around a polygon and inside it."""

from __future__ import annotations

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from large_maps import rough_disc
from pareto_ltl.world.scene_simplify import narrowed_polygon, widened_polygon, without_pools
from problems import KM
from strategies import star_polygons

some = settings(max_examples=100)
tolerances = st.floats(0.5, 40.0)
stars = star_polygons(corners=60).map(shapely.Polygon).filter(lambda polygon: polygon.is_valid)


def blob(corners, radius=200.0, roughness=0.01, seed=0):
    return rough_disc(corners, 0.0, 0.0, radius / KM, roughness, seed)


def farthest(shape, other):
    """Largest distance from a corner of ``shape`` to ``other``, which is the distance of all its points if
    ``shape`` is only slightly larger than ``other``."""
    return shapely.distance(shapely.points(shapely.get_coordinates(shape)), other).max()


@some
@given(stars, tolerances)
def test_a_widened_polygon_contains_the_original_and_keeps_to_the_tolerance(polygon, tolerance):
    wide = widened_polygon(polygon, tolerance)
    assert wide.is_valid
    assert wide.contains(polygon)
    assert farthest(wide, polygon) <= tolerance
    assert len(wide.interiors) == 0


@some
@given(stars, tolerances)
def test_a_narrowed_polygon_lies_inside_the_original_and_what_is_lost_is_near_its_outline(polygon, tolerance):
    narrow = narrowed_polygon(polygon, tolerance)
    assert narrow.is_valid
    assert polygon.covers(narrow)
    core = shapely.buffer(polygon, -tolerance)
    assert core.is_empty or narrow.covers(core)


def test_the_first_corner_of_a_ring_is_not_cut_off_twice_as_far():
    polygon = shapely.Polygon([(20, 80), (50, 110), (40, 0), (0, 100)])
    narrow = narrowed_polygon(polygon, 10.0)
    assert polygon.covers(narrow)
    assert narrow.covers(shapely.buffer(polygon, -10.0))


@pytest.mark.parametrize("change", [widened_polygon, narrowed_polygon])
@pytest.mark.parametrize("roughness", [0.0, 0.01])
def test_two_thousand_corners_become_a_few_dozen(change, roughness):
    polygon = shapely.Polygon(blob(2000, roughness=roughness))
    found = change(polygon, 2.0)
    assert 16 <= shapely.get_num_coordinates(found) <= 80
    assert abs(found.area / polygon.area - 1) < 0.02


def bay(mouth):
    """A square with a bay behind a narrow mouth."""
    west, east = 50 - mouth / 2, 50 + mouth / 2
    return shapely.Polygon(
        [(0, 0), (100, 0), (100, 100), (east, 100), (east, 80), (80, 80), (80, 20), (20, 20), (20, 80),
         (west, 80), (west, 100), (0, 100)]
    )  # fmt: skip


@pytest.mark.parametrize("mouth", [20.0, 4.0, 1.0])
def test_a_bay_stays_open_whatever_the_tolerance(mouth):
    wide = widened_polygon(bay(mouth), 8.0)
    way_out = shapely.LineString([(50, 50), (50, 150)])
    assert wide.contains(bay(mouth))
    assert not wide.intersects(way_out)


def test_what_is_narrower_than_the_tolerance_is_kept_as_it_is():
    strip = shapely.box(0, 0, 100, 1)
    assert narrowed_polygon(strip, 8.0).equals(strip)


def test_small_holes_are_filled_and_large_ones_kept():
    holes = [shapely.box(10, 10, 12, 12).exterior.coords, shapely.box(40, 40, 80, 80).exterior.coords]
    found = without_pools(shapely.Polygon(shapely.box(0, 0, 100, 100).exterior.coords, holes), 3.0)
    assert [shapely.Polygon(ring).area for ring in found.interiors] == [1600.0]


def test_a_large_hole_of_a_widened_polygon_gets_smaller():
    ring = shapely.Polygon(blob(400, 200.0), [blob(400, 100.0, seed=1)])
    wide = widened_polygon(ring, 4.0)
    assert wide.contains(ring)
    (hole,) = wide.interiors
    assert 0.9 < shapely.Polygon(hole).area / shapely.Polygon(ring.interiors[0]).area < 1.0
