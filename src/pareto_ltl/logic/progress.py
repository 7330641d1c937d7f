"""What is left of a mission after some of it is done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pareto_ltl.logic.automaton import Automaton, automaton_from_table
from pareto_ltl.logic.dfa import TransitionTable
from pareto_ltl.world.windows import Window


def remaining_automaton(automaton: Automaton, state: int, moment: float = 0.0) -> Automaton:
    """The automaton that goes on from ``state``, whatever label the place of departure shows.

    That label was read before: the first letter of a flight leads to ``state`` from a new initial state. Time
    windows count from ``moment`` [s after the first departure] on.
    """
    delta = np.vstack([np.full((1, len(automaton.letters)), state), automaton.delta]).astype(np.int64) + 1
    accepting = np.concatenate([[False], automaton.accepting])
    text = f"the rest of {automaton.formula}"
    rest = automaton_from_table(TransitionTable(delta, accepting), automaton.letters, automaton.atoms, text)
    return replace(rest, windows=later_windows(automaton.windows, moment), forbidden=automaton.forbidden)


def later_windows(windows: Mapping[str, Window], moment: float) -> dict[str, Window]:
    """``windows`` on a clock that begins at ``moment`` [s]."""
    return {
        name: replace(window, begin=window.begin - moment, end=window.end - moment)
        for name, window in windows.items()
    }


__all__ = ["later_windows", "remaining_automaton"]
