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
    accepted, collided : (n,) bool
    """

    law: str
    x: FloatArray
    accepted: BoolArray
    collided: BoolArray
