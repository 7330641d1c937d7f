"""What a step owes the mission, and how the means move: exact, also for what may not be flown."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pareto_ltl.kernels import data as kt
from pareto_ltl.planning.problem import Problem, trail
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Duties:
    """What the automaton asks of each step of a path.

    Attributes
    ----------
    q : (T+1,) int
        Planned automaton state after each step.
    witness : tuple of (step, part)
        Convex parts of regions that hold the position at a step.
    avoid : (T+1, C) bool
        Cells whose label would spoil the plan at a step.
    """

    q: IntArray
    witness: tuple[tuple[int, int], ...]
    avoid: BoolArray


def duties(problem: Problem, x: FloatArray, cov: FloatArray) -> Duties:
    """Read off what must hold for the means ``x`` (T+1, 2) to do what they do.

    A transition is put off to the safest step of the same visit, where the automaton does not mind.
    """
    logic = problem.tables.logic
    cell = problem.locate(x)
    q = _states(logic, cell)
    missed = _missed(problem, x, cov)
    before = np.concatenate([[logic.initial], q[:-1]])
    planned, witness = q.copy(), []
    for t in np.flatnonzero(q != before):
        parts = _needed(problem, x[t], int(before[t]), int(q[t]), int(cell[t]))
        if not parts:
            continue
        best = t
        if logic.covers[q[t], before[t]]:
            last = t
            while last + 1 < len(x) and q[last + 1] == q[t]:
                last += 1
            risk = missed[t : last + 1, parts].sum(axis=1)
            held = np.all(_slack(problem, x[t : last + 1])[:, parts] > 0.0, axis=1)
            held[0] = True
            best = t + int(np.argmin(np.where(held, risk, np.inf)))
        planned[t:best] = before[t]
        witness += [(int(best), part) for part in parts]
    return Duties(planned, tuple(witness), _spoiling(problem, planned))


def _states(logic: kt.Logic, cell: IntArray) -> IntArray:
    q, state = np.empty(len(cell), np.int64), logic.initial
    for t, c in enumerate(cell):
        state = q[t] = logic.delta[state, c]  # c = -1 is the column of no label
    return q


def _needed(problem: Problem, x: FloatArray, before: int, after: int, cell: int) -> list[int]:
    """Convex parts that must hold ``x`` for the step from ``before`` to ``after``."""
    logic, label = problem.tables.logic, problem.labels[cell] if cell >= 0 else frozenset()
    if logic.covers[logic.delta[before, -1], after]:
        return []
    column = {shown: c for c, shown in enumerate(problem.labels)} | {frozenset(): len(problem.labels)}
    atoms = [
        a for a in sorted(label & set(problem.atoms))
        if label - {a} not in column or not logic.covers[logic.delta[before, column[label - {a}]], after]
    ] or sorted(label & set(problem.atoms))[:1]  # fmt: skip
    slack = _slack(problem, x[None])[0]
    parts = [np.flatnonzero(problem.tables.regions.atom == problem.atoms.index(a)) for a in atoms]
    return [int(p[np.argmax(slack[p])]) for p in parts if len(p)]


def _spoiling(problem: Problem, q: IntArray) -> BoolArray:
    """Cells with a label whose reading at step t leads to no state as good as the planned one."""
    logic = problem.tables.logic
    labelled = np.array([bool(label) for label in problem.labels], bool)
    before = np.concatenate([[logic.initial], q[:-1]])
    return np.asarray(~logic.covers[logic.delta[before][:, :-1], q[:, None]] & labelled, bool)


def _slack(problem: Problem, x: FloatArray) -> FloatArray:
    """Distance to the nearest face of every region part, positive inside, (T+1, parts)."""
    faces = problem.tables.regions.faces
    return np.asarray(np.minimum.reduceat(faces.offset - x @ faces.normal.T, faces.ptr[:-1], axis=1), float)


def _missed(problem: Problem, x: FloatArray, cov: FloatArray) -> FloatArray:
    """Eq. (6) of every region part, (T+1, parts)."""
    from scipy.special import ndtr

    faces = problem.tables.regions.faces
    gap, sd = faces.offset - x @ faces.normal.T, _deviation(faces.normal, cov)
    return np.asarray(np.add.reduceat(ndtr(-gap / np.maximum(sd, 1e-3)), faces.ptr[:-1], axis=1), float)


def _deviation(normal: FloatArray, cov: FloatArray) -> FloatArray:
    """√(c_k' Σ_t c_k) of every step and face, (T+1, F); ``cov`` (T+1, 3) holds xx, xy, yy."""
    n = normal.T
    variance = cov @ np.stack([n[0] ** 2, 2 * n[0] * n[1], n[1] ** 2])
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), float)


