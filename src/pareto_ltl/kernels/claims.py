"""Which claims about the automaton a flight rests on at least risk (``simulation.certificates``)."""

from __future__ import annotations

import math
from typing import NamedTuple

from pareto_ltl.kernels.jit import allocating
from pareto_ltl.kernels.letters import epoch_at
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray


class ClaimEdges(NamedTuple):
    """How "the state is at least as good as q" becomes "at least as good as p" in one step.

    Edge i leads from ``source`` q to ``target`` p (E,) if the position lies in the polygon ``shown`` (E,),
    -1 for any position, and outside of the polygons ``shunned[ptr[i]:ptr[i + 1]]``, and if the way to it
    meets no hazard that ``loses`` (E, Q, H) q. At a step of epoch e, by ``epoch`` (S+1,), there are the edges
    ``first[e]`` to ``first[e + 1]``.
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
    """What each condition of an edge costs, step by step, inf where it is broken.

    ``shown`` (T+1, G): inside of a polygon; ``shunned`` (T+1, C): outside of one; ``way`` (T+1, H): clear of
    a hazard.
    """

    shown: FloatArray
    shunned: FloatArray
    way: FloatArray


@allocating
def cheapest_claims(edges: ClaimEdges, costs: ClaimCosts, least: FloatArray, via: IntArray) -> None:
    """Fill rows t + 1 of ``least`` (T+2, Q) from row 0, and ``via`` (T+1, Q), the edge taken at each step.

        V_{t+1}(p) = min over edges q → p of V_t(q) + costs of the edge at step t

    Of equal edges the first is taken; where no edge leads to p, ``via`` is -1.
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
