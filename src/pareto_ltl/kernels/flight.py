"""Simulated flights: the real nonlinear motion, the automaton on real positions, collisions on segments."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.kernels.coherent import blown, square, white
from pareto_ltl.kernels.data import Motion, Tables
from pareto_ltl.kernels.geometry import hits, locate
from pareto_ltl.kernels.interpolation import at, gust
from pareto_ltl.kernels.jit import allocating, kernel, vector
from pareto_ltl.kernels.track import landmark_at
from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray


@kernel
def touches(tables: Tables, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether a step meets any obstacle."""
    for j in range(len(tables.obstacles.ptr) - 1):  # noqa: SIM110
        if hits(tables.obstacles, j, x0, y0, x1, y1):
            return True
    return False


@kernel
def command(
    motion: Motion, u: FloatArray, mean: FloatArray, t: int, x: float, y: float
) -> tuple[float, float]:
    """Planned control plus position feedback -B⁻¹ K (x - m) / dt, held within u_max."""
    ux, uy = u[t, 0], u[t, 1]
    if motion.gain > 0.0:
        b, share = motion.b_inv, motion.gain / motion.dt
        ex, ey = share * (x - mean[t, 0]), share * (y - mean[t, 1])
        ux -= b[0, 0] * ex + b[0, 1] * ey
        uy -= b[1, 0] * ex + b[1, 1] * ey
        size = math.sqrt(ux * ux + uy * uy)
        if size > motion.u_max:
            ux, uy = ux * motion.u_max / size, uy * motion.u_max / size
    return ux, uy


@allocating
def fly(
    tables: Tables,
    b: FloatArray,
    u: FloatArray,
    mean: FloatArray,
    draws: FloatArray,
    theta: Float32Array,
    coherent: bool,
    x: FloatArray,
    accepted: BoolArray,
    collided: BoolArray,
) -> None:
    """Fly the controls ``u`` (T, 2) once for every column of ``draws`` (T, n, 2), standard normal.

    The independent law: w ~ N(μ(x, t), Σ_w(x, t)) anew at every step, at the real position. The coherent one:
    w = μ(x, t) + ψ(x)' θ of the flight's own ``theta`` (n, K, 2, P), plus what the modes leave white.
    Feedback holds on to ``mean`` (T+1, 2). ``x`` (n, T+1, 2) holds the start positions in row 0; the rest,
    ``accepted`` and ``collided`` are filled.
    """
    a, dt = tables.motion.a, tables.motion.dt
    modes = tables.modes
    for i in range(x.shape[0]):
        q = tables.logic.delta[tables.logic.initial, locate(tables.cells, x[i, 0, 0], x[i, 0, 1])]
        collided[i] = False
        for t in range(len(u)):
            px, py = x[i, t, 0], x[i, t, 1]
            we, wn = at(tables.wind.mean, tables.wind, t, px, py)
            if coherent:
                k = modes.slot[t]
                gi, gj, fx, fy = square(modes, px, py)
                e, ee = blown(modes.psi, k, gi, gj, fx, fy, 0, theta, i)
                n, nn = blown(modes.psi, k, gi, gj, fx, fy, 1, theta, i)
                we, wn = we + e, wn + n
                ve, vn = white(tables, t, px, py, ee, nn)
            else:
                ve, vn = at(tables.wind.latent, tables.wind, t, px, py)
                ge, gn = gust(tables.wind, t)
                ve, vn = ve + ge, vn + gn
            we += math.sqrt(ve) * draws[t, i, 0]
            wn += math.sqrt(vn) * draws[t, i, 1]
            ux, uy = command(tables.motion, u, mean, t, px, py)
            nx = a[0, 0] * px + a[0, 1] * py + dt * (b[0, 0] * ux + b[0, 1] * uy + we)
            ny = a[1, 0] * px + a[1, 1] * py + dt * (b[1, 0] * ux + b[1, 1] * uy + wn)
            x[i, t + 1, 0], x[i, t + 1, 1] = nx, ny
            collided[i] = collided[i] or touches(tables, px, py, nx, ny)
            q = tables.logic.delta[q, locate(tables.cells, nx, ny)]
        accepted[i] = tables.logic.distance[q] == 0.0


