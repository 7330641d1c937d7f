"""The stages of a plan: the table of the functions that make each record.

``PLAN_STAGES`` at the end is the table. Packages are imported inside the functions, so that a configuration
error is reported without loading them.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

from pareto_ltl.run import records as keys
from pareto_ltl.run.page_stage import DEPLOYMENT_STREAM, drawn_records, make_page
from pareto_ltl.run.provenance import wanted_wind
from pareto_ltl.run.stage_table import FOREST_STREAM, Stage, StageInputs, StageTable, named_child
from pareto_ltl.settings import ReportConfig, RobotConfig, Settings, WindConfig
from pareto_ltl.settings.heights import Height, flight_air, flight_height, temperature_doubt
from pareto_ltl.settings.outputs import EXPORT_FILES, FIGURE_FORMATS, PAGE_FILE
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_text

if TYPE_CHECKING:
    from pareto_ltl.logic import Automaton
    from pareto_ltl.planning.evaluate import Forecast
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import Forest, Front, Plan
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.wind.coverage import OwnErrors
    from pareto_ltl.wind.readings import Readings
    from pareto_ltl.wind.records import WindField, WindObservations
    from pareto_ltl.world.cells import Decomposition
    from pareto_ltl.world.scene import Scene

LOG = logging.getLogger(__name__)
PRICING = "prices"  # child of the seed of the flights that price limits
REMEDIES = "remedies"  # child of the seed of the flights that try changes
PRICING_BLOCKS, PRICING_RUNS = 8, 5_000  # blocks of these flights, and the flights of each


def make_readings(inputs: StageInputs) -> Readings:
    """All wind readings of the source; each file is read once, a large one only around the scene."""
    from pareto_ltl.wind.sources import read_readings

    settings = inputs.settings
    _check_sample(settings.robot, settings.wind)
    readings = read_readings(settings.wind, wanted_wind(settings))
    for note in readings.notes:
        LOG.info("%s: %s", readings.name, note)
    return readings


def _check_sample(robot: RobotConfig, wind: WindConfig) -> None:
    """Refuse a stated level of the packaged sample; a robot at another level gets a warning."""
    if wind.source == "sample" and wind.level not in ("10m", "10 m", robot.level):
        raise ConfigError(
            f"wind.level={shown_text(wind.level)}: the packaged sample has winds 10 m above ground only; "
            "expected wind.level=10m, or another wind.source with winds of that level"
        )


def make_scene(inputs: StageInputs) -> Scene:
    """The map; without ``mission.start_time`` the robot departs at the first wind time."""
    from pareto_ltl.logic.mission import region_use
    from pareto_ltl.planning.open_sky import sky_room
    from pareto_ltl.world.scene_settings import add_random_places, scene_from_settings
    from pareto_ltl.world.scene_sketch import MissionUse
    from pareto_ltl.world.windows import lacks_zone

    settings = inputs.settings
    departure, mission = settings.mission.start_time or inputs[keys.READINGS].first_time, settings.mission

    def use() -> MissionUse | None:
        found = region_use(mission)
        return None if found is None else MissionUse(*found)

    if mission.start_time and lacks_zone(mission.start_time):
        LOG.warning(
            "mission.start_time=%s states no zone and is taken as UTC; write %sZ, or the offset of its zone",
            shown_text(mission.start_time), shown_text(mission.start_time),
        )  # fmt: skip
    height = flight_height(settings)
    return scene_from_settings(
        add_random_places(settings.scene), departure, settings.fidelity.border, use,
        height if height.stated else None, sky_room(settings, inputs[keys.READINGS], departure),
    )  # fmt: skip


def make_decomposition(inputs: StageInputs) -> Decomposition:
    """The convex cells of the map."""
    from pareto_ltl.world import cells

    return cells.decompose(inputs[keys.SCENE])


def make_automaton(inputs: StageInputs) -> Automaton:
    """The automaton over the letters that cells show and the empty letter, which holds off the map."""
    from pareto_ltl.logic.mission import automaton_of
    from pareto_ltl.world import cells

    settings, scene, decomposition = inputs.settings, inputs[keys.SCENE], inputs[keys.DECOMPOSITION]
    letters = {*decomposition.letters, frozenset[str]()}
    result = automaton_of(
        settings.mission, letters, settings.logic.max_states, scene.regions, scene.windows, scene.forbidden
    )
    windows = result.windows
    asked = (windows[atom].region if atom in windows else atom for atom in result.atoms)
    places = {place for place in asked if place is not None}
    if cut_off := cells.unreachable_regions(decomposition, scene, places):
        LOG.warning("no way on the map leads from the start to %s", ", ".join(cut_off))
    return result


def make_observations(inputs: StageInputs) -> WindObservations:
    """The readings near the map, in its plane and with times since departure."""
    from pareto_ltl.wind.observations import place_readings

    return place_readings(inputs.settings.wind, inputs[keys.READINGS], inputs[keys.SCENE])


def make_wind(inputs: StageInputs) -> WindField:
    """The posterior wind for as long as a plan can last."""
    from pareto_ltl.wind import field
    from pareto_ltl.world.time_step import step_of

    settings = inputs.settings
    steps = settings.planner.max_steps
    horizon = steps * step_of(settings.robot, inputs[keys.SCENE], steps)
    return field.fit_wind_field(settings.wind, inputs[keys.OBSERVATIONS], inputs[keys.SCENE], horizon)


def make_problem(inputs: StageInputs) -> Problem:
    """Map, wind, automaton and robot as the arrays that planning reads."""
    from pareto_ltl.planning.costs import costs_with
    from pareto_ltl.planning.pack import build_problem
    from pareto_ltl.planning.refine import import_early
    from pareto_ltl.world.windows import missed_windows

    settings = inputs.settings
    _check_level(flight_height(settings), inputs[keys.WIND])
    if settings.fidelity.refine != "none":
        import_early()  # behind the modes of the wind and the trees
    problem = build_problem(
        settings.robot,
        settings.planner,
        settings.wind,
        inputs[keys.SCENE],
        inputs[keys.WIND],
        inputs[keys.DECOMPOSITION],
        inputs[keys.AUTOMATON],
        settings.fidelity,
    )
    problem = replace(problem, costs=costs_with(settings.selection.costs))
    for line in missed_windows(problem.automaton.windows, problem.max_steps * problem.motion.dt):
        LOG.warning("%s", line)
    return problem


def _check_level(height: Height, wind: WindField) -> None:
    """Warn if the level of the wind is not the level of the flight; calm air has no level."""
    from pareto_ltl.support.levels import level_mismatch

    if height.stated and wind.evidence is not None and (gap := level_mismatch(height.level, wind.level)):
        LOG.warning(
            "%s: winds at other heights differ, often by a factor of two; read winds of that level, or, if a "
            "table has them, state it with wind.level=%s",
            gap,
            height.level,
        )


def make_forest(inputs: StageInputs) -> Forest:
    """The search trees (Algorithm 1)."""
    from pareto_ltl.planning import growth
    from pareto_ltl.run.warmup import compiling_in_two

    settings, problem = inputs.settings, inputs[keys.PROBLEM]
    importing = Thread(target=_import_report, args=(settings.report,), daemon=True)

    def progress(*news: Any) -> None:
        if not importing.ident:  # machine code is loaded: an interrupted import would block later ones
            importing.start()
        if inputs.progress is not None:
            inputs.progress(*news)

    inputs.budget.heeded = True
    with compiling_in_two(settings, inputs.budget):
        forest = growth.grow_forest(settings.planner, problem, inputs.seeds, progress, budget=inputs.budget)
    if importing.ident:
        importing.join()
    return forest


def _import_report(cfg: ReportConfig) -> None:
    """Import what the last stages need, while the trees grow outside the interpreter: 0.7 s less a run."""
    with suppress(Exception):  # an error appears again in its stage
        if cfg.figures:
            import_module("pareto_ltl.report.figures")
        if cfg.page:
            import_module("pareto_ltl.report.page.content").page_template()


def make_front(inputs: StageInputs) -> Front:
    """The non-dominated paths, refined and judged as set in ``fidelity``."""
    from pareto_ltl.run import front_stage

    return front_stage.make_front(inputs)


def make_plan(inputs: StageInputs) -> Plan:
    """The chosen path, the chance constraint of each of its segments, and the prices of its limits."""
    from pareto_ltl.planning.refine.prices import limits_of
    from pareto_ltl.simulation.flights import simulate_flights

    plan, problem = make_unpriced_plan(inputs), inputs[keys.PROBLEM]
    law, seed = problem.fidelity.law, named_child(inputs.seeds, PRICING)
    blocks = (
        simulate_flights(problem, plan.path.u, PRICING_RUNS, law, child, plan.path.x).x
        for child in seed.spawn(PRICING_BLOCKS)
    )
    limits, prices = limits_of(problem, plan.path, blocks)
    return _with_remedies(inputs, replace(plan, limits=limits, prices=prices))


def _with_remedies(inputs: StageInputs, plan: Plan) -> Plan:
    """``plan`` with the changes that help it, if it breaks ``planner.epsilon`` or hardly ever succeeds."""
    from pareto_ltl.planning.costs import remedies_text
    from pareto_ltl.run.remedies import HOPELESS, Trial, tried_remedies

    if plan.epsilon_kept and (plan.promise is None or plan.promise.rate.failure < HOPELESS):
        return plan
    seed = named_child(inputs.seeds, REMEDIES)
    remedies = tried_remedies(Trial(inputs.settings, inputs[keys.PROBLEM], inputs[keys.WIND], plan, seed))
    if remedies:
        LOG.info("what helps, %s", remedies_text(remedies))
    else:
        LOG.info("neither position feedback nor a beacon, a younger forecast or a larger region helps")
    return replace(plan, remedies=remedies)


def make_unpriced_plan(inputs: StageInputs) -> Plan:
    """The path of the front that the rule picks; with ``judge=flights``, after a test with fresh flights."""
    from pareto_ltl.planning.records import Plan
    from pareto_ltl.planning.refine.separation import keeps_epsilon, worst_segment
    from pareto_ltl.planning.selection_rules import (
        bound_warning,
        choose_path,
        selection_rule,
        within_capacity,
    )
    from pareto_ltl.simulation.promise import promise_path
    from pareto_ltl.wind.coverage import coverage_of, held_warning
    from pareto_ltl.world.projection import navigate

    settings, problem = inputs.settings, inputs[keys.PROBLEM]
    front, height = within_capacity(settings.selection, inputs[keys.FRONT], problem), flight_height(settings)
    coverage = coverage_of(
        inputs[keys.WIND],
        problem.scene.time_zero,
        height.level if height.stated else "",
        by_default=settings.mission.start_time is None,
        robot=covered_errors(settings),
    )
    if front.rates:
        path, promise = promise_path(settings.selection, problem, inputs[keys.WIND], front, inputs.seeds)
    else:
        path, promise = choose_path(settings.selection, front), None
    held = held_warning(inputs[keys.WIND], float(path.t[-1]), problem.scene.time_zero)
    measured = None if (air := inputs[keys.WIND].air) is None else air.during(path.t)
    doubt = "" if measured is None else temperature_doubt(settings, height, measured)
    for warning in filter(None, (bound_warning(path, settings.fidelity), held, doubt)):
        LOG.warning("%s", warning)
    plan = Plan(
        path=path,
        formula=problem.automaton.formula,
        atoms=tuple(problem.atoms),
        dt=problem.motion.dt,
        u_min=settings.robot.u_min,
        u_max=settings.robot.u_max,
        capacity=None if problem.energy is None else problem.energy.capacity,
        epsilon=problem.epsilon,
        fidelity=settings.fidelity.label,
        rule=settings.selection.rule,
        weights=tuple(settings.selection.weights),
        rule_settings=selection_rule(settings.selection).settings_read(settings.selection),
        promise=promise,
        navigation=navigate(problem.scene, path.t, path.x, path.u),
        height=height,
        air=flight_air(settings, height, measured),
        covered=coverage.covered,
        not_covered=coverage.not_covered,
        worst=worst_segment(problem, path) if front.rates else None,
        epsilon_kept=not front.rates or keeps_epsilon(problem, path),
    )
    if not plan.epsilon_kept:
        LOG.warning("%s", plan.breach(problem.scene))
    return plan


def covered_errors(settings: Settings) -> OwnErrors:
    """The robot's own errors that the law of the plan covers: none under the independent law."""
    from pareto_ltl.wind.coverage import EXACT, OwnErrors

    robot = settings.robot
    if settings.fidelity.law == "independent":
        return EXACT
    return OwnErrors(robot.airspeed_sd, robot.heading_sd, robot.clock_sd)


