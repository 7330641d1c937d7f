"""Where points lie and what segments meet: half planes against shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pareto_ltl.kernels import geometry
from pareto_ltl.planning.problem import cell_tables, faces
from pareto_ltl.world import cells as workspace
from problems import KM, box, make_problem, make_scene, polygon_faces, two_goals
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
    return decomposition, cell_tables(scene.bounds, decomposition, sorted(scene.regions))


def points_in(scene, rng, n):
    (west, south), (east, north) = scene.bounds
    return rng.uniform([west, south], [east, north], (n, 2))


# --- slack and locate ---------------------------------------------------------------------------------


@some
@given(convex_polygons(), seeds)
def test_slack_is_the_distance_to_the_nearest_face_line(polygon, seed):
    points = np.random.default_rng(seed).uniform(-300, 1300, (20, 2))
    ring = faces([polygon])
    found = [geometry.slack(ring, 0, x, y) for x, y in points]
    np.testing.assert_allclose(found, workspace.inside_depth(polygon, points), atol=1e-8)
    inside = shapely.contains_xy(shapely.Polygon(polygon), points)
    depth = shapely.distance(shapely.Polygon(polygon).exterior, shapely.points(points))
    np.testing.assert_allclose(np.array(found)[inside], depth[inside], atol=1e-8)


@some
@given(st.one_of(scenes(), lattice_scenes()), seeds)
def test_points_of_free_space_are_found_in_a_cell_that_holds_them(scene, seed):
    decomposition, cells = tables(scene)
    points = points_in(scene, np.random.default_rng(seed), 60)
    found = geometry.locate_many(cells, points)
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
    blocked = geometry.locate_many(cells, points)
    expected = workspace.locate_cells(decomposition, points)
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


# --- the faces an obstacle is cleared by --------------------------------------------------------------


@some
@given(seeds, st.floats(-1.0, 4.0))
def test_a_face_is_cleared_where_it_is_z_standard_deviations_away(problem, seed, z):
    rng = np.random.default_rng(seed)
    obstacles = problem.tables.obstacles
    x = rng.uniform(0, 20 * KM, 2)
    root = rng.normal(0, 500, (2, 2))
    cov = root @ root.T
    masks = np.zeros((1, len(obstacles.ptr) - 1), np.int64)
    ok = geometry.clear_faces(obstacles, z, *x, cov[0, 0], cov[0, 1], cov[1, 1], masks, 0)
    expected = []
    for normals, offsets in polygon_faces(obstacles):
        gap = normals @ x - offsets
        sd = np.sqrt(np.einsum("ij,jk,ik->i", normals, cov, normals))
        assume(np.abs(gap - z * sd).min() > 1e-6)
        assume(np.abs(gap).min() > 1e-6)
        clear = gap >= z * sd
        if z >= 0:
            clear &= gap >= 0
        expected.append(sum(1 << k for k in np.flatnonzero(clear)))
    assert ok == all(expected)
    if ok:
        np.testing.assert_array_equal(masks[0], expected)


def test_the_31st_face_has_its_own_bit():
    angle = 2 * np.pi * np.arange(32) / 32
    ring = faces([100 * np.stack([np.cos(angle), np.sin(angle)], axis=1)])
    masks = np.zeros((1, 1), np.int64)
    normal = ring.normal[31]
    assert geometry.clear_faces(ring, 0.0, *(101 * normal), 0.0, 0.0, 0.0, masks, 0)
    assert masks[0, 0] & (1 << 31)
    assert not masks[0, 0] & (1 << 15)  # the opposite face


# --- segments ---------------------------------------------------------------------------------------


@many
@given(st.lists(nodes, min_size=3, max_size=7), nodes, nodes)
def test_a_segment_hits_exactly_where_it_meets_the_interior(corners, p, q):
    hull = shapely.MultiPoint(corners).convex_hull
    assume(hull.geom_type == "Polygon")
    polygon = shapely.get_coordinates(shapely.orient_polygons(hull).exterior)[:-1]
    line = shapely.Point(p) if p == q else shapely.LineString([p, q])
    expected = bool(shapely.relate_pattern(line, hull, "T********"))
    ring = faces([polygon])
    assert geometry.hits(ring, 0, *map(float, p), *map(float, q)) == expected
    assert geometry.hits(ring, 0, *map(float, q), *map(float, p)) == expected


@many
@given(convex_polygons(), seeds)
def test_segments_anywhere_agree_with_shapely(polygon, seed):
    rng = np.random.default_rng(seed)
    ring, shape = faces([polygon]), shapely.Polygon(polygon)
    less, more = shape.buffer(-1e-4), shape.buffer(1e-4)
    centre = polygon.mean(axis=0)
    for _ in range(10):
        p, q = centre + rng.uniform(-400, 400, (2, 2))
        line = shapely.LineString([p, q])
        hit = geometry.hits(ring, 0, *p, *q)
        assert hit or not shapely.intersects(line, less)
        assert not hit or shapely.intersects(line, more)


def test_sliding_along_a_face_and_touching_a_corner_is_no_hit():
    ring = faces([box(0, 0, 1, 1)])
    assert not geometry.hits(ring, 0, -KM, 0.0, 2 * KM, 0.0)
    assert not geometry.hits(ring, 0, KM, -KM, KM, 3 * KM)
    assert not geometry.hits(ring, 0, -KM, KM, KM, 3 * KM)
    assert not geometry.hits(ring, 0, -KM, 0.5 * KM, 0.0, 0.5 * KM)
    assert geometry.hits(ring, 0, -KM, 0.5 * KM, 0.01, 0.5 * KM)
    assert geometry.hits(ring, 0, -KM, -KM, 2 * KM, 2 * KM)


def test_a_map_without_obstacles_stops_nothing():
    problem = make_problem("F a", make_scene({"a": box(10, 10, 12, 12)}))
    masks = np.zeros((1, 0), np.int64)
    assert geometry.clear_faces(problem.tables.obstacles, 3.0, 0.0, 0.0, 1.0, 0.0, 1.0, masks, 0)
