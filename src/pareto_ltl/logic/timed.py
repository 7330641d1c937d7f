"""Propositions with time windows, automata with forbidden ones, and the rest of a partly done mission."""

from __future__ import annotations

import math
import operator
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from itertools import accumulate, pairwise

import numpy as np

from ltlf import Letter, TransitionTable
from pareto_ltl.logic.automaton import Automaton, alphabet_of, automaton_from_table
from pareto_ltl.support.errors import FormulaError
from pareto_ltl.world.windows import Window

MAX_LETTERS = 200_000


def letter_of(label: Letter, windows: Mapping[str, Window], holding: Collection[str]) -> Letter:
    """The propositions that hold in a cell with ``label`` while the windows ``holding`` are open.

    A region that has a time window under its own name holds only during that window.
    """
    return frozenset(name for name in label if name not in windows) | frozenset(
        name for name in holding if windows[name].region is None or windows[name].region in label
    )


def places_of(label: Letter, windows: Mapping[str, Window]) -> Letter:
    """The propositions, without clocks, that hold in a cell with ``label`` at some time."""
    return frozenset(name for name in label if name not in windows) | frozenset(
        name for name, window in windows.items() if window.region in label
    )


def timed_letters(labels: Iterable[Letter], windows: Mapping[str, Window]) -> set[Letter]:
    """All letters of cells with these ``labels``, at steps and between two steps.

    FormulaError if there are more than ``MAX_LETTERS``.
    """
    shown = set(labels)
    patterns = window_patterns(windows)
    if len(shown) * len(patterns) > MAX_LETTERS:
        raise FormulaError(
            f"{len(windows)} time windows open and close in {len(patterns)} ways; leave some of them out"
        )
    return {letter_of(label, windows, holding) for label in shown for holding in patterns}


def window_patterns(windows: Mapping[str, Window]) -> set[Letter]:
    """The sets of windows that hold at some moment after departure or during some time span."""
    ends = (t for window in windows.values() for t in (window.begin, window.end))
    marks = sorted({0.0, *(t for t in ends if 0.0 < t < math.inf)})
    moments = sorted({*marks, *((a + b) / 2 for a, b in pairwise(marks)), marks[-1] + 1.0})
    now = [frozenset(name for name, window in windows.items() if window.holds_at(t)) for t in moments]
    return {together for first in range(len(now)) for together in accumulate(now[first:], operator.or_)}


def keep_clear(automaton: Automaton, names: tuple[str, ...], labels: Iterable[Letter]) -> Automaton:
    """``automaton`` with a trap: the mission fails if a proposition of ``names`` holds before it is complete.

    ``labels`` are the letters that can occur, including these propositions.
    """
    atoms = tuple(sorted({*automaton.atoms, *names}))
    alphabet = alphabet_of(atoms, labels)
    trap = automaton.n_states
    column = [automaton.letter_index(letter) for letter in alphabet]
    bad = np.array([not letter.isdisjoint(names) for letter in alphabet], bool)
    delta = np.vstack([automaton.delta[:, column], np.full(len(alphabet), trap)])
    delta[:trap][:, bad] = np.where(automaton.accepting[:, None], delta[:trap][:, bad], trap)
    table = TransitionTable(delta, np.append(automaton.accepting, False))
    found = automaton_from_table(table, alphabet, atoms, automaton.formula)
    return replace(found, forbidden=names)
