"""Sampled refinement: trust-region Newton on the failure rate of common flights.

The deviations of n flights from the mean are held fixed for a few solves, then simulated again. The objective
is the smoothed failure

    mean_i σ(-m_i / τ),     τ falling from a share of the map to a few kilometres,

m_i the margin of flight i (:mod:`plane_logic.margin`), by one second-order cone programme a step with
the gradient and the Hessian of the binding events, within airspeed, map and the longest length allowed. The
sweeps of a front solve it by :mod:`plane_kernels.step_solver`; the last polish is made by
:class:`ConstrainedRefiner`: the same programme with the chance constraint of every segment, in cvxpy.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Protocol

import numpy as np

from pareto_ltl.kernels import descent as kd
from pareto_ltl.kernels.attraction import NEAREST, add_attraction
from pareto_ltl.kernels.data import LandmarkLaw
from pareto_ltl.kernels.pacing import fill_leg_times
from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.convex.programme import Descent, path_limits, programme_for, step_memory
from pareto_ltl.planning.evaluate import (
    airspeed_limits,
    empty_flight,
    propagate,
    propagate_controls,
    takes_fixes,
)
from pareto_ltl.planning.margin_model import margin_scratch, model_of_order, nearest_order, ordered
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.effort import Polish
from pareto_ltl.planning.routes.path_classes import PathClass, path_class
from pareto_ltl.planning.routes.taut_lines import CAP
from pareto_ltl.planning.separation import chance_along, excess
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray, length_of
from plane_logic import margin as km
from plane_logic.margin_events import MarginModel

EXCESS = 10.0  # penalty per relative excess of a segment over epsilon
MENDED = 0.1  # share of ``Polish.half`` that the last solve mends
COUNTED = 8.0  # widths: a flight with a larger margin counts for less than 3e-4
NEAR = 60.0  # widths that a first solve may move a path by
FINER = 8  # parts of a leg in which letters are looked for that no step reads
ALL = 0.9  # if more than this share of the flights counts, all are retained: copying winds takes longer


class CommonFlights(Protocol):
    """Flights in the same winds for every plan."""

    def deviations(self, flight: Flight) -> FloatArray:
        """Deviations (T+1, 2, n) [m] of the controls of ``flight`` from its means."""

    def unaided(self, flight: Flight) -> FloatArray:
        """Deviations (T+1, 2, n) [m] of the same flights without position fixes."""

    def ended(self, flight: Flight) -> tuple[FloatArray, BoolArray]:
        """The deviations, and which flights of a robot that corrects its course lack energy (n,)."""

    def linear(self) -> CommonFlights:
        """The same flights by the law linearised about their path: sooner known, and not exact."""

    def exact(self) -> CommonFlights:
        """The same flights in the law itself."""

    def only(self, rows: IntArray) -> CommonFlights:
        """The flights ``rows`` only."""

    def merged(self, problem: Problem, times: int) -> CommonFlights:
        """The same flights in ``problem``, whose steps are ``times`` as long."""

    def __len__(self) -> int: ...


@dataclass(frozen=True, slots=True)
class Candidate:
    """A path after polishing: its flight, length [m], smoothed failure and failure rate on its flights.

    ``kind`` is its class, None where that is not known. ``breach`` in [0, 1) is the part of ``smoothed`` that
    stands for segments which exceed epsilon; 0 if the path keeps it, or will after its last solve.
    """

    flight: Flight
    length: float
    smoothed: float
    failed: float
    origin: str = ""
    kind: PathClass | None = None
    breach: float = 0.0

    @property
    def steps(self) -> int:
        """The number of steps of the flight."""
        return len(self.flight.u)

    @property
    def failure(self) -> float:
        """The smoothed failure alone."""
        return self.smoothed - self.breach

    def moved(self, flight: Flight) -> Candidate:
        """The same with another ``flight``, whose failures and class are not looked at."""
        return replace(self, flight=flight, length=length_of(flight.x), kind=None)


@dataclass(slots=True)
class Refiner:
    """What all polishes of one problem share.

    Paths short enough, none of whose flights come near a limit, are not solved for, unless ``SOLVES_ALL``.
    """

    SOLVES_ALL: ClassVar[bool] = False
    problem: Problem
    model: MarginModel
    orders: dict[bytes, MarginModel] = field(default_factory=dict)

    def model_along(self, x: FloatArray) -> MarginModel:
        """The model of margins for flights near the means ``x`` (T+1, 2)."""
        if not ordered(self.model):
            return self.model
        states = self.states_passed(x)
        if not self.completed(states):  # no step lies in a place on the way
            states = self.states_passed(divided(x, FINER))
        if not self.completed(states):
            states = nearest_order(self.model, x)
        key = states.tobytes()
        if key not in self.orders:
            self.orders[key] = model_of_order(self.model, states)
        return self.orders[key]

    def completed(self, states: IntArray) -> bool:
        """Whether one of ``states`` (S,) is accepting."""
        return bool((self.problem.logic.distance[states] == 0.0).any())

    def states_passed(self, x: FloatArray) -> IntArray:
        """The automaton states along the means ``x`` (T+1, 2), ascending, each once."""
        return np.unique(np.append(self.problem.states(x), self.model.logic.initial))

    # --- means and controls ---

    def flown(self, x: FloatArray) -> Flight:
        """The flight along ``x`` (T+1, 2) [m], its controls scaled into the airspeed limits if necessary."""
        problem = self.problem
        flight = propagate(problem, x)
        for _ in range(2):
            speed = np.linalg.norm(flight.u, axis=1)
            least, limit = airspeed_limits(problem, (1.0 - 1e-9) * np.maximum(flight.speed, 0.0))
            if ((speed >= least * (1.0 - 1e-9)) & (speed <= limit * (1.0 + 1e-9))).all():
                break
            wanted = np.minimum(np.maximum(speed, least / CAP), np.maximum(CAP * limit, least))
            u = flight.u * (wanted / np.maximum(speed, 1e-9))[:, None]
            flight = propagate_controls(problem, np.ascontiguousarray(u), problem.world.law)
        return flight

    def slope(self, x: FloatArray, off: FloatArray, width: float, runs: float) -> tuple[Descent, FloatArray]:
        """Smoothed failure with derivatives of ``x`` + ``off`` (T+1, 2, n) of ``runs`` flights; margins (n,).

        The ``runs`` - n flights that are left out have margins too large to count.

        Eqs. (M54) and (M55) of docs/mathematics_methods.md.
        """
        slope, model = km.Slope(np.zeros((len(x), 2)), np.zeros((len(x), 3))), self.model_along(x)
        scratch = margin_scratch(model, off.shape[2], len(x))
        share = off.shape[2] / runs
        value = share * float(km.smoothed_failure(model, x, off, width, slope, scratch))
        descent = Descent(share * slope.gradient, share * slope.hessian, max(value, kd.LEAST_VALUE))
        return descent, scratch.margins

    # --- polishing ---

    def polish(
        self, x: FloatArray, flights: CommonFlights, how: Polish, longest: float, origin: str = ""
    ) -> Candidate:
        """The result of trust-region Newton from the means ``x`` (T+1, 2), about ``longest`` [m] at most."""
        flight = self.polished(x, flights, how, longest)
        return self.assessed(flight, flights, how.widths[-1], how.half, origin)

    def polished(self, x: FloatArray, flights: CommonFlights, how: Polish, longest: float) -> Flight:
        """The flight of :meth:`polish`, whose failures are not counted."""
        flight, near, runs = self.flown(x), flights, len(flights)
        chance = chance_along(self.problem, flight, how.stiff)
        for width in how.widths:
            trust = min(how.trust, NEAR * width / self.problem.reach)
            solves = kd.Solves(how.inner, trust, longest, chance)
            flight, near = self._at_width(flight, near, runs, width, solves)
        return flight

    def worth_of_fixes(
        self, flight: Flight, flights: CommonFlights, here: Descent, width: float, runs: int
    ) -> float:
        """What the fixes of ``flight`` save: its smoothed failure without them, less ``here``'s.

        Deviations are held fixed in the solves, so that the failure does not see that a path that leaves a
        landmark loses its fix. The attraction of landmarks, Eq. (M75) of docs/mathematics_methods.md, does.
        """
        if not takes_fixes(flight):
            return 0.0
        alone, _ = self.slope(flight.x, flights.unaided(flight), width, runs)
        return max(alone.value - here.value, 0.0)

    def assessed(
        self, flight: Flight, flights: CommonFlights, width: float, half: float, origin: str = ""
    ) -> Candidate:
        """``flight`` as it is, with its failure smoothed over ``width`` [m]; ``half`` as in :class:`Polish`.

        Flights that need more energy than the robot has fail; the solves do not see them. What the
        worst segment exceeds epsilon by is added to the smoothed failure, unless the last solve can mend it.
        """
        off, exhausted = flights.ended(flight)
        here, margins = self.slope(flight.x, off, width, len(flights))
        failed, kind = margins < 0.0, path_class(self.problem, flight.x)
        landed = float((exhausted & ~failed).mean())
        above = max(float(excess(self.problem, flight).max()) - MENDED * half, 0.0)
        breach = above / (above + half)
        smoothed = here.value + landed + breach
        return Candidate(
            flight, length_of(flight.x), smoothed, float(failed.mean()) + landed, origin, kind, breach
        )

    def _at_width(
        self, flight: Flight, near: CommonFlights, runs: int, width: float, solves: kd.Solves
    ) -> tuple[Flight, CommonFlights]:
        """The flight after the solves at one width, and the flights that still count.

        Flights with a margin larger than the path may move in the first solve no longer count.
        """
        off = near.deviations(flight)
        here, margins = self.slope(flight.x, off, width, runs)
        rows = np.flatnonzero(margins < COUNTED * width + solves.trust * self.problem.reach)
        if len(rows) == 0 and not self.SOLVES_ALL and length_of(flight.x) <= solves.longest:
            return flight, near
        if len(rows) == 0:
            rows = np.array([margins.argmin()])
        if len(rows) < ALL * len(margins):
            off, near = np.ascontiguousarray(off[:, :, rows]), near.only(rows)
        worth = self.worth_of_fixes(flight, near, here, width, runs)
        sample = kd.Sample(off, width, off.shape[2] / runs, worth, here.value)
        return self.descended(flight, here, sample, solves), near

    def descended(self, flight: Flight, here: Descent, sample: kd.Sample, solves: kd.Solves) -> Flight:
        """The flight after the solves at one width, whose deviations do not change.

        ``here`` is the smoothed failure of ``flight``.
        """
        problem, margins, n = self.problem, self.model_along(flight.x), len(flight.x)
        scratch = margin_scratch(margins, sample.off.shape[2], n)
        memory = kd.Memory(*step_memory(problem, len(flight.u)), scratch, np.empty(NEAREST, np.int64))
        first = kd.Guess(flight, km.Slope(here.gradient, here.hessian))
        other = empty_flight(problem.world.law, n)
        second = kd.Guess(other, km.Slope(np.empty((n, 2)), np.empty((n, 3))))
        ended = kd.descend(
            problem.world.law, path_limits(problem), margins, sample, solves, first, second, memory
        )
        return (first, second)[ended].flight


@dataclass(slots=True)
class ConstrainedRefiner(Refiner):
    """Polishes within ``planner.epsilon`` in every segment, by the programme of :mod:`~.programme`."""

    SOLVES_ALL: ClassVar[bool] = True

    def descended(self, flight: Flight, here: Descent, sample: kd.Sample, solves: kd.Solves) -> Flight:
        """Decides like :func:`~pareto_ltl.kernels.descent.descend`."""
        trust = solves.trust
        here = self.with_lure(here, flight, sample)
        value = here.value + self.penalty(flight, solves.longest)
        for _ in range(solves.number):
            cap = max(solves.longest, kd.SHORTENED * length_of(flight.x))
            x = self.next_means(flight, here, trust, cap)
            if x is None:
                trust *= kd.NARROWER
                continue
            other = self.flown(x)
            there, _ = self.slope(other.x, sample.off, sample.width, sample.off.shape[2] / sample.share)
            there = self.with_lure(there, other, sample)
            now = there.value + self.penalty(other, solves.longest)
            if now < value:
                gain = (value - now) / value
                flight, here, value, trust = other, there, now, min(kd.WIDER * trust, 1.0)
                if gain < kd.INNER_GAIN:
                    break
            else:
                trust *= kd.NARROWER
                if trust < kd.NARROWEST:
                    break
        return flight

    def next_means(self, flight: Flight, here: Descent, trust: float, cap: float) -> FloatArray | None:
        """Means (T+1, 2) [m] that lower the model ``here`` of ``flight``; None if there are none."""
        solution = programme_for(self.problem, len(flight.u)).descend(flight, here, trust, cap)
        return None if solution is None else solution.x

    def with_lure(self, here: Descent, flight: Flight, sample: kd.Sample) -> Descent:
        """The smoothed failure ``here`` of ``flight`` and the attraction of landmarks."""
        law = self.problem.world.law
        if sample.worth <= 0.0 or not isinstance(law, LandmarkLaw):
            return here
        slope, worth = km.Slope(here.gradient, here.hessian), sample.worth * sample.share
        more = add_attraction(law.landmarks, flight.x, sample.off, sample.width, worth, slope)
        return Descent(slope.gradient, slope.hessian, here.value + float(more))

    def penalty(self, flight: Flight, longest: float) -> float:
        """What violated limits add to the failure.

        These are the length above ``longest`` [m], and risks of segments above epsilon, relative to it.
        """
        overlong = max(0.0, length_of(flight.x) / longest - 1.0)
        return kd.OVERLONG * overlong + EXCESS * float(excess(self.problem, flight).sum())


def divided(x: FloatArray, parts: int) -> FloatArray:
    """``x`` (T+1, 2) with each leg divided into ``parts``."""
    at = np.linspace(0.0, len(x) - 1.0, parts * (len(x) - 1) + 1)
    return np.column_stack([np.interp(at, np.arange(len(x)), x[:, c]) for c in (0, 1)])


def deviations_from(positions: FloatArray, x: FloatArray) -> FloatArray:
    """Deviations (T+1, 2, n) of ``positions`` (n, T+1, 2) from the means ``x`` (T+1, 2)."""
    return np.ascontiguousarray(np.moveaxis(positions - x, 0, 2))


def steps_needed(problem: Problem, x: FloatArray) -> FloatArray:
    """Time that each leg of ``x`` (T+1, 2) takes at full airspeed in the expected wind, (T,) [steps].

    Eq. (M57) of docs/mathematics_methods.md.
    """
    needed = np.empty(len(x) - 1)
    fill_leg_times(problem.wind, problem.motion, CAP, np.ascontiguousarray(x), needed)
    return needed


def fewest_steps(needed: FloatArray) -> int:
    """The fewest steps of a path whose legs take the times ``needed`` (T,) [steps] at full airspeed."""
    return int(np.ceil(needed.sum() * 1.01))


def resampled_means(
    problem: Problem, x: FloatArray, steps: int, needed: FloatArray | None = None
) -> FloatArray:
    """The line of ``x`` (T+1, 2) divided into ``steps`` steps that need the same share of the airspeed.

    ``needed`` (T,) is :func:`steps_needed` of ``x`` where that is known.
    """
    needed = steps_needed(problem, x) if needed is None else needed
    time = np.concatenate([[0.0], np.cumsum(needed + 1e-6)])
    at = np.linspace(0.0, time[-1], steps + 1)
    return np.column_stack([np.interp(at, time, x[:, i]) for i in (0, 1)])
