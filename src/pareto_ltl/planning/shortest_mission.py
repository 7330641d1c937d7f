"""Reasons that exclude even the shortest line that completes the mission, flown in the expected wind.

The line keeps 2 m from obstacles, the border and the regions that the mission forbids at that moment; errors
of the wind and chance constraints do not matter here. Tested are, in this order: whether there is a line at
all, the strength of the wind, the end of the wind data or of ``planner.max_steps``, and time spans. A
setting is advised only if a line of the map has been flown with it.
For a mission that needs more energy than the robot has: another airspeed, or another vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from functools import partial
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from careful_io.texts import energy_text
from pareto_ltl.kernels import data as kd
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.planning.power import EnergyModel, energy_model
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Front
from pareto_ltl.planning.refine.starts import flown_lines, line_starts, paced_line
from pareto_ltl.planning.routes.obligations import MissionOrder, completes, possible_orders
from pareto_ltl.planning.routes.taut_lines import CAP, longest_share, taut_line, walk_line
from pareto_ltl.planning.wind_lookup import interpolate
from pareto_ltl.settings import RobotConfig
from pareto_ltl.support.arrays import FloatArray, length_of
from pareto_ltl.support.resources import CONF

MARGIN = 0.9  # share of the capacity that an advised vehicle may need on the shortest path
SPEEDS = 40  # airspeeds that are tried, in equal steps up to robot.u_max
MAX_ORDERS = 24  # mission orders that are tried
SLACK = 1.15  # plans are longer than the shortest line: needed time, over the time of the line
TIMES_LONGER = 2  # that many times the steps tell whether the time is too short
LONGER = 32  # a flight this many times as long as the wind is known counts as stopped by the wind
FASTEST = 16.0  # largest factor of robot.u_max that is tried
TRIALS, LARGER = 4, 1.1  # larger values of a setting that are tried, and the ratio of two of them
CLOSE = 1.01  # ratio of airspeeds at which the search of the smallest one ends


def mission_fault(problem: Problem) -> str:
    """Text on the reason that excludes the shortest line, and on the cure; empty if it can be flown."""
    lines = _mission_lines(problem)
    if not lines:
        why = closed_way(problem)
        return f"no path completes the mission: {why}" if why else ""
    seconds = _least_time(problem, lines)
    if math.isinf(seconds):
        return _too_windy(problem, lines)
    if seconds > problem.horizon * problem.motion.dt:
        return _too_long(problem, lines, seconds, SLACK)
    return "" if _may_be_in_time(problem, lines) else _too_late(problem, lines, seconds)


def longer_fault(problem: Problem, seconds: float) -> str:
    """Text for a mission whose paths take ``seconds``, longer than the wind is known, unlike its line."""
    lines = _mission_lines(problem)
    least = _least_time(problem, lines) if lines else math.inf
    return _too_long(problem, lines, least, max(SLACK, seconds / least)) if math.isfinite(least) else ""


def cautious_fault(problem: Problem) -> str:
    """Text if lines that keep a distance from obstacles would need more time than there is; else empty."""
    fitting = {start.origin for start in line_starts(problem)}
    longer = line_starts(with_longer_wind(problem, TIMES_LONGER))
    steps = [len(start.x) - 1 for start in longer if start.origin not in fitting]
    return longer_fault(problem, min(steps) * problem.motion.dt) if steps else ""


def with_longer_wind(problem: Problem, times: int) -> Problem:
    """``problem`` with ``times`` as many steps; after the wind data their last field is held."""
    steps, law = times * problem.horizon, problem.world.law

    def repeated(row: FloatArray) -> FloatArray:
        more = np.repeat(row[-1:], steps - len(law.wind.slot), axis=0)
        order: Literal["C", "F"] = "C" if row.flags.c_contiguous else "F"  # another one has to be compiled
        return np.array(np.concatenate([row, more]), order=order)

    def longer(model: Any, names: Sequence[str]) -> Any:
        return model._replace(**{name: repeated(getattr(model, name)) for name in names})

    changes = {"wind": longer(law.wind, ("slot", "weight", "between"))}
    if not isinstance(law, kd.IndependentLaw):
        changes["modes"] = longer(law.modes, ("slot", "epoch", "keep", "kept", "scale"))
    return replace(problem, world=problem.world._replace(law=law._replace(**changes)), max_steps=steps)


def flight_time(problem: Problem, line: FloatArray) -> float:
    """Time [s] along ``line`` (n, 2) at full airspeed in the expected wind; infinite if that is too strong.

    After the end of the wind data the last field is held.
    """
    motion, seconds, last = problem.motion, 0.0, len(problem.wind.slot) - 1
    for start, corner in pairwise(line):
        length, done = float(np.linalg.norm(corner - start)), 0.0
        far = 4.0 * problem.reach * (corner - start) / max(length, 1e-9)
        while length - done > 1e-6 * length:
            x, step = start + done / length * (corner - start), int(seconds / motion.dt)
            wind = interpolate(problem.wind, problem.wind.mean, min(step, last), x)
            share = longest_share(motion, x, x + far, wind)
            if share <= 1e-3 or seconds > LONGER * (last + 1) * motion.dt:
                return math.inf
            speed = share * 4.0 * problem.reach / motion.dt
            took = min(motion.dt * (step + 1 + 1e-9) - seconds, (length - done) / speed)
            done, seconds = done + took * speed, seconds + took
    return seconds


def _mission_lines(problem: Problem) -> list[FloatArray]:
    """The shortest line of each mission order that has one."""
    orders = possible_orders(problem, MAX_ORDERS)
    return [line for order in orders if (line := _line(problem, order)) is not None]


def _line(problem: Problem, order: MissionOrder) -> FloatArray | None:
    at_start, certain = problem.scene.start[None], np.zeros((1, 2, 2))
    return taut_line(problem, order, at_start, certain, 0.0, 0.0)


def _least_time(problem: Problem, lines: Sequence[FloatArray]) -> float:
    return min(flight_time(problem, line) for line in lines)


def _fits(problem: Problem, lines: Sequence[FloatArray], seconds: float, slack: float = SLACK) -> bool:
    """Whether a line takes at most ``seconds`` / ``slack``, with half a step more at each of its corners."""
    half = 0.5 * problem.motion.dt
    return any(slack * flight_time(problem, line) + half * (len(line) - 1) <= seconds for line in lines)


def _may_be_in_time(problem: Problem, lines: Sequence[FloatArray]) -> bool:
    """Whether a line completes the mission within its time spans if corners cost no time.

    Each corner of a walk is the end of a step, so the walk lasts longer; here it is as much faster.
    """
    for line in lines if len(problem.logic.delta) > 1 else ():
        x = walk_line(problem, line)
        if x is not None:
            share = (len(x) - 1) * problem.motion.dt / flight_time(problem, line)
            if _in_time(with_airspeed(problem, problem.motion.u_max * share), [line]):
                return True
    return len(problem.logic.delta) == 1


def _in_time(problem: Problem, lines: Sequence[FloatArray], slack: float = 1.0) -> bool:
    """Whether a line completes the mission in time with an airspeed that is ``slack`` times smaller."""
    slower = with_airspeed(problem, problem.motion.u_max / slack)
    walks = (walk_line(slower, line) for line in lines)
    return any(x is not None and completes(slower, paced_line(slower, x)) for x in walks)


def with_airspeed(problem: Problem, u_max: float) -> Problem:
    """``problem`` with another ``robot.u_max`` [m/s]."""
    law = problem.world.law
    law = law._replace(motion=law.motion._replace(u_max=u_max))
    return replace(problem, world=problem.world._replace(law=law))


# --- texts --------------------------------------------------------------------------------------


def closed_way(problem: Problem) -> str:
    """Text on the region that no line reaches, in the order that comes farthest; empty if it is not known."""
    orders = possible_orders(problem, MAX_ORDERS) if len(problem.logic.delta) == 1 else []
    if not orders:
        return ""
    reached = [_stages_reached(problem, order) for order in orders]
    best = int(np.argmax(reached))
    labels = ["/".join(sorted(label)) for label in orders[best].labels]
    before = f" after {', '.join(labels[: reached[best]])}" if reached[best] else " from the start"
    walls = "obstacles, the border" if problem.scene.walled else "obstacles"
    return (
        f"{walls} and regions that the mission forbids close every way{before} to region "
        f"{labels[reached[best]]!r}: move the start, a region or an obstacle"
    )


def _stages_reached(problem: Problem, order: MissionOrder) -> int:
    """The number of transitions of ``order`` that a line can make."""
    for n in range(len(order.labels) - 1, 0, -1):
        if _line(problem, MissionOrder(order.labels[:n], order.states[:n])) is not None:
            return n
    return 0


def _too_windy(problem: Problem, lines: Sequence[FloatArray]) -> str:
    """The wind is too strong for the robot somewhere on every line."""
    known, now = problem.horizon * problem.motion.dt, problem.motion.u_max
    u_max = flyable_airspeed(problem, partial(_fits, lines=lines, seconds=known))
    cure = f"set robot.u_max={u_max:g}" if u_max else "give the robot more airspeed"
    return (
        "no path completes the mission: on the shortest line the expected wind, up to "
        f"{_strongest_wind(problem, lines):.1f} m/s, is too strong for robot.u_max = {now:g} m/s: {cure}, or "
        "begin when the wind is weaker (mission.start_time)"
    )


def _strongest_wind(problem: Problem, lines: Sequence[FloatArray]) -> float:
    """Largest expected wind [m/s] in the data at places along the shortest line."""
    line = min(lines, key=length_of)
    wind, shares = problem.wind, np.linspace(0.0, 1.0, 33)[:, None]
    places = np.concatenate([a + shares * (b - a) for a, b in pairwise(line)])
    nodes = np.rint((places - [wind.west, wind.south]) * wind.per_metre).astype(int)
    nodes = np.clip(nodes, 0, np.array(wind.mean.shape[1:3]) - 1)
    return float(np.linalg.norm(wind.mean[:, nodes[:, 0], nodes[:, 1]], axis=-1).max())


def _too_long(problem: Problem, lines: Sequence[FloatArray], seconds: float, slack: float) -> str:
    """The wind data, or ``planner.max_steps``, end before a flight ``slack`` times as long as the line."""
    dt, known = problem.motion.dt, problem.horizon
    u_max = flyable_airspeed(problem, partial(_fits, lines=lines, seconds=known * dt, slack=slack))
    cures = [f"set robot.u_max={u_max:g}"] if u_max else []
    lasts = f"no path completes the mission: the shortest line {_duration(problem, seconds)}"
    if seconds <= known * dt:
        lasts += f", a path that keeps its distance from obstacles {_time(slack * seconds)}"
    enough = flyable_steps(problem, math.ceil(slack * seconds / dt) + max(map(len, lines)))
    if known == problem.max_steps:
        limit = f"planner.max_steps = {known} steps of {dt:g} s are {_time(known * dt)}"
        cures = [f"set planner.max_steps={enough}"] * bool(enough) + cures
        return f"{lasts}, and {limit}: {', or '.join(cures) or 'give the robot more airspeed'}"
    why = f" ({problem.wind_ends})" if problem.wind_ends else ""
    cures += [f"start {_time(slack * seconds - known * dt)} earlier if the wind is known then"]
    cures += ["give later wind fields"]
    if enough:
        more = f" planner.max_steps={enough}" * (enough > problem.max_steps)
        cures += [f"set wind.hold_last=true{more}"]
    wind = f"the wind is known for {_time(known * dt)}{_end_of_wind(problem)}{why}"
    return f"{lasts}, and {wind}: {', or '.join(cures)}"


def _duration(problem: Problem, seconds: float) -> str:
    u_max = problem.motion.u_max
    return f"takes {_time(seconds)} against the expected wind at robot.u_max = {u_max:g} m/s"


def _time(seconds: float) -> str:
    return f"{seconds / 3600:.1f} h" if seconds >= 3600.0 else f"{seconds / 60:.1f} min"


def _end_of_wind(problem: Problem) -> str:
    zero = problem.scene.time_zero
    if zero is None:
        return ""
    end = datetime.fromisoformat(zero) + timedelta(seconds=problem.horizon * problem.motion.dt)
    return f", until {end:%Y-%m-%dT%H:%M}Z"


def _too_late(problem: Problem, lines: Sequence[FloatArray], seconds: float) -> str:
    """Time spans of the formula or of the map end too early."""
    spans = late_spans(problem.automaton)
    if not spans:
        return ""
    u_max = flyable_airspeed(problem, partial(_in_time, lines=lines, slack=SLACK))
    cure = f", or set robot.u_max={u_max:g}" if u_max else ""
    return (
        f"no path completes the mission in time: the shortest line {_duration(problem, seconds)} and is too "
        f"late for its time spans ({'; '.join(spans)}): make them longer{cure}"
    )


def late_spans(automaton: Automaton) -> list[str]:
    """The time spans of the formula or of the map that can end too early, as texts."""
    return [
        f"{name if window.region else 'the time span'} {window}"
        for name, window in automaton.windows.items()
        if np.isfinite(window.end) and name not in automaton.forbidden
    ]


def flyable_airspeed(problem: Problem, works: Callable[[Problem], bool]) -> float | None:
    """The smallest robot.u_max [m/s] that ``works`` and with which a line can be flown; None if none is."""
    u_max = _least_airspeed(problem, works)
    for _ in range(TRIALS if u_max else 0):
        assert u_max is not None
        if can_be_flown(with_airspeed(problem, u_max)):
            return u_max
        u_max = _rounded_up(LARGER * u_max)
    return None


def flyable_steps(problem: Problem, steps: int) -> int | None:
    """The smallest planner.max_steps, from ``steps`` on, with which a line can be flown; None if none is.

    After the wind data their last field is held.
    """
    for _ in range(TRIALS):
        longer = with_longer_wind(problem, math.ceil(steps / problem.horizon))
        if can_be_flown(replace(longer, max_steps=steps)):
            return steps
        steps = math.ceil(LARGER * steps)
    return None


def can_be_flown(problem: Problem) -> bool:
    """Whether a line of the map can be flown as it is and completes the mission, whatever its risks are."""
    return bool(flown_lines(replace(problem, fidelity=replace(problem.fidelity, judge="flights"))))


def _least_airspeed(problem: Problem, works: Callable[[Problem], bool]) -> float | None:
    """The smallest robot.u_max [m/s] that ``works``, rounded up to 2 digits; None if none does."""
    low = problem.motion.u_max
    high = FASTEST * low
    if not works(with_airspeed(problem, high)):
        return None
    while high > CLOSE * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if works(with_airspeed(problem, middle)) else (middle, high)
    return _rounded_up(high)


def _rounded_up(speed: float) -> float:
    """``speed`` rounded up to 2 digits."""
    digit = 10.0 ** (math.floor(math.log10(speed)) - 1)
    return math.ceil(speed / digit - 1e-9) * digit


# --- energy -----------------------------------------------------------------------------------------


def capacity_advice(problem: Problem, front: Front) -> str:
    """What to change if every path needs too much energy; vehicles are flown along the shortest path."""
    path = min(front.paths, key=lambda one: one.objectives.length)
    slower, vehicle = _slower(problem, path.x), _vehicle(problem, path.x)
    ways = [text for text in (slower, vehicle) if text]
    return ", or ".join([*ways, "raise robot.power.capacity", "shorten the mission"])


def energy_at(problem: Problem, line: FloatArray, model: EnergyModel, u_max: float) -> float:
    """Energy [J] along ``line`` (n, 2) at the airspeed ``u_max``; infinite if that is too slow."""
    seconds = flight_time(with_airspeed(problem, u_max), line)
    known = seconds <= problem.horizon * problem.motion.dt
    return float(model.curve.watts(np.array(CAP * u_max))) * seconds if known else math.inf


def _slower(problem: Problem, line: FloatArray) -> str:
    """The airspeed of the least energy, if the robot's capacity suffices for it."""
    model, motion = problem.energy, problem.motion
    assert model is not None
    assert model.capacity is not None
    least = max(motion.u_min / CAP, motion.u_max / SPEEDS)
    speeds = np.linspace(least, motion.u_max, SPEEDS)
    energies = [energy_at(problem, line, model, float(speed)) for speed in speeds]
    enough = [k for k, energy in enumerate(energies) if energy <= MARGIN * model.capacity]
    if not enough:
        return ""
    best = int(np.argmin(energies))
    return f"set robot.u_max={speeds[best]:.3g}, with which the shortest needs {energy_text(energies[best])}"


def _vehicle(problem: Problem, line: FloatArray) -> str:
    """The preset with the smallest capacity that suffices, in the wind of this run."""
    from pareto_ltl.settings import Settings

    found: list[tuple[float, str, float, RobotConfig]] = []
    for name in CONF.names("robot"):
        robot: RobotConfig = Settings.of_section("robot", name)
        model = energy_model(robot.power)
        if model is None or model.capacity is None or "depth" in str(robot.level):  # under water
            continue
        needed = energy_at(problem, line, model, robot.u_max)
        if needed <= MARGIN * model.capacity:
            found.append((model.capacity, name, needed, robot))
    if not found:
        return ""
    capacity, name, needed, robot = min(found, key=lambda row: row[:2])
    return (
        f"take robot={name}, which needs {energy_text(needed)} of its {energy_text(capacity)} in this wind "
        f"(its level is {robot.level})"
    )
