"""One step of the Gaussian, under each wind law (``advance``).

With e = x - m the deviation from the mean and θ the coefficients of the field, the coherent law is

    e' = F e + h ψ(m)' θ + h gust,    F = A - K + h Dμ(m),    h = φ dt,
    Σ' = F Σ F' + h (F C ψ + (F C ψ)') + h² (ψ' ψ + white),    C = Cov(e, θ),
    C' = ρ (F C + h ψ'),               ρ = 1 within a slot,
    m' = A m + dt (B u + μ(m) + ½ D²μ : Σ + ∂ψ : C).

φ is the share of a step's wind error that position feedback leaves, 1 without it (M2).
The last two terms are the mean shift, the second-order part of E[w(x)]; planned controls compensate it.
Only m depends on the control.
"""

from __future__ import annotations

from pareto_ltl.kernels.data import (
    Ahead,
    CoherentLaw,
    CoherentMemory,
    IndependentLaw,
    LandmarkLaw,
    Law,
    Memory,
    Modes,
    Square,
)
from pareto_ltl.kernels.interpolation import (
    F32,
    bilinear,
    corner_weights,
    gust_variance,
    mode_square,
    mode_value,
    pair_at,
    wind_at,
    wind_square,
)
from pareto_ltl.kernels.motion import airspeed_left, independent_step, left_time, scaled_cov
from pareto_ltl.support.arrays import Float32Array
from plane_kernels.types import Cov, Gaussian, Linear, Point
from typed_kernels.jit import by_type, implements, kernel, vector


@by_type
def advance(law: Law, memory: Memory, step: int, here: Gaussian, row: int, target: int) -> Ahead:
    """One step ahead of the Gaussian ``here`` under a wind law: an :class:`~pareto_ltl.kernels.data.Ahead`.

    Row ``row`` of ``memory`` belongs to the step before ``here`` and is read; row ``target`` belongs to
    ``here`` and is written (both are 0 at the start).
    """
    raise NotImplementedError


@implements(advance, IndependentLaw)
def _advance_independent(
    law: IndependentLaw, _memory: None, step: int, here: Gaussian, _row: int, _target: int
) -> Ahead:
    return independent_step(law, step, here)


# --- coherent law -----------------------------------------------------------------------------


@kernel
def closed_loop(law: CoherentLaw | LandmarkLaw, step: int, at: Point) -> Linear:
    """F = A - K + φ dt Dμ(x).

    Eq. (M22) of docs/mathematics.md.
    """
    square = wind_square(law.wind, at)
    xx, xy = pair_at(law.modes.slope, law.wind, step, square, 0)
    yx, yy = pair_at(law.modes.slope, law.wind, step, square, 2)
    f, dt = law.motion.closed, left_time(law.motion)
    return Linear(f[0, 0] + dt * xx, f[0, 1] + dt * xy, f[1, 0] + dt * yx, f[1, 1] + dt * yy)


@kernel
def curvature(law: CoherentLaw | LandmarkLaw, step: int, here: Gaussian) -> tuple[float, float]:
    """½ D²μ : Σ [m/s], the part of the mean shift due to the second derivatives of the expected wind.

    Eq. (M24) of docs/mathematics.md.
    """
    square = wind_square(law.wind, here.mean)
    k, w = law.wind.slot[step], law.wind.weight[step]
    east, north = _slot_curvature(law.modes, k, square, here.cov)
    if w > 0.0:
        e1, n1 = _slot_curvature(law.modes, k + 1, square, here.cov)
        east, north = (1 - w) * east + w * e1, (1 - w) * north + w * n1
    return east, north


@kernel
def _slot_curvature(modes: Modes, slot: int, square: Square, cov: Cov) -> tuple[float, float]:
    exx, exy = bilinear(modes.bend, slot, square, 0)
    eyy, nxx = bilinear(modes.bend, slot, square, 2)
    nxy, nyy = bilinear(modes.bend, slot, square, 4)
    return (
        0.5 * (exx * cov.xx + 2.0 * exy * cov.xy + eyy * cov.yy),
        0.5 * (nxx * cov.xx + 2.0 * nxy * cov.xy + nyy * cov.yy),
    )


@kernel
def white_variance(
    law: CoherentLaw | LandmarkLaw, step: int, at: Point, ee: float, nn: float
) -> tuple[float, float]:
    """Variance of the wind error that is independent from step to step, east and north [m²/s²].

    It consists of gusts and of the smooth error that the modes do not represent, whose variance is reduced by
    ``ee``, ``nn`` = |ψ|². Averaging over a step multiplies them by ``modes.white`` and ``modes.rest``.

    Eq. (M19) of docs/mathematics.md.
    """
    ge, gn = gust_variance(law.wind, step)
    ve, vn = wind_at(law.wind.latent, law.wind, step, at)
    share, rest, between = law.modes.white, law.modes.rest, law.wind.between[step]
    return share * ge + rest * max(ve + between - ee, 0.0), share * gn + rest * max(vn + between - nn, 0.0)


