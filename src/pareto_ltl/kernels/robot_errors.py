"""The robot's own errors: of its airspeed, heading and clock, each constant over a flight.

A robot that commands the airspeed and heading of u moves through the air with

    (1 + a) R(b) (u_t + c / dt (u_{t-1} - u_t)),    (a, b, c) = m + L κ,  κ ~ N(0, I),

R(b) a rotation and κ drawn once a flight: an airspeed indicator off by the share a, a compass off by the
angle b, and a clock late by c, so that the control of each step lasts for c longer. With S = L L' and
vectors as complex numbers, the mean velocity is exactly

    P u_t + Q / dt (u_{t-1} - u_t),    P = e^(i m_b - S_bb/2) (1 + m_a + i S_ab),
    Q = P (m_c + i S_bc) + e^(i m_b - S_bb/2) S_ac:

planned controls compensate it, so that they are what the robot's instruments show. About the mean errors the
velocity is linear in κ, by E_t, and

    e' = F e + h (ψ' θ + E_t κ + white),
    C' = F C + h E_t,    C = Cov(e, κ),     Σ' <- Σ' + h (F C E' + E C' F') + h² E E'.

So the three are coefficients beside the θ of the wind: a fix informs about them, and a robot steers against
what it knows.
"""

from __future__ import annotations

import cmath
import math

from pareto_ltl.kernels.data import (
    CoherentLaw,
    FlightErrors,
    IndependentLaw,
    LandmarkLaw,
    Law,
    Motion,
    RobotErrors,
)
from plane_kernels.gaussian import FixWeights
from plane_kernels.types import Cov, Linear, Point
from typed_kernels.jit import by_type, implements, kernel

AIRSPEED, HEADING, CLOCK = range(3)  # the coefficients, in order


@kernel
def variance_of(law: RobotErrors, q: int, r: int) -> float:
    """Covariance of the errors ``q`` and ``r``."""
    total = 0.0
    for k in range(len(law.mean)):
        total += law.root[q, k] * law.root[r, k]
    return total


@kernel
def mean_flown(law: RobotErrors) -> tuple[complex, complex]:
    """P, and Q [s]: the mean velocity is P u_t + Q / dt (u_{t-1} - u_t).

    Eq. (M24c) of docs/mathematics.md.
    """
    if len(law.mean) == 0:
        return 1.0 + 0.0j, 0.0j
    mean = law.mean
    turned = cmath.exp(complex(-0.5 * variance_of(law, HEADING, HEADING), mean[HEADING]))
    scaled = turned * complex(1.0 + mean[AIRSPEED], variance_of(law, AIRSPEED, HEADING))
    late = complex(mean[CLOCK], variance_of(law, HEADING, CLOCK))
    return scaled, scaled * late + turned * variance_of(law, AIRSPEED, CLOCK)


@kernel
def set_control(errors: FlightErrors, motion: Motion, t: int, drifted: Point) -> Point:
    """Fill the control or the next mean, and E of step ``t``; ``drifted`` is the mean without control [m].

    Returns the point from which the control leads to the next mean, without errors [m].

    Eq. (M24c) of docs/mathematics.md.
    """
    b, b_inv, dt, x, u = motion.b, motion.b_inv, motion.dt, errors.x, errors.u
    scaled, late = mean_flown(errors.law)
    late = late / dt if t > 0 else 0.0j  # the first step has no control before it
    held = late * complex(u[t - 1, 0], u[t - 1, 1]) if t > 0 else 0.0j
    if not errors.steered[0]:
        dx, dy = x[t + 1, 0] - drifted.x, x[t + 1, 1] - drifted.y
        east = (b_inv[0, 0] * dx + b_inv[0, 1] * dy) / dt
        north = (b_inv[1, 0] * dx + b_inv[1, 1] * dy) / dt
        shown = (complex(east, north) - held) / (scaled - late)
        u[t, 0], u[t, 1] = shown.real, shown.imag
    control = complex(u[t, 0], u[t, 1])
    off = (scaled - late - 1.0) * control + held
    free = Point(
        drifted.x + dt * (b[0, 0] * off.real + b[0, 1] * off.imag),
        drifted.y + dt * (b[1, 0] * off.real + b[1, 1] * off.imag),
    )
    if errors.steered[0]:
        x[t + 1, 0] = free.x + dt * (b[0, 0] * u[t, 0] + b[0, 1] * u[t, 1])
        x[t + 1, 1] = free.y + dt * (b[1, 0] * u[t, 0] + b[1, 1] * u[t, 1])
    if len(errors.law.mean):
        set_push(errors, motion, t)
    return free


@kernel
def set_push(errors: FlightErrors, motion: Motion, t: int) -> None:
    """Fill E of step ``t`` from the controls: the slopes of the velocity at the mean errors, by κ.

    Eq. (M24b) of docs/mathematics.md.
    """
    b, u, law = motion.b, errors.u, errors.law
    before = max(t - 1, 0)
    control = complex(u[t, 0], u[t, 1])
    change = (complex(u[before, 0], u[before, 1]) - control) / motion.dt
    turned = cmath.exp(complex(0.0, law.mean[HEADING]))
    ahead = turned * (control + law.mean[CLOCK] * change)
    slopes = (ahead, 1j * (1.0 + law.mean[AIRSPEED]) * ahead, (1.0 + law.mean[AIRSPEED]) * turned * change)
    for q in range(len(law.mean)):
        by = slopes[0] * law.root[0, q] + slopes[1] * law.root[1, q] + slopes[2] * law.root[2, q]
        errors.push[t, 0, q] = b[0, 0] * by.real + b[0, 1] * by.imag
        errors.push[t, 1, q] = b[1, 0] * by.real + b[1, 1] * by.imag


