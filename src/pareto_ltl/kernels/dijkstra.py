"""The high-level planner's shortest path over product states (automaton state, cell)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pareto_ltl.kernels.jit import allocating, kernel
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray


class Product(NamedTuple):
    """Product graph; state z = q * C + r, edges of z in rows ``ptr[z]`` to ``ptr[z + 1]``.

    ``metres`` (E,) centroid distances over the diagonal of the map; ``volume`` (Z,) share of the map;
    ``urgency`` (Z,) 1 / (d_A(q) + 1); ``goal`` (Z,) accepting.
    """

    ptr: IntArray
    head: IntArray
    metres: FloatArray
    volume: FloatArray
    urgency: FloatArray
    goal: BoolArray


class Heap(NamedTuple):
    """A binary heap of states with their keys, and where the search stands."""

    key: FloatArray
    item: IntArray
    cost: FloatArray
    previous: IntArray


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
    """Remove the smallest entry (it was read before); return the new size."""
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


@kernel
def weigh(product: Product, count: IntArray, selected: IntArray, weight: FloatArray) -> None:
    """w(z) = (cov + 1) vol(r) / ((d_A(q) + 1) (numsel + 1)²), cov the number of vertices in Γ_z."""
    for z in range(len(weight)):
        s = selected[z] + 1.0
        weight[z] = (count[z] + 1.0) * product.volume[z] * product.urgency[z] / (s * s)


@kernel
def find_lead(product: Product, weight: FloatArray, start: int, heap: Heap, lead: IntArray) -> int:
    """Dijkstra from ``start`` to the nearest goal under cost metres / (w w').

    Fills ``lead`` from the start on and returns its length, 0 where no goal can be reached.
    """
    cost, previous = heap.cost, heap.previous
    cost[:] = math.inf
    cost[start] = 0.0
    previous[start] = -1
    size = _push(heap, 0, 0.0, start)
    goal = -1
    while size > 0:
        key, z = heap.key[0], heap.item[0]
        size = _pop(heap, size)
        if key > cost[z]:
            continue
        if product.goal[z]:
            goal = z
            break
        for e in range(product.ptr[z], product.ptr[z + 1]):
            w = product.head[e]
            reach = key + product.metres[e] / (weight[z] * weight[w])
            if reach < cost[w]:
                cost[w] = reach
                previous[w] = z
                size = _push(heap, size, reach, w)
    if goal < 0:
        return 0
    length = 0
    z = goal
    while z >= 0:
        lead[length] = z
        length += 1
        z = previous[z]
    for i in range(length // 2):
        lead[i], lead[length - 1 - i] = lead[length - 1 - i], lead[i]
    return length


@allocating
def shortest_lead(product: Product, count: IntArray, selected: IntArray, start: int) -> IntArray:
    """One lead by itself, for the uncompiled world: state numbers from ``start`` to a goal."""
    states, edges = len(product.goal), len(product.head)
    heap = Heap(
        np.empty(edges + 1), np.empty(edges + 1, np.int64), np.empty(states), np.empty(states, np.int64)
    )
    weight, lead = np.empty(states), np.empty(states, np.int64)
    weigh(product, count, selected, weight)
    return lead[: find_lead(product, weight, start, heap, lead)]
