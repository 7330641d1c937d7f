"""Simulated flights: which of them fail, when and why; the record that stages exchange, and its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from careful_io.files import write_npz
from pareto_ltl.planning.rates import FailureRate
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.display import Displayed
from pareto_ltl.support.stored import stored

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem

NO_FAILURE = -1
CAUSES = ("met an obstacle", "left the map", "broke the mission", "did not complete the mission")
COLLIDED, OFF_MAP, BROKEN, MISSED = range(4)
FLIGHT_ARRAYS = ("x", "accepted", "collided", "off_map", "walled")


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
        Index into ``Deployment.CAUSES``; -1 for flights that do not fail.
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


@dataclass(frozen=True, slots=True, repr=False)
class Deployment(Displayed):
    """Simulated flights of one plan under one wind law.

    Attributes
    ----------
    x : (n, T+1, 2) float
        Positions [m].
    accepted : (n,) bool
        Flights that complete the mission.
    collided, off_map : (n,) bool
        Flights that met an obstacle, and that left the map.
    walled : bool
        Whether leaving the map is a failure (``scene.border=wall``).
    """

    CAUSES: ClassVar[tuple[str, ...]] = CAUSES
    law: str
    x: FloatArray
    accepted: BoolArray
    collided: BoolArray
    off_map: BoolArray
    walled: bool = False

    @classmethod
    def judged(cls, problem: Problem, law: str, x: FloatArray) -> Deployment:
        """The flights ``x`` (n, T+1, 2) [m]: which complete the mission, meet obstacles, leave the map."""
        from pareto_ltl.kernels import flight as kernel

        nearby = problem.world.collision.nearby
        judge = kernel.Judge(problem.cells, problem.logic, problem.obstacles, nearby)
        outcome = kernel.Outcome(x, *(np.empty(len(x), bool) for _ in range(3)))
        kernel.judge_batch(judge, outcome)
        return cls(law, *outcome, problem.scene.walled)

    @property
    def failed(self) -> BoolArray:
        """Flights that miss the mission, meet an obstacle or, where the border is a wall, leave the map."""
        failed: BoolArray = ~self.accepted | self.collided
        return failed | self.off_map if self.walled else failed

    @property
    def rate(self) -> FailureRate:
        """Share of the flights that fail, with its interval."""
        return FailureRate.counted(self.law, int(self.failed.sum()), len(self.x))

    def failure_times(self, problem: Problem) -> FailureTimes:
        """When and why each flight fails first; ``failed`` names the flights that fail."""
        n, steps = len(self.x), self.x.shape[1] - 1
        step, cause = np.full(n, steps + 1), np.full(n, NO_FAILURE)

        def note(flights: IntArray, when: IntArray, why: int) -> None:
            sooner = when < step[flights]
            step[flights[sooner]], cause[flights[sooner]] = when[sooner], why

        for flag, why in (("collided", COLLIDED), ("off_map", OFF_MAP)):
            if why == COLLIDED or self.walled:
                met = np.flatnonzero(getattr(self, flag))
                note(met, _first_steps(problem, self.law, self.x[met], flag), why)
        missed = np.flatnonzero(~self.accepted)
        trapped = [np.isinf(problem.automaton.distance[problem.states(self.x[flight])]) for flight in missed]
        broken = np.array([row.argmax() if row.any() else steps + 1 for row in trapped], np.int64)
        note(missed, broken, BROKEN)
        note(missed, np.full(len(missed), steps), MISSED)
        return FailureTimes(steps, np.where(cause >= 0, step, NO_FAILURE), cause)

    def facts(self) -> Mapping[str, str]:
        """Number of flights, failure rate with its interval, and why flights fail."""
        gone = int(self.off_map.sum())
        return {
            "flights": f"{len(self.x):,}",
            "fail": str(self.rate),
            "miss the mission": f"{int((~self.accepted).sum()):,}",
            "meet an obstacle": f"{int(self.collided.sum()):,}",
            "leave the map": f"{gone:,}" + ("" if self.walled or not gone else ", which is no failure"),
        }


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
        until = np.ascontiguousarray(x[flights, : middle + 1])
        seen: BoolArray = getattr(Deployment.judged(problem, law, until), flag)
        stack += [(flights[seen], low, middle), (flights[~seen], middle, high)]
    return found


def write_deployments(directory: Path, deployments: Mapping[str, Deployment]) -> None:
    """Write ``deployments.npz``: the flights under each wind law."""
    flights = deployments.items()
    arrays = {f"{law}/{n}": np.asarray(getattr(flown, n)) for law, flown in flights for n in FLIGHT_ARRAYS}
    write_npz(directory / "deployments.npz", arrays)


def read_deployments(place: Path | str) -> dict[str, Deployment]:
    """The flights of ``deployments.npz`` by wind law; ``place`` is the file or the directory that has it."""
    with stored(place, "deployments.npz", "deployments") as arrays:
        laws = sorted({name.partition("/")[0] for name in arrays})
        flights = {law: [arrays[f"{law}/{name}"] for name in FLIGHT_ARRAYS] for law in laws}
        return {law: Deployment(law, f[0], f[1], f[2], f[3], bool(f[4].all())) for law, f in flights.items()}
