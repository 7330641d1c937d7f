"""From a tree that was searched for to the record of a plan that branches, rated by fresh flights."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pareto_ltl.extend import (
    Branch,
    BranchFix,
    Branching,
    FailureRate,
    Objectives,
    PlannedPath,
    Problem,
    TreeRow,
)
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray, length_of, square_matrices
from pareto_ltl.support.counts import paired_difference
from pareto_ltl_apps.branching.belief import Course, Passed
from pareto_ltl_apps.branching.tree_flights import TRUNK, TreeOutcome, whole_controls
from pareto_ltl_apps.branching.tree_search import (
    LATER_ROUNDS,
    SELDOM,
    Grower,
    Stem,
    Tree,
    course_of,
    expected_means,
    segment_risks,
    worthwhile_leaves,
)

Fixes = Callable[[Stem], Sequence[BranchFix]]


@dataclass(frozen=True, slots=True)
class Grown:
    """A tree with the number of branches that is taken, and the trees of branches that branch again."""

    tree: Tree
    number: int
    then: Mapping[int, Grown] = field(default_factory=dict)

    @property
    def leaves(self) -> int:
        """The number of tables that a flight can end on."""
        return self.number + sum(one.leaves - 1 for one in self.then.values())

    def outcome(self) -> tuple[BoolArray, float]:
        """Which of the flights of the choice fail, and the expected length [m]."""
        division = self.tree.divisions[self.number - 1]
        failed, length = division.failed.copy(), division.length
        number = self.tree.table.branch(division.cells)
        for k, one in self.then.items():
            rows = np.flatnonzero(number == k)
            failed[rows], own = one.outcome()
            length += len(rows) / len(failed) * (own - one.tree.alone.length)
        return failed, length


def with_second_fixes(grower: Grower, tree: Tree, number: int, fixes: Fixes) -> Grown:
    """``tree`` with ``number`` branches, of which those branch again for which it pays.

    ``fixes`` gives the fixes that can be taken on a stem.
    """
    division, found = tree.divisions[number - 1], dict[int, Grown]()
    cell_of = tree.table.branch(division.cells)
    for k in range(number):
        share = (division.failed & (cell_of == k)).mean()
        if share == 0.0:
            continue
        stem = stem_on(grower.problem, tree, number, k)
        inner = grower.within(tree.stem, tree.fix, division.cells[k])
        later, often = [fix for fix in fixes(stem) if fix.step > tree.fix.step], share >= SELDOM
        shoots = [inner.begun(stem, fix, searched=often) for fix in later]
        if not shoots:
            continue
        own = inner.grown(min(shoots, key=inner.best_score), LATER_ROUNDS if often else 0)
        first = own.divisions[0]
        fewer = own.fix.rejoin > 0 and first.failed.sum() < own.alone.failed.sum()
        if (leaves := max(worthwhile_leaves(own), int(fewer))) > 0:
            found[k] = Grown(own, leaves)  # whether it pays, fresh flights say
    return Grown(tree, number, found)


def stem_on(problem: Problem, tree: Tree, number: int, k: int) -> Stem:
    """The stem of branch ``k`` of a tree with ``number`` branches."""
    division, step = tree.divisions[number - 1], tree.fix.step
    u = whole_controls(tree.stem.u, step, tree.rests[division.rests[k]])
    passed = tree.stem.past(tree.fix, division.cells[k])
    means = expected_means(problem, u)
    course = Course.of(problem, means)
    x = course.given(passed, course.told(passed)).x
    q, _ = states_from(problem, int(tree.stem.q[step]), x[step:], step)
    return Stem(u, means, x, np.concatenate([tree.stem.q[:step], q]), passed)


# --- the front of trees ------------------------------------------------------------------------------


def tree_rows(law: str, alone: Tree, grown: Grown) -> tuple[TreeRow, ...]:
    """What each number of branches gives, in the flights of the choice.

    The row without branches is of ``alone``, the tree before its trunk was bent. Branches of branches are
    added one after another, those first that save most.
    """

    def row(leaves: int, failed: BoolArray, length: float, fixes: int) -> TreeRow:
        return TreeRow(leaves, FailureRate.counted(law, int(failed.sum()), len(failed)), length, fixes)

    rows = [row(1, alone.alone.failed, alone.alone.length, 0)]
    least = 1 if grown.tree.fix.rejoin else 2
    rows += [row(k, one.failed, one.length, 1) for k, one in enumerate(grown.tree.divisions, 1) if k >= least]
    gains = {k: int(one.tree.alone.failed.sum() - one.outcome()[0].sum()) for k, one in grown.then.items()}
    then = dict[int, Grown]()
    for k in sorted(gains, key=lambda k: -gains[k]):
        then[k] = grown.then[k]
        more = replace(grown, then=dict(then))
        rows.append(row(more.leaves, *more.outcome(), 2))
    return tuple(rows)


# --- the record --------------------------------------------------------------------------------------


def drafted(problem: Problem, grown: Grown, prefix: str = "") -> Branching:
    """The tree as a record whose rates and expected lengths are not known."""
    tree, unknown = grown.tree, FailureRate(problem.fidelity.law, 0.0, 0.0, 1.0, 1)
    division, frame, branches = tree.divisions[grown.number - 1], problem.scene.frame, []
    for k, (cell, rest) in enumerate(zip(division.cells, division.rests, strict=True)):
        share, path = branch_path(problem, tree, rest, tree.stem.past(tree.fix, cell))
        name = f"{prefix}{k + 1}" if prefix else Branching.NAMES[k]
        then = drafted(problem, grown.then[k], name) if k in grown.then else None
        log = frame.navigation(path.t, path.x, path.u)
        branches.append(Branch(name, cell, share, path, unknown, log, then))
    nothing = (0.0, 0.0, 0.0)
    return Branching(tree.fix, tuple(branches), unknown, unknown, nothing, 0.0, tree.point)


def rated(
    law: str, draft: Branching, flown: TreeOutcome, stem: FloatArray, since: int = 0, path: Sequence[int] = ()
) -> Branching:
    """``draft`` with the rates of the flights ``flown``, and with expected lengths.

    ``stem`` (n, 2) [m] are the positions that are flown without the fix, from step ``since`` on; ``path`` are
    the branches that lead to it.
    """
    level, rows = len(path), flown.rows(path)

    def rate(failed: BoolArray) -> FailureRate:
        return FailureRate.counted(law, int(failed.sum()), max(len(failed), 1))

    branches = []
    for k, one in enumerate(draft.branches):
        own = flown.rows((*path, k))
        then = one.then
        if then is not None:
            then = rated(law, then, flown, one.path.x, draft.fix.step, (*path, k))
        branches.append(replace(one, rate=rate(flown.failed[own]), then=then))
    taken = float((flown.branch[rows, level] != TRUNK).mean()) if len(rows) else 0.0
    rests = [length_of(one.path.x) if one.then is None else one.then.length for one in branches]
    shares = [one.share for one in branches]
    length = (1.0 - taken) * length_of(stem) + taken * (
        length_of(stem[: draft.fix.step - since + 1]) + float(np.dot(shares, rests))
    )
    alone, failed = flown.before[rows, level], flown.failed[rows]
    return replace(
        draft, branches=tuple(branches), rate=rate(failed), alone=rate(alone),
        difference=paired_difference(alone, failed) if len(rows) else draft.difference, length=float(length),
    )  # fmt: skip


def paying(grown: Grown, flown: TreeOutcome) -> Grown:
    """``grown`` without branches of branches that do not lower the failures of ``flown`` significantly."""
    kept = {}
    for k, one in grown.then.items():
        rows = flown.rows((k,))
        if len(rows) and paired_difference(flown.before[rows, 1], flown.failed[rows])[2] < 0.0:
            kept[k] = one
    return replace(grown, then=kept)


def branch_path(
    problem: Problem, tree: Tree, rest: int, passed: tuple[Passed, ...]
) -> tuple[float, PlannedPath]:
    """Share of the cell, and the rest number ``rest`` as the path of the flights in it."""
    k, stem, dt = tree.fix.step, tree.stem, problem.motion.dt
    u = whole_controls(stem.u, k, tree.rests[rest])
    course = course_of(problem, u)
    told = course.told(passed)
    given = course.given(passed, told)
    x, cov = given.x[k:], square_matrices(given.cov)[k:]
    q, cell = states_from(problem, int(stem.q[k]), x, k)
    unknown = math.nan
    path = PlannedPath(
        t=dt * np.arange(k, k + len(x), dtype=float),
        x=x,
        cov=cov,
        q=q,
        label=tuple(problem.decomposition.labels[c] if c >= 0 else frozenset() for c in cell.tolist()),
        u=tree.rests[rest],
        objectives=Objectives(problem.costs_of(x, tree.rests[rest]), unknown, unknown, unknown, unknown),
        origin="the rest of the plan" if rest <= tree.table.first else f"rest {rest} of the branches",
        order=problem.mission_order(q, cell, int(q[0])),
    )
    return told.share, path


def states_from(problem: Problem, state: int, x: FloatArray, step: int) -> tuple[IntArray, IntArray]:
    """Automaton states and cells (n,) of positions ``x`` (n, 2), read from ``step`` on, from ``state``."""
    cell = problem.locate(x)
    logic, q = problem.logic, [state]
    for t in range(1, len(x)):
        epoch = int(logic.epoch[min(step + t, len(logic.epoch) - 1)])
        q.append(int(logic.delta[epoch, q[-1], cell[t]]))
    return np.array(q, np.int64), cell


# --- the chance constraint ---------------------------------------------------------------------------


def keeps_epsilon(problem: Problem, grown: Grown, allowed: float) -> bool:
    """Whether the flights of all branches together have at most the ``allowed`` risk in every segment."""
    return bool((mixed_risk(problem, grown) <= allowed * (1.0 + 1e-6)).all())


def mixed_risk(problem: Problem, grown: Grown) -> FloatArray:
    """Probability of a collision in each segment from the first fix on, of the flights of all branches.

    Branches have unlike numbers of steps; what has ended collides no more. Flights without a fix are left
    out: the trunk keeps ``planner.epsilon`` by itself.
    """
    total = np.zeros(problem.horizon)
    _add_risk(problem, grown, 1.0, total)
    return total[grown.tree.fix.step :]


def _add_risk(problem: Problem, grown: Grown, weight: float, total: FloatArray) -> None:
    """Add the risk of the flights of ``grown``, of which there are ``weight``, to ``total`` (T,)."""
    tree = grown.tree
    division, step = tree.divisions[grown.number - 1], tree.fix.step
    for k, (cell, rest) in enumerate(zip(division.cells, division.rests, strict=True)):
        u, passed = whole_controls(tree.stem.u, step, tree.rests[rest]), tree.stem.past(tree.fix, cell)
        course = course_of(problem, u)
        told = course.told(passed)
        risk, later = segment_risks(problem, course, passed, told), grown.then.get(k)
        end = len(risk) if later is None else later.tree.fix.step
        total[step:end] += weight * told.share * risk[step:end]
        if later is not None:
            _add_risk(problem, later, weight * told.share, total)
