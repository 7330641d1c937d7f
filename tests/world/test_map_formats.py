"""Map files of other programs: what is read of each, what is said not to be read, and what is refused."""

from __future__ import annotations

import io
import json
import logging
import zipfile

import numpy as np
import pytest
import shapely

import pareto_ltl
from map_samples import AREA, ED269, OPENAIP_LIMITS, OPENAIR, PLAN, WAYPOINTS, box
from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.messages import LONGEST_LINE
from pareto_ltl.world.scene_settings import scene_from_settings

KML = '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'
START = "<Placemark><name>Start</name><Point><coordinates>10,60,0</coordinates></Point></Placemark>"


def kml_ring(west, south, east, north, tag="LinearRing"):
    corners = " ".join(f"{lon},{lat},0" for lon, lat in box(west, south, east, north))
    return f"<{tag}><coordinates>{corners}</coordinates></{tag}>"


def kml_polygon(*sides):
    return f"<Polygon><outerBoundaryIs>{kml_ring(*sides)}</outerBoundaryIs></Polygon>"


def folder(name, *places, more=""):
    inside = "".join(f"<Placemark><name>{title}</name>{shape}</Placemark>" for title, shape in places)
    return f"<Folder><name>{name}</name>{more}{inside}</Folder>"


GOAL = folder("Regions", ("a", kml_polygon(10.6, 60.1, 10.8, 60.2)))
WALL = folder("Obstacles", ("wall", kml_polygon(10.2, 59.95, 10.4, 60.3)))
IN_WALL, FREE = (10.3, 60.1), (10.5, 60.1)


def archive(path, **members):
    with zipfile.ZipFile(path, "w") as file:
        for name, content in members.items():
            file.writestr(name.replace("__", "/").replace("_kml", ".kml"), content)
    return path


def written(path, content):
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def feature(role, kind, coordinates, **properties):
    stated = {"role": role} if role else {}
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {**stated, **properties}, "geometry": geometry}


def collection(*features):
    return {"type": "FeatureCollection", "features": list(features)}


DRAWN = (
    feature("start", "Point", [10, 60]),
    feature("region", "Polygon", [box(10.6, 60.1, 10.8, 60.2)], name="a"),
)


def closed(scene, *places):
    area = shapely.union_all([shapely.Polygon(outline) for outline in scene.obstacles])
    points = scene.frame.to_plane(*np.array(places, float).T)
    return shapely.contains_xy(area, *points.T).tolist()


def refusal(path, **keys):
    with pytest.raises(DataError) as error:
        scene_from_settings(SceneConfig(file=str(path), **keys))
    text = str(error.value)
    assert "\n" not in text
    assert len(text) <= LONGEST_LINE
    return text.replace(str(path), "")


# --- KML --------------------------------------------------------------------------------------------------


def link(href, name="zones"):
    return f"<NetworkLink><name>{name}</name><Link><href>{href}</href></Link></NetworkLink>"


def test_links_inside_an_archive_and_beside_a_file_are_read(tmp_path):
    zones = KML.format(WALL)
    inside = archive(
        tmp_path / "m.kmz", doc_kml=KML.format(START + GOAL + link("files/zones.kml")), files__zones_kml=zones
    )
    assert closed(pareto_ltl.read_map(inside), IN_WALL, FREE) == [True, False]
    (tmp_path / "my zones.kml").write_text(zones)
    beside = written(tmp_path / "m.kml", KML.format(START + GOAL + link("my%20zones.kml#x")))
    assert closed(pareto_ltl.read_map(beside), IN_WALL, FREE) == [True, False]
    out = archive(tmp_path / "n.kmz", doc_kml=KML.format(START + GOAL + link("../my%20zones.kml")))
    assert closed(pareto_ltl.read_map(out), IN_WALL) == [True]
    packed = archive(tmp_path / "zones.kmz", doc_kml=zones)
    chained = written(tmp_path / "c.kml", KML.format(START + GOAL + link(packed.name)))
    assert closed(pareto_ltl.read_map(chained), IN_WALL) == [True]


