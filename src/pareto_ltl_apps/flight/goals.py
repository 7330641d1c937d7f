"""Which goals of a plan a flight has reached: shares of the simulated flights that fly what was flown."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pareto_ltl.extend import Deployment, PlannedPath, Problem
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.flight.belief import LAW, Belief

BELIEVED = 0.5  # probability from which a goal counts as reached


class Goal(NamedTuple):
    """Labels that bring the mission of the plan nearer to its end, at a step; ``state`` is reached there.

    ``left`` is the last step in a row at which the plan has these labels.
    """

    labels: tuple[str, ...]
    step: int
    state: int
    left: int

    @property
    def name(self) -> str:
        """``a and b``."""
        return " and ".join(self.labels) or "the next state of the mission"


def planned_goals(problem: Problem, path: PlannedPath) -> tuple[Goal, ...]:
    """The goals of ``path`` in the order of time."""
    left = problem.logic.distance[path.q]
    return tuple(
        Goal(tuple(sorted(path.label[t])), t, int(path.q[t]), _left(path, t))
        for t in range(1, len(path.q))
        if left[t] < left[t - 1]
    )


def _left(path: PlannedPath, step: int) -> int:
    """The last step in a row from ``step`` on at which the path has the labels of ``step``."""
    later = (t for t in range(step + 1, len(path.label)) if not path.label[step] <= path.label[t])
    return next(later, len(path.label)) - 1


def flown_on(problem: Problem, belief: Belief) -> FloatArray:
    """Positions (n, t+1, 2) [m] of the simulated flights that have met no obstacle; of all, if all have."""
    x = np.ascontiguousarray(belief.flown[:, : belief.step + 1])
    past = Deployment.judged(problem, LAW, x)
    lost = past.collided | (past.off_map & past.walled)
    return x if lost.all() else x[~lost]


def reached(problem: Problem, belief: Belief, goal: Goal) -> float:
    """Share of the flights in which the mission is at least as far as ``goal`` brings it."""
    left, limit = problem.logic.distance, problem.logic.distance[goal.state]
    return float(np.mean([left[problem.states(x)[-1]] <= limit for x in flown_on(problem, belief)]))


def completed(problem: Problem, belief: Belief) -> float:
    """Share of the flights that have completed the mission by now."""
    return 1.0 - float(Deployment.judged(problem, LAW, flown_on(problem, belief)).failed.mean())
