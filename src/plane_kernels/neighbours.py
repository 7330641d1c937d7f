"""Two indexes of vertices in groups, whose cost stays bounded up to a million vertices.

For the nearest vertex of a group: one k-d tree per group, built by insertion; vertices come in random order,
so that its depth is about 2 ln n. For some vertices near a point: for every square of a grid and state, a
uniform sample (reservoir) of the vertices there.
"""

from __future__ import annotations

from typing import NamedTuple

from numpy.random import Generator

from plane_kernels.types import FloatArray, Int32Array, IntArray, Point
from typed_kernels.jit import kernel


class Bins(NamedTuple):
    """Samples of vertices: one bin for each pair of square and state that has a vertex.

    ``head`` (squares,) is the first bin of a square, ``after`` (N,) the next bin of the same square, sorted
    by ``state`` (N,). 0 means none, so that the system allocates no pages for empty parts. ``seen``
    (N,) is the number of vertices of a bin, ``kept`` (N, capacity) a sample of them, ``used`` (1,) the number
    of bins in use; ``found`` (N,) is scratch.
    """

    head: Int32Array
    after: Int32Array
    state: Int32Array
    seen: Int32Array
    kept: Int32Array
    found: Int32Array
    used: IntArray


@kernel
def kd_insert(x: FloatArray, child: Int32Array, root: Int32Array, group: int, vertex: int) -> None:
    """Insert ``vertex`` into the k-d tree of ``group``; ``child`` (N, 2), ``root`` (groups,), -1 for none."""
    node = root[group]
    if node < 0:
        root[group] = vertex
        return
    axis = 0
    while True:
        side = 0 if x[vertex, axis] < x[node, axis] else 1
        if child[node, side] < 0:
            child[node, side] = vertex
            return
        node = child[node, side]
        axis = 1 - axis


@kernel
def kd_nearest(
    x: FloatArray,
    child: Int32Array,
    root: Int32Array,
    group: int,
    target: Point,
    stack: FloatArray,
) -> int:
    """The vertex of ``group`` nearest to a point; -1 if the group is empty.

    ``stack`` (depth, 4) is scratch: vertex, axis, and the offsets of its box from the point along both axes.
    A box is skipped by its distance, not by its offset along one axis: at 81,000 vertices a query then visits
    158 vertices instead of 811.
    """
    px, py = target
    best, best_d = -1, 1e300
    if root[group] < 0:
        return best
    top = 0
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = root[group], 0.0, 0.0, 0.0
    while top >= 0:
        node, axis, ox, oy = int(stack[top, 0]), int(stack[top, 1]), stack[top, 2], stack[top, 3]
        top -= 1
        if ox * ox + oy * oy >= best_d:
            continue
        while node >= 0:
            dx, dy = px - x[node, 0], py - x[node, 1]
            d = dx * dx + dy * dy
            if d < best_d:
                best, best_d = node, d
            gap = dx if axis == 0 else dy
            side = 0 if gap < 0.0 else 1
            far = child[node, 1 - side]
            fx, fy = (gap, oy) if axis == 0 else (ox, gap)
            axis = 1 - axis
            if far >= 0 and fx * fx + fy * fy < best_d and top + 1 < len(stack):
                top += 1
                stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3] = far, axis, fx, fy
            node = child[node, side]
    return best


@kernel
def remember(kept: Int32Array, seen: Int32Array, square: int, vertex: int, rng: Generator) -> None:
    """Vitter's algorithm R: keep ``kept[square]`` a uniform sample of all vertices that were added."""
    seen[square] += 1
    capacity = kept.shape[1]
    if seen[square] <= capacity:
        kept[square, seen[square] - 1] = vertex
    else:
        place = int(rng.random() * seen[square])
        if place < capacity:
            kept[square, place] = vertex


@kernel
def bin_of(bins: Bins, square: int, state: int) -> int:
    """The bin of a square and a state; it is made if there is none."""
    before, b = 0, bins.head[square]
    while b > 0 and bins.state[b] < state:
        before, b = b, bins.after[b]
    if b > 0 and bins.state[b] == state:
        return int(b)
    bins.used[0] += 1
    new = int(bins.used[0])
    bins.state[new], bins.after[new] = state, b
    if before > 0:
        bins.after[before] = new
    else:
        bins.head[square] = new
    return new
