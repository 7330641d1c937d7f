"""The landmarks that a path crosses."""

from __future__ import annotations

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.routes.search_map import meets
from pareto_ltl.support.arrays import BoolArray, FloatArray


def sights(problem: Problem, x: FloatArray) -> BoolArray:
    """Whether each leg of the means ``x`` (T+1, 2) [m] crosses each landmark, (T, K)."""
    import shapely

    crossed = np.zeros((max(len(x) - 1, 0), len(problem.landmarks)), bool)
    for k, corners in enumerate(problem.landmarks):
        crossed[:, k] = meets(shapely.Polygon(corners), x[:-1], x[1:])
    return crossed
