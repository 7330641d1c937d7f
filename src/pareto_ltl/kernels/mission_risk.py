"""The ordered mission risk V (DESIGN 4.4) and the exact probabilities of labels behind it."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.kernels.data import Labelled, Tables
from pareto_ltl.kernels.gaussian import inside
from pareto_ltl.kernels.geometry import locate
from pareto_ltl.kernels.jit import allocating, kernel
from pareto_ltl.support.arrays import FloatArray

TINY = 1e-13  # below this the exact probability is all rounding: half planes instead
CERTAIN = 8.0  # standard deviations; what lies farther away has probability below 1e-15
DEEP = 8.3  # exp(-x²/2) is below 1e-15 from here on

# Gauss-Legendre on [0, 1]. Twelve nodes give Owen's T to 1e-16 for |a| ≤ 1, since the integrand is cut off
# where it has died away.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
TURN = 2.0 * math.pi


@kernel
def owens_t(h: float, a: float) -> float:
    """T(h, a) = 1/2π ∫_0^a exp(-h² (1 + t²) / 2) / (1 + t²) dt for h ≥ 0 (Owen, Ann. Math. Stat. 27, 1956).

    T is odd in a; beyond |a| = 1 it is T(h, a) = ½ (Q(h) + Q(a h)) - Q(h) Q(a h) - T(a h, 1/a), Q = 1 - Φ.
    """
    b = abs(a)
    if h > DEEP:
        return 0.0
    if b <= 1.0:
        t = _owens(h, b)
    elif b == math.inf:
        t = 0.5 * _upper(h)
    else:
        q, r = _upper(h), _upper(b * h)
        t = 0.5 * (q + r) - q * r - _owens(b * h, 1.0 / b)
    return t if a >= 0.0 else -t


@kernel
def _owens(h: float, a: float) -> float:
    if h > DEEP:
        return 0.0
    b = a if a * h <= DEEP else DEEP / h
    total, half = 0.0, -0.5 * h * h
    for i in range(len(NODES)):
        t = b * NODES[i]
        s = 1.0 + t * t
        total += WEIGHTS[i] * math.exp(half * s) / s
    return total * b / TURN


@kernel
def _upper(h: float) -> float:
    return 0.5 * math.erfc(h / math.sqrt(2.0))


@kernel
def polygon_probability(
    labelled: Labelled, part: int, x: float, y: float, cxx: float, cxy: float, cyy: float
) -> float:
    """P(N((x, y), Σ) in the polygon), exact (``planning.reference.polygon_probability``)."""
    corner, first, last = labelled.corner, labelled.ptr[part], labelled.ptr[part + 1]
    a = math.sqrt(cxx)
    b = cxy / a
    c = math.sqrt(max(cyy - b * b, 1e-12 * cyy))
    total = 0.0
    dx, dy = corner[last - 1, 0] - x, corner[last - 1, 1] - y
    px, py = dx / a, (dy - b * dx / a) / c
    for k in range(first, last):
        dx, dy = corner[k, 0] - x, corner[k, 1] - y
        qx, qy = dx / a, (dy - b * dx / a) / c
        ex, ey = qx - px, qy - py
        size = math.sqrt(ex * ex + ey * ey)
        if size > 0.0:
            ex, ey = ex / size, ey / size
            h = px * ey - py * ex
            v1 = px * ex + py * ey
            v2 = v1 + size
            g = max(abs(h), 1e-300)
            share = (math.atan2(v2, g) - math.atan2(v1, g)) / TURN
            share -= owens_t(g, v2 / g) - owens_t(g, v1 / g)
            total += share if h > 0.0 else -share
        px, py = qx, qy
    return min(max(total, 0.0), 1.0)


@kernel
def shown(
    tables: Tables, part: int, x: float, y: float, cxx: float, cxy: float, cyy: float, width: float
) -> float:
    """P(position in labelled cell ``part``); ``width`` ≥ the largest standard deviation."""
    labelled = tables.labelled
    dx, dy = x - labelled.middle[part, 0], y - labelled.middle[part, 1]
    reach = labelled.radius[part] + CERTAIN * width
    if dx * dx + dy * dy > reach * reach:
        return 0.0
    bound = inside(tables.cells.faces, labelled.cell[part], x, y, cxx, cxy, cyy)
    if bound <= TINY:
        return bound
    return polygon_probability(labelled, part, x, y, cxx, cxy, cyy)


@kernel
def read_label(
    tables: Tables, x: float, y: float, cxx: float, cxy: float, cyy: float, seen: FloatArray
) -> None:
    """Fill ``seen`` (L + 1,): P(each labelled cell), and last P(no label)."""
    cells = len(tables.labelled.cell)
    rest = 1.0
    known = cxx <= 0.0 or cyy <= 0.0
    here = locate(tables.cells, x, y) if known else -1
    width = math.sqrt(cxx + cyy)
    for part in range(cells):
        if known:
            seen[part] = 1.0 if tables.labelled.cell[part] == here else 0.0
        else:
            seen[part] = shown(tables, part, x, y, cxx, cxy, cyy, width)
        rest -= seen[part]
    seen[cells] = min(max(rest, 0.0), 1.0)


@kernel
def after(
    tables: Tables, before: FloatArray, row: int, seen: FloatArray, now: FloatArray, target: int
) -> None:
    """V_t(p) = min(1, min_q [V_{t-1}(q) + P(label not in {s : δ(q, s) ≥ p})]) into ``now[target]``."""
    spoils, states = tables.logic.spoils, now.shape[1]
    cells = len(tables.labelled.cell)
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
                if seen[part] > 0.0 and spoils[q, tables.labelled.cell[part], p]:
                    v += seen[part]
            best = min(best, v)
        now[target, p] = best


@kernel
def add(now: FloatArray, row: int, risk: float) -> None:
    """Let every V of a row grow by a risk that whatever follows rests upon."""
    if risk > 0.0:
        for p in range(now.shape[1]):
            now[row, p] = min(now[row, p] + risk, 1.0)


@kernel
def begin(tables: Tables, now: FloatArray, target: int) -> None:
    """V(p) before the first letter: 0 where the initial state accepts all that p accepts, else 1."""
    for p in range(now.shape[1]):
        now[target, p] = 0.0 if tables.logic.covers[tables.logic.initial, p] else 1.0


@allocating
def mission_bound(tables: Tables, x: FloatArray, cov: FloatArray, miss: FloatArray) -> float:
    """V of a whole path; ``x`` (T+1, 2), ``cov`` (T+1, 3) = (xx, xy, yy), ``miss`` (T+1,) = P(landmark
    missed).
    """
    v = np.empty((2, len(tables.logic.distance)))
    seen = np.empty(len(tables.labelled.cell) + 1)
    begin(tables, v, 0)
    for t in range(len(x)):
        read_label(tables, x[t, 0], x[t, 1], cov[t, 0], cov[t, 1], cov[t, 2], seen)
        after(tables, v, t % 2, seen, v, (t + 1) % 2)
        add(v, (t + 1) % 2, miss[t])
    least = 1.0
    for p in range(v.shape[1]):
        if tables.logic.distance[p] == 0.0:
            least = min(least, v[len(x) % 2, p])
    return least


@allocating
def polygon_probabilities(labelled: Labelled, x: FloatArray, cov: FloatArray) -> FloatArray:
    """:func:`polygon_probability` of the first polygon for every row of ``x`` (n, 2) and ``cov`` (n, 3)."""
    found = np.empty(len(x))
    for i in range(len(x)):
        c = cov[i]
        found[i] = polygon_probability(labelled, 0, x[i, 0], x[i, 1], c[0], c[1], c[2])
    return found


@allocating
def owens_ts(h: FloatArray, a: FloatArray) -> FloatArray:
    """:func:`owens_t` for every pair."""
    found = np.empty(len(h))
    for i in range(len(h)):
        found[i] = owens_t(h[i], a[i])
    return found
