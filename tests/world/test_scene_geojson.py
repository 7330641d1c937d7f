"""Maps drawn in GeoJSON: parts, holes, buffers, points and lines, altitudes, times, borders."""

from __future__ import annotations

import json
import logging
import math
import re

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from careful_io.messages import LONGEST_LINE
from flight_quantities.heights import level_height
from flight_quantities.levels import parse_level
from pareto_ltl.extend import Frame
from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.cells import decompose, unreachable_regions
from pareto_ltl.world.scene import FixShape
from pareto_ltl.world.scene_files import scene_from_dict, scene_to_dict
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl.world.scene_sketch import MissionUse
from pareto_ltl.world.windows import Window
from pareto_ltl_apps.exports.geojson import true_fix
from pareto_ltl_verify import laws


def feature(role, coordinates, kind="Polygon", **properties):
    shape = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"role": role, **properties}, "geometry": shape}


def square(lon, lat, half=0.1):
    west, south, east, north = lon - half, lat - half, lon + half, lat + half
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


START = feature("start", [5.0, 60.0], "Point")
GOAL = feature("region", [square(5.5, 60.5)], name="a")
FRAME = feature("border", [square(5.3, 60.3, 0.6)])


def scene_of(tmp_path, *features, use=None, time_zero=None, border="open", level=None, **keys):
    path = tmp_path / "map.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    cfg = SceneConfig(file=str(path), **keys)
    told = None if use is None else MissionUse(*map(frozenset, use))
    height = None if level is None else level_height(parse_level(level))
    return scene_from_settings(cfg, time_zero, border, lambda: told, height)


def drawn_shape(scene, corners):
    """A polygon of the plane whose edges are straight in longitude and latitude, with 200 parts each."""
    ring, share = np.array(corners, float)[:, :2], np.linspace(0, 1, 200, endpoint=False)[:, None]
    edges = [a + share * (b - a) for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)]
    return shapely.Polygon(plane(scene, np.concatenate(edges)))


def bent(scene):
    """How far edges may pass from true ones [m]."""
    return 2.01e-4 * np.ptp(scene.bounds, axis=0).max()


def area(outlines):
    return sum(shapely.Polygon(outline).area for outline in outlines)


def plane(scene, corners):
    return scene.frame.to_plane(*np.array(corners, float).T)


def whole(outlines):
    return shapely.union_all([shapely.Polygon(outline) for outline in outlines])


# --- parts and holes ----------------------------------------------------------------------------------


def test_a_region_of_two_parts_with_a_hole_is_planned_with_as_one(tmp_path):
    parts = [[square(5.2, 60.2), square(5.2, 60.2, 0.03)], [square(5.6, 60.2)]]
    scene = scene_of(tmp_path, START, GOAL, feature("region", parts, "MultiPolygon", name="b"))
    drawn = [
        shapely.Polygon(plane(scene, outer), [plane(scene, h) for h in holes]) for outer, *holes in parts
    ]
    assert whole(scene.regions["b"]).symmetric_difference(shapely.union_all(drawn)).area < 1.0
    made = decompose(scene)
    assert area(made.regions["b"]) == pytest.approx(sum(d.area for d in drawn), rel=1e-6)
    shown = [c for c, label in zip(made.cells, made.labels, strict=True) if "b" in label]
    assert area(shown) == pytest.approx(sum(d.area for d in drawn), rel=1e-6)
    again = scene_from_dict(json.loads(json.dumps(scene_to_dict(scene))))
    assert scene_to_dict(again) == scene_to_dict(scene)
    (tmp_path / "scene.json").write_text(json.dumps(scene_to_dict(scene)))
    read = scene_from_settings(SceneConfig(file=str(tmp_path / "scene.json")))
    assert whole(read.regions["b"]).symmetric_difference(whole(scene.regions["b"])).area < 1.0


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(4.95, 5.65), st.floats(59.95, 60.65), st.floats(0.01, 0.2)),
        min_size=1,
        max_size=4,
    )
)
def test_parts_that_overlap_count_once(tmp_path_factory, squares):
    folder = tmp_path_factory.mktemp("map")
    coordinates = [[square(*one)] for one in squares]
    scene = scene_of(folder, START, FRAME, feature("region", coordinates, "MultiPolygon", name="a"))
    united = shapely.union_all([drawn_shape(scene, square(*one)) for one in squares])
    chord = 20.0  # [m]: a parallel at 60 degrees is at most so far from a chord of 22 km
    assert area(scene.regions["a"]) == pytest.approx(united.area, abs=chord * united.length)
    points = np.random.default_rng(0).uniform(*scene.bounds, (200, 2))
    clear = shapely.distance(shapely.points(points), united.boundary) > chord
    points, inside = points[clear], shapely.contains_xy(united, *points[clear].T)
    assert (shapely.contains_xy(whole(scene.regions["a"]), *points.T) == inside).all()


