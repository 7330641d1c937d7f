"""The automaton of the settings in section ``mission``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from pareto_ltl.logic import hoa, patterns
from pareto_ltl.logic.automaton import Automaton, translate
from pareto_ltl.logic.formula import check_names, parse_formula, positive_normal_form
from pareto_ltl.support.errors import ConfigError, DataError, FormulaError

if TYPE_CHECKING:
    from pareto_ltl.settings import MissionConfig


def automaton_of(
    mission: MissionConfig,
    letters: Iterable[Iterable[str]] | None = None,
    max_states: int = 10_000,
    regions: Iterable[str] | None = None,
) -> Automaton:
    """The automaton of ``mission.formula``, ``mission.pattern`` or the file ``mission.automaton``.

    Parameters
    ----------
    letters : iterable of sets of names, optional
        The labels that can occur on the map; default: all subsets of the propositions.
    regions : iterable of str, optional
        Names of the regions of the map; other names in the mission are an error.

    Raises
    ------
    ConfigError
        If no mission is given, or more than one.
    FormulaError, DataError
        If the formula or the file cannot be used, or names an unknown region.
    """
    text = patterns.formula_of(mission)
    if mission.automaton is not None:
        if text:
            raise ConfigError("mission.automaton is set, and so is a formula or pattern; choose one")
        result = hoa.read_hoa(mission.automaton, letters)
        missing = [name for name in result.atoms if regions is not None and name not in set(regions)]
        if missing:
            have = ", ".join(sorted(set(regions or ()))) or "none"
            raise DataError(f"{mission.automaton}: unknown region '{missing[0]}': the map has {have}")
        return result
    if not text.strip():
        raise ConfigError("mission.formula is missing: give a formula, a pattern or an automaton")
    tree = parse_formula(text)
    if regions is not None:
        check_names(tree, regions)
    return translate(text, letters, max_states)


def region_use(mission: MissionConfig) -> tuple[frozenset[str], frozenset[str]] | None:
    """The propositions that the mission asks for, and those whose absence it asks for; some are in both.

    In positive normal form, a proposition without negation can only help where it holds, one with negation
    only where it does not. None where there is no formula, or none that can be read.
    """
    try:
        text = patterns.formula_of(mission)
        if mission.automaton is not None or not text.strip():
            return None
        tree = positive_normal_form(parse_formula(text))
    except (ConfigError, FormulaError):
        return None  # the automaton says what is wrong
    nodes = list(tree.walk())
    negated = frozenset(node.args[0].name for node in nodes if node.op == "!")
    asked = [tree, *(arg for node in nodes if node.op != "!" for arg in node.args)]
    return frozenset(node.name for node in asked if node.op == "name"), negated


__all__ = ["automaton_of", "region_use"]
