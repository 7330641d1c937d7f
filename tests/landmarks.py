"""A straight path through a landmark, shared by the suites of planning and simulation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.settings.fidelity import preset
from pareto_ltl.world.scene import Scene
from problems import KM, box, make_problem, make_scene, smooth_wind
from wind_laws.forecast_error import ForecastError

LANDMARK_SCENE = replace(
    make_scene({"a": box(13, 13, 19, 19)}, start=(2.0, 2.0)), landmarks=(box(4, 4, 12.5, 12.5),)
)
LANDMARK_WAY = np.linspace([2.0, 2.0], [16.0, 16.0], 29) * KM


def landmark_problem(
    scene: Scene = LANDMARK_SCENE, error: ForecastError | None = None, judge: str = "flights", **robot: Any
) -> Problem:
    """Full fidelity with fixes; ``robot`` changes its settings."""
    models = replace(preset("full"), judge=judge)
    options: dict[str, Any] = {"dt": 100.0, "u_max": 25.0, "start_sd": 300.0, "fix_sd": 50.0}
    wind = smooth_wind(scene, speed=2.0, sd=0.7, gust=0.3, rho=0.9, error=error)
    return make_problem(
        "F a", scene, wind, RobotConfig(**options | robot), PlannerConfig(trees=4, n_max=600), fidelity=models
    )