def test_a_landmark_that_is_not_convex_comes_in_convex_parts(tmp_path):
    bent = [[5.0, 60.2], [5.3, 60.2], [5.3, 60.5], [5.2, 60.5], [5.2, 60.3], [5.0, 60.3], [5.0, 60.2]]
    scene = scene_of(tmp_path, START, GOAL, feature("landmark", [bent]))
    assert len(scene.landmarks) == 2
    assert whole(scene.landmarks).symmetric_difference(shapely.Polygon(plane(scene, bent))).area < 1.0
    for part in scene.landmarks:
        assert shapely.Polygon(part).convex_hull.area == pytest.approx(shapely.Polygon(part).area)


def test_a_polygon_cut_at_the_180th_meridian_is_one_area(tmp_path):
    west = [[179.5, -18.0], [180.0, -18.0], [180.0, -17.5], [179.5, -17.5], [179.5, -18.0]]
    east = [[-180.0, -18.0], [-179.6, -18.0], [-179.6, -17.5], [-180.0, -17.5], [-180.0, -18.0]]
    through = [[179.5, -18.9], [-179.6, -18.9], [-179.6, -18.4], [179.5, -18.4], [179.5, -18.9]]
    scene = scene_of(
        tmp_path,
        feature("start", [179.8, -18.2], "Point"),
        feature("region", [[west], [east]], "MultiPolygon", name="fiji"),
        feature("region", [through], name="b"),
    )
    assert len(scene.regions["fiji"]) == len(scene.regions["b"]) == 1
    for name in ("fiji", "b"):
        assert np.ptp(scene.regions[name][0][:, 0]) == pytest.approx(0.9 * 106_000, rel=0.02)


# --- buffers ------------------------------------------------------------------------------------------


def test_a_buffer_keeps_an_obstacle_at_its_distance(tmp_path):
    rock = feature("obstacle", [square(5.2, 60.3, 0.02)], buffer=800)
    tower = feature("obstacle", [5.5, 60.2], "Point", buffer="300")
    cable = feature("obstacle", [[5.0, 60.4], [5.2, 60.6]], "LineString", buffer=250.0)
    scene = scene_of(tmp_path, START, GOAL, rock, tower, cable)
    blocked = whole(scene.obstacles)
    cores = [
        (shapely.Polygon(plane(scene, square(5.2, 60.3, 0.02))), 800),
        (shapely.Point(plane(scene, [[5.5, 60.2]])), 300),
        (shapely.LineString(plane(scene, np.linspace([5.0, 60.4], [5.2, 60.6], 100))), 250),
    ]
    for core, distance in cores:
        assert blocked.buffer(bent(scene)).contains(core.buffer(distance, quad_segs=64))
    wide = shapely.union_all([core.buffer(1.05 * distance, quad_segs=64) for core, distance in cores])
    assert wide.contains(blocked)


