"""Automata without time windows, in the form that kernels take."""

from __future__ import annotations

import numpy as np

from pareto_ltl.planning.pack_logic import Reading
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from plane_kernels.types import Corners
from plane_logic.types import Logic


def reading_of(
    delta: IntArray,
    distance: FloatArray,
    covers: BoolArray,
    harm: BoolArray,
    loses: BoolArray,
    hazards: Corners,
) -> Reading:
    """The automaton at any step; ``delta``, ``harm`` and ``loses`` (Q, C + 1)."""
    return Reading(delta, delta, harm, loses, distance, covers, 0, hazards)


def one_epoch(read: Reading) -> Logic:
    """The automaton that reads every step like ``read``."""
    tables = (np.ascontiguousarray(table[None]) for table in (read.delta, read.way, read.harm, read.loses))
    return Logic(
        np.zeros(1, np.int64),
        *tables,
        read.distance[None],
        read.distance,
        read.covers,
        read.initial,
        read.hazards,
    )
