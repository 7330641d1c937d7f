"""The stages by name: the only place that knows which function of which room makes what.

A stage's parameters name what it needs: a record that an earlier stage made (``scene``, ``forest``), a
section of the settings (``planner_cfg`` is ``settings.planner``), all ``settings``, ``seeds`` (a
``SeedSequence`` of its own), ``progress`` (to call with done and total) or ``directory`` (of the results).
A parameter with a default may be absent. An ingredient is made when a stage first needs it, and so is
never listed. Rooms are imported inside, so that a configuration error does not wait for them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.support import resources
from pareto_ltl.support.errors import InfeasibleError

if TYPE_CHECKING:
    from numpy.random import SeedSequence

    from pareto_ltl.logic import Automaton
    from pareto_ltl.planning.evaluate import Forecast
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import Forest, Front, Plan, PlannedPath
    from pareto_ltl.settings import (
        DeploymentConfig,
        IngestConfig,
        LogicConfig,
        MissionConfig,
        PlannerConfig,
        ReportConfig,
        SceneConfig,
        SelectionConfig,
        Settings,
        SmoothingConfig,
        WindConfig,
    )
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.wind.records import WindField, WindObservations
    from pareto_ltl.world.cells import Decomposition
    from pareto_ltl.world.scene import Scene

log = logging.getLogger(__name__)

Progress = Callable[[int, int], None]
STAGES: dict[str, Callable[..., Any]] = {}
INGREDIENTS: dict[str, Callable[..., Any]] = {}


def stage(make: Callable[..., Any]) -> Callable[..., Any]:
    STAGES[make.__name__] = make
    return make


def ingredient(make: Callable[..., Any]) -> Callable[..., Any]:
    INGREDIENTS[make.__name__] = make
    return make


@ingredient
def scene(scene_cfg: SceneConfig, mission_cfg: MissionConfig, wind_cfg: WindConfig) -> Scene:
    from pareto_ltl.wind.sources import first_wind_time as first_time
    from pareto_ltl.world.random_maps import add_random_places as populated
    from pareto_ltl.world.scene_settings import scene_from_settings as read_scene

    return read_scene(populated(scene_cfg), mission_cfg.start_time or first_time(wind_cfg))


@stage
def observations(wind_cfg: WindConfig, scene: Scene) -> WindObservations:
    from pareto_ltl.wind.observations import observe_wind

    return observe_wind(wind_cfg, scene)


@stage
def wind(settings: Settings, wind_cfg: WindConfig, observations: WindObservations, scene: Scene) -> WindField:
    from pareto_ltl.wind import field

    horizon = settings.planner.max_steps * settings.robot.dt
    return field.fit_wind_field(wind_cfg, observations, scene, horizon)


@stage
def decomposition(scene: Scene) -> Decomposition:
    from pareto_ltl.world import cells as workspace

    return workspace.decompose(scene)


@stage
def automaton(
    mission_cfg: MissionConfig, logic_cfg: LogicConfig, scene: Scene, decomposition: Decomposition
) -> Automaton:
    """Over the letters that cells show, and the empty one of a flight that leaves the map."""
    from pareto_ltl.logic.mission import automaton_of
    from pareto_ltl.world import cells as workspace

    letters = {*decomposition.letters, frozenset[str]()}
    result = automaton_of(mission_cfg, letters, logic_cfg.max_states, scene.regions)
    if cut_off := workspace.unreachable_regions(decomposition, scene, result.atoms):
        log.warning("no way on the map leads from the start to %s", ", ".join(cut_off))
    return result


@ingredient
def problem(
    settings: Settings,
    scene: Scene,
    wind: WindField,
    decomposition: Decomposition,
    automaton: Automaton,
) -> Problem:
    from pareto_ltl.planning.pack import build_problem

    robot, planner, wind_cfg = settings.robot, settings.planner, settings.wind
    return build_problem(robot, planner, wind_cfg, scene, wind, decomposition, automaton, settings.fidelity)


@stage
def forest(planner_cfg: PlannerConfig, problem: Problem, seeds: SeedSequence, progress: Progress) -> Forest:
    from pareto_ltl.planning import growth

    return growth.grow_forest(planner_cfg, problem, seeds, progress)


@stage
def front(
    settings: Settings,
    planner_cfg: PlannerConfig,
    smoothing_cfg: SmoothingConfig,
    problem: Problem,
    selection_cfg: SelectionConfig,
    forest: Forest,
    progress: Progress,
    seeds: SeedSequence,
) -> Front:
    from pareto_ltl.planning import growth, selection

    if not len(forest.accepted):
        raise InfeasibleError(growth.explain_no_path(planner_cfg, problem, forest))
    raw = selection.tree_front(problem, forest)
    smoothed: tuple[PlannedPath, ...] = ()
    if settings.fidelity.refine == "convex":
        from pareto_ltl.planning.refine import smooth_paths

        candidates = (*raw, *selection.order_representatives(problem, forest))
        smoothed = smooth_paths(smoothing_cfg, problem, candidates, progress)
    found = selection.build_front(smoothed, raw)
    if settings.fidelity.judge == "bound":
        return found
    from pareto_ltl.simulation.acceptance import rank_front

    return rank_front(problem, found, selection_cfg.draws, seeds)


@stage
def plan(
    settings: Settings,
    selection_cfg: SelectionConfig,
    problem: Problem,
    wind: WindField,
    front: Front,
    seeds: SeedSequence,
) -> Plan:
    from pareto_ltl.planning.records import Plan
    from pareto_ltl.planning.selection import choose_path
    from pareto_ltl.simulation.acceptance import accept_path

    if settings.fidelity.judge == "flights":
        path, acceptance = accept_path(selection_cfg, problem, wind, front, seeds)
    else:
        path, acceptance = choose_path(selection_cfg, front), None
    return Plan(
        path=path,
        formula=problem.automaton.formula,
        atoms=tuple(problem.atoms),
        dt=settings.robot.dt,
        u_max=settings.robot.u_max,
        epsilon=problem.epsilon,
        fidelity=settings.fidelity.label,
        rule=selection_cfg.rule,
        weights=tuple(selection_cfg.weights),
        acceptance=acceptance,
    )


@ingredient
def forecasts(deployment_cfg: DeploymentConfig, problem: Problem, plan: Plan) -> Mapping[str, Forecast]:
    """V and R of the plan under every law that it will be deployed in."""
    from pareto_ltl.planning.evaluate import forecast

    return {law: forecast(problem, plan.path.u, law) for law in deployment_cfg.laws}


@stage
def deployment(
    deployment_cfg: DeploymentConfig,
    problem: Problem,
    plan: Plan,
    forecasts: Mapping[str, Forecast],
    seeds: SeedSequence,
) -> Mapping[str, Deployment]:
    from pareto_ltl.simulation.flights import deploy_plan

    return deploy_plan(deployment_cfg, problem, plan, seeds)


@stage
def report(
    report_cfg: ReportConfig,
    directory: Path,
    scene: Scene,
    decomposition: Decomposition,
    wind: WindField,
    forest: Forest | None = None,
    front: Front | None = None,
    plan: Plan | None = None,
    deployment: Mapping[str, Deployment] | None = None,
) -> tuple[Path, ...]:
    """Pictures of what there is: a mission that failed shows how far its trees came."""
    if not report_cfg.figures:
        return ()
    from pareto_ltl.report.figures import DrawnRun, draw_run_figures

    run = DrawnRun(scene, decomposition, wind, forest, front, plan, deployment or {})
    return draw_run_figures(directory / "figures", report_cfg, run)


@stage
def table(wind_cfg: WindConfig, ingest_cfg: IngestConfig) -> Path:
    """The wind table of ``pipelines=ingest``; its path counts from the current folder."""
    from pareto_ltl.wind.ingest import ingest_readings as ingest

    return ingest(wind_cfg, ingest_cfg, Path(ingest_cfg.out))


def input_files(settings: Settings) -> list[Path]:
    """The files this run may read, for its records."""
    if settings.wind.source == "sample":
        winds = resources.packaged_data()
    else:
        winds = matching(settings.wind.path) if settings.wind.path else []
    return matching(settings.scene.file) + winds if settings.scene.file else winds


def matching(name: str) -> list[Path]:
    """The files that a setting names: one file, all of a folder, or a pattern."""
    path = Path(name).expanduser()
    found = path.iterdir() if path.is_dir() else [Path(match) for match in glob(str(path))]
    return sorted(file for file in found if file.is_file())
