"""Taut lines against exact shortest ways, on small maps and on maps with many obstacles or corners."""

from __future__ import annotations

import itertools
import math
import tracemalloc

import numpy as np
import pytest
import shapely
from scipy.sparse.csgraph import dijkstra

from large_maps import MEGABYTE, SIDE, Waiting, many_discs, rough_disc
from pareto_ltl.planning.pack import pack_faces
from pareto_ltl.planning.routes.obligations import possible_orders
from pareto_ltl.planning.routes.taut_lines import gap_places, taut_line
from pareto_ltl.settings import RobotConfig
from problems import KM, box, make_problem, make_scene, paper_problem, polygon_faces, steady_wind

SHORT_STEPS = RobotConfig(dt=10.0, u_max=10.0)  # 100 m: they pass corners closely


def waiting(problem, deviations):
    """At the start, with standard deviations [m] step by step; the last one holds on."""
    variance = np.square(np.array(deviations, float))
    return Waiting(problem.scene.start[None], variance[:, None, None] * np.eye(2))


def two_region_problem(obstacles, formula="F(a & F b)", **options):
    regions = {"a": box(16, 16, 18, 18), "b": box(2, 15, 4, 17)}
    scene = make_scene(regions, obstacles, start=(1, 1), side=SIDE)
    return make_problem(formula, scene, steady_wind(scene, gust=(0.0, 0.0)), **options)


def length(line):
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def exact_length(stops, polygons, apart):
    """Length of the shortest way past convex polygons whose faces have moved outwards by ``apart`` [m].

    Dijkstra over all corners of the union that see each other: a second road to the same line.
    """
    wide = [shapely.buffer(shapely.Polygon(p), apart, join_style="mitre", mitre_limit=100) for p in polygons]
    blocked = shapely.union_all(wide)
    nodes = np.vstack([stops, shapely.get_coordinates(blocked)])
    i, j = np.triu_indices(len(nodes), 1)
    segments = shapely.linestrings(np.stack([nodes[i], nodes[j]], axis=1))
    hard = shapely.buffer(blocked, -1e-3)
    shapely.prepare(hard)
    seen = ~shapely.intersects(hard, segments)
    table = np.zeros((len(nodes), len(nodes)))
    table[i[seen], j[seen]] = np.linalg.norm(nodes[i[seen]] - nodes[j[seen]], axis=1)
    legs = dijkstra(table, directed=False, indices=np.arange(len(stops) - 1))
    return float(sum(legs[k, k + 1] for k in range(len(stops) - 1)))


def stops_of(problem, names):
    """The start and the middles of regions that are one cell."""
    return np.vstack([problem.scene.start, *(problem.scene.regions[n][0].mean(axis=0)[None] for n in names)])


def shortfall(problem, line, deviations, z):
    """How much [m] the line comes too near to an obstacle: 0 if every step has a face that both its ends
    keep z deviations from. Steps are made in still air."""
    n = [max(1, math.ceil(math.dist(p, q) / problem.reach)) for p, q in itertools.pairwise(line)]
    points = np.vstack([
        p + np.arange(k)[:, None] / k * (q - p) for k, p, q in zip(n, line, line[1:], strict=False)
    ] + [line[-1:]])  # fmt: skip
    flown = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    sd = np.interp(flown / problem.reach, np.arange(len(deviations)), deviations)
    worst = np.inf
    for normal, offset in polygon_faces(problem.barriers):
        room = points @ normal.T - offset - z * sd[:, None]
        worst = min(worst, np.minimum(room[:-1], room[1:]).max(axis=1).min())
    return max(0.0, -float(worst))


# --- small maps: the shortest way --------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("apart", [0.0, 150.0])
def test_a_line_is_as_short_as_an_exact_visibility_graph_allows(seed, apart):
    """With a distance that does not change on the way."""
    obstacles = many_discs(25, seed, (0.3, 0.9))
    problem = two_region_problem(obstacles, robot=SHORT_STEPS)
    (order,) = possible_orders(problem, 9)
    line = taut_line(problem, order, *waiting(problem, [apart]), 1.0, 1.0)
    exact = exact_length(stops_of(problem, "ab"), obstacles, apart)
    assert 1.0 <= length(line) / exact <= 1.002


