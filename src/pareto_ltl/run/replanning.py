"""Planning the rest of a flight again: position, wind and remaining mission after a fix or a new forecast.

Without either there is no new information, and the rest of the old plan is unchanged. With a fix, position
and wind are conditioned on it (``planning/conditioning.py``, ``wind/conditioned.py``); with a new forecast,
the wind is that of its file. The automaton continues from its most likely state, and the stages from the
trees on run with these records. The rest of the old plan is a candidate of the new front, and is compared
with the new plan in the same winds.
"""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.planning.conditioning import Fix, Learnt, learn_at, likely_histories, states_reached
from pareto_ltl.planning.costs import path_costs
from pareto_ltl.planning.evaluate import completing_path, propagate_controls
from pareto_ltl.run.extra_paths import EXTRA_FILE, write_extra_paths
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.quick import quick_settings
from pareto_ltl.run.records import AUTOMATON, DECOMPOSITION, PLAN, PROBLEM, SCENE, WIND, Records
from pareto_ltl.run.stage_table import stage_seeds
from pareto_ltl.settings import MissionConfig
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.display import Displayed, distance_text
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import FailureRate, Plan, PlannedPath
    from pareto_ltl.report.notebook import Drawing
    from pareto_ltl.settings import PowerConfig, SelectionConfig, Settings
    from pareto_ltl.support.arrays import FloatArray
    from pareto_ltl.wind.records import WindField
    from pareto_ltl.world.scene import Scene

LOG = logging.getLogger(__name__)
RETURN = 3.0  # steps in which a candidate returns to the positions of the old plan
STREAM, HISTORY = "replan", "replan history"  # streams of the compared flights, and of the past flights
HISTORIES = 2000  # simulated past flights that estimate the automaton state
VAGUE = 0.5  # of the least deviation of the position before: a less accurate fix gives a warning
WIND_STAGES = ("readings", "observations", "wind")  # with a new forecast
STAGES = ("problem", "forest", "front", "plan", "forecasts", "deployment", "export", "report", "page")
AUTOMATON_FILE = "automaton.hoa"  # in the new directory: its mission


@dataclass(frozen=True, slots=True)
class Situation:
    """Time, position and automaton state of a flight.

    Attributes
    ----------
    step : int
        Steps flown; ``time`` [s after departure] is its time.
    fix : Fix or None
    learnt : Learnt or None
        None without a fix.
    state : int
        Most likely automaton state, of probability ``certainty``.
    """

    step: int
    time: float
    fix: Fix | None
    learnt: Learnt | None
    state: int
    certainty: float


@dataclass(frozen=True, slots=True, repr=False)
class Replanned(Displayed):
    """A plan made during the flight, compared with the rest of the old one.

    Attributes
    ----------
    run : Run or None
        Records conditioned on the fix, with the new plan; None without a fix.
    plan : Plan
        The new plan; without a fix, the rest of the old one.
    old, new : FailureRate
        Of the rest of the old plan and of the new one, in the same fresh winds given the fix. Without a fix
        both are that of the whole old plan.
    difference : (float, float, float)
        New less old failure rate, and the ends of its 95 % interval.
    rest : PlannedPath
        The rest of the old plan.
    seconds : float
        Time from the records of the old plan to the new one [s].
    wind : str or None
        The file of a new forecast.
    """

    situation: Situation
    run: Run | None
    plan: Plan
    rest: PlannedPath
    old: FailureRate
    new: FailureRate
    difference: tuple[float, float, float]
    seconds: float
    wind: str | None = None

    @property
    def advice(self) -> str:
        """``new`` or ``old`` if one fails significantly less, else ``either``."""
        _, low, high = self.difference
        return "new" if high < 0.0 else "old" if low > 0.0 else "either"

    def facts(self) -> Mapping[str, str]:
        """When, the failure rates of both plans and their difference, and which of them to fly."""
        middle, *ends = self.difference
        return {
            "time": f"{self.situation.time / 3600:.1f} h after departure, step {self.situation.step}",
            "position fix": "none" if self.situation.fix is None else distance_text(self.situation.fix.sd),
            "old plan fails": str(self.old),
            "new plan fails": str(self.new),
            "new less old": f"{100 * middle:+.2g} % (95 %: {100 * ends[0]:+.2g} to {100 * ends[1]:+.2g} %)",
            "advice": self.advice,
        }

    def plot(self, **options: Any) -> Drawing:
        """The map with the new plan, and the rest of the old one dashed."""
        from pareto_ltl.report.notebook import replanned_drawing

        scene = None if self.run is None else self.run.make(SCENE)
        return replanned_drawing(self.plan, self.rest, scene=scene, **options)


