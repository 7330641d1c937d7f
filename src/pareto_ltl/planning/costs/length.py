"""The length of a path."""

from __future__ import annotations

from typing import TYPE_CHECKING

from careful_io.texts import distance_text
from pareto_ltl.planning.cost import cost
from pareto_ltl.support.arrays import FloatArray, length_of

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem


@cost("length_m", distance_text, "of the expected path", "path length [km]", 1e-3)
def length(_problem: Problem, x: FloatArray, _u: FloatArray) -> float:
    """Length of the expected path [m]."""
    return length_of(x)
