"""The graph of the high-level planner: product of cells and automaton (Section IV-B).

Product states are numbered z = q * C + r. An edge leads from (q, r) through a door, an edge that two cells
share, to (delta(q, label(r')), r'), or stays in r where reading its label again changes q. No edge leads to
states from which the mission cannot be completed. A label that depends on time is taken in the epoch in which
it helps most: a lead is an order of cells and states, without times.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.kernels.growth import Fans
from pareto_ltl.planning.pack_logic import helpful_delta
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.world.cells import Decomposition
from plane_logic.dijkstra import Heap, Product
from plane_logic.types import Logic

if TYPE_CHECKING:
    import networkx as nx

EXACT_LEADS = 20_000  # up to so many product states leads are exact shortest paths


def product_graph(decomposition: Decomposition, logic: Logic, bounds: FloatArray) -> Product:
    """The product graph as arrays for Dijkstra.

    Eq. (M42) of docs/mathematics_methods.md.
    """
    net = decomposition.graph
    cells, states = len(net), len(logic.distance)
    area, centre = (np.array([node[name] for node in net.nodes.values()]) for name in ("area", "centre"))
    diagonal = float(np.linalg.norm(bounds[1] - bounds[0]))
    doors = np.array(net.edges, np.int64).reshape(-1, 2)
    own = np.repeat(np.arange(cells), 2).reshape(-1, 2)
    rows = np.unique(np.vstack([doors, doors[:, ::-1], own]), axis=0)
    tail, head = rows[:, 0], rows[:, 1]
    metres = np.linalg.norm(centre[tail] - centre[head], axis=1) / diagonal
    helpful = helpful_delta(logic)
    graph = Product(
        ptr=np.searchsorted(tail, np.arange(cells + 1)).astype(np.int64),
        beyond=np.ascontiguousarray(head, np.int64),
        metres=np.maximum(metres, 1e-3),  # an edge that stays in its cell has a cost too
        delta=helpful,
        open=np.isfinite(logic.distance),
        volume=area / area.sum(),
        urgency=1.0 / (np.where(np.isinf(logic.distance), 1e6, logic.distance) + 1.0),
        goal=logic.distance == 0.0,
        ahead=np.zeros(states),
    )
    if states * cells <= EXACT_LEADS:
        return graph
    changing = (helpful[:, :-1] != helpful[:, -1:]).any(axis=0)
    return graph._replace(ahead=_cost_ahead(graph, logic.distance, np.flatnonzero(changing)))


def product_network(decomposition: Decomposition, logic: Logic) -> nx.DiGraph:
    """The same graph with one node (state, cell) for each product state, for small problems.

    Edges have the length ``metres`` between the centroids [m]. States from which the mission cannot be
    completed have no node.
    """
    import networkx as nx

    net, helpful = decomposition.graph, helpful_delta(logic)
    network = nx.DiGraph()
    for q in np.flatnonzero(np.isfinite(logic.distance)).tolist():
        for r in net:
            network.add_node((q, r))
            for s in (r, *net[r]):
                then = int(helpful[q, s])
                if np.isfinite(logic.distance[then]) and (s != r or then != q):
                    far = float(np.linalg.norm(net.nodes[r]["centre"] - net.nodes[s]["centre"]))
                    network.add_edge((q, r), (then, s), metres=far)
    return network


def farthest_states(decomposition: Decomposition, logic: Logic, start: tuple[int, int]) -> set[int]:
    """The automaton states nearest to acceptance that the cells lead to from (state, cell) ``start``.

    Empty if the start itself cannot complete the mission, or the product graph is too large to be searched.
    """
    import networkx as nx

    if len(decomposition.cells) * len(logic.distance) > EXACT_LEADS:
        return set()
    network = product_network(decomposition, logic)
    if start not in network:
        return set()
    reached = {q for q, _ in (start, *nx.descendants(network, start))}
    nearest = min(logic.distance[q] for q in reached)
    return {q for q in reached if logic.distance[q] == nearest}


def _cost_ahead(graph: Product, distance: FloatArray, places: IntArray) -> FloatArray:
    """Estimated cost (Q,) from each automaton state to acceptance, where there are no vertices yet.

    The way from one of ``places``, the cells whose labels matter, to the nearest other one costs c at urgency
    1, and c (d + 1)² in states d letters from acceptance; c is the median over ``places``.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    tail = np.repeat(np.arange(len(graph.volume)), np.diff(graph.ptr))
    cost = graph.metres / (graph.volume[tail] * graph.volume[graph.beyond])
    net = csr_matrix((cost, graph.beyond, graph.ptr), shape=(len(graph.volume), len(graph.volume)))
    far = dijkstra(net, indices=places)[:, places]
    np.fill_diagonal(far, np.inf)
    near = far.min(axis=1, initial=np.inf)
    letter = float(np.median(near[np.isfinite(near)])) if np.isfinite(near).any() else float(cost.max())
    d = np.where(np.isinf(distance), 0.0, distance)
    return np.asarray(letter * ((d + 1) * (d + 2) * (2 * d + 3) / 6 - 1.0), float)  # letter Σ_k (k + 1)²


def empty_heap(graph: Product) -> Heap:
    """Memory for one search at a time; memory that is never written is never allocated."""
    cells, states = len(graph.volume), len(graph.goal)
    degree = int(np.diff(graph.ptr).max())
    pushes = len(graph.beyond) * states + 1
    return Heap(
        np.empty(pushes), np.empty(pushes, np.int32), np.empty(states * cells),
        np.empty(states * cells, np.int32), np.zeros(states * cells, np.int32), np.zeros(1, np.int64),
        np.empty(degree, np.int64), np.empty(degree),
    )  # fmt: skip


def cell_fans(decomposition: Decomposition) -> Fans:
    """Cells as fans of triangles, for uniform samples."""
    corners, shares, ptr = [], [], [0]
    for cell in decomposition.cells:
        triangles = np.stack([np.repeat(cell[:1], len(cell) - 2, axis=0), cell[1:-1], cell[2:]], axis=1)
        ab, ac = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        area = np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
        corners.append(triangles)
        shares.append(np.cumsum(area) / area.sum())
        ptr.append(ptr[-1] + len(triangles))
    return Fans(np.array(ptr, np.int64), np.vstack(corners), np.concatenate(shares))
