"""Exact evaluation of one path: what a vertex of a tree costs, computed along the way."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.arrays import FloatArray, IntArray
from pareto_ltl.kernels.gaussian import SQRT_HALF, inside, missed
from pareto_ltl.kernels.geometry import SLACK, clear_faces, locate
from pareto_ltl.kernels.jit import allocating, kernel
from pareto_ltl.kernels.lattice import airspeed, drift, spread
from pareto_ltl.kernels.tables import Tables

FLOWN, TOO_FAST, UNKNOWN_WIND, OFF_MAP, CROSSING = range(5)


@kernel
def _shared(masks: IntArray) -> bool:
    for j in range(masks.shape[1]):  # noqa: SIM110
        if masks[0, j] & masks[1, j] == 0:
            return False
    return True


@allocating
def evaluate(
    tables: Tables, x: FloatArray, variance: float, fast: float,
    cov: FloatArray, u: FloatArray, q: IntArray, cell: IntArray, risk: FloatArray, touch: FloatArray,
) -> tuple[int, int]:  # fmt: skip
    """Fly the means ``x`` (T+1, 2) from a start of the given ``variance``.

    Fills ``cov`` (T+1, 3), ``u`` (T, 2), ``q``, ``cell`` (T+1,), ``risk`` (P,) = f_o^i and ``touch`` (T+1, m)
    = Eq. (10) for every step and obstacle. Returns what went wrong first, and at which step. ``fast`` is
    the factor by which u_max may be exceeded.
    """
    m, atoms = len(tables.obstacles.ptr) - 1, len(risk)
    masks = np.zeros((2, m), np.int64)  # of this step and of the one before
    risk[:] = -1.0
    cov[0, 0], cov[0, 1], cov[0, 2] = variance, 0.0, variance
    state = tables.logic.initial
    for t in range(len(x)):
        if t > 0:
            if t - 1 >= len(tables.wind.slot):
                return UNKNOWN_WIND, t
            fx, fy = drift(tables.wind, tables.motion, t - 1, x[t - 1, 0], x[t - 1, 1])
            dx, dy = x[t, 0] - fx, x[t, 1] - fy
            b, dt = tables.motion.b_inv, tables.motion.dt
            u[t - 1, 0] = (b[0, 0] * dx + b[0, 1] * dy) / dt
            u[t - 1, 1] = (b[1, 0] * dx + b[1, 1] * dy) / dt
            if airspeed(tables.motion, dx, dy) > tables.motion.u_max * fast:
                return TOO_FAST, t
            c = cov[t - 1]
            cov[t, 0], cov[t, 1], cov[t, 2] = spread(
                tables.wind, tables.motion, t - 1, x[t - 1, 0], x[t - 1, 1], c[0], c[1], c[2]
            )
        c = cov[t]
        for j in range(m):
            touch[t, j] = inside(tables.obstacles, j, x[t, 0], x[t, 1], c[0], c[1], c[2])
        cell[t] = locate(tables.cells, x[t, 0], x[t, 1])
        if cell[t] < 0:
            return OFF_MAP, t
        state = tables.logic.delta[state, cell[t]]
        q[t] = state
        if not clear_faces(tables.obstacles, tables.z, x[t, 0], x[t, 1], c[0], c[1], c[2], masks, 0):
            return CROSSING, t
        if t > 0 and not _shared(masks):
            return CROSSING, t
        masks[1] = masks[0]
        for atom in range(atoms):
            if tables.cells.atoms[cell[t], atom]:
                now = missed(tables.regions, atom, x[t, 0], x[t, 1], c[0], c[1], c[2])
                risk[atom] = now if risk[atom] < 0.0 else min(risk[atom], now)
    for atom in range(atoms):
        risk[atom] = max(risk[atom], 0.0)
    return FLOWN, len(x) - 1


@allocating
def collision_bound(tables: Tables, x: FloatArray, cov: FloatArray) -> float:
    """R = Σ over (obstacle, run of steps with one separating face) of min(Σ_t p_t, 2 Φ(-min d / max σ)).

    ``x`` (T+1, 2), ``cov`` (T+1, 3) = (xx, xy, yy). Runs overlap in the step where the face changes, because
    both ends of every step must clear one face; the cheapest division into runs is found by dynamic
    programming over the steps. The second form holds while Cov(e_s, e_t) >= Var e_s for s <= t (A = I).
    """
    total = 0.0
    reflect = tables.motion.a[0, 0] == 1.0 and tables.motion.a[1, 1] == 1.0
    reflect = reflect and tables.motion.a[0, 1] == 0.0 and tables.motion.a[1, 0] == 0.0
    cheapest = np.empty(len(x))
    for j in range(len(tables.obstacles.ptr) - 1):
        cheapest[:] = math.inf
        for s in range(len(x)):
            before = 0.0 if s == 0 else cheapest[s]
            if before < 1.0:
                _runs_from(tables, x, cov, j, s, before, reflect, cheapest)
        total += min(cheapest[-1], 1.0)
    return min(total, 1.0)


@kernel
def _runs_from(
    tables: Tables,
    x: FloatArray,
    cov: FloatArray,
    j: int,
    s: int,
    before: float,
    reflect: bool,
    cheapest: FloatArray,
) -> None:
    """Lower ``cheapest[t]``, the cost of steps 0 to t, by runs that begin at step s."""
    ptr, normal, offset = tables.obstacles.ptr, tables.obstacles.normal, tables.obstacles.offset
    for k in range(ptr[j], ptr[j + 1]):
        nx, ny = normal[k, 0], normal[k, 1]
        least, widest, total = math.inf, 0.0, 0.0
        for t in range(s, len(x)):
            gap = nx * x[t, 0] + ny * x[t, 1] - offset[k]
            if gap < -SLACK:
                break
            v = nx * nx * cov[t, 0] + 2.0 * nx * ny * cov[t, 1] + ny * ny * cov[t, 2]
            least, widest = min(least, gap), max(widest, v)
            if v > 0.0:
                total += 0.5 * math.erfc(SQRT_HALF * gap / math.sqrt(v))
            cost = total
            if reflect and widest > 0.0:
                cost = min(cost, math.erfc(SQRT_HALF * least / math.sqrt(widest)))
            if t > s or len(x) == 1:
                cheapest[t] = min(cheapest[t], before + cost)
