"""Flights of a plan that branches: sorted into cells by measured positions, each flown to its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.extend import BranchFix, Branching, DrawnFlights, PlannedPath, Problem, draw_flights
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.seeds import unspawned

TRUNK = -1  # the branch of a flight that takes no fix: the plan goes on
LEVELS = 2  # fixes, one after another, at which a plan can branch
BLOCK = 1000  # flights that are drawn together: their winds fill the memory


@dataclass(frozen=True, slots=True)
class TreeFlights:
    """Flights in drawn winds, with the draws of the errors of their fixes.

    Attributes
    ----------
    noise : (n, LEVELS, 2) float
        Standard normal draws of the errors of the measured positions, at each fix.
    luck : (n, LEVELS) float
        Uniform draws; a fix can be taken if its draw is below its probability.
    change : (S, n, 2) float or None
        What each flight adds to its control at each step [m/s], to fly off deviations measured before; None:
        nothing.
    """

    flights: DrawnFlights
    noise: FloatArray
    luck: FloatArray
    change: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.flights)

    @classmethod
    def drawn(cls, problem: Problem, runs: int, seed: SeedSequence) -> TreeFlights:
        """``runs`` flights in the winds of the law of ``problem``."""
        winds, fixes = unspawned(seed).spawn(2)
        rng = np.random.default_rng(fixes)
        pairs = [(rng.standard_normal((runs, 2)), rng.random(runs)) for _ in range(LEVELS)]
        noise, luck = (np.stack(part, axis=1) for part in zip(*pairs, strict=True))
        return cls(draw_flights(problem, problem.fidelity.law, runs, winds), noise, luck)

    def only(self, rows: IntArray) -> TreeFlights:
        """The flights ``rows``, ascending."""
        change = None if self.change is None else np.ascontiguousarray(self.change[:, rows])
        return TreeFlights(self.flights.only(rows), self.noise[rows], self.luck[rows], change)

    def flown(self, u: FloatArray) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls ``u`` (T, 2), without a further fix."""
        if self.change is not None:
            return self.flights.rejoining(u, self.change)
        return self.flights.flown(u, np.zeros((len(u) + 1, 2)))

    def after(self, fix: BranchFix, y: FloatArray, taken: BoolArray) -> TreeFlights:
        """These flights after ``fix``, which those ``taken`` (n,) take at the measured ``y`` (n, 2) [m].

        They fly off their distance from the planned position, and against further drift, instead of what
        they measured before. Flights that do not take the fix go on.
        """
        if fix.rejoin == 0 and self.change is None:
            return self
        problem = self.flights.problem
        change = np.zeros((problem.horizon, len(self), 2)) if self.change is None else self.change.copy()
        first, later = (part @ problem.motion.b_inv.T for part in fix.changes(y[taken], problem.motion.dt))
        change[fix.step : fix.step + fix.rejoin, taken] = first
        change[fix.step + fix.rejoin :, taken] = later
        return replace(self, change=change)

    def measured(self, fix: BranchFix, x: FloatArray, level: int = 0) -> tuple[FloatArray, BoolArray]:
        """Measured positions (n, 2) [m] of flights at ``x`` (n, 2), and which of them are taken.

        ``level`` is the number of fixes before.
        """
        return x + fix.sd * self.noise[:, level], fix.inside(x) & (self.luck[:, level] < fix.available)

    def measured_along(self, u: FloatArray, fix: BranchFix, level: int = 0) -> tuple[FloatArray, BoolArray]:
        """:meth:`measured` of flights that fly the controls ``u`` (T, 2) to the fix."""
        return self.measured(fix, self.flown(np.ascontiguousarray(u[: fix.step]))[:, -1], level)

    def failed(self, u: FloatArray) -> BoolArray:
        """Which flights of the controls ``u`` (T, 2) fail."""
        return self.flights.failed(self.flown(u))


def whole_controls(trunk: FloatArray, step: int, rest: FloatArray) -> FloatArray:
    """The controls of the plan up to ``step``, then ``rest``."""
    return np.ascontiguousarray(np.vstack([trunk[:step], rest]))


def fly_rests(
    winds: TreeFlights, trunk: FloatArray, step: int, rests: Sequence[FloatArray], branch: IntArray
) -> BoolArray:
    """Which flights (n,) fail if each flies the rest of its ``branch``, or ``TRUNK``.

    ``winds`` are flights after the fix (:meth:`TreeFlights.after`).
    """
    failed = np.zeros(len(winds), bool)
    for number, rest in ((TRUNK, trunk[step:]), *enumerate(rests)):
        rows = np.flatnonzero(branch == number)
        if len(rows):
            failed[rows] = winds.only(rows).failed(whole_controls(trunk, step, rest))
    return failed


@dataclass(frozen=True, slots=True)
class TreeOutcome:
    """Flights of a tree.

    Attributes
    ----------
    branch : (n, LEVELS) int
        The branch that each flight takes at each fix, ``TRUNK`` if it takes none.
    failed : (n,) bool
        Which flights fail with all branches.
    before : (n, LEVELS) bool
        Which fail without the first fix and all later ones, and without the second one.
    """

    branch: IntArray
    failed: BoolArray
    before: BoolArray

    def rows(self, path: Sequence[int]) -> IntArray:
        """The flights that take the branches ``path``, one at each fix."""
        held = np.ones(len(self.failed), bool)
        for level, number in enumerate(path):
            held &= self.branch[:, level] == number
        return np.flatnonzero(held)


def fly_branches(winds: TreeFlights, u: FloatArray, tree: Branching, level: int = 0) -> TreeOutcome:
    """Fly the controls ``u`` (T, 2), and at each fix the branch that the measured position selects."""
    branch = np.full((len(winds), LEVELS), TRUNK)
    alone = winds.failed(u)
    failed, before = alone.copy(), np.repeat(alone[:, None], LEVELS, axis=1)
    fix = tree.fix
    y, taken = winds.measured_along(u, fix, level)
    branch[:, level] = np.where(taken, tree.chosen(y), TRUNK)
    winds = winds.after(fix, y, taken)
    for number, one in enumerate(tree.branches):
        rows = np.flatnonzero(branch[:, level] == number)
        if not len(rows):
            continue
        own, whole = winds.only(rows), whole_controls(u, fix.step, one.path.u)
        if one.then is None:
            failed[rows] = own.failed(whole)
            before[rows, level + 1 :] = failed[rows, None]
            continue
        later = fly_branches(own, whole, one.then, level + 1)
        failed[rows] = later.failed
        branch[rows, level + 1 :] = later.branch[:, level + 1 :]
        before[rows, level + 1 :] = later.before[:, level + 1 :]
    return TreeOutcome(branch, failed, before)


def fly_tree(
    problem: Problem, trunk: PlannedPath, branching: Branching, runs: int, seed: SeedSequence
) -> TreeOutcome:
    """Fly a plan with its branches, and without, ``runs`` times in the same winds."""
    blocks = [min(BLOCK, runs - first) for first in range(0, runs, BLOCK)]
    parts = [
        fly_branches(TreeFlights.drawn(problem, size, child), trunk.u, branching)
        for size, child in zip(blocks, unspawned(seed).spawn(len(blocks)), strict=True)
    ]
    return TreeOutcome(
        np.concatenate([part.branch for part in parts]),
        np.concatenate([part.failed for part in parts]),
        np.concatenate([part.before for part in parts]),
    )