@pytest.mark.parametrize("name", ["phi1", "phi2"])
@pytest.mark.parametrize("z", [1.0, 2.4])
def test_a_line_whose_distances_grow_is_between_one_without_and_one_with_the_largest(name, z):
    problem = paper_problem(name)
    growing = 300.0 * np.arange(70)
    for order in possible_orders(problem, 9):
        line = taut_line(problem, order, *waiting(problem, growing), 1.0, z)
        stops = stops_of(problem, ["".join(label) for label in order.labels])
        obstacles = problem.decomposition.obstacles
        low, high = (exact_length(stops, obstacles, apart) for apart in (0.0, z * growing.max()))
        assert length(line) / low >= 1.0
        assert length(line) / high <= 1.001
        assert shortfall(problem, line, growing, z) < 1.0


def test_corners_are_where_the_distance_on_arrival_puts_them():
    """Past one corner of one obstacle, with a deviation of 10 m a step."""
    obstacle = box(8, -1, 10, 10)
    problem = two_region_problem([obstacle], "F a", robot=RobotConfig(dt=100.0, u_max=10.0))
    (order,) = possible_orders(problem, 9)
    growing = 10.0 * np.arange(60)
    line = taut_line(problem, order, *waiting(problem, growing), 1.0, 2.0)
    assert shortfall(problem, line, growing, 2.0) < 0.1
    corner = line[1]
    keep = 2.0 * 10.0 * math.dist(line[0], corner) / problem.reach
    np.testing.assert_allclose(corner, np.array([8 * KM - keep, 10 * KM + keep]), atol=5.0)


def test_a_line_that_cannot_keep_its_distance_is_none():
    problem = two_region_problem([box(-1, 8, 10, 9), box(10.2, 8, 21, 9)], "F a")
    (order,) = possible_orders(problem, 9)
    assert taut_line(problem, order, *waiting(problem, [40.0]), 1.0, 2.0) is not None
    assert taut_line(problem, order, *waiting(problem, [60.0]), 1.0, 2.0) is None


def test_regions_visited_before_do_not_hide_those_that_come_next():
    """Each transition has walls of its own: b before a is a failure, after it is the goal."""
    regions = {"a": box(16, 9, 18, 11), "b": box(8, 6, 11, 14), "c": box(2, 15, 4, 17)}
    scene = make_scene(regions, [box(5, 2, 6, 3)], start=(1, 10), side=SIDE)
    problem = make_problem("(!b U a) & F (a & F (b & F c))", scene, steady_wind(scene, gust=(0.0, 0.0)))
    (order,) = possible_orders(problem, 9)
    assert [set(label) for label in order.labels] == [{"a"}, {"b"}, {"c"}]
    line = taut_line(problem, order, *waiting(problem, [0.0]), 1.0, 1.0)
    around = exact_length(stops_of(problem, "a"), [regions["b"]], 2.0)
    onwards = length(stops_of(problem, "abc")[1:])
    assert length(line) == pytest.approx(around + onwards, rel=1e-3)


# --- large maps --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def crowded():
    return two_region_problem(many_discs(300, 1, (0.15, 0.35)))


def traced(problem, path, depth, z):
    """A line past all obstacles, and the largest memory [MB] that its search took, kernels compiled."""
    taut_line(two_region_problem([box(5, 5, 6, 6)]), possible_orders(problem, 9)[0], *path, depth, z)
    tracemalloc.start()
    try:
        line = taut_line(problem, possible_orders(problem, 9)[0], *path, depth, z)
        return line, tracemalloc.get_traced_memory()[1] / MEGABYTE
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("deviation", "detour"), [(0.0, 1.005), (30.0, 1.02)])
def test_lines_past_300_obstacles_are_short_and_take_little_memory(crowded, deviation, detour):
    line, peak = traced(crowded, waiting(crowded, [deviation]), 1.0, 2.0)
    stops = stops_of(crowded, "ab")
    straight = length(stops)
    assert straight <= length(line) <= detour * straight
    assert shortfall(crowded, line, [deviation], 2.0) == 0.0
    assert peak < 50.0  # MB; all pairs of faces took 7 GB


