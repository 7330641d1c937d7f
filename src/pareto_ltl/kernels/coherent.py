"""Coherent wind in a kernel: one step of the Gaussian that a flight through one random field has.

With e = x - m the deviation from the mean and θ the field's coefficients (DESIGN 4.2),

    e' = F e + dt ψ(m)' θ + dt gust,    F = A - K + dt Dμ(m),
    Σ' = F Σ F' + dt (F C ψ + (F C ψ)') + dt² (ψ' ψ + white),    C = Cov(e, θ),
    C' = ρ (F C + dt ψ'),               ρ = 1 within a slot,
    m' = A m + dt (B u + μ(m) + ½ D²μ : Σ + ∂ψ : C).

The last two terms are the mean shift, the second order of E[w(x)]; planned controls steer against it. Nothing
but m depends on the control, so a vertex knows the covariance of all its children.
"""

from __future__ import annotations

import numpy as np

from pareto_ltl.kernels.data import Modes, Motion, Tables, Wind
from pareto_ltl.kernels.interpolation import at, bilinear, gust, place
from pareto_ltl.kernels.jit import kernel, vector
from pareto_ltl.support.arrays import Float32Array

F32 = np.float32


@kernel
def square(modes: Modes, x: float, y: float) -> tuple[int, int, float, float]:
    """Square of the modes' lattice that holds a point, and the fractions within it."""
    return place(modes, modes.psi.shape[1], modes.psi.shape[2], x, y)


@kernel
def closed_loop(
    wind: Wind, modes: Modes, motion: Motion, step: int, x: float, y: float
) -> tuple[float, float, float, float]:
    """F = A - K + dt Dμ(x), row by row."""
    i, j, fx, fy = place(wind, wind.mean.shape[1], wind.mean.shape[2], x, y)
    k, w = wind.slot[step], wind.weight[step]
    xx, xy = bilinear(modes.slope, k, i, j, fx, fy, 0)
    yx, yy = bilinear(modes.slope, k, i, j, fx, fy, 2)
    if w > 0.0:
        a, b = bilinear(modes.slope, k + 1, i, j, fx, fy, 0)
        c, d = bilinear(modes.slope, k + 1, i, j, fx, fy, 2)
        xx, xy, yx, yy = (
            (1 - w) * xx + w * a,
            (1 - w) * xy + w * b,
            (1 - w) * yx + w * c,
            (1 - w) * yy + w * d,
        )
    f, dt = motion.closed, motion.dt
    return f[0, 0] + dt * xx, f[0, 1] + dt * xy, f[1, 0] + dt * yx, f[1, 1] + dt * yy


@kernel
def curvature(
    wind: Wind, modes: Modes, step: int, x: float, y: float, cxx: float, cxy: float, cyy: float
) -> tuple[float, float]:
    """½ D²μ : Σ, the part of the mean shift that the expected wind's curvature makes [m/s]."""
    i, j, fx, fy = place(wind, wind.mean.shape[1], wind.mean.shape[2], x, y)
    k, w = wind.slot[step], wind.weight[step]
    east, north = _bent(modes, k, i, j, fx, fy, cxx, cxy, cyy)
    if w > 0.0:
        e1, n1 = _bent(modes, k + 1, i, j, fx, fy, cxx, cxy, cyy)
        east, north = (1 - w) * east + w * e1, (1 - w) * north + w * n1
    return east, north


@kernel
def _bent(
    modes: Modes, k: int, i: int, j: int, fx: float, fy: float, cxx: float, cxy: float, cyy: float
) -> tuple[float, float]:
    exx, exy = bilinear(modes.bend, k, i, j, fx, fy, 0)
    eyy, nxx = bilinear(modes.bend, k, i, j, fx, fy, 2)
    nxy, nyy = bilinear(modes.bend, k, i, j, fx, fy, 4)
    return (
        0.5 * (exx * cxx + 2.0 * exy * cxy + eyy * cyy),
        0.5 * (nxx * cxx + 2.0 * nxy * cxy + nyy * cyy),
    )


