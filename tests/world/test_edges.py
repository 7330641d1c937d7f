"""Edges straight in longitude and latitude, the seam of longitudes, and outlines that touch themselves."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

import pareto_ltl
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.scene_sketch import Place
from pareto_ltl_apps.formats.map_edges import BEND, unwrapped


def box(west, south, east, north):
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


def feature(role, kind, coordinates, **properties):
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"role": role, **properties}, "geometry": geometry}


def read(tmp_path, start, goal, *obstacles):
    features = [feature("start", "Point", start), feature("region", "Polygon", [goal], name="a")]
    features += [feature("obstacle", "Polygon", rings, name=f"zone {k}") for k, rings in enumerate(obstacles)]
    path = tmp_path / "m.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return pareto_ltl.read_map(path)


def closed(scene, *places):
    area = shapely.union_all([shapely.Polygon(outline) for outline in scene.obstacles])
    points = scene.frame.to_plane(*np.array(places, float).T)
    return shapely.contains_xy(area, *points.T).tolist()


def dense(ring, n=400):
    ring, share = np.array(ring, float), np.linspace(0, 1, n, endpoint=False)[:, None]
    return np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(ring)])


# --- edges ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lat", [60.0, -60.0, 5.0])
def test_a_zone_along_a_parallel_is_closed_to_its_edge(tmp_path, lat):
    zone = box(5, lat, 23, lat + 2)
    scene = read(tmp_path, [14, lat - 1], box(13.8, lat - 0.5, 14.2, lat - 0.4), [zone])
    truth = shapely.Polygon(scene.frame.to_plane(*dense(zone).T))
    limit = BEND * float(np.ptp(scene.bounds, axis=0).max())
    found = shapely.union_all([shapely.Polygon(outline) for outline in scene.obstacles])
    assert shapely.hausdorff_distance(truth, found) < 1.05 * limit
    with pytest.raises(DataError, match="overlaps region 'a'"):
        read(tmp_path, [14, lat - 1], box(13.8, lat + 0.03, 14.2, lat + 0.15), [zone])


@settings(max_examples=40, deadline=None)
@given(st.floats(-70, 70), st.floats(0.2, 12), st.floats(0.2, 3), st.floats(0, 1), st.floats(0.05, 0.5))
def test_places_with_a_common_edge_touch_and_do_not_overlap(tmp_path_factory, south, wide, high, at, part):
    """A zone, and regions at each of its four sides, each along a part of the side."""
    folder = tmp_path_factory.mktemp("map")
    north, east = south + high, 10 + wide
    west = 10 + at * (1 - part) * wide
    low = south + at * (1 - part) * high
    beside = [
        box(west, north, west + part * wide, north + 0.1),
        box(west, south - 0.1, west + part * wide, south),
        box(east, low, east + 0.1, low + part * high),
        box(9.9, low, 10, low + part * high),
    ]
    for goal in beside:
        scene = read(folder, [9.5, south - 0.5], goal, [box(10, south, east, north)])
        zone = shapely.union_all([shapely.Polygon(outline) for outline in scene.obstacles])
        (region,) = scene.regions["a"]
        assert shapely.area(shapely.intersection(zone, shapely.Polygon(region))) < 1.0
        assert shapely.distance(zone, shapely.Polygon(region)) < 1e-3


# --- longitudes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("turn", [0, 0.0, 360, -360])
@pytest.mark.parametrize("middle", [0.0, 180.0, -180.0, 90.0])
def test_longitudes_may_be_written_from_0_to_360_or_across_the_seam(tmp_path, middle, turn):
    def lon(offset, whole):
        value = middle + offset
        return value % 360 if whole else (value + 180) % 360 - 180

    for whole in (True, False):
        zone = [[lon(x, whole), y] for x, y in box(-0.2, 50.9, 0.2, 51.2)]
        goal = [[lon(x, not whole), y] for x, y in box(0.8, 51.0, 1.0, 51.2)]
        scene = read(tmp_path, [lon(-0.8, whole), 51.0], goal, [zone])
        assert closed(scene, [middle + turn, 51.0], [middle + 0.5, 51.0]) == [True, False]
        assert np.ptp(scene.bounds[:, 0]) == pytest.approx(1.14 * 1.8 * 70_000, rel=0.01)


@given(
    st.lists(st.tuples(st.floats(-180, 180), st.floats(0, 30)), min_size=1, max_size=5), st.integers(-1, 1)
)
@example([(179.99999999999997, 0.0)], 0)
def test_the_seam_lies_in_the_widest_gap(arcs, turns):
    places = [Place("x", "x", ((np.array([[w, 0.0], [w + d, 0.0], [w + d, 1.0]]),),)) for w, d in arcs]
    found = unwrapped(places)
    lon = np.concatenate([place.corners[:, 0] for place in found])
    ends = np.sort(np.array([place.corners[:, 0] for place in found])[:, [0, 1]], axis=0)
    cover = np.zeros(720, bool)
    for w, d in arcs:
        cover[np.floor(np.arange(2 * (w + 180), 2 * (w + 180 + d) + 1)).astype(int) % 720] = True
    gaps, run = 0, 0
    for free in np.tile(~cover, 2):
        run = run + 1 if free else 0
        gaps = max(gaps, run)
    assert np.ptp(lon) <= 360 - gaps / 2 + 1.5
    assert -180 - 1e-9 <= (lon.min() + lon.max()) / 2 < 180  # within rounding
    assert np.isfinite(ends).all()
    shifted = unwrapped([place.moved(lambda c: c + np.array([360.0 * turns, 0.0])) for place in places])
    np.testing.assert_allclose(np.concatenate([p.corners for p in shifted])[:, 0], lon, atol=1e-9)


# --- outlines that touch themselves -----------------------------------------------------------------------

SQUARE = box(10, 60.4, 10.3, 60.5)
SPIKE = [[10, 60.4], [10.3, 60.4], [10.3, 60.5], [10.4, 60.55], [10.3, 60.5], [10, 60.5], [10, 60.4]]
KEYHOLE = [
    [10, 60.4], [10.3, 60.4], [10.3, 60.55], [10, 60.55], [10, 60.47], [10.1, 60.47], [10.1, 60.5],
    [10.2, 60.5], [10.2, 60.45], [10.1, 60.45], [10.1, 60.47], [10, 60.47], [10, 60.4],
]  # fmt: skip
EIGHT = [[10, 60.4], [10.1, 60.45], [10.2, 60.4], [10.2, 60.5], [10.1, 60.45], [10, 60.5], [10, 60.4]]
HOLES = {
    "touches in a corner": ([10.0, 60.45], [10.1, 60.42], [10.1, 60.48]),
    "lies along an edge": ([10.0, 60.42], [10.1, 60.42], [10.1, 60.48], [10.0, 60.48]),
}


@pytest.mark.parametrize(
    ("rings", "inside", "outside"),
    [
        ([SPIKE], [[10.1, 60.45]], [[10.35, 60.53], [10.1, 60.52]]),
        ([SPIKE[::-1]], [[10.1, 60.45]], [[10.35, 60.53]]),
        ([KEYHOLE], [[10.05, 60.52], [10.25, 60.48]], [[10.15, 60.48]]),
        ([EIGHT], [[10.05, 60.45], [10.15, 60.45]], [[10.1, 60.42], [10.1, 60.48]]),
        *[([SQUARE, [*hole, hole[0]]], [[10.2, 60.45]], [[10.05, 60.45]]) for hole in HOLES.values()],
        ([SQUARE, box(10.1, 60.42, 10.15, 60.44), box(10.15, 60.42, 10.2, 60.44)], [[10.2, 60.46]],
         [[10.12, 60.43], [10.18, 60.43]]),
        ([[*SQUARE[:1], *SQUARE]], [[10.1, 60.45]], [[10.35, 60.45]]),
    ],
    ids=["spike", "spike, clockwise", "keyhole", "eight", *HOLES, "holes side by side", "corner twice"],
)  # fmt: skip
def test_an_outline_that_touches_itself_is_mended_if_its_area_is_not_in_doubt(
    tmp_path, rings, inside, outside
):
    scene = read(tmp_path, [10, 60], box(10.5, 60.2, 10.7, 60.3), rings)
    assert closed(scene, *inside) == [True] * len(inside)
    assert closed(scene, *outside) == [False] * len(outside)


@pytest.mark.parametrize(
    "rings",
    [
        [[[10, 60.4], [10.3, 60.5], [10.3, 60.4], [10, 60.5], [10, 60.4]]],
        [[*SQUARE, *SQUARE[1:]]],
        [SQUARE, box(10.1, 60.42, 10.2, 60.52)],
        [SQUARE, box(10.1, 60.42, 10.2, 60.44), box(10.15, 60.42, 10.25, 60.44)],
        [[*KEYHOLE[:5], *KEYHOLE[10:4:-1], *KEYHOLE[11:]]],
    ],
    ids=[
        "bow tie",
        "twice around",
        "hole across the outline",
        "holes across one another",
        "keyhole the other way",
    ],
)
def test_an_outline_whose_area_is_in_doubt_is_refused_with_the_place(tmp_path, rings):
    with pytest.raises(DataError, match=r"zone 0.* at \(longitude 10"):
        read(tmp_path, [10, 60], box(10.5, 60.2, 10.7, 60.3), rings)
