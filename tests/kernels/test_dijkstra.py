"""The high-level planner's shortest path, against networkx."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto_ltl.kernels.dijkstra import Product, shortest_lead, weigh

some = settings(deadline=None, max_examples=60)


@st.composite
def graphs(draw):
    """A product graph with counts of vertices and selections, and a start."""
    states = draw(st.integers(1, 9))
    pairs = st.tuples(st.integers(0, states - 1), st.integers(0, states - 1))
    edges = np.array(sorted(draw(st.sets(pairs, max_size=40))), np.int64).reshape(-1, 2)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    product = Product(
        ptr=np.searchsorted(edges[:, 0], np.arange(states + 1)).astype(np.int64),
        head=np.ascontiguousarray(edges[:, 1]),
        metres=rng.uniform(0.01, 1.0, len(edges)),
        volume=rng.uniform(0.01, 1.0, states),
        urgency=1.0 / rng.integers(1, 5, states),
        goal=rng.random(states) < 0.3,
    )
    count, selected = rng.integers(0, 50, states), rng.integers(0, 9, states)
    return product, count, selected, draw(st.integers(0, states - 1))


def weights(product, count, selected):
    weight = np.empty(len(product.goal))
    weigh(product, count, selected, weight)
    return weight


def as_network(product, weight):
    net = nx.DiGraph()
    net.add_nodes_from(range(len(product.goal)))
    for z in range(len(product.goal)):
        for e in range(product.ptr[z], product.ptr[z + 1]):
            w = int(product.head[e])
            net.add_edge(z, w, cost=product.metres[e] / (weight[z] * weight[w]))
    return net


@some
@given(graphs())
def test_the_lead_is_a_cheapest_walk_to_a_goal(case):
    product, count, selected, start = case
    lead = shortest_lead(product, count, selected, start)
    net = as_network(product, weights(product, count, selected))
    reached = nx.single_source_dijkstra_path_length(net, start, weight="cost")
    costs = [cost for z, cost in reached.items() if product.goal[z]]
    if not costs:
        assert len(lead) == 0
        return
    assert lead[0] == start
    assert product.goal[lead[-1]]
    assert nx.path_weight(net, lead.tolist(), "cost") == pytest.approx(min(costs), rel=1e-12)


@some
@given(graphs())
def test_a_state_weighs_what_the_formula_says(case):
    product, count, selected, _ = case
    d = 1.0 / product.urgency - 1.0
    expected = (count + 1) * product.volume / ((d + 1) * (selected + 1) ** 2)
    np.testing.assert_allclose(weights(product, count, selected), expected)


def test_a_start_that_is_a_goal_is_the_whole_lead():
    product = Product(
        np.array([0, 1, 1]), np.array([1]), np.ones(1), np.ones(2), np.ones(2), np.array([True, True])
    )
    assert shortest_lead(product, np.zeros(2, np.int64), np.zeros(2, np.int64), 0).tolist() == [0]


def test_a_state_selected_often_is_gone_round():
    """0 -> 1 -> 3 is shorter than 0 -> 2 -> 3, until state 1 has been tried in vain."""
    product = Product(
        ptr=np.array([0, 2, 3, 4, 4]), head=np.array([1, 2, 3, 3]), metres=np.array([1.0, 2.0, 1.0, 2.0]),
        volume=np.ones(4), urgency=np.ones(4), goal=np.array([False, False, False, True]),
    )  # fmt: skip
    none = np.zeros(4, np.int64)
    assert shortest_lead(product, none, none, 0).tolist() == [0, 1, 3]
    assert shortest_lead(product, none, np.array([0, 1, 0, 0]), 0).tolist() == [0, 2, 3]
