"""From paths to the one that is flown: non-dominated front, then a rule (Section IV-D)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pareto_ltl.arrays import BoolArray, FloatArray
from pareto_ltl.config import SelectionConfig
from pareto_ltl.errors import InfeasibleError
from pareto_ltl.problem import Problem, evaluate
from pareto_ltl.records import Forest, Front, Objectives, Path


def objective_row(o: Objectives) -> FloatArray:
    """(mission risk, collision risk, length); mission risk is the paper's f_o."""
    return np.array([o.mission_risk_paper, o.collision_risk, o.length])


def non_dominated(rows: FloatArray) -> BoolArray:
    """Which rows (P, f) no other row dominates; of equal rows the first is kept. Minimisation."""
    import moocore

    return np.asarray(moocore.is_nondominated(rows, keep_weakly=False), bool)


def hypervolume(rows: FloatArray, reference: FloatArray) -> float:
    """Volume dominated by ``rows`` within the box below ``reference``, in units of the box (minimisation)."""
    import moocore

    if len(rows) == 0:
        return 0.0
    inside = np.minimum(rows, reference) / reference
    return float(moocore.hypervolume(inside, ref=np.ones(len(reference))))


def accepted_rows(forest: Forest) -> FloatArray:
    """Objectives (f_o, length) of every accepted vertex, in the order of ``forest.accepted``."""
    return np.array(
        [[min(1.0, forest.trees[j].risk[v].sum()), forest.trees[j].length[v]] for j, v in forest.accepted]
    ).reshape(-1, 2)


def tree_front(problem: Problem, forest: Forest) -> tuple[Path, ...]:
    """Non-dominated paths of the trees, by mission risk.

    The paper's objectives are mission risk and length, collisions a constraint (Eqs. 8 and 9): the front
    is taken in these two, which every vertex knows, and R is worked out for its members.
    """
    rows = accepted_rows(forest)
    if len(rows) == 0:
        return ()
    keep = np.flatnonzero(non_dominated(rows))
    paths = []
    for k in keep:
        j, v = (int(i) for i in forest.accepted[k])
        paths.append(evaluate(problem, forest.trees[j].path(v), f"tree {j} vertex {v}"))
    return tuple(sorted(paths, key=lambda p: tuple(objective_row(p.objectives))))


def front(smoothed: Sequence[Path], raw: Sequence[Path]) -> Front:
    """Non-dominated among the trees' paths and their smoothed versions."""
    paths = [*raw, *smoothed]
    if not paths:
        raise InfeasibleError("no path completes the mission")
    rows = np.array([objective_row(p.objectives) for p in paths])
    kept = [p for p, keep in zip(paths, non_dominated(rows), strict=True) if keep]
    kept.sort(key=lambda p: tuple(objective_row(p.objectives)))
    reference = np.array([1.0, 1.0, 2.0 * rows[:, 2].max()])
    volume = hypervolume(np.array([objective_row(p.objectives) for p in kept]), reference)
    return Front(tuple(kept), tuple(p.objectives for p in raw), volume, reference)


def choose(cfg: SelectionConfig, front: Front) -> Path:
    """Pick one path of the front.

    ``priority``: completion, then mission risk, then length (the paper's). ``weighted``: least
    g_w(ξ, λ) = Σ_j λ_j f_j, length in units of the shortest on the front. ``threshold``: the shortest with
    mission risk + collision risk ≤ alpha.

    Raises
    ------
    InfeasibleError
        For ``threshold``, where no path is safe enough; the text gives the least risk there is.
    """
    rows = np.array([objective_row(p.objectives) for p in front.paths])
    if cfg.rule == "priority":
        return front.paths[int(np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))[0])]
    if cfg.rule == "weighted":
        weights = np.array(cfg.weights) / sum(cfg.weights)
        scaled = rows / [1.0, 1.0, rows[:, 2].min() or 1.0]
        return front.paths[int(np.argmin(scaled @ weights))]
    risk = np.array([p.objectives.mission_risk + p.objectives.collision_risk for p in front.paths])
    safe = np.flatnonzero(risk <= cfg.alpha)
    if len(safe) == 0:
        raise InfeasibleError(
            f"no path keeps mission risk + collision risk within selection.alpha = {cfg.alpha:g}; the safest "
            f"has {risk.min():.3g}: raise selection.alpha, lower planner.epsilon, or raise planner.n_max"
        )
    return front.paths[int(safe[np.argmin(rows[safe, 2])])]
