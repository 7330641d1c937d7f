"""The solves of a refinement at one width: trust-region Newton on the failure of common flights.

The deviations of the flights from their path are given. A solve builds the programme of
:mod:`~plane_kernels.step_solver` about a path, solves it, propagates the new means and evaluates the
failure there. All solves of one width are one call: two threads that polish with a call for each of these
steps wait for the interpreter's lock longer than they compute.

``ConstrainedRefiner`` of :mod:`pareto_ltl.planning.refine.sampled` makes the same decisions in Python.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pareto_ltl.kernels.attraction import attract
from pareto_ltl.kernels.chance import Chance, add_breach
from pareto_ltl.kernels.data import CoherentLaw, IndependentLaw, LandmarkLaw, Law
from pareto_ltl.kernels.interpolation import wind_slopes
from pareto_ltl.kernels.motion import least_airspeed
from pareto_ltl.kernels.path import Flight, propagate_flight
from pareto_ltl.support.arrays import FloatArray, IntArray
from plane_kernels.step_solver import MOST, StepModel, Work, X, solve_step
from plane_logic.margin import Slope, smoothed_failure
from plane_logic.margin_events import MarginModel, Scratch
from typed_kernels.jit import by_type, entry, implements, kernel

OVERLONG = 20.0  # penalty per relative length above the cap: more than any failure
SHORTENED = 0.985  # one solve may shorten the path to this share of its length, not further
WIDER, NARROWER, NARROWEST = 1.5, 0.35, 0.01  # factors of the trust region after a success or not; its least
INNER_GAIN = 1e-3  # relative gain below which the solves of a width end
LEAST_VALUE = 1e-6  # of a smoothed failure, whose model is relative to it
RIDGE = 1e-4  # curvature added to the curvature of the failure, relative to it, for a full step squared
SLOWEST = 0.99  # upper limit of the least airspeed in a programme, as a share of the largest one
TRIES = 2  # times that controls are scaled into the airspeed limits
ROUNDING = 1e-9


class Limits(NamedTuple):
    """What holds for all paths of a problem.

    ``low`` and ``high`` (2,): corners of the map, less a margin [m]; ``unit``: a full step [m]; ``cap``: the
    share of the largest airspeed that is planned with; ``variance``: of the start [m²].
    """

    low: FloatArray
    high: FloatArray
    unit: float
    cap: float
    variance: float


class Sample(NamedTuple):
    """Flights whose failure is lowered: deviations ``off`` (T+1, 2, n) [m], smoothed over ``width`` [m].

    ``share``: the part of all flights that they are, the others do not fail. ``worth``: failures that fixes
    save, 0 without landmarks. ``begun``: the smoothed failure of the first path.
    """

    off: FloatArray
    width: float
    share: float
    worth: float
    begun: float


class Solves(NamedTuple):
    """At most ``number`` solves, with a first ``trust`` region [full steps].

    Paths are up to ``longest`` [m] and keep the ``chance`` constraint, both by penalties.
    """

    number: int
    trust: float
    longest: float
    chance: Chance


class Guess(NamedTuple):
    """A path and the derivatives of its objective, which for the first one is the smoothed failure alone."""

    flight: Flight
    slope: Slope


class Memory(NamedTuple):
    """Memory of a descent; ``legs`` (NEAREST,) is for :func:`~pareto_ltl.kernels.attraction.attract`."""

    model: StepModel
    work: Work
    scratch: Scratch
    legs: IntArray


@by_type
def add_lure(law: Law, x: FloatArray, sample: Sample, slope: Slope, legs: IntArray) -> float:
    """The attraction of landmarks [failures]; its derivatives are added to ``slope``."""
    raise NotImplementedError


@implements(add_lure, IndependentLaw, CoherentLaw)
def _no_lure(
    _law: IndependentLaw | CoherentLaw, _x: FloatArray, _sample: Sample, _slope: Slope, _legs: IntArray
) -> float:
    return 0.0


@implements(add_lure, LandmarkLaw)
def _lure(law: LandmarkLaw, x: FloatArray, sample: Sample, slope: Slope, legs: IntArray) -> float:
    worth = sample.worth * sample.share
    if worth <= 0.0:
        return 0.0
    return float(attract(law.landmarks, x, sample.off, sample.width, worth, slope, legs))


@kernel
def assess(
    law: Law, margin: MarginModel, chance: Chance, sample: Sample, guess: Guess, memory: Memory
) -> float:
    """The objective of a path: its smoothed failure and what :func:`penalties` adds; fills its slope.

    Eqs. (M54) and (M55) of docs/mathematics_methods.md.
    """
    slope, x = guess.slope, guess.flight.x
    slope.gradient[:] = 0.0
    slope.hessian[:] = 0.0
    failed = smoothed_failure(margin, x, sample.off, sample.width, slope, memory.scratch)
    for t in range(len(x)):
        for c in range(2):
            slope.gradient[t, c] *= sample.share
        for c in range(3):
            slope.hessian[t, c] *= sample.share
    failed = max(sample.share * failed, LEAST_VALUE)
    return failed + penalties(law, chance, sample, guess, memory)


@kernel
def penalties(law: Law, chance: Chance, sample: Sample, guess: Guess, memory: Memory) -> float:
    """The attraction of landmarks, and of segments that break epsilon; their derivatives are added.

    Eqs. (M75) and (M82) of docs/mathematics_methods.md.
    """
    lure = add_lure(law, guess.flight.x, sample, guess.slope, memory.legs)
    return lure + add_breach(chance, guess.flight, guess.slope)


@kernel
def length(x: FloatArray) -> float:
    """Length of the means ``x`` (T+1, 2) [m]."""
    total = 0.0
    for t in range(len(x) - 1):
        dx, dy = x[t + 1, 0] - x[t, 0], x[t + 1, 1] - x[t, 1]
        total += math.sqrt(dx * dx + dy * dy)
    return total


@kernel
def overlong(x: FloatArray, longest: float) -> float:
    """What a length above ``longest`` [m] adds to the failure."""
    return OVERLONG * max(0.0, length(x) / longest - 1.0)


@kernel
def fly_within(law: Law, limits: Limits, flight: Flight) -> None:
    """Propagate along ``flight.x``; its controls are scaled into the airspeed limits if necessary."""
    motion, u = law.motion, flight.u
    steered = False  # a variable: for each constant, numba would compile propagate_flight once more (3 s)
    for attempt in range(TRIES + 1):
        propagate_flight(law, flight, limits.variance, steered)
        within = True
        for t in range(len(u)):
            speed, limit = math.hypot(u[t, 0], u[t, 1]), (1.0 - ROUNDING) * max(flight.speed[t], 0.0)
            least = least_airspeed(motion, limit)
            if speed < least * (1.0 - ROUNDING) or speed > limit * (1.0 + ROUNDING):
                within = False
        if within or attempt == TRIES:
            return
        for t in range(len(u)):
            speed, limit = math.hypot(u[t, 0], u[t, 1]), (1.0 - ROUNDING) * max(flight.speed[t], 0.0)
            least = least_airspeed(motion, limit)
            wanted = min(max(speed, least / limits.cap), max(limits.cap * limit, least))
            share = wanted / max(speed, ROUNDING)
            u[t, 0], u[t, 1] = share * u[t, 0], share * u[t, 1]
        steered = True


# --- the programme of a solve -------------------------------------------------------------------


@kernel
def fill_motion(law: Law, limits: Limits, flight: Flight, model: StepModel) -> None:
    """Fill ``behind`` and ``cone`` of ``model``: how each step depends on its ends, and the airspeed left."""
    motion, u, x, E = law.motion, flight.u, flight.x, model.behind
    wind_slopes(law.wind, x, E)
    for t in range(len(u)):
        for j in range(2):
            first = motion.a[0, j] + motion.dt * E[t, 0, j]
            second = motion.a[1, j] + motion.dt * E[t, 1, j]
            E[t, 0, j] = motion.b_inv[0, 0] * first + motion.b_inv[0, 1] * second
            E[t, 1, j] = motion.b_inv[1, 0] * first + motion.b_inv[1, 1] * second
        fast, leg = model.cone[2 * t], model.cone[2 * t + 1]
        fast[0] = limits.cap * flight.speed[t] / motion.u_max
        leg[0] = 0.0
        for c in range(2):
            fast[1 + c] = u[t, c] / motion.u_max
            leg[1 + c] = (x[t + 1, c] - x[t, c]) / limits.unit


@kernel
def fill_lines(law: Law, limits: Limits, flight: Flight, trust: float, cap: float, model: StepModel) -> None:
    """Fill ``line`` and ``heading`` of ``model``: map, trust region, length ``cap`` [m], least airspeed."""
    motion, unit, u, x, line = law.motion, limits.unit, flight.u, flight.x, model.line
    T = len(u)
    for t in range(T):
        for c in range(2):
            lower = max((limits.low[c] - x[t + 1, c]) / unit, -trust)
            upper = min((limits.high[c] - x[t + 1, c]) / unit, trust)
            line[4 * t + c], line[4 * t + 2 + c] = max(lower, upper), -min(lower, upper)
    line[4 * T] = cap / unit
    for t in range(len(model.heading)):
        speed = math.hypot(u[t, 0], u[t, 1])
        ahead = model.heading[t]
        ahead[0], ahead[1] = (u[t, 0] / speed, u[t, 1] / speed) if speed > 0.0 else (1.0, 0.0)
        along, limit = (ahead[0] * u[t, 0] + ahead[1] * u[t, 1]) / motion.u_max, flight.speed[t]
        least = min(least_airspeed(motion, limit) / limits.cap, SLOWEST * limits.cap * limit)
        line[4 * T + 1 + t] = along - least / motion.u_max


@kernel
def fill_objective(limits: Limits, slope: Slope, value: float, model: StepModel) -> None:
    """Fill ``gradient`` and ``hessian`` of ``model``, relative to the objective ``value``."""
    unit = limits.unit
    for t in range(len(slope.gradient)):
        for c in range(2):
            model.gradient[t, c] = slope.gradient[t, c] * (unit / value)
        for c in range(3):
            model.hessian[t, c] = slope.hessian[t, c] * (unit * unit / value)
        model.hessian[t, 0] += RIDGE
        model.hessian[t, 2] += RIDGE


@kernel
def next_means(
    law: Law, limits: Limits, here: Guess, value: float, trust: float, cap: float, memory: Memory,
    means: FloatArray,
) -> bool:  # fmt: skip
    """Fill ``means`` (T+1, 2) [m] with those that minimise the model about ``here``; whether there are any.

    The programme, about the means x̄ and in full steps, is

        minimise    g' (x - x̄) + ½ (x - x̄)' H (x - x̄)
        subject to  ‖B⁻¹ (x_{t+1} - F_t x_t - g_t)‖ ≤ airspeed left,     F_t = A + dt Dμ(x̄_t)
                    û_t' B⁻¹ (x_{t+1} - F_t x_t - g_t) ≥ least airspeed    where there is one
                    Σ_t ‖x_{t+1} - x_t‖ ≤ L_max
                    |x_t - x̄_t| ≤ trust,    x_t on the map

    û_t is the direction of the last control: the half plane lies within the set of controls that are fast
    enough, which is not convex. ``trust`` in full steps, ``cap`` [m].

    Eq. (M56) of docs/mathematics_methods.md.
    """
    x = here.flight.x
    fill_motion(law, limits, here.flight, memory.model)
    fill_lines(law, limits, here.flight, trust, cap, memory.model)
    fill_objective(limits, here.slope, value, memory.model)
    if solve_step(memory.model, memory.work) >= MOST:
        return False
    for t in range(len(x)):
        for c in range(2):
            means[t, c] = x[t, c] + limits.unit * memory.work.points[X, t, c]
    return True


@entry
def descend(
    law: Law, limits: Limits, margin: MarginModel, sample: Sample, solves: Solves, first: Guess,
    second: Guess, memory: Memory,
) -> int:  # fmt: skip
    """Lower the failure of ``first``, whose flight is filled; returns 0 if it has the result, else 1."""
    here, there, at, trust = first, second, 0, solves.trust
    here_is = sample.begun + penalties(law, solves.chance, sample, here, memory)
    value = here_is + overlong(here.flight.x, solves.longest)
    for _ in range(solves.number):
        cap = max(solves.longest, SHORTENED * length(here.flight.x))
        if not next_means(law, limits, here, here_is, trust, cap, memory, there.flight.x):
            trust *= NARROWER
            continue
        fly_within(law, limits, there.flight)
        there_is = assess(law, margin, solves.chance, sample, there, memory)
        now = there_is + overlong(there.flight.x, solves.longest)
        if now < value:
            gain = (value - now) / value
            here, there, at, here_is, value = there, here, 1 - at, there_is, now
            trust = min(WIDER * trust, 1.0)
            if gain < INNER_GAIN:
                break
        else:
            trust *= NARROWER
            if trust < NARROWEST:
                break
    return at
