"""The missions of the benchmark, and the problem of flying them in the winds that came."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from careful_io.times import HOUR, seconds
from pareto_ltl.planning.problem import Problem
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import (
    MissionConfig,
    PlannerConfig,
    RobotConfig,
    SceneConfig,
    Settings,
    WindConfig,
    preset,
)
from pareto_ltl.wind.records import WindField
from pareto_ltl.wind.sources import read_readings
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl_apps.studies.random_missions import at_times
from wind_laws.lattice import wind_lattice

FOLDER = Path(__file__).parent
SPACING = 20_000.0  # of the lattice of the true winds [m]
PADDING = 100_000.0  # of true winds around a map [m]; beyond them the wind at the edge is used


@dataclass(frozen=True, slots=True)
class Mission:
    """A row of ``missions.json``; paths are relative to the folder of the data.

    Attributes
    ----------
    map : str
        GeoJSON with the start, the regions and the obstacles.
    known, truth : str
        Tables of wind: what a planner may read, and the fields in which its plan is flown.
    dt : float
        Duration of a step [s]: letters are read at steps, and legs last whole steps.
    hours : float
        Longest flight [h].
    u_min, u_max : float
        Limits of the airspeed [m/s].
    gust_sd : float
        Standard deviation of each component of the gusts, which are independent at each step [m/s].
    """

    name: str
    situation: str
    formula: str
    departure: str
    map: str
    known: str
    truth: str
    dt: float
    hours: float
    u_min: float
    u_max: float
    gust_sd: float

    @property
    def most_steps(self) -> int:
        """Number of steps of the longest flight."""
        return int(self.hours * HOUR / self.dt)


def missions(folder: Path = FOLDER) -> Iterator[Mission]:
    """The missions, in the order of the file."""
    for row in json.loads((folder / "missions.json").read_text(encoding="utf-8"))["missions"]:
        yield Mission(**row)


def true_problem(mission: Mission, folder: Path = FOLDER) -> Problem:
    """The mission in the winds that came: one field without uncertainty, and gusts."""
    scene = scene_from_settings(SceneConfig(file=str(folder / mission.map)), mission.departure)
    settings = Settings(
        mission=MissionConfig(formula=mission.formula, start_time=mission.departure),
        robot=RobotConfig(dt=mission.dt, u_min=mission.u_min, u_max=mission.u_max),
        planner=PlannerConfig(max_steps=mission.most_steps),
        fidelity=preset("paper"),  # without modes: the field is known
    )
    world = {"scene": scene, "wind": true_wind(mission, scene, folder)}
    return Run(settings, world).problem


def true_wind(mission: Mission, scene: Scene, folder: Path = FOLDER) -> WindField:
    """The true fields over ``scene``, bilinear in degrees and linear in time; gusts are its white part."""
    readings = read_readings(WindConfig(source="csv", path=str(folder / mission.truth)))
    times = readings.times - seconds(mission.departure)
    times = times[: np.searchsorted(times, mission.hours * HOUR) + 1]
    lattice = wind_lattice(scene.bounds, SPACING, PADDING)
    origin, spacing, shape = lattice
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2)
    mean = at_times(readings, scene, times, origin + spacing * nodes).reshape(len(times), *shape, 2)
    return WindField(
        origin=origin, spacing=spacing, times=times, mean=mean, latent_var=np.zeros_like(mean),
        gust_var=np.full((len(times), 2), mission.gust_sd**2), source="full fields",
    )  # fmt: skip