@vector
def stride(
    psi: Float32Array, k: int, i: int, j: int, fx: float, fy: float, c: int,
    own: Float32Array, row: int, to: Float32Array, target: int, keep: float,
    f00: float, f01: float, f10: float, f11: float, dt: float, per_metre: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Component c of the field: C' into ``to[target, :, c]`` from C in ``own[row, :, c]``.

    Returns |ψ|², (C ψ) for both rows of C, and ∂ψ : C.
    """
    w00, w10 = F32((1 - fx) * (1 - fy)), F32(fx * (1 - fy))
    w01, w11 = F32((1 - fx) * fy), F32(fx * fy)
    lower, upper, left, right = F32(1 - fy), F32(fy), F32(1 - fx), F32(fx)
    east, north = F32(keep * dt * (1 - c)), F32(keep * dt * c)
    a00, a01, a10, a11 = F32(keep * f00), F32(keep * f01), F32(keep * f10), F32(keep * f11)
    size, cx, cy, shift = F32(0.0), F32(0.0), F32(0.0), F32(0.0)
    for m in range(psi.shape[4]):
        p00, p10 = psi[k, i, j, c, m], psi[k, i + 1, j, c, m]
        p01, p11 = psi[k, i, j + 1, c, m], psi[k, i + 1, j + 1, c, m]
        p = w00 * p00 + w10 * p10 + w01 * p01 + w11 * p11
        ox, oy = own[row, 0, c, m], own[row, 1, c, m]
        size += p * p
        cx += ox * p
        cy += oy * p
        shift += (lower * (p10 - p00) + upper * (p11 - p01)) * ox
        shift += (left * (p01 - p00) + right * (p11 - p10)) * oy
        to[target, 0, c, m] = a00 * ox + a01 * oy + east * p
        to[target, 1, c, m] = a10 * ox + a11 * oy + north * p
    return size, cx, cy, shift * per_metre  # type: ignore[return-value]


@kernel
def carry(
    tables: Tables, step: int, x: float, y: float, cxx: float, cxy: float, cyy: float,
    own: Float32Array, row: int, to: Float32Array, target: int,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Mean with the motors off and covariance one step later; C' into ``to[target]``.

    ``own``, ``to`` (N, 2, 2, P): C = Cov(e, θ) by row of e and component of the wind. They may be one row.
    """
    wind, modes, motion = tables.wind, tables.modes, tables.motion
    dt = motion.dt
    f00, f01, f10, f11 = closed_loop(wind, modes, motion, step, x, y)
    k = modes.slot[step]
    keep = modes.keep[step + 1]
    i, j, fx, fy = square(modes, x, y)
    ee, exx, eyx, east = stride(
        modes.psi, k, i, j, fx, fy, 0, own, row, to, target, keep, f00, f01, f10, f11, dt, modes.per_metre
    )
    nn, nxx, nyx, north = stride(
        modes.psi, k, i, j, fx, fy, 1, own, row, to, target, keep, f00, f01, f10, f11, dt, modes.per_metre
    )
    white_e, white_n = white(tables, step, x, y, ee, nn)
    p0, p1 = f00 * cxx + f01 * cxy, f00 * cxy + f01 * cyy
    q0, q1 = f10 * cxx + f11 * cxy, f10 * cxy + f11 * cyy
    m00, m01 = f00 * exx + f01 * eyx, f00 * nxx + f01 * nyx
    m10, m11 = f10 * exx + f11 * eyx, f10 * nxx + f11 * nyx
    sxx = p0 * f00 + p1 * f01 + 2.0 * dt * m00 + dt * dt * (ee + white_e)
    sxy = p0 * f10 + p1 * f11 + dt * (m01 + m10)
    syy = q0 * f10 + q1 * f11 + 2.0 * dt * m11 + dt * dt * (nn + white_n)
    we, wn = at(wind.mean, wind, step, x, y)
    be, bn = curvature(wind, modes, step, x, y, cxx, cxy, cyy)
    a = motion.a
    return (
        a[0, 0] * x + a[0, 1] * y + dt * (we + be + east),
        a[1, 0] * x + a[1, 1] * y + dt * (wn + bn + north),
        sxx, sxy, syy,
    )  # fmt: skip


@kernel
def white(tables: Tables, step: int, x: float, y: float, ee: float, nn: float) -> tuple[float, float]:
    """Variance of the part that is new at every step: gusts, and what ``ee`` = |ψ|² leaves of the latent
    variance, so that both laws have the same wind at one place and time."""
    ge, gn = gust(tables.wind, step)
    ve, vn = at(tables.wind.latent, tables.wind, step, x, y)
    share = tables.modes.white
    return share * (ge + max(ve - ee, 0.0)), share * (gn + max(vn - nn, 0.0))


@vector
def blown(
    psi: Float32Array, k: int, i: int, j: int, fx: float, fy: float, c: int, theta: Float32Array, run: int
) -> tuple[float, float]:
    """ψ(x)' θ of component c, and |ψ|²; ``theta`` (n, K, 2, P)."""
    w00, w10 = F32((1 - fx) * (1 - fy)), F32(fx * (1 - fy))
    w01, w11 = F32((1 - fx) * fy), F32(fx * fy)
    wind, size = F32(0.0), F32(0.0)
    for m in range(psi.shape[4]):
        p = w00 * psi[k, i, j, c, m] + w10 * psi[k, i + 1, j, c, m]
        p += w01 * psi[k, i, j + 1, c, m] + w11 * psi[k, i + 1, j + 1, c, m]
        wind += p * theta[run, k, c, m]
        size += p * p
    return wind, size  # type: ignore[return-value]
