"""Rules that pick the path to fly from the front (Section IV-D), one function a value of ``selection.rule``.

A rule takes the settings of the selection and a front that is not empty, and returns the number of the path.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pareto_ltl.planning.records import Front, PlannedPath, objective_row
from pareto_ltl.planning.selection import chance_of_failures
from pareto_ltl.settings import SelectionConfig
from pareto_ltl.support import extensions
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import probability_text, round_up
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.extensions import known_kind

WORSE = 0.025  # chance of so many more failures below which a path is not as safe as another
SelectionRule = Callable[[SelectionConfig, Front], int]


def choose_path(cfg: SelectionConfig, front: Front) -> PlannedPath:
    """The path of ``front`` that the rule ``cfg.rule`` picks.

    Raises
    ------
    InfeasibleError
        If the rule accepts no path of the front.
    """
    rule = known_kind(extensions.SELECTION_RULE_GROUP, RULE_FUNCTIONS, cfg.rule, callable)
    return front.paths[rule(cfg, front)]


def by_priority(cfg: SelectionConfig, front: Front) -> int:
    """The least mission risk, then the least collision risk, then the shortest (the paper's rule).

    Where flights judge: the shortest of the paths that are as safe as the safest one. A path is as safe
    unless it fails more often with a confidence of 97.5 %. All paths met the same winds, so that the flights
    that only one of two survives tell them apart, also where the intervals of their rates overlap.
    """
    rows = _objective_rows(front)
    if not front.rates:
        return int(np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))[0])
    least = int(np.lexsort((rows[:, 2], front.failed.mean(axis=1)))[0])
    as_safe = np.flatnonzero(chance_of_failures(front.failed, front.failed[least]) >= WORSE)
    return int(as_safe[np.argmin(rows[as_safe, 2])])


def by_weights(cfg: SelectionConfig, front: Front) -> int:
    """The least g_w(ξ, λ) = Σ_j λ_j f_j, with length in units of the shortest path of the front."""
    rows = _objective_rows(front)
    weights = np.array(cfg.weights) / sum(cfg.weights)
    return int(np.argmin(rows / [1.0, 1.0, rows[:, 2].min() or 1.0] @ weights))


def by_threshold(cfg: SelectionConfig, front: Front) -> int:
    """The shortest path whose mission risk + collision risk is at most ``cfg.alpha``.

    Raises
    ------
    InfeasibleError
        If no path is safe enough; the text gives the least risk there is.
    """
    risk = _objective_rows(front)[:, :2].sum(axis=1)
    safe = np.flatnonzero(risk <= cfg.alpha)
    if len(safe) == 0:
        raise InfeasibleError(
            f"no path keeps {front.models.mission_symbol} + R in {front.models.law} winds within "
            f"selection.alpha = {cfg.alpha:g}; the least risk is {probability_text(risk.min())}: "
            f"{_alpha_advice(float(risk.min()))}lower planner.epsilon, or raise planner.n_max"
        )
    return int(safe[np.argmin(_objective_rows(front)[safe, 2])])


def _alpha_advice(least: float) -> str:
    """The setting of alpha that accepts the risk ``least``; none does where it is 1 or more."""
    alpha = round_up(least)
    return f"set selection.alpha={alpha:g}, " if alpha < 1.0 else ""


def _objective_rows(front: Front) -> FloatArray:
    """(mission risk, collision risk, length) of every path, shape (P, 3)."""
    return np.array([objective_row(path.objectives) for path in front.paths])


RULE_FUNCTIONS: dict[str, SelectionRule] = {
    "priority": by_priority,
    "weighted": by_weights,
    "threshold": by_threshold,
}
