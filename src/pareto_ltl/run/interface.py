"""The Python interface: ``pareto_ltl.plan``, ``simulate`` and ``steer``.

They go through the runner of the command line: the same settings and seed give the same plan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from careful_io.messages import shown_text
from careful_io.texts import distance_text
from pareto_ltl.run.directory import claimed_directory
from pareto_ltl.run.pipeline import Pipeline, carry_out
from pareto_ltl.run.plan_run import Run
from pareto_ltl.run.progress import Caller, ProgressBar
from pareto_ltl.run.results import Planned, planned_run
from pareto_ltl.settings import DeploymentConfig, MissionConfig, SceneConfig, WindConfig
from pareto_ltl.support.errors import ConfigError, ParetoLtlError
from pareto_ltl.support.resources import CONF
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_settings import read_map

if TYPE_CHECKING:
    from pareto_ltl.planning.records import PlannedPath
    from pareto_ltl.settings import Settings
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.support.arrays import FloatArray
    from pareto_ltl.wind.readings import Readings
    from pareto_ltl.wind.records import WindField

VEHICLE = "airframe"  # the choice of the group robot in conf/config.yaml
GOAL = "goal"  # name of the region about the end of a steered path
WIDE = 0.5  # half side of that region, in full steps
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


# --- planning -----------------------------------------------------------------------------------


@contextmanager
def _python_spelling() -> Iterator[None]:
    """Add a note to an error that names settings: how a caller in Python gives them."""
    try:
        yield
    except ParetoLtlError as error:
        if arguments := python_arguments(str(error)):
            error.add_note(f"in Python: pareto_ltl.plan(..., {arguments})")
        raise


def python_arguments(message: str) -> str:
    """The settings that a message names, as arguments of :func:`plan`; empty if it names none.

    The formula, which is its second argument, is left out.
    """
    from pareto_ltl.settings import Settings

    named = Settings.named_in(message.replace("mission.formula", ""))
    given = {section: ", ".join(f'"{key}": ...' for key in keys) for section, keys in named.items()}
    return ", ".join(f"{section}={{{keys}}}" for section, keys in given.items())


@_python_spelling()
def plan(
    scene: str | Path | Mapping[str, Any] | SceneConfig | Scene,
    formula: str | Mapping[str, Any] | MissionConfig,
    *,
    seed: int = 0,
    out: str | Path | None = None,
    on_progress: Callable[[str, int, int, str], None] | None = None,
    **sections: Any,
) -> Run:
    """Plan ``formula`` on ``scene``; the same settings give the same results as the command line.

    Parameters
    ----------
    scene : str, Path, mapping, SceneConfig, Scene or GeoDataFrame
        The name of a ready map (``"phi2"``), a GeoJSON or ``scene.json`` file, the keys of section ``scene``,
        a map in metres, or what :func:`pareto_ltl.read_map` reads.
    formula : str, mapping or MissionConfig
        A formula over the regions of the map (``"F(a & F b)"``), or the keys of section ``mission``.
    seed : int
        Another seed gives other flights that judge the paths, ``refine={"seed": 1}`` other paths.
    out : path, optional
        Run the whole pipeline into this results directory. Without it only up to the plan, with no files.
    on_progress : callable, optional
        Called with the name of the stage, what is done of which total (0 of 0 at its begin), and a text on
        the result so far.
    sections : mapping, str or settings object
        Any section of :class:`Settings`: ``wind="calm"``, ``planner={"trees": 4}``. A string names a choice
        in ``conf/``; ``mission`` gives the keys other than the formula. ``wind``, or its key ``source``, may
        also be a file, a dataset of xarray, a :class:`Readings`, or a :class:`WindField`. Messages write
        ``planner.trees=4`` for it.

    Raises
    ------
    ConfigError, FormulaError, DataError
        If a setting, the formula, the map or the wind is wrong.
    InfeasibleError
        If no path completes the mission.
    """
    from pareto_ltl.settings import Settings

    given, sections = _given_wind(sections)
    if hasattr(scene, "__geo_interface__") and not isinstance(scene, Scene):
        scene = read_map(scene)
    if isinstance(scene, Scene):
        given["scene"] = scene
    settings = Settings.of(
        {"pipelines": "plan", "seed": seed}
        | ({} if isinstance(scene, Scene) else {"scene": _map_settings(scene)})
        | sections
        | {"robot": _robot_settings(sections.get("robot"))}
        | {"mission": _mission_settings(formula, sections.get("mission"))}
    )
    if isinstance(scene, Scene) and scene.time_zero is None:
        departure = _departure(settings, given.get("readings"))
        given["scene"] = scene if departure is None else replace(scene, time_zero=departure)
    pipeline = Pipeline.of(settings, given=given)
    if not any(stage.name == "plan" for stage in pipeline.stages):
        raise ConfigError(
            f"pipelines.stages makes no plan; it lists {', '.join(settings.pipelines.stages)}: use "
            "pipelines='plan', or add the stage plan"
        )
    run = Run(settings, given, directory=None if out is None else Path(out))
    if on_progress is not None:
        shown = None if out else False
        run.progress = ProgressBar(shown, settings.fidelity.name, Caller(on_progress))
    _carried_out(run, pipeline)
    return run


def _carried_out(run: Run, pipeline: Pipeline) -> None:
    """Run all stages into the directory of ``run``; without one, the stages up to the plan."""
    if run.directory is not None:
        with claimed_directory(run.directory, pipeline.files):
            carry_out(run, pipeline.stages)
        return
    with run.budget.ends_at_key():
        for stage in pipeline.stages:
            run.made(stage)
            if stage.name == "plan":
                break


def _departure(settings: Settings, readings: Readings | None) -> str | None:
    """When a map without a date is flown: at ``mission.start_time``, else at the first wind in memory."""
    return settings.mission.start_time or (None if readings is None else readings.first_time)


def _given_wind(sections: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The records that section ``wind`` gives, and all sections with the settings that describe them."""
    from pareto_ltl.wind.readings import CALM, Readings
    from pareto_ltl.wind.records import WindField
    from pareto_ltl.wind.sources import is_dataset, read_wind, source_of_path

    section = sections.get("wind")
    # A dataset of xarray is a mapping, too.
    keys = section if isinstance(section, Mapping) and not is_dataset(section) else None
    others = dict(keys or {})
    wind = section if keys is None else others.get("source")
    if is_dataset(wind):
        wind = read_wind(wind, level=others.get("level"))
    given: dict[str, Any] = {}
    if isinstance(wind, WindField):
        given, found = {"wind": wind, "readings": CALM}, _given_level(wind, others)
    elif isinstance(wind, Readings):
        wind.check(float(others.get("max_speed", WindConfig().max_speed)))
        given, found = {"readings": wind}, _given_level(wind, others)
    elif isinstance(wind, str | Path) and _is_place(wind):
        found = {"source": source_of_path(wind), "path": str(wind)}
    elif wind is None and others.get("path") is not None:
        found = {"source": source_of_path(others["path"])}
    else:
        return {}, dict(sections)
    return given, {**sections, "wind": others | found}


