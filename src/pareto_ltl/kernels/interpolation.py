"""Wind between the nodes of its lattice: bilinear in space, linear in time."""

from __future__ import annotations

import math

from pareto_ltl.kernels.data import Modes, Motion, Wind
from pareto_ltl.kernels.jit import kernel
from pareto_ltl.support.arrays import FloatArray

# The maximum-trace rule looks at the centre and at eight points of the ball's rim: the latent variance is
# smooth at the size of the ball, so that its largest value there lies at the centre or on the rim.
_HALF = math.sqrt(0.5)
BALL = (
    (1.0, 0.0), (_HALF, _HALF), (0.0, 1.0), (-_HALF, _HALF), (-1.0, 0.0), (-_HALF, -_HALF), (0.0, -1.0),
    (_HALF, -_HALF),
)  # fmt: skip


@kernel
def place(lattice: Wind | Modes, nx: int, ny: int, x: float, y: float) -> tuple[int, int, float, float]:
    """The square of a lattice of ``nx`` by ``ny`` nodes that holds a point, clamped; fractions within it."""
    gx = min(max((x - lattice.west) * lattice.per_metre, 0.0), nx - 1.0)
    gy = min(max((y - lattice.south) * lattice.per_metre, 0.0), ny - 1.0)
    i, j = min(int(gx), nx - 2), min(int(gy), ny - 2)
    return i, j, gx - i, gy - j


@kernel
def at(table: FloatArray, wind: Wind, step: int, x: float, y: float) -> tuple[float, float]:
    """Both components of ``table`` (K, NX, NY, 2) at a position, clamped to the lattice, and a step."""
    i, j, fx, fy = place(wind, table.shape[1], table.shape[2], x, y)
    k, w = wind.slot[step], wind.weight[step]
    e, n = bilinear(table, k, i, j, fx, fy, 0)
    if w > 0.0:
        e1, n1 = bilinear(table, k + 1, i, j, fx, fy, 0)
        e, n = (1 - w) * e + w * e1, (1 - w) * n + w * n1
    return e, n


@kernel
def bilinear(
    table: FloatArray, k: int, i: int, j: int, fx: float, fy: float, first: int
) -> tuple[float, float]:
    """Entries ``first`` and ``first + 1`` of slot k of ``table`` in square (i, j), at fractions (fx, fy) of
    it.
    """
    a, b, c, d = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
    h, l, p, q = i + 1, j + 1, first, first + 1  # noqa: E741
    return (
        a * table[k, i, j, p] + b * table[k, h, j, p] + c * table[k, i, l, p] + d * table[k, h, l, p],
        a * table[k, i, j, q] + b * table[k, h, j, q] + c * table[k, i, l, q] + d * table[k, h, l, q],
    )  # fmt: skip


@kernel
def gust(wind: Wind, step: int) -> tuple[float, float]:
    """Variance of the white part at a step."""
    k, w = wind.slot[step], wind.weight[step]
    e, n = wind.gust[k, 0], wind.gust[k, 1]
    if w > 0.0:
        e, n = (1 - w) * e + w * wind.gust[k + 1, 0], (1 - w) * n + w * wind.gust[k + 1, 1]
    return e, n


@kernel
def worst_variance(wind: Wind, step: int, x: float, y: float, radius: float) -> tuple[float, float]:
    """Σ_w at the point of largest trace in the ball B(x, radius), by sampling (Section III)."""
    best_e, best_n = at(wind.latent, wind, step, x, y)
    if radius > 0.0:
        for dx, dy in BALL:
            e, n = at(wind.latent, wind, step, x + radius * dx, y + radius * dy)
            if e + n > best_e + best_n:
                best_e, best_n = e, n
    gust_e, gust_n = gust(wind, step)
    return best_e + gust_e, best_n + gust_n


@kernel
def drift(wind: Wind, motion: Motion, step: int, x: float, y: float) -> tuple[float, float]:
    """Where the robot is expected one step later with its motors off: A x + dt μ(x, t)."""
    e, n = at(wind.mean, wind, step, x, y)
    a, dt = motion.a, motion.dt
    return a[0, 0] * x + a[0, 1] * y + dt * e, a[1, 0] * x + a[1, 1] * y + dt * n


@kernel
def spread(
    wind: Wind, motion: Motion, step: int, x: float, y: float, cxx: float, cxy: float, cyy: float
) -> tuple[float, float, float]:
    """Covariance one step later: A Σ A' + dt² Σ_w(x*), whatever the control; A - K in place of A with
    feedback.
    """
    radius = motion.ball * math.sqrt(0.5 * (cxx + cyy))
    ve, vn = worst_variance(wind, step, x, y, radius)
    a, dt2 = motion.closed, motion.dt * motion.dt
    p0, p1 = a[0, 0] * cxx + a[0, 1] * cxy, a[0, 0] * cxy + a[0, 1] * cyy
    q0, q1 = a[1, 0] * cxx + a[1, 1] * cxy, a[1, 0] * cxy + a[1, 1] * cyy
    return (
        p0 * a[0, 0] + p1 * a[0, 1] + dt2 * ve,
        p0 * a[1, 0] + p1 * a[1, 1],
        q0 * a[1, 0] + q1 * a[1, 1] + dt2 * vn,
    )


@kernel
def allowed(motion: Motion, cxx: float, cxy: float, cyy: float) -> float:
    """Airspeed left for the planned control: u_max less what feedback asks for but seldom exceeds.

    Feedback is B⁻¹ c / dt with c of the given covariance [m²], and P(‖B⁻¹ c‖ > r) <= exp(-r² / 2 λ) with λ
    the largest eigenvalue of B⁻¹ Cov(c) B⁻': ``effort`` is r / √λ for the probability allowed.
    """
    if cxx <= 0.0 and cyy <= 0.0:
        return motion.u_max
    b = motion.b_inv
    ex, ey = b[0, 0] * cxx + b[0, 1] * cxy, b[0, 0] * cxy + b[0, 1] * cyy
    nx, ny = b[1, 0] * cxx + b[1, 1] * cxy, b[1, 0] * cxy + b[1, 1] * cyy
    ee, en, nn = ex * b[0, 0] + ey * b[0, 1], ex * b[1, 0] + ey * b[1, 1], nx * b[1, 0] + ny * b[1, 1]
    widest = 0.5 * (ee + nn) + math.sqrt(0.25 * (ee - nn) * (ee - nn) + en * en)
    return max(motion.u_max - motion.effort / motion.dt * math.sqrt(max(widest, 0.0)), 0.0)


@kernel
def airspeed(motion: Motion, dx: float, dy: float) -> float:
    """‖u‖ that moves the drift by (dx, dy) in one step."""
    b = motion.b_inv
    ux, uy = (b[0, 0] * dx + b[0, 1] * dy) / motion.dt, (b[1, 0] * dx + b[1, 1] * dy) / motion.dt
    return math.sqrt(ux * ux + uy * uy)
