"""Whether given positions complete the mission, shared by the suites of simulation."""

from __future__ import annotations

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray
from plane_kernels.geometry import segments_touch
from plane_logic.letters import states_along


def succeeds(problem: Problem, x: FloatArray) -> bool:
    """Whether positions ``x`` (T+1, 2) complete the mission, clear of obstacles and of walls, if any."""
    q = states_along(problem.cells, problem.logic, x)[-1]
    (west, south), (east, north) = problem.scene.bounds
    inside = bool(((x >= [west, south]) & (x <= [east, north])).all())
    hit = bool(segments_touch(problem.obstacles, np.hstack([x[:-1], x[1:]])).any())
    return bool(problem.automaton.distance[q] == 0.0) and not hit and (inside or not problem.scene.walled)
