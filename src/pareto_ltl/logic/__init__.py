"""Missions: syntactically co-safe LTL formulas and their minimal automata."""

from __future__ import annotations

from ltlf import Formula
from pareto_ltl.logic.automaton import Automaton, translate
from pareto_ltl.logic.formula import check_names, parse_formula, positive_normal_form
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
