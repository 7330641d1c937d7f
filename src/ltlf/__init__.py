"""Temporal logic on finite words: from a co-safe formula to the minimal automaton of its good prefixes.

    import ltlf

    dfa = ltlf.translate("!b U a & F b")         # a before b, and then b
    dfa.accepts([{"a"}, {"b"}]), dfa.step(0, {"b"})
    dfa.to_hoa()                                 # for Spot and others, in the Hanoi omega-automata format
    ltlf.parse_formula("◇ (a ∧ b)")              # operators as in Spot, NuSMV, papers, TeX
    ltlf.patterns.sequence("a", "b", "c")        # texts of common formulas

A formula must be syntactically co-safe: if a word satisfies it, a finite prefix decides so. The message of a
:class:`FormulaError` says what to write instead, in the words that an application gives as :class:`Advice`.

``formula`` ``words`` ``spans``  the syntax tree, its parser, the words and time spans that it reads
``normal_form``                  negation of propositions only; what is not co-safe
``progression`` ``dfa``          obligations after each letter; tables: product, minimisation, inclusion
``automaton`` ``labels`` ``hoa`` the automaton; sets of letters as short expressions; HOA text

Nothing here knows what propositions stand for; only clocks depend on the time.
"""

from ltlf import patterns
from ltlf.advice import Advice
from ltlf.automaton import Dfa, Letter, alphabet_of, letter_codes, minimal_dfa, show_letter, translate
from ltlf.dfa import TransitionTable
from ltlf.errors import FormulaError, PatternError, StatesError
from ltlf.formula import Formula, disputed_reading, parse_formula, written_name
from ltlf.normal_form import positive_normal_form
from ltlf.spans import clock_span
from ltlf.texts import caret_lines, name_fault

__all__ = [
    "Advice",
    "Dfa",
    "Formula",
    "FormulaError",
    "Letter",
    "PatternError",
    "StatesError",
    "TransitionTable",
    "alphabet_of",
    "caret_lines",
    "clock_span",
    "disputed_reading",
    "letter_codes",
    "minimal_dfa",
    "name_fault",
    "parse_formula",
    "patterns",
    "positive_normal_form",
    "show_letter",
    "translate",
    "written_name",
]