# --- replanning ------------------------------------------------------------------------------


def replanned(
    run: Run,
    time: float | str,
    fix: Sequence[float] | Fix | None,
    *,
    quick: bool = True,
    wind: str | Path | None = None,
) -> Replanned:
    """Plan the rest of the plan of ``run`` again.

    Parameters
    ----------
    time : float or str
        When: seconds after departure, ``6h``, or an ISO 8601 time. Rounded to a step.
    fix : (latitude, longitude, sd) or (x, y, sd) or Fix, optional
        Measured position [deg, or m in a plane without place on Earth] and its standard deviation [m].
    quick : bool
        Whether to use a coarser refinement, which takes two seconds on phi2.
    wind : path, optional
        A newer forecast. The error of the old one, and what a fix says about it, are then forgotten.

    Raises
    ------
    ConfigError, DataError
        If the time, the fix or the forecast cannot be used.
    InfeasibleError
        If no path completes the mission from there.
    """
    from pareto_ltl.planning.records import counted_rate
    from pareto_ltl.simulation.judging import which_fail

    began = clock.perf_counter()
    problem, plan = run.make(PROBLEM), run.make(PLAN)
    step = step_at(problem, plan, time)
    measured = fix if fix is None or isinstance(fix, Fix) else checked_fix(problem, fix)
    situation = situation_at(run, problem, plan, step, measured, moved=wind is not None)
    rest = remaining_path(problem, plan.path, step)
    if situation.learnt is None:
        return _carried_on(run, problem, plan, situation, rest, began)
    other = _with_rest(conditioned_run(run, situation, quick=quick, wind=wind), rest)
    runs, seeds = run.settings.selection.runs, stage_seeds(run.settings.seed, STREAM)
    rest_failed = which_fail(other.make(PROBLEM), rest, runs, seeds)
    failed = which_fail(other.make(PROBLEM), other.make(PLAN).path, runs, seeds)
    if paired_difference(rest_failed, failed)[1] > 0.0:  # the selected point fails more often than the rest
        other = _with_safest(other)
        failed = which_fail(other.make(PROBLEM), other.make(PLAN).path, runs, seeds)
    seconds = clock.perf_counter() - began
    old, later = (counted_rate(problem.fidelity.law, int(f.sum()), runs) for f in (rest_failed, failed))
    gap = paired_difference(rest_failed, failed)
    name = None if wind is None else str(wind)
    return Replanned(situation, other, other.make(PLAN), rest, old, later, gap, seconds, name)


def _with_rest(other: Run, rest: PlannedPath) -> Run:
    """``other`` with the rest of the old plan as a candidate of its front, and the plan made.

    The rest is tried with its controls, and with its positions, reached from the new start with less and less
    of the old offset. What does not complete the mission from there is left out: its flights are compared.
    """
    problem = other.make(PROBLEM)
    gap = problem.scene.start - rest.x[0]
    fading = np.exp(-np.arange(len(rest.x)) / RETURN)[:, None]
    flown = propagate_controls(problem, np.ascontiguousarray(rest.u), problem.world.law).x
    able = []
    for origin, x in (("controls of the old plan", flown), ("old plan", rest.x + fading * gap)):
        with suppress(InfeasibleError):
            able.append((origin, completing_path(problem, np.ascontiguousarray(x), origin).x))
    if not able:
        other.make(PLAN)
        return other
    with TemporaryDirectory() as folder:
        file = Path(folder) / EXTRA_FILE
        write_extra_paths(file, able)
        selection = replace(other.settings.selection, extra_paths=str(file))
        Run(replace(other.settings, selection=selection), other.table, other.records).make(PLAN)
    return other


def _with_safest(other: Run) -> Run:
    """``other`` with the safest point of its front as the plan."""
    LOG.warning("the selected point of the front fails more often than the rest of the old plan: point 0")
    selection = replace(other.settings.selection, rule="point", point=0)
    records = Records({key: other.records[key] for key in other.records if key != PLAN})
    chosen = Run(replace(other.settings, selection=selection), other.table, records)
    chosen.make(PLAN)
    return chosen