@kernel
def carry_errors(errors: FlightErrors, t: int, f: Linear, left: float, cov: Cov) -> Cov:
    """The covariance after step ``t`` [m²] of which ``cov`` lacks the errors of this step; fills C'.

    ``left`` is φ dt [s].

    Eq. (M24b) of docs/mathematics.md.
    """
    xx, xy, yy = cov
    for q in range(len(errors.law.mean)):
        cx, cy = errors.cross[t, 0, q], errors.cross[t, 1, q]
        mx, my = f.xx * cx + f.xy * cy, f.yx * cx + f.yy * cy
        ex, ey = left * errors.push[t, 0, q], left * errors.push[t, 1, q]
        xx += (2.0 * mx + ex) * ex
        xy += mx * ey + (my + ey) * ex
        yy += (2.0 * my + ey) * ey
        errors.cross[t + 1, 0, q], errors.cross[t + 1, 1, q] = mx + ex, my + ey
    return Cov(xx, xy, yy)


@by_type
def with_errors(law: Law, errors: FlightErrors, t: int, f: Linear, cov: Cov) -> Cov:
    """The covariance after step ``t`` [m²] with the robot's errors, which ``cov`` lacks in the coherent law.

    Under the law with landmarks ``advance`` adds them. Under the independent law a robot has none.
    """
    raise NotImplementedError


@implements(with_errors, IndependentLaw, LandmarkLaw)
def _unchanged(
    _law: IndependentLaw | LandmarkLaw, _errors: FlightErrors, _t: int, _f: Linear, cov: Cov
) -> Cov:  # fmt: skip
    return cov


@implements(with_errors, CoherentLaw)
def _with_errors(law: CoherentLaw, errors: FlightErrors, t: int, f: Linear, cov: Cov) -> Cov:
    return carry_errors(errors, t, f, law.motion.exposed * law.motion.dt, cov)


# --- with position fixes ----------------------------------------------------------------------


@kernel
def start_covariance(law: RobotErrors, variance: float) -> Cov:
    """Covariance of the start [m²], of which ``variance`` in each direction is not due to the errors."""
    xx, xy, yy = variance, 0.0, variance
    for q in range(len(law.mean)):
        xx += law.start[0, q] * law.start[0, q]
        xy += law.start[0, q] * law.start[1, q]
        yy += law.start[1, q] * law.start[1, q]
    return Cov(xx, xy, yy)


@kernel
def begin_errors(errors: FlightErrors) -> None:
    """Set C at departure."""
    for q in range(len(errors.law.mean)):
        errors.cross[0, 0, q], errors.cross[0, 1, q] = errors.law.start[0, q], errors.law.start[1, q]


@kernel
def add_errors(errors: FlightErrors, motion: Motion, t: int, f: Linear, drifted: Point, cov: Cov) -> Cov:
    """:func:`carry_errors` with the control of step ``t``, which leads on from ``drifted`` [m]."""
    if len(errors.law.mean) == 0:
        return cov
    set_control(errors, motion, t, drifted)
    return carry_errors(errors, t, f, motion.dt, cov)


@kernel
def learn_errors(errors: FlightErrors, t: int, f: int, weights: FixWeights, chance: float) -> None:
    """Kalman update of C at step ``t`` by fix ``f``, and its √p D, as by ``fixes.learn``.

    Eq. (M26) of docs/mathematics.md.
    """
    l00, l10, l11, gain = weights
    root = math.sqrt(chance)
    for q in range(len(errors.law.mean)):
        x, y = errors.cross[t, 0, q], errors.cross[t, 1, q]
        errors.gain[f, 0, q] = root * x / l00
        errors.gain[f, 1, q] = root * (y - l10 * x / l00) / l11
        errors.cross[t, 0, q] = x - chance * (gain.xx * x + gain.xy * y)
        errors.cross[t, 1, q] = y - chance * (gain.yx * x + gain.yy * y)


@kernel
def expected_error(errors: FlightErrors, t: int, f: int, r: int, c: int) -> float:
    """Component ``c`` of the velocity E_t D' of row ``r`` of fix ``f`` [m/s]."""
    velocity = 0.0
    for q in range(len(errors.law.mean)):
        velocity += errors.push[t, c, q] * errors.gain[f, r, q]
    return velocity


@kernel
def subtract_errors(errors: FlightErrors, t: int, f: int, r: int, east: float, north: float) -> None:
    """Subtract (``east``, ``north``) D of row ``r`` of fix ``f`` from C after step ``t``."""
    for q in range(len(errors.law.mean)):
        errors.cross[t + 1, 0, q] -= east * errors.gain[f, r, q]
        errors.cross[t + 1, 1, q] -= north * errors.gain[f, r, q]
