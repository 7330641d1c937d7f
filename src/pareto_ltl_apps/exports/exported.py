"""The record from which every format is written."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from numpy.random import SeedSequence

from careful_io.texts import listed_text, rate_text
from flight_quantities.medium import Medium
from pareto_ltl import Scene, Settings
from pareto_ltl.extend import (
    Branching,
    FailureRate,
    FlownAir,
    Height,
    Plan,
    PlannedPath,
    Problem,
    simulate_flights,
)
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.seeds import unspawned
from pareto_ltl_apps.exports.branches import ExportedBranch, branch_sentences, exported_branches
from pareto_ltl_apps.exports.corridor import Corridor, flown_corridor
from pareto_ltl_apps.exports.navigation_log import NavigationLog, navigation_log
from pareto_ltl_apps.exports.settings import ExportsConfig

GENERIC, FIXED_WING, MULTIROTOR, SUBMARINE = 0, 1, 2, 12  # MAV_TYPE
HELD_TIME = 60.0  # robot.feedback_time of an autopilot that holds positions [s]


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
    height : Height
        The height of the flight.
    air : FlownAir or None
        The air there; None in the water.
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
    airspeeds : (float, float)
        Least and largest true airspeed of the robot [m/s].
    branches : tuple of ExportedBranch
        What to fly after a position fix; empty for a plan without branches.
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
    air: FlownAir | None = None
    airspeeds: tuple[float, float] = (0.0, math.inf)
    branches: tuple[ExportedBranch, ...] = ()

    @property
    def autopilot_airspeed(self) -> FloatArray:
        """Airspeed of each leg (T,) [m/s] as autopilots mean it: calibrated; in the water, through it."""
        return self.log.airspeed if self.air is None else self.log.calibrated

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

    def questions(self) -> Iterator[tuple[Branching, Plan]]:
        """Each fix at which the plan branches, with the plan that is flown without it."""
        if (tree := self.plan.branching) is not None:
            yield tree, self.plan
        yield from ((one.branch.then, one.on_it) for one in self.branches if one.branch.then is not None)

    def sentences(self) -> tuple[str, ...]:
        """Sentences for every format that holds text: mission, failure rates, what they do not cover."""
        plan, promise, flows = self.plan, self.plan.promise, self.medium.flows

        def fails(rate: FailureRate, how: str) -> str:
            share = rate_text(rate.failure, rate.low, rate.high)
            return f"Of {rate.sample} flown {how} in {rate.law} {flows}, {share} fail."

        reported = [f"Mission {plan.formula}."]
        if promise is not None:
            reported.append(fails(promise.rate, self.flown_by()))
            if promise.rate.failure < promise.floor:
                reported.append(f"Promised: {promise.fails}.")
        if (tree := plan.branching) is not None:
            reported += branch_sentences(tree, self.log, self.branches)
        pilot = f"by an autopilot that knows and holds the positions (robot.feedback_time={HELD_TIME:g})"
        reported.append(f"{Plan.NO_PROMISE.capitalize()}." if self.held is None else fails(self.held, pilot))
        if self.log.swing > 0.0:
            reported.append(
                f"Turns take {self.log.late:.0f} s, which the times of the legs include. They lead up to "
                f"{self.log.swing:.0f} m away from the straight lines between the positions, which the "
                "failure rates leave out."
            )
        reported.append(height_sentence(self.height, self.air, self.medium))
        if gap := plan.level_gap:
            reported.append(f"The failure rates are no promise: {gap}.")
        if absent := absent_sentence(self.scene):
            reported.append(absent)
        if plan.not_covered:
            reported.append(f"Not covered: {plan.not_covered.rstrip('.')}.")
        return tuple(reported)


def height_sentence(height: Height, air: FlownAir | None, medium: Medium) -> str:
    """The height of the flight, whether a setting states it, and the two airspeeds there."""
    source = "" if height.stated else f", the level of the {medium.flow}, as robot.level is not set"
    sentence = f"Height {height.text}{source}."
    if air is None:
        return sentence
    factor = 1.0 / math.sqrt(air.density_ratio)
    return f"{sentence} True airspeed is {factor:.4f} times calibrated airspeed ({air.source})."


def absent_sentence(scene: Scene) -> str:
    """The places of the map that are above or below the flight; empty if there are none."""
    if not scene.absent:
        return ""
    return f"Above or below it, and not on this map: {listed_text([place.what for place in scene.absent])}."


def exported_plan(settings: Settings, problem: Problem, plan: Plan, seed: SeedSequence) -> ExportedPlan:
    """The data to export of ``plan``; its map must have a place on Earth."""
    corridor_seed, held_seed = unspawned(seed).spawn(2)
    cfg, motion = settings[ExportsConfig], problem.motion
    lower, upper = cfg.altitude_lower, cfg.altitude_upper
    height = settings.flight_height
    air = plan.air or settings.flight_air(height)
    return ExportedPlan(
        name=settings.name,
        scene=problem.scene,
        plan=plan,
        log=navigation_log(problem, plan.path, air),
        corridor=flown_corridor(problem, plan.path, cfg.flights, corridor_seed),
        held=None if plan.alarmed else held_course_rate(problem, plan.path, cfg.flights, held_seed),
        height=height,
        air=air,
        band=None if lower is None or upper is None else (lower, upper),
        feedback=None if motion.gain == 0.0 else motion.exposed * motion.dt / motion.gain,
        turn=problem.turns.acceleration,
        vehicle=vehicle_of(height, problem),
        medium=settings.medium,
        airspeeds=(motion.u_min, motion.u_max),
        branches=exported_branches(problem, plan, air),
    )


def held_course_rate(problem: Problem, path: PlannedPath, runs: int, seed: SeedSequence) -> FailureRate:
    """Failure rate of ``runs`` flights that hold the positions, within the airspeeds of the robot.

    They fly with ``robot.feedback_time=60``, instead of the headings and airspeeds of the plan.
    """
    held = problem.with_feedback(HELD_TIME)
    return simulate_flights(held, path.u, runs, problem.fidelity.law, seed, path.x).rate


def vehicle_of(height: Height, problem: Problem) -> Vehicle:
    """The vehicle: a submarine below the surface, else what the power curve or the least airspeed says."""
    if height.metres < 0.0:
        return Vehicle(SUBMARINE)
    if problem.energy is not None and problem.energy.hovers:
        return Vehicle(MULTIROTOR, height.metres > 0.0 and not height.above_sea, hovers=True)
    return Vehicle(FIXED_WING if problem.motion.u_min > 0.0 else GENERIC)
