"""The roadmap: its lines against an enumeration of all paths, and the automaton."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely

from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.routes import roadmap
from pareto_ltl.planning.routes.path_classes import path_class, path_word
from pareto_ltl.planning.routes.roadmap import roadmap_lines, sight_graph
from problems import box, make_problem, make_scene

OBSTACLES = [box(6, 8, 8, 12), box(11, 7, 13, 11)]


def task(formula: str = "F a", **regions) -> Problem:
    places = {"a": box(16, 9, 18, 11)} | regions
    return make_problem(formula, make_scene(places, OBSTACLES, start=(2, 10)), fidelity="full")


def length_of(line: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def shortest_of_each_word(problem: Problem, limit: float) -> dict[tuple[int, ...], float]:
    """The shortest way to region a for each word, by trying every path without a loop up to ``limit``."""
    graph = sight_graph(problem)
    goals = {k for k, cell in enumerate(problem.locate(graph.at)) if "a" in problem.labels[cell]}
    found: dict[tuple[int, ...], float] = {}
    begun = [([0], 0.0)]
    while begun:
        nodes, length = begun.pop()
        if nodes[-1] in goals:
            word = path_word(problem.decomposition.obstacles, graph.at[nodes])
            found[word] = min(length, found.get(word, np.inf))
            continue
        for k in range(graph.first[nodes[-1]], graph.first[nodes[-1] + 1]):
            node, further = int(graph.edge[k, 1]), length + float(graph.length[k])
            if node not in nodes and further <= limit:
                begun.append(([*nodes, node], further))
    return found


def test_lines_are_the_shortest_of_their_classes_and_no_class_is_missing():
    problem = task()
    lines = roadmap_lines(problem, 1000)
    assert [length_of(x) for x in lines] == sorted(length_of(x) for x in lines)
    limit = 1.25 * length_of(lines[0])
    expected = shortest_of_each_word(problem, limit)
    found = {path_word(problem.decomposition.obstacles, x): length_of(x) for x in lines}
    assert len(expected) >= 3
    for word, length in expected.items():
        assert found[word] == pytest.approx(length, rel=1e-9)


@pytest.mark.parametrize("formula", ["F(a & F b)", "F a & F b", "!b U a & F b", "F b | F(a & F b)"])
def test_lines_complete_the_mission_clear_of_obstacles_in_distinct_classes(formula):
    problem = task(formula, b=box(9, 14, 12, 17))
    lines = roadmap_lines(problem, 40)
    blocked = shapely.union_all([shapely.Polygon(part) for part in problem.decomposition.obstacles])
    assert len(lines) >= 2
    for x in lines:
        fine = np.vstack([np.linspace(p, q, 400) for p, q in pairwise(x)])
        assert problem.logic.distance[path_class(problem, fine).state] == 0.0
        assert not shapely.intersects(blocked, shapely.LineString(x))
    words = {path_word(problem.decomposition.obstacles, x) for x in lines}
    assert len(words) >= 2


def test_a_line_may_pass_many_obstacles():
    """Each of them has a ray to the north, which the line crosses."""
    row = [box(3 + k, 2, 3.5 + k, 3) for k in range(12)]
    problem = make_problem("F a", make_scene({"a": box(16, 9, 18, 11)}, row, start=(2, 10)), fidelity="full")
    lines = roadmap_lines(problem, 4)
    assert len(lines) == 4
    assert len(path_word(problem.decomposition.obstacles, lines[0])) == 12


def test_every_order_of_a_mission_has_a_line():
    problem = task("F a & F b", b=box(9, 14, 12, 17))
    orders = set()
    for x in roadmap_lines(problem, 60):
        fine = np.vstack([np.linspace(p, q, 400) for p, q in pairwise(x)])
        orders.add(tuple("".join(sorted(label)) for _, label in path_class(problem, fine).order))
    assert orders >= {("", "a", "b"), ("", "b", "a")}


def test_a_mission_that_no_way_completes_has_no_line():
    ring = [box(4, 0, 5, 20)]
    scene = make_scene({"a": box(16, 9, 18, 11)}, ring, start=(2, 10))
    assert roadmap_lines(make_problem("F a", scene, fidelity="full"), 5) == []


def test_a_product_that_is_too_large_is_left_to_trees_and_taut_lines(monkeypatch):
    monkeypatch.setattr(roadmap, "MAX_EDGES", 10)
    assert roadmap_lines(task(), 5) == []


def test_the_nodes_of_the_least_detour_are_kept(monkeypatch):
    monkeypatch.setattr(roadmap, "MOST_NODES", 8)
    graph = sight_graph(task())
    assert len(graph.at) <= 9
    assert roadmap_lines(task(), 5)


def test_lines_stay_on_the_map():
    scene = make_scene({"a": box(16, 9, 18, 11)}, [box(9, 0.2, 11, 19.8)], start=(2, 10))
    problem = make_problem("F a", scene, fidelity="full")
    low, high = problem.scene.bounds
    for x in roadmap_lines(problem, 9):
        assert ((x > low) & (x < high)).all()
