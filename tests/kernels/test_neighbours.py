"""The two indexes of vertices: k-d trees against brute force, reservoirs against chance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plane_kernels.neighbours import Bins, bin_of, kd_insert, kd_nearest, remember
from plane_kernels.types import Point
from problems import RARE, chi_square_chance

some = settings(deadline=None, max_examples=60)
coordinate = st.one_of(st.integers(-5, 5).map(float), st.floats(-1e6, 1e6))
clouds = st.lists(st.tuples(coordinate, coordinate, st.integers(0, 2)), max_size=60)


def planted(points, groups):
    """A k-d tree for each of the ``groups`` of ``points``."""
    x = np.array(points, float).reshape(-1, 2)
    child, root = np.full((len(x), 2), -1, np.int32), np.full(max(groups, default=0) + 1, -1, np.int32)
    for vertex, group in enumerate(groups):
        kd_insert(x, child, root, group, vertex)
    return x, child, root


def nearest(index, group, point):
    return kd_nearest(*index, group, Point(*map(float, point)), np.empty((256, 4)))


@some
@given(clouds, st.tuples(coordinate, coordinate))
def test_the_nearest_of_a_group_is_found(cloud, point):
    groups = np.array([g for *_, g in cloud] + [3])  # group 3: one vertex far away
    index = planted([(x, y) for x, y, _ in cloud] + [(9e6, 9e6)], groups)
    squared = ((index[0] - point) ** 2).sum(axis=1)
    for group in range(4):
        members = np.flatnonzero(groups == group)
        found = nearest(index, group, point)
        if len(members) == 0:
            assert found == -1
        else:
            assert groups[found] == group
            assert squared[found] == squared[members].min()


@pytest.mark.parametrize("order", ["sorted", "zigzag", "same"])
def test_orders_that_make_the_tree_deep_change_no_answer(order):
    n = 600
    line = np.arange(n, dtype=float)
    if order == "zigzag":  # outside in: both axes alternate from end to end
        line = np.where(np.arange(n) % 2 == 0, line, n - line)
    x = np.zeros((n, 2)) if order == "same" else np.column_stack([line, line % 7])
    index = planted(x, np.zeros(n, int))
    for point in np.random.default_rng(0).uniform(-10, n + 10, (40, 2)) * [1.0, 0.02]:
        squared = ((x - point) ** 2).sum(axis=1)
        assert squared[nearest(index, 0, point)] == squared.min()


def test_a_large_random_tree_agrees_with_brute_force():
    rng = np.random.default_rng(3)
    x = rng.uniform(0, 1, (3000, 2))
    index = planted(x, np.zeros(len(x), int))
    for point in rng.uniform(-0.2, 1.2, (200, 2)):
        assert nearest(index, 0, point) == np.argmin(((x - point) ** 2).sum(axis=1))


def test_a_square_keeps_all_that_fit_and_then_forgets_some():
    kept, seen = np.full((2, 4), -1, np.int32), np.zeros(2, np.int32)
    rng = np.random.default_rng(0)
    for vertex in range(4):
        remember(kept, seen, 1, vertex, rng)
    assert kept[1].tolist() == [0, 1, 2, 3]
    for vertex in range(4, 50):
        remember(kept, seen, 1, vertex, rng)
    assert seen.tolist() == [0, 50]
    assert np.all(kept[0] == -1)
    assert len(set(kept[1])) == 4
    assert set(kept[1]) <= set(range(50))


def test_every_vertex_is_kept_with_the_same_probability():
    items, capacity, rounds = 20, 5, 1500
    counts, rng = np.zeros(items), np.random.default_rng(7)
    for _ in range(rounds):
        kept, seen = np.empty((1, capacity), np.int32), np.zeros(1, np.int32)
        for vertex in range(items):
            remember(kept, seen, 0, vertex, rng)
        counts[kept[0]] += 1
    # A sample without repetition varies less than independent draws, by (n - k) / (n - 1).
    mean = rounds * capacity / items
    stretch = np.sqrt((items - 1) / (items - capacity))
    assert chi_square_chance(mean + stretch * (counts - mean), np.full(items, mean)) > RARE


@some
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 6)), max_size=40))
def test_every_pair_of_square_and_state_has_one_bin_and_bins_of_a_square_come_by_state(pairs):
    n = len(pairs) + 1
    none = [np.zeros(n, np.int32) for _ in range(3)]
    bins = Bins(
        np.zeros(4, np.int32), *none, np.zeros((n, 8), np.int32), np.zeros(n, np.int32), np.zeros(1, np.int64)
    )
    numbers = {}
    for square, state in pairs:
        b = bin_of(bins, square, state)
        assert numbers.setdefault((square, state), b) == b > 0
    assert bins.used[0] == len(numbers) == len(set(numbers.values()))
    for square in range(4):
        met, b = [], bins.head[square]
        while b > 0:
            assert numbers[square, int(bins.state[b])] == b
            met.append(int(bins.state[b]))
            b = bins.after[b]
        assert met == sorted(state for at, state in numbers if at == square)
