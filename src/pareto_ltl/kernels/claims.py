"""The claims about the automaton state by which a path completes its mission at the least risk.

Used by ``simulation.certificates``. Claim q is "the automaton state is at least as good as q".
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pareto_ltl.kernels.jit import allocating
from pareto_ltl.kernels.letters import epoch_at
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray


class ClaimEdges(NamedTuple):
    """The conditions under which claim q becomes claim p in one step.

    Edge i leads from ``source[i]`` = q to ``target[i]`` = p if the position lies in polygon ``shown[i]``
    (-1: anywhere) and outside the polygons ``shunned[ptr[i]:ptr[i + 1]]``, and if the segment to it meets no
    hazard h with ``loses[e, q, h]`` (E, Q, H). At a step of epoch e, given by ``epoch`` (S+1,), the edges
    ``first[e]`` to ``first[e + 1]`` apply.
    """

    source: IntArray
    target: IntArray
    shown: IntArray
    ptr: IntArray
    shunned: IntArray
    loses: BoolArray
    first: IntArray
    epoch: IntArray


class ClaimCosts(NamedTuple):
    """Risk of each condition of an edge at each step; inf if the path breaks the condition.

    ``shown`` (T+1, G): the position is inside a polygon; ``shunned`` (T+1, C): it is outside a polygon;
    ``way`` (T+1, H): the segment to it misses a hazard.
    """

    shown: FloatArray
    shunned: FloatArray
    way: FloatArray


@allocating
def cheapest_claims(edges: ClaimEdges, costs: ClaimCosts, least: FloatArray, via: IntArray) -> None:
    """Fill rows t + 1 of ``least`` (T+2, Q) from row 0, and ``via`` (T+1, Q), the edge taken at each step.

        V_{t+1}(p) = min over edges q → p of V_t(q) + costs of the edge at step t

    Of edges with equal cost the first is taken; ``via`` is -1 if no edge leads to p.
    """
    for t in range(len(via)):
        for p in range(least.shape[1]):
            least[t + 1, p], via[t, p] = math.inf, -1
        e = epoch_at(edges.epoch, t)
        for i in range(edges.first[e], edges.first[e + 1]):
            q, p = edges.source[i], edges.target[i]
            cost = least[t, q]
            if cost >= least[t + 1, p]:
                continue
            if edges.shown[i] >= 0:
                cost += costs.shown[t, edges.shown[i]]
            for k in range(edges.ptr[i], edges.ptr[i + 1]):
                cost += costs.shunned[t, edges.shunned[k]]
            for h in range(edges.loses.shape[2]):
                if edges.loses[e, q, h]:
                    cost += costs.way[t, h]
            if cost < least[t + 1, p]:
                least[t + 1, p], via[t, p] = cost, i
