"""Map files of other programs: what is read of each, what is said not to be read, and what is refused."""

from __future__ import annotations

import json
import logging

import numpy as np
import pytest
import shapely

import pareto_ltl
from map_files import DRAWN, FREE, IN_WALL, archive, closed, collection, feature, refusal, written
from map_samples import AREA, ED269, OPENAIP_LIMITS, OPENAIR, PLAN, WAYPOINTS, box
from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.world.scene_settings import scene_from_settings

# --- lengths, heights, facility maps ---------------------------------------------------------------------


def test_lengths_and_heights_have_units(tmp_path):
    tma = feature("obstacle", "Polygon", AREA, name="TMA", floor="2500 ft", ceiling="FL095")
    mast = feature("obstacle", "Point", [10.5, 60.1], name="mast", buffer="0.5 NM")
    path = written(tmp_path / "m.geojson", collection(*DRAWN, tma, mast))
    for altitude, active in ((761.0, False), (763.0, True), (2895.0, True), (2896.0, False)):
        scene = pareto_ltl.read_map(path, altitude=altitude)
        assert closed(scene, IN_WALL, (10.5, 60.108), (10.5, 60.109)) == [active, True, False]
    surface = feature("obstacle", "Polygon", AREA, floor="SFC", ceiling="UNL")
    assert closed(
        pareto_ltl.read_map(written(path, collection(*DRAWN, surface)), altitude=-100), IN_WALL
    ) == [True]


def test_a_fix_has_units(tmp_path):
    mark = feature("landmark", "Polygon", [box(10.3, 60.3, 10.4, 60.35)], fix={"sd": "0.1 NM"})
    scene = pareto_ltl.read_map(written(tmp_path / "m.geojson", collection(*DRAWN, mark)))
    assert scene.landmark_fixes[0].along == pytest.approx(185.2)


def test_heights_above_ground_and_above_the_sea_are_not_mixed_up(tmp_path, caplog):
    low = feature("obstacle", "Polygon", AREA, name="low", ceiling="120 m AGL")
    path = written(tmp_path / "m.geojson", collection(*DRAWN, low))
    assert closed(pareto_ltl.read_map(path, altitude=200), IN_WALL) == [False]  # all are above ground
    high = feature("obstacle", "Polygon", [box(10.45, 60.3, 10.5, 60.35)], floor="FL245")
    with caplog.at_level(logging.INFO):
        scene = pareto_ltl.read_map(written(path, collection(*DRAWN, low, high)), altitude=200)
    assert closed(scene, IN_WALL) == [True]  # the ground may be high
    assert "these have limits that count from elsewhere: obstacle low; the height" in caplog.text
    assert "a flight level is the height in the standard atmosphere" in caplog.text


@pytest.mark.parametrize("role", ["obstacle", ""])
def test_flight_is_permitted_up_to_the_ceiling_of_a_facility_map(tmp_path, role):
    cells = [
        feature(
            role, "Polygon", [box(10.2 + 0.05 * k, 60, 10.25 + 0.05 * k, 60.05)], CEILING=feet, UNIT="Feet"
        )
        for k, feet in enumerate((0, 100, 400))
    ]
    path = written(tmp_path / "m.geojson", collection(*DRAWN, *cells))
    places = [(10.225 + 0.05 * k, 60.025) for k in range(3)]
    shown = {h: closed(pareto_ltl.read_map(path, altitude=h), *places) for h in (0.1, 30.48, 31, 121.92, 122)}
    assert shown == {
        0.1: [True, False, False], 30.48: [True, False, False], 31: [True, True, False],
        121.92: [True, True, False], 122: [True, True, True],
    }  # fmt: skip


def test_a_ceiling_with_a_separate_unit_is_not_guessed(tmp_path):
    zone = feature("obstacle", "Polygon", AREA, ceiling=400, unit="ft")
    text = refusal(written(tmp_path / "m.geojson", collection(*DRAWN, zone)))
    assert "if the obstacle ends there, write the unit into ceiling, e.g. '400 ft AGL'" in text


# --- airspace and fences ---------------------------------------------------------------------------------

