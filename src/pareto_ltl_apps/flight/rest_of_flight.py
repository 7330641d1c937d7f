"""The records of the rest of a flight: its map, wind, mission and settings, and the rest of the old plan.

The wind is the old one, conditioned on fixes, or a newer forecast, which is read, compared with the old one
and fitted. The searches are coarser, for a plan that is needed soon.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.fingerprints import file_hashes
from careful_io.messages import shown_text
from careful_io.texts import distance_text
from pareto_ltl import Readings, Run, Scene, Settings, WindField
from pareto_ltl.extend import (
    MissionConfig,
    PlannedPath,
    PowerConfig,
    Problem,
    SelectionConfig,
    WindConfig,
    completing_path,
    evaluate,
)
from pareto_ltl.support.arrays import FloatArray, length_of, square_matrices
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl_apps.branching.settings import BranchConfig
from pareto_ltl_apps.conditioning import Learnt
from pareto_ltl_apps.flight.known_errors import robot_given
from pareto_ltl_apps.flight.position_fixes import FAR, Situation, chance
from pareto_ltl_apps.formats.content import source_of_path
from pareto_ltl_apps.received import KnownFiles, law_file

LOG = logging.getLogger("pareto_ltl.flight.rest_of_flight")
HOUR = 3600.0
NewWind = Any  # a path, the keys of section wind, Readings or a WindField
STAGES = ("problem", "forest", "front", "plan", "forecasts", "deployment", "export", "report", "page")
AUTOMATON_FILE = "automaton.hoa"  # in the new directory: its mission
PROMPT_TREES, PROMPT_POINTS, PROMPT_FLIGHTS = 5, 6, 300  # upper limits of a plan that is made in the air
PROMPT_SHARE = 0.6  # of planner.n_max
RETURNS = (1, 2, 4, 8, 16)  # steps in which a candidate flies from the fix back to the old plan


def remaining_path(problem: Problem, path: PlannedPath, step: int) -> PlannedPath:
    """The steps of ``path`` from ``step`` on, with times from there."""
    costs = problem.costs_of(path.x[step:], path.u[step:])
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
    other, alarms = conditioned_run(run, situation, quick=quick), list[str]()
    if wind is not None:
        steps = run.settings.planner.max_steps
        if run.read is not None:
            require_known_law(run.settings, run.read, wind)
        cfg, field = newer_field(run.settings, wind, other.scene, steps)
        warn_of_use(run.wind, field, situation.time, float(rest.t[-1]))
        newer = Run(
            replace(other.settings, wind=cfg), other.records | {"wind": field},
            read=None if run.read is None else {**run.read, **wind_hashes(other.settings, cfg)},
        )  # fmt: skip
        alarms = field_alarms(other.problem, newer.problem, rest)
        other = newer
    other.records["candidates"] = candidates_of(other.problem, rest)
    return other, alarms


def candidates_of(problem: Problem, rest: PlannedPath) -> tuple[PlannedPath, ...]:
    """The rest of the old plan with its controls, and a way back to its positions, if they can be flown."""
    known = len(problem.wind.slot)
    if len(rest.u) > known:
        return ()
    same = evaluate(problem, u=rest.u).x
    found, near = list[PlannedPath](), list[PlannedPath]()
    for origin, x in (("rest of the old plan, same controls", same), *_ways_back(problem, rest)):
        if len(found) > 1 or (found and origin == found[-1].origin):
            break
        try:
            path = completing_path(problem, x, origin)
        except InfeasibleError:
            continue
        (found if problem.keeps_epsilon(path) else near).append(path)
    return tuple(found or near)


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
    learnt = situation.learnt
    assert learnt is not None
    scene = scene_from(run.scene, learnt.mean, situation.time)
    automaton = run.automaton.after(situation.state, situation.time)
    if automaton.contradiction:
        raise ConfigError("the mission is lost at that time: no continuation completes it")
    if run.problem.logic.distance[situation.state] == 0.0:
        raise ConfigError("the mission is complete at that time: nothing is left to plan")
    settings = settings_from(run, scene, situation)
    records = {
        "scene": scene,
        "cells": run.cells,
        "automaton": automaton,
        "wind": wind_from(run.wind, learnt, situation.time, run.settings.fidelity.law),
    }
    return Run(prompt_settings(settings) if quick else settings, records, read=run.read)


def settings_from(run: Run, scene: Scene, situation: Situation) -> Settings:
    """The settings of ``run`` with the departure, spread, mission and stages of the rest."""
    settings, problem = run.settings, run.problem
    assert situation.learnt is not None
    unbranched = replace(settings[BranchConfig], leaves=1, fixes=1)
    return replace(
        settings.with_sections(unbranched),
        mission=MissionConfig(start_time=scene.time_zero, automaton=AUTOMATON_FILE),
        selection=rule_of_the_rest(settings.selection, run.plan.path, situation.step),
        robot=replace(
            robot_given(settings.robot, situation.learnt),
            dt=problem.motion.dt,
            power=power_left(settings.robot.power, problem, run.plan.path, situation.step),
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
    """The selection of the rest: ``length`` less what was flown; ``worth`` instead of a ``point``.

    Extra paths begin at the departure of the whole flight, so the rest has none.
    """
    cfg = replace(cfg, extra_paths=None)
    if cfg.rule == "point":
        return replace(cfg, rule="worth")
    if cfg.length is None:
        return cfg
    flown = length_of(path.x[: step + 1])
    return replace(cfg, length=max(cfg.length - flown, 1.0))


def scene_from(scene: Scene, start: FloatArray, moment: float) -> Scene:
    """``scene`` with a departure ``moment`` [s] later from ``start``."""
    inside = (scene.bounds[0] <= start) & (start <= scene.bounds[1])
    if not inside.all():
        raise ConfigError(
            "the position expected after the fix lies outside the map, where no path can begin; check the fix"
        )
    return scene.later(moment, start)


def wind_from(field: WindField, learnt: Learnt, moment: float, law: str) -> WindField:
    """The wind from ``moment`` [s] on; under the coherent law conditioned on fixes."""
    later = field.later(moment)
    if law == "independent" or not len(learnt.told):
        return later
    return later.given(learnt.theta, learnt.told)


# --- a newer forecast -----------------------------------------------------------------------------


def newer_field(settings: Settings, wind: NewWind, scene: Scene, steps: int) -> tuple[WindConfig, WindField]:
    """Settings and field of a newer forecast for a departure at ``scene.time_zero``, of at most ``steps``.

    Raises
    ------
    DataError
        If the forecast cannot be read, or does not cover the time or the map.
    """
    cfg = newer_settings(settings.wind, wind)
    if isinstance(wind, WindField):
        return cfg, wind
    if scene.time_zero is None:
        raise ConfigError(
            "a newer forecast needs the date of the departure, which this plan does not have: set "
            "mission.start_time and plan again"
        )
    mission = replace(settings.mission, start_time=scene.time_zero)
    planner = replace(settings.planner, max_steps=steps)
    newer = Run(replace(settings, wind=cfg, mission=mission, planner=planner), {"scene": scene})
    if isinstance(wind, Readings):
        wind.check(cfg.max_speed)
        newer.records["readings"] = wind
    newer.make("readings")  # an error of a file is no error of its use
    try:
        field = newer.wind
    except DataError as error:
        raise DataError(f"the newer forecast cannot be used from {scene.time_zero} on: {error}") from None
    return cfg, field


def require_known_law(settings: Settings, read: Mapping[str, str], wind: NewWind) -> None:
    """DataError if the law of forecast errors of a directory is a file that its run has not read."""
    given = isinstance(wind, Mapping) and "forecast_error" in wind
    if not given and (name := law_file(settings)) is not None and not KnownFiles(None, read).knows(name):
        raise DataError(
            f"wind.forecast_error={shown_text(name)} of the plan is not there, or not the file that the run "
            "read; give the law from Python, replan(DIR, wind={'path': ..., 'forecast_error': FILE})"
        )


def wind_hashes(settings: Settings, cfg: WindConfig) -> dict[str, str]:
    """SHA-256 of the files of a newer forecast, by name."""
    changed = replace(settings, wind=cfg)
    return file_hashes(Run(changed).wind_files())


def newer_settings(cfg: WindConfig, wind: NewWind) -> WindConfig:
    """The settings of the wind with the path or source of ``wind``; the reader stays if it reads files."""
    if isinstance(wind, Mapping):
        newer = replace(cfg, **{"path": None, **wind})
        return newer if "level" in wind else newer.instead_of(cfg)
    if not isinstance(wind, str | Path):
        return replace(cfg, source="given", path=None)
    path = Path(wind).expanduser()
    if not path.exists() and not any(letter in str(wind) for letter in "*?["):
        raise ConfigError(f"wind {wind}: no such file; give a newer forecast (GRIB2, NetCDF or CSV)")
    source = cfg.source if cfg.reads_path else source_of_path(path)
    return replace(cfg, source=source, path=str(path)).instead_of(cfg)


# --- against the old wind -------------------------------------------------------------------------


def warn_of_use(old: WindField, new: WindField, moment: float, rest: float) -> None:
    """Log what is doubtful about a newer forecast: its age, and an end before the end of the old plan.

    The times of ``old`` count from the first departure, times of ``new`` from ``moment`` [s]; ``rest`` [s] is
    the time that the rest of the old plan takes.
    """
    before, now = issued(old), issued(new) + moment
    if now < before - 60.0:  # not if one of them is NaN
        LOG.warning(
            "the newer forecast is older than the one of the plan: it begins %.3g h before it; it is used "
            "in any case",
            (before - now) / HOUR,
        )  # fmt: skip
    if new.known_until < rest - 1.0:
        LOG.warning(
            "the newer forecast ends %.3g h before the old plan would arrive (%s): the new plan must arrive "
            "before; a forecast that reaches farther, or wind.hold_last=true, allows longer plans",
            (rest - new.known_until) / HOUR, new.ends,
        )  # fmt: skip


def issued(field: WindField) -> float:
    """Start of the latest forecast of ``field`` [s since its departure]; NaN if its leads are not known."""
    starts = field.times - field.leads
    known = starts[np.isfinite(starts)]
    return float(known.max()) if len(known) else math.nan


def field_alarms(old: Problem, new: Problem, rest: PlannedPath) -> list[str]:
    """A message if the law of the plan gives the newer forecast less than ``UNLIKELY``.

    The controls of the rest of the old plan are flown in both winds, from the same start. Half-way and at the
    end, the difference of the two places is Gaussian under the law, with at most the sum of both covariances.
    None for a robot with position feedback: it returns to its path, and says little about the wind.
    """
    if old.motion.gain > 0.0:
        return []
    flown = min(len(rest.u), len(old.wind.slot), len(new.wind.slot))
    u = rest.u[:flown]
    a, b = (evaluate(problem.from_known_place(), u=u) for problem in (old, new))
    apart, S = b.x - a.x, square_matrices(a.cov + b.cov)
    for t in (flown // 2, flown):
        far = math.sqrt(max(float(apart[t] @ np.linalg.pinv(S[t]) @ apart[t]), 0.0))
        if far > FAR:
            gap = float(np.linalg.norm(apart[t]))
            return [
                f"the newer forecast moves the robot by {distance_text(gap)} in "
                f"{t * old.motion.dt / HOUR:.3g} h, {far:.1f} standard deviations of what the "
                f"{old.fidelity.law} winds of the plan allow "
                f"(probability {chance(far):.1g}): is it another time, level or unit, or are its components "
                f"swapped? Or the wind is outside the law: {gap / (t * old.motion.dt):.1f} m/s off on average"
            ]
    return []


# --- coarser searches -----------------------------------------------------------------------------


def quick_settings(settings: Settings) -> Settings:
    """``settings`` with one coarse search only: a third of the time, slightly worse plans."""
    return replace(settings, refine=settings.refine.coarse())


def prompt_settings(settings: Settings) -> Settings:
    """``settings`` for a robot that waits for its plan: a smaller search than the quick one.

    The rest of the old plan is a candidate of the front, so that the new plan is not worse.
    """
    coarse = quick_settings(settings)
    refine = replace(
        coarse.refine,
        points=min(coarse.refine.points, PROMPT_POINTS),
        flights=min(coarse.refine.flights, PROMPT_FLIGHTS),
        sweep_flights=min(coarse.refine.sweep_flights, PROMPT_FLIGHTS),
    )
    planner = replace(
        coarse.planner,
        trees=min(coarse.planner.trees, PROMPT_TREES),
        n_max=max(1, int(PROMPT_SHARE * coarse.planner.n_max)),
    )
    return replace(coarse, refine=refine, planner=planner)