def tangent_length(start, end, middle, radius):
    """Length of the shortest way around a disc: tangents, and the arc between them."""
    a, b = math.dist(start, middle), math.dist(end, middle)
    cosine = np.dot(start - middle, end - middle) / (a * b)
    arc = math.acos(cosine) - math.acos(radius / a) - math.acos(radius / b)
    return math.sqrt(a**2 - radius**2) + math.sqrt(b**2 - radius**2) + radius * arc


def test_a_line_around_2000_corners_is_that_around_a_disc():
    angle = 2 * np.pi * np.arange(2000) / 2000
    disc = (np.array([9.0, 9.2]) + 3 * np.column_stack([np.cos(angle), np.sin(angle)])) * KM
    problem = two_region_problem([disc], "F a", robot=SHORT_STEPS)
    line, peak = traced(problem, waiting(problem, [0.0]), 1.0, 1.0)
    exact = tangent_length(*stops_of(problem, "a"), disc.mean(axis=0), 3 * KM)
    assert 1.0 <= length(line) / exact <= 1.005
    assert not shapely.LineString(line).intersects(shapely.Polygon(disc))
    assert peak < 50.0


@pytest.mark.parametrize("depth", [0.0, 1.0])
def test_a_region_of_2000_corners_is_entered(depth):
    region = rough_disc()
    scene = make_scene({"a": region}, [box(5, 5, 8, 6)], side=SIDE)
    problem = make_problem("F a", scene, steady_wind(scene, gust=(0.0, 0.0)))
    line, peak = traced(problem, waiting(problem, [0.0]), depth, 1.0)
    polygon = shapely.Polygon(region)
    assert polygon.contains(shapely.Point(line[-1]))
    nearest = shapely.distance(polygon, shapely.Point(line[0]))
    assert length(line) <= nearest + (300.0 if depth == 0.0 else 3.5 * KM)
    assert peak < 50.0


def test_a_forbidden_region_of_2000_corners_is_not_crossed():
    region = rough_disc(east=10.0, north=9.0)
    scene = make_scene({"a": region, "b": box(16, 16, 18, 18)}, [box(5, 15, 6, 16)], side=SIDE)
    problem = make_problem("!a U b", scene, steady_wind(scene, gust=(0.0, 0.0)), robot=SHORT_STEPS)
    line, peak = traced(problem, waiting(problem, [0.0]), 1.0, 1.0)
    hull = shapely.convex_hull(shapely.Polygon(region))
    assert not shapely.LineString(line).intersects(shapely.Polygon(region))
    exact = exact_length(stops_of(problem, "b"), [shapely.get_coordinates(hull)[:-1]], 0.0)
    assert length(line) <= 1.005 * exact
    assert peak < 50.0


NEEDLE = np.array([[2e5, 1.05e4], [1e6, 1.05e4], [6e5, 1.05e4 + 2e-4]])  # no two faces differ by 1e-6 rad
ACUTE = np.array([[0.0, 3e3], [2e5, 3e3], [0.0, 4e3]])  # the place where it meets BLUNT is beyond its tip
BLUNT = np.array([[2.3e5, -1e4], [2.5e5, -1e4], [2.5e5, 1e4], [2.3e5, 1e4]])


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_gaps_of_slivers_and_needles_do_not_depend_on_the_order_of_obstacles(order):
    polygons = [NEEDLE, ACUTE, BLUNT]

    def places(numbers):
        chosen = [polygons[i] for i in numbers]
        at, grow = gap_places(chosen, pack_faces(chosen), 1e3)
        return sorted(map(tuple, np.round(np.hstack([at, grow]), 6).tolist()))

    assert places(order) == places(range(3))
    assert len(places([1, 2])) > 0 < len(places([0, 2]))
