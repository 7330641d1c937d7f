"""Rates of rare failures by weighted new flights.

A flight is the sequence z of the standard normal numbers that :func:`~pareto_ltl_verify.flights.fly` asks
for. The law linearised about the plan, a :class:`~pareto_ltl_verify.laws.Course`, makes of a half-space
a' e_t >= d of deviations the half-space ω' z >= τ of draws, |ω| = 1, with ω by the adjoint of the recursion
of the deviations. Behind such half-spaces lie obstacles, borders, the outside of visited regions and winds
for which the airspeed does not suffice; where failures begin along each ω, flights along it show. A share of
the flights is drawn as it is, the others are pushed into one of the half-spaces or into a wider one, and each
counts with the ratio of its densities without and with the pushes. Two rounds of few flights show which
half-spaces failures come from. The mean of the weights of failed flights is the rate of plain flights,
whatever the half-spaces are; no weight exceeds :data:`LARGEST`.

Errors with tails have a scale c that is drawn first: given c, τ / c stands for τ.

The planner finds its half-spaces at flights that fail, and has fixed shares.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.special import gammaincinv, ndtr, ndtri

from pareto_ltl_verify.arrays import FloatArray, IntArray
from pareto_ltl_verify.flights import Ground, fly
from pareto_ltl_verify.geometry import Convex, beyond_bounds
from pareto_ltl_verify.laws import Course, Law, fly_means
from pareto_ltl_verify.robot import Robot
from pareto_ltl_verify.tails import SHIFTED, Again, Numbers, ScaleDraws, UnitScales, drawn_scales

PLAIN = 0.1  # share of the flights that are not pushed
LARGEST = SHIFTED / PLAIN  # weight of a flight
EQUAL = 0.2  # share that all half-spaces have alike, whatever was seen of them
LEVELS = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)  # of the lengths at which flights fail: failures lie beside them, too
SPANS = (1, 3, 10, 30)  # steps
RAY = np.append(np.arange(0.0, 9.01, 0.25), np.arange(10.0, 25.0))  # lengths at which flights are tried
ALIKE = 0.95  # correlation of directions of which one is enough
FARTHEST = 8.0  # [standard deviations] thresholds beyond it are left out
DEEPEST = 37.0  # [standard deviations] to which draws are pushed: the probability of more is no normal float
MOST = 60  # half-spaces, the nearest
FEW = (2_000, 3_000)  # flights of the rounds that show where failures come from
RUNS = 10_000  # flights that the rate is taken from
BATCH = 500


class Barrier(NamedTuple):
    """A half-space Σ_t a_t' e_t + c_t' w_t >= d of deviations e [m] and errors w of the winds [m/s].

    ``positions`` and ``winds`` have a_t and c_t (2,) by step; ``near`` is about d in standard deviations.
    """

    near: float
    positions: Mapping[int, FloatArray]
    winds: Mapping[int, FloatArray] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Mixture:
    """From what flights are drawn.

    Unit vectors ``directions`` (J, D); of each component its half-space ``which`` (C,), threshold
    ``reach`` (C,) and ``share`` (C,) of the flights; the others are plain.
    """

    directions: FloatArray
    which: IntArray
    reach: FloatArray
    share: FloatArray


class Stored:
    """The source of normal numbers that :func:`fly` draws from: the rows of ``z`` (n, D), in order."""

    def __init__(self, z: FloatArray, scales: Numbers) -> None:
        """Numbers ``z``, and the source of the numbers for the scales of errors with tails."""
        self._z, self._used, self._scales = z, 0, scales

    def standard_normal(self, size: tuple[int, ...]) -> FloatArray:
        """The next columns, in the shape ``size`` (n, ...)."""
        first, self._used = self._used, self._used + math.prod(size[1:])
        if self._used > self._z.shape[1]:
            raise IndexError(f"a flight draws more than its {self._z.shape[1]} numbers")
        return self._z[:, first : self._used].reshape(size)

    def spawn(self, number: int) -> Sequence[Numbers]:
        """The source of the scales."""
        if number != 1:
            raise ValueError(f"there is one source of scales, not {number}")
        return [self._scales]


def rare_failures(law: Law, ground: Ground, x: FloatArray, u: FloatArray, seed: Sequence[int]) -> FloatArray:
    """Weights (RUNS,) of new flights of the controls ``u`` about the means ``x``, 0 where they do not fail.

    Empty where the law has position fixes, after which deviations are not linear in the numbers drawn, and
    where nothing stands within :data:`FARTHEST` standard deviations.
    """
    if law.landmarks:
        return np.empty(0)
    directions, begin = failing_directions(law, ground, x, u)
    if not len(begin) or begin[0] == 0.0:
        return np.empty(0)
    mixture = equal_shares(directions, begin)
    rng = np.random.default_rng(list(seed))
    for few in FEW:
        seen = np.zeros(len(mixture.share))
        for weights, came in weighted_flights(law, ground, x, u, mixture, few, rng):
            seen += weights @ came
        if seen.any():
            mixture = shared_as_seen(mixture, seen)
    drawn = weighted_flights(law, ground, x, u, mixture, RUNS, rng)
    return np.concatenate([weights for weights, _ in drawn])


def least_rate(weights: FloatArray, chance: float) -> float:
    """The rate that the mean of ``weights`` (n,) exceeds by chance only with the probability ``chance``.

    The lower end of the gamma interval of Fay and Feuer, Statistics in Medicine 16 (1997) 791-801.
    """
    mean, variance = float(weights.mean()), float(weights.var()) / len(weights)
    if mean == 0.0 or variance == 0.0:
        return 0.0
    return variance / mean * float(gammaincinv(mean**2 / variance, chance))


# --- half-spaces ------------------------------------------------------------------------------


def failing_directions(
    law: Law, ground: Ground, x: FloatArray, u: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Unit vectors ω (J, D) along which flights fail, and the lengths (J,) at which they begin to.

    The nearest first; of nearly parallel ones only the nearest. A robot whose airspeed does not suffice
    deviates like one that corrects less, so such robots give directions too.
    """
    rows = []
    for robot in less_held(law.robot):
        course = fly_means(replace(law, robot=robot), x)
        barriers = nearest_barriers(ground, course)
        if robot is law.robot:
            barriers += too_slow(law, course)
        rows += [direction(law, course, barrier, robot) for barrier in barriers]
    omega = np.array([row / np.linalg.norm(row) for row in rows if row.any()])
    begin = np.array([_first_failing(law, ground, x, u, row) for row in omega])
    kept: list[int] = []
    for k in np.argsort(begin, kind="stable").tolist():
        if np.isfinite(begin[k]) and (not kept or (omega[kept] @ omega[k]).max() < ALIKE):
            kept.append(k)
    return omega[kept[:MOST]], begin[kept[:MOST]]