def test_a_tower_in_a_region_is_cut_out_with_its_buffer(tmp_path):
    scene = scene_of(tmp_path, START, GOAL, feature("obstacle", [5.5, 60.5], "Point", buffer=500))
    lost = shapely.Polygon(plane(scene, square(5.5, 60.5))).area - area(scene.regions["a"])
    assert lost == pytest.approx(math.pi * 500**2, rel=0.06)
    assert decompose(scene).cells


def test_a_point_with_a_radius_is_a_region_no_larger_than_a_disc(tmp_path):
    scene = scene_of(tmp_path, START, feature("region", [5.5, 60.5], "Point", name="a", radius=2000))
    centre = shapely.Point(plane(scene, [[5.5, 60.5]]))
    (corners,) = scene.regions["a"]
    assert centre.buffer(2000.001, quad_segs=64).contains(shapely.Polygon(corners))
    assert area([corners]) > 0.97 * math.pi * 2000**2


@pytest.mark.parametrize(("use", "grows"), [(("a", ""), False), (("", "a"), True), (None, False)])
def test_the_buffer_of_a_region_is_on_the_careful_side(tmp_path, use, grows):
    area_of = feature("region", [square(5.5, 60.5)], name="a", buffer=1000)
    scene = scene_of(tmp_path, START, area_of, FRAME, use=use)
    true = shapely.Polygon(plane(scene, square(5.5, 60.5)))
    small, large = (true, whole(scene.regions["a"])) if grows else (whole(scene.regions["a"]), true)
    assert large.contains(small)
    assert small.exterior.distance(large.exterior) == pytest.approx(1000, rel=0.03)


# --- altitudes, times, borders ------------------------------------------------------------------------


def test_places_of_another_altitude_do_not_count(tmp_path, caplog):
    tfr = feature("region", [square(5.2, 60.5, 0.05)], name="tfr", floor=500)
    mast = feature("obstacle", [5.3, 60.3], "Point", buffer=100, ceiling=200)
    high = scene_of(tmp_path, START, GOAL, tfr, mast, level="300m amsl", use=("a", "b"))
    assert (high.regions["tfr"], high.obstacles) == ((), ())
    assert [(place.what, place.floor, place.ceiling) for place in high.absent] == [
        ("region 'tfr'", 500.0, np.inf),
        ("obstacle 1", -np.inf, 200.0),
    ]
    assert scene_from_dict(json.loads(json.dumps(scene_to_dict(high)))).absent == high.absent
    assert decompose(high).regions["tfr"] == ()
    low = scene_of(tmp_path, START, GOAL, tfr, mast, level="150m amsl")
    assert (len(low.regions["tfr"]), len(low.obstacles)) == (0, 1)
    assert not caplog.records
    with caplog.at_level(logging.WARNING):
        every = scene_of(tmp_path, START, GOAL, tfr, mast)
    assert (len(every.regions["tfr"]), len(every.obstacles)) == (1, 1)
    assert "the height of the flight is not set (robot.level)" in caplog.text
    assert every.absent == ()
    with pytest.raises(DataError, match="visits region 'tfr', which lies above 500 m"):
        scene_of(tmp_path, START, GOAL, tfr, level="300m amsl", use=(("a", "tfr"), ""))


def test_times_of_regions_and_obstacles_are_windows(tmp_path):
    open_till = {**GOAL, "properties": GOAL["properties"] | {"until": "6h"}}
    storm = feature(
        "obstacle", [square(5.2, 60.2, 0.05)], name="storm cell", **{"from": "2018-10-09T06:00:00Z"}
    )
    scene = scene_of(tmp_path, START, open_till, storm, time_zero="2018-10-09T00:00:00Z")
    assert scene.obstacles == ()
    assert scene.windows == {
        "a": Window("a", -math.inf, 21_600.0),
        "obstacle_storm_cell_3": Window("obstacle_storm_cell_3", 21_600.0, math.inf),
    }
    assert scene.forbidden == ("obstacle_storm_cell_3",)


FENCE = [[4.8, 59.9], [5.9, 59.9], [5.9, 60.9], [5.0, 60.9], [5.0, 60.2], [4.8, 60.2], [4.8, 59.9]]


