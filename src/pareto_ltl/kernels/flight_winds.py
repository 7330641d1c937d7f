"""The wind of a single flight, for aircraft that are simulated outside the kernels."""

from __future__ import annotations

from pareto_ltl.kernels.flight import Draws, meet_winds
from pareto_ltl.kernels.jit import entry
from pareto_ltl.support.arrays import FloatArray


@entry
def wind_met(draws: Draws, t: int, x: FloatArray, met: FloatArray) -> None:
    """Write the wind (east, north) [m/s] at step ``t`` to ``met[0, :2]``; ``draws`` hold one flight.

    ``met`` has shape (1, 4). Of ``x`` (1, T+1, 2) only the position ``x[0, t]`` [m] is read.
    """
    meet_winds(draws, t, x, met)