def less_held(robot: Robot) -> list[Robot]:
    """The robot, and robots that correct half of what it corrects and nothing."""
    if robot.feedback == 0.0:
        return [robot]
    half = -robot.dt / math.log1p(-0.5 * robot.feedback)
    return [robot, *(replace(robot, feedback_time=time) for time in (half, None))]


def _first_failing(law: Law, ground: Ground, x: FloatArray, u: FloatArray, omega: FloatArray) -> float:
    """The least length of :data:`RAY` at which the flight along ``omega`` fails; infinite without one."""
    failed = ground.failed(fly(law, x, u, len(RAY), Stored(RAY[:, None] * omega, UnitScales())))
    return float(RAY[np.argmax(failed)]) if failed.any() else math.inf


def nearest_barriers(ground: Ground, course: Course) -> list[Barrier]:
    """What a flight meets or misses if it leaves the plan, nearest first."""
    solid = [*ground.obstacles, *(beyond_bounds(ground.bounds) if ground.walled else ())]
    regions = [part for parts in ground.regions.values() for part in parts]
    found = [barrier for part in (*solid, *regions) for barrier in _entered(part, course)]
    found += [barrier for part in regions for barrier in _missed(part, course)]
    return sorted((one for one in found if one.near < FARTHEST), key=lambda one: one.near)[:MOST]


def _distances(part: Convex, course: Course) -> tuple[FloatArray, FloatArray]:
    """Distance (T+1, F) of each mean before each face [m], positive outside; the same in sd of its step."""
    gap = course.x @ part.normals.T - part.offsets
    sd = np.sqrt(np.maximum(np.einsum("fi,tij,fj->tf", part.normals, course.cov, part.normals), 0.0))
    with np.errstate(divide="ignore"):
        return gap, np.where(sd > 0.0, gap / np.where(sd > 0.0, sd, 1.0), math.inf * np.sign(gap))


def _local_minima(values: FloatArray) -> list[int]:
    """Where finite ``values`` (n,) are least among their neighbours."""
    padded = np.concatenate([[math.inf], values, [math.inf]])
    least = (values <= padded[:-2]) & (values < padded[2:]) & np.isfinite(values)
    return [int(k) for k in np.flatnonzero(least)]


def _entered(part: Convex, course: Course) -> Iterator[Barrier]:
    """Through the face that separates a mean outside from the polygon, at the steps where it is nearest."""
    gap, ratio = _distances(part, course)
    face = ratio.argmax(axis=1)
    near = np.where(gap.max(axis=1) > 0.0, ratio.max(axis=1), math.inf)
    for t in _local_minima(near):
        yield Barrier(float(near[t]), {t: -part.normals[face[t]]})


def _missed(part: Convex, course: Course) -> Iterator[Barrier]:
    """Out through each face at the deepest step of each stay in the polygon."""
    _, ratio = _distances(part, course)
    depth = -ratio.max(axis=1)
    for t in _local_minima(np.where(depth > 0.0, -depth, math.inf)):
        for normal, near in zip(part.normals, -ratio[t], strict=True):
            yield Barrier(float(near), {t: normal})


