"""The branch of a plan that a position fix selects, and what the robot then flies off."""

from __future__ import annotations

import numpy as np

from pareto_ltl.extend import Branch, Plan, Problem
from pareto_ltl.support.arrays import FloatArray


def selected_branch(plan: Plan, time: float, place: FloatArray) -> tuple[Branch, FloatArray] | None:
    """The branch of a position ``place`` (2,) [m] measured at ``time`` [s after departure].

    And what is added to its velocities (2,) [m/s] for ``branching.fix.rejoin`` steps. None if the plan has no
    branches, or the time is more than half a step from the one of its fix. A position is moved to the time of
    the fix by what the plan flies in between.
    """
    tree = plan.branching
    if tree is None:
        return None
    late = time / plan.dt - tree.fix.step
    if abs(late) > 0.5:
        return None
    x, k = plan.path.x, tree.fix.step
    beside = x[k + (1 if late > 0.0 else -1)]
    there = place - abs(late) * (beside - x[k])
    return tree.branches[int(tree.chosen(there[None])[0])], tree.fix.change(there, plan.dt)


def rejoining(problem: Problem, steps: slice, change: FloatArray, u: FloatArray) -> FloatArray:
    """The controls ``u`` (T, 2) [m/s] with ``change`` (2,) [m/s] in some ``steps``, within the airspeeds."""
    motion, changed = problem.motion, u.copy()
    changed[steps] += change @ motion.b_inv.T
    speed = np.maximum(np.hypot(*changed[steps].T), 1e-9)
    changed[steps] *= (np.clip(speed, motion.u_min, motion.u_max) / speed)[:, None]
    return changed
