"""Missions: syntactically co-safe LTL formulas and their minimal automata."""

from __future__ import annotations

from pareto_ltl.logic.automaton import Automaton, translate
from pareto_ltl.logic.formula import Formula, check_names, parse_formula
from pareto_ltl.logic.normal_form import positive_normal_form
from pareto_ltl.support.errors import FormulaError

__all__ = [
    "Automaton",
    "Formula",
    "FormulaError",
    "check_names",
    "parse_formula",
    "positive_normal_form",
    "translate",
]
