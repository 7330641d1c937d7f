"""A small world for the studies: two goals, an obstacle, a wind that changes in space and time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.run.plan_run import UnpricedRun
from pareto_ltl.settings import (
    DeploymentConfig,
    MissionConfig,
    PlannerConfig,
    RobotConfig,
    Settings,
    SmoothingConfig,
    preset,
)
from pareto_ltl.wind.records import WindObservations
from pareto_ltl_apps.studies.settings import EvaluationConfig
from pareto_ltl_apps.view.settings import ReportConfig
from problems import box, make_scene


def settings(**changes: Any) -> Settings:
    """Three trees of 400 vertices, 60 flights, one process; the method of the paper."""
    plain = Settings(
        fidelity=preset("paper"),
        mission=MissionConfig(formula="F(a & F b)"),
        robot=RobotConfig(dt=100.0, u_max=12.0),
        planner=PlannerConfig(trees=3, n_max=400),
        smoothing=SmoothingConfig(candidates=1, weights=[10.0]),
        deployment=DeploymentConfig(runs=60),
        evaluation=EvaluationConfig(seeds=[0, 1], laws=["independent"], jobs=1),
        report=ReportConfig(dpi=40, paths=5),
    )
    return replace(plain, **changes)


def world(cfg: Settings) -> UnpricedRun:
    """The results of the stages before a study."""
    scene = make_scene(
        {"a": box(13, 2, 17, 6), "b": box(3, 13, 7, 17)}, [box(9, 8, 12, 11)], start=(2.0, 3.0)
    )
    rng = np.random.default_rng(7)
    grid = np.stack(np.meshgrid(*[np.linspace(-2e3, 22e3, 5)] * 2), -1).reshape(-1, 2)
    winds = [
        np.stack([2 + np.sin(grid[:, 1] / 6e3 + k), 1 + np.cos(grid[:, 0] / 7e3)], -1)
        + 0.7 * rng.standard_normal((25, 2))
        for k in range(3)
    ]
    seen = WindObservations(np.array([0.0, 9000.0, 30000.0]), (grid,) * 3, tuple(winds), "by hand")
    run = UnpricedRun(cfg, {"scene": scene, "observations": seen})
    run.make("cells", "automaton")
    return run


def files(folder: Path) -> dict[str, bytes]:
    """Name and content of every file."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}
