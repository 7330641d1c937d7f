"""The changes of course along a path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.planning.cost import cost
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem


STILL = 1e-9  # [m] shorter steps have no course


def degrees_text(angle: float) -> str:
    """An angle [deg] as text."""
    return f"{angle:,.0f}°"


@cost("turns_deg", degrees_text, "sum of all turns", "turns [deg]")
def turns(_problem: Problem, x: FloatArray, _u: FloatArray) -> float:
    """Sum of the absolute changes of course along the expected path [deg]."""
    steps = np.diff(x, axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > STILL]
    course = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    return float(np.degrees(np.abs(np.diff(course)).sum()))
