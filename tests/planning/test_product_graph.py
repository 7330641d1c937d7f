"""The product graph, state by state, and the fans that cells are sampled by."""

from __future__ import annotations

from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from numpy.random import SeedSequence

from pareto_ltl.planning import growth
from pareto_ltl.planning import product_graph as guide
from pareto_ltl.settings import PlannerConfig
from pareto_ltl.world import cells as workspace
from plane_logic.dijkstra import list_edges, shortest_lead
from problems import KM, box, make_problem, make_scene, two_goals
from strategies import scenes

some = settings(deadline=None, max_examples=40)


def graph_of(problem):
    return guide.product_graph(problem.decomposition, problem.logic, problem.scene.bounds)


@pytest.mark.parametrize("formula", ["F(a & F b)", "!b U a", "F(a & X b)", "F a & F b"])
def test_edges_follow_doors_and_the_automaton(formula):
    problem = two_goals(formula)
    graph, automaton = graph_of(problem), problem.automaton
    cells, diagonal = len(problem.labels), np.linalg.norm(np.diff(problem.scene.bounds, axis=0))
    doors = {tuple(d) for d in problem.decomposition.doors.tolist()}
    doors |= {(j, i) for i, j in doors}
    centre = [workspace.moments(cell)[1] for cell in problem.decomposition.cells]
    heap = guide.empty_heap(graph)
    for q in range(automaton.n_states):
        for r in range(cells):
            z = q * cells + r
            n = list_edges(graph, z, heap)
            found = dict(zip(heap.head[:n].tolist(), heap.metres[:n].tolist(), strict=True))
            expected = {}
            for s in range(cells):
                then = automaton.step(q, problem.labels[s])
                if automaton.trap in (q, then):
                    continue
                if (r, s) in doors or (r == s and then != q):
                    far = np.linalg.norm(centre[r] - centre[s]) / diagonal
                    expected[then * cells + s] = max(far, 1e-3)
            assert found == pytest.approx(expected)


@pytest.mark.parametrize("formula", ["F(a & F b)", "!b U a", "F(a & X b)", "F a & F b"])
def test_arrays_of_states_and_cells_are_those_of_the_automaton_and_the_map(formula):
    problem = two_goals(formula)
    graph, automaton, cells = graph_of(problem), problem.automaton, problem.decomposition.cells
    states = range(automaton.n_states)
    lost = np.array([q == automaton.trap for q in states])
    np.testing.assert_array_equal(graph.goal, automaton.accepting)
    np.testing.assert_array_equal(graph.open, ~lost)
    area = np.array([shapely.Polygon(cell).area for cell in cells])
    np.testing.assert_allclose(graph.volume, area / area.sum())
    np.testing.assert_allclose(graph.urgency[~lost], 1 / (automaton.distance[~lost] + 1))
    assert (graph.urgency[lost] < 1e-5).all()
    assert graph.ahead.tolist() == [0.0] * len(states)
    tail = np.repeat(np.arange(len(cells)), np.diff(graph.ptr))
    found = list(zip(tail.tolist(), graph.beyond.tolist(), strict=True))
    doors = {tuple(door) for door in problem.decomposition.doors.tolist()}
    assert found == sorted({*doors, *((s, r) for r, s in doors), *((r, r) for r in range(len(cells)))})


@pytest.mark.parametrize("formula", ["F(a & F b)", "!b U a", "F(a & X b)", "F a & F b"])
def test_the_network_and_the_arrays_of_the_kernels_are_one_graph(formula):
    problem = two_goals(formula)
    graph, cells = graph_of(problem), len(problem.labels)
    network, heap = guide.product_network(problem.decomposition, problem.logic), guide.empty_heap(graph)
    for q in range(problem.automaton.n_states):
        for r in range(cells):
            heads = set(heap.head[: list_edges(graph, q * cells + r, heap)].tolist())
            beyond = network.adj.get((q, r), {})
            assert heads == {then * cells + s for then, s in beyond}
            assert bool(graph.open[q]) == ((q, r) in network)


@pytest.mark.parametrize(("formula", "places"), [("F(a & F b)", 2), ("F a & F b", 2), ("F a", 1)])
def test_the_cost_ahead_is_a_sum_over_the_letters_that_are_left(formula, places, monkeypatch):
    """Σ c (k + 1)² over the letters k = 1..d; c is the median way from a place to the nearest other one."""
    monkeypatch.setattr(guide, "EXACT_LEADS", 0)
    problem = two_goals(formula)
    graph, automaton = graph_of(problem), problem.automaton
    matter = [
        r
        for r, label in enumerate(problem.labels)
        if any(automaton.step(q, label) != automaton.step(q, frozenset()) for q in range(automaton.n_states))
    ]
    assert len(matter) >= places
    tail = np.repeat(np.arange(len(problem.labels)), np.diff(graph.ptr))
    cost = graph.metres / (graph.volume[tail] * graph.volume[graph.beyond])
    network = nx.DiGraph()
    network.add_weighted_edges_from(zip(tail.tolist(), graph.beyond.tolist(), cost.tolist(), strict=True))
    near = []
    for r in matter:
        far = nx.single_source_dijkstra_path_length(network, r)
        near.append(min((far[s] for s in matter if s != r), default=np.inf))
    finite = [far for far in near if np.isfinite(far)]
    letter = np.median(finite) if finite else cost.max()
    left = [0 if np.isinf(d) else int(d) for d in automaton.distance]
    wanted = [letter * sum((k + 1) ** 2 for k in range(1, d + 1)) for d in left]
    np.testing.assert_allclose(graph.ahead, wanted, rtol=1e-9)