@allocating
def fly_fixed(
    tables: Tables,
    b: FloatArray,
    u: FloatArray,
    mean: FloatArray,
    F: FloatArray,
    psi: Float32Array,
    gain: FloatArray,
    learnt: Float32Array,
    noise: FloatArray,
    draws: FloatArray,
    theta: Float32Array,
    coherent: bool,
    x: FloatArray,
    accepted: BoolArray,
    collided: BoolArray,
) -> None:
    """:func:`fly` of a robot that takes position fixes at landmarks.

    At a step where the plan counts on a fix (``gain`` (T, 2, 2) not 0) and the robot is in a landmark, it
    reads its position with ``noise`` (T, n, 2) and updates its estimate ê of the deviation and θ̂ of the
    field. It flies ê back and steers against ψ' θ̂, within u_max, and counts on no more than it could do.
    """
    a, dt, motion, modes = tables.motion.a, tables.motion.dt, tables.motion, tables.modes
    known = np.empty((2, psi.shape[2]), np.float32)
    for i in range(x.shape[0]):
        q = tables.logic.delta[tables.logic.initial, locate(tables.cells, x[i, 0, 0], x[i, 0, 1])]
        collided[i] = False
        known[:] = 0.0
        ex, ey, informed = 0.0, 0.0, False
        for t in range(len(u)):
            px, py = x[i, t, 0], x[i, t, 1]
            if t > 0 and informed and modes.keep[t] < 1.0:
                known[:] *= np.float32(modes.keep[t])
            if (gain[t, 0, 0] != 0.0 or gain[t, 1, 1] != 0.0) and landmark_at(tables, px, py) >= 0:
                dx, dy = px + noise[t, i, 0] - mean[t, 0] - ex, py + noise[t, i, 1] - mean[t, 1] - ey
                ex, ey = (
                    ex + gain[t, 0, 0] * dx + gain[t, 0, 1] * dy,
                    ey + gain[t, 1, 0] * dx + gain[t, 1, 1] * dy,
                )
                for c in range(2):
                    for m in range(psi.shape[2]):
                        known[c, m] += np.float32(learnt[t, 0, c, m] * dx + learnt[t, 1, c, m] * dy)
                informed = True
            ux, uy, hx, hy = u[t, 0], u[t, 1], 0.0, 0.0
            if informed:
                for m in range(psi.shape[2]):
                    hx += psi[t, 0, m] * known[0, m]
                    hy += psi[t, 1, m] * known[1, m]
                cx, cy = motion.fix_gain * ex / dt + hx, motion.fix_gain * ey / dt + hy
                ux -= motion.b_inv[0, 0] * cx + motion.b_inv[0, 1] * cy
                uy -= motion.b_inv[1, 0] * cx + motion.b_inv[1, 1] * cy
                size = math.sqrt(ux * ux + uy * uy)
                if size > motion.u_max:
                    ux, uy = ux * motion.u_max / size, uy * motion.u_max / size
            we, wn = at(tables.wind.mean, tables.wind, t, px, py)
            if coherent:
                k = modes.slot[t]
                gi, gj, fx, fy = square(modes, px, py)
                e, ee = blown(modes.psi, k, gi, gj, fx, fy, 0, theta, i)
                n, nn = blown(modes.psi, k, gi, gj, fx, fy, 1, theta, i)
                we, wn = we + e, wn + n
                ve, vn = white(tables, t, px, py, ee, nn)
            else:
                ve, vn = at(tables.wind.latent, tables.wind, t, px, py)
                ge, gn = gust(tables.wind, t)
                ve, vn = ve + ge, vn + gn
            we += math.sqrt(ve) * draws[t, i, 0]
            wn += math.sqrt(vn) * draws[t, i, 1]
            nx = a[0, 0] * px + a[0, 1] * py + dt * (b[0, 0] * ux + b[0, 1] * uy + we)
            ny = a[1, 0] * px + a[1, 1] * py + dt * (b[1, 0] * ux + b[1, 1] * uy + wn)
            if informed:
                dux, duy = ux - u[t, 0], uy - u[t, 1]
                ex, ey = (
                    F[t, 0, 0] * ex + F[t, 0, 1] * ey + dt * (hx + b[0, 0] * dux + b[0, 1] * duy),
                    F[t, 1, 0] * ex + F[t, 1, 1] * ey + dt * (hy + b[1, 0] * dux + b[1, 1] * duy),
                )
            x[i, t + 1, 0], x[i, t + 1, 1] = nx, ny
            collided[i] = collided[i] or touches(tables, px, py, nx, ny)
            q = tables.logic.delta[q, locate(tables.cells, nx, ny)]
        accepted[i] = tables.logic.distance[q] == 0.0


@allocating
def fly_linear(
    tables: Tables,
    mean: FloatArray,
    F: FloatArray,
    psi: Float32Array,
    noise: FloatArray,
    draws: FloatArray,
    theta: Float32Array,
    start: FloatArray,
    failed: BoolArray,
    collided: BoolArray,
) -> None:
    """Flights of the linearised coherent law e' = F_t e + dt (ψ_t' θ + gust) about ``mean`` (T+1, 2).

    One for every row of ``theta`` (n, K, 2, P) and column of ``draws`` (T, n, 2); ``start`` (n, 2) = e_0.
    """
    dt, modes = tables.motion.dt, tables.modes
    for i in range(len(theta)):
        ex, ey = start[i, 0], start[i, 1]
        px, py = mean[0, 0] + ex, mean[0, 1] + ey
        q = tables.logic.delta[tables.logic.initial, locate(tables.cells, px, py)]
        collided[i] = False
        for t in range(len(F)):
            k = modes.slot[t]
            we = along(psi, t, 0, theta, i, k) + math.sqrt(noise[t, 0]) * draws[t, i, 0]
            wn = along(psi, t, 1, theta, i, k) + math.sqrt(noise[t, 1]) * draws[t, i, 1]
            ex, ey = F[t, 0, 0] * ex + F[t, 0, 1] * ey + dt * we, F[t, 1, 0] * ex + F[t, 1, 1] * ey + dt * wn
            nx, ny = mean[t + 1, 0] + ex, mean[t + 1, 1] + ey
            collided[i] = collided[i] or touches(tables, px, py, nx, ny)
            q = tables.logic.delta[q, locate(tables.cells, nx, ny)]
            px, py = nx, ny
        failed[i] = collided[i] or tables.logic.distance[q] > 0.0


@vector
def along(psi: Float32Array, t: int, c: int, theta: Float32Array, run: int, k: int) -> float:
    """ψ_t' θ of component c."""
    wind = np.float32(0.0)
    for m in range(psi.shape[2]):
        wind += psi[t, c, m] * theta[run, k, c, m]
    return wind  # type: ignore[return-value]


@allocating
def touches_many(tables: Tables, segments: FloatArray) -> BoolArray:
    """:func:`touches` for every row of ``segments`` (S, 4)."""
    found = np.empty(len(segments), np.bool_)
    for i in range(len(segments)):
        s = segments[i]
        found[i] = touches(tables, s[0], s[1], s[2], s[3])
    return found