def test_a_folder_of_links_gives_its_role_to_what_they_hold(tmp_path):
    bare = KML.format(f"<Placemark><name>x</name>{kml_polygon(10.2, 59.95, 10.4, 60.3)}</Placemark>")
    (tmp_path / "zones.kml").write_text(bare)
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + link("zones.kml", "No-fly zones")))
    assert closed(pareto_ltl.read_map(path), IN_WALL) == [True]


def test_links_in_a_circle_end(tmp_path):
    (tmp_path / "b.kml").write_text(KML.format(WALL + link("a.kml")))
    path = written(tmp_path / "a.kml", KML.format(START + GOAL + link("b.kml") + link("b.kml")))
    assert len(pareto_ltl.read_map(path).obstacles) == 1


@pytest.mark.parametrize("href", ["missing.kml", "../outside.kml", "/etc/passwd", "a%00b.kml"])
def test_a_link_to_a_file_that_is_not_there_is_refused(tmp_path, href):
    (tmp_path / "maps").mkdir()
    (tmp_path / "outside.kml").write_text(KML.format(WALL))
    path = written(tmp_path / "maps" / "m.kml", KML.format(START + GOAL + link(href)))
    assert "NetworkLink 'zones' links to" in refusal(path)


def test_a_link_of_the_file_system_leads_to_no_other_folder(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "secret.kml").write_text(KML.format(WALL))
    (tmp_path / "maps" / "zones.kml").symlink_to(tmp_path / "secret.kml")
    path = written(tmp_path / "maps" / "m.kml", KML.format(START + GOAL + link("zones.kml")))
    assert "which is not in the folder of the map" in refusal(path)


OVERLAY = "<GroundOverlay><name>chart</name><Icon><href>x.png</href></Icon></GroundOverlay>"
TRACK = (
    "<Placemark><name>cable</name><gx:Track xmlns:gx='g'><gx:coord>1 2 3</gx:coord></gx:Track></Placemark>"
)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (link("https://example.org/zones.kml"), "NetworkLink 'zones' to https://example.org/zones.kml"),
        (OVERLAY, "GroundOverlay 'chart'"),
        (f"<Folder><name>Obstacles</name>{TRACK}</Folder>", "the Track of Placemark 'cable'"),
        ("<Strange/>", "the element Strange"),
    ],
)
def test_what_may_be_an_obstacle_and_is_not_read_is_a_warning(tmp_path, caplog, content, words):
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + content))
    with caplog.at_level(logging.INFO):
        pareto_ltl.read_map(path)
    (warning,) = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert "not read, and it may be an obstacle" in warning.getMessage()
    assert words in warning.getMessage()


def test_one_line_lists_what_cannot_be_an_obstacle(tmp_path, caplog):
    high = kml_polygon(10.2, 59.95, 10.4, 60.3).replace(
        "<Polygon>", "<Polygon><altitudeMode>absolute</altitudeMode>"
    )
    label = f"<MultiGeometry><Point><coordinates>10.3,60.1</coordinates></Point>{high}</MultiGeometry>"
    content = START + GOAL + "<Style/><Style/><LookAt/>" + folder("Obstacles", ("R-44", label))
    with caplog.at_level(logging.INFO):
        scene = pareto_ltl.read_map(written(tmp_path / "m.kml", KML.format(content)))
    assert closed(scene, IN_WALL) == [True]
    (line,) = [record for record in caplog.records if "not read" in record.getMessage()]
    assert line.levelno == logging.INFO
    for words in (
        "Style (2 times)",
        "LookAt",
        "altitudes (altitudeMode absolute)",
        "a label point in obstacle R-44",
    ):
        assert words in line.getMessage()


def test_a_point_beside_an_area_may_be_a_tower(tmp_path, caplog):
    point = "<Point><coordinates>10.5,60.1</coordinates></Point>"
    far = f"<MultiGeometry>{point}{kml_polygon(10.2, 59.95, 10.4, 60.3)}"
    content = START + GOAL + folder("Obstacles", ("R-44", far + "</MultiGeometry>"))
    pareto_ltl.read_map(written(tmp_path / "m.kml", KML.format(content)))
    assert "a point outside of obstacle R-44: a tower needs the property buffer" in caplog.text


