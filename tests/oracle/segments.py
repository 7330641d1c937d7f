"""Letters that are read between steps, in plain NumPy: the readable form of ``plane_logic.letters``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl_verify.gaussians import crossing
from pareto_ltl_verify.geometry import convex

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem

INSIDE = 1e-6  # [m] a segment that is less deep in a cell does not meet it


def cells_on_the_way(problem: Problem, start: FloatArray, end: FloatArray) -> IntArray:
    """Cells whose interior the segment meets, in the order in which it enters them.

    A convex cell holds the shares of the segment between the last face entered and the first one left.
    """
    faces = problem.cells.faces
    enters = []
    for cell in range(len(faces.ptr) - 1):
        rows = slice(faces.ptr[cell], faces.ptr[cell + 1])
        gap = faces.offset[rows] - INSIDE - faces.normal[rows] @ start
        rate = faces.normal[rows] @ (end - start)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            share = gap / rate
        low = np.max(share[rate < 0], initial=0.0)
        high = np.min(share[rate > 0], initial=1.0)
        if low < high and (gap[rate == 0] > 0).all():
            enters.append((low, cell))
    return np.array([cell for _, cell in sorted(enters)], np.int64)


def state_on_the_way(problem: Problem, q: int, ends: FloatArray, cells: tuple[int, int], step: int) -> int:
    """State after the harmful letters between ``ends`` (2, 2) on the way to ``step``.

    ``cells`` are the cells of the ends, whose labels are letters of steps.
    """
    logic = problem.reading(step)
    if problem.reading(step - 1).delta[q, cells[0]] != q:  # the state depends on the number of steps
        return q
    for met in cells_on_the_way(problem, *ends):
        if met not in cells and logic.harm[q, met]:
            q = int(logic.way[q, met])
    return q


def states_of_flight(problem: Problem, x: FloatArray) -> IntArray:
    """Automaton state after each step of ``x`` (T+1, 2): harmful letters on the way, then the label."""
    cell = problem.locate(x)
    q = int(problem.reading(0).delta[problem.logic.initial, cell[0]])
    states = [q]
    for t in range(1, len(x)):
        q = state_on_the_way(problem, q, x[t - 1 : t + 1], (int(cell[t - 1]), int(cell[t])), t)
        q = int(problem.reading(t).delta[q, cell[t]])
        states.append(q)
    return np.array(states, np.int64)


def meeting_bounds(problem: Problem, x: FloatArray, cov: FloatArray) -> FloatArray:
    """Bounds on P(step t meets hazard h), (T+1, H); row 0 bounds P(start in the hazard).

    P(segment meets a convex polygon) ≤ min over lines beside it of P(one end not beyond) + P(other end not
    beyond): the lines of its faces, and the nearest one along the line through both means.

    Eq. (M38) of docs/mathematics.md.
    """
    parts = [convex(problem.decomposition.cells[cell]) for cell in problem.logic.hazards.cell]
    ends = [slice(max(t - 1, 0), t + 1) for t in range(len(x))]
    bounds = [[crossing(part, x[rows], cov[rows]) for part in parts] for rows in ends]
    return np.array(bounds).reshape(len(x), len(parts))


def hazard_costs(problem: Problem, x: FloatArray, cov: FloatArray) -> FloatArray:
    """Σ_h P(hazard h met), over those whose label loses q, (T+1, Q)."""
    met, hazards = meeting_bounds(problem, x, cov), problem.logic.hazards.cell
    return np.array([met[t] @ problem.reading(t).loses[:, hazards].T for t in range(len(x))], float)