def test_a_border_that_is_no_rectangle_is_a_fence(tmp_path):
    scene = scene_of(tmp_path, START, GOAL, feature("border", [FENCE]), border="wall")
    inside = drawn_shape(scene, FENCE)
    box = shapely.box(*scene.bounds.ravel())
    assert whole(scene.obstacles).symmetric_difference(box - inside).area < bent(scene) * inside.length
    np.testing.assert_allclose(inside.bounds, box.bounds, atol=5e-4 * np.ptp(scene.bounds))
    assert scene_of(tmp_path, START, GOAL, feature("border", [FENCE])).obstacles == ()


def test_the_buffer_of_a_border_moves_it_inwards(tmp_path):
    for corners, walls in ((FENCE, 3), (square(5.4, 60.4, 0.7), 0)):
        plain = scene_of(tmp_path, START, GOAL, feature("border", [corners]), border="wall")
        moved = scene_of(tmp_path, START, GOAL, feature("border", [corners], buffer=1000), border="wall")
        inner = shapely.box(*moved.bounds.ravel()) - whole(moved.obstacles)
        outer = shapely.box(*plain.bounds.ravel()) - whole(plain.obstacles)
        assert outer.contains(inner)
        assert outer.exterior.distance(inner) == pytest.approx(1000, abs=30 + 5e-4 * np.ptp(plain.bounds))
        assert bool(moved.obstacles) == bool(walls)


def plane_square(half_km, turn=0.0, parts=64):
    """A square of the plane around (5.3, 60.3), turned by ``turn`` [rad], in degrees with 6 decimals.

    Its sides are straight in the plane, so each has ``parts`` edges in degrees.
    """
    angles = turn + np.pi / 4 * np.array([1, 3, 5, 7])
    ends = 1000 * half_km * np.sqrt(2) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    share = np.linspace(0, 1, parts, endpoint=False)[:, None]
    corners = np.concatenate([a + share * (b - a) for a, b in zip(ends, np.roll(ends, -1, 0), strict=True)])
    crs = "+proj=aeqd +lat_0=60.3 +lon_0=5.3 +datum=WGS84"
    return np.round(np.stack(Frame(crs).to_geographic(corners), axis=1), 6).tolist()


BENT_SQUARE = plane_square(60, parts=1)


@pytest.mark.parametrize("half_km", [60, 250, 400])
def test_a_border_that_is_almost_a_rectangle_is_the_rectangle_inside_it(tmp_path, half_km):
    drawn = plane_square(half_km)
    scene = scene_of(tmp_path, START, GOAL, feature("border", [drawn]), border="wall")
    inside, box = shapely.Polygon(plane(scene, drawn)), shapely.box(*scene.bounds.ravel())
    assert scene.obstacles == ()
    assert inside.buffer(1e-3).covers(box)
    assert inside.hausdorff_distance(box) < 5e-4 * 2000 * half_km


@pytest.mark.parametrize("turn", [1e-4, 1e-3, 0.05])
def test_no_sliver_is_left_between_a_border_and_the_bounds(tmp_path, turn):
    drawn = plane_square(250, turn)
    corner = drawn[0]
    at_corner = [corner, [corner[0] - 0.3, corner[1] - 0.01], [corner[0] - 0.3, corner[1] - 0.2], corner]
    for places in ((), (feature("region", [at_corner], name="b"),)):
        scene = scene_of(tmp_path, START, GOAL, *places, feature("border", [drawn]), border="wall")
        inside, box = shapely.Polygon(plane(scene, drawn)), shapely.box(*scene.bounds.ravel())
        assert (box - inside - whole(scene.obstacles)).area < 1e-6 * box.length**2
        for part in decompose(scene).obstacles:
            assert 2 * shapely.Polygon(part).area / shapely.Polygon(part).length > 1e-6 * 5e5


