"""Sampled refinement: trust-region Newton on the failure rate of common flights.

The deviations of n flights from the mean are held fixed for a few solves, then simulated again. The objective
is the smoothed failure

    mean_i σ(-m_i / τ),     τ falling from a share of the map to a few kilometres,

m_i the margin of flight i (:mod:`pareto_ltl.kernels.margin`), by one second-order cone programme a step with
the gradient and the Hessian of the binding events, within airspeed, map and the longest length allowed. The
sweeps of a front solve it by :mod:`pareto_ltl.kernels.step_solver`; its last polish is that of
:class:`ConstrainedRefiner`, the same programme with the chance constraint of every segment, in cvxpy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pareto_ltl.kernels import margin as km
from pareto_ltl.kernels.data import LandmarkLaw
from pareto_ltl.kernels.margin_events import MarginModel
from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.evaluate import airspeed_limits, propagate, propagate_controls, takes_fixes
from pareto_ltl.planning.margin_model import margin_scratch
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.attraction import Attraction
from pareto_ltl.planning.refine.programme import programmes_of
from pareto_ltl.planning.refine.separation import allowed_risk, separation
from pareto_ltl.planning.refine.step_programme import Descent, next_means
from pareto_ltl.planning.routes.taut_lines import CAP
from pareto_ltl.planning.wind_lookup import wind_and_gradient
from pareto_ltl.support.arrays import FloatArray, IntArray

EXCESS = 10.0  # penalty per relative risk of a segment above epsilon
OVERLONG = 20.0  # penalty per relative length above the cap: more than any failure
SHORTENED = 0.985  # one solve may shorten the path to this share of its length, not further
WIDER, NARROWER, NARROWEST = 1.5, 0.35, 0.01  # factors of the trust region after a success or not; its least
INNER_GAIN, OUTER_GAIN = 1e-3, 5e-3  # relative gain below which the solves, or the roll-outs, of a width end
COUNTED = 8.0  # widths: a flight with a larger margin counts for less than 3e-4
ALL = 0.9  # if more than this share of the flights counts, all are kept: copying winds takes longer
LEAST_VALUE = 1e-6
SLOWEST = 0.05  # of u_max: least ground speed assumed for a leg against a strong wind


class CommonFlights(Protocol):
    """Flights in the same winds for every plan."""

    def positions(self, flight: Flight) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls of ``flight``."""

    def unaided(self, flight: Flight) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the same flights without position fixes."""

    def only(self, rows: IntArray) -> CommonFlights:
        """The flights ``rows`` only."""

    def __len__(self) -> int: ...


@dataclass(frozen=True, slots=True)
class Polish:
    """Effort of a refinement.

    ``widths`` τ [m] in turn, ``outer`` roll-outs for each width, ``inner`` solves for each roll-out, and the
    first ``trust`` region [full steps].
    """

    widths: tuple[float, ...]
    outer: int = 2
    inner: int = 4
    trust: float = 0.5


@dataclass(frozen=True, slots=True)
class Candidate:
    """A path after polishing: its flight, length [m], smoothed failure and failure rate on its flights."""

    flight: Flight
    length: float
    smoothed: float
    failed: float
    origin: str = ""

    @property
    def steps(self) -> int:
        """The number of steps of the flight."""
        return len(self.flight.u)


def path_length(x: FloatArray) -> float:
    """Length of the means ``x`` (T+1, 2) [m]."""
    return float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())


@dataclass(slots=True)
class Refiner:
    """What all polishes of one problem share."""

    problem: Problem
    model: MarginModel

    # --- means and controls ---

    def flown(self, x: FloatArray) -> Flight:
        """The flight along ``x`` (T+1, 2) [m], its controls scaled into the airspeed limits if necessary."""
        problem = self.problem
        flight = propagate(problem, x)
        for _ in range(2):
            speed = np.linalg.norm(flight.u, axis=1)
            least, most = airspeed_limits(problem, (1.0 - 1e-9) * np.maximum(flight.speed, 0.0))
            if ((speed >= least * (1.0 - 1e-9)) & (speed <= most * (1.0 + 1e-9))).all():
                break
            wanted = np.minimum(np.maximum(speed, least / CAP), np.maximum(CAP * most, least))
            u = flight.u * (wanted / np.maximum(speed, 1e-9))[:, None]
            flight = propagate_controls(problem, np.ascontiguousarray(u), problem.world.law)
        return flight

    def slope(self, x: FloatArray, off: FloatArray, width: float, runs: int) -> tuple[Descent, FloatArray]:
        """Smoothed failure with derivatives of ``x`` + ``off`` (T+1, 2, n) of ``runs`` flights; margins (n,).

        The ``runs`` - n flights that are left out have margins too large to count.

        Eqs. (M54) and (M55) of docs/mathematics_methods.md.
        """
        slope = km.Slope(np.zeros((len(x), 2)), np.zeros((len(x), 3)))
        scratch = margin_scratch(self.model, off.shape[2], len(x))
        share = off.shape[2] / runs
        value = share * float(km.smoothed_failure(self.model, x, off, width, slope, scratch))
        descent = Descent(share * slope.gradient, share * slope.hessian, max(value, LEAST_VALUE))
        return descent, scratch.margins

    # --- polishing ---

    def step(self, flight: Flight, here: Descent, trust: float, cap: float) -> FloatArray | None:
        """Means (T+1, 2) [m] that lower the model ``here`` about those of ``flight``; None: none found."""
        return next_means(self.problem, flight, here, trust, cap)

    def penalty(self, flight: Flight, longest: float) -> float:
        """What violated limits add to the failure: the length above ``longest`` [m]."""
        return OVERLONG * max(0.0, path_length(flight.x) / longest - 1.0)

    def polish(
        self, x: FloatArray, flights: CommonFlights, how: Polish, longest: float, origin: str = ""
    ) -> Candidate:
        """The result of trust-region Newton from the means ``x`` (T+1, 2), about ``longest`` [m] at most."""
        return self.assessed(self.polished(x, flights, how, longest), flights, how.widths[-1], origin)

    def polished(self, x: FloatArray, flights: CommonFlights, how: Polish, longest: float) -> Flight:
        """The flight of :meth:`polish`, whose failures are not counted."""
        flight, near, runs = self.flown(x), flights, len(flights)
        for width in how.widths:
            flight, near = self._at_width(flight, near, runs, how, width, longest)
        return flight

    def attraction(
        self, flight: Flight, flights: CommonFlights, here: Descent, width: float, runs: int
    ) -> Attraction:
        """What the fixes of ``flight`` save: its smoothed failure without them, less that of ``here``."""
        law = self.problem.laws["coherent"]
        if not isinstance(law, LandmarkLaw) or not takes_fixes(flight):
            return Attraction(None, 0.0)
        off = deviations_from(flights.unaided(flight), flight.x)
        alone, _ = self.slope(flight.x, off, width, runs)
        return Attraction(law.landmarks, alone.value - here.value)

    def assessed(self, flight: Flight, flights: CommonFlights, width: float, origin: str = "") -> Candidate:
        """``flight`` as it is, with its failure smoothed over ``width`` [m]."""
        off = deviations_from(flights.positions(flight), flight.x)
        here, margins = self.slope(flight.x, off, width, len(flights))
        return Candidate(flight, path_length(flight.x), here.value, float((margins < 0.0).mean()), origin)

    def _at_width(
        self, flight: Flight, near: CommonFlights, runs: int, how: Polish, width: float, longest: float
    ) -> tuple[Flight, CommonFlights]:
        """The flight after the solves at one width, and the flights that still count.

        Flights with a margin larger than the path may move in the first solve no longer count.
        """
        trust = how.trust
        for turn in range(how.outer):
            off = deviations_from(near.positions(flight), flight.x)
            here, margins = self.slope(flight.x, off, width, runs)
            if turn == 0:
                rows = np.flatnonzero(margins < COUNTED * width + how.trust * self.problem.reach)
                if len(rows) == 0:
                    break
                if len(rows) < ALL * len(margins):
                    off, near = np.ascontiguousarray(off[:, :, rows]), near.only(rows)
            lure = self.attraction(flight, near, here, width, runs)
            here = lure.added(here, flight.x, off, width, runs)
            value = here.value + self.penalty(flight, longest)
            before = value
            for _ in range(how.inner):
                cap = max(longest, SHORTENED * path_length(flight.x))
                y = self.step(flight, here, trust, cap)
                if y is None:
                    trust *= NARROWER
                    continue
                other = self.flown(y)
                there, _ = self.slope(other.x, off, width, runs)
                there = lure.added(there, other.x, off, width, runs)
                now = there.value + self.penalty(other, longest)
                if now < value:
                    gain = (value - now) / value
                    flight, here, value, trust = other, there, now, min(WIDER * trust, 1.0)
                    if gain < INNER_GAIN:
                        break
                else:
                    trust *= NARROWER
                    if trust < NARROWEST:
                        break
            if before - value < OUTER_GAIN * before:
                break
        return flight, near


@dataclass(slots=True)
class ConstrainedRefiner(Refiner):
    """Polishes within ``planner.epsilon`` in every segment, by the programme of :mod:`~.programme`."""

    def step(self, flight: Flight, here: Descent, trust: float, cap: float) -> FloatArray | None:
        """The solution of the convex programme."""
        solution = programmes_of(self.problem).of(len(flight.u)).descend(flight, here, trust, cap)
        return None if solution is None else solution.x

    def penalty(self, flight: Flight, longest: float) -> float:
        """Also the risks of segments above epsilon, relative to it."""
        risk, limit = separation(self.problem, flight).risk, allowed_risk(self.problem)
        above = np.maximum(risk / limit - 1.0, 0.0).sum()
        return Refiner.penalty(self, flight, longest) + EXCESS * float(above)


def deviations_from(positions: FloatArray, x: FloatArray) -> FloatArray:
    """Deviations (T+1, 2, n) of ``positions`` (n, T+1, 2) from the means ``x`` (T+1, 2)."""
    return np.ascontiguousarray(np.moveaxis(positions - x, 0, 2))


def steps_needed(problem: Problem, x: FloatArray) -> FloatArray:
    """Time that each leg of ``x`` (T+1, 2) takes at full airspeed in the expected wind, (T,) [steps].

    Along the direction d the ground speed is d' w + √(u_max² - |w - (d' w) d|²). The wind is that of the
    leg's own step; B is taken as dt I.

    Eq. (M57) of docs/mathematics_methods.md.
    """
    motion = problem.motion
    wind, _ = wind_and_gradient(problem.wind, x[:-1])
    leg = np.diff(x, axis=0)
    length = np.linalg.norm(leg, axis=1)
    along = np.einsum("ti,ti->t", leg, wind) / np.maximum(length, 1e-9)
    across = np.maximum((wind**2).sum(axis=1) - along**2, 0.0)
    speed = along + np.sqrt(np.maximum((CAP * motion.u_max) ** 2 - across, 0.0))
    return np.asarray(length / (motion.dt * np.maximum(speed, SLOWEST * motion.u_max)), float)


def resampled_means(problem: Problem, x: FloatArray, steps: int) -> FloatArray:
    """The line of ``x`` (T+1, 2) divided into ``steps`` steps that need the same share of the airspeed."""
    time = np.concatenate([[0.0], np.cumsum(steps_needed(problem, x) + 1e-6)])
    at = np.linspace(0.0, time[-1], steps + 1)
    return np.column_stack([np.interp(at, time, x[:, i]) for i in (0, 1)])
