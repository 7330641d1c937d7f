"""The wind that one flight of a batch meets, for aircraft that fly outside of the kernels."""

from __future__ import annotations

from pareto_ltl.kernels.flight import Draws, meet_winds
from pareto_ltl.kernels.jit import entry
from pareto_ltl.support.arrays import FloatArray


@entry
def wind_met(draws: Draws, t: int, x: FloatArray, met: FloatArray) -> None:
    """Wind (east, north) [m/s] of the one flight of ``draws`` at step ``t`` into ``met`` (1, 4).

    Only its place ``x[0, t]`` is read.
    """
    meet_winds(draws, t, x, met)
