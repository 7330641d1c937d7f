"""Epochs: spans of consecutive steps in which the same time windows are open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pareto_ltl.kernels.data import Corners
from pareto_ltl.logic.automaton import Automaton, Letter
from pareto_ltl.logic.timed import letter_of
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.world.windows import Window


class Epoch(NamedTuple):
    """Names of the windows open at a step (``now``) and at some time of the segment before it (``way``)."""

    now: frozenset[str]
    way: frozenset[str]


class Reading(NamedTuple):
    """The automaton at one step, for code outside the kernels.

    ``delta`` (Q, C + 1), the last column for no label (obstacles, off the map); ``distance`` (Q,) the fewest
    letters to acceptance among those that this and later epochs show, inf where it cannot be reached.

    On the segment between two steps, letters that lead away from acceptance are read as well: they take q to
    ``way`` (Q, C + 1). They are read only in states that the label of the first step leaves unchanged.
    ``harm`` (Q, C + 1): the label is worse in q than no label, or ends in the trap; ``loses`` (Q, C + 1):
    meeting the label may take a state as good as q to one that is not.
    """

    delta: IntArray
    way: IntArray
    harm: BoolArray
    loses: BoolArray
    distance: FloatArray
    covers: BoolArray
    initial: int
    hazards: Corners


def epochs_of(windows: Mapping[str, Window], dt: float, steps: int) -> tuple[IntArray, tuple[Epoch, ...]]:
    """Index of the epoch of each step 0 to ``steps`` of ``dt`` [s], (S + 1,), and the epochs in order."""
    if not windows:
        nothing = frozenset[str]()
        return np.zeros(steps + 1, np.int64), (Epoch(nothing, nothing),)
    epochs: list[Epoch] = []
    number = np.empty(steps + 1, np.int64)
    for t in range(steps + 1):
        first, last = dt * max(t - 1, 0), dt * t
        epoch = Epoch(
            frozenset(name for name, window in windows.items() if window.holds_at(last)),
            frozenset(name for name, window in windows.items() if window.meets(first, last)),
        )
        if not epochs or epochs[-1] != epoch:
            epochs.append(epoch)
        number[t] = len(epochs) - 1
    return number, tuple(epochs)


def step_epochs(epoch: IntArray, count: int) -> IntArray:
    """Epoch of each of the first ``count`` steps; ``epoch`` (S + 1,) as in :class:`Logic`."""
    return epoch[np.minimum(np.arange(count), len(epoch) - 1)]


def letter_columns(automaton: Automaton, labels: Sequence[Letter], holding: frozenset[str]) -> IntArray:
    """Automaton column of each label and, last, of no label, while the windows ``holding`` are open."""
    letters = [letter_of(label, automaton.windows, holding) for label in (*labels, Letter())]
    return np.array([automaton.letter_index(letter) for letter in letters], np.int64)