def make_forecasts(inputs: StageInputs) -> Mapping[str, Forecast]:
    """V and R of the plan under every law of ``deployment.laws``."""
    from pareto_ltl.planning.evaluate import forecast

    plan = inputs[keys.PLAN]
    return {law: forecast(inputs[keys.PROBLEM], plan.path.u, law) for law in inputs.settings.deployment.laws}


def make_deployments(inputs: StageInputs) -> Mapping[str, Deployment]:
    """Simulated flights of the plan under every law of ``deployment.laws``."""
    from pareto_ltl.simulation.flights import deploy_plan

    return deploy_plan(inputs.settings.deployment, inputs[keys.PROBLEM], inputs[keys.PLAN], inputs.seeds)


def make_export(inputs: StageInputs) -> tuple[Path, ...]:
    """Files of the plan, in the formats of ``exports.formats`` that the map and its departure allow."""
    settings, problem, plan = inputs.settings, inputs[keys.PROBLEM], inputs[keys.PLAN]
    if not settings.exports.files:
        return ()
    from pareto_ltl.exports.exported import exported_plan
    from pareto_ltl.exports.formats import writable_formats, write_exports

    formats, reason = writable_formats(settings.exports.formats, problem.scene, plan.path.t)
    if reason:
        LOG.info("%s", reason)
    if not formats:
        return ()
    exported = exported_plan(settings, problem, plan, inputs.seeds)
    return write_exports(exported, formats, inputs.directory)


