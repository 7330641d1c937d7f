"""Planning the rest of a flight again: position, wind error and remaining mission after position fixes.

Without fixes and without a newer forecast there is no new information, and the rest of the old plan is
unchanged. Position and wind are conditioned on fixes (``conditioning.py``, ``wind_laws/conditioned.py``), or
the wind is a newer forecast (``rest_of_flight.py``). The automaton continues from its most likely state, and
the stages from the trees on run with these records. The rest of the old plan is one of the paths of the new
front. The new plan and the rest of the old one are then simulated in the same winds; a plan that fails
significantly more often than the rest is replaced by a path of the front that does not.
"""

from __future__ import annotations

import logging
import math
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.files import write_json
from careful_io.fingerprints import file_hashes
from careful_io.texts import distance_text, probability_text
from pareto_ltl import Readings, Run, WindField
from pareto_ltl.extend import (
    FailureRate,
    Front,
    Pipeline,
    Plan,
    Planned,
    PlannedPath,
    Problem,
    planned_run,
)
from pareto_ltl.support.arrays import BoolArray
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.display import Displayed
from pareto_ltl.support.seeds import stage_seeds
from pareto_ltl_apps.conditioning import Fix
from pareto_ltl_apps.flight.known_errors import errors_text, settings_of_errors
from pareto_ltl_apps.flight.position_fixes import Situation, fixes_from, planned_step, situation_at
from pareto_ltl_apps.flight.rest_of_flight import (
    AUTOMATON_FILE,
    NewWind,
    remaining_path,
    run_of_the_rest,
    scene_from,
)

LOG = logging.getLogger("pareto_ltl.flight.replanning")
STREAM = "replan"  # stream of the compared flights
# Stages that are left out after an alarm: their files are probabilities, or are flown.
NOT_ALARMED = ("front", "forecasts", "deployment", "export")
GROUNDED = (
    "no files to fly are written (no mission.plan, mavlink_script.json or tables), since they would be flown "
    "without a promise; when the alarm is explained, pareto-ltl export DIR writes them"
)
TRIES = 3  # paths of the front that are compared if the rule's choice is the worse plan
ADVICE = {
    "new": "the new plan is safer",
    "old": "the rest of the old plan is safer",
    "either": "neither is safer beyond chance",
    "outlasted": "the newer forecast ends before the rest of the old plan would arrive: how often that fails "
    "is not known, and the new plan arrives before",
    "alarm": f"{Plan.NO_PROMISE}; check the alarm before the new plan is flown",
}


@dataclass(frozen=True, slots=True, repr=False)
class Replanned(Displayed):
    """A plan made during the flight, compared with the rest of the old one.

    Attributes
    ----------
    run : Run or None
        Records of the rest of the flight, with the new plan; None without new information.
    plan : Plan
        The new plan; without new information, the rest of the old one.
    old, new : FailureRate
        Failure of the rest of the old plan and of the new one, in the same fresh winds given the fixes.
        Without new information, both are the rate of the whole old plan. Not valid if there are
        ``situation.alarms``. ``old`` is None if the newer forecast ends before the rest of the old plan
        would arrive.
    difference : (float, float, float)
        New less old failure rate, and the ends of its 95 % interval; NaN without ``old``.
    rest : PlannedPath
        The rest of the old plan.
    wind : str
        The file or source of the newer forecast; empty without one.
    seconds : float
        Time from the records of the old plan to the new one [s].
    """

    situation: Situation
    run: Run | None
    plan: Plan
    rest: PlannedPath
    old: FailureRate | None
    new: FailureRate
    difference: tuple[float, float, float]
    seconds: float
    wind: str = ""

    @property
    def advice(self) -> str:
        """``new`` or ``old`` if one fails significantly less, else ``either``.

        ``alarm``: unknown; ``outlasted``: the rest of the old plan lasts longer than the newer forecast.
        """
        _, low, high = self.difference
        if self.situation.alarms:
            return "alarm"
        if self.old is None:
            return "outlasted"
        return "new" if high < 0.0 else "old" if low > 0.0 else "either"

    def facts(self) -> Mapping[str, str]:
        """Time of the new plan, failure rates of both plans with their difference, and which one to fly."""
        at, (middle, *ends) = self.situation, self.difference
        facts = {
            "time": f"{at.time / 3600:.1f} h after departure, step {at.step}",
            "position fix": ", ".join(distance_text(fix.sd) for fix in at.fixes) or "none",
            **({"wind": self.wind} if self.wind else {}),
        }
        if at.alarms:
            return facts | {"alarm": "; ".join(at.alarms)}
        if self.old is None:
            return facts | {"new plan fails": str(self.new), "advice": ADVICE[self.advice]}
        return facts | {
            "old plan fails": str(self.old),
            "new plan fails": str(self.new),
            "new less old": f"{100 * middle:+.2g} % (95 %: {100 * ends[0]:+.2g} to {100 * ends[1]:+.2g} %)",
            "advice": self.advice,
        }

    def plot(self, **options: Any) -> Any:
        """The map with the new plan, and the rest of the old one dashed."""
        from pareto_ltl_apps.view.figures import replanned_drawing

        scene = None if self.run is None else self.run.scene
        return replanned_drawing(self.plan, self.rest, scene=scene, **options)


