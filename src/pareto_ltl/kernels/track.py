"""The coherent Gaussian along a path or tree, with position fixes at landmarks.

A robot inside a landmark learns its position, and with it something of the field it flies in (a Kalman
update of (e, θ) by y = e + ν). From then on it knows a part of its deviation, e = ê + ẽ: it flies a share κ
of ê back in every step and steers against the wind ψ' θ̂ that it now expects. What is unknown goes on as
before with what is left of Cov(θ),

    ẽ' = F ẽ + dt (ψ' θ̃ + gust),    Cov(θ̃) = I - Σ_f s_f² D_f' D_f,    D = L⁻¹ C,  L L' = Σ̃ + fix²,
    ê' = (F - κ) ê,                  Cov(e) = Cov(ẽ) + Cov(ê)   (orthogonal),

with s_f the product of ρ since the fix. Missing the landmark is counted as failure: P(fail) <= P(miss) +
P(fail with the fix), since flights that enter it are those of the law with the fix.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pareto_ltl.kernels.coherent import carry, closed_loop, square
from pareto_ltl.kernels.data import Tables
from pareto_ltl.kernels.geometry import slack
from pareto_ltl.kernels.interpolation import allowed
from pareto_ltl.kernels.jit import kernel, vector
from pareto_ltl.kernels.mission_risk import polygon_probability
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray

F32 = np.float32


class Track(NamedTuple):
    """Row v is what the children of v start from: ``theta`` (N, 2, 2, P) = Cov(ẽ, θ̃), ``known`` (N, 3) =
    Cov(ê), the last fix ``fix`` (N,) and ``faded`` (N,), the s of it. Fix f has ``gain`` (M, 2, 2, P) = D,
    the fix before it ``previous`` and the ``share`` that the latter had then; ``used`` (1,) fixes are in
    use. Without landmarks all but ``theta`` have no rows."""

    theta: Float32Array
    known: FloatArray
    fix: IntArray
    faded: FloatArray
    gain: Float32Array
    previous: IntArray
    share: FloatArray
    used: IntArray


@kernel
def landmark_at(tables: Tables, x: float, y: float) -> int:
    """Number of the landmark that holds a point, -1 for none."""
    for k in range(len(tables.landmarks.ptr) - 1):
        if slack(tables.landmarks, k, x, y) >= 0.0:
            return k
    return -1


@kernel
def missing(
    tables: Tables, track: Track, row: int, x: float, y: float, cxx: float, cxy: float, cyy: float
) -> float:
    """P(landmark missed) where the plan counts on a fix at a position, -1 where it does not.

    A fix is worth its risk while half of the variance or more is unknown, so a robot that crosses a
    landmark in several steps counts on the first.
    """
    if len(tables.landmarks.ptr) < 2:
        return -1.0
    if 2.0 * (track.known[row, 0] + track.known[row, 2]) > cxx + cyy:
        return -1.0
    k = landmark_at(tables, x, y)
    if k < 0 or cxx <= 0.0 or cyy <= 0.0:
        return -1.0
    miss = 1.0 - polygon_probability(tables.spots, k, x, y, cxx, cxy, cyy)
    return miss if miss <= tables.motion.fix_risk else -1.0


@kernel
def advance(
    tables: Tables, track: Track, step: int, x: float, y: float, cxx: float, cxy: float, cyy: float,
    row: int, target: int,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """One step from (x, y), whose covariance before any fix is given: mean with the motors off, covariance,
    and the
    airspeed left for the control. ``row`` is the vertex before, ``target`` this one (both 0 at the start)."""
    motion = tables.motion
    share = motion.gain * motion.gain
    if len(tables.landmarks.ptr) < 2:
        fx, fy, sxx, sxy, syy = carry(
            tables, step, x, y, cxx, cxy, cyy, track.theta, row, track.theta, target
        )
        return fx, fy, sxx, sxy, syy, allowed(motion, share * cxx, share * cxy, share * cyy)
    kxx, kxy, kyy = track.known[row, 0], track.known[row, 1], track.known[row, 2]
    uxx, uxy, uyy = max(cxx - kxx, 0.0), cxy - kxy, max(cyy - kyy, 0.0)
    fix, faded = track.fix[row], track.faded[row]
    if row != target:
        copy(track.theta, row, target)
    if missing(tables, track, row, x, y, cxx, cxy, cyy) >= 0.0 and track.used[0] < len(track.previous):
        f = track.used[0]
        track.used[0] += 1
        track.previous[f], track.share[f] = fix, faded
        gxx, gxy, gyy = learn(track, target, f, uxx, uxy, uyy, motion.fix_variance)
        kxx, kxy, kyy = kxx + gxx, kxy + gxy, kyy + gyy
        uxx, uxy, uyy = max(uxx - gxx, 0.0), uxy - gxy, max(uyy - gyy, 0.0)
        fix, faded = f, 1.0
    fx, fy, sxx, sxy, syy = carry(tables, step, x, y, uxx, uxy, uyy, track.theta, target, track.theta, target)
    keep = tables.modes.keep[step + 1]
    axx, axy, ayy = 0.0, 0.0, 0.0
    f, s = fix, faded
    while f >= 0 and s > 1e-3:
        pxx, pxy, pyy = relieve(tables, track, step, x, y, f, s, keep, target)
        axx, axy, ayy = axx + pxx, axy + pxy, ayy + pyy
        s, f = s * track.share[f], track.previous[f]
    dt2 = motion.dt * motion.dt
    f00, f01, f10, f11 = closed_loop(tables.wind, tables.modes, motion, step, x, y)
    f00, f11 = f00 - motion.fix_gain, f11 - motion.fix_gain
    p0, p1 = f00 * kxx + f01 * kxy, f00 * kxy + f01 * kyy
    q0, q1 = f10 * kxx + f11 * kxy, f10 * kxy + f11 * kyy
    nxx, nxy, nyy = p0 * f00 + p1 * f01, p0 * f10 + p1 * f11, q0 * f10 + q1 * f11
    track.known[target, 0], track.known[target, 1], track.known[target, 2] = nxx, nxy, nyy
    track.fix[target], track.faded[target] = fix, faded * keep
    k2 = motion.fix_gain * motion.fix_gain
    effort = allowed(
        motion, share * uxx + k2 * kxx + dt2 * axx, share * uxy + k2 * kxy + dt2 * axy,
        share * uyy + k2 * kyy + dt2 * ayy,
    )  # fmt: skip
    return fx, fy, sxx - dt2 * axx + nxx, sxy - dt2 * axy + nxy, syy - dt2 * ayy + nyy, effort


@vector
def copy(theta: Float32Array, row: int, target: int) -> None:
    for r in range(2):
        for c in range(2):
            for m in range(theta.shape[3]):
                theta[target, r, c, m] = theta[row, r, c, m]


@vector
def learn(
    track: Track, v: int, f: int, uxx: float, uxy: float, uyy: float, variance: float
) -> tuple[float, float, float]:
    """Kalman update of row v of ``theta``, whose Cov(ẽ) is given; fix f gets its D. Returns what is now
    known,
    Σ̃ S⁻¹ Σ̃."""
    a, b, c = uxx + variance, uxy, uyy + variance
    l00 = math.sqrt(a)
    l10 = b / l00
    l11 = math.sqrt(max(c - l10 * l10, 1e-9 * c))
    det = a * c - b * b
    g00, g01 = (uxx * c - uxy * b) / det, (uxy * a - uxx * b) / det
    g10, g11 = (uxy * c - uyy * b) / det, (uyy * a - uxy * b) / det
    i00, i10, i11 = F32(1.0 / l00), F32(-l10 / (l00 * l11)), F32(1.0 / l11)
    k00, k01, k10, k11 = F32(g00), F32(g01), F32(g10), F32(g11)
    theta = track.theta
    for w in range(2):
        for m in range(theta.shape[3]):
            p, q = theta[v, 0, w, m], theta[v, 1, w, m]
            track.gain[f, 0, w, m] = i00 * p
            track.gain[f, 1, w, m] = i10 * p + i11 * q
            theta[v, 0, w, m] = p - k00 * p - k01 * q
            theta[v, 1, w, m] = q - k10 * p - k11 * q
    return g00 * uxx + g01 * uxy, g00 * uxy + g01 * uyy, g10 * uxy + g11 * uyy


@kernel
def relieve(
    tables: Tables, track: Track, step: int, x: float, y: float, f: int, s: float, keep: float, target: int
) -> tuple[float, float, float]:
    """Take what fix f knows of the wind out of row ``target`` of ``theta``; return the variance of that
    wind.
    """
    modes = tables.modes
    k = modes.slot[step]
    i, j, fx, fy = square(modes, x, y)
    dt = tables.motion.dt
    xx, xy, yy = 0.0, 0.0, 0.0
    for r in range(2):
        e = s * foreseen(modes.psi, k, i, j, fx, fy, 0, track.gain, f, r)
        n = s * foreseen(modes.psi, k, i, j, fx, fy, 1, track.gain, f, r)
        xx, xy, yy = xx + e * e, xy + e * n, yy + n * n
        subtract(track.theta, target, 0, track.gain, f, r, keep * dt * e * s)
        subtract(track.theta, target, 1, track.gain, f, r, keep * dt * n * s)
    return xx, xy, yy


@vector
def foreseen(
    psi: Float32Array,
    k: int,
    i: int,
    j: int,
    fx: float,
    fy: float,
    c: int,
    gain: Float32Array,
    f: int,
    r: int,
) -> float:
    """ψ(x)' of component c times row r of D."""
    w00, w10 = F32((1 - fx) * (1 - fy)), F32(fx * (1 - fy))
    w01, w11 = F32((1 - fx) * fy), F32(fx * fy)
    total = F32(0.0)
    for m in range(psi.shape[4]):
        p = w00 * psi[k, i, j, c, m] + w10 * psi[k, i + 1, j, c, m]
        p += w01 * psi[k, i, j + 1, c, m] + w11 * psi[k, i + 1, j + 1, c, m]
        total += p * gain[f, r, c, m]
    return total  # type: ignore[return-value]


@vector
def subtract(
    theta: Float32Array, v: int, row: int, gain: Float32Array, f: int, r: int, factor: float
) -> None:
    weight = F32(factor)
    for c in range(2):
        for m in range(theta.shape[3]):
            theta[v, row, c, m] -= weight * gain[f, r, c, m]


@kernel
def reset(track: Track) -> None:
    """Make row 0 that of a start about whose field nothing is known."""
    for r in range(2):
        for c in range(2):
            for m in range(track.theta.shape[3]):
                track.theta[0, r, c, m] = F32(0.0)
    if len(track.fix) > 0:
        track.known[0, 0], track.known[0, 1], track.known[0, 2] = 0.0, 0.0, 0.0
        track.fix[0], track.faded[0] = -1, 1.0
        track.used[0] = 0
