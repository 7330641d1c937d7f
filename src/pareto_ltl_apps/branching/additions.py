"""What the planner asks of this application: the entry point in ``pareto_ltl.plan_additions``."""

from __future__ import annotations

from pareto_ltl import Run, Settings
from pareto_ltl.extend import Plan, PlanAddition, Problem
from pareto_ltl_apps.branching.settings import BranchConfig


def _wanted(settings: Settings) -> bool:
    return settings[BranchConfig].leaves > 1


def _without_steering(problem: Problem) -> Problem:
    """The robot flies tables: a fix chooses one, and steers nothing."""
    return problem.with_feedback(None)


def _branched(run: Run, plan: Plan) -> Plan:
    from pareto_ltl_apps.branching.stage import branched_plan

    return branched_plan(run, plan)


BRANCHES = PlanAddition(_wanted, _without_steering, _branched)