def _is_place(wind: str | Path) -> bool:
    """Whether ``wind`` is a file, a folder or a pattern of files, and not the name of a choice."""
    if str(wind) in CONF.names("wind"):
        return False
    return Path(wind).expanduser().exists() or any(letter in str(wind) for letter in "*?[")


def _given_level(wind: Readings | WindField, others: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a wind in memory, which states its level; ConfigError if ``others`` contradicts it."""
    from pareto_ltl.support.levels import wind_level

    requested = str(others.get("level", "auto"))
    if requested != "auto" and wind_level(requested) != wind_level(wind.level):
        raise ConfigError(
            f"wind.level={shown_text(requested)}: the given {type(wind).__name__} states the level "
            f"{wind.level}; leave wind.level out, or give winds of that level"
        )
    return {"source": "given", "level": wind.level}


def _map_settings(scene: str | Path | Mapping[str, Any] | SceneConfig) -> SceneConfig:
    """Settings of the map from its keys, its name or its file; ConfigError for an unknown name."""
    if isinstance(scene, str | Path) and str(scene) not in CONF.names("scene"):
        if not Path(scene).expanduser().is_file():
            ready = ", ".join(CONF.names("scene"))
            raise ConfigError(f"scene {str(scene)!r} is neither a file nor a ready map; there are {ready}")
        return SceneConfig(file=str(scene))
    from pareto_ltl.settings import Settings

    built = Settings.of_section("scene", str(scene) if isinstance(scene, Path) else scene)
    assert isinstance(built, SceneConfig)
    return built


def _robot_settings(robot: Any) -> Any:
    """The section ``robot``; keys alone change the vehicle that the command line has without ``robot=``."""
    if robot is None or isinstance(robot, Mapping):
        return CONF.values("robot", VEHICLE) | dict(robot or {})
    return robot


def _mission_settings(formula: Any, others: Any) -> Any:
    """The section ``mission`` from a formula or its keys, and from the other keys in ``others``.

    Raises ConfigError if both give the same key, or ``others`` cannot be combined with the formula.
    """
    mission = {"formula": formula} if isinstance(formula, str) else formula
    if others is None:
        return mission
    if not (isinstance(mission, Mapping) and isinstance(others, Mapping)):
        raise ConfigError(
            "the mission is given twice, as the second argument and as mission=...: give one of them, or the "
            "formula and mission={...} with the other keys"
        )
    if twice := sorted(set(mission) & set(others)):
        raise ConfigError(f"mission.{twice[0]} is given twice, in the second argument and in mission={{...}}")
    return {**mission, **others}


# --- what follows from a plan -------------------------------------------------------------------


def simulate(
    planned: Planned,
    runs: int = 500,
    law: str = "coherent",
    *,
    seed: int | None = None,
) -> Deployment:
    """Simulate ``runs`` flights of a plan in winds of the law ``law``: ``independent`` or ``coherent``.

    Parameters
    ----------
    planned : Run or path
        What :func:`plan` returned, or a results directory.
    seed : int, optional
        Seed of the winds; default the seed of the plan. One seed gives the same winds to every plan.
    """
    run = planned_run(planned)
    settings = replace(
        run.settings,
        seed=run.settings.seed if seed is None else seed,
        deployment=DeploymentConfig(runs=runs, laws=[law]),
    )
    return Run(settings, run.make("problem", "plan")).deployments[law]


def steer(
    planned: Planned, start: Sequence[float], end: Sequence[float],
    *, radius: float | None = None, weight: float = 10.0,
) -> PlannedPath:  # fmt: skip
    """The path from ``start`` to ``end`` on the map and in the wind of a plan, from its departure on.

    One convex programme bends lines past the obstacles; each segment keeps ``planner.epsilon``. Obstacles,
    border, forbidden regions and robot are taken from the plan; its mission has no effect.

    Parameters
    ----------
    planned : Run or path
        What :func:`pareto_ltl.plan` returned, or a results directory.
    start, end : (2,) float
        Positions on the plane of the map [m].
    radius : float, optional
        The path ends in the square of this half side about ``end`` [m]; by default half a full step.
    weight : float
        Weight of mission risk + collision risk, beside the length in units of the shortest line.

    Raises
    ------
    ConfigError
        If a point lies outside the map or in an obstacle.
    InfeasibleError
        If no path leads there within the limits.
    """
    from pareto_ltl.planning.smoothing import steered_path

    run = planned_run(planned)
    settings, scene, problem = run.settings, run.scene, run.problem
    here, there = (_point(scene, name, at) for name, at in (("start", start), ("end", end)))
    wide = WIDE * problem.reach if radius is None else radius
    if not wide > 0.0:
        raise ConfigError(f"steer: radius must be above 0 m, got {wide:g}")
    settings = replace(
        settings,
        mission=MissionConfig(formula=f"F {GOAL}", start_time=scene.time_zero),
        robot=replace(settings.robot, dt=problem.motion.dt),
    )
    leg = Run(settings, {"scene": _towards(scene, here, there, wide), "wind": run.wind}).problem
    return steered_path(leg, settings.smoothing, weight)


def _point(scene: Scene, name: str, at: Sequence[float]) -> FloatArray:
    import shapely

    place = np.asarray(at, float)
    if place.shape != (2,) or not np.isfinite(place).all():
        raise ConfigError(f"steer: {name} must be two numbers [m], got {at!r}")
    (west, south), (east, north) = scene.bounds
    if not (scene.bounds[0] <= place).all() or not (place <= scene.bounds[1]).all():
        raise ConfigError(
            f"steer: {name} {tuple(place.tolist())} lies outside the map, which reaches from "
            f"({west:g}, {south:g}) to ({east:g}, {north:g}) m"
        )
    for k, outline in enumerate(scene.obstacles):
        if shapely.Polygon(outline).covers(shapely.Point(place)):
            gap = shapely.Polygon(outline).exterior.distance(shapely.Point(place))
            raise ConfigError(
                f"steer: {name} lies {distance_text(gap)} deep in {scene.obstacle_title(k + 1)}; move it out"
            )
    return place


def _towards(scene: Scene, start: FloatArray, end: FloatArray, wide: float) -> Scene:
    """``scene`` from ``start``, with the square of half side ``wide`` about ``end`` as its only goal."""
    square = np.clip(end + wide * CORNERS, *scene.bounds)
    windows = {name: window for name, window in scene.windows.items() if name in scene.forbidden}
    hazards = {window.region for window in windows.values()}
    regions = {name: parts for name, parts in scene.regions.items() if name in hazards}
    return replace(scene, start=start, regions={**regions, GOAL: (square,)}, windows=windows)