def test_a_time_span_of_a_folder_is_that_of_its_places(tmp_path):
    span = "<TimeSpan><begin>2026-01-01T06:00:00Z</begin><end>2026-01-01T09:00:00Z</end></TimeSpan>"
    own = "<TimeSpan><begin>1h</begin></TimeSpan>" + kml_polygon(10.45, 60.1, 10.5, 60.2)
    timed = folder("Obstacles", ("drill", kml_polygon(10.2, 59.95, 10.4, 60.3)), ("later", own), more=span)
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + timed))
    scene = scene_from_settings(SceneConfig(file=str(path)), "2026-01-01T00:00:00Z")
    spans = {name: (window.begin, window.end) for name, window in scene.windows.items()}
    assert spans == {"obstacle_drill_3": (21600.0, 32400.0), "obstacle_later_4": (3600.0, np.inf)}
    assert set(scene.forbidden) == set(spans)


@pytest.mark.parametrize(
    "shape",
    [
        kml_ring(10.2, 59.95, 10.4, 60.3),
        kml_ring(10.2, 59.95, 10.4, 60.3, "LineString"),
        f"<MultiGeometry>{kml_ring(10.2, 59.95, 10.4, 60.3)}</MultiGeometry>",
    ],
)
def test_a_closed_line_is_an_area(tmp_path, shape):
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + folder("Obstacles", ("x", shape))))
    assert closed(pareto_ltl.read_map(path), IN_WALL, FREE) == [True, False]


def test_an_open_line_still_needs_a_buffer(tmp_path):
    line = "<LineString><coordinates>10.2,60 10.3,60 10.3,60.1</coordinates></LineString>"
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + folder("Obstacles", ("x", line))))
    assert "obstacle x is a LineString; expected a Polygon, or the property buffer" in refusal(path)


@pytest.mark.parametrize(
    "others",
    [
        {"files__legend_kml": KML.format("<Placemark><name>legend</name><Point/></Placemark>")},
        {"a_kml": KML.format("<Placemark><name>overlay</name></Placemark>"), "b_kml": "no XML"},
    ],
)
def test_the_map_of_an_archive_is_the_file_with_roles(tmp_path, caplog, others):
    path = archive(tmp_path / "m.kmz", **others, mission_kml=KML.format(START + GOAL))
    scene = pareto_ltl.read_map(path)
    assert (sorted(scene.regions), scene.obstacles) == (["a"], ())
    assert "in the archive, to which the map has no link" in caplog.text


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
    assert "the height of the ground is not known, so these have no ceiling: obstacle low" in caplog.text
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
    assert pareto_ltl.Scene(np.array([[0.0, 0], [9, 9]]), np.ones(2), {"a": square}).frame is None


def test_all_faults_of_a_map_are_in_one_message(tmp_path):
    path = written(
        tmp_path / "m.kml",
        KML.format(
            START + GOAL + link("missing.kml") + "<Placemark><name>x</name></Placemark>"
            + folder("Obstacles", ("line", "<LineString><coordinates>1,2 3,4</coordinates></LineString>"))
        ),
    )  # fmt: skip
    text = refusal(path)
    assert "has 3 faults" in text
    for words in ("missing.kml", "Placemark 'x' has no Point", "obstacle line is a LineString"):
        assert words in text


def test_zones_need_a_map_in_degrees(tmp_path):
    zones = written(tmp_path / "zones.txt", OPENAIR)
    with pytest.raises(ConfigError, match="name a map file"):
        scene_from_settings(SceneConfig(bounds=[[0, 0], [9, 9]], start=[1, 1], zones=[str(zones)]))
    path = written(tmp_path / "m.geojson", collection(*DRAWN))
    with pytest.raises(DataError, match="cannot be read"):
        scene_from_settings(SceneConfig(file=str(path), zones=[str(tmp_path / "none.txt")]))


def test_an_archive_may_have_any_name(tmp_path):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr("doc.kml", KML.format(START + GOAL + WALL))
    (tmp_path / "map.zip").write_bytes(buffer.getvalue())
    assert closed(pareto_ltl.read_map(tmp_path / "map.zip"), IN_WALL) == [True]