NM = 1 / 60  # [deg] of latitude, nearly


def test_openair_is_read_beside_a_map(tmp_path, caplog):
    zones = written(tmp_path / "zones.txt", OPENAIR)
    path = written(tmp_path / "m.geojson", collection(*DRAWN))
    places = [
        (10.15, 60.45),
        (10.2, 60.1 + 1.49 * NM),
        (10.2, 60.1 + 1.54 * NM),
        (10.51, 60.01),
        (10.49, 60.01),
    ]
    places += [(10.47, 60.25), (10.53, 60.25), (10.35, 60.45)]
    cfg = SceneConfig(file=str(path), zones=[str(zones)])
    with caplog.at_level(logging.INFO):
        scene = scene_from_settings(cfg)
    assert closed(scene, *places) == [True, True, False, True, False, True, False, False]
    assert "the limit 'NOTAM' of 'HALF', which is read as no limit" in caplog.text
    assert "4 features: they are airspace (OpenAir)" in caplog.text
    cfg.altitude = 900.0  # above TEST CTR, 2500 ft
    assert closed(scene_from_settings(cfg), *places[:2]) == [False, True]
    cfg.roles = {"class": {"Q": "none", "D": "none"}, "else": "obstacle"}
    assert closed(scene_from_settings(cfg), *places[:4]) == [False, True, False, False]


@pytest.mark.parametrize(("name", "content"), [("fence.plan", PLAN), ("fence.waypoints", WAYPOINTS)])
def test_a_fence_of_a_ground_station_is_border_and_obstacles(tmp_path, caplog, name, content):
    fence = written(tmp_path / name, content)
    path = written(tmp_path / "m.geojson", collection(*DRAWN))
    with caplog.at_level(logging.INFO):
        scene = scene_from_settings(SceneConfig(file=str(path), zones=[str(fence)]), border="wall")
    assert closed(scene, (10.3, 60.15), (10.3, 60.26), (10.3, 60.29), FREE) == [True, True, False, False]
    low, high = scene.frame.to_geographic(scene.bounds)
    np.testing.assert_allclose([*low, *high], [9.9, 10.9, 59.9, 60.5], atol=0.01)
    assert scene.border == "wall"
    assert "draw what the mission visits as regions" in caplog.text


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("m.plan", PLAN, "a QGroundControl plan: it has no start and no regions"),
        ("m.waypoints", WAYPOINTS, "QGC WPL"),
        ("m.txt", OPENAIR, "OpenAir"),
    ],
)
def test_a_file_without_a_mission_is_named_with_the_way_to_use_it(tmp_path, name, content, words):
    text = refusal(written(tmp_path / name, content))
    assert words in text
    assert f"scene.zones=[{name}]" in text


def test_zones_of_ed_269_have_heights_and_times(tmp_path, caplog):
    zones = written(tmp_path / "uas.json", ED269)
    path = written(tmp_path / "m.geojson", collection(*DRAWN))
    cfg = SceneConfig(file=str(path), zones=[str(zones)], altitude=100.0)
    with caplog.at_level(logging.INFO):
        scene = scene_from_settings(cfg, "2026-01-01T00:00:00Z")
    assert closed(scene, IN_WALL, FREE) == [True, False]
    (window,) = scene.windows.values()
    assert (window.begin, window.end) == (21600.0, 32400.0)
    race = shapely.Polygon(scene.regions[scene.forbidden[0]][0])
    assert race.area == pytest.approx(np.pi * 1500**2, rel=0.07)
    assert "NO_RESTRICTION" in caplog.text
    cfg.altitude = 130.0
    assert closed(scene_from_settings(cfg, "2026-01-01T00:00:00Z"), IN_WALL, FREE) == [False, False]