def replan(
    planned: Planned,
    time: float | str | None = None,
    fix: Sequence[float] | None = None,
    *,
    fixes: str | Path | Sequence[Sequence[Any]] | None = None,
    wind: str | Path | Mapping[str, Any] | Readings | WindField | None = None,
    quick: bool = True,
    out: str | Path | None = None,
) -> Replanned:
    """Plan the rest of a flight again, from position fixes or a newer forecast (docs/replanning.md).

    Parameters
    ----------
    planned : Run or path
        What :func:`plan` returned, or a results directory.
    time : float or str, optional
        When: seconds after departure, ``"6h"``, or an ISO 8601 time; rounded to a step of the plan. With
        ``fixes`` it is the time of the last one.
    fix : (latitude, longitude, sd) or (x, y, sd), optional
        Measured position [deg, or m on a map without a place on Earth] and its standard deviation [m].
    fixes : path or sequence of (time, latitude, longitude, sd), optional
        Several fixes: a CSV file with the columns ``time,lat,lon,sd_m`` (or ``time,x,y,sd_m``), or rows.
    wind : path, mapping, Readings or WindField, optional
        A newer forecast for the rest of the flight: a file that the reader of the plan's wind reads, or keys
        of section ``wind`` that differ.
    quick : bool
        Whether to use a coarser refinement, which takes about a third of the time.
    out : path, optional
        Write a results directory of the new plan there.

    Without fixes and without ``wind`` there is no new information, and the rest of the plan is unchanged.

    Raises
    ------
    ConfigError
        If the time lies outside the plan, or a fix is off the map or contradicts another one.
    DataError
        If the file of fixes or the newer forecast cannot be used.
    InfeasibleError
        If no path completes the mission from there.
    """
    run, place = planned_run(planned), None if out is None else Path(out)
    source = run.source(place)
    done = replanned(run, time, fixes_from(run, time, fix, fixes), wind=wind, quick=quick)
    if place is not None:
        write_replanned(done, run, place, str(source or "a plan in memory"))
    return done


# --- replanning ------------------------------------------------------------------------------


def replanned(
    run: Run,
    time: float | str | None,
    fixes: Sequence[Fix] = (),
    *,
    wind: NewWind | None = None,
    quick: bool = True,
) -> Replanned:
    """Plan the rest of the plan of ``run`` again.

    Parameters
    ----------
    time : float or str or None
        When: seconds after departure, ``6h``, or an ISO 8601 time; rounded to a step. None: at the last fix.
    fixes : sequence of Fix
        Measured positions in order of time, the last one at ``time``.
    wind : path, mapping, Readings or WindField, optional
        A newer forecast for the rest of the flight.
    quick : bool
        Whether to use a coarser refinement, which takes a second on phi2.

    Raises
    ------
    ConfigError
        If the time or a fix cannot be used.
    DataError
        If the newer forecast cannot be used.
    InfeasibleError
        If no path completes the mission from there.
    """
    began = clock.perf_counter()
    problem, plan = run.problem, run.plan
    step = planned_step(problem, plan, time, fixes)
    situation = situation_at(run, step, tuple(fixes), ahead=wind is not None)
    rest = remaining_path(problem, plan.path, step)
    if situation.learnt is None:
        return _carried_on(run, problem, plan, situation, rest, began)
    other, alarms = run_of_the_rest(run, situation, rest, wind, quick=quick)
    situation = replace(situation, alarms=(*situation.alarms, *alarms))
    for alarm in situation.alarms:
        LOG.warning("ALARM: %s", alarm)
    other.make("plan")
    seconds = clock.perf_counter() - began
    other, flown = never_worse(other, rest)
    if situation.alarms:
        other.records["plan"] = other.plan.without_promise()
    new, *others = (FailureRate.counted(problem.fidelity.law, int(row.sum()), len(row)) for row in flown)
    difference = paired_difference(flown[1], flown[0]) if others else (math.nan, math.nan, math.nan)
    return Replanned(
        situation, other, other.plan, rest, others[0] if others else None, new, difference,
        seconds,
        "" if wind is None else str(wind) if isinstance(wind, str | Path) else other.wind.source,
    )  # fmt: skip


