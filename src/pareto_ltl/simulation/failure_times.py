"""When simulated flights fail, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.simulation.flights import judge_flights
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

NO_FAILURE = -1
CAUSES = ("met an obstacle", "left the map", "broke the mission", "did not complete the mission")
COLLIDED, OFF_MAP, BROKEN, MISSED = range(4)


@dataclass(frozen=True, slots=True)
class FailureTimes:
    """For n flights, the time and the cause of the first failure of each.

    Attributes
    ----------
    steps : int
        Steps T of the flights.
    step : (n,) int
        The first step, 0 to T, at which the flight has failed; -1 for flights that do not fail.
        A flight whose only failure is an incomplete mission fails at the last step.
    cause : (n,) int
        Index into ``CAUSES``; -1 for flights that do not fail.
    """

    steps: int
    step: IntArray
    cause: IntArray

    def counts(self) -> IntArray:
        """Number of flights that have failed by each step, for each cause, (4, T+1)."""
        found = np.zeros((len(CAUSES), self.steps + 1), np.int64)
        failed = self.step >= 0
        np.add.at(found, (self.cause[failed], self.step[failed]), 1)
        return found.cumsum(axis=1)


def failure_times(problem: Problem, flown: Deployment) -> FailureTimes:
    """When each flight of ``flown`` fails first; ``flown.failed`` names the flights that fail."""
    n, steps = len(flown.x), flown.x.shape[1] - 1
    step, cause = np.full(n, steps + 1), np.full(n, NO_FAILURE)

    def note(flights: IntArray, when: IntArray, why: int) -> None:
        sooner = when < step[flights]
        step[flights[sooner]], cause[flights[sooner]] = when[sooner], why

    for flag, why in (("collided", COLLIDED), ("off_map", OFF_MAP)):
        if why == COLLIDED or flown.walled:
            met = np.flatnonzero(getattr(flown, flag))
            note(met, _first_steps(problem, flown.law, flown.x[met], flag), why)
    missed = np.flatnonzero(~flown.accepted)
    broken = np.array([_broken_step(problem, flown.x[flight]) for flight in missed], np.int64)
    note(missed, broken, BROKEN)
    note(missed, np.full(len(missed), steps), MISSED)
    return FailureTimes(steps, np.where(cause >= 0, step, NO_FAILURE), cause)


def _first_steps(problem: Problem, law: str, x: FloatArray, flag: str) -> IntArray:
    """The first step by which each of the flights ``x`` (n, T+1, 2) has ``flag``, (n,), by bisection.

    Each of them has it at the last step, and a flight never loses it.
    """
    found = np.full(len(x), x.shape[1] - 1)
    stack = [(np.arange(len(x)), 0, x.shape[1] - 1)]
    while stack:
        flights, low, high = stack.pop()  # not yet at low, surely at high
        if not len(flights) or high - low <= 1:
            found[flights] = high
            continue
        middle = (low + high) // 2
        seen: BoolArray = getattr(
            judge_flights(problem, law, np.ascontiguousarray(x[flights, : middle + 1])), flag
        )
        stack += [(flights[seen], low, middle), (flights[~seen], middle, high)]
    return found


def _broken_step(problem: Problem, x: FloatArray) -> int:
    """The first step of a flight ``x`` (T+1, 2) in the trap of the automaton; T + 1 if there is none."""
    lost = np.flatnonzero(np.isinf(problem.automaton.distance[problem.states(x)]))
    return int(lost[0]) if len(lost) else len(x)
