"""Components of winds and currents in tables and files, and speed and direction as a vector.

A wind has the direction from which it blows, a current the direction towards which it flows (WMO Manual on
Codes)::

    u = -s sin(d),   v = -s cos(d)      direction from
    u =  s sin(d),   v =  s cos(d)      direction towards
"""

from __future__ import annotations

import numpy as np

from pareto_ltl.support.arrays import FloatArray

U, V, SPEED, FROM, TOWARDS = "u", "v", "speed", "direction from", "direction towards"
TEMPERATURE = "temperature"


def polar_winds(speed: FloatArray, direction: FloatArray, meaning: str) -> FloatArray:
    """u and v (N, 2) of ``speed`` (N,) and ``direction`` (N,) [deg], which is ``FROM`` or ``TOWARDS``.

    The direction of no wind does not matter; it may be missing.
    """
    angle = np.deg2rad(np.where(speed == 0.0, 0.0, direction))
    sign = -1.0 if meaning == FROM else 1.0
    return np.asarray(sign * speed[:, None] * np.column_stack([np.sin(angle), np.cos(angle)]) + 0.0, float)
