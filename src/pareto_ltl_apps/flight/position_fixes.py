"""Position fixes as users give them, and the state of a flight that follows: position, wind, mission.

A fix to which the law gives a probability below :data:`UNLIKELY` is an alarm: the plan is made, because the
robot needs one, but it has no promise.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.messages import shown_value
from careful_io.reading import Advice, read_text
from careful_io.texts import distance_text
from careful_io.times import duration_seconds
from pareto_ltl import Run
from pareto_ltl.extend import Plan, PlannedPath, Problem
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.departure import seconds_after
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.conditioning import Fix, Learnt

LOG = logging.getLogger("pareto_ltl.flight.position_fixes")
UNLIKELY = 1e-4  # probability under the law below which a fix or a field is an alarm
FAR = math.sqrt(-2.0 * math.log(UNLIKELY))  # the same as a distance of two components [sd]
NEAR = 2.0  # standard deviations within which another time or place explains a fix
APART = 5.0  # standard deviations of their errors by which two fixes must differ to contradict each other
ADVICE = Advice("give the path of a CSV file", "expected a CSV file with the columns time,lat,lon,sd_m")
MAX_FIXES = 200
LEAST_SD = 0.01  # [m] fixes that are more accurate make the covariance of several singular
HISTORY = "replan history"  # stream of the past flights
HISTORIES = 2000  # simulated past flights that estimate the automaton state
VAGUE = 0.5  # of the least deviation of the position before: a less accurate fix gives a warning
COLUMNS = {True: ("time", "lat", "lon", "sd_m"), False: ("time", "x", "y", "sd_m")}  # by place on Earth

# --- when ---------------------------------------------------------------------------------------


def seconds_of(problem: Problem, what: str, time: float | str) -> float:
    """A time after departure [s]; ConfigError if ``time`` is none."""
    requested = time
    if isinstance(time, str) and (short := duration_seconds(time, "s")) is not None:
        requested = short
    try:
        return seconds_after(what, requested, problem.scene.time_zero)
    except DataError as error:
        raise ConfigError(str(error)) from None


def step_at(problem: Problem, plan: Plan, time: float | str, what: str = "time") -> int:
    """The step nearest to a time; raises ConfigError unless it lies within the plan."""
    dt, steps = problem.motion.dt, len(plan.path.u)
    seconds = seconds_of(problem, what, time)
    step = round(seconds / dt)
    if not 0 < step < steps:
        when = "before the first step" if step <= 0 else "after the last step"
        raise ConfigError(
            f"{what} {time} is {seconds / 3600:.4g} h after departure, {when} of the plan, which has steps "
            f"of {dt:g} s from 0 to {steps * dt / 3600:.4g} h: name a time after its first and before its "
            "last step, in UTC or after departure"
        )
    return step


# --- where --------------------------------------------------------------------------------------


def placed_fix(
    problem: Problem, plan: Plan, time: float | str, numbers: Sequence[float], what: str = "fix"
) -> Fix:
    """The fix in the plane, at the nearest step; raises ConfigError if it cannot be used.

    A fix between two steps is moved by what the plan flies between its time and the time of the step.
    """
    place = place_of(problem, numbers, what)
    step = step_at(problem, plan, time, "time" if what == "fix" else f"{what}: time")
    seconds, x = seconds_of(problem, what, time), plan.path.x
    late = seconds / problem.motion.dt - step
    beside = x[step + (1 if late > 0 else -1)]
    return Fix(place - abs(late) * (beside - x[step]), float(numbers[2]), step)


def place_of(problem: Problem, numbers: Sequence[float], what: str = "fix") -> FloatArray:
    """The position (2,) [m] of a fix; raises ConfigError if it is off the map, or its sd not positive."""
    scene = problem.scene
    names = "X,Y,SD" if scene.crs is None else "LAT,LON,SD"
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise ConfigError(f"{what} must be three numbers {names}, got {list(numbers)}")
    a, b, sd = map(float, numbers)
    if sd < LEAST_SD:
        raise ConfigError(
            f"{what}: its standard deviation must be at least {LEAST_SD:g} m, got {sd:g}; a satellite "
            "receiver has about 5 m"
        )
    if scene.crs is not None and abs(a) > 90.0:
        raise ConfigError(f"{what}: latitude must lie in [-90, 90] deg, got {a:g}; is it LAT,LON,SD?")
    place, swapped = in_plane(problem, a, b), in_plane(problem, b, a)
    if place is None or not on_map(problem, place):
        hint = (
            "; swapped, it would lie on the map" if swapped is not None and on_map(problem, swapped) else ""
        )
        raise ConfigError(f"{what} {a:g},{b:g} lies outside the map{hint}; expected {names}")
    return place


def in_plane(problem: Problem, a: float, b: float) -> FloatArray | None:
    """Latitude and longitude [deg], or x and y [m], as a position (2,) [m]; None if it is not a latitude."""
    if problem.scene.crs is None:
        return np.array([a, b])
    if abs(a) > 90.0:
        return None
    return np.asarray(problem.scene.frame.to_plane(np.array([b]), np.array([a]))[0], float)


def on_map(problem: Problem, place: FloatArray) -> bool:
    """Whether ``place`` (2,) lies within the bounds of the map."""
    low, high = problem.scene.bounds
    return bool((low <= place).all() and (place <= high).all())


# --- several ------------------------------------------------------------------------------------


def fix_rows(file: Path, *, on_earth: bool) -> list[tuple[str, str, list[float]]]:
    """Place in the file, time, and the three numbers of each fix; DataError for another content."""
    columns = COLUMNS[on_earth]
    rows = [[cell.strip() for cell in line.split(",")] for line in read_text(file, ADVICE).splitlines()]
    head = rows[0] if rows else []
    if sorted(head) != sorted(columns):
        raise DataError(
            f"{file}: the columns are {shown_value(','.join(head))}; expected {','.join(columns)} in the "
            "first line"
        )
    used = [(number, row) for number, row in enumerate(rows[1:], 2) if any(row)]
    if not 1 <= len(used) <= MAX_FIXES:
        raise DataError(f"{file}: {len(used)} fixes; expected 1 to {MAX_FIXES}, one a line")
    found = []
    for number, row in used:
        what = f"{file}, line {number}"
        if len(row) != len(head):
            raise DataError(f"{what}: {len(row)} values for {len(head)} columns; expected {','.join(head)}")
        cells = dict(zip(head, row, strict=True))
        time, *numbers = (cells[name] for name in columns)
        try:
            found.append((what, time, [float(number) for number in numbers]))
        except ValueError:
            text = shown_value(",".join(numbers))
            raise DataError(f"{what}: {text} are not three numbers; expected {','.join(columns)}") from None
    return found


def checked_fixes(problem: Problem, fixes: Iterable[Fix]) -> tuple[Fix, ...]:
    """The fixes in order of time; raises ConfigError if the robot cannot have been at two of them."""
    ordered = tuple(sorted(fixes, key=lambda fix: fix.step))
    wind = problem.wind
    fastest = float(
        np.linalg.norm(wind.mean, axis=-1).max() + 4.0 * np.sqrt(wind.latent.max() + wind.between.max())
    )
    for one, other in combinations(ordered, 2):
        gap = float(np.linalg.norm(one.place - other.place))
        hours = (other.step - one.step) * problem.motion.dt / 3600.0
        reach = 3600.0 * hours * (problem.motion.u_max + fastest)
        if gap > reach + APART * math.hypot(one.sd, other.sd):
            raise ConfigError(
                f"two fixes contradict each other: they are {distance_text(gap)} and {hours:g} h apart, "
                f"where the robot covers at most {distance_text(reach)}, and their standard deviations are "
                f"{distance_text(one.sd)} and {distance_text(other.sd)}: remove the wrong one, or give the "
                "standard deviations that they really have"
            )
    return ordered


# --- alarms -------------------------------------------------------------------------------------


def fix_alarms(problem: Problem, path: PlannedPath, fixes: Sequence[Fix], learnt: Learnt) -> list[str]:
    """A message for each fix to which the law of the plan gives less than :data:`UNLIKELY`."""
    law = problem.fidelity.law

    def gap(fix: Fix) -> str:
        return distance_text(float(np.linalg.norm(fix.place - path.x[fix.step])))

    return [
        f"the fix at step {fix.step} lies {gap(fix)} from the plan, {far:.1f} standard deviations of what "
        f"the {law} winds of the plan allow (probability {chance(far):.1g}): "
        f"{'; '.join(causes(problem, path, fix))}"
        for fix, far in zip(fixes, learnt.distance.tolist(), strict=True)
        if far > FAR
    ]  # fmt: skip


def chance(far: float) -> float:
    """Probability that two standard normal components are farther than ``far`` from 0."""
    return math.exp(-0.5 * far * far)


def causes(problem: Problem, path: PlannedPath, fix: Fix) -> list[str]:
    """Possible causes of an unlikely fix, the most specific first."""
    found, dt = [], problem.motion.dt
    off = _distances(path, fix.place, fix.sd)
    nearest = int(np.argmin(off))
    if off[nearest] < NEAR:
        late = (nearest - fix.step) * dt / 60.0
        found.append(
            f"is a clock wrong by {abs(late):.0f} min? The plan is expected there "
            f"{nearest * dt / 3600:.4g} h after departure"
        )
    if (swapped := _swapped(problem, fix)) is not None and _distances(path, swapped, fix.sd)[fix.step] < NEAR:
        found.append("are the two coordinates swapped? The other way round, it is where the plan expects it")
    drift = float(np.linalg.norm(fix.place - path.x[fix.step])) / max(fix.step * dt, 1.0)
    return [
        *found,
        f"is the place wrong? Or the wind is outside the law: {drift:.1f} m/s off on average since departure",
    ]


def _distances(path: PlannedPath, place: FloatArray, sd: float) -> FloatArray:
    """Distance (T+1,) of a measured ``place`` from the plan at each step, in standard deviations."""
    S = path.cov + sd**2 * np.eye(2)
    off = place - path.x
    return np.asarray(np.sqrt(np.einsum("ti,ti->t", off, np.linalg.solve(S, off[..., None])[..., 0])), float)


def _swapped(problem: Problem, fix: Fix) -> FloatArray | None:
    """The place of ``fix`` with its two coordinates swapped."""
    if problem.scene.crs is None:
        return fix.place[::-1]
    lon, lat = (float(value[0]) for value in problem.scene.frame.to_geographic(fix.place[None]))
    return in_plane(problem, lon, lat)


# --- the state of the flight ----------------------------------------------------------------------


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
    """The fixes that a user gives: one at ``time``, or a file or rows (time, latitude, longitude, sd).

    Raises
    ------
    DataError
        If the file cannot be read or has other columns.
    ConfigError
        If a fix cannot be used, or two contradict each other.
    """
    problem, plan = run.problem, run.plan
    if fix is not None and fixes is not None:
        raise ConfigError("fix and fixes are both given: put all fixes into the file, with their times")
    if fix is not None:
        if time is None:
            raise ConfigError("a fix needs its time: give --time, e.g. 6h or 2018-10-09T06:00:00Z")
        return (placed_fix(problem, plan, time, fix),)
    if fixes is None:
        return ()
    if isinstance(fixes, str | Path):
        rows: Iterable[Any] = fix_rows(Path(fixes).expanduser(), on_earth=problem.scene.crs is not None)
    elif wrong := [k for k, row in enumerate(fixes) if len(row) != 4]:
        raise ConfigError(
            f"fix {wrong[0]} has {len(fixes[wrong[0]])} values; expected time, latitude, longitude (or x, y) "
            "and standard deviation"
        )
    else:
        rows = ((f"fix {k}", row[0], row[1:]) for k, row in enumerate(fixes))
    return checked_fixes(problem, [placed_fix(problem, plan, when, at, what) for what, when, at in rows])


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
    problem, plan = run.problem, run.plan
    time = step * problem.motion.dt
    if not fixes and not ahead:
        return Situation(step, time, (), None, int(plan.path.q[step]), 1.0)
    learnt = Learnt.at(problem, plan.path.x, step, fixes)
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
    from pareto_ltl.extend import simulate_flights

    seeds, path = run.seeds(HISTORY), plan.path
    law = problem.fidelity.law
    x = simulate_flights(problem, path.u[:step], HISTORIES, law, seeds, path.x[: step + 1]).x
    if fixes:
        noise = np.random.default_rng(seeds).standard_normal((HISTORIES, 2 * len(fixes)))
        x = likely_histories(x, fixes, noise)
    states, counts = np.unique([problem.states(flight)[-1] for flight in x], return_counts=True)
    shares = counts / counts.sum()
    best = int(np.argmax(shares))
    if shares[best] < 0.5:
        distance = problem.logic.distance[states]
        open_states = np.flatnonzero((shares > 0.05) & np.isfinite(distance))
        best = int(open_states[np.argmax(distance[open_states])]) if len(open_states) else best
    return int(states[best]), float(shares[best])


def likely_histories(x: FloatArray, fixes: Sequence[Fix], noise: FloatArray) -> FloatArray:
    """Samples of flights given ``fixes``, from flights ``x`` (N, k+1, 2) [m] without them.

    Matheron's rule with the covariances of the flights: x + Cov(x_t, x_F) S⁻¹ (y + ν - x_F) with x_F the
    positions at the n fixes; ``noise`` (N, 2n) ~ N(0, 1).

    Eq. (M69) of docs/mathematics_methods.md.
    """
    at = [fix.step for fix in fixes]
    sd = np.repeat([fix.sd for fix in fixes], 2)
    there = x[:, at].reshape(len(x), -1)
    off, off_there = x - x.mean(axis=0), there - there.mean(axis=0)
    cross = np.einsum("nti,nj->tij", off, off_there) / max(len(x) - 1, 1)
    S = off_there.T @ off_there / max(len(x) - 1, 1) + np.diag(sd**2)
    gap = np.concatenate([fix.place for fix in fixes]) + sd * noise - there
    return np.asarray(x + np.einsum("tij,nj->nti", cross, np.linalg.solve(S, gap.T).T), float)
