"""Classes of paths: words change exactly where a path cannot be bent without meeting an obstacle."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise, product

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pareto_ltl.planning.routes.path_classes import crossed_rays, path_class, path_word, reduced_word
from pareto_ltl.support.arrays import FloatArray
from problems import KM, along, box, make_problem, make_scene

# Triangles about their middles; odd middles, even nodes: no path goes through a middle, many go above one.
TRIANGLE = np.array([[-0.3, -0.2], [0.3, -0.2], [0.0, 0.4]])
middles = st.tuples(st.integers(-3, 3), st.integers(-3, 3)).map(lambda k: (2 * k[0] + 1, 2 * k[1] + 1))
nodes = st.tuples(st.integers(-4, 4), st.integers(-4, 4)).map(lambda k: (2 * k[0], 2 * k[1]))
fine_nodes = st.tuples(st.integers(-16, 16), st.integers(-16, 16)).map(lambda k: (k[0] / 2, k[1] / 2))
maps = st.lists(middles, max_size=5, unique=True)
paths = st.lists(st.one_of(nodes, fine_nodes), min_size=2, max_size=9).map(lambda p: np.array(p, float))
some = settings(deadline=None, max_examples=150)


def obstacles_at(places: list[tuple[int, int]]) -> list[FloatArray]:
    return [np.array(place) + TRIANGLE for place in places]


def inverse(word: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(-letter for letter in reversed(word))


def clear_of(places: list[tuple[int, int]], x: FloatArray) -> bool:
    """Whether no leg of ``x`` passes through a middle."""
    legs = [shapely.LineString(leg) for leg in pairwise(x)]
    return not any(leg.distance(shapely.Point(place)) < 1e-6 for leg in legs for place in places)


# --- crossings ------------------------------------------------------------------------------------


def slow_crossings(places: list[tuple[int, int]], x: FloatArray) -> dict[int, tuple[int, ...]]:
    """In exact fractions, one leg and one ray after the other; of rays in one line the first lies west."""
    found = {}
    for i, leg in enumerate(pairwise(x)):
        (x0, y0), (x1, y1) = [[Fraction(float(v)) for v in point] for point in leg]
        crossings = []
        for k, (east, north) in enumerate(places):
            if (x0 <= east) == (x1 <= east):
                continue
            share = (east - x0) / (x1 - x0)
            if y0 + share * (y1 - y0) > north:
                crossings.append((share, k + 1 if x0 <= east else -(k + 1)))
        if crossings:
            found[i] = tuple(letter for _, letter in sorted(crossings))
    return found


@some
@given(maps, paths)
def test_rays_are_crossed_as_in_exact_fractions(places: list[tuple[int, int]], x: FloatArray) -> None:
    assume(clear_of(places, x))
    assert crossed_rays(obstacles_at(places), x[:-1], x[1:]) == slow_crossings(places, x)


@some
@given(maps, paths)
def test_a_loop_winds_round_an_obstacle_as_often_as_its_letter_says(
    places: list[tuple[int, int]], x: FloatArray
) -> None:
    """Clockwise turns by angles; the sum of a letter's signs in a word."""
    loop = np.vstack([x, x[:1]])
    assume(clear_of(places, loop))
    word = path_word(obstacles_at(places), loop)
    for k, place in enumerate(places):
        angle = np.unwrap(np.arctan2(*(loop - place).T[::-1]))
        turns = round((angle[0] - angle[-1]) / (2 * np.pi))
        assert word.count(k + 1) - word.count(-(k + 1)) == turns


# --- words ----------------------------------------------------------------------------------------


@some
@given(maps, paths, st.data())
def test_a_detour_round_nothing_leaves_the_word_alone(
    places: list[tuple[int, int]], x: FloatArray, data: st.DataObject
) -> None:
    """A loop from a point of the path and back encloses no obstacle."""
    at = data.draw(st.integers(0, len(x) - 1))
    loop = np.array(data.draw(st.lists(fine_nodes, min_size=1, max_size=3)), float)
    longer = np.vstack([x[: at + 1], loop, x[at:]])
    hull = shapely.MultiPoint(np.vstack([x[at : at + 1], loop])).convex_hull
    assume(not any(hull.distance(shapely.Point(place)) < 1e-6 for place in places))
    assume(clear_of(places, x))
    obstacles = obstacles_at(places)
    assert path_word(obstacles, longer) == path_word(obstacles, x)


