"""The non-dominated front of paths (Section IV-D); ``selection_rules`` picks the plan from it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Forest, Front, PlannedPath, objective_row
from pareto_ltl.settings import FidelityConfig
from pareto_ltl.settings.fidelity import PAPER
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.counts import binomial_tail
from pareto_ltl.support.errors import InfeasibleError

MOST = 64  # paths of the trees that are evaluated in other models than the paper's


def non_dominated(rows: FloatArray) -> BoolArray:
    """Which rows (P, f) no other row dominates; of equal rows the first counts. Minimisation."""
    import moocore

    return np.asarray(moocore.is_nondominated(rows, keep_weakly=False), bool)


def hypervolume(rows: FloatArray, reference: FloatArray) -> float:
    """Volume dominated by ``rows`` within the box below ``reference``, in units of the box (minimisation).

    Eq. (M46) of docs/mathematics_methods.md.
    """
    import moocore

    if len(rows) == 0:
        return 0.0
    inside = np.minimum(rows, reference) / reference
    return float(moocore.hypervolume(inside, ref=np.ones(len(reference))))


def box_above(costs: FloatArray) -> FloatArray:
    """Sides (C,) of the box of a hypervolume: twice the largest of ``costs`` (P, C), 1 where all are 0."""
    limit = costs.max(axis=0)
    return np.where(limit > 0.0, 2.0 * limit, 1.0)


def chance_of_failures(failed: BoolArray, others: BoolArray) -> FloatArray:
    """p value of the hypothesis that two paths fail equally often in the same winds, against the first.

    If both are equally safe, each fails in half of the flights that only one of them completes: the sign test
    (McNemar, Psychometrika 12, 1947, doi:10.1007/BF02295996), exact and one-sided. A small value says that
    the first path is worse. ``failed``, ``others`` (..., n); returns shape (...).

    Eq. (M49) of docs/mathematics_methods.md.
    """
    worse = (failed & ~others).sum(axis=-1)
    better = (~failed & others).sum(axis=-1)
    return binomial_tail(worse, worse + better, 0.5)


def accepted_rows(forest: Forest) -> FloatArray:
    """Mission risk, at most 1, and length [m] of every accepted vertex (A, 2), as ``forest.accepted``."""
    if not len(forest.accepted):
        return np.empty((0, 2))
    stored = [np.column_stack([np.minimum(tree.risk.sum(axis=1), 1.0), tree.length]) for tree in forest.trees]
    first = np.cumsum([0, *map(len, stored)])
    tree, vertex = np.transpose(forest.accepted)
    return np.asarray(np.concatenate(stored)[first[tree] + vertex])


def tree_front(problem: Problem, forest: Forest) -> tuple[PlannedPath, ...]:
    """Non-dominated paths of the trees, by mission risk.

    With the models of the paper, the front is taken in the objectives that vertices store: mission risk and
    length; collisions are a constraint (Eqs. 8 and 9), and R is computed for the members. With other models,
    paths of all orders and lengths are evaluated, and those that they do not allow are left out.
    """
    rows = accepted_rows(forest)
    if len(rows) == 0:
        return ()
    if not problem.is_published:
        paths = list(_feasible_paths(problem, forest, _unlike_rows(problem, forest, rows)))
        if paths:
            keep = non_dominated(np.array([objective_row(path.objectives) for path in paths]))
            paths = [path for path, kept in zip(paths, keep, strict=True) if kept]
    else:
        paths = list(_feasible_paths(problem, forest, np.flatnonzero(non_dominated(rows))))
    return tuple(sorted(paths, key=lambda p: tuple(objective_row(p.objectives))))


def _tree_path(forest: Forest, k: int) -> tuple[FloatArray, str]:
    j, v = (int(i) for i in forest.accepted[k])
    return forest.trees[j].path(v), f"tree {j} vertex {v}"


def _feasible_paths(
    problem: Problem, forest: Forest, rows: IntArray, *, tight: bool = True
) -> Iterator[PlannedPath]:
    """The paths to the accepted vertices ``rows``, except those that break a constraint of the plan."""
    for k in rows.tolist():
        with suppress(InfeasibleError):
            yield evaluate_path(problem, *_tree_path(forest, k), tight=tight)


def order_representatives(problem: Problem, forest: Forest) -> tuple[PlannedPath, ...]:
    """For every mission order that some accepted path of the trees follows, the best such path.

    An order is the sequence of automaton states and labels at which the state changes. The front alone may
    contain only one of them, while another one is better after smoothing. These paths are starts of
    smoothing: R has its looser form and may lie above delta, and limits of other models than the paper's are
    not checked.
    """
    rows, orders = accepted_rows(forest), _accepted_orders(problem, forest)
    best: dict[int, int] = {}
    for k in np.lexsort((rows[:, -1], rows[:, 0])):
        best.setdefault(orders[k], int(k))
    fast = 1e-6
    if not problem.is_published:
        problem, fast = replace(problem, fidelity=replace(problem.fidelity, judge="flights")), np.inf
    return tuple(evaluate_path(problem, *_tree_path(forest, k), fast, tight=False) for k in best.values())


def unlike_paths(problem: Problem, forest: Forest) -> tuple[PlannedPath, ...]:
    """Accepted paths of the trees for flights to judge: no two of the same mission order and similar length.

    R has its looser form.
    """
    rows = accepted_rows(forest)
    if len(rows) == 0:
        return ()
    return tuple(_feasible_paths(problem, forest, _unlike_rows(problem, forest, rows), tight=False))


def _unlike_rows(problem: Problem, forest: Forest, rows: FloatArray) -> IntArray:
    """Accepted vertices of which no two have the same mission order and similar length.

    Lengths are similar within 2 %, or within more if there were more than ``MOST`` paths; of similar paths
    the one with the least risk is taken.
    """
    orders, order = np.array(_accepted_orders(problem, forest)), np.argsort(rows[:, 0], kind="stable")
    width, chosen = 0.02, order
    while width == 0.02 or len(chosen) > MOST:
        boxes = np.column_stack([orders, (np.log(rows[:, -1] + 1.0) / width).astype(np.int64)])
        chosen = order[np.sort(np.unique(boxes[order], axis=0, return_index=True)[1])]
        width *= 1.5
    return np.asarray(chosen, np.int64)


def _accepted_orders(problem: Problem, forest: Forest) -> list[int]:
    """A hash of the mission order of every accepted vertex."""
    signs = [_order_hashes(problem, forest, j) for j in range(len(forest.trees))]
    return [signs[j][v] for j, v in forest.accepted.tolist()]


def _order_hashes(problem: Problem, forest: Forest, j: int) -> list[int]:
    """A hash of the mission order of every vertex of tree ``j``."""
    tree = forest.trees[j]
    shown = [hash(tuple(sorted(label))) for label in problem.labels]
    signs: list[int] = []
    for parent, q, cell in zip(tree.parent.tolist(), tree.q.tolist(), tree.cell.tolist(), strict=True):
        if parent < 0:
            signs.append(hash((q, shown[cell])))
        elif q == tree.q[parent]:
            signs.append(signs[parent])
        else:
            signs.append(hash((signs[parent], q, shown[cell])))
    return signs


def build_front(
    smoothed: Sequence[PlannedPath], raw: Sequence[PlannedPath], models: FidelityConfig = PAPER
) -> Front:
    """Non-dominated among the trees' paths and their smoothed versions, planned with ``models``.

    Raises
    ------
    InfeasibleError
        If there is no path.
    """
    paths = [*raw, *smoothed]
    if not paths:
        raise InfeasibleError(
            "no path completes the mission within planner.delta; raise it, or planner.n_max"
        )
    rows = np.array([objective_row(p.objectives) for p in paths])
    remaining = [p for p, keep in zip(paths, non_dominated(rows), strict=True) if keep]
    remaining.sort(key=lambda p: tuple(objective_row(p.objectives)))
    reference = np.array([1.0, 1.0, *box_above(rows[:, 2:])])
    volume = hypervolume(np.array([objective_row(p.objectives) for p in remaining]), reference)
    before = tuple(p.objectives for p in raw)
    return Front(tuple(remaining), before, volume, reference, models=models, judged=rows)
