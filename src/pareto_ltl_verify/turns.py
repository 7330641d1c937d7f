"""Flight of an aircraft that banks, by its dead-reckoning table, integrated in small time steps."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl_verify.laws import Robot

PARTS = 2000  # time steps of a leg
SHARP = math.radians(169.9)  # [rad] sharper turns count as without room: an autopilot may turn the other way
G = 9.80665  # [m/s²]


def fly_table(
    robot: Robot, heading: FloatArray, airspeed: FloatArray, duration: FloatArray, wind: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Displacements of the legs (T, 2) [m], and which are long enough for their turn (T,).

    ``heading`` (T,) counter-clockwise from +x [rad], ``airspeed`` (T,), ``duration`` (T,), ``wind`` (T, 2)::

        ψ' = g tan(bank) / V towards the order, from delay after it on;    x' = V (cos ψ, sin ψ) + w
    """
    ways, roomy = np.empty((len(heading), 2)), np.ones(len(heading), bool)
    nose = float(heading[0]) if len(heading) else 0.0
    for k in range(len(heading)):
        left = math.remainder(float(heading[k]) - nose, math.tau)
        rate = G * math.tan(robot.bank) / float(airspeed[k])
        time = np.linspace(0.0, float(duration[k]), PARTS + 1)
        turned = np.minimum(rate * np.maximum(time - robot.turn_delay, 0.0), abs(left))
        angle = nose + math.copysign(1.0, left) * turned
        air = airspeed[k] * np.column_stack([np.cos(angle), np.sin(angle)])
        ways[k] = np.trapezoid(air, time, axis=0) + duration[k] * wind[k]
        roomy[k] = abs(left) < SHARP and turned[-1] >= abs(left) - 1e-9
        nose = float(angle[-1])
    return ways, roomy
