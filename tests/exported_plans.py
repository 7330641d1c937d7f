"""A small plan with all its files, and differences between the plan and places and times of a file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import Geod

import pareto_ltl
from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import SceneConfig, Settings
from pareto_ltl_apps.exports.exported import ExportedPlan
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.exports.settings import ExportsConfig
from quick_wind import QUICK_WIND

SMALL = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 2, "n_max": 3000, "max_steps": 80},
    "selection": {"draws": 200, "runs": 500},
    "refine": {"flights": 200, "sweep_flights": 60, "points": 4},
    "wind": QUICK_WIND,
}
EXPORTS = ExportsConfig(formats=list(FORMATS), flights=1000, altitude_lower=300.0, altitude_upper=420.0)


def settings_named(name: str, **scene: Any) -> Settings:
    """Settings of a run that exports every format."""
    return Settings(name=name, exports=EXPORTS, scene=SceneConfig(**scene))


@dataclass(frozen=True)
class Flown:
    """The plan, the problem that it solves, the exported values and the folder of the files."""

    result: pareto_ltl.Run
    exported: ExportedPlan
    folder: Path

    @property
    def problem(self) -> Problem:
        return self.result.problem

    def json(self, name: str) -> Any:
        return json.loads((self.folder / name).read_text())


def metres_apart(lat: Any, lon: Any, exported: ExportedPlan, first: int = 0) -> float:
    """The largest distance between places and the expected positions from step ``first`` on [m]."""
    log = exported.log
    assert len(lat) == len(log.lat) - first
    return float(np.max(Geod(ellps="WGS84").inv(lon, lat, log.lon[first:], log.lat[first:])[2]))


def seconds_apart(times: Any, exported: ExportedPlan) -> float:
    """The largest difference between aware times and the times of the plan [s]."""
    assert exported.log.utc is not None
    wanted = [datetime.fromisoformat(text) for text in exported.log.utc]
    return max(abs((a - b).total_seconds()) for a, b in zip(times, wanted, strict=True))
