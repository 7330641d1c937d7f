"""Planning the rest of a flight again: position, wind error and remaining mission after position fixes.

Without fixes and without a newer forecast there is no new information, and the rest of the old plan is
unchanged. Position and wind are conditioned on fixes (``planning/conditioning.py``, ``wind/conditioned.py``),
or the wind is a newer forecast (``run/newer_wind.py``). The automaton continues from its most likely
state, and the stages from the trees on run with these records. The rest of the old plan is one of the paths
of the new front. The new plan and the rest of the old one are then simulated in the same winds; a plan that
fails significantly more often than the rest is replaced by a path of the front that does not.
"""

from __future__ import annotations

import logging
import math
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.planning.records import NO_PROMISE
from pareto_ltl.run.newer_wind import NewWind
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import (
    AUTOMATON,
    DECOMPOSITION,
    FOREST,
    FRONT,
    PLAN,
    PROBLEM,
    SCENE,
    WIND,
    RecordKey,
    Records,
)
from pareto_ltl.run.rest_of_flight import remaining_path, run_of_the_rest, scene_from
from pareto_ltl.run.situations import Situation, planned_step, situation_at
from pareto_ltl.run.stage_table import stage_seeds
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.display import Displayed, distance_text

if TYPE_CHECKING:
    from pareto_ltl.planning.conditioning import Fix
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import FailureRate, Front, Plan, PlannedPath
    from pareto_ltl.report.notebook import Drawing
    from pareto_ltl.support.arrays import BoolArray

LOG = logging.getLogger(__name__)
STREAM = "replan"  # stream of the compared flights
TRIES = 3  # paths of the front that are compared if the rule's choice is the worse plan
ADVICE = {
    "new": "the new plan is safer",
    "old": "the rest of the old plan is safer",
    "either": "neither is safer beyond chance",
    "outlasted": "the newer forecast ends before the rest of the old plan would arrive: how often that fails "
    "is not known, and the new plan arrives before",
    "alarm": f"{NO_PROMISE}; check the alarm before the new plan is flown",
}
KEPT: tuple[RecordKey[Any], ...] = (SCENE, DECOMPOSITION, AUTOMATON, WIND, PROBLEM, FOREST, FRONT)


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

    def plot(self, **options: Any) -> Drawing:
        """The map with the new plan, and the rest of the old one dashed."""
        from pareto_ltl.report.notebook import replanned_drawing

        scene = None if self.run is None else self.run.make(SCENE)
        return replanned_drawing(self.plan, self.rest, scene=scene, **options)


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
    from pareto_ltl.planning.records import counted_rate

    began = clock.perf_counter()
    problem, plan = run.make(PROBLEM), run.make(PLAN)
    step = planned_step(problem, plan, time, fixes)
    situation = situation_at(run, step, tuple(fixes), ahead=wind is not None)
    rest = remaining_path(problem, plan.path, step)
    if situation.learnt is None:
        return _carried_on(run, problem, plan, situation, rest, began)
    other, alarms = run_of_the_rest(run, situation, rest, wind, quick=quick)
    situation = replace(situation, alarms=(*situation.alarms, *alarms))
    for alarm in situation.alarms:
        LOG.warning("ALARM: %s", alarm)
    other.make(PLAN)
    seconds = clock.perf_counter() - began
    other, flown = never_worse(other, rest)
    if situation.alarms:
        other.records[PLAN] = other.make(PLAN).without_promise()
    new, *others = (counted_rate(problem.fidelity.law, int(row.sum()), len(row)) for row in flown)
    difference = paired_difference(flown[1], flown[0]) if others else (math.nan, math.nan, math.nan)
    return Replanned(
        situation, other, other.make(PLAN), rest, others[0] if others else None, new, difference, seconds,
        "" if wind is None else str(wind) if isinstance(wind, str | Path) else other.make(WIND).source,
    )  # fmt: skip


def never_worse(other: Run, rest: PlannedPath) -> tuple[Run, list[BoolArray]]:
    """A run whose plan does not fail significantly more often than ``rest``, and which flights of both fail.

    If the rule's choice does, the shortest path of the front is taken that fails no more often than the rest,
    which was judged with it; of the paths tried, the one with the fewest failures. A rest that outlasts the
    wind cannot be flown: then only the plan is flown.
    """
    from pareto_ltl.simulation.judging import which_fail_each

    problem, cfg = other.make(PROBLEM), other.settings.selection
    seeds = stage_seeds(other.settings.seed, STREAM)
    if len(rest.u) > len(problem.wind.slot):
        return other, list(which_fail_each(problem, [other.make(PLAN).path], cfg.runs, seeds))
    old, new = which_fail_each(problem, [rest, other.make(PLAN).path], cfg.runs, seeds)
    if paired_difference(old, new)[1] <= 0.0:
        return other, [new, old]
    front = other.make(FRONT)
    tried = _safer_points(front, float(old.mean()))
    if not tried:
        return other, [new, old]
    failed = which_fail_each(problem, [front.paths[k] for k in tried], cfg.runs, seeds)
    held = [row for row in range(len(tried)) if paired_difference(old, failed[row])[1] <= 0.0]
    row = held[0] if held else int(np.argmin(failed.sum(axis=1)))
    LOG.info("the choice of selection.rule=%s fails more often than the rest of the old plan", cfg.rule)
    selection = replace(cfg, rule="point", point=tried[row])
    records: dict[RecordKey[Any], Any] = {key: other.make(key) for key in KEPT}
    settings = replace(other.settings, selection=selection)
    safer = Run(settings, other.table, Records(records), dict(other.seconds))
    safer.make(PLAN)
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
    from pareto_ltl.planning.records import counted_rate
    from pareto_ltl.simulation.judging import which_fail
    from pareto_ltl.world.projection import navigate

    runs = run.settings.selection.runs
    failed = which_fail(problem, plan.path, runs, stage_seeds(run.settings.seed, STREAM))
    rate = counted_rate(problem.fidelity.law, int(failed.sum()), runs)
    seconds = clock.perf_counter() - began
    scene = scene_from(problem.scene, rest.x[0], situation.time)
    flown = len(plan.path.u) - len(rest.u)
    limits = plan.limits and plan.limits.after(flown)
    # Prices belong to the whole flight, at steps of its path.
    plan = replace(
        plan, path=rest, limits=limits, prices=(), navigation=navigate(scene, rest.t, rest.x, rest.u)
    )
    return Replanned(situation, None, plan, rest, rate, rate, (0.0, 0.0, 0.0), seconds)
