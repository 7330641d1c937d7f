"""The energy of a flight."""

from __future__ import annotations

from typing import TYPE_CHECKING

from careful_io.texts import energy_text
from pareto_ltl.planning.cost import cost
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem


@cost("energy_j", energy_text, "for the airspeeds", "energy [Wh]", 1 / 3600)
def energy(problem: Problem, _x: FloatArray, u: FloatArray) -> float | None:
    """Energy of the airspeeds [J]; None without a power curve."""
    return None if problem.energy is None else problem.energy.of(u, problem.motion.dt)
