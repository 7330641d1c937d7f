"""The search for a tree: which fix, which cells, which rest of the plan in each (docs/branching.md).

A stem is a trunk, or a branch that may branch again. For a stem and a fix, rests of the flight are searched
for in four quadrants around the planned position. All rests, the rest of the stem among them, are then flown
by all flights, so that any division of the plane into cells is judged by a table: which flights fail with
which rest. Cells and rests are chosen from it; the rests are searched for again in the chosen cells, and the
cells are drawn again. Flights of the choice are none of those that rests are fitted to; flights of the
promise are neither.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl import Run
from pareto_ltl.extend import (
    BranchFix,
    Cell,
    PlannedPath,
    Problem,
    SelectionConfig,
    cells_of,
    evaluate,
    search_paths,
)
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray, length_of
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl_apps.branching.belief import Course, Passed, learnt_in_cell, noise_of, prior_at
from pareto_ltl_apps.branching.moments import EVERYWHERE, Ends, Moments
from pareto_ltl_apps.branching.rest_problem import Countered, rest_of_flight
from pareto_ltl_apps.branching.settings import BranchConfig
from pareto_ltl_apps.branching.tree_flights import TRUNK, TreeFlights, whole_controls
from pareto_ltl_apps.conditioning import Learnt

LOG = logging.getLogger("pareto_ltl.branching.tree_search")
SMALL = SelectionConfig.SMALL  # failure rate below which a lower one is worth little length
FITTED, JUDGED = 4000, 8000  # flights that rests are fitted to, and flights by which trees are chosen
SURE = 2.0  # standard errors by which a tree on another path of the front must be better
LEAST_FLIGHTS = 50  # of a cell: fewer say nothing
RESTS = 6  # rests retained of a cell
PLACES = 9  # at which a line is tried, from the 10th to the 90th percentile
ROUNDS = 2  # in which rests are searched for again in the cells that were drawn
LATER_ROUNDS = 1  # the same, of a second fix
SELDOM = 1e-3  # share of all flights: for a cell in which fewer fail no rest is searched for again
SOME = 0.05  # share of the flights of a cell in an automaton state for which a rest is searched for
REJOINED = (0.1, 0.3, 0.6)  # shares of the rest that are tried for flying off a deviation
COUNTERED = (0.3, 0.6, 1.0)  # of the mean drift since the last fix, that are tried to be countered
RESERVED = 0.9  # of the velocities that are added, for which rests retain airspeed
SLOWER = (1.1, 1.25, 1.4)  # times as many steps, tried for rests: a reserve of airspeed to fly deviations off
QUADRANTS = tuple(
    Cell(along, left)
    for along in ((0.0, math.inf), (-math.inf, 0.0))
    for left in ((0.0, math.inf), (-math.inf, 0.0))
)


@dataclass(frozen=True, slots=True)
class Stem:
    """What is flown up to a fix, and on without it.

    Attributes
    ----------
    u : (T, 2) float
        Controls, from the departure on [m/s].
    means : (T+1, 2) float
        Expected positions [m] of all flights of these controls, without a fix.
    x : (T+1, 2) float
        The same of the flights in the cells that were passed, from the last one on.
    q : (T+1,) int
        Automaton states along ``x``.
    passed : tuple of Passed
        Fixes before, each with the cell that selected this stem.
    """

    u: FloatArray
    means: FloatArray
    x: FloatArray
    q: IntArray
    passed: tuple[Passed, ...] = ()

    @classmethod
    def trunk(cls, path: PlannedPath) -> Stem:
        """The stem of a path of the front."""
        return cls(path.u, path.x, path.x, path.q)

    @property
    def level(self) -> int:
        """The number of fixes before."""
        return len(self.passed)

    def past(self, fix: BranchFix, cell: Cell) -> tuple[Passed, ...]:
        """The cells of flights that a further ``fix`` puts into ``cell``."""
        return (*self.passed, Passed(fix, cell))


@dataclass(frozen=True, slots=True)
class Table:
    """What every flight that takes the fix would do with every rest.

    Attributes
    ----------
    y : (n, 2) float
        Distances along and left of the measured positions [m].
    taken : (n,) bool
        Flights that take the fix; the others fly the stem.
    failed : (n, R) bool
        Whether flight i fails with rest r; rest 0 is the rest of the stem, without the fix.
    length : (R,) float
        Length of the whole plan with each rest [m].
    first : int
        The first rest that a branch can have: 1 if flights with the fix fly off what they measure, so that
        rest 0 is not flown as a branch.
    """

    y: FloatArray
    taken: BoolArray
    failed: BoolArray
    length: FloatArray
    first: int = 0

    def branch(self, cells: tuple[Cell, ...]) -> IntArray:
        """The number of the cell (n,) of each flight, ``TRUNK`` if it takes no fix."""
        return np.where(self.taken, cells_of(cells, self.y), TRUNK)


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
    """A stem, a fix, and the best division for each number of branches.

    ``alone`` is the stem without the fix, which is the division for one branch, too, unless flights with the
    fix fly off what they measure. ``single`` is the best rest for all flights that take the fix: what a fix
    that says nothing would give.
    """

    stem: Stem
    fix: BranchFix
    rests: tuple[FloatArray, ...]
    divisions: tuple[Division, ...]
    table: Table
    alone: Division
    single: Division
    point: int = 0


@dataclass(frozen=True, slots=True)
class Grower:
    """What the search of all trees shares: flights to fit rests to, flights to choose by, the preference.

    ``allowed`` is the largest risk of a collision in a segment.
    """

    run: Run
    fitted: TreeFlights
    judged: TreeFlights
    leaves: int
    allowed: float = math.inf

    @classmethod
    def of(cls, run: Run, seeds: SeedSequence, worst: float) -> Grower:
        """Draws the flights. A plan that breaks epsilon, with the risk ``worst``, may have branches of it."""
        fit, judge = seeds.spawn(2)
        problem = run.problem
        return cls(
            run, TreeFlights.drawn(problem, FITTED, fit), TreeFlights.drawn(problem, JUDGED, judge),
            run.settings[BranchConfig].leaves, max(problem.allowed_risk, worst),
        )  # fmt: skip

    def within(self, stem: Stem, fix: BranchFix, cell: Cell) -> Grower:
        """The same search in the flights that ``fix`` puts into ``cell``."""

        def inside(winds: TreeFlights) -> TreeFlights:
            y, taken = winds.measured_along(stem.u, fix, stem.level)
            held = np.flatnonzero(taken & cell.holds(fix.distances(y)))
            return winds.after(fix, y, taken).only(held)

        return replace(self, fitted=inside(self.fitted), judged=inside(self.judged))

    @property
    def problem(self) -> Problem:
        """The problem of the whole flight, without fixes."""
        return self.run.problem

    @property
    def saving(self) -> float:
        """Per cent of the failures that a per cent of length must save, whatever rule chose the plan."""
        return self.run.settings.selection.saving

    def score(self, failure: float, length: float) -> float:
        """What is minimised, as the rule ``worth`` does: log(p + SMALL) + s log(l)."""
        return math.log(failure + SMALL) + self.saving * math.log(length)

    # --- one tree ---

    def begun(self, stem: Stem, fix: BranchFix, *, searched: bool = True) -> Tree:
        """The best trees with rests that were searched for around the planned position.

        If deviations are flown off, for all flights; else for those in each of the cells around it. Without a
        search their rests are the one of the stem, and it flown slower.
        """
        ways = [(one, self.first_rests(stem, one, searched)) for one in self.rejoining(stem, fix)]
        fix, rests = min(ways, key=lambda way: self.score_of_one(stem, *way))
        tree = self.tree(stem, fix, rests, self.table(stem, fix, rests))
        return self.searched_in(tree, self.around()) if searched and not fix.rejoin else tree

    def around(self) -> tuple[Cell, ...]:
        """The cells around the planned position in which rests are searched for first."""
        return QUADRANTS if self.leaves > 2 else _halves()

    def searched_in(self, tree: Tree, cells: Sequence[Cell]) -> Tree:
        """``tree`` with rests that were searched for in ``cells``, and with cells drawn again."""
        more = [u for cell in cells for u in self.rests_in(tree.stem, tree.fix, cell)]
        if not more:
            return tree
        table = self.with_rests(tree.table, tree.stem, tree.fix, more)
        return replace(self.tree(tree.stem, tree.fix, [*tree.rests, *more], table), point=tree.point)

    def first_rests(self, stem: Stem, fix: BranchFix, searched: bool) -> list[FloatArray]:
        """The rest of the stem, and if deviations are flown off rests for all flights."""
        rests: list[FloatArray] = [stem.u[fix.step :]]
        if fix.rejoin:
            rests += [*rests, *self.slower_rests(stem, fix, Cell(), rests[0])]
            rests += self.rests_in(stem, fix, Cell()) if searched else []
        return rests

    def score_of_one(self, stem: Stem, fix: BranchFix, rests: Sequence[FloatArray]) -> float:
        """The score of the best of ``rests`` for all flights that take the fix."""
        y, taken = self.fitted.measured_along(stem.u, fix, stem.level)
        after = self.fitted.after(fix, y, taken)
        return min(self.worth_of(after, stem, fix.step, rest) for rest in rests)

    def rejoining(self, stem: Stem, fix: BranchFix) -> list[BranchFix]:
        """Ways to use what ``fix`` measures, each with the steps in which deviations are best flown off.

        One without, and one with the best counter to the drift; on the stem, or on its rest flown slower. The
        first one flies nothing off if the setting says so, or if the flights fail no less.
        """
        if not self.run.settings[BranchConfig].rejoin:
            return [fix]
        y, taken = self.fitted.measured_along(stem.u, fix, stem.level)
        own, since = stem.u[fix.step :], stem.passed[-1].fix.step if stem.passed else 0
        slower = self.slower_rests(stem, fix, Cell(), own)
        wholes = [whole_controls(stem.u, fix.step, rest) for rest in (own, *slower)]

        def fewest(one: BranchFix) -> int:
            after = self.fitted.after(one, y, taken)
            return min(int(after.failed(u).sum()) for u in (wholes if one.rejoin else wholes[:1]))

        steps = sorted({max(round(share * len(own)), 1) for share in REJOINED})
        elapsed = (fix.step - since) * self.problem.motion.dt
        plain = [replace(fix, rejoin=n) for n in (0, *steps)]
        countered = [replace(fix, rejoin=n, counter=c / elapsed) for n in steps for c in COUNTERED]
        return [min(ways, key=fewest) for ways in (plain, countered)]

    def slower_rests(self, stem: Stem, fix: BranchFix, cell: Cell, rest: FloatArray) -> list[FloatArray]:
        """``rest`` along the same positions in more steps, as far as they can be flown in ``cell``."""
        u = whole_controls(stem.u, fix.step, rest)
        means, found, passed = expected_means(self.problem, u), list[FloatArray](), stem.past(fix, cell)
        try:
            told = Course.of(self.problem, stem.means).told(passed)
        except ValueError:
            return found
        for factor in SLOWER:
            steps = math.ceil(factor * len(rest))
            if fix.step + steps > self.problem.horizon:
                continue
            at = fix.step + np.linspace(0.0, len(rest), steps + 1)
            slow = np.stack([np.interp(at, np.arange(len(means)), x) for x in means.T], axis=1)
            whole = np.ascontiguousarray(np.vstack([means[: fix.step], slow]))
            one = evaluate(self.problem, x=whole).u[fix.step :]
            if self.has_airspeeds(one) and self.can_be_flown(stem, passed, told, one):
                found.append(np.ascontiguousarray(one))
        return found

    def has_airspeeds(self, u: FloatArray) -> bool:
        """Whether the robot has the airspeeds of the controls ``u`` (T, 2) [m/s]."""
        speed, motion = np.hypot(*u.T), self.problem.motion
        return bool((speed >= motion.u_min).all() and (speed <= motion.u_max).all())

    def grown(self, tree: Tree, rounds: int = ROUNDS) -> Tree:
        """``tree`` with rests that were searched for again in its cells, and with cells drawn again.

        If deviations are flown off, around the planned position first; cells that do not pay beside that are
        not searched again.
        """
        if rounds and tree.fix.rejoin:
            tree = self.searched_in(tree, self.around())
        for _ in range(rounds):
            if tree.fix.rejoin and worthwhile_leaves(tree) < 2:
                break
            tree = self.searched_in(tree, tree.divisions[-1].cells)
        return tree

    def tree(self, stem: Stem, fix: BranchFix, rests: Sequence[FloatArray], table: Table) -> Tree:
        """The best division for each number of branches."""
        alone, single = self.of_cells(table, (Cell(),), only=1), self.of_cells(table, (Cell(),))
        first, single = (single, alone) if fix.rejoin else (alone, single)
        more = (self.divided(table, number) for number in range(2, self.leaves + 1))
        return Tree(stem, fix, tuple(rests), (first, *more), table, alone, single)

    def best_division(self, tree: Tree) -> Division:
        """The division of ``tree`` with the best score, of any number of branches."""
        return min(tree.divisions, key=lambda one: self.score(one.failure, one.length))

    def best_score(self, tree: Tree) -> float:
        """The best score of ``tree`` with any number of branches."""
        best = self.best_division(tree)
        return self.score(best.failure, best.length)

    def best_of(self, trees: Sequence[Tree]) -> Tree:
        """The best of ``trees``; one on another path than the first one only if it is surely better."""
        best = min((tree for tree in trees if tree.point == trees[0].point), key=self.best_score)
        for tree in sorted(trees, key=self.best_score):
            if tree.point != best.point and self.gain(tree, best) > SURE:
                return tree
        return best

    def gain(self, tree: Tree, than: Tree) -> float:
        """By how many standard errors the score of ``tree`` is lower, from pairs of the same flights.

        It is lower if p + SMALL is less than the other p + SMALL times (other length / length)^saving.
        """
        one, other = self.best_division(tree), self.best_division(than)
        worth = (other.length / one.length) ** self.saving
        pairs = worth * (other.failed + SMALL) - (one.failed + SMALL)
        return float(pairs.mean() / max(pairs.std() / math.sqrt(len(pairs)), 1e-12))

    def rests_in(self, stem: Stem, fix: BranchFix, cell: Cell) -> list[FloatArray]:
        """Controls of rests that few of the flights in ``cell`` fail with."""
        winds, k = self.fitted, fix.step
        x = winds.flown(np.ascontiguousarray(stem.u[:k]))
        y, taken = winds.measured(fix, x[:, -1], stem.level)
        rows = np.flatnonzero(taken & cell.holds(fix.distances(y)))
        if len(rows) < LEAST_FLIGHTS:
            return []
        passed, after = stem.past(fix, cell), winds.after(fix, y, taken)
        try:
            told = Course.of(self.problem, stem.means).told(passed)
        except ValueError:
            return []
        learnt, countered = self.searched_law(stem, passed, told, y)
        inside, here, reserve = after.only(rows), x[:, -1], 0.0
        if fix.rejoin:  # the deviation is gone at once
            here = here - (y - fix.place)
        if fix.counter:
            added = np.hypot(*fix.changes(y[rows], self.problem.motion.dt)[1].T)
            reserve = float(np.quantile(added, RESERVED))
        state = np.array([self.problem.states(flight)[-1] for flight in x[rows]])
        found: list[tuple[float, FloatArray]] = []
        for q in self.open_states(state):
            own = rows[state == q]
            try:
                rest = rest_of_flight(self.run, learnt, k, q, reserve)
                flights = rest.flights(winds.flights.only(own), here[own], countered and countered.only(own))
                paths = search_paths(self.run.settings.refine.coarse(), flights)
            except (InfeasibleError, DataError) as error:
                LOG.info("no rest of the flight %s: %s", cell.words, error)
                continue
            found += [(self.worth_of(inside, stem, k, path.u), path.u) for path in paths]
        found.sort(key=lambda pair: pair[0])
        if fix.rejoin and found:
            slow = self.slower_rests(stem, fix, cell, found[0][1])
            found += [(self.worth_of(inside, stem, k, u), u) for u in slow]
            found.sort(key=lambda pair: pair[0])
        return [u for _, u in found[:RESTS] if self.can_be_flown(stem, passed, told, u)]

    def searched_law(
        self, stem: Stem, passed: tuple[Passed, ...], told: Moments, y: FloatArray
    ) -> tuple[Learnt, Countered | None]:
        """The law in which a rest is searched for, and what flights at the measured ``y`` (n, 2) [m] counter.

        As if the deviation were flown off at once, and what is expected of the wind were countered, as far as
        the last fix has that.
        """
        fix, countered, last = passed[-1].fix, None, passed
        if fix.counter:
            last, told = passed[-1:], Moments(told.share, np.zeros(2), np.zeros((2, 2)))
        prior = prior_at(self.problem, last, stem.means)
        if fix.counter:
            countered = Countered.of(prior, fix.sd, y - stem.means[fix.step])
        learnt = learnt_in_cell(prior, told, noise_of(last))
        return (learnt.at_place(fix.place, fix.sd) if fix.rejoin else learnt), countered

    def worth_of(self, winds: TreeFlights, stem: Stem, step: int, rest: FloatArray) -> float:
        """The score of one rest for the flights of a cell."""
        u = whole_controls(stem.u, step, rest)
        length = length_of(expected_means(self.problem, u))
        return self.score(float(winds.failed(u).mean()), length)

    def open_states(self, state: IntArray) -> list[int]:
        """The automaton states of a cell that have more than ``SOME`` of its flights and are not lost."""
        q, count = np.unique(state, return_counts=True)
        distance = self.problem.logic.distance[q]
        able = (count >= max(SOME * len(state), LEAST_FLIGHTS)) & np.isfinite(distance) & (distance > 0.0)
        return [int(one) for one in q[able][np.argsort(-count[able])]]

    def can_be_flown(self, stem: Stem, passed: tuple[Passed, ...], told: Moments, rest: FloatArray) -> bool:
        """Whether the flights of a cell keep epsilon in each segment of ``rest``, within the energy."""
        k, energy = passed[-1].fix.step, self.problem.energy
        u = whole_controls(stem.u, k, rest)
        capacity = math.inf if energy is None or energy.capacity is None else energy.capacity
        if energy is not None and energy.of(u, self.problem.motion.dt) > capacity:
            return False
        risk = segment_risks(self.problem, course_of(self.problem, u), passed, told)
        return bool((risk[k:] <= self.allowed * (1.0 + 1e-6)).all())

    # --- the table ---

    def table(self, stem: Stem, fix: BranchFix, rests: Sequence[FloatArray]) -> Table:
        """Which of the flights of the choice fail with which of ``rests``."""
        y, taken = self.judged.measured_along(stem.u, fix, stem.level)
        empty = Table(
            fix.distances(y), taken, np.zeros((len(self.judged), 0), bool), np.zeros(0), int(fix.rejoin > 0)
        )
        return self.with_rests(empty, stem, fix, rests)

    def with_rests(self, table: Table, stem: Stem, fix: BranchFix, rests: Sequence[FloatArray]) -> Table:
        """``table`` with further columns."""
        controls = [whole_controls(stem.u, fix.step, rest) for rest in rests]
        y, alone = fix.place + table.y @ fix.axes, len(table.length) == 0 and table.first
        after = self.judged.after(fix, y, table.taken)
        columns = [(self.judged if alone and k == 0 else after).failed(u) for k, u in enumerate(controls)]
        failed = np.stack(columns, axis=1)
        length = np.array([length_of(expected_means(self.problem, u)) for u in controls])
        return replace(
            table, failed=np.hstack([table.failed, failed]), length=np.append(table.length, length)
        )

    def divided(self, table: Table, leaves: int) -> Division:
        """The best division into ``leaves`` cells, 2 to 4."""
        found = [self.of_cells(table, cells) for cells in divisions(table.y[table.taken], leaves)]
        return min(found, key=lambda one: self.score(one.failure, one.length))

    def of_cells(self, table: Table, cells: tuple[Cell, ...], only: int | None = None) -> Division:
        """The best rest that a branch can have, or of the first ``only``, in each of ``cells``."""
        alone = table.failed[:, 0]
        p, L = float(alone.mean()), float(table.length[0])
        price = self.saving * (p + SMALL) / L  # [1/m] of failure rate, at the stem
        number = table.branch(cells)
        first = 0 if only else table.first
        rests, failed = [], alone.copy()
        length = np.full(len(alone), L)
        for k in range(len(cells)):
            rows = number == k
            best = first
            if rows.any():
                cost = table.failed[rows, first:only].mean(axis=0) + price * table.length[first:only]
                best += int(np.argmin(cost))
            rests.append(best)
            failed[rows], length[rows] = table.failed[rows, best], table.length[best]
        return Division(cells, tuple(rests), failed, float(length.mean()))


def expected_means(problem: Problem, u: FloatArray) -> FloatArray:
    """Expected positions (T+1, 2) [m] of the controls ``u`` (T, 2) [m/s], without a fix."""
    return evaluate(problem, u=u).x


def course_of(problem: Problem, u: FloatArray) -> Course:
    """The flights of the controls ``u`` (T, 2) [m/s]."""
    return Course.of(problem, expected_means(problem, u))


def segment_risks(problem: Problem, course: Course, passed: tuple[Passed, ...], told: Moments) -> FloatArray:
    """The probability of a collision in each segment (T,) of the flights of ``course`` in cells."""
    return problem.segment_risks(course.given(passed, told))


def worthwhile_leaves(tree: Tree) -> int:
    """The fewest branches of ``tree`` beyond which more do not reduce the failures significantly; 0: none.

    The first ones must also fail less than one rest for all flights: else the search has found a better
    stem, and the fix says nothing.
    """
    number, least = 0, [tree.alone.failed, tree.single.failed]
    for more, division in enumerate(tree.divisions, 1):
        if all(paired_difference(failed, division.failed)[2] < 0.0 for failed in least):
            number, least = more, [division.failed]
    return number


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
