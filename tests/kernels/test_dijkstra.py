"""The high-level planner's shortest path, against networkx."""

from __future__ import annotations

from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto_ltl.planning.product_graph import empty_heap
from plane_logic.dijkstra import Product, find_lead, list_edges, shortest_lead

some = settings(deadline=None, max_examples=100)


@st.composite
def graphs(draw):
    """Cells with doors and a random automaton; counts of vertices and selections, and a start."""
    cells, states = draw(st.integers(1, 6)), draw(st.integers(1, 4))
    pairs = st.tuples(st.integers(0, cells - 1), st.integers(0, cells - 1))
    doors = draw(st.sets(pairs, max_size=20))
    edges = np.array(sorted(doors | {(r, r) for r in range(cells)}), np.int64)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    product = Product(
        ptr=np.searchsorted(edges[:, 0], np.arange(cells + 1)).astype(np.int64),
        beyond=np.ascontiguousarray(edges[:, 1]),
        metres=rng.uniform(0.01, 1.0, len(edges)),
        delta=rng.integers(0, states, (states, cells + 1)),
        open=rng.random(states) < 0.9,
        volume=rng.uniform(0.01, 1.0, cells),
        urgency=1.0 / rng.integers(1, 5, states),
        goal=rng.random(states) < 0.3,
        ahead=np.zeros(states),
    )
    size = cells * states
    count, selected = rng.integers(0, 50, size), rng.integers(0, 9, size)
    return product, count, selected, draw(st.integers(0, size - 1))


def weights(product, count, selected):
    w = (count + 1) * np.tile(product.volume, len(product.goal))
    return w * np.repeat(product.urgency, len(product.volume)) / (selected + 1.0) ** 2


def edges_of(product):
    """Rows (z, z', metres) by the definition."""
    cells = len(product.volume)
    for z in range(cells * len(product.goal)):
        q, r = divmod(z, cells)
        for e in range(product.ptr[r], product.ptr[r + 1]):
            s = int(product.beyond[e])
            then = int(product.delta[q, s])
            if product.open[q] and product.open[then] and (s != r or then != q):
                yield z, then * cells + s, product.metres[e]


def as_network(product, weight):
    net = nx.DiGraph()
    net.add_nodes_from(range(len(weight)))
    for z, w, metres in edges_of(product):
        net.add_edge(z, w, cost=metres / (weight[z] * weight[w]))
    return net


@some
@given(graphs())
def test_edges_come_by_their_heads(case):
    product, count, *_ = case
    heap, found = empty_heap(product), []
    for z in range(len(count)):
        n = list_edges(product, z, heap)
        assert np.all(np.diff(heap.head[:n]) > 0)
        found += [(z, w, metres) for w, metres in zip(heap.head[:n], heap.metres[:n], strict=True)]
    assert sorted(found) == sorted(edges_of(product))


@some
@given(graphs())
def test_the_lead_is_a_cheapest_walk_to_a_goal(case):
    product, count, selected, start = case
    lead = shortest_lead(product, count, selected, start, empty_heap(product))
    net = as_network(product, weights(product, count, selected))
    reached = nx.single_source_dijkstra_path_length(net, start, weight="cost")
    costs = [cost for z, cost in reached.items() if product.goal[z // len(product.volume)]]
    if not costs:
        assert len(lead) == 0
        return
    assert lead[0] == start
    assert product.goal[lead[-1] // len(product.volume)]
    assert nx.path_weight(net, lead.tolist(), "cost") == pytest.approx(min(costs), rel=1e-12)


@some
@given(graphs(), st.floats(0.0, 100.0))
def test_with_a_cost_ahead_a_lead_still_follows_edges_to_a_goal(case, worth):
    product, count, selected, start = case
    ahead = worth * np.arange(len(product.goal), dtype=float)
    hurried = product._replace(ahead=ahead)
    lead = shortest_lead(hurried, count, selected, start, empty_heap(hurried))
    shortest = shortest_lead(product, count, selected, start, empty_heap(product))
    assert (len(lead) == 0) == (len(shortest) == 0)
    net = as_network(product, weights(product, count, selected))
    assert all(net.has_edge(z, w) for z, w in pairwise(lead.tolist()))
    if len(lead):
        assert product.goal[lead[-1] // len(product.volume)]


@some
@given(graphs())
def test_the_memory_of_one_search_serves_the_next(case):
    product, count, selected, start = case
    heap, lead, weight = empty_heap(product), np.empty(len(count), np.int64), np.empty(len(count))
    lengths = []
    for _ in range(3):
        lengths.append(find_lead(product, count, selected, start, heap, lead, weight))
        np.testing.assert_allclose(
            weight[: lengths[-1]], weights(product, count, selected)[lead[: lengths[-1]]]
        )
    assert len(set(lengths)) == 1


def test_a_start_that_is_a_goal_is_the_whole_lead():
    product = Product(
        np.array([0, 2]), np.array([0, 0]), np.ones(2), np.zeros((1, 2), np.int64), np.array([True]),
        np.ones(1), np.ones(1), np.array([True]), np.zeros(1),
    )  # fmt: skip
    lead = shortest_lead(product, np.zeros(1, np.int64), np.zeros(1, np.int64), 0, empty_heap(product))
    assert lead.tolist() == [0]
