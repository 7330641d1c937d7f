"""Delayed lines, for time windows that open after a robot at full speed would arrive."""

from __future__ import annotations

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.sampled import resampled_means
from pareto_ltl.planning.routes.obligations import completes
from pareto_ltl.support.arrays import FloatArray

SHUTTLE = 0.8  # share of a full step that a robot with a least airspeed flies to and fro where it waits
TOO_SLOW = 0.8  # of the least airspeed: refinement lengthens a line that is flown a little too slowly
STOPS = 12  # places along a line at which a stop is tried


def retimed_means(
    problem: Problem, x: FloatArray, steps: int, needed: FloatArray | None = None
) -> FloatArray:
    """The line of ``x`` (T+1, 2) in ``steps`` steps; paced anew if these times do not complete the mission.

    Where pacing does not help, ``x`` is returned. ``needed`` as for
    :func:`~pareto_ltl.planning.refine.sampled.resampled_means`.
    """
    y = resampled_means(problem, x, steps, needed)
    if len(problem.logic.delta) == 1 or completes(problem, y) or not completes(problem, x):
        return y
    y = paced_line(problem, y)
    return y if completes(problem, y) else x


def paced_line(problem: Problem, x: FloatArray) -> FloatArray:
    """``x`` (T+1, 2) flown more slowly, or with a stop on the way, if only that completes the mission.

    Lines are walked at full speed, and may arrive before a window opens, or while a region is still
    forbidden. First the whole line is slowed down, as little as necessary and hardly below the least
    airspeed; then stops are tried, the shortest first. Without time windows, and if neither helps, ``x`` is
    returned.
    """
    if len(problem.logic.delta) == 1 or completes(problem, x):
        return x
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
    slowest = TOO_SLOW * problem.motion.u_min * problem.motion.dt
    most = problem.horizon if slowest == 0.0 else min(problem.horizon, int(along[-1] / slowest))
    for steps in range(len(x), most + 1):
        even = np.linspace(0.0, along[-1], steps + 1)
        slow = np.stack([np.interp(even, along, x[:, k]) for k in (0, 1)], axis=1)
        if completes(problem, slow):
            return slow
    for stop in range(1, problem.horizon + 2 - len(x)):
        for t in range(len(x) - 1, -1, -max(1, len(x) // STOPS)):
            late = np.concatenate([x[:t], _waiting(problem, x, t, stop), x[t + 1 :]])
            if completes(problem, late):
                return late
    return x


def _waiting(problem: Problem, x: FloatArray, t: int, stop: int) -> FloatArray:
    """Position t of ``x`` and ``stop`` more: the same or, with a least airspeed, to and fro on the line."""
    there = np.repeat(x[t : t + 1], stop + 1, axis=0)
    if problem.motion.u_min > 0.0:
        other = x[t - 1] if t else x[1]
        way = other - x[t]
        there[1::2] += way * min(1.0, SHUTTLE * problem.reach / max(float(np.hypot(*way)), 1e-9))
    return there
