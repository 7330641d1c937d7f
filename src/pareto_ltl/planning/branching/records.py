"""The records of a plan that branches: the fix, its cells, and the rest of the plan of each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pareto_ltl.planning.branching.cells import Cell
from pareto_ltl.planning.rates import FailureRate
from pareto_ltl.planning.records import BY_STEP, Plan, PlannedPath
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.world.cells import inside_depth
from pareto_ltl.world.projection import Navigation

TRUNK = -1  # the branch of a flight that takes no fix: the plan goes on
NAMES = "ABCD"  # of the branches, in order


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
    """

    step: int
    place: FloatArray
    ahead: FloatArray
    sd: float
    available: float = 1.0
    landmark: FloatArray | None = None

    @property
    def axes(self) -> FloatArray:
        """Rows: the directions along the track and to its left, (2, 2)."""
        east, north = self.ahead
        return np.array([[east, north], [-north, east]])

    def distances(self, y: FloatArray) -> FloatArray:
        """Distances along and left (n, 2) [m] of the positions ``y`` (n, 2) [m]."""
        return np.asarray((y - self.place) @ self.axes.T, float)

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
        Failure of the flights that fly this branch.
    navigation : Navigation
        ``path`` in the terms of navigation.
    """

    name: str
    cell: Cell
    share: float
    path: PlannedPath
    rate: FailureRate
    navigation: Navigation


@dataclass(frozen=True, slots=True)
class TreeRow:
    """A row of the front of trees: ``leaves`` branches, 1 for none, its failure and expected length [m]."""

    leaves: int
    rate: FailureRate
    length: float


@dataclass(frozen=True, slots=True)
class Branching:
    """What a plan does after a fix.

    Attributes
    ----------
    rate : FailureRate
        Failure of fresh flights of the whole plan with its branches.
    alone : FailureRate
        Failure of the same flights without a fix: the plan alone.
    difference : (float, float, float)
        ``rate`` less ``alone``, and the ends of its 95 % interval by pairs.
    length : float
        Expected length of the planned paths, weighed by how often each is flown [m].
    point : int
        Number of the plan in ``front.csv``: it may be another path than the one that is best alone.
    front : tuple of TreeRow
        What each number of branches was found to give, in the same flights, fewest branches first.
    """

    fix: BranchFix
    branches: tuple[Branch, ...]
    rate: FailureRate
    alone: FailureRate
    difference: tuple[float, float, float]
    length: float
    point: int = 0
    front: tuple[TreeRow, ...] = ()

    def __post_init__(self) -> None:
        if not 2 <= len(self.branches) <= len(NAMES):
            raise ValueError(f"a fix has 2 to {len(NAMES)} branches, got {len(self.branches)}")

    def chosen(self, y: FloatArray) -> IntArray:
        """The number of the branch for each measured position ``y`` (n, 2) [m]."""
        return cells_of(tuple(branch.cell for branch in self.branches), self.fix.distances(y))


def cells_of(cells: tuple[Cell, ...], distances: FloatArray) -> IntArray:
    """The number of the cell that holds each of ``distances`` (n, 2) [m]; the cells cover the plane."""
    held = np.stack([cell.holds(distances) for cell in cells])
    if not (held.sum(axis=0) == 1).all():
        raise ValueError("the cells do not divide the plane: a position lies in none of them, or in two")
    return np.asarray(held.argmax(axis=0), np.int64)


def plan_on_branch(plan: Plan, branch: Branch) -> Plan:
    """``plan`` up to its fix, then ``branch``: its promise is the rate of the flights that fly the branch."""
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
    return replace(plan, path=path, promise=promise, branching=None, limits=None, prices=(), navigation=log)
