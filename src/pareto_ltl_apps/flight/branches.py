"""The branch that a position fix selects, and the plan from there on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pareto_ltl.extend import Branch, Plan, PlannedPath
from pareto_ltl.support.arrays import FloatArray


def selected_branch(plan: Plan, time: float, place: FloatArray) -> Branch | None:
    """The branch of a position ``place`` (2,) [m] measured at ``time`` [s after departure].

    None if the plan has no branches, or the time is more than half a step from the one of its fix. A position
    is moved to the time of the fix by what the plan flies in between.
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
    return tree.branches[int(tree.chosen(there[None])[0])]


def plan_on_branch(plan: Plan, branch: Branch) -> Plan:
    """``plan`` up to its fix, then ``branch``: its promise is the rate of flights that fly the branch."""
    tree = plan.branching
    assert tree is not None
    promise = None if plan.promise is None else replace(plan.promise, rate=branch.rate)
    path = joined_path(plan.path, branch.path, tree.fix.step)
    return replace(plan, path=path, promise=promise, branching=None, limits=None, prices=(), navigation=None)


def joined_path(trunk: PlannedPath, rest: PlannedPath, step: int) -> PlannedPath:
    """The steps of ``trunk`` before ``step``, then ``rest``."""

    def joined(name: str) -> FloatArray:
        return np.concatenate([getattr(trunk, name)[:step], getattr(rest, name)])

    return replace(
        trunk, t=joined("t"), x=joined("x"), cov=joined("cov"), u=joined("u"),
        q=np.concatenate([trunk.q[:step], rest.q]), label=(*trunk.label[:step], *rest.label),
        origin=rest.origin, order=rest.order,
    )  # fmt: skip
