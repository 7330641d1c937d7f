"""The records of the rest of a flight: its map, wind, mission and settings, and the rest of the old plan."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.planning.costs import path_costs
from pareto_ltl.run.newer_wind import NewWind, field_alarms, newer_field, warn_of_use
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.quick import prompt_settings
from pareto_ltl.run.records import AUTOMATON, CANDIDATES, DECOMPOSITION, PLAN, PROBLEM, SCENE, WIND, Records
from pareto_ltl.settings import MissionConfig
from pareto_ltl.support.errors import ConfigError, InfeasibleError

if TYPE_CHECKING:
    from pareto_ltl.planning.conditioning import Learnt
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import PlannedPath
    from pareto_ltl.run.situations import Situation
    from pareto_ltl.settings import PowerConfig, SelectionConfig, Settings
    from pareto_ltl.support.arrays import FloatArray
    from pareto_ltl.wind.records import WindField
    from pareto_ltl.world.scene import Scene

STAGES = ("problem", "forest", "front", "plan", "forecasts", "deployment", "export", "report", "page")
AUTOMATON_FILE = "automaton.hoa"  # in the new directory: its mission
RETURNS = (1, 2, 4, 8, 16)  # steps in which a candidate flies from the fix back to the old plan


def remaining_path(problem: Problem, path: PlannedPath, step: int) -> PlannedPath:
    """The steps of ``path`` from ``step`` on, with times from there."""
    costs = path_costs(problem, path.x[step:], path.u[step:])
    return replace(
        path,
        objectives=replace(path.objectives, costs=costs),
        t=path.t[step:] - path.t[step],
        x=path.x[step:],
        cov=path.cov[step:],
        q=path.q[step:],
        label=path.label[step:],
        u=path.u[step:],
        origin=f"{path.origin}, from step {step} on",
        fixes=tuple(fix - step for fix in path.fixes if fix >= step),
    )


# --- the conditioned world ---------------------------------------------------------------------


def run_of_the_rest(
    run: Run, situation: Situation, rest: PlannedPath, wind: NewWind | None, *, quick: bool
) -> tuple[Run, list[str]]:
    """A run of the rest of the flight, and the alarms about a newer forecast.

    It starts where the robot is expected to be, with the remaining mission, in the conditioned wind or in
    a newer forecast, and has the rest of the old plan as a candidate.
    """
    other = conditioned_run(run, situation, quick=quick)
    alarms: list[str] = []
    if wind is not None:
        old = other
        scene = old.make(SCENE)
        cfg, field = newer_field(run.settings, wind, scene, run.settings.planner.max_steps)
        warn_of_use(run.make(WIND), field, situation.time, float(rest.t[-1]))
        records = old.records.replaced(WIND, field)
        other = Run(replace(old.settings, wind=cfg), old.table, records)
        alarms = field_alarms(old.make(PROBLEM), other.make(PROBLEM), rest)
    other.records[CANDIDATES] = candidates_of(other.make(PROBLEM), rest)
    return other, alarms


def candidates_of(problem: Problem, rest: PlannedPath) -> tuple[PlannedPath, ...]:
    """The rest of the old plan with its controls, and a way back to its positions, if they can be flown."""
    from pareto_ltl.planning.evaluate import completing_path, propagate_controls
    from pareto_ltl.planning.refine.epsilon import keeps_epsilon

    known = len(problem.wind.slot)
    if len(rest.u) > known:
        return ()
    same = propagate_controls(problem, np.ascontiguousarray(rest.u), problem.world.law).x
    found: list[PlannedPath] = []
    for origin, x in (("rest of the old plan, same controls", same), *_ways_back(problem, rest)):
        if len(found) > 1 or (found and origin == found[-1].origin):
            break
        try:
            path = completing_path(problem, x, origin)
        except InfeasibleError:
            continue
        if keeps_epsilon(problem, path):
            found.append(path)
    return tuple(found)


def _ways_back(problem: Problem, rest: PlannedPath) -> list[tuple[str, FloatArray]]:
    """Positions (T+1, 2) [m] from the start of the problem to the path ``rest``, in more and more steps."""
    off = problem.scene.start - rest.x[0]
    steps = np.arange(len(rest.x))
    return [
        (
            "rest of the old plan, back to its positions",
            rest.x + np.maximum(1.0 - steps / n, 0.0)[:, None] * off,
        )
        for n in RETURNS
        if n < len(rest.x)
    ]


def conditioned_run(run: Run, situation: Situation, *, quick: bool) -> Run:
    """A run that starts at the fix, in the conditioned wind, with the remaining mission."""
    from pareto_ltl.logic.timed import remaining_automaton

    learnt = situation.learnt
    assert learnt is not None
    scene = scene_from(run.make(SCENE), learnt.mean, situation.time)
    automaton = remaining_automaton(run.make(AUTOMATON), situation.state, situation.time)
    if automaton.contradiction:
        raise ConfigError("the mission is lost at that time: no continuation completes it")
    if run.make(PROBLEM).logic.distance[situation.state] == 0.0:
        raise ConfigError("the mission is complete at that time: nothing is left to plan")
    settings = settings_from(run, scene, situation)
    records = Records(
        {
            SCENE: scene,
            DECOMPOSITION: run.make(DECOMPOSITION),
            AUTOMATON: automaton,
            WIND: wind_from(run.make(WIND), learnt, situation.time, run.settings.fidelity.law),
        }
    )
    return Run(prompt_settings(settings) if quick else settings, run.table, records)


def settings_from(run: Run, scene: Scene, situation: Situation) -> Settings:
    """The settings of ``run`` with the departure, spread, mission and stages of the rest."""
    settings, problem = run.settings, run.make(PROBLEM)
    assert situation.learnt is not None
    return replace(
        settings,
        mission=MissionConfig(start_time=scene.time_zero, automaton=AUTOMATON_FILE),
        selection=rule_of_the_rest(settings.selection, run.make(PLAN).path, situation.step),
        robot=replace(
            settings.robot,
            dt=problem.motion.dt,
            start_sd=situation.learnt.sd,
            power=power_left(settings.robot.power, problem, run.make(PLAN).path, situation.step),
        ),
        pipelines=replace(
            settings.pipelines, stages=[name for name in STAGES if name in settings.pipelines.stages]
        ),
    )  # fmt: skip


def power_left(cfg: PowerConfig, problem: Problem, path: PlannedPath, step: int) -> PowerConfig:
    """The power curve with the capacity that is left after ``step``."""
    if problem.energy is None or cfg.capacity is None or problem.energy.capacity is None:
        return cfg
    used = problem.energy.of(path.u[:step], problem.motion.dt) / problem.energy.capacity
    if used >= 1.0:
        raise ConfigError("the plan has used all of robot.power.capacity at that time")
    return replace(cfg, capacity=cfg.capacity * (1.0 - used))


def rule_of_the_rest(cfg: SelectionConfig, path: PlannedPath, step: int) -> SelectionConfig:
    """The selection of the rest: ``length`` less what was flown; ``worth`` instead of a ``point``."""
    if cfg.rule == "point":
        return replace(cfg, rule="worth")
    if cfg.length is None:
        return cfg
    flown = float(np.linalg.norm(np.diff(path.x[: step + 1], axis=0), axis=1).sum())
    return replace(cfg, length=max(cfg.length - flown, 1.0))


def scene_from(scene: Scene, start: FloatArray, moment: float) -> Scene:
    """``scene`` with a departure ``moment`` [s] later from ``start``."""
    from pareto_ltl.logic.timed import later_windows
    from pareto_ltl.world.projection import utc_times

    inside = (scene.bounds[0] <= start) & (start <= scene.bounds[1])
    if not inside.all():
        raise ConfigError(
            "the position expected after the fix lies outside the map, where no path can begin; check the fix"
        )
    later = utc_times(scene.time_zero, np.array([moment]))
    windows = later_windows(scene.windows, moment)
    return replace(
        scene, start=np.array(start, float), time_zero=None if later is None else later[0], windows=windows
    )


def wind_from(field: WindField, learnt: Learnt, moment: float, law: str) -> WindField:
    """The wind from ``moment`` [s] on; under the coherent law conditioned on fixes."""
    from pareto_ltl.wind.conditioned import conditioned_field, field_from

    later = field_from(field, moment)
    if law == "independent" or not len(learnt.told):
        return later
    return conditioned_field(later, learnt.theta, learnt.told)