def test_airspace_of_openaip_has_its_limits_in_numbers(tmp_path):
    zone = feature("", "Polygon", AREA, name="CTR", icaoClass=3, **OPENAIP_LIMITS)
    path = written(tmp_path / "m.geojson", collection(*DRAWN, zone))
    shown = {h: closed(pareto_ltl.read_map(path, altitude=h), IN_WALL) for h in (304, 305, 1981, 1982)}
    assert shown == {304: [False], 305: [True], 1981: [True], 1982: [False]}
    item = {"name": "CTR", "geometry": zone["geometry"], **OPENAIP_LIMITS}
    plain = written(tmp_path / "p.geojson", collection(*DRAWN))
    for content in ([item], {"items": [item]}):
        zones = written(tmp_path / "asp.json", content)
        cfg = SceneConfig(file=str(plain), zones=[str(zones)], altitude=1000.0)
        assert closed(scene_from_settings(cfg), IN_WALL) == [True]
    cfg = SceneConfig(file=str(path), roles={"icaoClass": {3: "none"}})
    assert scene_from_settings(cfg).obstacles == ()


def test_airspace_of_the_faa_and_of_ed_318(tmp_path):
    faa = feature("", "Polygon", AREA, UPPER_VAL=4000, UPPER_UOM="FT", UPPER_CODE="MSL", LOWER_VAL=-9998,
                  LOWER_UOM="FT", LOWER_CODE="SFC")  # fmt: skip
    path = written(tmp_path / "m.geojson", collection(*DRAWN, faa))
    assert [closed(pareto_ltl.read_map(path, altitude=h), IN_WALL)[0] for h in (10, 1219, 1220)] == [
        True,
        True,
        False,
    ]
    round_zone = feature("", "Point", [10.3, 60.1], name="x")
    round_zone["geometry"] |= {"extent": {"subType": "Circle", "radius": 3000}, "layer": {
        "upper": 120, "upperReference": "AGL", "lower": 0, "lowerReference": "AGL", "uom": "m"}}  # fmt: skip
    path = written(path, collection(*DRAWN, round_zone))
    assert [closed(pareto_ltl.read_map(path, altitude=h), IN_WALL)[0] for h in (10, 119, 121)] == [
        True,
        True,
        False,
    ]


def test_roles_for_a_file_a_property_and_the_rest(tmp_path):
    zones = collection(
        feature("", "Polygon", AREA, use="wood"),
        feature("", "Polygon", [box(10.45, 60.3, 10.5, 60.35)], use="lake", name="lake"),
    )
    other = written(tmp_path / "other.geojson", zones)
    path = written(
        tmp_path / "m.geojson", collection(*DRAWN, feature("", "Polygon", [box(10, 60.3, 10.1, 60.4)]))
    )
    assert "feature 3 has role None" in refusal(path)
    cfg = SceneConfig(file=str(path), zones=[str(other)], roles="obstacle")
    assert closed(scene_from_settings(cfg), IN_WALL, (10.47, 60.32), (10.05, 60.35)) == [True, True, True]
    cfg.roles = {"use": {"lake": "landmark"}, "other.geojson": "none", "else": "obstacle"}
    scene = scene_from_settings(cfg)
    assert closed(scene, IN_WALL, (10.05, 60.35)) == [False, True]
    assert len(scene.landmarks) == 1
    for wrong in ("airport", {"else": "airport"}, 3):
        cfg.roles = wrong
        with pytest.raises(ConfigError, match=r"scene\.roles must be a role"):
            scene_from_settings(cfg)


# --- GeoJSON of other programs ----------------------------------------------------------------------------


@pytest.mark.parametrize(("before", "between"), [("", "\n"), ("\x1e", "\n\x1e"), ("", "\r\n\r\n")])
def test_a_sequence_of_features_is_a_map(tmp_path, before, between):
    text = before + between.join(json.dumps(one) for one in (*DRAWN, feature("obstacle", "Polygon", AREA)))
    assert closed(pareto_ltl.read_map(written(tmp_path / "m.geojsonl", text)), IN_WALL) == [True]


def test_faults_of_a_sequence_are_named_by_their_place(tmp_path):
    text = "\n".join([json.dumps(DRAWN[0]), '{"type": 3}', '{"type": "Feature", }', json.dumps(DRAWN[1])])
    said = refusal(written(tmp_path / "m.geojsonl", text))
    assert "text 2 is" in said
    assert "text 3: not JSON" in said