def too_slow(law: Law, course: Course) -> list[Barrier]:
    """A robot that corrects its course lacks airspeed over some of the next :data:`SPANS` steps."""
    robot, steps = law.robot, len(course.u)
    speed = np.linalg.norm(course.u, axis=1)
    if robot.feedback == 0.0 or not (speed > 0.0).all():
        return []
    ahead, found = -np.linalg.solve(robot.b.T, (course.u / speed[:, None]).T).T, list[Barrier]()
    for span in (n for n in (*SPANS, steps) if n <= steps):
        some = []
        for first in range(0, steps - span + 1, max(1, span // 3)):
            within = range(first, first + span)
            barrier = Barrier(
                float((robot.u_max - speed[first : first + span]).sum()),
                {t: robot.feedback / robot.dt * ahead[t] for t in within},
                {t: (1.0 - robot.exposed) * ahead[t] for t in within},
            )
            sd = float(np.linalg.norm(direction(law, course, barrier, robot)))
            some.append(barrier._replace(near=barrier.near / sd if sd > 0.0 else math.inf))
        found += [some[k] for k in _local_minima(np.array([one.near for one in some]))]
    return sorted(found, key=lambda one: one.near)[:MOST]


def draws_before(law: Law, steps: int) -> list[bool]:
    """Of each of the ``steps``, whether :func:`fly` draws new parts of the coefficients before its wind."""
    return [t > 0 and not bool((law.kept(t) == 1.0).all()) for t in range(steps)]


def direction(law: Law, course: Course, barrier: Barrier, robot: Robot) -> FloatArray:
    """What each number that :func:`fly` draws adds to the sum of a ``barrier``, (D,); its norm is the sd.

    The ``robot`` is the one of the ``course``, the numbers are those that flights under ``law`` draw.
    """
    n, steps, none = law.coefficients, len(course.u), np.zeros(2)
    dt, renewed = robot.exposed * robot.dt, draws_before(law, steps)
    slope, field = np.asarray(barrier.positions.get(steps, none), float), np.zeros(n)
    of_steps: list[FloatArray] = []
    for t in reversed(range(steps)):
        on_wind = dt * slope + barrier.winds.get(t, none)
        white = np.sqrt(course.white[t]) * on_wind
        field = course.psi[t].T @ on_wind + law.kept(t + 1) * field
        slope = course.F[t].T @ slope + barrier.positions.get(t, none)
        fresh = np.sqrt(1.0 - law.kept(t) ** 2) * field if renewed[t] else np.empty(0)
        of_steps.append(np.concatenate([fresh, white]))
    field[law.modes :] += law.errors.start.T @ slope
    return np.concatenate([robot.start_sd * slope, field, *reversed(of_steps)])


# --- flights ----------------------------------------------------------------------------------


def equal_shares(directions: FloatArray, begin: FloatArray) -> Mixture:
    """The mixture in which the half-spaces of all ``directions`` (J, D) have the same share."""
    which, level = np.tile(np.arange(len(begin)), len(LEVELS)), np.repeat(LEVELS, len(begin))
    share = np.full(len(which), (1.0 - PLAIN) / len(which))
    return Mixture(directions, which, level * begin[which], share)


def shared_as_seen(mixture: Mixture, seen: FloatArray) -> Mixture:
    """The mixture with shares as the weights of failures that came by each component, ``seen`` (C,)."""
    equal = np.full(len(seen), 1.0 / len(seen))
    share = (1.0 - PLAIN - EQUAL) * seen / seen.sum() + EQUAL * equal
    return Mixture(mixture.directions, mixture.which, mixture.reach, share)


def weighted_flights(
    law: Law, ground: Ground, x: FloatArray, u: FloatArray, mixture: Mixture, runs: int, rng: Generator
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Batches of ``runs`` flights: weights (n,), 0 without a failure, and by which part it came (n, C)."""
    for first in range(0, runs, BATCH):
        n = min(BATCH, runs - first)
        numbers = ScaleDraws(n, rng.spawn(1)[0])
        scale = drawn_scales(law, n, numbers).typical(n)
        z = rng.standard_normal((n, mixture.directions.shape[1]))
        came = pushed(mixture, z, scale, rng)
        ratio = PLAIN + came.sum(axis=1)
        failed = ground.failed(fly(law, x, u, n, Stored(z, Again(numbers.drawn))))
        yield np.where(failed, numbers.weight / ratio, 0.0), came / ratio[:, None]


def pushed(mixture: Mixture, z: FloatArray, scale: FloatArray, rng: Generator) -> FloatArray:
    """Push draws ``z`` (n, D) in place, each into the half-space of its component, at its ``scale`` (n,).

    Returned is what each component adds to the ratio q/φ at the draws, (n, C).
    """
    share = np.append(mixture.share, PLAIN)
    component = rng.choice(len(share), size=len(z), p=share / share.sum())
    uniform, reach = 1.0 - rng.random(len(z)), np.minimum(mixture.reach / scale[:, None], DEEPEST)
    chance = ndtr(-reach)
    for k in np.flatnonzero(component < len(mixture.share)).tolist():
        c = component[k]
        omega = mixture.directions[mixture.which[c]]
        z[k] += (-float(ndtri(uniform[k] * chance[k, c])) - z[k] @ omega) * omega
    along = (z @ mixture.directions.T)[:, mixture.which]
    return np.asarray(np.where(along >= reach, mixture.share / chance, 0.0), float)
