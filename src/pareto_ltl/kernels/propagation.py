"""One step of the Gaussian, under each wind law (``advance``).

With e = x - m the deviation from the mean and θ the coefficients of the field, the coherent law is

    e' = F e + h ψ(m)' θ + h gust,    F = A - K + h Dμ(m),    h = φ dt,
    Σ' = F Σ F' + h (F C ψ + (F C ψ)') + h² (ψ' ψ + white),    C = Cov(e, θ),
    C' = ρ (F C + h ψ'),               ρ = 1 within a slot,
    m' = A m + dt (B u + μ(m) + ½ D²μ : Σ + ∂ψ : C).

φ is the share of a step's wind error that position feedback leaves, 1 without it (M2).
The last two terms are the mean shift, the second-order part of E[w(x)]; planned controls compensate it.
Only m depends on the control, so all children of a vertex have the same covariance.
"""

from __future__ import annotations

import math

from pareto_ltl.kernels.data import (
    Ahead,
    CoherentLaw,
    CoherentMemory,
    Cov,
    Gaussian,
    IndependentLaw,
    LandmarkLaw,
    Law,
    Linear,
    Memory,
    Modes,
    Motion,
    Point,
    Square,
    Wind,
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
from pareto_ltl.kernels.jit import by_type, implements, inlined, kernel, vector
from pareto_ltl.support.arrays import Float32Array

# The maximum-trace rule evaluates the centre and eight points on the boundary of the ball: the latent
# variance is smooth at the size of the ball, so its largest value is at the centre or on the boundary.
_HALF = math.sqrt(0.5)
BALL = (
    (1.0, 0.0), (_HALF, _HALF), (0.0, 1.0), (-_HALF, _HALF), (-1.0, 0.0), (-_HALF, -_HALF), (0.0, -1.0),
    (_HALF, -_HALF),
)  # fmt: skip

# --- common to all laws -----------------------------------------------------------------------


@inlined
def airspeed(motion: Motion, dx: float, dy: float) -> float:
    """‖u‖ [m/s] of the control that moves the robot by (dx, dy) [m] relative to the drift in one step."""
    b = motion.b_inv
    ux, uy = (b[0, 0] * dx + b[0, 1] * dy) / motion.dt, (b[1, 0] * dx + b[1, 1] * dy) / motion.dt
    return math.sqrt(ux * ux + uy * uy)


@inlined
def left_time(motion: Motion) -> float:
    """φ dt [s]: a step's wind error, times this, is the deviation that feedback leaves at its end."""
    return motion.exposed * motion.dt


@kernel
def airspeed_left(motion: Motion, correction: Cov) -> float:
    """Airspeed left for the planned control [m/s]: u_max minus a quantile of the feedback.

    Feedback is B⁻¹ c / dt, where c has the given covariance [m²], and P(‖B⁻¹ c‖ > r) <= exp(-r² / 2 λ) with λ
    the largest eigenvalue of B⁻¹ Cov(c) B⁻'. ``motion.effort`` is r / √λ for the allowed probability.

    Eq. (M3) of docs/mathematics.md.
    """
    cxx, cxy, cyy = correction
    if cxx <= 0.0 and cyy <= 0.0:
        return motion.u_max
    b = motion.b_inv
    ex, ey = b[0, 0] * cxx + b[0, 1] * cxy, b[0, 0] * cxy + b[0, 1] * cyy
    nx, ny = b[1, 0] * cxx + b[1, 1] * cxy, b[1, 0] * cxy + b[1, 1] * cyy
    ee, en, nn = ex * b[0, 0] + ey * b[0, 1], ex * b[1, 0] + ey * b[1, 1], nx * b[1, 0] + ny * b[1, 1]
    widest = 0.5 * (ee + nn) + math.sqrt(0.25 * (ee - nn) * (ee - nn) + en * en)
    return max(motion.u_max - motion.effort / motion.dt * math.sqrt(max(widest, 0.0)), 0.0)


@inlined
def least_airspeed(motion: Motion, speed: float) -> float:
    """Smallest airspeed for planning [m/s]: u_min plus the reserve for feedback, u_max - ``speed``.

    It is 0 if u_min is 0, since feedback may stop or reverse such a robot.

    Eq. (M3) of docs/mathematics.md.
    """
    return motion.u_min + motion.u_max - speed if motion.u_min > 0.0 else 0.0


@inlined
def scaled_cov(factor: float, cov: Cov) -> Cov:
    """``factor`` times Σ."""
    return Cov(factor * cov.xx, factor * cov.xy, factor * cov.yy)


@by_type
def advance(law: Law, memory: Memory, step: int, here: Gaussian, row: int, target: int) -> Ahead:
    """One step ahead of the Gaussian ``here`` under a wind law: an :class:`~pareto_ltl.kernels.data.Ahead`.

    Row ``row`` of ``memory`` belongs to the parent of ``here`` and is read; row ``target`` belongs to
    ``here`` and is written (both are 0 at the start).
    """
    raise NotImplementedError


# --- independent law --------------------------------------------------------------------------


@kernel
def worst_variance(wind: Wind, step: int, at: Point, radius: float) -> tuple[float, float]:
    """Diagonal of Σ_w [m²/s²] at the point of largest trace in the ball B(x, radius), Section III.

    The ball is sampled. The error of interpolation in time, the same everywhere, is included.

    Eq. (M21) of docs/mathematics.md.
    """
    best_e, best_n = wind_at(wind.latent, wind, step, at)
    if radius > 0.0:
        for dx, dy in BALL:
            e, n = wind_at(wind.latent, wind, step, Point(at.x + radius * dx, at.y + radius * dy))
            if e + n > best_e + best_n:
                best_e, best_n = e, n
    gust_e, gust_n = gust_variance(wind, step)
    between = wind.between[step]
    return best_e + gust_e + between, best_n + gust_n + between


@kernel
def drift(wind: Wind, motion: Motion, step: int, at: Point) -> Point:
    """Expected position one step later with zero airspeed [m]: A x + dt μ(x, t).

    Eq. (M21) of docs/mathematics.md.
    """
    e, n = wind_at(wind.mean, wind, step, at)
    a, dt = motion.a, motion.dt
    return Point(
        a[0, 0] * at.x + a[0, 1] * at.y + dt * e, a[1, 0] * at.x + a[1, 1] * at.y + dt * n
    )  # fmt: skip


@kernel
def spread(wind: Wind, motion: Motion, step: int, here: Gaussian) -> Cov:
    """Covariance one step later [m²], for any control: A Σ A' + dt² Σ_w(x*).

    With feedback, A - K replaces A and φ dt replaces dt.

    Eq. (M21) of docs/mathematics.md.
    """
    cxx, cxy, cyy = here.cov
    radius = motion.ball * math.sqrt(0.5 * (cxx + cyy))
    ve, vn = worst_variance(wind, step, here.mean, radius)
    a, left = motion.closed, left_time(motion)
    dt2 = left * left
    p0, p1 = a[0, 0] * cxx + a[0, 1] * cxy, a[0, 0] * cxy + a[0, 1] * cyy
    q0, q1 = a[1, 0] * cxx + a[1, 1] * cxy, a[1, 0] * cxy + a[1, 1] * cyy
    return Cov(
        p0 * a[0, 0] + p1 * a[0, 1] + dt2 * ve,
        p0 * a[1, 0] + p1 * a[1, 1],
        q0 * a[1, 0] + q1 * a[1, 1] + dt2 * vn,
    )


@implements(advance, IndependentLaw)
def _advance_independent(
    law: IndependentLaw, _memory: None, step: int, here: Gaussian, _row: int, _target: int
) -> Ahead:
    motion = law.motion
    speed = airspeed_left(motion, scaled_cov(motion.gain * motion.gain, here.cov))
    return Ahead(drift(law.wind, motion, step, here.mean), spread(law.wind, motion, step, here), speed)


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
