"""The non-dominated front of paths (Section IV-D); ``selection_rules`` picks the plan from it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress

import numpy as np

from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Forest, Front, PlannedPath, objective_row
from pareto_ltl.settings import FidelityConfig
from pareto_ltl.settings.fidelity import PAPER
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.counts import binomial_tail
from pareto_ltl.support.errors import InfeasibleError

RISK_FLOOR = 1e-6  # risks below it count as equal
MOST = 64  # paths of a tree front with three objectives that are evaluated, the safest first


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
    most = costs.max(axis=0)
    return np.where(most > 0.0, 2.0 * most, 1.0)


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
    """Objectives of every accepted vertex, (A, 2 or 3), in the order of ``forest.accepted``.

    The mission risk, at most 1, then with the path bound the collision risk R, then the length [m].
    """
    columns = forest.mission_columns
    if not len(forest.accepted):
        return np.empty((0, 2))
    stored = [np.column_stack([tree.risk, tree.length]) for tree in forest.trees]
    first = np.cumsum([0, *map(len, stored)])
    tree, vertex = np.transpose(forest.accepted)
    table = np.concatenate(stored)[first[tree] + vertex]
    mission = np.minimum(table[:, :columns].sum(axis=1), 1.0)
    return np.column_stack([mission, table[:, columns:]])


def tree_front(problem: Problem, forest: Forest) -> tuple[PlannedPath, ...]:
    """Non-dominated paths of the trees, by mission risk.

    The front is taken in the objectives that vertices store. With the step bound, as in the paper, these are
    mission risk and length; collisions are a constraint (Eqs. 8 and 9), and R is computed for the members.
    With the path bound R is an objective too, and only members that differ by more than a few per cent are
    evaluated.
    """
    rows = accepted_rows(forest)
    if len(rows) == 0:
        return ()
    keep = np.flatnonzero(non_dominated(rows))
    if rows.shape[1] == 3:
        keep = keep[unlike_rows(rows[keep])]
    # R may lie above delta where growth trusted the reflection and the deviations shrink.
    paths = _feasible_paths(problem, forest, keep)
    return tuple(sorted(paths, key=lambda p: tuple(objective_row(p.objectives))))


def _tree_path(forest: Forest, k: int) -> tuple[FloatArray, str]:
    j, v = (int(i) for i in forest.accepted[k])
    return forest.trees[j].path(v), f"tree {j} vertex {v}"


def _feasible_paths(
    problem: Problem, forest: Forest, rows: IntArray, *, tight: bool = True
) -> Iterator[PlannedPath]:
    """The paths to the accepted vertices ``rows``, except where rounding breaks a constraint at its limit."""
    for k in rows.tolist():
        with suppress(InfeasibleError):
            yield evaluate_path(problem, *_tree_path(forest, k), tight=tight)


def unlike_rows(rows: FloatArray) -> IntArray:
    """Indices of rows (V, R, length) of which no two are alike, at most ``MOST``.

    They are the safest row of each box of 10 % risk and 1 % length.
    """
    boxes = np.column_stack([np.log(rows[:, :2] + RISK_FLOOR) / 0.1, np.log(rows[:, 2] + 1.0) / 0.01]).round()
    order = np.argsort(rows[:, :2].sum(axis=1), kind="stable")
    _, first = np.unique(boxes[order], axis=0, return_index=True)
    return (
        np.asarray(np.sort(order[first])[:MOST], np.int64)
        if len(first) <= MOST
        else order[np.sort(first)][:MOST]
    )


def order_representatives(problem: Problem, forest: Forest) -> tuple[PlannedPath, ...]:
    """For every mission order that some accepted path of the trees follows, the best such path.

    An order is the sequence of automaton states and labels at which the state changes. The front alone may
    contain only one of them, while another one is better after smoothing. R has its looser form and may lie
    above delta: these paths are starts of smoothing.
    """
    rows, orders = accepted_rows(forest), _accepted_orders(problem, forest)
    best: dict[int, int] = {}
    for k in np.lexsort((rows[:, -1], rows[:, :-1].sum(axis=1))):
        best.setdefault(orders[k], int(k))
    return tuple(evaluate_path(problem, *_tree_path(forest, k), tight=False) for k in best.values())


def unlike_paths(problem: Problem, forest: Forest) -> tuple[PlannedPath, ...]:
    """Accepted paths of the trees for flights to judge: no two of the same mission order and similar length.

    Lengths are similar within 2 %, or within more if there were more than ``MOST`` paths; of similar paths
    the one with the least risk is taken. R has its looser form.
    """
    rows, orders = accepted_rows(forest), np.array(_accepted_orders(problem, forest))
    if len(rows) == 0:
        return ()
    order = np.argsort(rows[:, :-1].sum(axis=1), kind="stable")
    width, chosen = 0.02, order
    while width == 0.02 or len(chosen) > MOST:
        boxes = np.column_stack([orders, (np.log(rows[:, -1] + 1.0) / width).astype(np.int64)])
        chosen = order[np.sort(np.unique(boxes[order], axis=0, return_index=True)[1])]
        width *= 1.5
    return tuple(_feasible_paths(problem, forest, chosen, tight=False))


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
