"""What searches begin with, by their statements: paths on the other side, nodes by their detours."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pareto_ltl.planning.refine.starts import BEYOND, FLIPPED, flipped_starts
from pareto_ltl.planning.routes import roadmap, taut_lines

TRACK = np.column_stack([np.arange(21) * 500.0, np.full(21, 4000.0)])


def square(x: float, y: float, half: float) -> np.ndarray:
    return np.array([[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]])


def flipped(*obstacles: np.ndarray, reach: float = 500.0) -> Any:
    scene = SimpleNamespace(bounds=np.array([[0.0, 0.0], [10_000.0, 12_000.0]]))
    problem: Any = SimpleNamespace(
        scene=scene, decomposition=SimpleNamespace(obstacles=obstacles), reach=reach
    )
    return flipped_starts(problem, TRACK, "path 2")


def test_a_path_is_bent_past_the_other_side_of_a_near_obstacle() -> None:
    half, size = 400.0, 11_000.0
    radius = half * np.sqrt(2)
    (start,) = flipped(square(5000.0, 4500.0, half))
    assert start.origin == "path 2, past obstacle 0"
    moved = start.x - TRACK
    np.testing.assert_allclose(moved[:, 0], 0.0, atol=1e-9)
    peak = 500.0 + radius + BEYOND * size  # from the track over the middle to beyond the corners
    window = max(2.0, (radius + 500.0) / 500.0)
    expected = peak * np.exp(-0.5 * ((np.arange(21) - 10) / window) ** 2)
    expected[0] = 0.0
    np.testing.assert_allclose(moved[:, 1], expected, rtol=1e-9)
    (wide,) = flipped(square(5000.0, 4500.0, half), reach=100.0)
    assert wide.x[5, 1] - 4000.0 == pytest.approx(peak * np.exp(-0.5 * (500.0 / (radius + 500.0)) ** 2))


def test_far_obstacles_and_those_on_the_path_are_not_passed() -> None:
    near = FLIPPED * 11_000.0 + 100.0 * np.sqrt(2)
    found = flipped(
        square(5000.0, 4000.0 + near + 1.0, 100.0),
        square(5000.0, 4000.0 + near - 1.0, 100.0),
        square(5000.0, 4000.5, 100.0),
        square(5000.0, 4000.0 - 1.5, 100.0),
    )
    assert [one.origin for one in found] == ["path 2, past obstacle 1", "path 2, past obstacle 3"]


def test_a_bent_path_stays_on_the_map() -> None:
    (start,) = flipped(square(5000.0, 2000.0, 3000.0))
    assert start.x[:, 1].min() == 0.0
    assert (start.x[0] == TRACK[0]).all()


@given(st.integers(0, 2**32 - 1), st.integers(0, 3))
def test_a_detour_is_the_least_of_all_pairs_of_ends(seed: int, goals: int) -> None:
    rng = np.random.default_rng(seed)
    start, ends = rng.normal(size=2), rng.normal(size=(goals, 2))
    points = rng.normal(size=(roadmap.MOST_NODES + 1, 2))
    found = roadmap._detours(start, ends, points)  # noqa: SLF001
    if not goals:
        np.testing.assert_array_equal(found, np.arange(len(points)))
        return
    every = [
        np.hypot(*(points - a).T) + np.hypot(*(points - b).T) - np.hypot(*(a - b))
        for a, b in combinations(np.vstack([start, ends]), 2)
    ]
    np.testing.assert_allclose(found, np.min(every, axis=0), atol=1e-9)
    few = roadmap._detours(start, ends, points[:-1])  # noqa: SLF001
    np.testing.assert_array_equal(few, np.arange(roadmap.MOST_NODES))


@given(st.integers(0, 2**32 - 1), st.floats(1.0, 1e5))
def test_a_step_reaches_the_goal_or_is_at_its_largest_airspeed(seed: int, far: float) -> None:
    rng = np.random.default_rng(seed)
    b = rng.normal(size=(2, 2)) + 2.0 * np.eye(2)
    motion: Any = SimpleNamespace(
        a=np.eye(2) + 1e-5 * rng.normal(size=(2, 2)), b_inv=np.linalg.inv(b), dt=100.0, u_max=20.0
    )
    x, wind = 100.0 * rng.normal(size=2), 5.0 * rng.normal(size=2)
    goal = x + far * rng.normal(size=2)
    share = taut_lines.longest_share(motion, x, goal, wind)

    def airspeed(s: Any) -> Any:
        moved = x + np.multiply.outer(s, goal - x) - motion.a @ x - 100.0 * wind
        return np.linalg.norm(moved @ motion.b_inv.T, axis=-1) / 100.0

    cap, slowest = taut_lines.CAP * motion.u_max, airspeed(np.linspace(-3.0, 3.0, 2001)).min()
    assert share <= 1.0
    if share == 1.0:
        assert airspeed(1.0) <= cap * (1 + 1e-9)
    elif slowest < cap:
        assert airspeed(share) == pytest.approx(cap, rel=1e-6)
        assert airspeed(share + 1e-3) > cap


def test_nodes_are_free_on_the_map_outside_obstacles() -> None:
    margin, km = roadmap.FACE_MARGIN, 1000.0
    problem: Any = SimpleNamespace(scene=SimpleNamespace(bounds=np.array([[0.0, 0.0], [10 * km, 20 * km]])))
    blocked = shapely.box(2 * km, 11 * km, 4 * km, 13 * km)

    def free(*points: tuple[float, float]) -> list[bool]:
        return roadmap._free(problem, blocked, np.array(points)).tolist()  # noqa: SLF001

    assert free((3 * km, 12 * km), (3 * km, 3 * km), (9 * km, 12 * km)) == [False, True, True]
    assert free((margin, margin), (10 * km - margin, 20 * km - margin)) == [True, True]
    half, middle = margin / 2, 5 * km
    assert not any(free((half, middle), (middle, half), (10 * km - half, middle), (middle, 20 * km - half)))
