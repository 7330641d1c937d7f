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
    return np.random.default_rng(seed).standard_normal((runs, len(problem.own_errors(law).mean)))


def erring_pilot(
    pilot: Pilot, u: FloatArray, law: kd.RobotErrors, errors: FloatArray, *, linear: bool = False
) -> Pilot:
    """``pilot`` of robots whose own errors have the coefficients ``errors`` (n, Q), planned to fly ``u``.

    ``linear``: in the law linearised about the plan, whose mean has the mean of the errors and their
    second-order part.

    Eqs. (M24a) and (M24b) of docs/mathematics.md.
    """
    if not len(law.mean):
        return pilot
    off = errors @ law.root.T
    if linear:
        (a, b, c), (scale, turn, late) = law.mean, off.T
        turned = np.exp(1j * b)
        change = turned * (scale + 1j * (1.0 + a) * turn)
        share, held = 1.0 + change, change * c + turned * (1.0 + a) * late
    else:
        scale, turn, late = (law.mean + off).T
        share = (1.0 + scale) * np.exp(1j * turn)
        held = share * late
    return ErringPilot(pilot, u, np.column_stack([share, held]), np.empty((len(errors), 2)))
