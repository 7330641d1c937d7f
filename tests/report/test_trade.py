"""Sentences on what other paths of a front would give, and on loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from drawn_world import front_of, plan_of, scene_of
from pareto_ltl import Scene
from pareto_ltl.extend import FailureRate, Front
from pareto_ltl_apps.view.trade import Trade, looped_regions, trade_lines

LENGTHS, FAILURES = (2.0e6, 1.95e6, 1.7e6, 1.5e6), (0.03, 0.04, 0.05, 0.5)


def graded_front() -> Front:
    """Paths of LENGTHS [m] with FAILURES, all through the same positions."""
    front = front_of(scene_of())
    base = front.paths[0]
    paths = tuple(
        replace(base, objectives=replace(base.objectives, costs={"length": length}), x=base.x + 1e-6 * k)
        for k, length in enumerate(LENGTHS)
    )
    rates = tuple(FailureRate.counted("coherent", round(4000 * one), 4000) for one in FAILURES)
    return replace(front, paths=paths, rates=rates, failed=np.zeros((4, 4000), bool))


def one_region(scene: Scene, half: float) -> Scene:
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    return replace(scene, regions={"b": (corners,)}, windows={}, forbidden=())


def test_the_best_path_that_is_a_tenth_shorter_and_the_best_longer_one_are_named() -> None:
    front, scene = graded_front(), scene_of()
    lines = list(trade_lines(scene, front, plan_of(front.paths[1])))
    compared = "in the winds in which paths are compared"
    assert lines[:2] == [
        f"Point 2 is 250.0 km (13 %) shorter: 5.0 instead of 4.0 of 100 flights fail, {compared}",
        f"Point 0 is 50.0 km longer: 3.0 instead of 4.0 of 100 flights fail, {compared}",
    ]
    safest = list(trade_lines(scene, front, plan_of(front.paths[0])))
    assert safest[0].startswith("Point 2 is 300.0 km (15 %) shorter: 5.0 instead of 3.0")
    assert not any("longer" in line for line in safest)


def test_what_one_per_cent_of_length_gives_is_said_of_both_sides() -> None:
    """ln(41 / 31) / ln(2 / 1.95), and ln(51 / 41) / ln(1.95 / 1.7), 0.1 % added to each rate."""
    front, scene = graded_front(), scene_of()
    both, least, most = (list(trade_lines(scene, front, plan_of(front.paths[k]))) for k in (1, 3, 0))
    assert both[2] == (
        "1 % more length saves at most 11.0 % of the failures (point 0), "
        "1 % less adds at least 1.6 % (point 2)"
    )
    assert least[-1] == "1 % more length saves at most 18.3 % of the failures (point 2)"
    assert "1 % less length adds at least 3.1 % to the failures (point 2)" in most


def test_a_front_that_is_judged_by_bounds_has_no_sentence() -> None:
    front = front_of(scene_of())
    assert not list(trade_lines(scene_of(), front, plan_of(front.paths[0])))


@pytest.mark.parametrize(
    ("x", "loops"),
    [
        ([[-9, 0], [0, 0], [9, 0]], False),  # straight through
        ([[-9, 0], [0, 0], [9, 0], [9, 9], [0, 0], [0, -9]], True),  # twice
        ([[-9, 0], [-1, 0], [1, 0], [0, 1], [-1, 0.5], [-9, 0.5]], True),  # turns inside
        ([[-9, 0], [0, 0], [0, 9]], False),  # a quarter turn
        ([[-9, 5], [9, 5]], False),  # beside it
    ],
)
def test_a_path_loops_in_a_region_that_it_enters_twice_or_turns_in(x: list[list[float]], loops: bool) -> None:
    scene = one_region(scene_of(), 2.0)
    path = np.array(x, float)
    assert looped_regions(scene, path) == (["b"] if loops else [])
    inside = shapely.LineString(path).intersection(shapely.box(-2, -2, 2, 2))  # a second road: its pieces
    if loops and len(x) == 6 and x[1] == [0, 0]:
        assert len(shapely.get_parts(shapely.node(inside))) > 2


def test_a_loop_has_its_reason_where_paths_without_it_are_less_safe() -> None:
    scene, front = one_region(scene_of(), 2.0), graded_front()
    ways = [[[-9, 0], [0, 0], [9, 0], [9, 9], [0, 0]]] + [[[-9, 0], [0, 0], [9, 0], [9, 1], [9, 2]]] * 3
    paths = tuple(
        replace(path, x=np.vstack([np.array(way, float), path.x[5:] + 1e6]))
        for path, way in zip(front.paths, ways, strict=True)
    )
    front = replace(front, paths=paths)
    (line,) = [one for one in trade_lines(scene, front, plan_of(paths[0])) if "turns" in one]
    assert line == (
        "It turns in b, so that more flights meet it: 3.0 of 100 flights fail; of the safest path without "
        "that (point 1, 1,950.0 km) 4.0 of 100 flights"
    )


def floored(front: Front, floor: float, ways: dict[int, list[list[float]]] | None = None) -> Trade:
    """The trade of ``front`` with other first positions of some paths."""
    paths = tuple(
        replace(path, x=np.vstack([np.array(ways[k], float), path.x[5:] + 1e6]))
        if ways and k in ways
        else path
        for k, path in enumerate(front.paths)
    )
    return Trade(one_region(scene_of(), 2.0), replace(front, paths=paths), floor)


def test_the_shortest_path_that_the_law_cannot_tell_apart_is_named_first() -> None:
    trade = floored(graded_front(), 0.06)  # points 0, 1 and 2 fail less often than the floor
    told = "fewer than 6.0 of 100 flights fail too"
    assert trade.lines(0) == [
        f"Point 2 is 300.0 km (15 %) shorter: {told} (5 % instead of 3 % of the simulated ones)",
        "1 % less length adds at least 7.3 % to the failures (point 3)",
    ]
    rest = "50 instead of fewer than 6.0 of 100 flights fail, in the winds in which paths are compared"
    assert trade.lines(2) == [
        f"Point 3 is 200.0 km (12 %) shorter: {rest}",
        "1 % less length adds at least 16.8 % to the failures (point 3)",
    ]
    assert not any("longer" in line for line in trade.lines(2))  # a safer one is not safer as far as is known
    assert [line.startswith("Point 0") for line in floored(graded_front(), 0.0).lines(2)[1:2]] == [True]


def test_a_loop_below_the_floor_says_what_was_simulated() -> None:
    there, straight = [[-9, 0], [0, 0], [9, 0], [9, 9], [0, 0]], [[-9, 0], [0, 0], [9, 0], [9, 1], [9, 2]]
    trade = floored(graded_front(), 0.06, {0: there, **dict.fromkeys((1, 2, 3), straight)})
    assert trade.lines(0)[-1] == (
        "It turns in b, so that more flights meet it: of the simulated ones 3 % fail; of the safest path "
        "without that (point 1, 1,950.0 km) 4 %; the data of the law cannot tell these rates apart"
    )
    assert not any("turns" in line for k in (1, 2, 3) for line in trade.lines(k))
    assert trade.paragraphs()[0] == " ".join(f"{line}." for line in trade.lines(0))
