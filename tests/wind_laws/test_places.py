"""Selections of places of readings."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wind_laws.places import FAR_SHARE, farthest_points, shared_nodes, thinned

NODES = np.stack(np.meshgrid(np.arange(4.0), 50.0 + np.arange(5.0), indexing="ij"), axis=-1).reshape(-1, 2)


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_shared_nodes_are_those_of_all_times_in_the_order_of_the_first(seed: int, times: int) -> None:
    rng = np.random.default_rng(seed)
    points = [NODES[rng.permutation(20)[: rng.integers(1, 21)]] for _ in range(times)]
    every = [set(map(tuple, one.tolist())) for one in points]
    expected = [node for node in points[0].tolist() if all(tuple(node) in one for one in every)]
    assert shared_nodes(points).tolist() == expected


@given(st.integers(0, 2**32 - 1), st.integers(10, 30), st.integers(10, 30), st.floats(0.0, 1.0))
def test_readings_beside_a_region_stay_and_leave_their_share_to_others(
    seed: int, count: int, limit: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    beside, around = rng.random(count) < share, 2.0 * np.pi * np.arange(count) / count
    ring = 1e3 * np.column_stack([np.cos(around), np.sin(around)])  # others are far away and apart
    points = np.where(beside[:, None], rng.normal(size=(count, 2)), ring)
    found = thinned(points, beside, np.zeros(2), limit)
    assert len(found) == min(count, limit)
    assert list(found) == sorted(set(found.tolist()))
    if count <= limit:
        return
    near, far = int(beside[found].sum()), int((~beside)[found].sum())
    assert far >= min(int(FAR_SHARE * limit), int((~beside).sum()))
    if near < beside.sum():  # not all of these: the others have their share and no more
        assert far == min(int(FAR_SHARE * limit), int((~beside).sum()))
        inner = np.flatnonzero(beside)
        assert inner[np.argmin(np.hypot(*points[inner].T))] in found


def test_farthest_points_match_a_plain_search():
    points = np.random.default_rng(3).normal(size=(80, 2))
    chosen = [7]
    while len(chosen) < 12:
        gaps = np.linalg.norm(points[:, None] - points[chosen][None], axis=2).min(axis=1)
        chosen.append(int(np.argmax(gaps)))
    np.testing.assert_array_equal(farthest_points(points, 12, 7), chosen)
