"""The branch of a plan that a position fix selects, and what the robot then flies off."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from pareto_ltl.extend import Branch, Branching, Plan, Problem
from pareto_ltl.support.arrays import FloatArray

Changes: TypeAlias = tuple[FloatArray, FloatArray]  # of velocities (2,) [m/s], at first and later on


def selected_branch(plan: Plan, time: float, place: FloatArray) -> tuple[Branch, Changes] | None:
    """The branch of a position ``place`` (2,) [m] measured at ``time`` [s after departure].

    And what is added to its velocities (2,) [m/s] for ``branching.fix.rejoin`` steps, and later on. None if
    the plan has no branches, or the time is more than half a step from the one of its fix. A position is
    moved to the time of the fix by what the plan flies in between.
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
    return tree.branches[int(tree.chosen(there[None])[0])], tree.fix.changes(there, plan.dt)


def rejoining(problem: Problem, tree: Branching, changes: Changes, u: FloatArray) -> FloatArray:
    """The controls ``u`` (T, 2) [m/s] with ``changes`` after the fix of ``tree``, within the airspeeds."""
    fix, motion, changed = tree.fix, problem.motion, u.copy()
    end = fix.step + fix.rejoin
    for steps, change in zip((slice(fix.step, end), slice(end, None)), changes, strict=True):
        if not change.any():
            continue
        changed[steps] += change @ motion.b_inv.T
        speed = np.maximum(np.hypot(*changed[steps].T), 1e-9)
        changed[steps] *= (np.clip(speed, motion.u_min, motion.u_max) / speed)[:, None]
    return changed