# --- exact motion, also of what may not be flown -----------------------------------------------


def propagate(problem: Problem, x: FloatArray) -> FloatArray:
    """Covariances (T+1, 3) along means that may be too fast or cross an obstacle.

    The kernel of the exact evaluation runs on an empty map, so nothing is written down twice.
    """
    from pareto_ltl.kernels import path as kernel

    far = 1e12
    none = kt.Faces(np.zeros(1, np.int64), np.empty((0, 2)), np.empty(0))
    box = kt.Faces(
        np.array([0, 4]), np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]), np.full(4, far)
    )
    zero, one = np.zeros(1, np.int64), np.array([0, 1])
    open_map = problem.tables._replace(
        obstacles=none, regions=kt.Regions(none, np.empty(0, np.int64)),
        cells=kt.Cells(-far, -far, far, far, 1, one, zero, box, np.zeros((1, 0), bool)),
        logic=kt.Logic(
            np.zeros((1, 2), np.int64), np.zeros(1), np.ones((1, 1), bool), np.zeros((1, 2, 1), bool), 0
        ),
    )  # fmt: skip
    n = len(x)
    cov = np.empty((n, 3))
    kernel.evaluate(
        open_map, np.ascontiguousarray(x), problem.start_variance, math.inf, cov, np.empty((n - 1, 2)),
        np.empty(n, np.int64), np.empty(n, np.int64), np.empty(0), np.empty((n, 0)),
        trail(problem, n), np.empty(n),
    )  # fmt: skip
    return cov


def mean_shift(problem: Problem, x: FloatArray) -> FloatArray:
    """What controls steer against besides the expected wind (T, 2) [m/s]: 0 of paper fidelity."""
    from pareto_ltl.kernels import path as kernel

    shift = np.zeros((len(x) - 1, 2))
    if problem.tables.full:
        course = trail(problem, len(x))
        kernel.mean_shift(problem.tables, np.ascontiguousarray(x), problem.start_variance, course, shift)
    return shift


def allowed(problem: Problem, x: FloatArray) -> FloatArray:
    """Share of u_max left for the control of each step by feedback and fixes, (T,)."""
    from pareto_ltl.kernels import path as kernel

    motion = problem.tables.motion
    speed = np.full(len(x) - 1, motion.u_max)
    if motion.gain > 0.0 or len(problem.tables.landmarks.ptr) > 1:
        course = trail(problem, len(x))
        kernel.speeds(problem.tables, np.ascontiguousarray(x), problem.start_variance, course, speed)
    return np.asarray(speed / motion.u_max, float)


def wind_and_gradient(problem: Problem, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """μ(x_t, t) (T, 2) [m/s] and Dμ (T, 2, 2) [1/s] at the rows of ``x``, one a step.

    μ is bilinear on the lattice, so ∂μ/∂x runs linearly between the differences along the cell's lower and
    upper side. Beyond the lattice the wind is constant.
    """
    wind = problem.tables.wind
    top = np.array(wind.mean.shape[1:3]) - 1
    g = (x - [wind.west, wind.south]) * wind.per_metre
    inside = (g >= 0) & (g <= top)
    g = np.clip(g, 0, top)
    i, j = np.minimum(g.astype(np.int64), top - 1).T
    fx, fy = (g - np.column_stack([i, j])).T[..., None]
    k, w = wind.slot[: len(x)], wind.weight[: len(x), None]
    after = np.minimum(k + 1, len(wind.mean) - 1)
    (c00, c10), (c01, c11) = (
        [(1 - w) * wind.mean[k, i + a, j + b] + w * wind.mean[after, i + a, j + b] for a in (0, 1)]
        for b in (0, 1)
    )
    mean = (1 - fy) * ((1 - fx) * c00 + fx * c10) + fy * ((1 - fx) * c01 + fx * c11)
    along = (1 - fy) * (c10 - c00) + fy * (c11 - c01)
    across = (1 - fx) * (c01 - c00) + fx * (c11 - c10)
    gradient = np.stack([along, across], axis=-1) * wind.per_metre * inside[:, None, :]
    return mean, gradient
