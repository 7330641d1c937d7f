"""Mission orders: all that the automaton allows, or with the shortest way where there are too many."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest

from pareto_ltl.planning.routes import obligations
from problems import box, make_problem, make_scene

SPOTS = [(4 * k + 2.0, 4.0 * j + 2.0) for k, j in product(range(1, 5), range(3))]


def visits(count: int):
    """Regions a, b, ... that are to be visited in any order."""
    names = "abcdefghijkl"[:count]
    regions = {name: box(x, y, x + 1, y + 1) for name, (x, y) in zip(names, SPOTS, strict=False)}
    return make_problem(" & ".join(f"F {name}" for name in names), make_scene(regions)), names


def words(problem, most):
    return ["".join(*zip(*order.labels, strict=True)) for order in obligations.possible_orders(problem, most)]


def test_few_regions_have_all_their_orders():
    problem, names = visits(4)
    assert sorted(words(problem, 100)) == sorted(map("".join, permutations(names)))
    assert len(words(problem, 5)) == 5


def test_the_shortest_ways_come_first():
    """Regions on a line east of the start: of all orders the one from west to east is the first."""
    names = "abcd"
    regions = {name: box(4 + 3 * k, 9, 5 + 3 * k, 10) for k, name in enumerate(names)}
    scene = make_scene(regions, start=(1.0, 9.5))
    problem = make_problem(" & ".join(f"F {name}" for name in reversed(names)), scene)
    assert words(problem, 24)[0] == "abcd"
    assert words(problem, 3) == words(problem, 24)[:3]


@pytest.mark.parametrize("most", [1, 24])
def test_of_many_orders_those_of_a_short_way_are_found(most):
    problem, names = visits(9)
    found = words(problem, most)
    assert len(set(found)) == most
    assert all(sorted(word) == list(names) for word in found)
    middle = {name: problem.scene.regions[name][0].mean(axis=0) for name in names}
    rng = np.random.default_rng(0)

    def length(word):
        way = np.array([problem.scene.start, *(middle[name] for name in word)])
        return np.linalg.norm(np.diff(way, axis=0), axis=1).sum()

    chance = [length(rng.permutation(list(names))) for _ in range(500)]
    assert max(map(length, found)) < np.quantile(chance, 0.05)


def test_states_before_the_labels_are_those_of_the_automaton(monkeypatch):
    monkeypatch.setattr(obligations, "BEGUN", 3)
    problem, _ = visits(5)
    for order in obligations.possible_orders(problem, 24):
        q = problem.automaton.initial
        for label, state in zip(order.labels, order.states, strict=True):
            assert state == q
            q = problem.automaton.step(q, label)
        assert problem.automaton.accepting[q]


def test_deviations_towards_faces_are_those_of_the_covariances():
    rng = np.random.default_rng(4)
    normal = rng.standard_normal((7, 2))
    factors = rng.standard_normal((5, 2, 2))
    full = factors @ factors.transpose(0, 2, 1)
    packed = np.stack([full[:, 0, 0], full[:, 0, 1], full[:, 1, 1]], axis=1)
    wanted = np.sqrt(np.einsum("fi,tij,fj->tf", normal, full, normal))
    np.testing.assert_allclose(obligations.face_deviations(normal, packed), wanted)


def test_cells_that_spoil_a_path_are_those_whose_label_leads_to_no_state_as_good():
    """Of !b U a on a map with both: b spoils every step and the segment to a, the path's cells none."""
    scene = make_scene({"a": box(8, 8, 10, 10), "b": box(4, 0, 6, 2)})
    problem = make_problem("!b U a", scene)
    where = {label: k for k, label in enumerate(map("".join, problem.labels)) if label}
    free = next(k for k, label in enumerate(problem.labels) if not label)
    step = problem.automaton.step
    start = problem.automaton.initial
    q = np.array([start, start, step(start, frozenset("a"))])
    spoils = obligations._spoiling_cells(problem, q, np.array([free, free, where["a"]]))  # noqa: SLF001
    assert spoils[:, where["b"]].all()  # on the segment to a too
    assert not spoils[:, [k for k, label in enumerate(problem.labels) if not label]].any()
    assert not spoils[:, where["a"]].any()
