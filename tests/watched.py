"""A small plan whose flight is watched, shared by the suites of ``follow``."""

from __future__ import annotations

import math

from coherent import STEPS, coherent_problem
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.records import Plan
from pareto_ltl.support.arrays import FloatArray

PROBLEM = coherent_problem()
PATH = evaluate_path(PROBLEM, STEPS, "given", tolerance=10.0)
PLAN = Plan(PATH, "F a", ("a",), PROBLEM.motion.dt, 20.0, 0.05, "full", "worth", ())
DT = PROBLEM.motion.dt
FLIGHT_TIME = len(PATH.u) * DT


def heading_of(u: FloatArray) -> tuple[float, float]:
    """Heading [deg] and airspeed [m/s] of a control (2,) on a map without a place on Earth."""
    return math.degrees(math.atan2(u[0], u[1])) % 360.0, math.hypot(*u)
