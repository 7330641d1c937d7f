"""Flights of a plan that branches: sorted into cells by a measured position, each flown to its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.planning.branching.records import TRUNK, BranchFix, Branching
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.simulation.common_flights import DrawnFlights, draw_flights
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

BLOCK = 1000  # flights that are drawn together: their winds fill the memory


@dataclass(frozen=True, slots=True)
class TreeFlights:
    """Flights in drawn winds, with the draws of the errors of their fixes.

    Attributes
    ----------
    noise : (n, 2) float
        Standard normal draws of the errors of the measured positions.
    luck : (n,) float
        Uniform draws; a fix can be taken if its draw is below its probability.
    """

    flights: DrawnFlights
    noise: FloatArray
    luck: FloatArray

    def __len__(self) -> int:
        return len(self.flights)

    @classmethod
    def drawn(cls, problem: Problem, runs: int, seed: SeedSequence) -> TreeFlights:
        """``runs`` flights in the winds of the law of ``problem``."""
        winds, fixes = seed.spawn(2)
        rng = np.random.default_rng(fixes)
        noise, luck = rng.standard_normal((runs, 2)), rng.random(runs)
        return cls(draw_flights(problem, problem.fidelity.law, runs, winds), noise, luck)

    def only(self, rows: IntArray) -> TreeFlights:
        """The flights ``rows``, ascending."""
        return TreeFlights(self.flights.only(rows), self.noise[rows], self.luck[rows])

    def flown(self, u: FloatArray) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls ``u`` (T, 2), without a fix."""
        return self.flights.flown(u, np.zeros((len(u) + 1, 2)))

    def measured(self, fix: BranchFix, x: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Measured positions (n, 2) [m] of flights that are at ``x`` (n, 2), and which of them are taken."""
        return x + fix.sd * self.noise, fix.inside(x) & (self.luck < fix.available)

    def failed(self, u: FloatArray) -> BoolArray:
        """Which flights of the controls ``u`` (T, 2) fail."""
        return self.flights.failed(self.flown(u))


def whole_controls(trunk: FloatArray, step: int, rest: FloatArray) -> FloatArray:
    """The controls of the plan up to ``step``, then ``rest``."""
    return np.ascontiguousarray(np.vstack([trunk[:step], rest]))


def fly_branches(
    winds: TreeFlights, trunk: FloatArray, step: int, rests: Sequence[FloatArray], branch: IntArray
) -> BoolArray:
    """Which flights (n,) fail if each flies the rest of its ``branch``, or ``TRUNK``."""
    failed = np.zeros(len(winds), bool)
    for number, rest in ((TRUNK, trunk[step:]), *enumerate(rests)):
        rows = np.flatnonzero(branch == number)
        if len(rows):
            failed[rows] = winds.only(rows).failed(whole_controls(trunk, step, rest))
    return failed


def branches_of(winds: TreeFlights, fix: BranchFix, branching: Branching, trunk: FloatArray) -> IntArray:
    """The number of the branch that each flight takes, ``TRUNK`` if it takes no fix."""
    at = winds.flown(np.ascontiguousarray(trunk[: fix.step]))[:, -1]
    y, taken = winds.measured(fix, at)
    return np.where(taken, branching.chosen(y), TRUNK)


@dataclass(frozen=True, slots=True)
class TreeOutcome:
    """Fresh flights of a tree: the ``branch`` (n,) of each, whether it fails with branches, and alone."""

    branch: IntArray
    failed: BoolArray
    alone: BoolArray


def fly_tree(
    problem: Problem, trunk: PlannedPath, branching: Branching, runs: int, seed: SeedSequence
) -> TreeOutcome:
    """Fly a plan with its branches, and alone, ``runs`` times in the same winds."""
    parts = []
    blocks = [min(BLOCK, runs - first) for first in range(0, runs, BLOCK)]
    rests = [branch.path.u for branch in branching.branches]
    for size, child in zip(blocks, seed.spawn(len(blocks)), strict=True):
        winds = TreeFlights.drawn(problem, size, child)
        branch = branches_of(winds, branching.fix, branching, trunk.u)
        failed = fly_branches(winds, trunk.u, branching.fix.step, rests, branch)
        parts.append((branch, failed, winds.failed(trunk.u)))
    return TreeOutcome(*(np.concatenate(column) for column in zip(*parts, strict=True)))
