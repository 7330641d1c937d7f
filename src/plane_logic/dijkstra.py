"""Shortest paths over product states (automaton state, cell), weighted towards what is little explored."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plane_kernels.types import BoolArray, FloatArray, Int32Array, IntArray
from typed_kernels.jit import allocating, inlined, kernel


class Product(NamedTuple):
    """Product graph of automaton and cells; state z = q * C + r.

    From cell r, edges lead to the cells ``beyond[ptr[r]:ptr[r + 1]]``, ascending. These include r itself,
    whose label is read again. The automaton state after cell r' is ``delta[q, r']``. Edges that change
    neither cell nor state are left out, and edges from or to states that are not ``open`` (Q,), which cannot
    complete the mission.

    ``metres`` (D,): distance of the centroids divided by the diagonal of the map; ``volume`` (C,): area of a
    cell as a share of the map; ``urgency`` (Q,): 1 / (d_A(q) + 1); ``goal`` (Q,): whether q accepts;
    ``ahead`` (Q,): estimated cost from q to acceptance, 0 in small graphs, whose leads are the shortest.
    """

    ptr: IntArray
    beyond: IntArray
    metres: FloatArray
    delta: IntArray
    open: BoolArray
    volume: FloatArray
    urgency: FloatArray
    goal: BoolArray
    ahead: FloatArray


class Heap(NamedTuple):
    """Memory of a search: a binary heap of states ``item`` by ``key``, and the results so far.

    ``cost`` and ``previous`` (Z,) are valid in search number s = ``search[0]`` for states with ``reached``
    (Z,) = 2 s, or 2 s + 1 once they are final; ``head`` and ``metres`` hold the edges of one state.
    """

    key: FloatArray
    item: Int32Array
    cost: FloatArray
    previous: Int32Array
    reached: Int32Array
    search: IntArray
    head: IntArray
    metres: FloatArray


@kernel
def _push(heap: Heap, size: int, key: float, item: int) -> int:
    i = size
    while i > 0 and heap.key[(i - 1) // 2] > key:
        heap.key[i], heap.item[i] = heap.key[(i - 1) // 2], heap.item[(i - 1) // 2]
        i = (i - 1) // 2
    heap.key[i], heap.item[i] = key, item
    return size + 1


@kernel
def _pop(heap: Heap, size: int) -> int:
    """Remove the entry with the smallest key, which the caller has read; return the new size."""
    size -= 1
    key, item = heap.key[size], heap.item[size]
    i = 0
    while True:
        j = 2 * i + 1
        if j >= size:
            break
        if j + 1 < size and heap.key[j + 1] < heap.key[j]:
            j += 1
        if heap.key[j] >= key:
            break
        heap.key[i], heap.item[i] = heap.key[j], heap.item[j]
        i = j
    heap.key[i], heap.item[i] = key, item
    return size


@inlined
def state_weight(product: Product, count: IntArray, selected: IntArray, z: int) -> float:
    """w(z) = (cov + 1) vol(r) / ((d_A(q) + 1) (numsel + 1)²), cov the number of vertices in Γ_z.

    Eq. (M42) of docs/mathematics_methods.md.
    """
    cells, s = len(product.volume), selected[z] + 1.0
    return float((count[z] + 1.0) * product.volume[z % cells] * product.urgency[z // cells] / (s * s))


@kernel
def list_edges(product: Product, z: int, heap: Heap) -> int:
    """Write the edges of state ``z`` to ``heap.head`` and ``heap.metres``, by head; return their number."""
    cells = len(product.volume)
    q, r = z // cells, z % cells
    found = 0
    if not product.open[q]:
        return found
    for e in range(product.ptr[r], product.ptr[r + 1]):
        then = product.delta[q, product.beyond[e]]
        if not product.open[then] or (product.beyond[e] == r and then == q):
            continue
        head, k = then * cells + product.beyond[e], found
        while k > 0 and heap.head[k - 1] > head:
            heap.head[k], heap.metres[k] = heap.head[k - 1], heap.metres[k - 1]
            k -= 1
        heap.head[k], heap.metres[k] = head, product.metres[e]
        found += 1
    return found


@kernel
def find_lead(
    product: Product, count: IntArray, selected: IntArray, start: int, heap: Heap, lead: IntArray,
    weight: FloatArray,
) -> int:  # fmt: skip
    """Shortest path from ``start`` to a goal with edge cost metres / (w w'), by Dijkstra's algorithm.

    With ``product.ahead`` above 0, this is A* with that estimate, whose path need not be the shortest. Fills
    ``lead`` from the start on, and ``weight`` with the weights of its states; returns the number of states, 0
    if no goal can be reached.

    Eq. (M42) of docs/mathematics_methods.md.
    """
    cost, previous, reached, cells = heap.cost, heap.previous, heap.reached, len(product.volume)
    heap.search[0] += 1
    now = 2 * heap.search[0]
    cost[start], previous[start], reached[start] = 0.0, -1, now
    size = _push(heap, 0, product.ahead[start // cells], start)
    goal = -1
    while size > 0:
        z = int(heap.item[0])
        size = _pop(heap, size)
        if reached[z] == now + 1:
            continue
        reached[z] = now + 1
        if product.goal[z // cells]:
            goal = z
            break
        own = state_weight(product, count, selected, z)
        for e in range(list_edges(product, z, heap)):
            w = heap.head[e]
            if reached[w] == now + 1:
                continue
            reach = cost[z] + heap.metres[e] / (own * state_weight(product, count, selected, w))
            if reached[w] < now or reach < cost[w]:
                cost[w], previous[w], reached[w] = reach, z, now
                size = _push(heap, size, reach + product.ahead[w // cells], w)
    return trace_lead(previous, goal, lead, weight, product, count, selected)


@inlined
def trace_lead(
    previous: Int32Array, goal: int, lead: IntArray, weight: FloatArray, product: Product, count: IntArray,
    selected: IntArray,
) -> int:  # fmt: skip
    """Fill ``lead`` with the states up to ``goal``, and ``weight`` with their weights; return how many."""
    length, z = 0, goal
    while z >= 0:
        lead[length] = z
        length += 1
        z = previous[z]
    for i in range(length // 2):
        lead[i], lead[length - 1 - i] = lead[length - 1 - i], lead[i]
    for i in range(length):
        weight[i] = state_weight(product, count, selected, lead[i])
    return length


@allocating
def shortest_lead(product: Product, count: IntArray, selected: IntArray, start: int, heap: Heap) -> IntArray:
    """One lead, for callers in Python: numbers of states from ``start`` to a goal; empty if there is none."""
    lead, weight = np.empty(len(count), np.int64), np.empty(len(count))
    return lead[: find_lead(product, count, selected, start, heap, lead, weight)]
