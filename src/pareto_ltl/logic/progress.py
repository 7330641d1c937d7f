"""The rest of a mission after a part of it is done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pareto_ltl.logic.automaton import Automaton, automaton_from_table
from pareto_ltl.logic.dfa import TransitionTable
from pareto_ltl.world.windows import Window


def remaining_automaton(automaton: Automaton, state: int, moment: float = 0.0) -> Automaton:
    """The automaton of the rest of the mission from ``state``, for a flight that departs at ``moment``.

    From a new initial state every letter leads to ``state``, since the label at the position of departure was
    already read. ``moment`` is in [s after the first departure]; time windows then count from there.
    """
    delta = np.vstack([np.full((1, len(automaton.letters)), state), automaton.delta]).astype(np.int64) + 1
    accepting = np.concatenate([[False], automaton.accepting])
    text = f"the rest of {automaton.formula}"
    rest = automaton_from_table(TransitionTable(delta, accepting), automaton.letters, automaton.atoms, text)
    return replace(rest, windows=later_windows(automaton.windows, moment), forbidden=automaton.forbidden)


def later_windows(windows: Mapping[str, Window], moment: float) -> dict[str, Window]:
    """``windows`` with times that count from ``moment`` [s]."""
    return {
        name: replace(window, begin=window.begin - moment, end=window.end - moment)
        for name, window in windows.items()
    }
