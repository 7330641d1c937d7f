"""Bounds on the probability of missing the mission: the paper's f_o and the ordered bound V."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.kernels.data import Cov, Gaussian, Ordered, Point, Theorem2
from pareto_ltl.kernels.gaussian import inside, region_missed
from pareto_ltl.kernels.geometry import locate_cell
from pareto_ltl.kernels.jit import allocating, kernel
from pareto_ltl.kernels.polygon import polygon_probability
from pareto_ltl.support.arrays import FloatArray, IntArray

TINY = 1e-13  # below this the exact probability is all rounding: half planes instead
CERTAIN = 8.0  # standard deviations; what lies farther away has probability below 1e-15

# --- f_o of the paper -------------------------------------------------------------------------


@kernel
def visit_risk(bound: Theorem2, atom: int, cell: int, here: Gaussian, before: float) -> float:
    """f_o^i (Theorem 1) after a step into ``cell``: the least risk over all visits, -1 before the first."""
    if not bound.holds[cell, atom]:
        return before
    now = region_missed(bound.faces, bound.atom, atom, here)
    return now if before < 0.0 else min(before, now)


@allocating
def theorem2_risks(bound: Theorem2, x: FloatArray, cov: FloatArray, cell: IntArray) -> FloatArray:
    """f_o^i of every proposition along a path, (P,); 0 where it is never visited.

    ``x`` (T+1, 2), ``cov`` (T+1, 3) = (xx, xy, yy), ``cell`` (T+1,).
    """
    risks = np.empty(bound.holds.shape[1])
    for atom in range(len(risks)):
        risk = -1.0
        for t in range(len(x)):
            here = Gaussian(Point(x[t, 0], x[t, 1]), Cov(cov[t, 0], cov[t, 1], cov[t, 2]))
            risk = visit_risk(bound, atom, cell[t], here, risk)
        risks[atom] = max(risk, 0.0)
    return risks


# --- the ordered bound V ----------------------------------------------------------------------


@kernel
def label_probability(bound: Ordered, part: int, here: Gaussian, width: float) -> float:
    """P(position in labelled cell ``part``); ``width`` ≥ the largest standard deviation [m]."""
    labelled = bound.labelled
    dx, dy = here.mean.x - labelled.middle[part, 0], here.mean.y - labelled.middle[part, 1]
    reach = labelled.radius[part] + CERTAIN * width
    if dx * dx + dy * dy > reach * reach:
        return 0.0
    bound_inside = inside(bound.cells.faces, labelled.cell[part], here)
    if bound_inside <= TINY:
        return bound_inside
    return polygon_probability(labelled, part, here)


@kernel
def read_labels(bound: Ordered, here: Gaussian, seen: FloatArray) -> None:
    """Fill ``seen`` (L + 1,): P(each labelled cell), and last P(no label)."""
    cells = len(bound.labelled.cell)
    rest = 1.0
    known = here.cov.xx <= 0.0 or here.cov.yy <= 0.0
    cell = locate_cell(bound.cells, here.mean) if known else -1
    width = math.sqrt(here.cov.xx + here.cov.yy)
    for part in range(cells):
        if known:
            seen[part] = 1.0 if bound.labelled.cell[part] == cell else 0.0
        else:
            seen[part] = label_probability(bound, part, here, width)
        rest -= seen[part]
    seen[cells] = min(max(rest, 0.0), 1.0)


@kernel
def begin_bound(bound: Ordered, now: FloatArray, target: int) -> None:
    """V(p) before the first letter: 0 where the initial state accepts all that p accepts, else 1."""
    for p in range(now.shape[1]):
        now[target, p] = 0.0 if bound.logic.covers[bound.logic.initial, p] else 1.0


@kernel
def read_letter(
    bound: Ordered, before: FloatArray, row: int, seen: FloatArray, now: FloatArray, target: int
) -> None:
    """V after one more letter into ``now[target]`` from ``before[row]``, both (., Q),

    V_t(p) = min(1, min_q [V_{t-1}(q) + P(label not in {s : δ(q, s) ≥ p})]).
    """
    spoils, states = bound.logic.spoils, now.shape[1]
    cells = len(bound.labelled.cell)
    empty = spoils.shape[1] - 1
    for p in range(states):
        best = 1.0
        for q in range(states):
            v = before[row, q]
            if v >= best:
                continue
            if spoils[q, empty, p]:
                v += seen[cells]
            for part in range(cells):
                if seen[part] > 0.0 and spoils[q, bound.labelled.cell[part], p]:
                    v += seen[part]
            best = min(best, v)
        now[target, p] = best


@kernel
def add_risk(now: FloatArray, row: int, risk: float) -> None:
    """Raise V of every state in a row by a risk that all that follows rests upon."""
    if risk > 0.0:
        for p in range(now.shape[1]):
            now[row, p] = min(now[row, p] + risk, 1.0)


@allocating
def ordered_risk(bound: Ordered, x: FloatArray, cov: FloatArray, miss: FloatArray) -> float:
    """V of a whole path; ``x`` (T+1, 2), ``cov`` (T+1, 3) = (xx, xy, yy), ``miss`` (T+1,) = P(landmark
    missed)."""
    v = np.empty((2, len(bound.logic.distance)))
    seen = np.empty(len(bound.labelled.cell) + 1)
    begin_bound(bound, v, 0)
    for t in range(len(x)):
        here = Gaussian(Point(x[t, 0], x[t, 1]), Cov(cov[t, 0], cov[t, 1], cov[t, 2]))
        read_labels(bound, here, seen)
        read_letter(bound, v, t % 2, seen, v, (t + 1) % 2)
        add_risk(v, (t + 1) % 2, miss[t])
    least = 1.0
    for p in range(v.shape[1]):
        if bound.logic.distance[p] == 0.0:
            least = min(least, v[len(x) % 2, p])
    return least
