"""The record from which every format is written."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.exports.corridor import Corridor, flown_corridor
from pareto_ltl.exports.navigation_log import NavigationLog, navigation_log
from pareto_ltl.kernels.pilots import Autopilot, Pilot
from pareto_ltl.planning.costs import Rotor
from pareto_ltl.planning.pack import with_feedback
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import NO_PROMISE, FailureRate, Plan, PlannedPath
from pareto_ltl.settings import ExportsConfig, Settings
from pareto_ltl.simulation.flights import erring_pilot, fly_pilot, own_errors, unspawned
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import rate_text
from pareto_ltl.support.medium import Medium, medium_of
from pareto_ltl.wind.levels import DEPTH, PRESSURE, parse_level
from pareto_ltl.world.scene import Scene

GENERIC, FIXED_WING, MULTIROTOR, SUBMARINE = 0, 1, 2, 12  # MAV_TYPE
HELD_TIME = 60.0  # robot.feedback_time of an autopilot that holds positions [s]


@dataclass(frozen=True, slots=True)
class Height:
    """Height of a flight [m]: above the ground of the start, or above mean sea level."""

    metres: float
    above_sea: bool

    @property
    def of_sea(self) -> bool:
        """Whether it is above mean sea level or a depth, so that no height of the ground is needed."""
        return self.above_sea or self.metres < 0.0


class Vehicle(NamedTuple):
    """The MAV_TYPE of a robot; whether it takes off vertically from the ground, and can hover."""

    kind: int
    takes_off: bool = False
    hovers: bool = False


@dataclass(frozen=True, slots=True)
class ExportedPlan:
    """A plan on a map with a place on Earth, and all data of the formats.

    Attributes
    ----------
    name : str
        Name of the run.
    log : NavigationLog
        Legs and expected positions.
    corridor : Corridor
        Ellipses that hold positions and whole flights.
    held : FailureRate or None
        Failure rate of the plan if an autopilot holds its positions (``robot.feedback_time=60``); None after
        an alarm.
    vehicle : Vehicle
        What autopilots call the robot, and whether it takes off vertically and can hover.
    medium : Medium
        What the robot moves in.
    band : (float, float) or None
        Lowest and highest height of the flight above the WGS 84 ellipsoid [m], where they are set.
    feedback : float
        ``robot.feedback_time`` of the plan [s]; None if it is flown without knowledge of the position.
    turn : float or None
        Centripetal acceleration of turns [m/s²]; None for a robot that turns on the spot.
    """

    name: str
    scene: Scene
    plan: Plan
    log: NavigationLog
    corridor: Corridor
    held: FailureRate | None
    height: Height
    vehicle: Vehicle
    medium: Medium
    band: tuple[float, float] | None
    feedback: float | None = None
    turn: float | None = None

    @property
    def crs(self) -> str:
        """PROJ string of the plane."""
        assert self.scene.crs is not None
        return self.scene.crs

    @property
    def law_words(self) -> str:
        """The wind law of the plan: ``coherent winds``."""
        return f"{self.log.law} {self.medium.flows}"

    def flown_by(self) -> str:
        """How a robot follows the plan: by heading and airspeed, with fixes or feedback if it has them."""
        fixes = " and fixes at landmarks" if self.log.fixes else ""
        feedback = (
            f" and feedback (robot.feedback_time={self.feedback:g} s)" if self.feedback is not None else ""
        )
        return f"by heading and {self.medium.speed}{fixes}{feedback}"

    def sentences(self) -> tuple[str, ...]:
        """Sentences for every format that holds text: mission, failure rates, what they do not cover."""
        plan, promise, flows = self.plan, self.plan.promise, self.medium.flows

        def fails(rate: FailureRate, how: str) -> str:
            share = rate_text(rate.failure, rate.low, rate.high)
            return f"Of {rate.sample} flown {how} in {rate.law} {flows}, {share} fail."

        told = [f"Mission {plan.formula}."]
        if promise is not None:
            told.append(fails(promise.rate, self.flown_by()))
        pilot = f"by an autopilot that knows and holds the positions (robot.feedback_time={HELD_TIME:g})"
        told.append(f"{NO_PROMISE.capitalize()}." if self.held is None else fails(self.held, pilot))
        if self.log.swing > 0.0:
            told.append(
                f"Turns take {self.log.late:.0f} s, which the times of the legs include. They lead up to "
                f"{self.log.swing:.0f} m away from the straight lines between the positions, which the "
                "failure rates leave out."
            )
        if plan.not_covered:
            told.append(f"Not covered: {plan.not_covered.rstrip('.')}.")
        return tuple(told)


def exported_plan(
    cfg: ExportsConfig, name: str, level: str, problem: Problem, plan: Plan, seed: SeedSequence
) -> ExportedPlan:
    """The data to export of ``plan``; its map must have a place on Earth. ``level``: of the flight."""
    corridor_seed, held_seed = unspawned(seed).spawn(2)
    lower, upper, motion = cfg.altitude_lower, cfg.altitude_upper, problem.motion
    height = height_of(level) if cfg.altitude is None else Height(cfg.altitude, above_sea=False)
    return ExportedPlan(
        name=name,
        scene=problem.scene,
        plan=plan,
        log=navigation_log(problem, plan.path),
        corridor=flown_corridor(problem, plan.path, cfg.flights, corridor_seed),
        held=None if plan.alarmed else held_course_rate(problem, plan.path, cfg.flights, held_seed),
        height=height,
        band=None if lower is None or upper is None else (lower, upper),
        feedback=None if motion.gain == 0.0 else motion.exposed * motion.dt / motion.gain,
        turn=problem.turns.acceleration,
        vehicle=vehicle_of(height, problem),
        medium=medium_of(level),
    )


def held_problem(problem: Problem) -> Problem:
    """``problem`` for a robot that always knows its position (``robot.feedback_time=60``)."""
    motion = with_feedback(problem.motion, HELD_TIME)
    return replace(problem, world=problem.world._replace(law=problem.world.law._replace(motion=motion)))


def held_course_rate(problem: Problem, path: PlannedPath, runs: int, seed: SeedSequence) -> FailureRate:
    """Failure rate of ``runs`` flights that hold the positions, within the airspeeds of the robot.

    They fly with ``robot.feedback_time=60``, instead of the headings and airspeeds of the plan.
    """
    pilot, law = Autopilot(path.u, np.ascontiguousarray(path.x)), problem.fidelity.law
    held, sd = held_problem(problem), own_errors(problem, law)

    def holding(_noise: FloatArray, errors: FloatArray) -> Pilot:
        return erring_pilot(pilot, path.u, sd, errors)

    return fly_pilot(held, holding, len(path.u), runs, law, seed).rate


def vehicle_of(height: Height, problem: Problem) -> Vehicle:
    """The vehicle: a submarine below the surface, else what the power curve or the least airspeed says."""
    if height.metres < 0.0:
        return Vehicle(SUBMARINE)
    if problem.energy is not None and isinstance(problem.energy.curve, Rotor):
        return Vehicle(MULTIROTOR, height.metres > 0.0 and not height.above_sea, hovers=True)
    return Vehicle(FIXED_WING if problem.motion.u_min > 0.0 else GENERIC)


def flown_level(settings: Settings) -> str:
    """The level of the flight: the level of the robot, or of the wind if the robot has none."""
    return settings.robot.level or settings.wind.level


def height_of(level: str) -> Height:
    """The height of a level; for a pressure, in the standard atmosphere (ISO 2533, up to 20 km)."""
    found = parse_level(level)
    if found.kind == PRESSURE and found.value < 22_632.0:  # the lower stratosphere, at 216.65 K throughout
        return Height(11_000.0 + 6_341.6 * math.log(22_632.0 / found.value), above_sea=True)
    if found.kind == PRESSURE:
        return Height(44_330.77 * (1.0 - (found.value / 101_325.0) ** 0.190_263), above_sea=True)
    return Height(-found.value if found.kind == DEPTH else found.value, above_sea=False)
