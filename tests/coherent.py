"""One path through coherent winds, shared by the suites of the kernels, planning and simulation."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import beta as beta_law

from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.world.scene import Scene
from problems import KM, box, make_problem, make_scene, smooth_wind

RARE = 1e-6  # chance at which a statistical test may fail
SCENE = make_scene({"a": box(15, 15, 19, 19)}, [box(8, 2, 11, 6)], start=(2.0, 2.0))
WAY = [(2, 2), (3, 4), (5, 7), (7, 9), (9, 11), (12, 12), (14, 14), (16.5, 16.5)]  # [km]
STEPS = KM * np.vstack([np.linspace(a, b, 6)[:-1] for a, b in pairwise(WAY)] + [np.array(WAY[-1:])])
LOOSE = PlannerConfig(epsilon=0.999, delta=0.999)


def coherent_problem(
    scene: Scene = SCENE,
    robot: RobotConfig | None = None,
    planner: PlannerConfig = LOOSE,
    formula: str = "F a",
    **wind: Any,
) -> Problem:
    """A mission in winds with exact modes; ``wind`` goes to ``smooth_wind``."""
    robot = robot or RobotConfig(dt=100.0, u_max=20.0, start_sd=50.0)
    options: Mapping[str, Any] = wind
    return make_problem(formula, scene, smooth_wind(scene, **options), robot, planner, fidelity="full")


def rate_interval(failures: int, runs: int) -> tuple[float, float]:
    """An interval that misses the true rate less than once in 10^6."""
    low = 0.0 if failures == 0 else float(beta_law.ppf(RARE / 2, failures, runs - failures + 1))
    high = 1.0 if failures == runs else float(beta_law.ppf(1 - RARE / 2, failures + 1, runs - failures))
    return low, high
