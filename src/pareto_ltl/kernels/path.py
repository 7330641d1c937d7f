"""Propagation of the Gaussian position along a path, and the checks of a path."""

from __future__ import annotations

from typing import Any, NamedTuple

from pareto_ltl.kernels import fixes  # noqa: F401 - the code of the law with landmarks
from pareto_ltl.kernels.data import CoherentLaw, FlightErrors, IndependentLaw, LandmarkLaw, Law, World
from pareto_ltl.kernels.interpolation import corner_weights, mode_square, mode_value, wind_at
from pareto_ltl.kernels.motion import airspeed, least_airspeed, left_time
from pareto_ltl.kernels.propagation import advance, closed_loop, forget, white_variance
from pareto_ltl.kernels.robot_errors import begin_errors, set_control, start_covariance, with_errors
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray
from plane_kernels.collision_risk import step_allowed
from plane_kernels.geometry import locate_cell
from plane_kernels.types import Cov, Gaussian, Linear, Point
from plane_logic.letters import next_state
from typed_kernels.jit import allocating, by_type, entry, implements, kernel

FLOWN, TOO_FAST, UNKNOWN_WIND, OFF_MAP, CROSSING, TOO_SLOW = range(6)


class Flight(NamedTuple):
    """A path of T steps under one wind law, filled by :func:`propagate_flight`.

    Attributes
    ----------
    x : (T+1, 2) float
        Mean position [m].
    u : (T, 2) float
        Control, air-relative velocity [m/s].
    cov : (T+1, 3) float
        Covariance (xx, xy, yy) of the position [m²].
    free : (T, 2) float
        Mean one step ahead with zero airspeed [m].
    shift : (T, 2) float
        Mean shift ½ D²μ : Σ + ∂ψ : C, and what a heading error takes from B u [m/s]; 0 under the independent
        law.
    speed : (T,) float
        Airspeed that feedback leaves for the control [m/s].
    F : (T, 2, 2) float, psi : (T, 2, P) float32, white : (T, 2) float
        The law linearised about the path: e' = F e + φ dt (ψ' θ + E κ + white). P = 0 under the independent
        law.
    memory : Memory
        Memory of the law for each step: Cov(e, θ) in ``theta``.
    errors : FlightErrors
        The robot's own errors: E in ``push``, Cov(e, κ) in ``cross``; Q = 0 for a robot without them.
    """

    x: FloatArray
    u: FloatArray
    cov: FloatArray
    free: FloatArray
    shift: FloatArray
    speed: FloatArray
    F: FloatArray
    psi: Float32Array
    white: FloatArray
    memory: Any
    errors: FlightErrors


@kernel
def position(flight: Flight, t: int) -> Gaussian:
    """Mean and covariance at step ``t``."""
    x, cov = flight.x, flight.cov
    return Gaussian(Point(x[t, 0], x[t, 1]), Cov(cov[t, 0], cov[t, 1], cov[t, 2]))


@by_type
def note_linear_law(law: Law, flight: Flight, t: int, here: Gaussian) -> None:
    """Fill row ``t`` of ``flight.F``, ``psi``, ``white`` and ``shift``."""
    raise NotImplementedError


@implements(note_linear_law, IndependentLaw)
def _note_independent(law: IndependentLaw, flight: Flight, t: int, here: Gaussian) -> None:
    closed, left = law.motion.closed, left_time(law.motion)
    dt2 = left * left
    for i in range(2):
        flight.shift[t, i] = 0.0
        for j in range(2):
            flight.F[t, i, j] = closed[i, j]
    # Σ' - A Σ A' is (φ dt)² Σ_w at the point of largest trace.
    p0, p1 = closed[0, 0] * here.cov.xx + closed[0, 1] * here.cov.xy, closed[0, 0] * here.cov.xy
    p1 += closed[0, 1] * here.cov.yy
    q0, q1 = closed[1, 0] * here.cov.xx + closed[1, 1] * here.cov.xy, closed[1, 0] * here.cov.xy
    q1 += closed[1, 1] * here.cov.yy
    flight.white[t, 0] = (flight.cov[t + 1, 0] - p0 * closed[0, 0] - p1 * closed[0, 1]) / dt2
    flight.white[t, 1] = (flight.cov[t + 1, 2] - q0 * closed[1, 0] - q1 * closed[1, 1]) / dt2


@implements(note_linear_law, CoherentLaw, LandmarkLaw)
def _note_coherent(law: CoherentLaw | LandmarkLaw, flight: Flight, t: int, here: Gaussian) -> None:
    modes, motion, at, psi = law.modes, law.motion, here.mean, flight.psi
    f = closed_loop(law, t, at)
    flight.F[t, 0, 0], flight.F[t, 0, 1], flight.F[t, 1, 0], flight.F[t, 1, 1] = f
    square = mode_square(modes, at)
    weights = corner_weights(square)
    ee, nn = 0.0, 0.0
    for m in range(psi.shape[2]):
        scale = modes.scale[t, m]
        psi[t, 0, m] = scale * mode_value(modes.psi, modes.slot[t], square, weights, 0, m)
        psi[t, 1, m] = scale * mode_value(modes.psi, modes.slot[t], square, weights, 1, m)
        ee += psi[t, 0, m] * psi[t, 0, m]
        nn += psi[t, 1, m] * psi[t, 1, m]
    flight.white[t, 0], flight.white[t, 1] = white_variance(law, t, at, ee, nn)
    a, dt = motion.a, motion.dt
    we, wn = wind_at(law.wind.mean, law.wind, t, at)
    flight.shift[t, 0] = (flight.free[t, 0] - a[0, 0] * at.x - a[0, 1] * at.y) / dt - we
    flight.shift[t, 1] = (flight.free[t, 1] - a[1, 0] * at.x - a[1, 1] * at.y) / dt - wn


