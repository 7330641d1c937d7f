"""What is seen past polygons, and where gaps between them are clear: kernels against plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto_ltl.planning.pack import pack_faces
from plane_kernels.visibility import (
    BESIDE,
    TOUCH,
    Distances,
    Places,
    Walls,
    arrivals,
    clear_crossings,
    direction,
    kept_distance,
    seen_places,
)
from problems import polygon_faces
from strategies import convex_polygons

some = settings(max_examples=40)
seeds = st.integers(0, 2**32 - 1)
maps = st.lists(convex_polygons(least=20.0, most=120.0, corners=7), min_size=1, max_size=8)


def walls_of(polygons, asks=None):
    corners = np.vstack([np.empty((0, 2)), *polygons])
    return Walls(pack_faces(polygons), corners, np.ones(len(polygons)) if asks is None else asks)


def plainly_seen(walls, here, keep, there, keeps, step):
    """Every step of the flight to each place has a face that both its ends keep their distance from."""
    found = []
    for end, last in zip(there, keeps, strict=True):
        n = max(1, int(np.ceil(np.hypot(*(end - here)) / step)))
        share = np.arange(n + 1)[:, None] / n
        points, wanted = here + share * (end - here), keep + share * (last - keep)
        seen = True
        for (normal, offset), ask in zip(polygon_faces(walls.faces), walls.asks, strict=True):
            clear = points @ normal.T - offset >= ask * wanted - TOUCH
            seen &= bool((clear[:-1] & clear[1:]).any(axis=1).all())
        found.append(seen)
    return np.array(found)


@some
@given(maps, seeds, st.floats(20.0, 400.0))
def test_seen_places_agree_with_plain_numpy(polygons, seed, step):
    rng = np.random.default_rng(seed)
    walls = walls_of(polygons, rng.integers(0, 2, len(polygons)).astype(float))
    here, there = rng.uniform(0, 1000, 2), rng.uniform(-100, 1100, (60, 2))
    keep, keeps = rng.uniform(0, 30), rng.uniform(0, 60, len(there))
    found = seen_places(walls, here, keep, there, keeps, step)
    np.testing.assert_array_equal(found, plainly_seen(walls, here, keep, there, keeps, step))


@some
@given(maps, seeds)
def test_the_order_of_places_does_not_matter(polygons, seed):
    rng, walls = np.random.default_rng(seed), walls_of(polygons)
    here, there = rng.uniform(0, 1000, 2), rng.uniform(0, 1000, (60, 2))
    keeps, order = rng.uniform(0, 60, 60), rng.permutation(60)
    found = seen_places(walls, here, 10.0, there, keeps, 100.0)
    again = seen_places(walls, here, 10.0, there[order], keeps[order], 100.0)
    np.testing.assert_array_equal(found[order], again)


def test_without_polygons_everything_is_seen():
    there = np.array([[1.0, 2.0], [5.0, 5.0]])
    assert seen_places(walls_of([]), np.zeros(2), 1.0, there, np.ones(2), 1.0).all()


square = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]])


@pytest.mark.parametrize(
    ("here", "there", "keep", "seen"),
    [
        ((-50, -50), (150, -50), 40.0, True),  # along a face
        ((-50, -50), (150, -50), 60.0, False),  # too near to it
        ((-50, 50), (150, 50), 0.0, False),  # through the middle
        ((-50, 160), (160, -50), 0.0, False),  # through two edges
        ((-100, 130), (80, 310), 0.0, True),  # beside a corner
    ],
)
def test_what_a_square_hides(here, there, keep, seen):
    place, goal = np.array(here, float), np.array([there], float)
    found = seen_places(walls_of([square]), place, keep, goal, np.array([keep]), 1e9)
    assert found.tolist() == [seen]


@pytest.mark.parametrize(("step", "seen"), [(1e9, False), (200.0, False), (20.0, True)])
def test_a_way_past_a_corner_is_flown_in_short_steps_only(step, seen):
    """No face of the square has all of the way on its outer side; of short steps each has one."""
    here, there = np.array([-100.0, 320.0]), np.array([[320.0, -100.0]])
    found = seen_places(walls_of([square]), here, 0.0, there, np.zeros(1), step)
    assert found.tolist() == [seen]


@some
@given(maps, seeds)
def test_clear_crossings_agree_with_plain_numpy(polygons, seed):
    rng, faces = np.random.default_rng(seed), pack_faces(polygons)
    n, distances = 80, np.array([5.0, 15.0, 40.0])
    first, second = rng.integers(0, len(polygons), (2, n))
    at, grow = rng.uniform(0, 1000, (n, 2)), rng.uniform(-1.5, 1.5, (n, 2))
    expected = np.zeros(n, bool)
    for r in distances:
        p = at + r * grow
        depth = np.array([(p @ a.T - b).max(axis=1) for a, b in polygon_faces(faces)]).T
        rows = np.arange(n)
        beside = np.maximum(depth[rows, first], depth[rows, second]) <= BESIDE * r + TOUCH
        expected |= beside & (depth >= r - TOUCH).all(axis=1)
    np.testing.assert_array_equal(clear_crossings(faces, first, second, at, grow, distances), expected)


def test_directions_grow_with_the_angle_and_count_to_four():
    angle = np.linspace(0, 2 * np.pi, 721)[:-1]
    found = [direction(7 * np.cos(a), 7 * np.sin(a)) for a in angle]
    assert (np.diff(found) > 0).all()
    quarters = [direction(*d) for d in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))]
    assert quarters == [0.0, 1.0, 2.0, 3.0]


@given(st.floats(0, 2000))
def test_the_distance_to_keep_is_that_of_numpy(metres):
    keep = np.array([0.0, 3.0, 5.0, 11.0, 12.0])
    found = kept_distance(Distances(250.0, keep), metres)
    assert found == pytest.approx(np.interp(metres / 250.0, np.arange(5), keep), rel=1e-12, abs=1e-12)


@some
@given(seeds)
def test_places_are_reached_where_the_distance_on_arrival_puts_them(seed):
    """Each is a fixed point: place, distance to keep there and length of the line agree."""
    rng, n, length = np.random.default_rng(seed), 60, 300.0
    places = Places(rng.uniform(0, 1000, (n, 2)), rng.uniform(-1.4, 1.4, (n, 2)))
    distances, here = Distances(100.0, np.cumsum(rng.uniform(0, 3, 30))), rng.uniform(0, 1000, 2)
    best, bounds = rng.uniform(300, 1600, n), np.array([[0.0, 0.0], [1000.0, 900.0]])
    rows, ends, keeps, total = arrivals(places, best, here, length, distances, bounds)
    keep = np.interp(total / 100.0, np.arange(30), distances.keep)
    np.testing.assert_allclose(keeps, keep, atol=1e-3)
    np.testing.assert_allclose(ends, places.at[rows] + keeps[:, None] * places.grow[rows], atol=1e-9)
    np.testing.assert_allclose(total, length + np.linalg.norm(ends - here, axis=1), atol=1e-9)
    assert (total < best[rows]).all()
    assert ((ends >= bounds[0]) & (ends <= bounds[1])).all()
    for k in np.setdiff1d(np.arange(n), rows):
        reach = length + np.linalg.norm(places.at[k] - here)
        for _ in range(50):
            end = places.at[k] + np.interp(reach / 100.0, np.arange(30), distances.keep) * places.grow[k]
            reach = length + np.linalg.norm(end - here)
        inside = ((end >= bounds[0]) & (end <= bounds[1])).all()
        assert not inside or reach >= best[k] - 1e-3