def make_report(inputs: StageInputs) -> tuple[Path, ...]:
    """Figures of the records that exist; without a plan the map shows how far the trees came."""
    if not inputs.settings.report.figures:
        return ()
    from pareto_ltl.report.figures import draw_run_figures
    from pareto_ltl.report.records import DrawnRun

    run = DrawnRun(decomposition=inputs[keys.DECOMPOSITION], **drawn_records(inputs.records))
    return draw_run_figures(inputs.directory / "figures", inputs.settings.report, run)


def make_wind_table(inputs: StageInputs) -> Path:
    """The wind table of ``pipelines=ingest``; its path is relative to the current folder."""
    from pareto_ltl.wind.ingest import write_wind_table

    ingest = inputs.settings.ingest
    return write_wind_table(inputs.settings.wind, inputs[keys.READINGS], ingest, Path(ingest.out))


EXPORT_STREAM = "export"
FIGURE_FILES = tuple(f"figures/*.{kind}" for kind in FIGURE_FORMATS)
MAP_FILES, PLAN_FILES = "pareto_ltl.world.scene_files", "pareto_ltl.planning.plan_files"
SHOWN = (keys.FOREST, keys.FRONT, keys.PLAN, keys.DEPLOYMENTS, keys.FORECASTS)  # if they exist
PLAN_STAGES = (
    Stage(keys.READINGS, make_readings),
    Stage(keys.SCENE, make_scene, (keys.READINGS,), writes=("scene.json",), codec=f"{MAP_FILES}:scene"),
    Stage(
        keys.DECOMPOSITION, make_decomposition, (keys.SCENE,),
        writes=("cells.json",), codec=f"{MAP_FILES}:cells",
    ),
    Stage(
        keys.AUTOMATON, make_automaton, (keys.SCENE, keys.DECOMPOSITION),
        writes=("automaton.json", "automaton.hoa"), codec="pareto_ltl.logic.automaton_files:automaton",
    ),
    Stage(keys.OBSERVATIONS, make_observations, (keys.READINGS, keys.SCENE)),
    Stage(
        keys.WIND, make_wind, (keys.OBSERVATIONS, keys.SCENE),
        writes=("wind.nc",), codec="pareto_ltl.wind.netcdf:wind",
    ),
    Stage(keys.PROBLEM, make_problem, (keys.SCENE, keys.WIND, keys.DECOMPOSITION, keys.AUTOMATON)),
    Stage(
        keys.FOREST, make_forest, (keys.PROBLEM,), stream=FOREST_STREAM,
        writes=("trees.npz",), codec=f"{PLAN_FILES}:forest",
    ),
    Stage(
        keys.FRONT, make_front, (keys.PROBLEM, keys.FOREST), (keys.CANDIDATES,), stream="front",
        writes=("front.csv", "front.npz"), codec=f"{PLAN_FILES}:front",
    ),
    Stage(
        keys.PLAN, make_plan, (keys.PROBLEM, keys.WIND, keys.FRONT), stream="plan",
        writes=("plan.json", "plan.csv"), codec=f"{PLAN_FILES}:plan",
    ),
    Stage(keys.FORECASTS, make_forecasts, (keys.PROBLEM, keys.PLAN)),
    Stage(
        keys.DEPLOYMENTS, make_deployments, (keys.PROBLEM, keys.PLAN), stream=DEPLOYMENT_STREAM,
        writes=("deployments.npz",), codec="pareto_ltl.simulation.records:deployments",
    ),
    Stage(
        keys.EXPORTS, make_export, (keys.PROBLEM, keys.PLAN), stream=EXPORT_STREAM,
        writes=tuple(EXPORT_FILES.values()),
    ),
    Stage(keys.FIGURES, make_report, (keys.SCENE, keys.DECOMPOSITION, keys.WIND), SHOWN, shows=FIGURE_FILES),
    Stage(
        keys.PAGE, make_page, (keys.SCENE, keys.WIND), (keys.AUTOMATON, keys.PROBLEM, *SHOWN),
        stream=DEPLOYMENT_STREAM, shows=(PAGE_FILE,),
    ),
    Stage(keys.WIND_TABLE, make_wind_table, (keys.READINGS,)),
)  # fmt: skip
PLAN_TABLE = StageTable(PLAN_STAGES)
# For studies, which read no price: pricing is more than half of a small plan's time.
_UNPRICED = replace(PLAN_TABLE.maker_of(keys.PLAN), make=make_unpriced_plan)
UNPRICED_TABLE = StageTable(_UNPRICED if stage.makes is keys.PLAN else stage for stage in PLAN_STAGES)
