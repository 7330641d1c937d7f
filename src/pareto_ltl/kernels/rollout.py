"""Simulated flights: the real nonlinear motion, the automaton on real positions, collisions on segments."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.arrays import BoolArray, FloatArray
from pareto_ltl.kernels.geometry import hits, locate
from pareto_ltl.kernels.jit import allocating, kernel
from pareto_ltl.kernels.lattice import at, gust
from pareto_ltl.kernels.tables import Tables


@kernel
def touches(tables: Tables, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether a step meets any obstacle."""
    for j in range(len(tables.obstacles.ptr) - 1):  # noqa: SIM110
        if hits(tables.obstacles, j, x0, y0, x1, y1):
            return True
    return False


@allocating
def fly(
    tables: Tables,
    b: FloatArray,
    u: FloatArray,
    draws: FloatArray,
    x: FloatArray,
    accepted: BoolArray,
    collided: BoolArray,
) -> None:
    """Fly the controls ``u`` (T, 2) once for every column of ``draws`` (T, n, 2), standard normal.

    The independent law: w ~ N(μ(x, t), Σ_w(x, t)) anew at every step, at the real position.
    ``x`` (n, T+1, 2) holds the start positions in row 0; the rest, ``accepted`` and ``collided`` are filled.
    """
    a, dt = tables.motion.a, tables.motion.dt
    for i in range(x.shape[0]):
        q = tables.logic.delta[tables.logic.initial, locate(tables.cells, x[i, 0, 0], x[i, 0, 1])]
        collided[i] = False
        for t in range(len(u)):
            px, py = x[i, t, 0], x[i, t, 1]
            we, wn = at(tables.wind.mean, tables.wind, t, px, py)
            ve, vn = at(tables.wind.latent, tables.wind, t, px, py)
            ge, gn = gust(tables.wind, t)
            we += math.sqrt(ve + ge) * draws[t, i, 0]
            wn += math.sqrt(vn + gn) * draws[t, i, 1]
            nx = a[0, 0] * px + a[0, 1] * py + dt * (b[0, 0] * u[t, 0] + b[0, 1] * u[t, 1] + we)
            ny = a[1, 0] * px + a[1, 1] * py + dt * (b[1, 0] * u[t, 0] + b[1, 1] * u[t, 1] + wn)
            x[i, t + 1, 0], x[i, t + 1, 1] = nx, ny
            collided[i] = collided[i] or touches(tables, px, py, nx, ny)
            q = tables.logic.delta[q, locate(tables.cells, nx, ny)]
        accepted[i] = tables.logic.distance[q] == 0.0


@allocating
def touches_many(tables: Tables, segments: FloatArray) -> BoolArray:
    """:func:`touches` for every row of ``segments`` (S, 4)."""
    found = np.empty(len(segments), np.bool_)
    for i in range(len(segments)):
        s = segments[i]
        found[i] = touches(tables, s[0], s[1], s[2], s[3])
    return found
