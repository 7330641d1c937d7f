"""The robot's own errors: of its airspeed, heading and clock, each constant over a flight.

A robot that commands the airspeed and heading of u moves through the air with

    (1 + a) R(b) (u_t + c / dt (u_{t-1} - u_t)),    a ~ N(0, σ_a²),  b ~ N(0, σ_b²),  c ~ N(0, σ_c²),

R(b) a rotation and a, b, c drawn once a flight: an airspeed indicator off by the share a, a compass off by
the angle b, and a clock late by c, so that the control of each step lasts for c longer. In the coefficients
κ = (a / σ_a, b / σ_b, c / σ_c) ~ N(0, I) this is linear about the plan,

    e' = F e + h (ψ' θ + E_t κ + white),    E_t = B (σ_a u_t, σ_b R(90°) u_t, σ_c (u_{t-1} - u_t) / dt),
    C' = F C + h E_t,    C = Cov(e, κ),     Σ' <- Σ' + h (F C E' + E C' F') + h² E E',

and its mean, to second order, is e^(-σ_b²/2) B u_t: planned controls compensate it. So the three are
coefficients beside the θ of the wind: a fix informs about them, and a robot steers against what it knows.
"""

from __future__ import annotations

import math

from pareto_ltl.kernels.data import (
    CoherentLaw,
    Cov,
    FlightErrors,
    IndependentLaw,
    LandmarkLaw,
    Law,
    Linear,
    Motion,
    Point,
)
from pareto_ltl.kernels.gaussian import FixWeights
from pareto_ltl.kernels.jit import by_type, implements, kernel
from pareto_ltl.support.arrays import FloatArray

AIRSPEED, HEADING, CLOCK = range(3)  # the coefficients, in order


@kernel
def straightness(sd: FloatArray) -> float:
    """E[cos b]: the share of a control that is flown on average with a heading error of ``sd`` (Q,)."""
    return math.exp(-0.5 * sd[1] * sd[1]) if len(sd) else 1.0


@kernel
def set_control(errors: FlightErrors, motion: Motion, t: int, drifted: Point) -> Point:
    """Fill the control or the next mean, and E of step ``t``; ``drifted`` is the mean without control [m].

    Returns the point from which the control leads to the next mean, without errors [m].

    Eq. (M24a) of docs/mathematics.md.
    """
    b, b_inv, dt, x, u = motion.b, motion.b_inv, motion.dt, errors.x, errors.u
    straight = straightness(errors.sd)
    if not errors.steered[0]:
        dx, dy = x[t + 1, 0] - drifted.x, x[t + 1, 1] - drifted.y
        u[t, 0] = (b_inv[0, 0] * dx + b_inv[0, 1] * dy) / dt / straight
        u[t, 1] = (b_inv[1, 0] * dx + b_inv[1, 1] * dy) / dt / straight
    flown_x = dt * (b[0, 0] * u[t, 0] + b[0, 1] * u[t, 1])
    flown_y = dt * (b[1, 0] * u[t, 0] + b[1, 1] * u[t, 1])
    free = Point(drifted.x + (straight - 1.0) * flown_x, drifted.y + (straight - 1.0) * flown_y)
    if errors.steered[0]:
        x[t + 1, 0], x[t + 1, 1] = free.x + flown_x, free.y + flown_y
    if len(errors.sd):
        set_push(errors, motion, t)
    return free


@kernel
def set_push(errors: FlightErrors, motion: Motion, t: int) -> None:
    """Fill E of step ``t`` from the controls.

    Eq. (M24a) of docs/mathematics.md.
    """
    b, u, sd = motion.b, errors.u, errors.sd
    before = max(t - 1, 0)
    late_x, late_y = (u[before, 0] - u[t, 0]) / motion.dt, (u[before, 1] - u[t, 1]) / motion.dt
    for r in range(2):
        push = errors.push[t, r]
        push[AIRSPEED] = sd[AIRSPEED] * (b[r, 0] * u[t, 0] + b[r, 1] * u[t, 1])
        push[HEADING] = sd[HEADING] * (b[r, 1] * u[t, 0] - b[r, 0] * u[t, 1])
        push[CLOCK] = sd[CLOCK] * (b[r, 0] * late_x + b[r, 1] * late_y)


@kernel
def carry_errors(errors: FlightErrors, t: int, f: Linear, left: float, cov: Cov) -> Cov:
    """The covariance after step ``t`` [m²] of which ``cov`` lacks the errors of this step; fills C'.

    ``left`` is φ dt [s].

    Eq. (M24b) of docs/mathematics.md.
    """
    xx, xy, yy = cov
    for q in range(len(errors.sd)):
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
def clear_errors(errors: FlightErrors) -> None:
    """Set C at departure to 0."""
    for q in range(len(errors.sd)):
        errors.cross[0, 0, q], errors.cross[0, 1, q] = 0.0, 0.0


@kernel
def add_errors(errors: FlightErrors, motion: Motion, t: int, f: Linear, drifted: Point, cov: Cov) -> Cov:
    """:func:`carry_errors` with the control of step ``t``, which leads on from ``drifted`` [m]."""
    if len(errors.sd) == 0:
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
    for q in range(len(errors.sd)):
        x, y = errors.cross[t, 0, q], errors.cross[t, 1, q]
        errors.gain[f, 0, q] = root * x / l00
        errors.gain[f, 1, q] = root * (y - l10 * x / l00) / l11
        errors.cross[t, 0, q] = x - chance * (gain.xx * x + gain.xy * y)
        errors.cross[t, 1, q] = y - chance * (gain.yx * x + gain.yy * y)


@kernel
def expected_error(errors: FlightErrors, t: int, f: int, r: int, c: int) -> float:
    """Component ``c`` of the velocity E_t D' of row ``r`` of fix ``f`` [m/s]."""
    velocity = 0.0
    for q in range(len(errors.sd)):
        velocity += errors.push[t, c, q] * errors.gain[f, r, q]
    return velocity


@kernel
def subtract_errors(errors: FlightErrors, t: int, f: int, r: int, east: float, north: float) -> None:
    """Subtract (``east``, ``north``) D of row ``r`` of fix ``f`` from C after step ``t``."""
    for q in range(len(errors.sd)):
        errors.cross[t + 1, 0, q] -= east * errors.gain[f, r, q]
        errors.cross[t + 1, 1, q] -= north * errors.gain[f, r, q]
