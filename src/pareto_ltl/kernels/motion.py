"""Airspeed, and one step of the Gaussian in the paper's wind law, which draws the wind of every step anew."""

from __future__ import annotations

import math

from pareto_ltl.kernels.data import Ahead, IndependentLaw, Motion, Wind
from pareto_ltl.kernels.interpolation import gust_variance, wind_at
from plane_kernels.types import Cov, Gaussian, Point
from typed_kernels.jit import inlined, kernel

# The maximum-trace rule evaluates the centre and eight points on the boundary of the ball: the latent
# variance is smooth at the size of the ball, so its largest value is at the centre or on the boundary.
_HALF = math.sqrt(0.5)
BALL = (
    (1.0, 0.0), (_HALF, _HALF), (0.0, 1.0), (-_HALF, _HALF), (-1.0, 0.0), (-_HALF, -_HALF), (0.0, -1.0),
    (_HALF, -_HALF),
)  # fmt: skip


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


@kernel
def independent_step(law: IndependentLaw, step: int, here: Gaussian) -> Ahead:
    """One step ahead of the Gaussian ``here``.

    Eq. (M21) of docs/mathematics.md.
    """
    motion = law.motion
    speed = airspeed_left(motion, scaled_cov(motion.gain * motion.gain, here.cov))
    return Ahead(drift(law.wind, motion, step, here.mean), spread(law.wind, motion, step, here), speed)