@allocating
def propagate_flight(law: Law, flight: Flight, variance: float, steered: bool) -> int:
    """Propagate the Gaussian position along a path, from a start with ``variance`` [m²] in each direction.

    The robot's own errors may add to it.

    With ``steered`` the controls ``flight.u`` are given and the means are computed, otherwise the means
    ``flight.x`` are given and the controls are computed. All other fields of ``flight`` are filled. Returns
    the number of steps, which is less than T if the wind is known for fewer steps.

    Eqs. (M23) to (M24b) of docs/mathematics.md.
    """
    cov, F, errors = flight.cov, flight.F, flight.errors
    forget(law, flight.memory)
    begin_errors(errors)
    errors.steered[0] = steered
    cov[0, 0], cov[0, 1], cov[0, 2] = start_covariance(errors.law, variance)
    steps = min(len(flight.u), len(law.wind.slot))
    for t in range(steps):
        here = position(flight, t)
        ahead = advance(law, flight.memory, t, here, max(t - 1, 0), t)
        flight.free[t, 0], flight.free[t, 1] = set_control(errors, law.motion, t, ahead.mean)
        flight.speed[t] = ahead.speed
        cov[t + 1, 0], cov[t + 1, 1], cov[t + 1, 2] = ahead.cov
        note_linear_law(law, flight, t, here)
        f = Linear(F[t, 0, 0], F[t, 0, 1], F[t, 1, 0], F[t, 1, 1])
        cov[t + 1, 0], cov[t + 1, 1], cov[t + 1, 2] = with_errors(law, errors, t, f, ahead.cov)
    return steps


@allocating
def check_path(
    world: World, flight: Flight, known: int, fast: float, q: IntArray, cell: IntArray
) -> tuple[int, int]:
    """The first constraint that a path breaks, ``FLOWN`` for none, and the step where it does.

    The path was propagated for ``known`` steps. Fills ``q`` and ``cell`` (T+1,) up to that step. ``fast`` is
    the factor by which the airspeed may exceed its limits.
    """
    motion, x, free = world.law.motion, flight.x, flight.free
    cells, logic = world.mission.cells, world.mission.logic
    state = logic.initial
    before = position(flight, 0)
    for t in range(len(x)):
        if t > 0:
            if t > known:
                return UNKNOWN_WIND, t
            dx, dy = x[t, 0] - free[t - 1, 0], x[t, 1] - free[t - 1, 1]
            flown, left = airspeed(motion, dx, dy), flight.speed[t - 1]
            if flown > left * fast:
                return TOO_FAST, t
            if flown * fast < least_airspeed(motion, left):
                return TOO_SLOW, t
        here = position(flight, t)
        cell[t] = locate_cell(cells, here.mean)
        if cell[t] < 0:
            return OFF_MAP, t
        if t == 0:
            state = int(logic.delta[logic.epoch[0], state, cell[t]])
        else:
            start, end = before.mean, here.mean
            state = next_state(cells, logic, t, state, start, cell[t - 1], end, cell[t])
        q[t] = state
        if not step_allowed(world.collision, before, here):
            return CROSSING, t
        before = here
    return FLOWN, len(x) - 1


@entry
def covariance_across_time(
    linear: tuple[FloatArray, Float32Array, FlightErrors], cov: FloatArray, theta: Float32Array,
    kept: Float32Array, dt: float, held: FloatArray, cross: FloatArray,
) -> None:  # fmt: skip
    """Fill ``cross[t, s]`` (T+1, T+1, 2, 2) with Cov(e_t, e_s) [m²] for s <= t, of a flight without fixes.

    ``linear`` are F (T, 2, 2), ψ (T, 2, P) and the errors of the flight, ``cov`` (T+1, 3) its covariance,
    ``theta`` its Cov(e, θ), ``kept`` (S+1, P) the persistence of the modes; ``held`` (2, 2, P) is scratch.

    Eq. (M25) of docs/mathematics.md.
    """
    F, psi, errors = linear
    n, modes = len(cov), psi.shape[2]
    for s in range(n):
        cross[s, s, 0, 0], cross[s, s, 0, 1] = cov[s, 0], cov[s, 1]
        cross[s, s, 1, 0], cross[s, s, 1, 1] = cov[s, 1], cov[s, 2]
        for r in range(2):
            for c in range(2):
                for m in range(modes):
                    held[r, c, m] = theta[s - 1, r, c, m] if s > 0 else 0.0
        for t in range(s, n - 1):
            for c in range(2):
                for r in range(2):
                    pushed = 0.0
                    for m in range(modes):
                        pushed += psi[t, c, m] * held[r, c, m]
                        held[r, c, m] *= kept[t + 1, m]
                    for q in range(len(errors.law.mean)):
                        pushed += errors.push[t, c, q] * errors.cross[s, r, q]
                    moved = F[t, c, 0] * cross[t, s, 0, r] + F[t, c, 1] * cross[t, s, 1, r]
                    cross[t + 1, s, c, r] = moved + dt * pushed
