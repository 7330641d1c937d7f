"""How long the legs of a line take at full airspeed."""

from __future__ import annotations

import math

from pareto_ltl.kernels.data import Motion, Wind
from pareto_ltl.kernels.interpolation import wind_at
from pareto_ltl.support.arrays import FloatArray
from plane_kernels.types import Point
from typed_kernels.jit import entry

SLOWEST = 0.05  # of u_max: least ground speed assumed for a leg against a strong wind
LEAST = 1e-9  # [m]


@entry
def fill_leg_times(wind: Wind, motion: Motion, cap: float, x: FloatArray, needed: FloatArray) -> None:
    """Fill ``needed`` (T,) with the time of each leg of ``x`` (T+1, 2) [m] at ``cap`` u_max [steps].

    Along the direction d the ground speed is d' w + √(u² - |w - (d' w) d|²), u the airspeed and w the
    expected wind where and when the leg begins, the last one known if it begins later. B is taken as dt I.

    Eq. (M57) of docs/mathematics_methods.md.
    """
    limit, last = cap * motion.u_max, len(wind.slot) - 1
    for t in range(len(needed)):
        east, north = wind_at(wind.mean, wind, min(t, last), Point(x[t, 0], x[t, 1]))
        dx, dy = x[t + 1, 0] - x[t, 0], x[t + 1, 1] - x[t, 1]
        length = math.sqrt(dx * dx + dy * dy)
        along = (dx * east + dy * north) / max(length, LEAST)
        across = max(east * east + north * north - along * along, 0.0)
        speed = along + math.sqrt(max(limit * limit - across, 0.0))
        needed[t] = length / (motion.dt * max(speed, SLOWEST * motion.u_max))
