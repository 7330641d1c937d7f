"""Plans get branches if the settings ask for them, by an entry point."""

from __future__ import annotations

from landmarks import landmark_problem
from pareto_ltl import Settings
from pareto_ltl.run.plan_additions import additions_to_plans
from pareto_ltl_apps.branching.additions import BRANCHES
from pareto_ltl_apps.branching.settings import BranchConfig


def test_only_settings_with_several_branches_ask_for_them() -> None:
    settings = Settings()
    assert list(additions_to_plans(settings)) == []
    branched = settings.with_sections(BranchConfig(leaves=2, at=[5.0]))
    assert list(additions_to_plans(branched)) == [BRANCHES]


def test_fixes_of_a_plan_that_branches_steer_nothing() -> None:
    problem = landmark_problem()
    assert len(problem.landmarks) > 0
    assert BRANCHES.problem(problem).landmarks == ()
