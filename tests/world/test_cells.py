"""Cells tile the free space; doors, labels and point location agree with shapely."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.world import cells as workspace
from pareto_ltl.world import polygons as convex
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_settings import scene_from_settings
from strategies import convex_polygons, lattice_scenes, scenes, star_polygons

SCENES = Path(__file__).parents[2] / "conf" / "scene"
every_map = st.one_of(scenes(), lattice_scenes())
seeds = st.integers(0, 2**32 - 1)
some = settings(deadline=None, max_examples=30)


def shipped(name):
    return scene_from_settings(SceneConfig(**yaml.safe_load((SCENES / f"{name}.yaml").read_text())))


def box(west, south, east, north):
    return np.array([[west, south], [east, south], [east, north], [west, north]], float)


def room(obstacles=(), side=10.0, start=(0.5, 0.5), **regions):
    bounds = np.array([[0.0, 0.0], [side, side]])
    return Scene(bounds=bounds, start=np.array(start), regions=regions, obstacles=tuple(obstacles))


def polygons(parts):
    return [shapely.Polygon(p) for p in parts]


def free_space(scene):
    return shapely.box(*scene.bounds.ravel()) - shapely.union_all(polygons(scene.obstacles))


def size(scene):
    return float(np.ptp(scene.bounds, axis=0).max())


def contact(one, other, tolerance):
    """Length of the common edges of two convex polygons, to ``tolerance`` of distance, by clipping lines."""
    total = 0.0
    for a, b in zip(one, np.roll(one, -1, 0), strict=True):
        for c, d in zip(other, np.roll(other, -1, 0), strict=True):
            along = (b - a) / np.linalg.norm(b - a)
            normal = np.array([-along[1], along[0]])
            (s, t), off = (np.array([c, d]) - a) @ along, np.abs((np.array([c, d]) - a) @ normal)
            if along @ (d - c) < 0 and off.max() < tolerance:
                total += max(0.0, min(np.linalg.norm(b - a), s) - max(0.0, t))
    return total


def is_convex(polygon):
    edge = np.roll(polygon, -1, 0) - polygon
    after = np.roll(edge, -1, 0)
    winding = np.sum(
        np.arctan2(edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0], np.sum(edge * after, axis=1))
    )
    return np.all(edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0] > 0) and np.isclose(winding, 2 * np.pi)


# --- cells ---------------------------------------------------------------------------------------


@given(every_map)
@some
def test_cells_tile_the_free_space(scene):
    cells = polygons(workspace.decompose(scene).cells)
    free = free_space(scene)
    allowed = 1e-9 * size(scene) ** 2
    assert sum(c.area for c in cells) == pytest.approx(
        free.area, abs=allowed
    )  # with the next line: no overlap
    assert shapely.union_all(cells).symmetric_difference(free).area <= allowed


@given(every_map)
@some
def test_interiors_of_cells_are_disjoint(scene):
    cells = polygons(workspace.decompose(scene).cells)
    tree = shapely.STRtree(cells)
    for i, j in zip(*tree.query(cells, predicate="intersects"), strict=True):
        assert i >= j or cells[i].intersection(cells[j]).area <= 1e-10 * size(scene) ** 2


@given(every_map)
@some
def test_every_part_is_convex_and_counter_clockwise(scene):
    made = workspace.decompose(scene)
    for part in (*made.cells, *made.obstacles, *(p for parts in made.regions.values() for p in parts)):
        assert is_convex(part)


@given(every_map)
@some
def test_doors_are_the_pairs_of_cells_with_a_common_edge(scene):
    made = workspace.decompose(scene)
    doors = {tuple(pair) for pair in made.doors.tolist()}
    assert len(doors) == len(made.doors)
    for i in range(len(made.cells)):
        for j in range(i + 1, len(made.cells)):
            length = contact(made.cells[i], made.cells[j], 1e-9 * size(scene))
            if length > 1e-6 * size(scene):
                assert (i, j) in doors
            elif length == 0:
                assert (i, j) not in doors


@given(every_map, seeds)
@some
def test_labels_say_which_regions_hold_a_point(scene, seed):
    made = workspace.decompose(scene)
    points = np.random.default_rng(seed).uniform(*scene.bounds, (50, 2))
    places = {name: shapely.Polygon(*corners) for name, corners in scene.regions.items()}
    outlines = [shapely.Polygon(p).exterior for p in (*scene.obstacles, *scene.region_outlines)]
    for point, cell in zip(shapely.points(points), workspace.cells_of_points(made, points), strict=True):
        if shapely.union_all(outlines).distance(point) > 1e-9 * size(scene):
            assert (cell >= 0) == free_space(scene).contains(point)
            if cell >= 0:
                assert made.labels[cell] == {n for n, place in places.items() if place.contains(point)}


@given(every_map)
@some
def test_cells_with_more_labels_come_first(scene):
    counts = [len(label) for label in workspace.decompose(scene).labels]
    assert counts == sorted(counts, reverse=True)


@given(every_map)
@settings(deadline=None, max_examples=20)
def test_the_same_map_gives_the_same_cells(scene):
    one, two = workspace.decompose(scene), workspace.decompose(scene)
    assert [c.tolist() for c in one.cells] == [c.tolist() for c in two.cells]
    assert one.labels == two.labels
    assert one.doors.tolist() == two.doors.tolist()


@given(scenes(), st.floats(-1e7, 1e7), st.floats(1e-3, 1e6))
@settings(deadline=None, max_examples=20)
def test_tiling_does_not_depend_on_where_and_how_large_the_map_is(scene, shift, factor):
    def moved(corners):
        return corners * factor + shift

    far = Scene(
        moved(scene.bounds),
        moved(scene.start),
        {n: moved(*p) for n, p in scene.regions.items()},
        tuple(moved(p) for p in scene.obstacles),
    )
    made = workspace.decompose(far)
    rounding = np.spacing(np.abs(far.bounds).max()) / size(far)
    cells = [p - far.bounds[0] for p in made.cells]
    free = free_space(scene).area * factor**2
    assert sum(c.area for c in polygons(cells)) == pytest.approx(
        free, abs=(1e-9 + 1e3 * rounding) * size(far) ** 2
    )


@pytest.mark.parametrize(("name", "most"), [("phi1", 30), ("phi2", 38)])
def test_the_shipped_maps_need_few_cells(name, most):
    made = workspace.decompose(shipped(name))
    assert len(made.cells) <= most
    assert {frozenset({n}) for n in shipped(name).regions} | {frozenset()} == set(made.letters)


@pytest.mark.parametrize("name", ["phi1", "phi2"])
def test_the_shipped_maps_are_tiled_exactly(name):
    scene = shipped(name)
    made = workspace.decompose(scene)
    areas = [p.area for p in polygons((*made.cells, *made.obstacles))]
    assert sum(areas) == pytest.approx(1e12, rel=1e-12)
    assert workspace.unreachable_regions(made, scene, scene.regions) == ()


def test_overlapping_regions_give_a_cell_with_both_labels():
    made = workspace.decompose(room(a=box(2, 2, 6, 6), b=box(4, 4, 8, 8)))
    assert made.labels[0] == {"a", "b"}
    np.testing.assert_array_equal(sorted(made.cells[0].tolist()), sorted(box(4, 4, 6, 6).tolist()))
    assert set(made.letters) == {frozenset(), frozenset("a"), frozenset("b"), frozenset("ab")}


def test_a_region_within_a_region_is_cut_out_of_it():
    made = workspace.decompose(room(a=box(2, 2, 8, 8), b=box(4, 4, 6, 6)))
    area = dict.fromkeys(made.letters, 0.0)
    for cell, label in zip(polygons(made.cells), made.labels, strict=True):
        area[label] += cell.area
    assert area == {frozenset(): 64.0, frozenset("a"): 32.0, frozenset("ab"): 4.0}


def test_an_enclosed_pocket_has_cells_but_no_door_out():
    ring = [box(3, 3, 7, 4), box(3, 6, 7, 7), box(3, 4, 4, 6), box(6, 4, 7, 6)]
    scene = room(ring, a=box(4.5, 4.5, 5.5, 5.5), b=box(8, 8, 9, 9))
    made = workspace.decompose(scene)
    assert workspace.cells_of_points(made, np.array([[5.0, 5.0]]))[0] >= 0
    assert workspace.unreachable_regions(made, scene, ["a", "b"]) == ("a",)


def test_corner_contact_is_no_door():
    scene = room([box(0, 5, 5, 10), box(5, 0, 10, 5)], start=(1, 1), a=box(6, 6, 7, 7))
    made = workspace.decompose(scene)
    assert workspace.unreachable_regions(made, scene, ["a"]) == ("a",)


@pytest.mark.parametrize("wall", [box(0, 4, 3, 6), box(0, 0, 3, 3), box(2, 0, 4, 10), box(4, 4, 6, 6)])
def test_obstacles_may_touch_the_bounds_and_a_region(wall):
    scene = room([wall], start=(9, 9), a=box(wall[1, 0], 4, wall[1, 0] + 2, 6))
    made = workspace.decompose(scene)
    assert sum(c.area for c in polygons(made.cells)) == 100 - shapely.Polygon(wall).area
    assert frozenset("a") in made.letters


def test_a_map_without_obstacles_and_one_region_over_everything_is_one_cell():
    made = workspace.decompose(room(a=box(0, 0, 10, 10)))
    assert (len(made.cells), made.labels, made.doors.shape) == (1, (frozenset("a"),), (0, 2))


def test_obstacles_over_the_whole_map_are_refused():
    with pytest.raises(DataError, match="no free space is left"):
        workspace.decompose(room([box(0, 0, 6, 10), box(5, 0, 10, 10)]))


# --- convex parts --------------------------------------------------------------------------------


@given(star_polygons(centre=(500, 500), most=450, corners=24))
@some
def test_parts_of_an_outline_tile_it(corners):
    made = workspace.decompose(room([corners], side=1000.0, a=corners))
    for parts in (made.obstacles, made.regions["a"]):
        assert sum(p.area for p in polygons(parts)) == pytest.approx(shapely.Polygon(corners).area, rel=1e-9)
        assert shapely.union_all(polygons(parts)).symmetric_difference(shapely.Polygon(corners)).area < 1e-5


@given(convex_polygons(centre=(500, 500), most=450, corners=150))
@some
def test_a_convex_obstacle_stays_whole(corners):
    made = workspace.decompose(room([corners], side=1000.0, a=box(0, 0, 1, 1)))
    assert [len(p) for p in made.obstacles] == [len(corners)]
    assert polygons(made.obstacles)[0].area == pytest.approx(shapely.Polygon(corners).area, rel=1e-9)


def test_an_obstacle_within_another_is_dropped_and_overlapping_ones_stay():
    walls = [box(2, 2, 6, 6), box(3, 3, 5, 5), box(5, 5, 8, 8), box(2, 2, 6, 6)]
    made = workspace.decompose(room(walls, a=box(8, 0, 9, 1)))
    assert sorted(p.area for p in polygons(made.obstacles)) == [9.0, 16.0]


@given(lattice_scenes(obstacles=8, regions=1))
@some
def test_triangles_use_every_node_of_an_outline_and_fill_it(scene):
    for face in shapely.orient_polygons(shapely.get_parts(free_space(scene))):
        rings = [
            shapely.get_coordinates(r)[:-1].astype(int).tolist() for r in (face.exterior, *face.interiors)
        ]
        rings = [[tuple(node) for node in ring] for ring in rings]
        if not np.array_equal(
            shapely.get_coordinates(face) % 1, np.zeros_like(shapely.get_coordinates(face))
        ):
            continue  # outlines that cross between lattice points
        found = convex.triangulate(shapely.Polygon(rings[0], rings[1:]), int)
        assert all(convex.signed_turn(*t) > 0 for t in found)
        assert sum(convex.signed_turn(*t) for t in found) == 2 * face.area
        sides = {edge for t in found for edge in convex.ring_edges(t)}
        assert {edge for ring in rings for edge in convex.ring_edges(ring)} <= sides


def test_flat_corners_of_an_outline_and_a_hole_become_corners_of_triangles():
    outline = [(0, 0), (5, 0), (10, 0), (10, 10), (0, 10)]
    hole = [(2, 2), (2, 4), (3, 4), (4, 4), (4, 2)]
    assert len(convex.triangulate(shapely.Polygon(outline, [hole]), int)) == 5 + 5 + 2 - 2


def test_a_corner_made_of_short_edges_is_still_a_corner():
    far = 10**9  # steps; the reflex corner (far, far) is drawn with two edges of one step
    outline = [
        (0, 0),
        (2 * far, 0),
        (2 * far, far),
        (far + 1, far),
        (far, far),
        (far, far + 1),
        (far, 2 * far),
        (0, 2 * far),
    ]
    parts = convex.convex_parts(outline)
    assert len(parts) > 1
    assert sum(shapely.Polygon(convex.drop_flat(p)).area for p in parts) == 3 * far**2


def test_a_bend_of_one_step_in_a_long_edge_is_none():
    far = 10**9
    outline = [(0, 0), (far, 1), (2 * far, 0), (2 * far, far), (0, far)]
    assert convex.convex_parts(outline) == [outline]
    assert convex.drop_flat(outline) == [(0, 0), (2 * far, 0), (2 * far, far), (0, far)]


def test_nearly_coincident_crossings_do_not_hide_a_corner():
    north = [0.001, 0.02]
    one = [north, [0, 0.01973205], [0, 0], [0.021, 0], [0.01832051, 0.01], [0.011, 0.01732051]]
    two = [north, [0, 0.01988835], [0, 0], [0.049, 0], [0.04256922, 0.01], [0.025, 0.01732051]]
    made = workspace.decompose(room(side=1.0, a=np.array(one), b=np.array(two)))
    assert sum(c.area for c in polygons(made.cells)) == pytest.approx(1, abs=1e-9)


def test_flat_corners_do_not_survive_in_a_part():
    square = [(0, 0), (2, 0), (2, 2), (0, 2)]
    assert convex.drop_flat([(0, 0), (1, 0), (2, 0), (2, 2), (1, 2), (0, 2), (0, 1)]) == square
    assert convex.drop_flat([(0, 0), (1, 0), (2, 0)]) == []


# --- points --------------------------------------------------------------------------------------


def edge_points(cells, rng):
    """Corners, middles and random points of all edges."""
    a = np.concatenate(cells)
    b = np.concatenate([np.roll(c, -1, 0) for c in cells])
    share = rng.uniform(size=(len(a), 1))
    return np.concatenate([a, (a + b) / 2, a + share * (b - a)])


@given(every_map, seeds)
@some
def test_every_point_on_an_edge_or_corner_has_a_cell_that_holds_it(scene, seed):
    made = workspace.decompose(scene)
    points = edge_points(made.cells, np.random.default_rng(seed))
    found = workspace.cells_of_points(made, points)
    assert np.all(found >= 0)
    cells = np.array(polygons(made.cells))[found]
    assert np.all(shapely.distance(cells, shapely.points(points)) <= 1e-9 * size(scene))


@given(every_map, seeds)
@some
def test_a_shared_edge_belongs_to_the_first_cell(scene, seed):
    made = workspace.decompose(scene)
    points = edge_points(made.cells, np.random.default_rng(seed))
    distances = shapely.distance(np.array(polygons(made.cells))[None], shapely.points(points)[:, None])
    first = np.argmax(distances <= 1e-14 * size(scene), axis=1)
    held = distances.min(axis=1) <= 1e-14 * size(scene)
    assert np.all(workspace.cells_of_points(made, points)[held] <= first[held])


def test_the_edge_of_a_region_belongs_to_the_region():
    made = workspace.decompose(room([box(6, 2, 8, 4)], a=box(2, 2, 6, 6)))
    rim = edge_points([box(2, 2, 6, 6)], np.random.default_rng(0))
    assert {made.labels[i] for i in workspace.cells_of_points(made, rim)} == {frozenset("a")}


def test_no_cell_outside_the_bounds_and_inside_an_obstacle():
    bent = np.array([[2, 2], [8, 2], [8, 8], [6, 8], [6, 4], [2, 4]], float)  # two parts with a seam
    made = workspace.decompose(room([bent], a=box(0, 8, 1, 9)))
    assert len(made.obstacles) == 2
    outside = [[-1, 5], [11, 5], [5, -0.1], [5, 10.1], [7, 3], [3, 3], [7, 7]]
    assert np.all(workspace.cells_of_points(made, np.array(outside, float)) == -1)
    line = shapely.Polygon(made.obstacles[0]).intersection(shapely.Polygon(made.obstacles[1]))
    on_seam = shapely.get_coordinates(line.interpolate([0.2, 0.5, 0.8], normalized=True))
    assert line.length > 0
    assert np.all(workspace.cells_of_points(made, on_seam) == -1)


@given(every_map, seeds)
@some
def test_buckets_list_every_cell_that_may_hold_a_point(scene, seed):
    made = workspace.decompose(scene)
    assume(all(shapely.Polygon(cell).area > 1e-6 for cell in made.cells))  # no slivers of one grid step
    ptr, index = workspace.bucket_cells(made, scene.bounds)
    rng = np.random.default_rng(seed)
    points = np.concatenate([edge_points(made.cells, rng), rng.uniform(*scene.bounds, (200, 2))])
    found = workspace.cells_of_points(made, points)
    side = (scene.bounds[1] - scene.bounds[0]) / 64
    column, row = np.clip(((points - scene.bounds[0]) / side).astype(int), 0, 63).T
    bucket = column * 64 + row
    for k, cell in zip(bucket[found >= 0], found[found >= 0], strict=True):
        candidates = index[ptr[k] : ptr[k + 1]]
        assert np.all(candidates[1:] >= 0)
        whole, candidates = candidates[0] < 0, np.where(candidates < 0, ~candidates, candidates)
        assert cell in candidates
        assert cell == candidates[0] or not whole
        assert np.all(np.diff(candidates) > 0)


def test_buckets_are_short():
    scene = shipped("phi2")
    ptr, index = workspace.bucket_cells(workspace.decompose(scene), scene.bounds)
    assert len(ptr) == 64 * 64 + 1
    assert len(index) < 1.5 * 64 * 64
    assert np.mean(index < 0) > 0.5  # most lie within one cell


@given(convex_polygons(), seeds)
@some
def test_half_planes_hold_exactly_the_points_inside(corners, seed):
    normals, offsets = workspace.half_planes(corners)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    points = np.random.default_rng(seed).uniform(-300, 1300, (100, 2))
    gap = (points @ normals.T - offsets).max(axis=1)
    inside = shapely.contains_xy(shapely.Polygon(corners), *points.T)
    assert np.array_equal(gap[np.abs(gap) > 1e-9] < 0, inside[np.abs(gap) > 1e-9])


# --- graph and mission ---------------------------------------------------------------------------


@given(every_map)
@some
def test_moments_are_area_and_centroid(scene):
    made = workspace.decompose(scene)
    for cell, polygon in zip(made.cells, polygons(made.cells), strict=True):
        area, centroid = workspace.moments(cell)
        assert area == pytest.approx(polygon.area, rel=1e-6)
        if polygon.area > 1e-6 * size(scene) ** 2:
            middle = shapely.get_coordinates(polygon.centroid)[0]
            np.testing.assert_allclose(centroid, middle, atol=1e-6 * size(scene))


def test_an_unknown_region_is_named_with_its_closest_match():
    scene = room(harbour=box(1, 1, 2, 2), depot=box(4, 4, 5, 5))
    made = workspace.decompose(scene)
    with pytest.raises(ConfigError, match=r"'harbor'.*it has depot, harbour: did you mean 'harbour'\?"):
        workspace.unreachable_regions(made, scene, ["depot", "harbor"])
    with pytest.raises(ConfigError, match=r"'zzz'.*rename it"):
        workspace.unreachable_regions(made, scene, ["zzz"])


def test_a_start_in_an_obstacle_is_refused_by_the_mission_check():
    scene = room([box(4, 4, 6, 6)], a=box(1, 1, 2, 2))
    made = workspace.decompose(scene)
    with pytest.raises(DataError, match="no free cell"):
        workspace.unreachable_regions(made, replace(scene, start=np.array([5.0, 5.0])), ["a"])


@pytest.mark.parametrize(("width", "parts"), [(1e-9, 1), (1e-3, 2)])
def test_a_spike_thinner_than_rounding_errors_is_no_part_of_an_obstacle(width, parts):
    spike = [[2.0, 4.0], [8.0, 4.0 + width / 2], [2.0, 4.0 + width]]
    made = workspace.decompose(room([np.array([[1, 3], [2, 3], *spike, [2, 5], [1, 5]])]))
    thin = np.array([spike[0], spike[1], [2.0, 4.0 + 1e-9]])
    assert sum(shapely.Polygon(part).area < 2.0 for part in made.obstacles) == parts - 1
    assert sum(shapely.Polygon(part).area for part in made.obstacles) == pytest.approx(2 + 3 * width)
    assert len(workspace.decompose(room([thin])).obstacles) == 1  # alone it is a wall


def test_a_point_that_rounding_put_outside_is_in_the_nearest_cell() -> None:
    side = 1e6
    map_ = workspace.decompose(room(side=side, a=(box(0.0, 0.0, side / 2, side),)))
    close = workspace.EDGE_FRACTION * side
    for off in (-50.0, -1.0, 0.0, 1.0, 50.0):
        west, east = [-off * close, side / 3], [side + off * close, side / 3]
        found = workspace.cells_of_points(map_, np.array([west, east]))
        assert map_.labels[found[0]] == {"a"}
        assert map_.labels[found[1]] == set()
    assert (
        workspace.cells_of_points(map_, np.array([[-200 * close, 1.0], [side + 200 * close, 1.0]])) == -1
    ).all()