@pytest.mark.parametrize(
    ("features", "words"),
    [
        (
            (feature("obstacle", [5.3, 60.3], "Point"),),
            "obstacle 1 is a Point; expected a Polygon, or the property buffer",
        ),
        (
            (feature("obstacle", [square(5.3, 60.3)], buffer="wide"),),
            "buffer is 'wide'; expected a number of metres",
        ),
        ((feature("obstacle", [square(5.3, 60.3)], buffer=-5),), "its buffer is -5 m; expected 0 or more"),
        (
            (feature("obstacle", [square(5.3, 60.3)], floor=300, ceiling=100),),
            "floor, 300 m, lies above its ceiling",
        ),
        (
            (feature("obstacle", [5.0, 60.001], "Point", buffer=500),),
            "start (longitude 5, latitude 60) lies inside obstacle 1 or its buffer",
        ),
        (
            (feature("region", [square(5.3, 60.3, 0.01)], name="b", buffer=1e4),),
            "nothing is left of region 'b' within its buffer",
        ),
        (
            (feature("obstacle", [5.5, 60.5], "Point", buffer=2e4), FRAME),
            "nothing is left of region 'a' outside of the buffers",
        ),
        (
            (feature("border", [[square(5, 60)], [square(6, 60)]], "MultiPolygon"),),
            "the border has a hole or several parts",
        ),
        ((feature("landmark", [square(5.2, 60.2)], until="6h"),), "landmark 1 has times"),
        ((feature("obstacle", [], "GeometryCollection"),), "not a GeometryCollection of GeoJSON"),
        ((feature("obstacle", [[5.0], [6.0]], "LineString", buffer=5),), "a corner of obstacle 1 is [5.0]"),
        ((feature("obstacle", [[]], "LineString", buffer=5),), "a corner of obstacle 1"),
        ((feature("obstacle", 5, "MultiPoint", buffer=5),), "no MultiPoint as GeoJSON writes it"),
        (
            (feature("region", [[[5.2, 60.2], [5.4, 60.4], [5.4, 60.2], [5.2, 60.4]]], name="b"),),
            "region 'b' crosses or touches its own outline at (longitude 5.3",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(tmp_path, features, words):
    with pytest.raises(DataError) as error:
        scene_of(tmp_path, START, GOAL, *features)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("half", "said"), [(3.0, ""), (12.0, "% wrong at its corners"), (29.0, "refused")])
def test_lengths_that_the_plane_distorts_are_said_in_per_cent(tmp_path, caplog, half, said):
    frame = feature("border", [square(5.3, 60.3 if half < 20 else 45.0, half)])
    if said == "refused":
        with pytest.raises(DataError, match=r"lengths in its plane are up to \d+\.\d % wrong at its corners"):
            scene_of(tmp_path, START, GOAL, frame)
        return
    scene_of(tmp_path, START, GOAL, frame)
    assert (said in caplog.text) if said else "wrong" not in caplog.text


def test_a_start_and_a_region_outside_of_a_fence_are_named(tmp_path):
    fence = feature("border", [FENCE])
    away = feature("start", [4.85, 60.5], "Point")
    with pytest.raises(DataError, match=r"the start .* lies outside the border"):
        scene_of(tmp_path, away, GOAL, fence, border="wall")
    swapped = feature("start", [60.5, 5.0], "Point")
    with pytest.raises(DataError, match=r"outside the b.*: are longitude and latitude swapped .*first\)\?"):
        scene_of(tmp_path, swapped, GOAL, fence, border="wall")
    beyond = feature("region", [square(4.95, 60.5, 0.02)], name="b")
    with pytest.raises(DataError, match="region 'b' lies outside the border at"):
        scene_of(tmp_path, START, GOAL, beyond, fence, border="wall")


def test_a_region_both_visited_and_avoided_has_no_careful_side(tmp_path):
    margin = feature("region", [square(5.3, 60.3, 0.05)], name="b", buffer=100)
    with pytest.raises(DataError, match="both visits and avoids it"):
        scene_of(tmp_path, START, GOAL, margin, use=("ab", "b"))


def test_a_collection_of_points_lines_and_polygons_is_one_obstacle(tmp_path):
    parts = [
        {"type": "Point", "coordinates": [5.2, 60.2]},
        {"type": "Polygon", "coordinates": [square(5.3, 60.4, 0.03)]},
        {
            "type": "GeometryCollection",
            "geometries": [{"type": "MultiLineString", "coordinates": [[[5.1, 60.5], [5.2, 60.5]]]}],
        },
    ]
    farm = {
        "type": "Feature",
        "properties": {"Role": " Obstacle ", "Buffer": 200},
        "geometry": {"type": "GeometryCollection", "geometries": parts},
    }
    assert len(scene_of(tmp_path, START, GOAL, farm).obstacles) == 3


# --- faults -------------------------------------------------------------------------------------------


def fault_of(tmp_path, *features, **keys):
    with pytest.raises(DataError) as error:
        scene_of(tmp_path, *features, **keys)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_one_message_names_all_faults_of_a_map_each_with_its_place(tmp_path):
    line = [[5.1, 60.1], [5.2, 60.2], [5.1, 60.1]]
    bow = [[5.1, 60.1], [5.2, 60.2], [5.2, 60.1], [5.1, 60.2]]
    text = fault_of(
        tmp_path, START, GOAL, FRAME,
        feature("region", [square(5.9, 60.8)], name="b"),
        feature("zone", [square(5.0, 60.1)]),
        feature("obstacle", [line], name="wood"),
        feature("obstacle", [bow]),
        feature("obstacle", [square(5.55, 60.55)]),
        feature("region", [square(5.1, 60.8)], name='c"d'),
        feature("region", [square(5.1, 60.5)], name="late", until="soon"),
    )  # fmt: skip
    words = [
        "map.geojson has 7 faults: (1) feature 5 has role 'zone'", "obstacle wood has 2 distinct corners",
        "obstacle 2 crosses or touches its own outline at (longitude 5.15, latitude 60.15",
        "obstacle 3 overlaps region 'a' at (longitude 5.525, latitude 60.525",
        "region 'b' lies outside the bounds at (longitude 6, ", "name 'c\"d' cannot stand in", "'soon'",
    ]  # fmt: skip
    assert [word for word in words if word not in text] == []


def test_a_faulty_start_or_border_gives_no_further_messages_about_what_is_missing(tmp_path):
    text = fault_of(tmp_path, feature("start", [5.0], "Point"), GOAL, feature("border", [[[5, 60], [6, 61]]]))
    assert (
        "has 2 faults: (1) start is [5.0]; expected [x, y], two finite numbers; (2) border has 2 distinct"
        in text
    )


def test_of_many_faults_the_first_are_named_and_the_others_counted(tmp_path):
    flat = [[5.1, 60.1], [5.2, 60.2], [5.1, 60.1]]
    text = fault_of(tmp_path, START, GOAL, *(feature("obstacle", [flat]) for _ in range(40)))
    assert len(text) <= LONGEST_LINE
    named = text.count("distinct corners")
    assert named > 5
    assert text.endswith(f"; and {40 - named} more")


@pytest.mark.parametrize("border", ["wall", "open"])
@pytest.mark.parametrize(
    "features",
    [
        (feature("start", [4.7, 60.0], "Point"), FRAME),
        (feature("start", [4.7, 59.7], "Point"), FRAME),
        (feature("start", BENT_SQUARE[0], "Point"), feature("border", [BENT_SQUARE])),
        (START, FRAME, feature("obstacle", [square(5.1, 60.0)])),
        (START, FRAME, feature("obstacle", [square(5.9, 60.3, 0.2)])),
        (START, FRAME, feature("obstacle", [square(6.0, 60.3)])),
        (START, FRAME, feature("obstacle", [square(5.7, 60.5)])),
        (START, FRAME, feature("region", [square(5.8, 60.8)], name="b")),
        (START, feature("border", [[[4.7, 59.7], [5.3, 59.7], *square(5.3, 60.3, 0.6)[1:]]])),
        (START, feature("border", [[*FENCE[:2], *FENCE[1:4], *FENCE[3:]]])),
    ],
    ids=["start on the border", "start in its corner", "start in the corner of a plane square",
         "start on an obstacle", "obstacle across the border", "obstacle outside of it",
         "obstacle beside a region", "region in a corner", "flat corners", "repeated corners"],
)  # fmt: skip
def test_places_that_touch_one_another_are_accepted(tmp_path, features, border):
    scene = scene_of(tmp_path, *features, GOAL, border=border)
    assert unreachable_regions(decompose(scene), scene, ["a"]) == ()


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ([[4.7, 59.7], [5.9, 60.9], [4.7, 59.7]], "border has 2 distinct corners"),
        (
            [[4.7, 59.7], [5.9, 60.9], [5.9, 59.7], [4.7, 60.9]],
            r"crosses .* at \(longitude 5.3",
        ),
        (
            [[4.7, 59.7], [5.3, 60.0], [5.9, 59.7], [5.9, 60.9], [5.3, 60.0], [4.7, 60.9]],
            "lies outside the border",  # two triangles that meet in a corner
        ),
        ([[4.7, 60], [5.3, 60 + 1e-9], [5.9, 60]], "lies outside the bo"),
    ],
)
def test_a_degenerate_border_is_refused_with_the_place(tmp_path, corners, words):
    assert re.search(words, fault_of(tmp_path, START, GOAL, feature("border", [corners]), border="wall"))


