"""What other packages add to plans before they are priced and written: ``pareto_ltl.plan_additions``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pareto_ltl.support.extensions import PLAN_ADDITIONS

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import Plan
    from pareto_ltl.run.plan_run import Run
    from pareto_ltl.settings import Settings


@dataclass(frozen=True, slots=True)
class PlanAddition:
    """What is added to the plans of runs whose settings ask for it, e.g. branches at a position fix.

    Attributes
    ----------
    wanted : function
        Whether the settings ask for it.
    problem : function
        The problem that paths are searched for in, from the usual one.
    plan : function
        The plan of a run, from the plan that the rule picks; it may be of another path of the front.
    """

    wanted: Callable[[Settings], bool]
    problem: Callable[[Problem], Problem]
    plan: Callable[[Run, Plan], Plan]


def additions_to_plans(settings: Settings) -> Iterator[PlanAddition]:
    """The additions that ``settings`` ask for, by the names of their entry points."""
    found = PLAN_ADDITIONS.load_all(lambda loaded: isinstance(loaded, PlanAddition))
    return (addition for addition in found if addition.wanted(settings))
