"""Epochs: spans of steps in which the same propositions with time windows hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pareto_ltl.logic.automaton import Automaton, Letter
from pareto_ltl.logic.timed import letter_of
from pareto_ltl.support.arrays import IntArray
from pareto_ltl.world.windows import Window


class Epoch(NamedTuple):
    """The windows that hold at a step, at some moment on the way to it, and at the step before."""

    now: frozenset[str]
    way: frozenset[str]
    before: frozenset[str]


def epochs_of(windows: Mapping[str, Window], dt: float, steps: int) -> tuple[IntArray, tuple[Epoch, ...]]:
    """Number of the epoch of each step, (S + 1,), and the epochs, in their order."""
    if not windows:
        nothing = frozenset[str]()
        return np.zeros(steps + 1, np.int64), (Epoch(nothing, nothing, nothing),)
    epochs: list[Epoch] = []
    number = np.empty(steps + 1, np.int64)
    for t in range(steps + 1):
        first, last = dt * max(t - 1, 0), dt * t
        epoch = Epoch(
            frozenset(name for name, window in windows.items() if window.holds_at(last)),
            frozenset(name for name, window in windows.items() if window.meets(first, last)),
            frozenset(name for name, window in windows.items() if window.holds_at(first)),
        )
        if not epochs or epochs[-1] != epoch:
            epochs.append(epoch)
        number[t] = len(epochs) - 1
    return number, tuple(epochs)


def letter_columns(automaton: Automaton, labels: Sequence[Letter], holding: frozenset[str]) -> IntArray:
    """Column of the automaton for each label, and last for none, while the windows ``holding`` are open."""
    letters = [letter_of(label, automaton.windows, holding) for label in (*labels, Letter())]
    return np.array([automaton.letter_index(letter) for letter in letters], np.int64)


__all__ = ["Epoch", "epochs_of", "letter_columns"]
