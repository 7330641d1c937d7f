"""The air that a flight needs: the area of its ellipses along the path, times how long it is held."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from careful_io.times import HOUR
from pareto_ltl.planning.cost import cost
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem

DEVIATIONS = 3.0  # half axes of the ellipses, in standard deviations: 98.9 % of a Gaussian


def air_text(amount: float) -> str:
    """An area times a time [km² h] as text.

    >>> air_text(48_210.0), air_text(0.51234)
    ('48,210 km² h', '0.512 km² h')
    """
    return f"{amount:,.0f} km² h" if amount >= 100.0 else f"{amount:.3g} km² h"


@cost("air_km2_h", air_text, "area and time that hold it", "air [km² h]")
def containment(problem: Problem, x: FloatArray, _u: FloatArray) -> float:
    """Area times time of ellipses of three standard deviations that are swept along each step [km² h].

    Eq. (M78) of docs/mathematics_methods.md.
    """
    from pareto_ltl.planning.evaluate import propagate
    from pareto_ltl.support.arrays import square_matrices

    cov = square_matrices(propagate(problem, np.ascontiguousarray(x)).cov)
    middle, steps = 0.5 * (cov[:-1] + cov[1:]), np.diff(x, axis=0)
    across = np.stack([-steps[:, 1], steps[:, 0]], axis=1)  # as long as the step
    ellipse = np.pi * DEVIATIONS**2 * np.sqrt(np.maximum(np.linalg.det(middle), 0.0))
    swept = 2.0 * DEVIATIONS * np.sqrt(np.maximum(np.einsum("ti,tij,tj->t", across, middle, across), 0.0))
    return float((ellipse + swept).sum() * 1e-6 * problem.motion.dt / HOUR)
