"""One solve of the sampled refinement, for tests that compare it with other statements."""

from __future__ import annotations

import numpy as np

from pareto_ltl.kernels import descent as kernel
from pareto_ltl.kernels.attraction import NEAREST
from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.convex.programme import Descent, path_limits, step_memory
from pareto_ltl.planning.margin_model import margin_model, margin_scratch
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray
from plane_logic.margin import Slope


def next_means(
    problem: Problem, flight: Flight, descent: Descent, trust: float, longest: float
) -> FloatArray | None:
    """Means (T+1, 2) [m] that minimise the model about those of ``flight``; None: the solver has none."""
    y = np.empty_like(flight.x)
    scratch = margin_scratch(margin_model(problem), 1, len(y))
    memory = kernel.Memory(*step_memory(problem, len(flight.u)), scratch, np.empty(NEAREST, np.int64))
    here = kernel.Guess(flight, Slope(descent.gradient, descent.hessian))
    law, limits = problem.world.law, path_limits(problem)
    solved = kernel.next_means(law, limits, here, descent.value, trust, longest, memory, y)
    return y if solved else None
