"""What the settings of a plan must have: a map and a mission."""

from __future__ import annotations

from pareto_ltl.settings import MissionConfig, SceneConfig
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import CONF


def require_map(scene: SceneConfig) -> None:
    """Raise ConfigError if there is no map."""
    if not (scene.bounds or scene.file):
        raise ConfigError(
            f"scene is missing: choose a ready mission with +experiment=NAME "
            f"({', '.join(CONF.names('experiment'))}) or a map with scene=NAME "
            f"({', '.join(CONF.names('scene'))})"
        )


def require_formula(mission: MissionConfig) -> None:
    """Raise ConfigError if there is no formula, FormulaError if it cannot be read."""
    if mission.automaton:
        return
    from pareto_ltl.logic.formula import parse_formula, positive_normal_form
    from pareto_ltl.logic.patterns import formula_of

    formula = formula_of(mission)
    if not formula.strip():
        raise ConfigError(
            "mission.formula is missing: choose a ready mission with +experiment=NAME "
            f"({', '.join(CONF.names('experiment'))}) or give one, e.g. \"mission.formula='F(a & F b)'\""
        )
    positive_normal_form(parse_formula(formula))  # the automaton is made of the same tree, from a cache
