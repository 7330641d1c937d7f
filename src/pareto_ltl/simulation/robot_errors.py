"""The robot's own errors in simulated flights: their draws, and pilots that make them."""

from __future__ import annotations

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.kernels import data as kd
from pareto_ltl.kernels.pilots import ErringPilot, Pilot
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray


def draw_errors(problem: Problem, law: str, runs: int, seed: SeedSequence) -> FloatArray:
    """κ ~ N(0, I) (runs, Q) of the robot's own errors under ``law``; none under the independent law."""
    return np.random.default_rng(seed).standard_normal((runs, len(own_errors(problem, law))))


def own_errors(problem: Problem, law: str) -> FloatArray:
    """Standard deviations (Q,) of the robot's own errors under ``law``; none under the independent law."""
    model = problem.laws[law]
    return kd.EXACT if isinstance(model, kd.IndependentLaw) else model.errors


def erring_pilot(
    pilot: Pilot, u: FloatArray, sd: FloatArray, errors: FloatArray, *, linear: bool = False
) -> Pilot:
    """``pilot`` of robots whose own errors are ``errors`` (n, Q) times ``sd`` (Q,), planned to fly ``u``.

    ``linear``: in the law linearised about the plan, whose mean has the second-order part of the errors.

    Eq. (M24a) of docs/mathematics.md.
    """
    if not len(sd):
        return pilot
    scale, turn, late = (errors * sd).T
    ahead, aside = (
        (1.0 + scale, turn) if linear else ((1.0 + scale) * np.cos(turn), (1.0 + scale) * np.sin(turn))
    )
    return ErringPilot(pilot, u, np.column_stack([ahead, aside, late]), np.empty((len(errors), 2)))
