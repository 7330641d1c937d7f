"""Exact evaluation of one path: what a vertex of a tree costs, computed along the way."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.kernels.coherent import closed_loop, square, white
from pareto_ltl.kernels.collision_risk import pass_by
from pareto_ltl.kernels.data import Tables
from pareto_ltl.kernels.gaussian import SQRT_HALF, inside, missed
from pareto_ltl.kernels.geometry import SLACK, clear_faces, locate
from pareto_ltl.kernels.interpolation import airspeed, allowed, at, drift, spread
from pareto_ltl.kernels.jit import allocating, kernel
from pareto_ltl.kernels.track import Track, advance, missing, reset
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray

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
    track: Track, miss: FloatArray,
) -> tuple[int, int]:  # fmt: skip
    """Fly the means ``x`` (T+1, 2) from a start of the given ``variance``.

    Fills ``cov`` (T+1, 3), ``u`` (T, 2), ``q``, ``cell`` (T+1,), ``risk`` (P,) = f_o^i and ``touch`` (T+1,
    m) = Eq. (10) for every step and obstacle. Returns what went wrong first, and at which step. ``fast`` is
    the factor by which u_max may be exceeded. Of full fidelity the covariance is the coherent law's, kept
    in ``track``, controls steer against the mean shift, the obstacles share epsilon as they need it, and
    ``miss`` (T+1,) is the probability of missing the landmark of each step, 0 where the plan counts on
    none.
    """
    reset(track)
    miss[:] = 0.0
    faces = np.full((2, len(tables.obstacles.ptr) - 1), -1, np.int32)
    runs = np.zeros((2, faces.shape[1], 3), np.float32)
    m = len(tables.obstacles.ptr) - 1
    masks = np.zeros((2, m), np.int64)  # of this step and of the one before
    cov[0, 0], cov[0, 1], cov[0, 2] = variance, 0.0, variance
    state = tables.logic.initial
    for t in range(len(x)):
        if t > 0:
            if t - 1 >= len(tables.wind.slot):
                return UNKNOWN_WIND, t
            p = cov[t - 1]
            if tables.full:
                lost = missing(tables, track, max(t - 2, 0), x[t - 1, 0], x[t - 1, 1], p[0], p[1], p[2])
                miss[t - 1] = max(lost, 0.0)
                fx, fy, cov[t, 0], cov[t, 1], cov[t, 2], speed = advance(
                    tables, track, t - 1, x[t - 1, 0], x[t - 1, 1], p[0], p[1], p[2], max(t - 2, 0), t - 1
                )
            else:
                share = tables.motion.gain * tables.motion.gain
                speed = allowed(tables.motion, share * p[0], share * p[1], share * p[2])
                fx, fy = drift(tables.wind, tables.motion, t - 1, x[t - 1, 0], x[t - 1, 1])
                cov[t, 0], cov[t, 1], cov[t, 2] = spread(
                    tables.wind, tables.motion, t - 1, x[t - 1, 0], x[t - 1, 1], p[0], p[1], p[2]
                )
            dx, dy = x[t, 0] - fx, x[t, 1] - fy
            b, dt = tables.motion.b_inv, tables.motion.dt
            u[t - 1, 0] = (b[0, 0] * dx + b[0, 1] * dy) / dt
            u[t - 1, 1] = (b[1, 0] * dx + b[1, 1] * dy) / dt
            if airspeed(tables.motion, dx, dy) > speed * fast:
                return TOO_FAST, t
        c = cov[t]
        for j in range(m):
            touch[t, j] = inside(tables.obstacles, j, x[t, 0], x[t, 1], c[0], c[1], c[2])
        cell[t] = locate(tables.cells, x[t, 0], x[t, 1])
        if cell[t] < 0:
            return OFF_MAP, t
        state = tables.logic.delta[state, cell[t]]
        q[t] = state
        if tables.full:
            s = max(t - 1, 0)
            b4 = cov[s]
            step_risk, _ = pass_by(
                tables.obstacles, x[s, 0], x[s, 1], b4[0], b4[1], b4[2], x[t, 0], x[t, 1], c[0], c[1], c[2],
                faces, runs, (t + 1) % 2, faces, runs, t % 2,
            )  # fmt: skip
            if step_risk > tables.epsilon:
                return CROSSING, t
        else:
            if not clear_faces(tables.obstacles, tables.z, x[t, 0], x[t, 1], c[0], c[1], c[2], masks, 0):
                return CROSSING, t
            if t > 0 and not _shared(masks):
                return CROSSING, t
            masks[1] = masks[0]
    paper_risk(tables, x, cov, cell, risk)
    return FLOWN, len(x) - 1


@allocating
def paper_covariance(tables: Tables, x: FloatArray, variance: float, cov: FloatArray) -> None:
    """Σ of Section III along the means ``x`` (T+1, 2) into ``cov`` (T+1, 3)."""
    cov[0, 0], cov[0, 1], cov[0, 2] = variance, 0.0, variance
    for t in range(1, len(x)):
        c = cov[t - 1]
        cov[t, 0], cov[t, 1], cov[t, 2] = spread(
            tables.wind, tables.motion, t - 1, x[t - 1, 0], x[t - 1, 1], c[0], c[1], c[2]
        )


@allocating
def paper_risk(tables: Tables, x: FloatArray, cov: FloatArray, cell: IntArray, risk: FloatArray) -> None:
    """f_o^i of Theorem 1 into ``risk`` (P,): the least over all visits, 0 where there is none."""
    for atom in range(len(risk)):
        risk[atom] = -1.0
        for t in range(len(x)):
            if tables.cells.atoms[cell[t], atom]:
                now = missed(tables.regions, atom, x[t, 0], x[t, 1], cov[t, 0], cov[t, 1], cov[t, 2])
                risk[atom] = now if risk[atom] < 0.0 else min(risk[atom], now)
        risk[atom] = max(risk[atom], 0.0)


@allocating
def foresee(
    tables: Tables, b: FloatArray, u: FloatArray, variance: float, coherent: bool, x: FloatArray,
    cov: FloatArray, track: Track, miss: FloatArray,
) -> None:  # fmt: skip
    """Mean and covariance of flying the controls ``u`` (T, 2), which B = ``b`` turns into motion, under one
    law, whatever the plan's fidelity.

    ``x`` (T+1, 2) holds the start in row 0; the rest, ``cov`` (T+1, 3), ``track`` and ``miss`` (T+1,) are
    filled.
    """
    motion = tables.motion
    reset(track)
    miss[:] = 0.0
    cov[0, 0], cov[0, 1], cov[0, 2] = variance, 0.0, variance
    for t in range(len(u)):
        c = cov[t]
        if coherent:
            miss[t] = max(missing(tables, track, max(t - 1, 0), x[t, 0], x[t, 1], c[0], c[1], c[2]), 0.0)
            fx, fy, cov[t + 1, 0], cov[t + 1, 1], cov[t + 1, 2], _ = advance(
                tables, track, t, x[t, 0], x[t, 1], c[0], c[1], c[2], max(t - 1, 0), t
            )
        else:
            fx, fy = drift(tables.wind, motion, t, x[t, 0], x[t, 1])
            cov[t + 1, 0], cov[t + 1, 1], cov[t + 1, 2] = spread(
                tables.wind, motion, t, x[t, 0], x[t, 1], c[0], c[1], c[2]
            )
        x[t + 1, 0] = fx + motion.dt * (b[0, 0] * u[t, 0] + b[0, 1] * u[t, 1])
        x[t + 1, 1] = fy + motion.dt * (b[1, 0] * u[t, 0] + b[1, 1] * u[t, 1])


@allocating
def speeds(tables: Tables, x: FloatArray, variance: float, track: Track, speed: FloatArray) -> None:
    """Airspeed left for the control of each step along the means ``x`` (T+1, 2), into ``speed`` (T,)."""
    reset(track)
    xx, xy, yy = variance, 0.0, variance
    share = tables.motion.gain * tables.motion.gain
    for t in range(len(x) - 1):
        px, py = x[t, 0], x[t, 1]
        if tables.full:
            _, _, xx, xy, yy, speed[t] = advance(tables, track, t, px, py, xx, xy, yy, max(t - 1, 0), t)
        else:
            speed[t] = allowed(tables.motion, share * xx, share * xy, share * yy)
            xx, xy, yy = spread(tables.wind, tables.motion, t, px, py, xx, xy, yy)


@allocating
def estimator(
    tables: Tables, x: FloatArray, variance: float, track: Track, gain: FloatArray, learnt: Float32Array
) -> None:
    """What a robot needs to use its fixes along the means ``x`` (T+1, 2).

    Fills ``gain`` (T, 2, 2) = Σ̃ S⁻¹ and ``learnt`` (T, 2, 2, P) = S⁻¹ Cov(ẽ, θ̃) of the steps with a fix,
    0 at the others.
    """
    reset(track)
    xx, xy, yy = variance, 0.0, variance
    for t in range(len(x) - 1):
        row = max(t - 1, 0)
        if missing(tables, track, row, x[t, 0], x[t, 1], xx, xy, yy) >= 0.0:
            a = xx - track.known[row, 0]
            b = xy - track.known[row, 1]
            c = yy - track.known[row, 2]
            p, q = a + tables.motion.fix_variance, c + tables.motion.fix_variance
            det = p * q - b * b
            gain[t, 0, 0], gain[t, 0, 1] = (a * q - b * b) / det, (b * p - a * b) / det
            gain[t, 1, 0], gain[t, 1, 1] = (b * q - c * b) / det, (c * p - b * b) / det
            for w in range(2):
                for m in range(track.theta.shape[3]):
                    ex, ey = track.theta[row, 0, w, m], track.theta[row, 1, w, m]
                    learnt[t, 0, w, m] = (q * ex - b * ey) / det
                    learnt[t, 1, w, m] = (p * ey - b * ex) / det
        _, _, xx, xy, yy, _ = advance(tables, track, t, x[t, 0], x[t, 1], xx, xy, yy, row, t)


@allocating
def mean_shift(tables: Tables, x: FloatArray, variance: float, track: Track, shift: FloatArray) -> None:
    """½ D²μ : Σ + ∂ψ : C along the means ``x`` (T+1, 2), into ``shift`` (T, 2) [m/s]."""
    reset(track)
    a, dt = tables.motion.a, tables.motion.dt
    xx, xy, yy = variance, 0.0, variance
    for t in range(len(x) - 1):
        px, py = x[t, 0], x[t, 1]
        fx, fy, xx, xy, yy, _ = advance(tables, track, t, px, py, xx, xy, yy, max(t - 1, 0), t)
        we, wn = at(tables.wind.mean, tables.wind, t, px, py)
        shift[t, 0] = (fx - a[0, 0] * px - a[0, 1] * py) / dt - we
        shift[t, 1] = (fy - a[1, 0] * px - a[1, 1] * py) / dt - wn


@allocating
def linearise(tables: Tables, x: FloatArray, F: FloatArray, psi: Float32Array, noise: FloatArray) -> None:
    """The coherent law about the means ``x`` (T+1, 2): F_t (T, 2, 2), ψ(x_t) (T, 2, P) and white variance
    (T, 2).
    """
    field = tables.modes.psi
    for t in range(len(x) - 1):
        f = closed_loop(tables.wind, tables.modes, tables.motion, t, x[t, 0], x[t, 1])
        F[t, 0, 0], F[t, 0, 1], F[t, 1, 0], F[t, 1, 1] = f
        i, j, fx, fy = square(tables.modes, x[t, 0], x[t, 1])
        k = tables.modes.slot[t]
        for c in range(2):
            for m in range(field.shape[4]):
                low = (1 - fx) * field[k, i, j, c, m] + fx * field[k, i + 1, j, c, m]
                high = (1 - fx) * field[k, i, j + 1, c, m] + fx * field[k, i + 1, j + 1, c, m]
                psi[t, c, m] = (1 - fy) * low + fy * high
        ee, nn = 0.0, 0.0
        for m in range(field.shape[4]):
            ee += psi[t, 0, m] * psi[t, 0, m]
            nn += psi[t, 1, m] * psi[t, 1, m]
        noise[t, 0], noise[t, 1] = white(tables, t, x[t, 0], x[t, 1], ee, nn)


@allocating
def across_time(
    tables: Tables, F: FloatArray, psi: Float32Array, theta: FloatArray, cov: FloatArray, cross: FloatArray
) -> None:
    """Cov(e_t, e_s) for s <= t into ``cross`` (T+1, T+1, 2, 2), from Cov(e_s, θ) = ``theta`` (T+1, 2, 2,
    P).
    """
    n, dt, modes = len(cov), tables.motion.dt, psi.shape[2]
    held = np.empty(theta.shape[1:])
    for s in range(n):
        cross[s, s, 0, 0], cross[s, s, 0, 1] = cov[s, 0], cov[s, 1]
        cross[s, s, 1, 0], cross[s, s, 1, 1] = cov[s, 1], cov[s, 2]
        held[:] = 0.0
        if s > 0:
            held[:] = theta[s - 1]
        for t in range(s, n - 1):
            keep = tables.modes.keep[t + 1]
            for c in range(2):
                for r in range(2):
                    pushed = 0.0
                    for m in range(modes):
                        pushed += psi[t, c, m] * held[r, c, m]
                        held[r, c, m] *= keep
                    moved = F[t, c, 0] * cross[t, s, 0, r] + F[t, c, 1] * cross[t, s, 1, r]
                    cross[t + 1, s, c, r] = moved + dt * pushed


@allocating
def collision_bound(tables: Tables, x: FloatArray, cov: FloatArray, cross: FloatArray) -> float:
    """R = Σ over (obstacle, run of steps with one separating face) of min(Σ_t p_t, 2 Φ(-min d / max σ)).

    ``x`` (T+1, 2), ``cov`` (T+1, 3) = (xx, xy, yy). Runs overlap in the step where the face changes,
    because both ends of every step must clear one face; the cheapest division into runs is found by dynamic
    programming over the steps. The second form holds while Cov(e_s, e_t) >= Var e_s for s <= t along the
    face's normal: always where A - K = I under the independent law, and otherwise where ``cross`` (T+1,
    T+1, 2, 2) = Cov(e_t, e_s) says so; empty, the form is not used.
    """
    total = 0.0
    f = tables.motion.closed
    walk = f[0, 0] == 1.0 and f[1, 1] == 1.0 and f[0, 1] == 0.0 and f[1, 0] == 0.0
    reflect = 2 if len(cross) > 0 else int(walk and not tables.full)
    cheapest = np.empty(len(x))
    for j in range(len(tables.obstacles.ptr) - 1):
        cheapest[:] = math.inf
        for s in range(len(x)):
            before = 0.0 if s == 0 else cheapest[s]
            if before < 1.0:
                _runs_from(tables, x, cov, cross, j, s, before, reflect, cheapest)
        total += min(cheapest[-1], 1.0)
    return min(total, 1.0)


@kernel
def _runs_from(
    tables: Tables,
    x: FloatArray,
    cov: FloatArray,
    cross: FloatArray,
    j: int,
    s: int,
    before: float,
    reflect: int,
    cheapest: FloatArray,
) -> None:
    """Lower ``cheapest[t]``, the cost of steps 0 to t, by runs that begin at step s."""
    ptr, normal, offset = tables.obstacles.ptr, tables.obstacles.normal, tables.obstacles.offset
    for k in range(ptr[j], ptr[j + 1]):
        nx, ny = normal[k, 0], normal[k, 1]
        least, widest, total, grows = math.inf, 0.0, 0.0, reflect > 0
        for t in range(s, len(x)):
            gap = nx * x[t, 0] + ny * x[t, 1] - offset[k]
            if gap < -SLACK:
                break
            v = nx * nx * cov[t, 0] + 2.0 * nx * ny * cov[t, 1] + ny * ny * cov[t, 2]
            least, widest = min(least, gap), max(widest, v)
            if v > 0.0:
                total += 0.5 * math.erfc(SQRT_HALF * gap / math.sqrt(v))
            cost = total
            if reflect == 2 and grows and t > s:
                grows = _grows(cross, s, t, nx, ny)
            if grows and widest > 0.0:
                cost = min(cost, math.erfc(SQRT_HALF * least / math.sqrt(widest)))
            if t > s or len(x) == 1:
                cheapest[t] = min(cheapest[t], before + cost)


@kernel
def _grows(cross: FloatArray, s: int, t: int, nx: float, ny: float) -> bool:
    """Whether n' Cov(e_t, e_r) n >= n' Var(e_r) n for all r from s to t."""
    for r in range(s, t):
        both = nx * nx * cross[t, r, 0, 0] + nx * ny * (cross[t, r, 0, 1] + cross[t, r, 1, 0])
        both += ny * ny * cross[t, r, 1, 1]
        own = nx * nx * cross[r, r, 0, 0] + 2.0 * nx * ny * cross[r, r, 0, 1] + ny * ny * cross[r, r, 1, 1]
        if both < own * (1.0 - 1e-9):
            return False
    return True
