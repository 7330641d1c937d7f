"""Simulated flights: first the motion in the drawn winds, then whether each flight succeeds.

All flights of a batch take a step together: one vectorised loop reads their winds from one slot of the
tables, which is faster than one flight after the other. The type of the draws selects the wind of a flight,
the type of the pilot what the robot knows and commands (:mod:`~pareto_ltl.kernels.pilots`,
:mod:`~pareto_ltl.kernels.navigator`). Afterwards the flown positions are evaluated: mission and collisions.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

from pareto_ltl.kernels import fixes, navigator  # noqa: F401 - the code of laws and pilots with fixes
from pareto_ltl.kernels.data import CoherentLaw, IndependentLaw, LandmarkLaw, Modes, Motion
from pareto_ltl.kernels.interpolation import (
    F32,
    corner_weights,
    gust_variance,
    mode_square,
    mode_value,
    wind_at,
)
from pareto_ltl.kernels.pilots import Pilot, begin_flights, command, observe
from pareto_ltl.kernels.propagation import white_variance
from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray, IntArray
from plane_kernels.geometry import locate_cell, off_map, segment_touches
from plane_kernels.types import Cells, Faces, Nearby, Point
from plane_logic.letters import next_state
from plane_logic.types import Logic
from typed_kernels.jit import by_type, entry, implements, kernel, vector

# --- winds ------------------------------------------------------------------------------------


class IndependentDraws(NamedTuple):
    """w ~ N(μ(x, t), Σ_w(x, t)), drawn at every step at the flown position; ``white`` (T, n, 2) ~ N(0, 1).

    Eq. (M20) of docs/mathematics.md.
    """

    law: IndependentLaw
    white: FloatArray


class CoherentDraws(NamedTuple):
    """w = μ(x, t) + ψ(x)' θ + white noise, with one field ``theta`` (E, n, 2, P) for each flight.

    ``white`` (T, n, 2) ~ N(0, 1).
    """

    law: CoherentLaw | LandmarkLaw
    white: FloatArray
    theta: Float32Array


class LinearDraws(NamedTuple):
    """The winds of :class:`CoherentDraws`, linear in the distance from the means of a path.

    w = ``wind`` + ``slope`` (x - ``mean``): ``wind`` (T, n, 2) [m/s] is what each flight would meet at the
    means ``mean`` (T+1, 2) [m], and ``slope`` (T, 2, 2) [1/s] the gradient of the expected wind there.
    """

    mean: FloatArray
    wind: FloatArray
    slope: FloatArray


class LinearLaw(NamedTuple):
    """The coherent law linearised about T steps of a path: e' = F e + dt (ψ' θ + E κ + white).

    ``F`` (T, 2, 2), ``psi`` (T, 2, P) [m/s], ``sd`` (T, 2) of the white part [m/s], E in ``push`` (T, 2, Q)
    [m/s], and the step ``dt`` [s]; a robot without feedback.
    """

    F: FloatArray
    psi: Float32Array
    sd: FloatArray
    push: FloatArray
    dt: float


Draws: TypeAlias = IndependentDraws | CoherentDraws | LinearDraws


@by_type
def meet_winds(draws: Draws, t: int, x: FloatArray, met: FloatArray) -> None:
    """Write the winds (east, north) [m/s] of all flights at step ``t`` to the first two columns of ``met``.

    ``met`` (n, 4): the other columns are scratch; ``x`` (n, T+1, 2): positions [m].
    """
    raise NotImplementedError


@implements(meet_winds, IndependentDraws)
def _independent_winds(draws: IndependentDraws, t: int, x: FloatArray, met: FloatArray) -> None:
    wind, white, between = draws.law.wind, draws.white, draws.law.wind.between[t]
    ge, gn = gust_variance(wind, t)
    for i in range(x.shape[0]):
        at = Point(x[i, t, 0], x[i, t, 1])
        we, wn = wind_at(wind.mean, wind, t, at)
        ve, vn = wind_at(wind.latent, wind, t, at)
        met[i, 0] = we + math.sqrt(ve + ge + between) * white[t, i, 0]
        met[i, 1] = wn + math.sqrt(vn + gn + between) * white[t, i, 1]


@implements(meet_winds, CoherentDraws)
def _coherent_winds(draws: CoherentDraws, t: int, x: FloatArray, met: FloatArray) -> None:
    law, white = draws.law, draws.white
    meet_fields(law.modes, t, x, draws.theta[law.modes.epoch[t]], met)
    for i in range(x.shape[0]):
        at = Point(x[i, t, 0], x[i, t, 1])
        we, wn = wind_at(law.wind.mean, law.wind, t, at)
        ve, vn = white_variance(law, t, at, met[i, 2], met[i, 3])
        met[i, 0] += we + math.sqrt(ve) * white[t, i, 0]
        met[i, 1] += wn + math.sqrt(vn) * white[t, i, 1]


@implements(meet_winds, LinearDraws)
def _linear_winds(draws: LinearDraws, t: int, x: FloatArray, met: FloatArray) -> None:
    wind, slope, mean = draws.wind, draws.slope, draws.mean
    for i in range(x.shape[0]):
        dx, dy = x[i, t, 0] - mean[t, 0], x[i, t, 1] - mean[t, 1]
        for c in range(2):
            met[i, c] = wind[t, i, c] + slope[t, c, 0] * dx + slope[t, c, 1] * dy


@vector
def meet_fields(modes: Modes, t: int, x: FloatArray, theta: Float32Array, met: FloatArray) -> None:
    """Write ψ(x)' θ, east and north, and |ψ|² of both of all flights at step ``t`` to ``met`` (n, 4).

    ``theta`` has shape (n, 2, P). With 32 modes this takes 17 ns per flight, and 40 ns with one call for
    each.

    Eq. (M14) of docs/mathematics.md.
    """
    slot, scale, psi = modes.slot[t], modes.scale[t], modes.psi
    for i in range(x.shape[0]):
        square = mode_square(modes, Point(x[i, t, 0], x[i, t, 1]))
        weights = corner_weights(square)
        e, ee, n, nn = F32(0.0), F32(0.0), F32(0.0), F32(0.0)
        for m in range(psi.shape[4]):
            east = scale[m] * mode_value(psi, slot, square, weights, 0, m)
            north = scale[m] * mode_value(psi, slot, square, weights, 1, m)
            e += east * theta[i, 0, m]
            ee += east * east
            n += north * theta[i, 1, m]
            nn += north * north
        met[i, 0], met[i, 1], met[i, 2], met[i, 3] = e, n, ee, nn


@vector
def linear_field(psi: Float32Array, t: int, c: int, theta: Float32Array) -> float:
    """ψ_t' θ of wind component ``c`` [m/s]; ``psi`` (T, 2, P), ``theta`` (2, P)."""
    wind = F32(0.0)
    for m in range(psi.shape[2]):
        wind += psi[t, c, m] * theta[c, m]
    return wind  # type: ignore[return-value]


