"""Simulated flights as stages hand them on."""

from __future__ import annotations

from dataclasses import dataclass

from pareto_ltl.support.arrays import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Deployment:
    """Simulated flights of one plan under one wind law.

    Attributes
    ----------
    x : (n, T+1, 2) float
        Positions [m].
    accepted : (n,) bool
        Flights that complete the mission.
    collided, off_map : (n,) bool
        Flights that met an obstacle, and that left the map.
    walled : bool
        Whether leaving the map is a failure (``scene.border=wall``).
    """

    law: str
    x: FloatArray
    accepted: BoolArray
    collided: BoolArray
    off_map: BoolArray
    walled: bool = False

    @property
    def failed(self) -> BoolArray:
        """Flights that miss the mission, meet an obstacle or, where the border is a wall, leave the map."""
        failed: BoolArray = ~self.accepted | self.collided
        return failed | self.off_map if self.walled else failed
