"""The formula of the settings in section ``mission``, as it stands there or by the name of a pattern."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ltlf import PatternError, patterns
from pareto_ltl.logic.formula import planner_errors
from pareto_ltl.support import extensions
from pareto_ltl.support.errors import ConfigError

if TYPE_CHECKING:
    from pareto_ltl.settings import MissionConfig

PATTERNS: dict[str, Callable[[MissionConfig], str]] = {
    "sequence": lambda m: patterns.sequence(*m.goals),
    "coverage": lambda m: patterns.coverage(*m.goals),
    "ordered_coverage": lambda m: patterns.ordered_coverage(m.goals, m.order),
    "patrol": lambda m: patterns.patrol(*m.goals),
    "either": lambda m: patterns.either(*m.goals),
    "avoid_until": lambda m: patterns.avoid_until(m.avoid, _single_goal(m, "avoid_until")),
    "reach_avoid": lambda m: patterns.reach_avoid(m.goals, m.avoid),
    "key_door": lambda m: patterns.key_door(*m.order, goal=_single_goal(m, "key_door") if m.goals else None),
}


def formula_of(mission: MissionConfig) -> str:
    """The formula of ``mission.formula`` or ``mission.pattern``; ConfigError if both are set."""
    if mission.pattern is None:
        return mission.formula
    if mission.formula:
        raise ConfigError(f"mission.pattern={mission.pattern} and mission.formula are both set; choose one")
    try:
        make = extensions.PATTERNS.kind(PATTERNS, mission.pattern, callable)
    except KeyError:
        known = ", ".join((*PATTERNS, *extensions.PATTERNS.names()))
        raise ConfigError(f"mission.pattern must be one of {known}; got {mission.pattern!r}") from None
    try:
        with planner_errors():
            return make(mission)
    except PatternError as error:
        raise ConfigError(f"mission pattern {error}") from None


def _single_goal(mission: MissionConfig, pattern: str) -> str:
    if len(mission.goals) != 1:
        raise ConfigError(f"mission pattern {pattern} takes one goal, got {list(mission.goals)}")
    return mission.goals[0]
