"""The search for a tree: which fix, which cells, which rest of the plan in each (docs/branching.md).

For a trunk and a fix, rests of the flight are searched for in four quadrants around the planned position. All
rests, the rest of the trunk among them, are then flown by all flights, so that any division of the plane into
cells is judged by a table: which flights fail with which rest. Cells and rests are chosen from it; the rests
are searched for again in the chosen cells, and the cells are drawn again. Flights of the choice are none of
those that rests are fitted to; flights of the promise are neither.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.planning.branching.belief import (
    course_in_cell,
    learnt_in_cell,
    measured_moments,
    prior_at,
)
from pareto_ltl.planning.branching.cells import EVERYWHERE, Cell, Ends, Moments
from pareto_ltl.planning.branching.records import (
    NAMES,
    TRUNK,
    Branch,
    BranchFix,
    Branching,
    TreeRow,
    cells_of,
)
from pareto_ltl.planning.evaluate import mission_order_text, propagate_controls
from pareto_ltl.planning.problem import Problem, unaided
from pareto_ltl.planning.rates import FailureRate
from pareto_ltl.planning.records import Objectives, PlannedPath
from pareto_ltl.planning.refine import sampled_paths
from pareto_ltl.planning.refine.separation import allowed_risk, separation
from pareto_ltl.planning.selection_rules import SMALL
from pareto_ltl.run.branching.rest_problem import World, rest_of_flight
from pareto_ltl.simulation.tree_flights import TreeFlights, fly_tree, whole_controls
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray, length_of, square_matrices
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import DataError, InfeasibleError

LOG = logging.getLogger(__name__)
FITTED, JUDGED = 4000, 8000  # flights that rests are fitted to, and flights by which trees are chosen
LEAST_FLIGHTS = 50  # of a cell: fewer say nothing
RESTS = 6  # rests retained of a cell
PLACES = 9  # at which a line is tried, from the 10th to the 90th percentile
ROUNDS = 2  # in which rests are searched for again in the cells that were drawn
SOME = 0.05  # share of the flights of a cell in an automaton state for which a rest is searched for
QUADRANTS = tuple(
    Cell(along, left)
    for along in ((0.0, math.inf), (-math.inf, 0.0))
    for left in ((0.0, math.inf), (-math.inf, 0.0))
)


@dataclass(frozen=True, slots=True)
class Table:
    """What every flight that takes the fix would do with every rest.

    Attributes
    ----------
    y : (n, 2) float
        Distances along and left of the measured positions [m].
    taken : (n,) bool
        Flights that take the fix; the others fly the trunk.
    failed : (n, R) bool
        Whether flight i fails with rest r; rest 0 is the rest of the trunk.
    length : (R,) float
        Length of the whole plan with each rest [m].
    """

    y: FloatArray
    taken: BoolArray
    failed: BoolArray
    length: FloatArray


@dataclass(frozen=True, slots=True)
class Division:
    """Cells, the rest of each, and what the tree then has: failure and expected length [m]."""

    cells: tuple[Cell, ...]
    rests: tuple[int, ...]
    failed: BoolArray
    length: float

    @property
    def failure(self) -> float:
        """Share of the flights that fail."""
        return float(self.failed.mean())


@dataclass(frozen=True, slots=True)
class Tree:
    """A trunk, a fix, and the best division for each number of branches, one being the trunk alone.

    ``single`` is the best rest for all flights that take the fix: what a fix that says nothing would give.
    """

    trunk: PlannedPath
    fix: BranchFix
    rests: tuple[FloatArray, ...]
    divisions: tuple[Division, ...]
    table: Table
    single: Division
    point: int = 0


@dataclass(frozen=True, slots=True)
class Grower:
    """What the search of all trees shares: flights to fit rests to, flights to choose by, the preference."""

    world: World
    fitted: TreeFlights
    judged: TreeFlights
    leaves: int

    @classmethod
    def of(cls, world: World, seeds: SeedSequence) -> Grower:
        """Draws the flights."""
        fit, judge = seeds.spawn(2)
        problem = world.problem
        return cls(
            world, TreeFlights.drawn(problem, FITTED, fit), TreeFlights.drawn(problem, JUDGED, judge),
            world.settings.branch.leaves,
        )  # fmt: skip

    @property
    def problem(self) -> Problem:
        """The problem of the whole flight, without fixes."""
        return self.world.problem

    @property
    def saving(self) -> float:
        """Per cent of the failures that a per cent of length must save, whatever rule chose the plan."""
        return self.world.settings.selection.saving

    def score(self, failure: float, length: float) -> float:
        """What is minimised, as the rule ``worth`` does: log(p + SMALL) + s log(l)."""
        return math.log(failure + SMALL) + self.saving * math.log(length)

    # --- one tree ---

    def begun(self, trunk: PlannedPath, fix: BranchFix) -> Tree:
        """The best trees with rests that were searched for around the planned position."""
        rests: list[FloatArray] = [trunk.u[fix.step :]]
        for cell in QUADRANTS if self.leaves > 2 else _halves():
            rests += self.rests_in(trunk, fix, cell)
        return self.tree(trunk, fix, rests, self.table(trunk, fix, rests))

    def grown(self, tree: Tree) -> Tree:
        """``tree`` with rests that were searched for again in its cells, and with cells drawn again."""
        for _ in range(ROUNDS):
            more = [u for cell in tree.divisions[-1].cells for u in self.rests_in(tree.trunk, tree.fix, cell)]
            if not more:
                break
            table = self.with_rests(tree.table, tree.trunk, tree.fix, more)
            tree = replace(self.tree(tree.trunk, tree.fix, [*tree.rests, *more], table), point=tree.point)
        return tree

    def tree(self, trunk: PlannedPath, fix: BranchFix, rests: Sequence[FloatArray], table: Table) -> Tree:
        """The best division for each number of branches."""
        divisions = tuple(self.divided(table, number) for number in range(1, self.leaves + 1))
        return Tree(trunk, fix, tuple(rests), divisions, table, self.of_cells(table, (Cell(),)))

    def best_score(self, tree: Tree) -> float:
        """The best score of ``tree`` with any number of branches."""
        return min(self.score(one.failure, one.length) for one in tree.divisions)

    def rests_in(self, trunk: PlannedPath, fix: BranchFix, cell: Cell) -> list[FloatArray]:
        """Controls of rests that few of the flights in ``cell`` fail with."""
        winds, k = self.fitted, fix.step
        x = winds.flown(np.ascontiguousarray(trunk.u[:k]))
        y, taken = winds.measured(fix, x[:, -1])
        rows = np.flatnonzero(taken & cell.holds(fix.distances(y)))
        if len(rows) < LEAST_FLIGHTS:
            return []
        try:
            told = measured_moments(fix, cell, trunk.cov[k])
        except ValueError:
            return []
        learnt = learnt_in_cell(prior_at(self.problem, fix, trunk.x), told, fix.sd)
        state = np.array([self.problem.states(flight)[-1] for flight in x[rows]])
        found: list[tuple[float, FloatArray]] = []
        for q in self.open_states(state):
            own = rows[state == q]
            try:
                rest = rest_of_flight(self.world, learnt, k, q)
                flights = rest.flights(winds.flights.only(own), x[own, -1])
                paths = sampled_paths(self.world.settings.refine.coarse(), rest.problem, None, flights)
            except (InfeasibleError, DataError) as error:
                LOG.info("no rest of the flight %s: %s", cell.words, error)
                continue
            found += [(self.worth_of(winds.only(rows), trunk, k, path.u), path.u) for path in paths]
        found.sort(key=lambda pair: pair[0])
        return [u for _, u in found[:RESTS] if self.can_be_flown(trunk, fix, told, u)]

    def worth_of(self, winds: TreeFlights, trunk: PlannedPath, step: int, rest: FloatArray) -> float:
        """The score of one rest for the flights of a cell."""
        u = whole_controls(trunk.u, step, rest)
        length = length_of(expected_means(self.problem, u))
        return self.score(float(winds.failed(u).mean()), length)

    def open_states(self, state: IntArray) -> list[int]:
        """The automaton states of a cell that have more than ``SOME`` of its flights and are not lost."""
        q, count = np.unique(state, return_counts=True)
        distance = self.problem.logic.distance[q]
        able = (count >= max(SOME * len(state), LEAST_FLIGHTS)) & np.isfinite(distance) & (distance > 0.0)
        return [int(one) for one in q[able][np.argsort(-count[able])]]

    def can_be_flown(self, trunk: PlannedPath, fix: BranchFix, told: Moments, rest: FloatArray) -> bool:
        """Whether the flights of a cell keep epsilon in each segment of ``rest``, within the energy."""
        u, energy = whole_controls(trunk.u, fix.step, rest), self.problem.energy
        capacity = math.inf if energy is None or energy.capacity is None else energy.capacity
        if energy is not None and energy.of(u, self.problem.motion.dt) > capacity:
            return False
        risk = segment_risks(self.problem, expected_means(self.problem, u), fix, told)
        return bool((risk[fix.step :] <= allowed_risk(self.problem) * (1.0 + 1e-6)).all())

    # --- the table ---

    def table(self, trunk: PlannedPath, fix: BranchFix, rests: Sequence[FloatArray]) -> Table:
        """Which of the flights of the choice fail with which of ``rests``."""
        winds, k = self.judged, fix.step
        at = winds.flown(np.ascontiguousarray(trunk.u[:k]))[:, -1]
        y, taken = winds.measured(fix, at)
        empty = Table(fix.distances(y), taken, np.zeros((len(winds), 0), bool), np.zeros(0))
        return self.with_rests(empty, trunk, fix, rests)

    def with_rests(
        self, table: Table, trunk: PlannedPath, fix: BranchFix, rests: Sequence[FloatArray]
    ) -> Table:
        """``table`` with further columns."""
        controls = [whole_controls(trunk.u, fix.step, rest) for rest in rests]
        failed = np.stack([self.judged.failed(u) for u in controls], axis=1)
        length = np.array([length_of(expected_means(self.problem, u)) for u in controls])
        return replace(
            table, failed=np.hstack([table.failed, failed]), length=np.append(table.length, length)
        )

    def divided(self, table: Table, leaves: int) -> Division:
        """The best division into ``leaves`` cells; into one: the trunk alone."""
        if leaves == 1:
            return self.of_cells(table, (Cell(),), only=1)
        found = [self.of_cells(table, cells) for cells in divisions(table.y[table.taken], leaves)]
        return min(found, key=lambda one: self.score(one.failure, one.length))

    def of_cells(self, table: Table, cells: tuple[Cell, ...], only: int | None = None) -> Division:
        """The best rest, of the first ``only``, in each of ``cells``."""
        trunk = table.failed[:, 0]
        p, L = float(trunk.mean()), float(table.length[0])
        price = self.saving * (p + SMALL) / L  # [1/m] of failure rate, at the trunk
        number = np.where(table.taken, cells_of(cells, table.y), TRUNK)
        rests, failed = [], trunk.copy()
        length = np.full(len(trunk), L)
        for k in range(len(cells)):
            rows = number == k
            cost = table.failed[rows, :only].mean(axis=0) + price * table.length[:only] if rows.any() else [0]
            best = int(np.argmin(cost))
            rests.append(best)
            failed[rows], length[rows] = table.failed[rows, best], table.length[best]
        return Division(cells, tuple(rests), failed, float(length.mean()))


def expected_means(problem: Problem, u: FloatArray) -> FloatArray:
    """Expected positions (T+1, 2) [m] of the controls ``u`` (T, 2) [m/s], without a fix."""
    return propagate_controls(problem, u, unaided(problem.world.law)).x


def segment_risks(problem: Problem, x: FloatArray, fix: BranchFix, told: Moments) -> FloatArray:
    """The probability of a collision in each segment (T,) of the flights in a cell."""
    return np.asarray(separation(problem, course_in_cell(problem, x, fix, told)).risk, float)


def mixed_risk(problem: Problem, tree: Tree, number: int) -> FloatArray:
    """Probability of a collision in each segment from the fix on, of the flights of all branches together.

    Branches have unlike numbers of steps; what has ended collides no more. Flights without a fix are left
    out: the trunk keeps ``planner.epsilon`` by itself.
    """
    division, fix, k = tree.divisions[number - 1], tree.fix, tree.fix.step
    total = np.zeros(max(len(u) for u in tree.rests))
    for cell, rest in zip(division.cells, division.rests, strict=True):
        told = measured_moments(fix, cell, tree.trunk.cov[k])
        u = whole_controls(tree.trunk.u, k, tree.rests[rest])
        risk = segment_risks(problem, expected_means(problem, u), fix, told)[k:]
        total[: len(risk)] += told.share * risk
    return total


def _halves() -> tuple[Cell, ...]:
    """Left, right, ahead and behind."""
    up, down = (0.0, math.inf), (-math.inf, 0.0)
    return Cell(left=up), Cell(left=down), Cell(along=up), Cell(along=down)


def divisions(y: FloatArray, leaves: int) -> Iterator[tuple[Cell, ...]]:
    """Divisions of the plane into ``leaves`` cells by lines along the track and across it.

    Parallel bands, a half of bands beside an undivided half, and for four cells the four quadrants of two
    lines. Lines are tried at percentiles of the distances ``y`` (n, 2) [m], rounded so that a person can
    apply them.
    """
    places = [rounded_places(y[:, i]) for i in (0, 1)]
    for i in (0, 1):
        for cuts in combinations(places[i], leaves - 1):
            yield tuple(_cell(i, ends) for ends in _bands(cuts))
        if leaves == 3:
            for first in places[i]:
                low, high = _bands((first,))
                for second in places[1 - i]:
                    halves = _bands((second,))
                    yield (_cell(i, low), *(_cell(i, high, own) for own in halves))
                    yield (*(_cell(i, low, own) for own in halves), _cell(i, high))
    if leaves == 4:
        for first in places[0]:
            for second in places[1]:
                yield tuple(Cell(along, left) for along in _bands((first,)) for left in _bands((second,)))


def _cell(i: int, ends: Ends, other: Ends = EVERYWHERE) -> Cell:
    """The cell with ``ends`` in distance i (0 along the track, 1 to its left), ``other`` in the other."""
    return Cell(ends, other) if i == 0 else Cell(other, ends)


def _bands(cuts: Sequence[float]) -> list[Ends]:
    """The intervals between ``cuts``."""
    ends = [-math.inf, *cuts, math.inf]
    return list(pairwise(ends))


def rounded_places(distance: FloatArray) -> list[float]:
    """Distances [m] at which a line is tried: 0, and percentiles of ``distance`` in round numbers."""
    sd = float(distance.std())
    unit = 10.0 ** math.floor(math.log10(max(sd, 1e-9))) / 2.0  # half of a power of ten: at least sd / 20
    at = np.quantile(distance, np.linspace(0.1, 0.9, PLACES))
    return sorted({0.0, *(float(unit * round(place / unit)) for place in at)})


# --- from a tree to a plan ------------------------------------------------------------------------


def branching_of(
    problem: Problem, tree: Tree, number: int, runs: int, seeds: SeedSequence, front: Sequence[TreeRow]
) -> tuple[Branching, bool]:
    """The tree with ``number`` branches as a record, promised by ``runs`` fresh flights; whether it pays."""
    division, fix, trunk = tree.divisions[number - 1], tree.fix, tree.trunk
    law = problem.fidelity.law
    told = [measured_moments(fix, cell, trunk.cov[fix.step]) for cell in division.cells]
    unknown = FailureRate(law, 0.0, 0.0, 1.0, 1)
    frame, paths = problem.scene.frame, []
    for rest, moments in zip(division.rests, told, strict=True):
        paths.append(branch_path(problem, tree, rest, moments))
    branches = tuple(
        Branch(NAMES[k], cell, moments.share, path, unknown, frame.navigation(path.t, path.x, path.u))
        for k, (cell, moments, path) in enumerate(zip(division.cells, told, paths, strict=True))
    )
    draft = Branching(fix, branches, unknown, unknown, (0.0, 0.0, 0.0), 0.0)
    flown = fly_tree(problem, trunk, draft, runs, seeds)

    def rate(failed: BoolArray) -> FailureRate:
        return FailureRate.counted(law, int(failed.sum()), max(len(failed), 1))

    own = [flown.failed[flown.branch == k] for k in range(len(branches))]
    branches = tuple(replace(one, rate=rate(failed)) for one, failed in zip(branches, own, strict=True))
    taken = float((flown.branch != TRUNK).mean())
    begun = length_of(trunk.x[: fix.step + 1])
    length = (1.0 - taken) * length_of(trunk.x) + taken * sum(
        one.share * (begun + length_of(one.path.x)) for one in branches
    )
    made = Branching(
        fix, branches, rate(flown.failed), rate(flown.alone), paired_difference(flown.alone, flown.failed),
        float(length), tree.point, tuple(front),
    )  # fmt: skip
    return made, made.difference[2] < 0.0


def branch_path(problem: Problem, tree: Tree, rest: int, told: Moments) -> PlannedPath:
    """The rest number ``rest`` as a path: means and covariances of the flights in the cell."""
    k, trunk = tree.fix.step, tree.trunk
    u = whole_controls(trunk.u, k, tree.rests[rest])
    course = course_in_cell(problem, expected_means(problem, u), tree.fix, told)
    x, cov = course.x[k:], square_matrices(course.cov)[k:]
    q, cell = states_from(problem, int(trunk.q[k]), x, k)
    unknown = math.nan
    return PlannedPath(
        t=problem.motion.dt * np.arange(k, k + len(x), dtype=float),
        x=x,
        cov=cov,
        q=q,
        label=tuple(problem.decomposition.labels[c] if c >= 0 else frozenset() for c in cell.tolist()),
        u=tree.rests[rest],
        objectives=Objectives(problem.costs_of(x, tree.rests[rest]), unknown, unknown, unknown, unknown),
        origin="the rest of the plan" if rest == 0 else f"rest {rest} of the branches",
        order=mission_order_text(problem, q, cell),
    )


def states_from(problem: Problem, state: int, x: FloatArray, step: int) -> tuple[IntArray, IntArray]:
    """Automaton states and cells (n,) of positions ``x`` (n, 2), read from ``step`` on, from ``state``."""
    cell = problem.locate(x)
    logic, q = problem.logic, [state]
    for t in range(1, len(x)):
        epoch = int(logic.epoch[min(step + t, len(logic.epoch) - 1)])
        q.append(int(logic.delta[epoch, q[-1], cell[t]]))
    return np.array(q, np.int64), cell
