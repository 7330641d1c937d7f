"""The table of coasts, lakes, borders and cities, and what maps show of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from drawn_world import scene_of
from pareto_ltl.extend import Frame
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.desk.earth import ground_view
from pareto_ltl_apps.view.geography import (
    ANSWER_LIMIT,
    AREAS,
    LINES,
    geography_around,
    geography_of,
    places_named,
)

WORLD = (-180.0, -89.0, 180.0, 89.0)
EARTH = 6371.0  # [km]
PLACES = {
    "land": [(139.75, 35.69), (-72.93, -41.45), (9.0, 50.0), (134.55, -25.0)],
    "lakes": [(-87.5, 47.7), (51.0, 42.0), (33.0, -1.0)],  # Superior, Caspian Sea, Victoria
    "islands": [(-82.2, 45.75)],  # Manitoulin
}
AT_SEA = [(-140.0, 30.0), (-30.0, 0.0), (133.6, 34.1), (179.9, 60.0)]


def areas(lines: list[np.ndarray]) -> list[shapely.Polygon]:
    return [shapely.Polygon(line) for line in lines]


@pytest.mark.parametrize("layer", AREAS)
def test_well_known_places_lie_in_their_areas(layer: str) -> None:
    for lon, lat in PLACES[layer]:
        found = geography_of((lon - 1.0, lat - 1.0, lon + 1.0, lat + 1.0), 0.004)
        assert any(area.contains(shapely.Point(lon, lat)) for area in areas(getattr(found, layer)))


def test_the_sea_is_no_land() -> None:
    for lon, lat in AT_SEA:
        found = geography_of((lon - 1.0, lat - 1.0, lon + 1.0, lat + 1.0), 0.004)
        assert not any(area.contains(shapely.Point(lon, lat)) for area in areas(found.land))


def test_the_land_is_as_large_as_on_the_earth() -> None:
    """148.9 million km2 in the literature; Lambert's cylinder keeps areas."""
    total = 0.0
    for line in geography_of(WORLD, 0.004).land:
        lon, lat = np.deg2rad(line).T
        total += shapely.Polygon(np.column_stack([EARTH * lon, EARTH * np.sin(lat)])).area
    assert 145e6 < total < 151e6


def test_what_is_shown_lies_in_its_box_and_keeps_to_the_detail() -> None:
    box = (8.0, 53.0, 13.0, 57.0)
    fine, coarse = geography_of(box, 0.004), geography_of(box, 0.1)
    for found in (fine, coarse):
        for line in (line for layer in (*AREAS, *LINES) for line in getattr(found, layer)):
            assert (line >= np.array(box[:2]) - 1e-9).all()
            assert (line <= np.array(box[2:]) + 1e-9).all()
        assert all(box[0] <= lon <= box[2] and box[1] <= lat <= box[3] for _, lon, lat in found.cities)
    assert sum(map(len, coarse.land)) < sum(map(len, fine.land)) / 2
    shore = shapely.union_all(areas(fine.land)).boundary
    drawn = shapely.segmentize(shapely.union_all(areas(coarse.land)).boundary, 0.02)
    assert shapely.distance(shapely.points(shapely.get_coordinates(drawn)), shore).max() < 0.1


def test_land_across_180_degrees_is_one_piece() -> None:
    found = geography_of((170.0, 60.0, 195.0, 72.0), 0.02)
    west, east = shapely.Point(179.5, 67.5), shapely.Point(180.5, 67.5)
    assert any(area.contains(west) and area.contains(east) for area in areas(found.land))
    turned = geography_of((-190.0, 60.0, -165.0, 72.0), 0.02)
    assert sum(map(len, turned.land)) == sum(map(len, found.land))
    assert [name for name, *_ in turned.cities] == [name for name, *_ in found.cities]


@pytest.mark.parametrize(
    ("text", "name", "place"),
    [
        ("puerto mo", "Puerto Montt", (-72.9, -41.5)),
        ("  SAO PAULO ", "São Paulo", (-46.6, -23.6)),
        ("kochi", "Kōchi", (133.6, 33.6)),
        ("tromso", "Tromsø", (19.0, 69.6)),
    ],
)
def test_a_city_is_found_without_its_accents(text: str, name: str, place: tuple[float, float]) -> None:
    found = [one for one in places_named(text) if one[0] == name]
    assert any(np.hypot(lon - place[0], lat - place[1]) < 0.2 for _, lon, lat in found)


def test_the_same_name_comes_before_longer_ones_and_larger_cities_before_small_ones() -> None:
    assert places_named("paris")[0][0] == "Paris"
    assert places_named("paris")[0][1:] == pytest.approx((2.35, 48.86), abs=0.05)
    assert len(places_named("san")) == ANSWER_LIMIT
    assert places_named("") == places_named("no city has this name") == []


def test_a_map_without_a_place_on_earth_or_with_a_pole_has_no_geography() -> None:
    scene = scene_of()
    assert geography_around(replace(scene, crs=None)) is None
    assert geography_around(replace(scene, crs=Frame.at(89.99, 0.0).crs)) is None


def test_a_map_has_what_lies_beside_it_too() -> None:
    scene = replace(scene_of(), crs=Frame.at(-42.5, -73.8).crs)
    found = geography_around(scene)
    assert found is not None
    lon, lat = scene.frame.to_geographic(scene.bounds)
    west, south, east, north = found.box
    assert west < lon.min() < lon.max() < east
    assert south < lat.min() < lat.max() < north


@pytest.mark.parametrize(
    ("box", "pixels"),
    [("1,2,3", "100"), ("a,b,c,d", "100"), ("10,0,5,5", "100"), ("0,0,5,95", "100"), ("0,0,1,1", "0"),
     ("0,0,1,1", "99999"), ("nan,0,1,1", "10"), ("0,0,1e9,1", "10")],
)  # fmt: skip
def test_a_box_that_is_none_is_refused_in_one_line(box: str, pixels: str) -> None:
    with pytest.raises(ConfigError, match="WEST,SOUTH,EAST,NORTH"):
        ground_view(box, pixels)


def test_a_view_round_the_earth_has_each_place_once() -> None:
    found = ground_view("-500,-80,500,80", "1000")
    assert found["box"][2] - found["box"][0] == 360.0
    assert len({name for name, *_ in found["cities"]}) > 200


def test_a_view_of_one_place_has_its_ground() -> None:
    """As the desk asks for when a start is all that is drawn."""
    found = ground_view("14.4053,67.2822,14.4053001,67.2822001", "1936")
    west, south, east, north = found["box"]
    assert west <= 14.4053 < east
    assert south <= 67.2822 < north
    assert set(found) >= {"land", "cities"}