def test_metres_without_a_crs_are_not_swapped_degrees(tmp_path):
    far = [
        feature("start", "Point", [5e5, 6.7e6]),
        feature("region", "Polygon", [box(5.2e5, 6.72e6, 5.3e5, 6.73e6)], name="a"),
    ]
    text = refusal(written(tmp_path / "m.geojson", collection(*far)))
    assert "its coordinates are no degrees" in text
    assert "crs" in text
    assert "swap" not in text
    assert "faults" not in text  # said once


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("m.gpkg", b"SQLite format 3\x00", "a GeoPackage"),
        ("m.shp", b"\x00\x00\x27\x0a", "a shapefile"),
        ("m.gpx", b"<gpx version='1.1'></gpx>", "a GPX file"),
        ("m.gml", b"<gml:FeatureCollection/>", "GML"),
        ("m.xml", b"<?xml version='1.0'?><!-- x --><message:AIXMBasicMessage/>", "AIXM"),
        ("m.json", b'{"type": "Topology"}', "TopoJSON"),
        ("m.json", b'{"features": [], "geometryType": "esriGeometryPolygon"}', "Esri"),
        ("m.fen", b"#saved by Mission Planner 1.3\n60 10\n", "Mission Planner"),
        ("m.wkt", b"POLYGON((1 2, 3 4, 5 6, 1 2))", "well-known text"),
        ("m.csv", b"name,lat,lon\na,1,2\n", "a table"),
        ("m.dxf", b"0\nSECTION\n", "DXF"),
        ("m.zip", None, "there is no KML file in it"),
    ],
)
def test_another_format_is_named_with_the_way_to_convert_it(tmp_path, name, content, words):
    path = tmp_path / name
    if content is None:
        archive(path, x_txt="")
    else:
        path.write_bytes(content)
    assert words in refusal(path)


# --- the rest ---------------------------------------------------------------------------------------------


def test_without_a_border_the_sky_is_open_and_a_drawn_border_is_a_wall(tmp_path, caplog):
    path = written(tmp_path / "m.geojson", collection(*DRAWN))
    with caplog.at_level(logging.INFO):
        assert scene_from_settings(SceneConfig(file=str(path)), border="wall").border == "open"
    assert caplog.text.count("the sky is open") == 1
    assert scene_from_settings(SceneConfig(file=str(path), border="wall")).border == "wall"
    frame = feature("border", "Polygon", [box(9.9, 59.9, 10.9, 60.5)])
    path = written(path, collection(*DRAWN, frame))
    assert scene_from_settings(SceneConfig(file=str(path)), border="wall").border == "wall"
    assert scene_from_settings(SceneConfig(file=str(path)), border="open").border == "open"


def test_the_frame_converts_positions_and_knows_north(tmp_path):
    scene = pareto_ltl.read_map(written(tmp_path / "m.geojson", collection(*DRAWN)))
    assert scene.frame.to_plane([10], [60])[0] == pytest.approx(scene.start)
    lon, lat = scene.frame.to_geographic(scene.start)
    assert (lon[0], lat[0]) == pytest.approx((10.0, 60.0))
    here, there = scene.frame.to_plane([10, 10], [60, 60.001])
    east, north = there - here
    assert scene.frame.north(scene.start)[0] == pytest.approx(np.arctan2(-east, north), abs=1e-6)
    square = np.array([[0.0, 0], [1, 0], [1, 1]])
    assert not pareto_ltl.Scene(np.array([[0.0, 0], [9, 9]]), np.ones(2), {"a": square}).frame.on_earth


def test_zones_need_a_map_in_degrees(tmp_path):
    zones = written(tmp_path / "zones.txt", OPENAIR)
    with pytest.raises(ConfigError, match="name a map file"):
        scene_from_settings(SceneConfig(bounds=[[0, 0], [9, 9]], start=[1, 1], zones=[str(zones)]))
    path = written(tmp_path / "m.geojson", collection(*DRAWN))
    with pytest.raises(DataError, match="cannot be read"):
        scene_from_settings(SceneConfig(file=str(path), zones=[str(tmp_path / "none.txt")]))