# --- errors of fixes --------------------------------------------------------------------------------

EVEN = [[5.2, 60.2], [5.3, 60.2], [5.3, 60.25], [5.2, 60.25], [5.2, 60.2]]  # as long as wide
COAST = [[5.2, 60.2], [5.4, 60.2], [5.4, 60.21], [5.2, 60.21], [5.2, 60.2]]


@pytest.mark.parametrize("fix", [{"along": 3000, "across": 40}, '{"sd": 3000, "across": 40}'])
def test_a_coast_shows_the_distance_across_its_longer_side(tmp_path, fix):
    scene = scene_of(tmp_path, START, GOAL, feature("landmark", [COAST], fix=fix))
    (shape,) = scene.landmark_fixes
    assert (shape.along, shape.across) == (3000.0, 40.0)
    east = np.diff(plane(scene, COAST[:2]), axis=0)[0]
    off = math.degrees(math.atan2(*east)) - shape.bearing
    assert abs((off + 90.0) % 180.0 - 90.0) < 0.1
    again = scene_from_dict(json.loads(json.dumps(scene_to_dict(scene))))
    assert again.landmark_fixes == scene.landmark_fixes


def test_a_bearing_counts_from_true_north_and_parts_share_the_fix(tmp_path):
    bent = [[5.2, 60.2], [5.4, 60.2], [5.4, 60.4], [5.35, 60.4], [5.35, 60.22], [5.2, 60.22], [5.2, 60.2]]
    fix = {"along": 500, "across": 50, "bearing": 30}
    frame = feature("border", [square(2.6, 60.3, 3.0)])
    marks = feature("landmark", [bent], fix=fix), feature("landmark", [COAST])
    scene = scene_of(tmp_path, START, GOAL, frame, *marks)
    assert [shape is not None for shape in scene.landmark_fixes] == [True] * 2 + [False]
    assert scene.landmark_fixes[0] == scene.landmark_fixes[1]
    at, metre = np.array([5.3, 60.3]), 1e-5
    step = [
        metre * math.sin(math.radians(30)) / math.cos(math.radians(60.3)),
        metre * math.cos(math.radians(30)),
    ]
    east, north = np.diff(plane(scene, [at, at + step]), axis=0)[0]
    assert scene.landmark_fixes[0].bearing == pytest.approx(math.degrees(math.atan2(east, north)), abs=0.15)
    assert abs(scene.landmark_fixes[0].bearing - 30.0) > 2.0  # meridians converge


