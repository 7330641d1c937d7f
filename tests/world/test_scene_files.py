"""Maps are read into metres, harmless mistakes are corrected, and the rest is refused in one line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_files import scene_from_dict, scene_to_dict
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl_apps.formats import feature_limit
from strategies import lattice_scenes, scenes

SCENES = Path(__file__).parents[2] / "conf" / "scene"
SQUARE = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]]
WALL = [[5.0, 5.0], [7.0, 5.0], [7.0, 7.0], [5.0, 7.0]]


def config(**changes):
    keys = {
        "name": "harbour",
        "bounds": [[0.0, 0.0], [10.0, 10.0]],
        "start": [0.5, 0.5],
        "regions": {"a": SQUARE},
        "obstacles": [WALL],
    }
    return SceneConfig(**(keys | changes))


def refusal(**changes):
    with pytest.raises(DataError) as error:
        scene_from_settings(config(**changes))
    message = str(error.value)
    assert "\n" not in message
    return message


# --- units and planes ----------------------------------------------------------------------------


def test_coordinates_are_scaled_to_metres():
    scene = scene_from_settings(config(unit=100.0))
    np.testing.assert_array_equal(scene.bounds, [[0, 0], [1000, 1000]])
    np.testing.assert_array_equal(scene.start, [50, 50])
    np.testing.assert_array_equal(scene.regions["a"][0], 100 * np.array(SQUARE))
    np.testing.assert_array_equal(scene.obstacles[0], 100 * np.array(WALL))
    assert scene.crs is None


def test_a_map_with_a_centre_has_the_middle_of_its_bounds_there():
    scene = scene_from_settings(config(unit=1e5, centre=[37.0, -92.0]), "2018-10-09T00:00:00Z")
    np.testing.assert_array_equal(scene.bounds, [[-5e5, -5e5], [5e5, 5e5]])
    lon, lat = scene.frame.to_geographic(np.zeros((1, 2)))
    np.testing.assert_allclose([lat[0], lon[0]], [37, -92], atol=1e-9)
    assert scene.time_zero == "2018-10-09T00:00:00Z"


@pytest.mark.parametrize(("name", "regions", "obstacles"), [("phi1", "abc", 6), ("phi2", "abcd", 10)])
def test_the_shipped_maps_are_a_thousand_kilometres_wide(name, regions, obstacles):
    scene = scene_from_settings(SceneConfig(**yaml.safe_load((SCENES / f"{name}.yaml").read_text())))
    np.testing.assert_array_equal(scene.bounds, [[-5e5, -5e5], [5e5, 5e5]])
    assert "".join(scene.regions) == regions
    assert len(scene.obstacles) == obstacles


# --- round trip ----------------------------------------------------------------------------------


@given(st.one_of(scenes(), lattice_scenes()))
@settings(deadline=None, max_examples=30)
def test_a_scene_comes_back_from_json_bit_by_bit(scene):
    again = scene_from_dict(json.loads(json.dumps(scene_to_dict(scene))))
    assert scene_to_dict(again) == scene_to_dict(scene)
    assert isinstance(again, Scene)
    assert again.bounds.tobytes() == scene.bounds.tobytes()


def test_the_scene_file_of_a_run_is_read_as_it_was_written(tmp_path):
    scene = scene_from_settings(config(unit=1e5, centre=[37.0, -92.0]), "2018-10-09T00:00:00Z")
    (tmp_path / "scene.json").write_text(json.dumps(scene_to_dict(scene)))
    again = scene_from_settings(SceneConfig(file=str(tmp_path / "scene.json")))
    assert scene_to_dict(again) == scene_to_dict(scene)
    later = scene_from_settings(SceneConfig(file=str(tmp_path / "scene.json")), "2018-10-10T00:00:00Z")
    assert later.time_zero == "2018-10-10T00:00:00Z"


def test_a_scene_without_its_fields_is_refused():
    with pytest.raises(DataError, match="lacks start, regions"):
        scene_from_dict({"bounds": [[0, 0], [1, 1]], "obstacles": []})


# --- mistakes that are corrected ------------------------------------------------------------------


def test_a_repeated_closing_corner_is_dropped():
    scene = scene_from_settings(config(regions={"a": [*SQUARE, SQUARE[0]]}, obstacles=[[WALL[0], *WALL]]))
    assert len(scene.regions["a"][0]) == len(scene.obstacles[0]) == 4


@given(st.permutations([0, 1, 2, 3]).filter(lambda p: abs(p[0] - p[2]) == 2))
def test_outlines_are_turned_counter_clockwise(order):
    scene = scene_from_settings(config(regions={"a": [SQUARE[i] for i in order]}, obstacles=[WALL[::-1]]))
    for polygon in (*scene.regions["a"], *scene.obstacles):
        assert shapely.is_ccw(shapely.LinearRing(polygon))


def test_an_obstacle_that_sticks_out_is_clipped_to_the_bounds():
    comb = [[8, -2], [12, -2], [12, 12], [8, 12], [8, 8], [11, 8], [11, 2], [8, 2]]
    scene = scene_from_settings(config(obstacles=[WALL, comb, [[20, 20], [21, 20], [21, 21]]]))
    np.testing.assert_array_equal(scene.obstacles[0], WALL)
    assert [shapely.Polygon(o).area for o in scene.obstacles] == [4, 4, 4]
    assert np.concatenate(scene.obstacles).max() == 10
    assert np.concatenate(scene.obstacles).min() == 0


@pytest.mark.parametrize(
    "wall", [[[2, 1], [4, 1], [4, 2], [2, 2]], [[2, 2], [4, 2], [4, 4]], [[0, 2], [3, 2], [3, 3]]]
)
def test_an_obstacle_may_touch_a_region(wall):
    assert len(scene_from_settings(config(obstacles=[wall])).obstacles) == 1


def test_touching_survives_rounding_in_any_unit_and_plane():
    third = [[1 / 3, 0.1], [0.7, 0.1], [0.7, 0.9], [1 / 3, 0.9]]
    left = [[0.1, 0.1], [1 / 3, 0.1], [1 / 3, 0.9], [0.1, 0.9]]
    for unit in (0.3048, 1852.0, 1e5):
        keys = {"unit": unit, "centre": [60.0, 5.0], "bounds": [[0.0, 0.0], [1.1, 1.3]], "start": [0.9, 0.05]}
        assert scene_from_settings(config(regions={"a": third}, obstacles=[left], **keys))


def test_the_start_may_lie_on_the_edge_of_the_map():
    np.testing.assert_array_equal(scene_from_settings(config(start=[0.0, 10.0])).start, [0, 10])


# --- maps that are refused -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bounds": []}, ["scene 'harbour' has no bounds", "scene.bounds"]),
        ({"start": []}, ["has no start", "scene.start"]),
        ({"regions": {}}, ["has no regions"]),
        ({"bounds": [[10.0, 10.0], [0.0, 0.0]]}, ["reversed", "[[west, south], [east, north]]"]),
        ({"bounds": [[0.0, 0.0], [0.0, 5.0]]}, ["reversed or empty"]),
        ({"bounds": [[0.0, 0.0]]}, ["expected [[west, south], [east, north]]"]),
        ({"bounds": [[0.0, 0.0], [10.0, float("inf")]]}, ["not finite"]),
        ({"start": [1.0]}, ["scene.start is [1.0]", "expected [x, y]"]),
        ({"start": [1.0, float("nan")]}, ["scene.start", "finite"]),
        ({"start": [11.0, 1.0]}, ["start lies outside the bounds at (11, 1)", "(0, 0) to (10, 10)"]),
        ({"start": [6.0, 6.5]}, ["start (6, 6.5) lies inside obstacle 1"]),
        ({"regions": {"a": SQUARE[:2]}}, ["region 'a' has 2 distinct corners", "at least 3"]),
        (
            {"regions": {"a": [SQUARE[0], SQUARE[0], SQUARE[1], SQUARE[0]]}},
            ["region 'a' has 2 distinct corners"],
        ),
        ({"obstacles": [WALL, WALL[:1]]}, ["obstacle 2 has", "at least 3"]),
        (
            {"obstacles": [[[1.0, 3.0], [2.0], [2.0, 4.0]]]},
            ["obstacle 1: corner 2 is [2.0]", "expected [x, y]"],
        ),
        ({"obstacles": [[[1.0, 3.0], [2.0, float("nan")], [2.0, 4.0]]]}, ["obstacle 1: corner 2", "finite"]),
        ({"obstacles": [3.0]}, ["obstacle 1 is 3.0", "expected a list of corners"]),
        ({"obstacles": [WALL, [[1.0, 3.0], [2.0, 3.0], [4.0, 3.0]]]}, ["obstacle 2 is degenerate", "(1, 3)"]),
        (
            {"regions": {"a": [[1.0, 1.0], [3.0, 3.0], [3.0, 1.0], [1.0, 3.0]]}},
            ["region 'a' crosses or touches its own outline at (2, 2)"],
        ),
        (
            {"regions": {"a": [[9.0, 8.0], [10.5, 8.0], [10.0, 9.0]]}},
            ["region 'a' lies outside", "(10.5, 8)"],
        ),
        ({"regions": {"a": [[4.0, 4.0], [6.0, 4.0], [6.0, 6.0]]}}, ["obstacle 1 overlaps region 'a' at (5."]),
        ({"regions": {"a\nb": SQUARE}}, ["region name 'a\\\\nb'", "cannot be printed; rename it"]),
        ({"regions": {" ": SQUARE}}, ["region name ' '", "it is empty, or begins or ends with a space"]),
        ({"regions": {"x" * 81: SQUARE}}, ["it has 81 characters, 80 are the limit"]),
        ({"file": "no/such/file.json"}, ["no/such/file.json: cannot be read", "check scene.file"]),
    ],
)
def test_a_bad_map_is_refused_with_the_place_and_the_way_out(changes, words):
    message = refusal(unit=1000.0, centre=[37.0, -92.0], **changes)
    for word in words:
        assert word in message


# --- GeoJSON -------------------------------------------------------------------------------------


def test_one_message_names_all_faults_of_a_map_in_the_settings():
    text = refusal(start=[1], obstacles=[[[0, 0], [1, 1]], [[2, 2], [3, 2], [4, 2]]])
    assert re.search(
        r"has 3 faults: \(1\) scene.start is \[1\].*\(2\) obstacle 1 has 2 d.*\(3\) obstacle 2 is deg", text
    )
    assert "has 2 faults" in refusal(bounds=[[0, 0], [0, 1]], start=[])


def feature(role, coordinates, kind="Polygon", **properties):
    return {
        "type": "Feature",
        "properties": {"role": role, **properties},
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def square(lon, lat, half=0.1):
    west, south, east, north = lon - half, lat - half, lon + half, lat + half
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


FJORD = (
    feature("start", [5.0, 60.0], "Point"),
    feature("region", [square(5.5, 60.5)], name="a"),
    feature("obstacle", [square(5.25, 60.25)], name="Stord"),
)


def geojson(tmp_path, *features):
    (tmp_path / "map.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return SceneConfig(file=str(tmp_path / "map.geojson"))


def test_a_geojson_map_lies_where_it_was_drawn(tmp_path):
    scene = scene_from_settings(geojson(tmp_path, *FJORD))
    lon, lat = scene.frame.to_geographic(np.stack([scene.start, scene.regions["a"][0].mean(axis=0)]))
    np.testing.assert_allclose([lon, lat], [[5, 5.5], [60, 60.5]], atol=1e-4)
    middle = scene.frame.to_geographic(np.zeros((1, 2)))
    np.testing.assert_allclose(np.ravel(middle), [5.3, 60.3], atol=1e-9)  # box 5..5.6, 60..60.6
    assert len(scene.obstacles) == 1


def test_bounds_of_a_geojson_map_default_to_the_drawing_and_five_standard_deviations(tmp_path):
    scene = scene_from_settings(geojson(tmp_path, *FJORD))
    drawn = np.concatenate([scene.start[None], *scene.regions["a"], *scene.obstacles])
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    margin = 5 * 0.35 / 25 * (high - low).max()  # a wind error of 0.35 m/s across the map at 25 m/s
    np.testing.assert_allclose(scene.bounds, [low - margin, high + margin])


def test_bounds_drawn_in_degrees_hold_everything_between_their_parallels(tmp_path):
    frame = [[-10, 50], [20, 50], [20, 70], [-10, 70], [-10, 50]]
    low = feature("region", [square(5, 50.11)], name="low")  # at the middle of the southern parallel
    scene = scene_from_settings(geojson(tmp_path, *FJORD, low, feature("bounds", [frame])))
    corner = scene.frame.to_plane(np.array([-10.0]), np.array([50.0]))[0]
    assert scene.bounds[0, 1] < corner[1]


def test_a_geojson_map_may_cross_the_180th_meridian(tmp_path):
    scene = scene_from_settings(
        geojson(
            tmp_path,
            feature("start", [179.8, -18.0], "Point"),
            feature("region", [square(-179.5, -18.0)], name="fiji"),
        )
    )
    assert np.ptp(scene.bounds[:, 0]) < 1.2 * 111_320
    assert scene.regions["fiji"][0].min() > scene.start[0] - 1e5


def test_an_obstacle_with_a_hole_or_in_several_parts_is_cut_up(tmp_path):
    holed = feature("obstacle", [square(5.25, 60.25), square(5.25, 60.25, 0.05)])
    parts = feature("obstacle", [[square(5.05, 60.5, 0.02)], [square(5.1, 60.6, 0.02)]], "MultiPolygon")
    scene = scene_from_settings(geojson(tmp_path, *FJORD[:2], holed, parts))
    centre = scene.frame.to_plane(np.array([5.25]), np.array([60.25]))[0]
    assert not any(shapely.Polygon(o).contains(shapely.Point(centre)) for o in scene.obstacles)
    whole, hole = (shapely.Polygon(_plane(scene, square(5.25, 60.25, half))).area for half in (0.1, 0.05))
    near = [o for o in scene.obstacles if np.linalg.norm(o.mean(axis=0) - centre) < 12_000]
    assert sum(shapely.Polygon(o).area for o in near) == pytest.approx(whole - hole, rel=1e-9)
    assert len(scene.obstacles) == len(near) + 2


def _plane(scene, corners):
    lon, lat = np.array(corners, float).T
    return scene.frame.to_plane(lon, lat)


@pytest.mark.parametrize(
    ("features", "words"),
    [
        ((), ["has no features"]),
        (FJORD[:1], ["has no regions"]),
        (FJORD[1:], ["has no start", "Point"]),
        ((*FJORD, feature("start", [5, 60], "Point")), ["start twice"]),
        ((*FJORD, FJORD[1]), ["region 'a' twice"]),
        ((*FJORD, feature("goal", [square(5, 60)])), ["feature 4 has role 'goal'", "region, obstacle"]),
        ((*FJORD, feature("region", [square(5, 60)])), ["feature 4 is a region", "name"]),
        (
            (*FJORD, feature("region", [[5, 60], [6, 60]], "LineString", name="b")),
            ["region 'b' is a LineString"],
        ),
        (
            (*FJORD, feature("region", [square(5, 60), square(5.1, 60, 0.05)], name="b")),
            ["region 'b': its holes cross"],
        ),
        ((*FJORD, feature("region", [[1, 2, 3]], name="b")), ["coordinates of region 'b'", "Polygon"]),
        ((feature("start", square(5, 60)), *FJORD[1:]), ["the start is a Polygon", "expected a Point"]),
        ((*FJORD, feature("region", [square(60, 105)], name="b")), ["[longitude, latitude]", "swap"]),
        (
            (*FJORD, feature("obstacle", [square(5.5, 60.5)], name="Huglo")),
            ["obstacle Huglo overlaps region 'a'"],
        ),
        (
            (*FJORD, feature("bounds", [square(5.3, 60.3, 0.2)])),
            ["start lies outside the bounds at (longitude 5, latitude 60)"],
        ),
    ],
)
def test_a_bad_geojson_map_is_refused_in_degrees(tmp_path, features, words):
    with pytest.raises(DataError) as error:
        scene_from_settings(geojson(tmp_path, *features))
    for word in ["map.geojson", *words]:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"), [("{", "not JSON"), ("[]", "neither a GeoJSON"), ('{"a": 1}', "neither")]
)
def test_a_file_that_is_no_map_is_refused(tmp_path, text, words):
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(DataError, match=words):
        scene_from_settings(SceneConfig(file=str(tmp_path / "x.json")))


def member(name, value):
    return {**FJORD[0], name: value}


@pytest.mark.parametrize(
    ("features", "words"),
    [
        (1, "/features: expected an array of features, got 1"),
        (None, "/features: expected an array of features, got null"),
        ([1], "feature 1: expected an object 'properties' in an object, got 1"),
        ([None], "feature 1: expected an object 'properties'"),
        ([member("properties", [])], "feature 1: expected an object 'properties' in an object, got []"),
        ([member("geometry", "Point")], "feature 1: expected an object 'geometry'"),
        ([member("properties", {"role": ["start"]})], "feature 1 has role ['start']"),
        ([feature("region", [], name=["a"])], "feature 1: expected a text as name"),
        ([feature("start", 5, "Point")], "start is 5; expected [x, y]"),
        ([feature("start", {"x": 1}, "Point")], "expected [x, y]"),
        ([feature("start", ["5", "60"], "Point")], "start is ['5', '60']; expected [x, y]"),
        ([feature("start", [True, False], "Point")], "expected [x, y]"),
        ([feature("start", [10**30, 1], "Point")], "expected [x, y]"),
        ([feature("region", 5, name="a")], "coordinates of region 'a' are no Polygon"),
        ([feature("region", [5], name="a")], "coordinates of region 'a' are no Polygon"),
        ([feature("region", {"a": 1}, name="a")], "coordinates of region 'a' are no Polygon"),
        ([feature("region", [[{}, {}, {}]], name="a")], "coordinates of region 'a' are no Polygon"),
        ([feature("region", ["abc"], "MultiPolygon", name="a")], "no MultiPolygon"),
        ([feature("obstacle", [[]], "MultiPolygon")], "no MultiPolygon"),
        ([feature("region", [[]], "Poly\ngon" + "x" * 500, name="a")], "region 'a' is a Poly\\ngonxxx"),
        ([feature("region", [square(5, 60)], name="a b" * 100), FJORD[0]], "region name 'a ba b"),
        ([feature("obstacle", [square(5, 60), [[0, 0], [1e308, 0], [0, 1]]])], "expected finite numbers"),
    ],
)
def test_a_feature_of_another_shape_is_refused_by_its_number(tmp_path, features, words):
    (tmp_path / "map.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(DataError) as error:
        scene_from_settings(SceneConfig(file=str(tmp_path / "map.geojson")))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bounds": 1}, "/bounds: expected two corners, [[west, south], [east, north]], got 1"),
        ({"start": {"x": 1}}, "/start: expected an array of 2 numbers"),
        ({"regions": [SQUARE]}, "/regions: expected an object of outlines by name"),
        ({"obstacles": {"a": SQUARE}}, "/obstacles: expected an array of outlines"),
        ({"landmarks": [[["a", 1]] * 3]}, "/landmarks/0/0/0: expected a number of metres, at most 1e9"),
        ({"time_zero": "tomorrow"}, "time_zero is 'tomorrow'; expected an ISO 8601 time"),
        ({"time_zero": "9" * 5000}, "999'; expected an ISO 8601 time"),
        ({"crs": ["wgs84"]}, "/crs: expected text or null"),
        ({"windows": {"w": {"region": "zz", "begin": 0, "end": 9}}}, "window 'w' is of 'zz'; regions are "),
        ({"forbidden": ["k"]}, "forbidden lists 'k', but windows has no such name"),
    ],
)  # fmt: skip
def test_a_scene_json_of_another_shape_is_refused_with_the_place(tmp_path, changes, words):
    content = scene_to_dict(scene_from_settings(config())) | changes
    (tmp_path / "scene.json").write_text(json.dumps(content))
    with pytest.raises(DataError) as error:
        scene_from_settings(SceneConfig(file=str(tmp_path / "scene.json")))
    assert words in str(error.value)
    assert "scene.json" in str(error.value)
    assert len(str(error.value)) < 500


def test_a_map_saved_with_a_byte_order_mark_is_read(tmp_path):
    text = json.dumps({"type": "FeatureCollection", "features": FJORD})
    (tmp_path / "map.geojson").write_text(text, encoding="utf-8-sig")
    assert scene_from_settings(SceneConfig(file=str(tmp_path / "map.geojson"))).regions


def with_crs(tmp_path, crs, features=None):
    """FJORD in the coordinates of a system that PROJ knows, with the member crs."""
    text = {"type": "FeatureCollection", "crs": crs, "features": FJORD if features is None else features}
    (tmp_path / "crs.geojson").write_text(json.dumps(text))
    return SceneConfig(file=str(tmp_path / "crs.geojson"))


def named(name):
    return {"type": "name", "properties": {"name": name}}


def moved(coordinates, change):
    if isinstance(coordinates[0], list | tuple):
        return [moved(part, change) for part in coordinates]
    return list(change.transform(*coordinates))


@pytest.mark.parametrize("name", ["urn:ogc:def:crs:EPSG::3857", "EPSG:3857", "EPSG:32632", "EPSG:4258"])
def test_a_geojson_map_in_another_system_lies_where_it_was_drawn(tmp_path, name):
    change = pyproj.Transformer.from_crs("EPSG:4326", name, always_xy=True)
    features = json.loads(json.dumps(FJORD))
    for one in features:
        one["geometry"]["coordinates"] = moved(one["geometry"]["coordinates"], change)
    plain = scene_from_settings(geojson(tmp_path, *FJORD))
    scene = scene_from_settings(with_crs(tmp_path, named(name), features))
    np.testing.assert_allclose(scene.bounds, plain.bounds, atol=1.0)
    for region, corners in plain.regions.items():
        np.testing.assert_allclose(scene.regions[region][0], *corners, atol=1.0)


@pytest.mark.parametrize(
    "crs",
    [None, named("urn:ogc:def:crs:OGC:1.3:CRS84"), named("EPSG:4326"), named("urn:ogc:def:crs:EPSG::4326")],
)
def test_degrees_need_no_system_and_may_name_theirs(tmp_path, crs):
    plain = scene_from_settings(geojson(tmp_path, *FJORD))
    np.testing.assert_array_equal(scene_from_settings(with_crs(tmp_path, crs)).bounds, plain.bounds)


@pytest.mark.parametrize(
    ("crs", "words"),
    [
        (named("EPSG:999999"), "PROJ does not know the crs 'EPSG:999999'"),
        (named("x" * 10_000), "PROJ does not know the crs 'xxx"),
        (named(3), "expected a name such as urn:ogc:def:crs:EPSG::3857"),
        ({"type": "link", "properties": {"href": "http://example.org"}}, "expected a name such as"),
        ("EPSG:4326", "expected a name such as"),
    ],
)
def test_a_system_that_is_not_known_is_refused(tmp_path, crs, words):
    with pytest.raises(DataError) as caught:
        scene_from_settings(with_crs(tmp_path, crs))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(tmp_path))


@pytest.mark.parametrize("unit", [1e-3, 1e7])
def test_a_map_larger_than_the_earth_or_smaller_than_any_robot_is_refused(unit):
    size = 0.1 if unit < 1 else 100
    outline = [[0.1 * size, 0.1 * size], [0.2 * size, 0.1 * size], [0.2 * size, 0.2 * size]]
    made = SceneConfig(unit=unit, bounds=[[0, 0], [size, size]], start=[0, 0], regions={"a": outline})
    with pytest.raises(DataError, match=r"the map is .* m x .* m; expected sides between .*scene\.unit"):
        scene_from_settings(made)


@pytest.mark.parametrize("suffix", ["geojson", "kml"])
def test_a_map_of_too_many_features_is_refused_before_it_is_parsed(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr(feature_limit, "MAX_FEATURES", 1)
    feature = {"geojson": '{"geometry": ', "kml": "<Placemark></Placemark>"}[suffix]
    (tmp_path / f"map.{suffix}").write_text(2 * feature)  # neither JSON nor XML
    with pytest.raises(DataError, match="has more than 1 features; keep those near the mission"):
        scene_from_settings(SceneConfig(file=str(tmp_path / f"map.{suffix}")))
