"""State of a flight: the step and the fixes that a user gives, the position, the state of the mission."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.planning.conditioning import (
    Fix,
    Learnt,
    expected_at,
    learn_at,
    likely_histories,
    states_reached,
)
from pareto_ltl.run.position_fixes import (
    checked_fixes,
    fix_alarms,
    placed_fix,
    read_fixes,
    seconds_of,
    step_at,
)
from pareto_ltl.run.records import PLAN, PROBLEM
from pareto_ltl.run.stage_table import stage_seeds
from pareto_ltl.support.display import distance_text
from pareto_ltl.support.errors import ConfigError

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import Plan
    from pareto_ltl.run.pipeline import Run

LOG = logging.getLogger(__name__)
HISTORY = "replan history"  # stream of the past flights
HISTORIES = 2000  # simulated past flights that estimate the automaton state
VAGUE = 0.5  # of the least deviation of the position before: a less accurate fix gives a warning


@dataclass(frozen=True, slots=True)
class Situation:
    """Time, position and automaton state of a flight.

    Attributes
    ----------
    step : int
        Steps flown; ``time`` [s after departure] is its time.
    fixes : tuple of Fix
        The last one at ``step``; empty without a fix.
    learnt : Learnt or None
        Without fixes the position that is expected, for a newer forecast; None without one.
    state : int
        Most likely automaton state, of probability ``certainty``.
    alarms : tuple of str
        Fixes and fields that the law makes very unlikely: then the plan has no promise.
    """

    step: int
    time: float
    fixes: tuple[Fix, ...]
    learnt: Learnt | None
    state: int
    certainty: float
    alarms: tuple[str, ...] = ()


def fixes_from(
    run: Run,
    time: float | str | None,
    fix: Sequence[float] | None,
    fixes: str | Path | Sequence[Sequence[Any]] | None,
) -> tuple[Fix, ...]:
    """The fixes that a user gives: one at ``time``, or a file or rows (time, latitude, longitude, sd)."""
    problem, plan = run.make(PROBLEM), run.make(PLAN)
    if fix is not None and fixes is not None:
        raise ConfigError("fix and fixes are both given: put all fixes into the file, with their times")
    if fix is not None:
        if time is None:
            raise ConfigError("a fix needs its time: give --time, e.g. 6h or 2018-10-09T06:00:00Z")
        return (placed_fix(problem, plan, time, fix),)
    if fixes is None:
        return ()
    if isinstance(fixes, str | Path):
        return read_fixes(fixes, problem, plan)
    if wrong := [k for k, row in enumerate(fixes) if len(row) != 4]:
        raise ConfigError(
            f"fix {wrong[0]} has {len(fixes[wrong[0]])} values; expected time, latitude, longitude (or x, y) "
            "and standard deviation"
        )
    placed = [placed_fix(problem, plan, row[0], row[1:], f"fix {k}") for k, row in enumerate(fixes)]
    return checked_fixes(problem, placed)


def planned_step(problem: Problem, plan: Plan, time: float | str | None, fixes: Sequence[Fix]) -> int:
    """The step at which the new plan begins: the step of ``time``, or of the last fix."""
    last = fixes[-1].step if fixes else None
    if time is None:
        if last is None:
            raise ConfigError("replanning needs a time: give --time, e.g. 6h or 2018-10-09T06:00:00Z")
        return last
    step = step_at(problem, plan, time)
    late = seconds_of(problem, "time", time) - step * problem.motion.dt
    if last is not None and last != step:
        raise ConfigError(
            f"time {time} is step {step}, and the last fix is at step {last}: a plan begins at its last fix; "
            "leave --time out, or give a fix of that time"
        )
    if abs(late) > 1e-6 * problem.motion.dt:
        LOG.warning(
            "time %s lies between two steps; the new plan begins at step %d, %g s after departure%s", time,
            step, step * problem.motion.dt, ", where the fix is moved along the plan" if fixes else "",
        )  # fmt: skip
    return step


def situation_at(run: Run, step: int, fixes: tuple[Fix, ...], *, ahead: bool = False) -> Situation:
    """Position, time and automaton state at ``step``, given fixes; ``ahead``: there is a newer forecast."""
    problem, plan = run.make(PROBLEM), run.make(PLAN)
    time = step * problem.motion.dt
    if not fixes and not ahead:
        return Situation(step, time, (), None, int(plan.path.q[step]), 1.0)
    learnt = learn_at(problem, plan.path.x, step, fixes) if fixes else expected_at(problem, plan.path.x, step)
    if fixes and fixes[-1].sd > VAGUE * learnt.sd_before:
        LOG.warning(
            "the standard deviation of the fix, %s, is close to the standard deviation of the planned "
            "position, %s: the covariance of position and wind after the fix is neglected",
            distance_text(fixes[-1].sd), distance_text(learnt.sd_before),
        )  # fmt: skip
    state, certainty = likely_state(run, problem, plan, step, fixes)
    alarms = fix_alarms(problem, plan.path, fixes, learnt)
    return Situation(step, time, fixes, learnt, state, certainty, tuple(alarms))


def likely_state(
    run: Run, problem: Problem, plan: Plan, step: int, fixes: Sequence[Fix]
) -> tuple[int, float]:
    """The automaton state of most simulated past flights, conditioned on the fixes, and their share.

    If no state has half of them: of the states above 5 %, the one farthest from acceptance.
    """
    from pareto_ltl.simulation.flights import simulate_flights

    seeds, path = stage_seeds(run.settings.seed, HISTORY), plan.path
    law = problem.fidelity.law
    x = simulate_flights(problem, path.u[:step], HISTORIES, law, seeds, path.x[: step + 1]).x
    if fixes:
        noise = np.random.default_rng(seeds).standard_normal((HISTORIES, 2 * len(fixes)))
        x = likely_histories(x, fixes, noise)
    reached = states_reached(problem, x)
    states, counts = np.unique(reached, return_counts=True)
    shares = counts / counts.sum()
    best = int(np.argmax(shares))
    if shares[best] < 0.5:
        distance = problem.logic.distance[states]
        open_states = np.flatnonzero((shares > 0.05) & np.isfinite(distance))
        best = int(open_states[np.argmax(distance[open_states])]) if len(open_states) else best
    return int(states[best]), float(shares[best])