@entry
def winds_at_means(
    psi: Float32Array, sd: FloatArray, epoch: IntArray, white: FloatArray, theta: Float32Array,
    wind: FloatArray,
) -> None:  # fmt: skip
    """Add ψ_t' θ + ``sd`` (T, 2) ``white`` (T, n, 2) of each flight to ``wind`` (T, n, 2) [m/s].

    ``psi`` (T, 2, P) [m/s]; ``theta`` (E, n, 2, P) is the field of each ``epoch`` (T,).
    """
    for i in range(wind.shape[1]):
        for t in range(wind.shape[0]):
            field = theta[epoch[t], i]
            for c in range(2):
                wind[t, i, c] += linear_field(psi, t, c, field) + sd[t, c] * white[t, i, c]


@entry
def linear_deviations(
    along: LinearLaw, epoch: IntArray, white: FloatArray, theta: Float32Array, kappa: FloatArray,
    off: FloatArray,
) -> None:  # fmt: skip
    """Fill the deviations ``off`` (T+1, 2, n) [m] of flights that begin with ``off[0]``.

    e' = F e + dt (ψ' θ + E κ + white). ``white`` (T, n, 2) ~ N(0, 1); ``theta`` (E, n, 2, P) is the field of
    each ``epoch`` (T,); ``kappa`` (n, Q) are the coefficients of the robot's own errors.
    """
    F, psi, sd, push, dt = along.F, along.psi, along.sd, along.push, along.dt
    for i in range(off.shape[2]):
        e, n = off[0, 0, i], off[0, 1, i]
        for t in range(len(F)):
            field = theta[epoch[t], i]
            east = linear_field(psi, t, 0, field) + sd[t, 0] * white[t, i, 0]
            north = linear_field(psi, t, 1, field) + sd[t, 1] * white[t, i, 1]
            for q in range(kappa.shape[1]):
                east += push[t, 0, q] * kappa[i, q]
                north += push[t, 1, q] * kappa[i, q]
            e, n = (
                F[t, 0, 0] * e + F[t, 0, 1] * n + dt * east,
                F[t, 1, 0] * e + F[t, 1, 1] * n + dt * north,
            )
            off[t + 1, 0, i], off[t + 1, 1, i] = e, n


@entry
def place_innovations(kept: Float32Array, drawn: Float32Array, field: Float32Array) -> None:
    """Fill ``field`` (E, n, 2, P) with the next of ``drawn`` if ``kept`` (E, P) < 1 (θ changes), else 0."""
    used = 0
    for k in range(field.shape[0]):
        for i in range(field.shape[1]):
            for c in range(2):
                for m in range(field.shape[3]):
                    if kept[k, m] < 1.0:
                        field[k, i, c, m] = drawn[used]
                        used += 1
                    else:
                        field[k, i, c, m] = F32(0.0)