def _carried_on(
    run: Run, problem: Problem, plan: Plan, situation: Situation, rest: PlannedPath, began: float
) -> Replanned:
    """The result without a fix: the rest of the old plan, with the failure rate of the whole plan."""
    from pareto_ltl.planning.records import counted_rate
    from pareto_ltl.simulation.judging import which_fail
    from pareto_ltl.world.navigation import navigate

    runs = run.settings.selection.runs
    failed = which_fail(problem, plan.path, runs, stage_seeds(run.settings.seed, STREAM))
    rate = counted_rate(problem.fidelity.law, int(failed.sum()), runs)
    seconds = clock.perf_counter() - began
    scene = scene_from(problem.scene, rest.x[0], situation.time)
    flown = len(plan.path.u) - len(rest.u)
    limits = plan.limits and plan.limits.after(flown)
    # Prices are those of the whole flight, at steps of its path.
    plan = replace(
        plan, path=rest, limits=limits, prices=(), navigation=navigate(scene, rest.t, rest.x, rest.u)
    )
    return Replanned(situation, None, plan, rest, rate, rate, (0.0, 0.0, 0.0), seconds)


# --- when and where ---------------------------------------------------------------------------


def step_at(problem: Problem, plan: Plan, time: float | str) -> int:
    """The step nearest to a time; raises ConfigError unless it lies within the plan."""
    from pareto_ltl.world.windows import duration_seconds, seconds_after

    dt, steps = problem.motion.dt, len(plan.path.u)
    asked = time
    if isinstance(time, str) and (short := duration_seconds(time, "s")) is not None:
        asked = short
    try:
        seconds = seconds_after("time", asked, problem.scene.time_zero)
    except DataError as error:
        raise ConfigError(str(error)) from None
    step = round(seconds / dt)
    if not 0 < step < steps:
        raise ConfigError(
            f"time {time} is {seconds / 3600:.4g} h after departure; the plan has steps of {dt:g} s from 0 "
            f"to {steps * dt / 3600:.4g} h: name a time after its first and before its last step"
        )
    if abs(step * dt - seconds) > 1e-6 * dt:
        LOG.warning(
            "time %s lies between two steps; step %d, %g s after departure, is taken", time, step, step * dt
        )
    return step


def checked_fix(problem: Problem, fix: Sequence[float]) -> Fix:
    """The fix in the plane; raises ConfigError if it is off the map or has no positive standard deviation."""
    from pareto_ltl.world.projection import to_plane

    scene = problem.scene
    names = "X,Y,SD" if scene.crs is None else "LAT,LON,SD"
    if len(fix) != 3 or not np.isfinite(fix).all():
        raise ConfigError(f"fix must be three numbers {names}, got {list(fix)}")
    a, b, sd = map(float, fix)
    if sd <= 0.0:
        raise ConfigError(f"fix: its standard deviation must be positive [m], got {sd:g}")
    if scene.crs is None:
        places = [np.array([a, b]), np.array([b, a])]
    else:
        if abs(a) > 90.0:
            raise ConfigError(f"fix: latitude must lie in [-90, 90] deg, got {a:g}; is it LAT,LON,SD?")
        places = [to_plane(scene.crs, np.array([b]), np.array([a]))[0]]
        if abs(b) <= 90.0:
            places.append(to_plane(scene.crs, np.array([a]), np.array([b]))[0])
    on_map = [bool((scene.bounds[0] <= p).all() and (p <= scene.bounds[1]).all()) for p in places]
    if not on_map[0]:
        swapped = "; swapped, it would lie on the map" if on_map[1:] == [True] else ""
        raise ConfigError(f"fix {a:g},{b:g} lies outside the map{swapped}; expected {names}")
    return Fix(places[0], sd)


def situation_at(
    run: Run, problem: Problem, plan: Plan, step: int, fix: Fix | None, *, moved: bool = False
) -> Situation:
    """Position, time and automaton state at ``step``, given the fix if there is one.

    ``moved``: the position is needed also without a fix, for a new forecast; it is then that of the plan.
    """
    dt = problem.motion.dt
    if fix is None:
        expected = learn_at(problem, plan.path.x, step, None) if moved else None
        return Situation(step, step * dt, None, expected, int(plan.path.q[step]), 1.0)
    learnt = learn_at(problem, plan.path.x, step, fix)
    if fix.sd > VAGUE * learnt.sd_before:
        LOG.warning(
            "the standard deviation of the fix, %s, is close to that of the planned position, %s: the "
            "covariance of position and wind after the fix is neglected",
            distance_text(fix.sd), distance_text(learnt.sd_before),
        )  # fmt: skip
    state, certainty = likely_state(run, problem, plan, step, fix)
    return Situation(step, step * dt, fix, learnt, state, certainty)