def test_the_cells_and_the_automaton_are_graphs_with_their_properties():
    problem = two_goals("F(a & F b)")
    cells, states = problem.decomposition.graph, problem.automaton.graph
    assert {frozenset(edge) for edge in cells.edges} == set(
        map(frozenset, problem.decomposition.doors.tolist())
    )
    for number, node in cells.nodes.items():
        polygon = shapely.Polygon(problem.decomposition.cells[number])
        assert node["label"] == problem.labels[number]
        assert node["area"] == pytest.approx(polygon.area)
        assert node["centre"] == pytest.approx(np.array(polygon.centroid.coords[0]))
    lengths = dict(nx.single_target_shortest_path_length(states, 2))
    assert [states.nodes[q]["accepting"] for q in states] == problem.automaton.accepting.tolist()
    for q in states:  # a letter of no region repeats a state: the shortest words are the shortest paths
        assert states.nodes[q]["distance"] == lengths[q]


def test_the_states_that_the_map_leads_to_end_before_a_closed_region():
    walls = [box(11, 11, 19, 12), box(11, 18, 19, 19), box(11, 12, 12, 18), box(18, 12, 19, 18)]
    scene = make_scene({"a": box(14, 14, 16, 16), "b": box(2, 2, 4, 4)}, walls)
    problem = make_problem("F a & F b", scene)
    start = int(problem.locate(problem.scene.start[None])[0])
    stuck = guide.farthest_states(problem.decomposition, problem.logic, (problem.automaton.initial, start))
    assert stuck == {problem.automaton.step(problem.automaton.initial, {"b"})}
    open_map = make_problem("F a & F b", make_scene({"a": box(14, 14, 16, 16), "b": box(2, 2, 4, 4)}))
    start = int(open_map.locate(open_map.scene.start[None])[0])
    reached = guide.farthest_states(
        open_map.decomposition, open_map.logic, (open_map.automaton.initial, start)
    )
    assert all(open_map.automaton.accepting[q] for q in reached)


def test_states_weigh_volume_and_urgency():
    problem = two_goals()
    graph = graph_of(problem)
    area = np.array([shapely.Polygon(c).area for c in problem.decomposition.cells])
    distance = problem.automaton.distance
    np.testing.assert_allclose(graph.volume, area / area.sum())
    np.testing.assert_allclose(graph.urgency[distance < np.inf], 1 / (distance[distance < np.inf] + 1))
    np.testing.assert_array_equal(graph.goal, distance == 0)


def test_the_lead_is_a_run_of_the_automaton_through_doors():
    problem = two_goals()
    graph, cells = graph_of(problem), len(problem.labels)
    none = np.zeros(len(graph.goal) * cells, np.int64)
    start = int(problem.locate(problem.scene.start[None])[0])
    q = problem.automaton.step(problem.automaton.initial, problem.labels[start])
    lead = shortest_lead(graph, none, none, q * cells + start, guide.empty_heap(graph))
    net = nx.Graph(problem.decomposition.doors.tolist())
    for z, w in pairwise(lead):
        assert net.has_edge(z % cells, w % cells)
        assert w // cells == problem.automaton.step(z // cells, problem.labels[w % cells])
    assert problem.automaton.accepting[lead[-1] // cells]


def test_a_label_that_must_be_read_twice_is_an_edge_from_a_cell_to_itself():
    """F(a & X a): one stays in region a for a step; no door is passed."""
    problem = make_problem("F(a & X a)", make_scene({"a": box(8, 8, 12, 12)}))
    assert len(growth.grow_forest(PlannerConfig(trees=2, n_max=400), problem, SeedSequence(0)).accepted) > 0


@some
@given(scenes())
def test_fans_tile_their_cells(scene):
    decomposition = workspace.decompose(scene)
    fans = guide.cell_fans(decomposition)
    for k, cell in enumerate(decomposition.cells):
        rows = slice(fans.ptr[k], fans.ptr[k + 1])
        triangles, whole = shapely.polygons(fans.corner[rows]), shapely.Polygon(cell)
        areas = shapely.area(triangles)
        assert areas.sum() == pytest.approx(whole.area, rel=1e-9)
        assert shapely.union_all(triangles).symmetric_difference(whole).area < 1e-6 * whole.area
        np.testing.assert_allclose(fans.share[rows], np.cumsum(areas) / areas.sum(), atol=1e-9)


def test_fans_of_a_box_are_two_halves():
    fans = guide.cell_fans(workspace.decompose(make_scene({"a": box(0, 0, 20, 20)}, start=(1, 1))))
    np.testing.assert_allclose(fans.share, [0.5, 1.0])
    assert shapely.area(shapely.polygons(fans.corner)).sum() == pytest.approx((20 * KM) ** 2)


def test_up_to_the_limit_of_states_leads_are_exact_and_beyond_it_costs_are_estimated(monkeypatch):
    problem = two_goals("F(a & F b)")
    size = len(problem.labels) * problem.automaton.n_states
    start = (problem.automaton.initial, int(problem.locate(problem.scene.start[None])[0]))
    for limit, exact in ((size, True), (size - 1, False)):
        monkeypatch.setattr(guide, "EXACT_LEADS", limit)
        assert (graph_of(problem).ahead == 0.0).all() == exact
        assert bool(guide.farthest_states(problem.decomposition, problem.logic, start)) == exact