def test_the_covariance_of_a_fix_is_long_along_its_bearing():
    shape = FixShape(300.0, 20.0, 30.0)
    xx, xy, yy = shape.cov
    along = np.array([math.sin(math.radians(30)), math.cos(math.radians(30))])
    S = np.array([[xx, xy], [xy, yy]])
    np.testing.assert_allclose(S @ along, 300.0**2 * along)
    np.testing.assert_allclose(np.linalg.eigvalsh(S), [20.0**2, 300.0**2])
    np.testing.assert_allclose(S, laws.fix_error({"along": 300.0, "across": 20.0, "bearing": 30.0}, 1.0))


@pytest.mark.parametrize(
    ("corners", "fix", "words"),
    [
        (EVEN, {"along": 90, "across": 9}, "landmark 1 is about as long as wide"),
        (COAST, {}, "fix is {}; expected {sd: M}"),
        (COAST, 5, "fix is 5; expected {sd: M}"),
        (COAST, "5 m", "fix is '5 m'; expected {sd: M}"),
        (COAST, {"sd": 5, "range": 3}, "expected {sd: M}"),
        (COAST, {"across": 5}, "give along and across, or sd for one of them"),
        (COAST, {"sd": 5, "across": 5, "along": 7}, "give along and across, or sd for one of them"),
        (COAST, {"bearing": 5}, "give along and across, or sd for one of them"),
        (COAST, {"sd": 0}, "fix: sd is 0; expected a number of metres, above 0 and at most 1e+06"),
        (COAST, {"sd": "5 steps"}, "fix: sd is '5 steps'; expected a number of metres"),
        (COAST, {"sd": True}, "fix: sd is True; expected a number of metres"),
        (COAST, {"sd": 2e6}, "fix: sd is 2000000.0; expected a number of metres"),
        (COAST, {"along": 9, "across": 5, "bearing": 900}, "expected a number of degrees from -360 to 360"),
    ],
)
def test_an_error_of_fixes_that_cannot_be_used_is_refused_in_one_line(tmp_path, corners, fix, words):
    with pytest.raises(DataError) as error:
        scene_of(tmp_path, START, GOAL, feature("landmark", [corners], fix=fix))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_landmarks_of_the_settings_have_errors_of_fixes():
    strip = [[1, 1], [9, 1], [9, 2], [1, 2]]
    keys = {"bounds": [[0, 0], [20, 20]], "start": [5, 5], "regions": {"a": [[12, 12], [14, 12], [13, 14]]}}
    marks = [{"corners": strip, "fix": {"along": 5, "across": 1}}, [[15, 1], [17, 1], [16, 3]]]
    scene = scene_from_settings(SceneConfig(unit=1000.0, landmarks=marks, **keys), None, "open")
    assert scene.landmark_fixes == (FixShape(5.0, 1.0, 90.0), None)
    for wrong in ({"corners": strip, "sd": 5}, {"fix": {"sd": 5}}):
        with pytest.raises(
            DataError, match=r"landmark 1 has the keys .*; expected corners, and fix if need be"
        ):
            scene_from_settings(SceneConfig(landmarks=[wrong], **keys), None, "open")


def test_an_exported_landmark_keeps_the_error_of_its_fixes(tmp_path):
    frame, fix = feature("border", [square(2.6, 60.3, 3.0)]), {"along": 500, "across": 50, "bearing": 40}
    marks = [feature("landmark", [COAST], fix=own) for own in (fix, {"sd": 70}, None)]
    scene = scene_of(tmp_path, START, GOAL, frame, *marks)
    found = [true_fix(scene, number) for number in (1, 2, 3)]
    assert found[0]["fix"] == pytest.approx(fix, abs=0.1)
    assert found[1:] == [{"fix": {"sd": 70.0}}, {}]
