"""What a robot commands in flight, by the type of its pilot."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

from pareto_ltl.kernels.data import Landmarks, Motion
from pareto_ltl.support.arrays import BoolArray, ComplexArray, Float32Array, FloatArray, IntArray
from plane_kernels.types import Point
from typed_kernels.jit import by_type, implements, inlined, kernel

SHARES = 8  # parts of a step in which a fix can lie: fixes in one part have the same gains


class Autopilot(NamedTuple):
    """Flies the controls ``u`` (T, 2) [m/s]; feedback, if any, steers towards ``mean`` (T+1, 2) [m]."""

    u: FloatArray
    mean: FloatArray


class RejoiningPilot(NamedTuple):
    """Flies the controls ``u`` (T, 2) [m/s], and at step t of flight i also ``change[t, i]`` (T, n, 2) [m/s].

    The change flies off a deviation that was measured. A control that it changes is limited to u_min and
    u_max.
    """

    u: FloatArray
    change: FloatArray


class FilterLaw(NamedTuple):
    """The law about the planned means, for T steps: e' = F e + dt (ψ' θ + E κ + white).

    ``x`` (T+1, 2) [m], ``u`` (T, 2) [m/s], ``F`` (T, 2, 2), ``psi`` (T, 2, P) [m/s], ``white`` (T, 2)
    [m²/s²], ``kept`` (S, P + R): ρ; ``variance`` of the start in each direction [m²]. The robot's own errors
    κ, with E = ``push`` (T, 2, Q) [m/s], are R = (Q + 1) // 2 more coefficients of each wind component for
    the filter (:func:`place_of_error`): they act on both components, and do not change. The start deviates by
    ``start`` (2, Q) κ [m] beside the variance.
    """

    x: FloatArray
    u: FloatArray
    F: FloatArray
    psi: Float32Array
    white: FloatArray
    kept: Float32Array
    variance: float
    push: FloatArray
    start: FloatArray


class Beliefs(NamedTuple):
    """Covariances of errors of estimates, one row for each history of fixes.

    ``step`` (N,) is when a row was last needed. ``cov`` (N, 2, 2) = Cov(ẽ) [m²], ``before``
    (N, 2, 2) the same a step ago, ``across`` (N, 2, 2) = Cov(ẽ_t, ẽ_{t-1}); ``cross`` (N, 2, 2P) =
    Cov(ẽ, θ̃), ``lagged`` (N, 2, 2P) = Cov(ẽ_{t-1}, θ̃). Cov(θ̃) = I - K'K, where K is the first ``rank``
    (N,) rows of ``known`` (N, 2P, 2P), zero left of its diagonal. ``gain`` (N, 2, 2) and ``learnt``
    (N, 2, 2P) are the gains of the last fix, one step before ``last`` (N,), 0 for none. ``child``
    (G, K, SHARES) is the row of a group after a fix at the step ``asked`` (G,), -1 for none. ``flights`` (N,)
    counts the flights of a row, ``used`` (1,) the rows ever used. ``push`` (2, 2P) is scratch.
    """

    cov: FloatArray
    before: FloatArray
    across: FloatArray
    cross: Float32Array
    lagged: Float32Array
    known: FloatArray
    rank: IntArray
    gain: FloatArray
    learnt: Float32Array
    child: IntArray
    flights: IntArray
    used: IntArray
    push: FloatArray
    step: IntArray
    last: IntArray
    asked: IntArray


class Moves(NamedTuple):
    """The linear law from each step t to the step ``end`` (T+1,).

    e' = A e + G θ + n and θ' = R θ + ζ, with A in ``turn`` (T+1, 2, 2), G in ``push`` (T+1, 2, 2P) [m],
    Cov(n) in ``noise`` (T+1, 2, 2) [m²], Cov(n, ζ) in ``mixed`` (T+1, 2, 2P) [m] and R in ``kept``
    (T+1, P); Cov(ζ) = I - R².
    """

    turn: FloatArray
    push: Float32Array
    noise: FloatArray
    mixed: Float32Array
    kept: Float32Array
    end: IntArray


class Navigator(NamedTuple):
    """Flies the controls of ``law`` and corrects them after fixes.

    ``root`` (K, 2, 2) is the lower root of the covariance of a fix [m], ``noise`` (T+1, n, 2) ~ N(0, 1).
    ``estimate`` (n, 4) = (ê_t, ê_{t-1}) [m], ``field`` (n, 2P) = θ̂, ``history`` (n,) the row of
    ``beliefs``, ``fixed`` (n,) whether a fix was taken. ``moves`` lead as far as rows have been carried,
    ``steps`` one step each. Flights with their last two fixes at the same steps have one history if it is
    ``shared``.
    """

    law: FilterLaw
    landmarks: Landmarks
    root: FloatArray
    noise: FloatArray
    estimate: FloatArray
    field: Float32Array
    history: IntArray
    fixed: BoolArray
    beliefs: Beliefs
    moves: Moves
    steps: Moves
    shared: bool


class ErringPilot(NamedTuple):
    """A ``pilot`` of erring robots, whose planned controls are ``u`` (T, 2) [m/s].

    Flight i flies p u_t + r (u_{t-1} - u_t) / dt of controls u as complex numbers, with p and r [s] in
    ``flown`` (n, 2); ``last`` (n, 2) is the control before, u_{t-1} [m/s].
    """

    pilot: Any
    u: FloatArray
    flown: ComplexArray
    last: FloatArray


Pilot: TypeAlias = Autopilot | RejoiningPilot | Navigator | ErringPilot


@by_type
def begin_flights(pilot: Pilot) -> None:
    """Reset what the pilots of earlier flights knew."""
    raise NotImplementedError


@by_type
def observe(pilot: Pilot, motion: Motion, t: int, x: FloatArray) -> None:
    """What all pilots measure on their way to step ``t`` of the flights ``x`` (n, T+1, 2) [m]."""
    raise NotImplementedError


@by_type
def command(
    pilot: Pilot, motion: Motion, t: int, i: int, at: Point, wind: Point
) -> tuple[float, float]:  # fmt: skip
    """Control [m/s] of flight ``i`` at step ``t`` and position ``at`` [m], in the ``wind`` it meets [m/s].

    A control that feedback or an estimate changes is limited to u_min and u_max.
    """
    raise NotImplementedError


@kernel
def within_airspeed(motion: Motion, ux: float, uy: float) -> tuple[float, float]:
    """Control with the same direction and an airspeed limited to [u_min, u_max]; 0 stays 0."""
    size = math.sqrt(ux * ux + uy * uy)
    if size > motion.u_max:
        return ux * motion.u_max / size, uy * motion.u_max / size
    if 0.0 < size < motion.u_min:
        return ux * motion.u_min / size, uy * motion.u_min / size
    return ux, uy


@implements(begin_flights, Autopilot)
def _begin_autopilot(_pilot: Autopilot) -> None:
    pass


@implements(observe, Autopilot)
def _observe_nothing(_pilot: Autopilot, _motion: Motion, _t: int, _x: FloatArray) -> None:
    pass


@implements(command, Autopilot)
def _command_autopilot(
    pilot: Autopilot, motion: Motion, t: int, _i: int, at: Point, wind: Point
) -> tuple[float, float]:  # fmt: skip
    """The planned control; with feedback u_t - B⁻¹ (K (x - m_t) / dt + (1 - φ) (w - w̄_t)).

    w̄ is the wind for which the plan flies from m_t to the next mean. A robot that always knows its position
    also counteracts, within the step, what the wind of the step does to it: the share 1 - φ.

    Eq. (M2) of docs/mathematics.md.
    """
    ux, uy = pilot.u[t, 0], pilot.u[t, 1]
    if motion.gain == 0.0:
        return ux, uy
    mean, a, b, b_inv, dt = pilot.mean, motion.a, motion.b, motion.b_inv, motion.dt
    mx, my = mean[t, 0], mean[t, 1]
    planned_x = (mean[t + 1, 0] - a[0, 0] * mx - a[0, 1] * my) / dt - b[0, 0] * ux - b[0, 1] * uy
    planned_y = (mean[t + 1, 1] - a[1, 0] * mx - a[1, 1] * my) / dt - b[1, 0] * ux - b[1, 1] * uy
    share, met = motion.gain / dt, 1.0 - motion.exposed
    ex = share * (at.x - mx) + met * (wind.x - planned_x)
    ey = share * (at.y - my) + met * (wind.y - planned_y)
    ux -= b_inv[0, 0] * ex + b_inv[0, 1] * ey
    uy -= b_inv[1, 0] * ex + b_inv[1, 1] * ey
    return within_airspeed(motion, ux, uy)


@implements(begin_flights, RejoiningPilot)
def _begin_rejoining(_pilot: RejoiningPilot) -> None:
    pass


@implements(observe, RejoiningPilot)
def _observe_before(_pilot: RejoiningPilot, _motion: Motion, _t: int, _x: FloatArray) -> None:
    pass


@implements(command, RejoiningPilot)
def _command_rejoining(
    pilot: RejoiningPilot, motion: Motion, t: int, i: int, _at: Point, _wind: Point
) -> tuple[float, float]:  # fmt: skip
    ux, uy = pilot.u[t, 0], pilot.u[t, 1]
    east, north = pilot.change[t, i, 0], pilot.change[t, i, 1]
    if east == 0.0 and north == 0.0:
        return ux, uy
    return within_airspeed(motion, ux + east, uy + north)


# --- the robot's own errors -------------------------------------------------------------------


@inlined
def place_of_error(q: int, modes: int, half: int) -> int:
    """Where a filter with ``half`` coefficients of each component, ``modes`` of the wind, has error ``q``."""
    return (q % 2) * half + modes + q // 2


@implements(begin_flights, ErringPilot)
def _begin_erring(pilot: ErringPilot) -> None:
    begin_flights(pilot.pilot)


@implements(observe, ErringPilot)
def _observe_erring(pilot: ErringPilot, motion: Motion, t: int, x: FloatArray) -> None:
    observe(pilot.pilot, motion, t, x)


@implements(command, ErringPilot)
def _command_erring(
    pilot: ErringPilot, motion: Motion, t: int, i: int, at: Point, wind: Point
) -> tuple[float, float]:  # fmt: skip
    """The velocity through the air that is flown, (M24a).

    A robot that always knows its position sees what its errors do to the planned control as a wind.
    """
    p, late, b, before = pilot.flown[i, 0], pilot.flown[i, 1] / motion.dt, motion.b, max(t - 1, 0)
    planned = complex(pilot.u[t, 0], pilot.u[t, 1])
    off = (p - 1.0) * planned + late * (complex(pilot.u[before, 0], pilot.u[before, 1]) - planned)
    met = Point(
        wind.x + b[0, 0] * off.real + b[0, 1] * off.imag, wind.y + b[1, 0] * off.real + b[1, 1] * off.imag
    )
    ux, uy = command(pilot.pilot, motion, t, i, at, met)
    control = complex(ux, uy)
    last = control if t == 0 else complex(pilot.last[i, 0], pilot.last[i, 1])
    pilot.last[i, 0], pilot.last[i, 1] = ux, uy
    flown = p * control + late * (last - control)
    return flown.real, flown.imag
