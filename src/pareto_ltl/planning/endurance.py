"""Advice for a mission that needs more energy than the robot has: another airspeed, or another vehicle."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.planning.power import EnergyModel, energy_model
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Front
from pareto_ltl.planning.routes.taut_lines import CAP
from pareto_ltl.planning.shortest_mission import flight_time, with_airspeed
from pareto_ltl.settings import RobotConfig
from pareto_ltl.settings.building import section_of
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import energy_text
from pareto_ltl.support.resources import choices

MARGIN = 0.9  # share of the capacity that an advised vehicle may need on the shortest path
SPEEDS = 40  # airspeeds that are tried, in equal steps up to robot.u_max


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
    found: list[tuple[float, str, float, RobotConfig]] = []
    for name in choices("robot"):
        robot: RobotConfig = section_of("robot", name)
        model = energy_model(robot.power)
        if model is None or model.capacity is None or _is_under_water(robot):
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


def _is_under_water(robot: RobotConfig) -> bool:
    return "depth" in str(robot.level)