@vector
def carry_modes(
    modes: Modes, step: int, square: Square, c: int, theta: Float32Array, rows: tuple[int, int],
    f: Linear, dt: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """For wind component c, compute C' in row ``rows[1]`` of ``theta`` from C in row ``rows[0]``.

    Returns |ψ|², the two components of C ψ, and ∂ψ : C.

    Eqs. (M23) and (M24) of docs/mathematics.md.
    """
    psi, k = modes.psi, modes.slot[step]
    kept, scale = modes.kept[step + 1], modes.scale[step]
    i, j, fx, fy = square
    row, target = rows
    weights = corner_weights(square)
    lower, upper, left, right = F32(1 - fy), F32(fy), F32(1 - fx), F32(fx)
    east, north = F32(dt * (1 - c)), F32(dt * c)
    a00, a01, a10, a11 = F32(f.xx), F32(f.xy), F32(f.yx), F32(f.yy)
    size, cx, cy, shift = F32(0.0), F32(0.0), F32(0.0), F32(0.0)
    for m in range(psi.shape[4]):
        p00, p10 = psi[k, i, j, c, m], psi[k, i + 1, j, c, m]
        p01, p11 = psi[k, i, j + 1, c, m], psi[k, i + 1, j + 1, c, m]
        p = scale[m] * mode_value(psi, k, square, weights, c, m)
        ox, oy = theta[row, 0, c, m], theta[row, 1, c, m]
        size += p * p
        cx += ox * p
        cy += oy * p
        shift += scale[m] * (lower * (p10 - p00) + upper * (p11 - p01)) * ox
        shift += scale[m] * (left * (p01 - p00) + right * (p11 - p10)) * oy
        theta[target, 0, c, m] = kept[m] * (a00 * ox + a01 * oy + east * p)
        theta[target, 1, c, m] = kept[m] * (a10 * ox + a11 * oy + north * p)
    return size, cx, cy, shift * modes.per_metre  # type: ignore[return-value]


@kernel
def carry(
    law: CoherentLaw | LandmarkLaw, step: int, here: Gaussian, theta: Float32Array, row: int, target: int
) -> tuple[Point, Cov]:
    """Mean with zero airspeed [m] and covariance [m²] one step later; C' is written to ``theta[target]``.

    C = Cov(e, θ) (2, 2, P), by component of e and of the wind, is read from ``theta[row]``; both may be the
    same row.

    Eqs. (M23) and (M24) of docs/mathematics.md.
    """
    modes, motion, at = law.modes, law.motion, here.mean
    dt, left = motion.dt, left_time(motion)
    f = closed_loop(law, step, at)
    square, rows = mode_square(modes, at), (row, target)
    ee, exx, eyx, east = carry_modes(modes, step, square, 0, theta, rows, f, left)
    nn, nxx, nyx, north = carry_modes(modes, step, square, 1, theta, rows, f, left)
    white_e, white_n = white_variance(law, step, at, ee, nn)
    cxx, cxy, cyy = here.cov
    p0, p1 = f.xx * cxx + f.xy * cxy, f.xx * cxy + f.xy * cyy
    q0, q1 = f.yx * cxx + f.yy * cxy, f.yx * cxy + f.yy * cyy
    m00, m01 = f.xx * exx + f.xy * eyx, f.xx * nxx + f.xy * nyx
    m10, m11 = f.yx * exx + f.yy * eyx, f.yx * nxx + f.yy * nyx
    cov = Cov(
        p0 * f.xx + p1 * f.xy + 2.0 * left * m00 + left * left * (ee + white_e),
        p0 * f.yx + p1 * f.yy + left * (m01 + m10),
        q0 * f.yx + q1 * f.yy + 2.0 * left * m11 + left * left * (nn + white_n),
    )
    we, wn = wind_at(law.wind.mean, law.wind, step, at)
    be, bn = curvature(law, step, here)
    a = motion.a
    return Point(
        a[0, 0] * at.x + a[0, 1] * at.y + dt * (we + be + east),
        a[1, 0] * at.x + a[1, 1] * at.y + dt * (wn + bn + north),
    ), cov  # fmt: skip


@implements(advance, CoherentLaw)
def _advance_coherent(
    law: CoherentLaw, memory: CoherentMemory, step: int, here: Gaussian, row: int, target: int
) -> Ahead:
    mean, cov = carry(law, step, here, memory.theta, row, target)
    motion = law.motion
    return Ahead(mean, cov, airspeed_left(motion, scaled_cov(motion.gain * motion.gain, here.cov)))


@by_type
def forget(law: Law, memory: Memory) -> None:
    """Reset row 0 of the memory of a law to the start: Cov(e, θ) = 0 and no fixes."""


@implements(forget, IndependentLaw)
def _forget_nothing(law: IndependentLaw, memory: None) -> None:
    pass


@kernel
def clear_theta(theta: Float32Array) -> None:
    """Set row 0 of ``theta`` (N, 2, 2, P) to 0."""
    for r in range(2):
        for c in range(2):
            for m in range(theta.shape[3]):
                theta[0, r, c, m] = F32(0.0)


@implements(forget, CoherentLaw)
def _forget_field(_law: CoherentLaw, memory: CoherentMemory) -> None:
    clear_theta(memory.theta)
