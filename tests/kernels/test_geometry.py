"""Where points lie and what segments meet: half planes against shapely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pareto_ltl.planning.pack import pack_barriers, pack_cells, pack_faces, pack_nearby
from pareto_ltl.world import cells as workspace
from plane_kernels import geometry
from plane_kernels.types import Point
from problems import KM, box, two_goals
from strategies import convex_polygons, lattice_scenes, scenes

some = settings(deadline=None, max_examples=25)
many = settings(deadline=None, max_examples=150)
seeds = st.integers(0, 2**32 - 1)
nodes = st.tuples(st.integers(-2, 10), st.integers(-2, 10))


@pytest.fixture(scope="module")
def problem():
    return two_goals()


def tables(scene):
    decomposition = workspace.decompose(scene)
    return decomposition, pack_cells(scene.bounds, decomposition)


def points_in(scene, rng, n):
    (west, south), (east, north) = scene.bounds
    return rng.uniform([west, south], [east, north], (n, 2))


# --- slack and locate ---------------------------------------------------------------------------------


@some
@given(convex_polygons(), seeds)
def test_slack_is_the_distance_to_the_nearest_face_line(polygon, seed):
    points = np.random.default_rng(seed).uniform(-300, 1300, (20, 2))
    ring = pack_faces([polygon])
    found = [geometry.face_slack(ring, 0, Point(x, y)) for x, y in points]
    np.testing.assert_allclose(found, workspace.inside_depth(polygon, points), atol=1e-8)
    inside = shapely.contains_xy(shapely.Polygon(polygon), points)
    depth = shapely.distance(shapely.Polygon(polygon).exterior, shapely.points(points))
    np.testing.assert_allclose(np.array(found)[inside], depth[inside], atol=1e-8)


@some
@given(st.one_of(scenes(), lattice_scenes()), seeds)
def test_points_of_free_space_are_found_in_a_cell_that_holds_them(scene, seed):
    decomposition, cells = tables(scene)
    points = points_in(scene, np.random.default_rng(seed), 60)
    found = geometry.locate_cells(cells, points)
    blocked = shapely.union_all([shapely.Polygon(o) for o in decomposition.obstacles])
    free = ~shapely.contains_xy(blocked, points)
    assert np.all(found[free] >= 0)
    for point, cell in zip(points[free], found[free], strict=True):
        assert shapely.distance(shapely.Polygon(decomposition.cells[cell]), shapely.Point(point)) < 1e-6
    if shapely.area(blocked) > 0:
        deep = shapely.contains_xy(shapely.buffer(blocked, -2.0), points)
        assert np.all(found[deep] == -1)


@some
@given(scenes(), seeds)
def test_both_roads_name_the_same_cell(scene, seed):
    decomposition, cells = tables(scene)
    points = points_in(scene, np.random.default_rng(seed), 60)
    rings = [*decomposition.cells, *decomposition.obstacles]
    edge = np.min([np.abs(workspace.inside_depth(ring, points)) for ring in rings], axis=0)
    clear = edge > 1e-5  # beside an edge the two roads may round differently
    blocked = geometry.locate_cells(cells, points)
    expected = workspace.cells_of_points(decomposition, points)
    shallow = (expected == -1) & (blocked >= 0)  # the kernel forgives a metre
    for point in points[shallow]:
        assert max(float(workspace.inside_depth(o, point[None])[0]) for o in decomposition.obstacles) < 1.0
    np.testing.assert_array_equal(blocked[clear & ~shallow], expected[clear & ~shallow])


def test_corners_edges_and_bounds_always_have_a_cell(problem):
    cells = problem.decomposition.cells
    corners = np.vstack(cells)
    middles = np.vstack([(c + np.roll(c, -1, axis=0)) / 2 for c in cells])
    found = problem.locate(np.vstack([corners, middles]))
    assert np.all(found >= 0)


def test_an_edge_of_a_region_belongs_to_the_region(problem):
    for name, parts in problem.decomposition.regions.items():
        for part in parts:
            edge = np.vstack([part + t * (np.roll(part, -1, axis=0) - part) for t in (0.0, 0.2, 0.5, 0.9)])
            assert all(name in problem.labels[cell] for cell in problem.locate(edge))


def test_off_the_map_and_deep_in_an_obstacle_there_is_no_cell(problem):
    (west, south), (east, north) = problem.scene.bounds
    outside = [[west - 1, south], [east + 1, north], [west, north + 1e-3], [np.inf, 0.0], [np.nan, np.nan]]
    assert np.all(problem.locate(np.array(outside)) == -1)
    centres = np.array([o.mean(axis=0) for o in problem.decomposition.obstacles])
    assert np.all(problem.locate(centres) == -1)


# --- segments ---------------------------------------------------------------------------------------


def hits(ring, start, end):
    """Whether a segment meets the interior of the first polygon."""
    return geometry.segment_hits(ring, 0, Point(*map(float, start)), Point(*map(float, end)))


@many
@given(st.lists(nodes, min_size=3, max_size=7), nodes, nodes)
def test_a_segment_hits_exactly_where_it_meets_the_interior(corners, p, q):
    hull = shapely.MultiPoint(corners).convex_hull
    assume(hull.geom_type == "Polygon")
    polygon = shapely.get_coordinates(shapely.orient_polygons(hull).exterior)[:-1]
    line = shapely.Point(p) if p == q else shapely.LineString([p, q])
    expected = bool(shapely.relate_pattern(line, hull, "T********"))
    ring = pack_faces([polygon])
    assert hits(ring, p, q) == expected
    assert hits(ring, q, p) == expected


@many
@given(convex_polygons(), seeds)
def test_segments_anywhere_agree_with_shapely(polygon, seed):
    rng = np.random.default_rng(seed)
    ring, shape = pack_faces([polygon]), shapely.Polygon(polygon)
    less, more = shape.buffer(-1e-4), shape.buffer(1e-4)
    centre = polygon.mean(axis=0)
    for _ in range(10):
        p, q = centre + rng.uniform(-400, 400, (2, 2))
        line = shapely.LineString([p, q])
        hit = hits(ring, p, q)
        assert hit or not shapely.intersects(line, less)
        assert not hit or shapely.intersects(line, more)


def test_sliding_along_a_face_and_touching_a_corner_is_no_hit():
    ring = pack_faces([box(0, 0, 1, 1)])
    assert not hits(ring, (-KM, 0.0), (2 * KM, 0.0))
    assert not hits(ring, (KM, -KM), (KM, 3 * KM))
    assert not hits(ring, (-KM, KM), (KM, 3 * KM))
    assert not hits(ring, (-KM, 0.5 * KM), (0.0, 0.5 * KM))
    assert hits(ring, (-KM, 0.5 * KM), (0.01, 0.5 * KM))
    assert hits(ring, (-KM, -KM), (2 * KM, 2 * KM))


def test_a_map_without_obstacles_stops_nothing():
    none = pack_faces([])
    nearby = pack_nearby(none, np.array([[0.0, 0.0], [KM, KM]]))
    assert not geometry.segment_touches(none, nearby, Point(0.0, 0.0), Point(KM, KM))


@some
@given(scenes(), seeds)
def test_many_points_and_segments_are_answered_as_one_by_one(scene, seed):
    decomposition, cells = tables(scene)
    obstacles = pack_faces(decomposition.obstacles)
    nearby = pack_nearby(pack_barriers(replace(scene, border="wall"), obstacles), scene.bounds)
    segments = np.random.default_rng(seed).uniform(-100, 1100, (30, 4))
    touched = geometry.segments_touch(obstacles, segments)
    found = geometry.locate_cells(cells, np.ascontiguousarray(segments[:, :2]))
    for i, s in enumerate(segments):
        assert touched[i] == geometry.segment_touches(obstacles, nearby, Point(*s[:2]), Point(*s[2:]))
        assert touched[i] == any(hits_part(obstacles, j, s) for j in range(len(decomposition.obstacles)))
        assert found[i] == geometry.locate_cell(cells, Point(*s[:2]))


def hits_part(obstacles, j, s):
    """Whether a segment (x0, y0, x1, y1) meets obstacle ``j``."""
    return geometry.segment_hits(obstacles, j, Point(*s[:2]), Point(*s[2:]))
