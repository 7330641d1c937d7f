"""The automaton of the mission that the settings in section ``mission`` describe."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from careful_io.messages import shown_text
from ltlf import Letter
from pareto_ltl.logic import patterns
from pareto_ltl.logic.automaton import Automaton, translate
from pareto_ltl.logic.automaton_formats import automaton_formats
from pareto_ltl.logic.formula import check_names, disputed_reading, parse_formula, positive_normal_form
from pareto_ltl.logic.timed import keep_clear, timed_letters
from pareto_ltl.support.errors import ConfigError, DataError, FormulaError
from pareto_ltl.world.windows import Window, clock_windows

if TYPE_CHECKING:
    from pareto_ltl.settings import MissionConfig

LOG = logging.getLogger(__name__)


def automaton_of(
    mission: MissionConfig,
    labels: Iterable[Letter] | None = None,
    max_states: int = 10_000,
    regions: Iterable[str] | None = None,
    windows: Mapping[str, Window] | None = None,
    forbidden: tuple[str, ...] = (),
) -> Automaton:
    """The automaton of ``mission.formula``, ``mission.pattern`` or the file ``mission.automaton``.

    Parameters
    ----------
    labels : iterable of sets of names, optional
        The labels of the cells of the map; default: all subsets of the propositions.
    max_states : int
        Largest number of states of the automaton.
    regions : iterable of str, optional
        Names of the regions of the map; other names in the mission are an error.
    windows : mapping of proposition to Window, optional
        Time windows of the map.
    forbidden : tuple of str
        Propositions with a time window that must not hold before the mission is complete.

    Raises
    ------
    ConfigError
        If no mission is given, or more than one.
    FormulaError, DataError
        If the formula or the file is not valid, or names an unknown region.
    """
    text = patterns.formula_of(mission)
    if mission.automaton is not None and text:
        raise ConfigError("mission.automaton is set, and so is a formula or pattern; choose one")
    if mission.automaton is None and not text.strip():
        raise ConfigError("mission.formula is missing: give a formula, a pattern or an automaton")
    known = None if regions is None else {*regions, *(windows or {})}
    atoms = _file_atoms(mission.automaton, known) if mission.automaton else _formula_atoms(text, known)
    timed = {name: (windows or {})[name] for name in sorted({*atoms, *forbidden} & set(windows or {}))}
    timed |= clock_windows(atoms)
    shown = list(labels) if labels is not None else None
    letters = timed_letters(shown, timed) if shown is not None and timed else shown
    if mission.automaton is not None:
        result = automaton_formats().read(mission.automaton, letters)
    else:
        result = translate(text, letters, max_states)
    if forbidden and letters is not None:
        result = keep_clear(result, forbidden, letters)
    return replace(result, windows=timed) if timed else result


def read_formula(text: str, letters: Iterable[Iterable[str]] | None = None) -> Automaton:
    """The minimal automaton of a co-safe formula; ``accepts`` returns whether a word completes the mission.

    Operators may be written as in Spot, NuSMV, Spin, papers and TeX, with the precedence of Spot
    (:mod:`ltlf.words`). A text that other tools read in another order is logged with its
    parentheses.

    Parameters
    ----------
    letters : iterable of sets of names, optional
        The labels that can occur; default: all subsets of the propositions.

    Raises
    ------
    FormulaError
        If the text has a syntax error or is not co-safe; the message says what to write instead.
    """
    _formula_atoms(text, None)
    return translate(text, letters)


def _formula_atoms(text: str, known: set[str] | None) -> set[str]:
    """Propositions of a formula, including clocks; FormulaError for a name that is not in ``known``."""
    tree = parse_formula(text)
    if reading := disputed_reading(text):
        LOG.warning("%s", shown_text(reading, 1000))
    if known is not None:
        check_names(tree, known)
    return {*tree.atoms, *positive_normal_form(tree, text).atoms}


def _file_atoms(path: str, known: set[str] | None) -> set[str]:
    """Propositions of an automaton file; DataError for one that is neither ``known`` nor a clock."""
    atoms = automaton_formats().atoms(path)
    missing = [
        name for name in atoms if known is not None and name not in known and not clock_windows([name])
    ]
    if missing:
        have = ", ".join(sorted(known or ())) or "none"
        raise DataError(f"{path}: unknown region '{shown_text(missing[0])}': the map has {have}")
    return set(atoms)


def region_use(mission: MissionConfig) -> tuple[frozenset[str], frozenset[str]] | None:
    """The propositions that occur in the mission without negation, and those with negation.

    This refers to the positive normal form, where a proposition without negation can only help if it holds,
    one with negation only if it does not; a proposition can be in both sets. None if there is no valid
    formula.
    """
    try:
        text = patterns.formula_of(mission)
        if mission.automaton is not None or not text.strip():
            return None
        tree = positive_normal_form(parse_formula(text))
    except (ConfigError, FormulaError):
        return None  # automaton_of raises the error
    nodes = list(tree.walk())
    negated = frozenset(node.args[0].name for node in nodes if node.op == "!")
    requested = [tree, *(arg for node in nodes if node.op != "!" for arg in node.args)]
    return frozenset(node.name for node in requested if node.op == "name"), negated