def never_worse(other: Run, rest: PlannedPath) -> tuple[Run, list[BoolArray]]:
    """A run whose plan does not fail significantly more often than ``rest``, and which flights of both fail.

    If the rule's choice does, the shortest path of the front is taken that fails no more often than the rest,
    which was judged with it; of the paths tried, the one with the fewest failures. A rest that outlasts the
    wind cannot be flown: then only the plan is flown.
    """
    from pareto_ltl.extend import which_fail

    problem, cfg = other.problem, other.settings.selection
    seeds = stage_seeds(other.settings.seed, STREAM)
    if len(rest.u) > len(problem.wind.slot):
        return other, list(which_fail(problem, [other.plan.path], cfg.runs, seeds))
    old, new = which_fail(problem, [rest, other.plan.path], cfg.runs, seeds)
    if paired_difference(old, new)[1] <= 0.0:
        return other, [new, old]
    front = other.front
    tried = _safer_points(front, float(old.mean()))
    if not tried:
        return other, [new, old]
    failed = which_fail(problem, [front.paths[k] for k in tried], cfg.runs, seeds)
    held = [row for row in range(len(tried)) if paired_difference(old, failed[row])[1] <= 0.0]
    row = held[0] if held else int(np.argmin(failed.sum(axis=1)))
    LOG.info("the choice of selection.rule=%s fails more often than the rest of the old plan", cfg.rule)
    selection = replace(cfg, rule="point", point=tried[row])
    kept = other.make("scene", "cells", "automaton", "wind", "problem", "forest", "front")
    safer = Run(
        replace(other.settings, selection=selection), kept, seconds=dict(other.seconds), read=other.read
    )
    safer.make("plan")
    return safer, [failed[row], old]


def _safer_points(front: Front, failure: float) -> list[int]:
    """Paths of the front that fail no more often than ``failure``, the shortest first; else the safest."""
    lengths = [path.objectives.length for path in front.paths]
    rates = [rate.failure for rate in front.rates]
    able = [k for k in np.argsort(lengths, kind="stable").tolist() if rates and rates[k] <= failure]
    return (able or [int(np.argmin(rates))] * bool(rates))[:TRIES]


def _carried_on(
    run: Run, problem: Problem, plan: Plan, situation: Situation, rest: PlannedPath, began: float
) -> Replanned:
    """The result without a fix: the rest of the old plan, with the failure rate of the whole plan."""
    from pareto_ltl.extend import which_fail

    runs = run.settings.selection.runs
    failed = which_fail(problem, [plan.path], runs, run.seeds(STREAM))[0]
    rate = FailureRate.counted(problem.fidelity.law, int(failed.sum()), runs)
    seconds = clock.perf_counter() - began
    scene = scene_from(problem.scene, rest.x[0], situation.time)
    flown = len(plan.path.u) - len(rest.u)
    limits = plan.limits and plan.limits.after(flown)
    # Prices belong to the whole flight, at steps of its path.
    plan = replace(
        plan,
        path=rest,
        limits=limits,
        prices=(),
        branching=None,
        navigation=scene.frame.navigation(rest.t, rest.x, rest.u),
    )
    return Replanned(situation, None, plan, rest, rate, rate, (0.0, 0.0, 0.0), seconds)


# --- files and summary ----------------------------------------------------------------------------


