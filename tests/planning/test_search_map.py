"""The map on which lines are searched: what stands for many corners covers them, or lies within."""

from __future__ import annotations

import logging

import numpy as np
import pytest
import shapely

from large_maps import SIDE, rough_disc
from pareto_ltl.planning.routes.search_map import MANY_CORNERS, MAP_SHARE, search_map
from problems import KM, box, make_problem, make_scene, two_goals


def disc(corners, east, north, radius, roughness=0.0, seed=0):
    return rough_disc(corners, east, north, radius, roughness, seed)


def union(polygons):
    return shapely.union_all([shapely.Polygon(p) for p in polygons])


def corner_count(polygons):
    return sum(map(len, polygons))


@pytest.fixture(scope="module", params=[0.0, 0.02], ids=["round", "rough"])
def detailed(request):
    """A region and an obstacle of 2,000 corners, and a region of four."""
    regions = {"a": disc(2000, 15, 15, 2, request.param), "b": box(2, 15, 4, 17)}
    scene = make_scene(regions, [disc(2000, 9, 9, 3, request.param, seed=1), box(13, 3, 15, 5)], side=SIDE)
    return make_problem("!a U b", scene)


def test_a_map_with_few_corners_is_left_as_it_is(caplog):
    problem = two_goals()
    with caplog.at_level(logging.INFO):
        found = search_map(problem)
    assert found.obstacles is problem.decomposition.obstacles
    assert found.barriers is problem.barriers
    for group in found.shown.values():
        cells = [problem.decomposition.cells[k] for k in group.cells]
        assert all(one is other for one, other in zip(group.within, cells, strict=True))
        assert group.around is group.within
        assert not group.united
    np.testing.assert_array_equal(found.witness.offset, problem.theorem2.faces.offset)
    assert not caplog.records


def test_the_map_is_made_once_and_a_note_tells_what_was_left_out(detailed, caplog):
    fresh = make_problem("!a U b", detailed.scene)
    with caplog.at_level(logging.INFO):
        assert search_map(fresh) is search_map(fresh)
    (record,) = caplog.records
    assert "corners instead of" in record.getMessage()
    assert "every check uses the true ones" in record.getMessage()


def test_two_thousand_corners_become_less_than_a_hundred(detailed):
    found = search_map(detailed)
    assert corner_count(found.obstacles) < 200  # of convex parts
    for group in found.shown.values():
        assert corner_count(group.within) < 200
        assert corner_count(group.around) < 200
    assert np.diff(found.witness.ptr).max() <= 2 * MANY_CORNERS


def test_obstacles_are_covered_by_little_more_than_themselves(detailed):
    scene, found = detailed.scene, union(search_map(detailed).obstacles)
    exact = union(scene.obstacles)
    assert shapely.buffer(found, 1e-6).covers(exact)
    assert shapely.buffer(exact, MAP_SHARE * SIDE * KM + 1e-6).covers(found)


def test_cells_lie_between_what_is_within_and_what_is_around(detailed):
    found = search_map(detailed)
    for label, group in found.shown.items():
        cells = union([detailed.decomposition.cells[k] for k in group.cells])
        assert {detailed.labels[k] for k in group.cells} == {label}
        assert shapely.buffer(cells, 1e-4).covers(union(group.within))
        assert shapely.buffer(union(group.around), 1e-4).covers(cells)
        assert union(group.around).area / union(group.within).area < 1.1
    numbers = np.concatenate([group.cells for group in found.shown.values()])
    assert sorted(numbers) == [k for k, label in enumerate(detailed.labels) if label]


def test_witness_polygons_lie_inside_the_parts_of_regions(detailed):
    exact, found = detailed.theorem2.faces, search_map(detailed).witness
    assert len(found.ptr) == len(exact.ptr)
    for part in range(len(exact.ptr) - 1):
        inner, outer = (slice(f.ptr[part], f.ptr[part + 1]) for f in (found, exact))
        corners = half_plane_corners(found.normal[inner], found.offset[inner])
        assert (corners @ exact.normal[outer].T <= exact.offset[outer] + 1e-6).all()


def half_plane_corners(normal, offset):
    """Where neighbouring faces of a convex polygon meet."""
    pair = np.stack([normal, np.roll(normal, -1, axis=0)], axis=1)
    ends = np.stack([offset, np.roll(offset, -1)], axis=1)
    return np.linalg.solve(pair, ends[..., None])[..., 0]


@pytest.mark.parametrize("gap", [0.2, 0.05, 0.01])
def test_a_gap_between_obstacles_stays_open(gap):
    """Kilometres; the tolerance alone is 40 m."""
    obstacles = [disc(500, 7, 10, 3), disc(500, 13 + gap, 10, 3)]
    problem = make_problem("F a", make_scene({"a": box(9, 15, 11, 17)}, obstacles, side=SIDE))
    left = union(p for p in search_map(problem).obstacles if p[:, 0].max() < 10.1 * KM)
    right = union(p for p in search_map(problem).obstacles if p[:, 0].min() > 9.9 * KM)
    assert shapely.distance(left, right) >= 0.4 * gap * KM


def test_outlines_that_touch_do_not_stop_each_other_from_being_simplified():
    regions = {"a": disc(500, 13, 10, 3.0)}
    scene = make_scene(regions, [disc(500, 7, 10, 3.0), box(18, 18, 19, 19)], side=SIDE)
    assert corner_count(search_map(make_problem("F a", scene)).obstacles) < 100


def test_a_region_inside_another_leaves_a_hole_in_it():
    """The cells that show a alone surround b; lines to them must not end in b."""
    regions = {"a": disc(600, 10, 10, 4), "b": disc(600, 10, 10, 2)}
    problem = make_problem("F (a & !b)", make_scene(regions, side=SIDE))
    shown = search_map(problem).shown
    only_a = shown[frozenset("a")]
    assert only_a.united
    assert union(only_a.within).intersection(shapely.Polygon(regions["b"])).area == pytest.approx(0, abs=1.0)
    assert (
        shapely.buffer(union(shown[frozenset("ab")].within), -1)
        .difference(shapely.Polygon(regions["b"]))
        .is_empty
    )
