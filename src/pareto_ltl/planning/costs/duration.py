"""The time until arrival."""

from __future__ import annotations

from typing import TYPE_CHECKING

from careful_io.times import HOUR
from pareto_ltl.planning.cost import cost
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem


def hours_text(seconds: float) -> str:
    """A time [s] as text in hours."""
    return f"{seconds / HOUR:,.2f} h"


@cost("arrival_s", hours_text, "until arrival", "duration [h]", 1 / 3600)
def duration(problem: Problem, _x: FloatArray, u: FloatArray) -> float:
    """Time from departure to arrival [s]."""
    return len(u) * problem.motion.dt