def write_replanned(done: Replanned, run: Run, place: Path, source: str) -> None:
    """Write a results directory of the new plan; without a fix, the rest of the old one as ``plan.json``."""
    with Pipeline.of(run.settings).claimed(place):
        if done.run is not None:
            settings, records = done.run.settings, done.run.records
            mission = replace(settings.mission, automaton=str(place / AUTOMATON_FILE))
            if done.situation.alarms:
                left = [name for name in settings.pipelines.stages if name not in NOT_ALARMED]
                settings = replace(settings, pipelines=replace(settings.pipelines, stages=left))
                records = {name: found for name, found in records.items() if name != "front"}
            written = Run(
                replace(settings, mission=mission), dict(records), place, seconds=dict(done.run.seconds),
                read=None if done.run.read is None else {**done.run.read, **flown_hashes(source)},
            )  # fmt: skip
            Pipeline.of(settings, given=records).complete(written)
        else:
            place.mkdir(parents=True, exist_ok=True)
            Run.plan.save(place, done.plan)
        write_json(place / "replan.json", replan_document(done, source))


def flown_hashes(source: str) -> dict[str, str]:
    """SHA-256 of the plan that was flown, by which ``verify`` knows it; none if it was in memory."""
    plan = Path(source) / "plan.json"
    return file_hashes([plan]) if plan.is_file() else {}


def replan_document(done: Replanned, source: str) -> dict[str, Any]:
    """The content of ``replan.json``: the old plan, time and position, and the comparison of both plans."""
    at, learnt = done.situation, done.situation.learnt
    compared = not at.alarms
    return {
        "schema": "pareto_ltl.replan/2",
        "source": source,
        "step": at.step,
        "time_s": at.time,
        "fixes": [
            {"step": fix.step, "place": fix.place, "sd": fix.sd, "distance": far}
            for fix, far in zip(at.fixes, () if learnt is None else learnt.distance.tolist(), strict=True)
        ],
        "wind": done.wind or None,
        "alarms": list(at.alarms),
        "position": None
        if learnt is None
        else {"mean": learnt.mean, "cov": learnt.cov, "before": learnt.before},
        "errors": None if learnt is None or done.run is None else settings_of_errors(done.run.settings.robot),
        "state": at.state,
        "certainty": at.certainty,
        "rest": {"x": done.rest.x, "u": done.rest.u},
        "old": asdict(done.old) if compared and done.old is not None else None,
        "new": asdict(done.new) if compared else None,
        "difference": dict(zip(("middle", "low", "high"), done.difference, strict=True))
        if compared and done.old is not None
        else None,
    }


def errors_lines(done: Replanned) -> list[str]:
    """What the fixes say of the robot's own errors, for the user."""
    if done.run is None or not done.situation.fixes or done.situation.alarms:
        return []
    text = errors_text(done.run.settings.robot)
    return [f"by the fixes, {text}; headings and airspeeds of the new plan correct it"] if text else []


def comparison_lines(done: Replanned) -> list[str]:
    """The summary for the user."""
    at = done.situation
    lines = [f"step {at.step}, {at.time / 3600:.4g} h after departure"]
    if at.learnt is None:
        return [
            *lines,
            "no fix: there is no new information, and the rest of the plan is unchanged; "
            f"the failure rate of the whole flight is {done.old}",
        ]
    if at.fixes:
        lines.append(
            f"position known to {distance_text(at.learnt.sd)} (before: {distance_text(at.learnt.sd_before)} "
            f"or more); automaton state {at.state}, reached by {probability_text(at.certainty)} of the "
            "histories that lead to the fix"
        )
    else:
        lines.append(f"no fix: the position is known to {distance_text(at.learnt.sd)}; the forecast is new")
    lines += errors_lines(done)
    lines += [f"wind: {done.wind}"] if done.wind else []
    rest, new = (distance_text(path.objectives.length) for path in (done.rest, done.plan.path))
    if at.alarms:
        alarms = [f"ALARM: {alarm}" for alarm in at.alarms]
        planned = f"new plan: {new}; planned in {done.seconds:.1f} s"
        return [*lines, *alarms, planned, GROUNDED, ADVICE["alarm"]]
    fails = f"failure rate of the new plan ({new}): {done.new}"
    if done.old is None:
        return [*lines, fails, f"planned in {done.seconds:.1f} s", ADVICE[done.advice]]
    gap, low, high = (100.0 * value for value in done.difference)
    lines += [
        f"failure rate of the rest of the old plan ({rest}): {done.old}",
        fails,
        f"difference: {gap:+.2f} points [{low:+.2f}, {high:+.2f}]; planned in {done.seconds:.1f} s",
        ADVICE[done.advice],
    ]
    return lines