@entry
def link_fields(kept: Float32Array, theta: Float32Array) -> None:
    """Replace innovations η in ``theta`` (E, n, 2, P) by θ_k = ρ_k θ_{k-1} + √(1 - ρ_k²) η_k.

    ``kept`` (E, P) = ρ.

    Eq. (M15) of docs/mathematics.md.
    """
    for k in range(1, theta.shape[0]):
        for i in range(theta.shape[1]):
            for c in range(2):
                for m in range(theta.shape[3]):
                    rho = kept[k, m]
                    fresh = F32(math.sqrt(F32(1.0) - rho * rho)) * theta[k, i, c, m]
                    theta[k, i, c, m] = rho * theta[k - 1, i, c, m] + fresh


# --- the flights ------------------------------------------------------------------------------


class Tank(NamedTuple):
    """Energy of the robots: ``capacity`` [J], infinite where it is not limited, and ``spent`` (n,) [J].

    ``watts`` (M,) [W] is the power at evenly spaced airspeeds, ``spacing`` [m/s] apart, from ``slowest`` on.
    """

    watts: FloatArray
    slowest: float
    spacing: float
    capacity: float
    spent: FloatArray


@kernel
def can_fly(tank: Tank, i: int, speed: float, dt: float) -> bool:
    """Whether flight ``i`` has the energy for a step of ``dt`` [s] at ``speed`` [m/s], which it spends."""
    if tank.capacity == math.inf:
        return True
    last = len(tank.watts) - 1
    place = min(max((speed - tank.slowest) / tank.spacing, 0.0), float(last))
    k = min(int(place), last - 1)
    share = place - k
    tank.spent[i] += dt * ((1.0 - share) * tank.watts[k] + share * tank.watts[k + 1])
    return bool(tank.spent[i] <= tank.capacity)


@entry
def fly_batch(
    motion: Motion, draws: Draws, pilot: Pilot, x: FloatArray, met: FloatArray, tank: Tank
) -> None:  # fmt: skip
    """Simulate one flight of the plan for every row of ``x`` (n, T+1, 2) [m], whose column 0 is the start.

    ``met`` (n, 4) is scratch. A robot without the energy for a step stays where it is.

    Eq. (M1) of docs/mathematics.md.
    """
    a, b, dt = motion.a, motion.b, motion.dt
    begin_flights(pilot)
    for t in range(x.shape[1] - 1):
        meet_winds(draws, t, x, met)
        observe(pilot, motion, t, x)
        for i in range(x.shape[0]):
            at, wind = Point(x[i, t, 0], x[i, t, 1]), Point(met[i, 0], met[i, 1])
            ux, uy = command(pilot, motion, t, i, at, wind)
            if not can_fly(tank, i, math.sqrt(ux * ux + uy * uy), dt):
                x[i, t + 1, 0], x[i, t + 1, 1] = at.x, at.y
                continue
            x[i, t + 1, 0] = a[0, 0] * at.x + a[0, 1] * at.y + dt * (b[0, 0] * ux + b[0, 1] * uy + wind.x)
            x[i, t + 1, 1] = a[1, 0] * at.x + a[1, 1] * at.y + dt * (b[1, 0] * ux + b[1, 1] * uy + wind.y)


# --- evaluation of flights --------------------------------------------------------------------


class Judge(NamedTuple):
    """The data that judging a flight needs: cells with the bounds of the map, automaton, obstacles.

    ``nearby`` lists the obstacles by their distance from each part of the map.
    """

    cells: Cells
    logic: Logic
    obstacles: Faces
    nearby: Nearby


class Outcome(NamedTuple):
    """Flights ``x`` (n, T+1, 2) [m]; whether each completes the mission, collides, leaves the map (n,)."""

    x: FloatArray
    accepted: BoolArray
    collided: BoolArray
    off_map: BoolArray


@entry
def judge_batch(judge: Judge, outcome: Outcome) -> None:
    """Fill ``accepted``, ``collided`` and ``off_map`` of ``outcome`` from its positions."""
    logic, x = judge.logic, outcome.x
    for i in range(x.shape[0]):
        at = Point(x[i, 0, 0], x[i, 0, 1])
        cell = locate_cell(judge.cells, at)
        q = int(logic.delta[logic.epoch[0], logic.initial, cell])
        collided, outside = False, off_map(judge.cells, at)
        for t in range(1, x.shape[1]):
            there = Point(x[i, t, 0], x[i, t, 1])
            collided = collided or segment_touches(judge.obstacles, judge.nearby, at, there)
            outside = outside or off_map(judge.cells, there)
            last = locate_cell(judge.cells, there)
            q = next_state(judge.cells, logic, t, q, at, cell, there, last)
            at, cell = there, last
        outcome.collided[i], outcome.off_map[i] = collided, outside
        outcome.accepted[i] = logic.distance[q] == 0.0


@entry
def wind_met(draws: Draws, t: int, x: FloatArray, met: FloatArray) -> None:
    """Write the wind (east, north) [m/s] at step ``t`` to ``met[0, :2]``; ``draws`` hold one flight.

    ``met`` has shape (1, 4). Of ``x`` (1, T+1, 2) only the position ``x[0, t]`` [m] is read.
    """
    meet_winds(draws, t, x, met)