def likely_state(run: Run, problem: Problem, plan: Plan, step: int, fix: Fix) -> tuple[int, float]:
    """The automaton state of most simulated past flights, conditioned on the fix, and their share.

    If no state has half of them: of the states above 5 %, the one farthest from acceptance.
    """
    from pareto_ltl.simulation.flights import simulate_flights

    seeds, path = stage_seeds(run.settings.seed, HISTORY), plan.path
    law = problem.fidelity.law
    flown = simulate_flights(problem, path.u[:step], HISTORIES, law, seeds, path.x[: step + 1])
    noise = np.random.default_rng(seeds).standard_normal((HISTORIES, 2))
    reached = states_reached(problem, likely_histories(flown.x, fix, noise))
    states, counts = np.unique(reached, return_counts=True)
    shares = counts / counts.sum()
    best = int(np.argmax(shares))
    if shares[best] < 0.5:
        distance = problem.logic.distance[states]
        open_states = np.flatnonzero((shares > 0.05) & np.isfinite(distance))
        best = int(open_states[np.argmax(distance[open_states])]) if len(open_states) else best
    return int(states[best]), float(shares[best])


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


def conditioned_run(
    run: Run, situation: Situation, *, quick: bool, wind: str | Path | None = None
) -> Run:  # fmt: skip
    """A run that starts at the fix, in the conditioned wind or that of the file ``wind``."""
    from pareto_ltl.logic.progress import remaining_automaton

    learnt = situation.learnt
    assert learnt is not None
    scene = scene_from(run.make(SCENE), learnt.mean, situation.time)
    automaton = remaining_automaton(run.make(AUTOMATON), situation.state, situation.time)
    if automaton.contradiction:
        raise ConfigError("the mission is lost at that time: no continuation completes it")
    if run.make(PROBLEM).logic.distance[situation.state] == 0.0:
        raise ConfigError("the mission is complete at that time: nothing is left to plan")
    settings = settings_from(run, scene, situation)
    settings = quick_settings(settings) if quick else settings
    records = Records({SCENE: scene, DECOMPOSITION: run.make(DECOMPOSITION), AUTOMATON: automaton})
    if wind is None:
        records[WIND] = wind_from(run.make(WIND), learnt, situation.time, run.settings.fidelity.law)
        return Run(settings, run.table, records)
    other = Run(with_forecast(settings, Path(wind).expanduser()), run.table, records)
    warn_of_age(run.make(WIND), other.make(WIND), situation.time)
    return other


def with_forecast(settings: Settings, file: Path) -> Settings:
    """``settings`` with the wind of ``file``; its reader is that of the file's kind."""
    from pareto_ltl.wind.sources import source_of_file

    if not file.is_file():
        raise ConfigError(f"wind {file}: no such file; give a newer forecast (GRIB2, NetCDF or CSV)")
    stages = settings.pipelines.stages
    return replace(
        settings,
        wind=replace(settings.wind, source=source_of_file(file), path=str(file)),
        pipelines=replace(settings.pipelines, stages=[*WIND_STAGES, *stages]),
    )


def warn_of_age(old: WindField, new: WindField, moment: float) -> None:
    """A WARNING if the forecast ``new``, whose times count from ``moment`` [s], is not newer than ``old``."""
    made, before = (float(np.nanmax(f.times - f.leads, initial=-np.inf)) for f in (new, old))
    if np.isfinite([made, before]).all() and made + moment <= before:
        LOG.warning(
            "the forecast for the rest is not newer than that of the plan: it was made %.1f h earlier",
            (before - made - moment) / 3600.0,
        )


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
    from pareto_ltl.logic.progress import later_windows
    from pareto_ltl.world.navigation import utc_times

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
    """The wind from ``moment`` [s] on; under the coherent law conditioned on the fix."""
    from pareto_ltl.wind.conditioned import conditioned_field, field_from

    later = field_from(field, moment)
    return later if law == "independent" else conditioned_field(later, learnt.theta, learnt.told)
