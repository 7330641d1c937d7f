"""The records of a plan that branches: the fix, its cells, and the rest of the plan of each.

A branch may branch again at a second fix, so that a plan with branches is a tree of at most two levels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from flight_quantities.frames import Navigation
from pareto_ltl.planning.branching.cells import Cell
from pareto_ltl.planning.rates import FailureRate
from pareto_ltl.planning.records import BY_STEP, Plan, PlannedPath
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.world.cells import inside_depth


@dataclass(frozen=True, slots=True)
class BranchFix:
    """The position fix at which a plan branches.

    Attributes
    ----------
    step : int
        Step of the plan at which the robot measures its position.
    place : (2,) float
        Planned position there [m].
    ahead : (2,) float
        Unit vector along the planned track there: from the step before.
    sd : float
        Standard deviation of the measurement in each direction [m].
    available : float
        Probability that the fix can be taken; without it the plan goes on.
    landmark : (n, 2) float or None
        Convex outline [m] of the landmark outside of which no fix can be taken; None: anywhere.
    rejoin : int
        Number n of steps from the fix on in which the robot flies off its distance from ``place``: it adds
        -(y - place) / (n dt) to each air velocity of its branch, within its airspeeds; 0: it does not.
    counter : float
        Rate [1/s] at which it then goes on against the drift that the distance tells of: it adds
        -counter (y - place) to every air velocity from the fix to the next one, or to the end.
    """

    step: int
    place: FloatArray
    ahead: FloatArray
    sd: float
    available: float = 1.0
    landmark: FloatArray | None = None
    rejoin: int = 0
    counter: float = 0.0

    @property
    def axes(self) -> FloatArray:
        """Rows: the directions along the track and to its left, (2, 2)."""
        east, north = self.ahead
        return np.array([[east, north], [-north, east]])

    def distances(self, y: FloatArray) -> FloatArray:
        """Distances along and left (n, 2) [m] of the positions ``y`` (n, 2) [m]."""
        return np.asarray((y - self.place) @ self.axes.T, float)

    def changes(self, y: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
        """What robots at the measured ``y`` (..., 2) [m] add to their velocities, two times (..., 2) [m/s].

        For ``rejoin`` steps of ``dt`` [s], and in all later ones; 0 if they fly nothing off.
        """
        back = np.asarray(self.place - y, float)
        later = self.counter * back
        return (back / (self.rejoin * dt) + later if self.rejoin else later), later

    def inside(self, x: FloatArray) -> BoolArray:
        """Which robots at ``x`` (n, 2) [m] are where a fix can be taken."""
        if self.landmark is None:
            return np.ones(len(x), bool)
        return inside_depth(self.landmark, x) >= 0.0


@dataclass(frozen=True, slots=True)
class Branch:
    """One cell of a fix and the rest of the plan from there.

    Attributes
    ----------
    cell : Cell
    share : float
        Probability of the cell, of flights that take the fix.
    path : PlannedPath
        From the step of the fix on: times since departure; ``x`` and ``cov`` belong to flights in the
        cell; the controls are what the robot flies.
    rate : FailureRate
        Failure of the flights that fly this branch, with its own branches.
    navigation : Navigation
        ``path`` in the terms of navigation.
    then : Branching or None
        What to fly after a second fix; None: the branch is flown to its end.
    """

    name: str
    cell: Cell
    share: float
    path: PlannedPath
    rate: FailureRate
    navigation: Navigation
    then: Branching | None = None


@dataclass(frozen=True, slots=True)
class TreeRow:
    """A row of the front of trees: ``leaves`` tables to end on, failure and expected length [m].

    ``fixes`` are the fixes that a flight can take: 0 for the plan without branches.
    """

    leaves: int
    rate: FailureRate
    length: float
    fixes: int = 1


@dataclass(frozen=True, slots=True)
class Branching:
    """What a plan, or a branch, does after a fix.

    Attributes
    ----------
    rate : FailureRate
        Failure of fresh flights of the whole plan with its branches; of a branch, of those that fly it.
    alone : FailureRate
        Failure of the same flights without this fix and later ones.
    difference : (float, float, float)
        ``rate`` less ``alone``, and the ends of its 95 % interval by pairs.
    length : float
        Expected length of the planned paths, weighed by how often each is flown [m].
    point : int
        Number of the plan in ``front.csv``: it may be another path than the one that is best alone.
    front : tuple of TreeRow
        What each number of branches was found to give, in the same flights, fewest branches first; empty
        for the branches of a branch.
    bent : (float, float, float) or None
        Failure with branches less the one of path ``point`` with its branches, and the ends of its 95 %
        interval by pairs, if the plan is that path bent for its branches.
    """

    NAMES: ClassVar[str] = "ABCD"  # of the branches of a plan, in order; branch A goes on as A1, A2, ...
    fix: BranchFix
    branches: tuple[Branch, ...]
    rate: FailureRate
    alone: FailureRate
    difference: tuple[float, float, float]
    length: float
    point: int = 0
    front: tuple[TreeRow, ...] = ()
    bent: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        least = 1 if self.fix.rejoin else 2
        if not least <= len(self.branches) <= len(self.NAMES):
            raise ValueError(f"a fix has {least} to {len(self.NAMES)} branches, got {len(self.branches)}")

    def chosen(self, y: FloatArray) -> IntArray:
        """The number of the branch for each measured position ``y`` (n, 2) [m]."""
        return cells_of(tuple(branch.cell for branch in self.branches), self.fix.distances(y))

    @property
    def fixes(self) -> int:
        """The largest number of fixes that a flight takes."""
        return 1 + max(0 if one.then is None else one.then.fixes for one in self.branches)

    def all_branches(self) -> Iterator[tuple[Branching, Branch]]:
        """Every branch with the tree that it belongs to: A, A1, A2, B, ..."""
        for branch in self.branches:
            yield self, branch
            if branch.then is not None:
                yield from branch.then.all_branches()

    def ends(self) -> Iterator[Branch]:
        """The branches that are flown to their ends if every fix is taken."""
        return (branch for _, branch in self.all_branches() if branch.then is None)


def cells_of(cells: tuple[Cell, ...], distances: FloatArray) -> IntArray:
    """The number of the cell that holds each of ``distances`` (n, 2) [m]; the cells cover the plane."""
    held = np.stack([cell.holds(distances) for cell in cells])
    if not (held.sum(axis=0) == 1).all():
        raise ValueError("the cells do not divide the plane: a position lies in none of them, or in two")
    return np.asarray(held.argmax(axis=0), np.int64)


def plan_on_branch(plan: Plan, branch: Branch) -> Plan:
    """``plan`` up to its fix, then ``branch``, which may branch again.

    Its promise is the rate of the flights that fly the branch.
    """
    assert plan.branching is not None
    step, log = plan.branching.fix.step, plan.navigation

    def joined(one: Any, other: Any, name: str) -> Any:
        first, then = getattr(one, name), getattr(other, name)
        if first is None or then is None:
            return None
        return (*first[:step], *then) if isinstance(first, tuple) else np.concatenate([first[:step], then])

    trunk, rest = plan.path, branch.path
    path = replace(
        trunk, **{name: joined(trunk, rest, name) for name in BY_STEP},
        origin=rest.origin, order=rest.order,
    )  # fmt: skip
    if log is not None:
        names = ("airspeed", "time_utc", "lat", "lon", "heading_true")
        log = replace(log, **{name: joined(log, branch.navigation, name) for name in names})
    promise = None if plan.promise is None else replace(plan.promise, rate=branch.rate)
    return replace(
        plan, path=path, promise=promise, branching=branch.then, limits=None, prices=(), navigation=log
    )  # fmt: skip


def plans_on_branches(plan: Plan) -> Iterator[tuple[Plan, Branch, Plan]]:
    """For every branch, in the order of its names: the plan that branches, the branch, the plan on it."""
    if plan.branching is None:
        return
    for branch in plan.branching.branches:
        on_it = plan_on_branch(plan, branch)
        yield plan, branch, on_it
        yield from plans_on_branches(on_it)