@some
@given(maps, paths, st.integers(0, 7))
def test_a_detour_round_an_obstacle_changes_the_word(
    places: list[tuple[int, int]], x: FloatArray, at: int
) -> None:
    assume(places)
    assume(clear_of(places, x))
    obstacles, place = obstacles_at(places), np.array(places[0])
    near = place + 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])  # round this one alone
    at = min(at, len(x) - 1)
    there = np.vstack([x[: at + 1], near[:1]])
    assume(clear_of(places, there))
    longer = np.vstack([there, near, x[at:]])
    assert path_word(obstacles, longer) != path_word(obstacles, x)
    twice = np.vstack([there, near, near[::-1], x[at:]])
    assert path_word(obstacles, twice) == path_word(obstacles, x)


@some
@given(maps, paths, paths)
def test_words_follow_one_another_and_turn_round(
    places: list[tuple[int, int]], x: FloatArray, y: FloatArray
) -> None:
    y = np.vstack([x[-1:], y])
    assume(clear_of(places, x) and clear_of(places, y))
    obstacles = obstacles_at(places)
    there, on = path_word(obstacles, x), path_word(obstacles, y)
    assert path_word(obstacles, x[::-1]) == inverse(there)
    assert path_word(obstacles, np.vstack([x, y])) == reduced_word(there, on)
    assert reduced_word(there, inverse(there)) == ()


def test_every_choice_of_sides_is_a_class_of_its_own() -> None:
    places = [(1, 1), (5, -1), (9, 3), (13, 1)]
    obstacles, words = obstacles_at(places), set()
    for sides in product((-1, 1), repeat=4):
        bends = [(east, north + side) for (east, north), side in zip(places, sides, strict=True)]
        words.add(path_word(obstacles, np.vstack([[-2, 0], *bends, [16, 0]])))
    assert len(words) == 16


def test_without_obstacles_there_is_one_word() -> None:
    assert crossed_rays([], np.zeros((3, 2)), np.ones((3, 2))) == {}
    assert path_word([], np.array([[0.0, 0], [5, 5], [-3, 2]])) == ()


# --- classes --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def problem():
    """Two goals in any order, one obstacle between them and the start."""
    scene = make_scene({"a": box(14, 8, 18, 12), "b": box(8, 15, 12, 18)}, [box(7, 8, 9, 12)], start=(2, 10))
    return make_problem("F a & F b", scene, fidelity="full")


def test_a_class_is_the_order_of_the_mission_and_the_sides_of_obstacles(problem) -> None:
    a, b = [16, 10], [10, 16]
    south_a_b = path_class(problem, along([2, 10], [8, 6], a, b))
    finer = path_class(problem, along([2, 10], [8, 6], a, b, step=0.13))
    wider = path_class(problem, along([2, 10], [3, 2], [15, 3], a, [14, 15], b))
    north_a_b = path_class(problem, along([2, 10], [8, 13], a, b))
    b_a = path_class(problem, along([2, 10], [8, 13], b, a))
    only_a = path_class(problem, along([2, 10], [8, 6], a))
    assert south_a_b == finer == wider
    assert len({south_a_b, north_a_b, b_a, only_a}) == 4
    assert south_a_b.words == ((), ())
    assert north_a_b.words == b_a.words == ((1,), ())
    assert [sorted(label) for _, label in south_a_b.order] == [[], ["a"], ["b"]]
    assert [sorted(label) for _, label in b_a.order] == [[], ["b"], ["a"]]
    done = problem.logic.distance == 0.0
    assert done[south_a_b.state]
    assert done[b_a.state]
    assert not done[only_a.state]


def test_out_and_back_past_an_obstacle_are_told_apart_leg_by_leg(problem) -> None:
    """As one word, both ways north and both ways south are the same."""
    b, a = [16, 10], [3, 17]
    scene = make_scene({"b": box(14, 8, 18, 12), "a": box(2, 16, 4, 18)}, [box(7, 8, 9, 12)], start=(2, 10))
    mission = make_problem("F(b & F a)", scene, fidelity="full")
    north = path_class(mission, along([2, 10], [8, 13], b, [8, 14], a))
    south = path_class(mission, along([2, 10], [8, 6], b, [8, 6], [2, 8], a))
    assert [len(word) for word in north.words] == [1, 1]
    assert south.words == ((), ())
    whole = mission.decomposition.obstacles
    assert path_word(whole, along([2, 10], [8, 13], b, [8, 14], a)) == ()


def test_a_start_in_a_region_is_read(problem) -> None:
    x = np.array([[15.0, 10.0], [10.0, 16.0]]) * KM
    kind = path_class(problem, x)
    assert [sorted(label) for _, label in kind.order] == [["a"], ["b"]]
