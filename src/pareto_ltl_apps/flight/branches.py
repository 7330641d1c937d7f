"""The branch of a plan that a position fix selects."""

from __future__ import annotations

from pareto_ltl.extend import Branch, Plan
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
