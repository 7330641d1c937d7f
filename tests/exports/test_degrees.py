"""Lines of the plane in degrees: close to where they were, cut at the 180th meridian."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from pyproj import Geod

from flight_quantities.frames import local_plane
from pareto_ltl.extend import Frame
from pareto_ltl_apps.exports.degrees import crosses, line_parts, polygon_parts

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@pytest.mark.parametrize("lat", [-60.0, 0.0, 37.0, 70.0])
def test_a_reader_that_joins_points_is_never_a_metre_off(lat: float) -> None:
    crs = local_plane(lat, 10.0)
    line = np.array([[-150e3, 90e3], [140e3, -20e3], [120e3, 130e3]])
    drawn = Frame(crs).line_degrees(line)
    way = shapely.LineString(line)
    share = np.linspace(0, 1, 11)[:, None, None]
    on_sheet = drawn[:-1] + share * np.diff(drawn, axis=0)  # joined by straight lines in degrees
    back = Frame(crs).to_plane(*on_sheet.reshape(-1, 2).T)
    assert shapely.distance(way, shapely.points(back)).max() < 1.0
    middle = Geod(ellps="WGS84")
    azimuth, _, far = middle.inv(drawn[:-1, 0], drawn[:-1, 1], drawn[1:, 0], drawn[1:, 1])
    lon, half, _ = middle.fwd(drawn[:-1, 0], drawn[:-1, 1], azimuth, far / 2)  # joined on the ellipsoid
    assert shapely.distance(way, shapely.points(Frame(crs).to_plane(lon, half))).max() < 1.0


def test_lines_and_polygons_are_cut_at_the_180th_meridian() -> None:
    crs = local_plane(52.0, 179.5)
    outline = Frame(crs).outline_degrees(100e3 * SQUARE)
    assert crosses(outline)
    parts = polygon_parts([outline])
    assert len(parts) == 2
    shapes = [shapely.Polygon(*[rings[0]], rings[1:]) for rings in parts]
    assert all(shape.is_valid and shape.exterior.is_ccw for shape in shapes)
    places = np.concatenate([rings[0] for rings in parts])
    assert np.abs(places[:, 0]).max() <= 180.0
    area = sum(abs(Geod(ellps="WGS84").geometry_area_perimeter(shape)[0]) for shape in shapes)
    assert area == pytest.approx(200e3**2, rel=1e-3)

    east, west = line_parts(Frame(crs).line_degrees(100e3 * SQUARE[:2]))
    assert east[-1, 0] == 180.0
    assert west[0, 0] == -180.0
    assert east[-1, 1] == pytest.approx(west[0, 1], abs=1e-9)


def test_a_hole_is_cut_with_its_polygon() -> None:
    crs = local_plane(52.0, 179.9)
    rings = [Frame(crs).outline_degrees(100e3 * SQUARE), Frame(crs).outline_degrees(20e3 * SQUARE[::-1])]
    parts = polygon_parts(rings)
    shapes = [shapely.Polygon(part[0], part[1:]) for part in parts]
    area = sum(abs(Geod(ellps="WGS84").geometry_area_perimeter(shape)[0]) for shape in shapes)
    assert area == pytest.approx(200e3**2 - 40e3**2, rel=1e-3)


def test_what_lies_on_one_side_stays_as_it_is() -> None:
    crs = local_plane(37.0, -92.0)
    outline = Frame(crs).outline_degrees(100e3 * SQUARE)
    ((kept,),) = polygon_parts([outline])
    np.testing.assert_array_equal(kept, outline)
    lon, lat = Frame(crs).to_geographic(100e3 * SQUARE)
    for place in np.column_stack([lon, lat]):
        assert np.abs(outline - place).max(axis=1).min() < 1e-8
