"""The letters that a flight reads: the label at each step and, between steps, the labels of hazards.

Labels that lead towards acceptance are read only at the steps. Labels that lead away from it are read on the
whole segment between two steps, so that a flight cannot skip over a forbidden region.
"""

from __future__ import annotations

import math

import numpy as np

from plane_kernels.geometry import entry_share, locate_cell
from plane_kernels.types import Cells, FloatArray, IntArray, Point
from plane_logic.types import Logic
from typed_kernels.jit import allocating, inlined, kernel


@inlined
def epoch_at(epoch: IntArray, step: int) -> int:
    """Number of the epoch at a step."""
    return int(epoch[min(step, len(epoch) - 1)])


@inlined
def too_late(logic: Logic, step: int, q: int) -> bool:
    """Whether the labels of ``step`` and of later steps cannot complete the mission from state q."""
    return bool(logic.ahead[epoch_at(logic.epoch, step), q] == math.inf)


@inlined
def rests(logic: Logic, step: int, q: int, cell: int) -> bool:
    """Whether the label of ``cell``, read at the step before ``step``, leaves state q unchanged."""
    return bool(logic.delta[epoch_at(logic.epoch, step - 1), q, cell] == q)


@inlined
def next_state(
    cells: Cells, logic: Logic, step: int, q: int, start: Point, first: int, end: Point, last: int
) -> int:
    """State after ``step``, from ``start`` in cell ``first`` to ``end`` in cell ``last``; -1: no cell.

    Hazards between the steps are read only if the label at ``start`` leaves q unchanged. Otherwise the
    formula counts steps (operator X), and a letter between two steps is not a step.
    """
    state, begun, ended = int(np.int64(q)), int(np.int64(first)), int(np.int64(last))  # one type
    e = epoch_at(logic.epoch, step)
    if len(logic.hazards.cell) > 0 and (begun != ended or begun < 0) and rests(logic, step, state, begun):
        state = meet_hazards(cells, logic, e, state, start, begun, end, ended)
    return int(logic.delta[e, state, ended])


@kernel
def meet_hazards(
    cells: Cells, logic: Logic, e: int, q: int, start: Point, first: int, end: Point, last: int
) -> int:
    """State after the hazards between ``start`` and ``end`` in epoch ``e``, in the order of entry.

    The cells of the two ends are skipped: their labels are read at the steps.
    """
    hazards = logic.hazards
    dx, dy = 0.5 * (end.x - start.x), 0.5 * (end.y - start.y)
    half = math.sqrt(dx * dx + dy * dy)
    middle = Point(start.x + dx, start.y + dy)
    passed = -1.0
    while True:
        share, found = math.inf, -1
        for h in range(len(hazards.cell)):
            cell = hazards.cell[h]
            if not logic.harm[e, q, cell] or cell == first or cell == last:  # noqa: PLR1714, SIM109 - types differ
                continue
            ax, ay = hazards.middle[h, 0] - middle.x, hazards.middle[h, 1] - middle.y
            reach = hazards.radius[h] + half
            if ax * ax + ay * ay > reach * reach:
                continue
            enters = entry_share(cells.faces, cell, start, end)
            if passed < enters < share:
                share, found = enters, cell
        if found < 0:
            return q
        q, passed = int(logic.way[e, q, found]), share


@allocating
def states_along(cells: Cells, logic: Logic, x: FloatArray) -> IntArray:
    """Automaton state after each step of a path ``x`` (T+1, 2) [m]: (T+1,)."""
    states = np.empty(len(x), np.int64)
    at = Point(x[0, 0], x[0, 1])
    cell = locate_cell(cells, at)
    states[0] = logic.delta[logic.epoch[0], logic.initial, cell]
    for t in range(1, len(x)):
        there = Point(x[t, 0], x[t, 1])
        last = locate_cell(cells, there)
        states[t] = next_state(cells, logic, t, states[t - 1], at, cell, there, last)
        at, cell = there, last
    return states
