"""Small missions of ``forecast_test`` in winds of six-hourly cycles that are made up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pareto_ltl.settings import DeploymentConfig, PlannerConfig, SelectionConfig, Settings, SmoothingConfig
from pareto_ltl.wind.snapshots import Snapshot
from pareto_ltl_apps.studies import forecast_test as study
from pareto_ltl_apps.studies.known_winds import DepartureWinds
from pareto_ltl_apps.studies.settings import EvaluationConfig, ForecastTestConfig

START, HOUR = 1.5e9, 3600.0
LON, LAT = np.meshgrid(np.arange(-112.0, -87.0), np.arange(29.0, 49.0))
NODES = np.column_stack([LON.ravel(), LAT.ravel()])
AREA = [[-101.0, 37.0], [-99.0, 37.0], [-99.0, 39.0], [-101.0, 39.0]]


def snapshots(wind: object, hours: int = 30, leads: tuple[int, ...] = (0, 3)) -> tuple[Snapshot, ...]:
    """Six-hourly cycles of a wind that is alike everywhere, ``wind(hour)`` [m/s]; forecasts are right."""
    found = []
    for cycle in range(0, hours + 1, 6):
        for lead in leads:
            here = np.tile(wind(cycle + lead), (len(NODES), 1))  # type: ignore[operator]
            ripple = 0.2 * np.sin(NODES[:, ::-1] / 3.0)  # a field to fit, not a constant
            file = Path(f"folder/c{cycle}f{lead}")
            found.append(
                Snapshot(START + HOUR * (cycle + lead), HOUR * lead, NODES, here + ripple, "10m", (file,))
            )
    return tuple(found)


def settings(**changes: object) -> Settings:
    """Small missions, planned in seconds."""
    cfg = ForecastTestConfig(
        missions=2,
        area=AREA,
        side=[300e3, 350e3],
        obstacles=[0, 1],
        formulas=["F(a & F b)"],
        hours=10.0,
        points=40,
    )
    return Settings(
        planner=PlannerConfig(trees=3, n_max=1200),
        smoothing=SmoothingConfig(candidates=1, weights=[10.0]),
        selection=SelectionConfig(draws=200, runs=300),
        deployment=DeploymentConfig(runs=200),
        evaluation=EvaluationConfig(jobs=1),
        forecast_test=replace(cfg, **changes),  # type: ignore[arg-type]
    )


def calm(hour: float) -> tuple[float, float]:
    return 3.0, 1.0


def context_of(told: tuple[Snapshot, ...], cfg: Settings) -> DepartureWinds:
    files = tuple(file for snap in told for file in snap.files)
    known = study.known_winds(cfg, cfg.forecast_test, Path("none"), told, files)
    assert isinstance(known, DepartureWinds)
    return known
