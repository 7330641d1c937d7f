"""The room around the drawing of a map without a border: five standard deviations of the position."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from careful_io.times import HOUR
from pareto_ltl.planning.power import energy_model
from pareto_ltl.settings import RobotConfig, Settings
from pareto_ltl.wind.displacement import displacement_variance, known_for
from pareto_ltl.wind.readings import Readings
from pareto_ltl.world.scene_sketch import SkyRoom
from pareto_ltl.world.time_step import DETOUR, SLOW

DEVIATIONS = 5.0
AIRSPEEDS = 50  # from u_min to u_max, at which the power is computed


class _Limit(NamedTuple):
    """A limit of the duration of a flight [s], and what sets it."""

    seconds: float
    reason: str


def sky_room(settings: Settings, readings: Readings, departure: str | None) -> Callable[[float], SkyRoom]:
    """The room for flights as a function of the length of a tour of all regions [m].

    Five standard deviations of the position after the longest flight T, predicted from errors of the wind
    (:func:`displacement_variance`) and errors of the robot ::

        Var = wind + ((airspeed_sd² + heading_sd²) T² + clock_sd²) u_max² + start_sd²

    A robot that knows its position, with ``robot.feedback_time``, accumulates errors for no longer than that.
    T is the least of: 1.5 tours at 0.6 u_max, for which ``robot.dt=auto`` provides too; the steps that a path
    may have; the energy of the robot at the airspeed of least power; the end of the wind. No plan leaves the
    drawing by more than half of its way, 0.6 u_max T / 2.
    """

    def room(tour: float) -> SkyRoom:
        robot = settings.robot
        limit = min(_limits(settings, readings, departure, tour))
        lasting = limit.seconds if robot.feedback_time is None else min(limit.seconds, robot.feedback_time)
        wind = displacement_variance(settings.wind, readings, departure, lasting) if lasting else 0.0
        sd = math.sqrt(wind + _own_variance(robot, lasting))
        half, flight = (
            SLOW * robot.u_max * limit.seconds / 2.0,
            f"{limit.reason}, {limit.seconds / HOUR:.3g} h",
        )
        if half < DEVIATIONS * sd:
            return SkyRoom(half, f"half of the way of {flight}")
        return SkyRoom(DEVIATIONS * sd, f"5 standard deviations of the position after {flight}")

    return room


def _limits(settings: Settings, readings: Readings, departure: str | None, tour: float) -> list[_Limit]:
    """What limits the duration of a flight."""
    robot = settings.robot
    limits = [
        _Limit(DETOUR * tour / (SLOW * robot.u_max), "a slow flight to all regions"),
        _Limit(known_for(settings.wind, readings, departure), "a flight to the end of the wind"),
    ]
    if not isinstance(robot.dt, str):
        limits.append(_Limit(settings.planner.max_steps * robot.dt, "a flight of planner.max_steps"))
    model = energy_model(robot.power)
    if model is not None and model.capacity is not None:
        least = float(model.curve.watts(np.linspace(robot.u_min, robot.u_max, AIRSPEEDS)).min())
        if least > 0.0:
            limits.append(_Limit(model.capacity / least, "a flight on all of the energy"))
    return limits


def _own_variance(robot: RobotConfig, duration: float) -> float:
    """Variance of the position [m²] by the errors of the robot and of its start."""
    relative = math.hypot(robot.airspeed_sd or 0.0, math.radians(robot.heading_sd or 0.0))
    own = (relative * duration) ** 2 + (robot.clock_sd or 0.0) ** 2
    return own * robot.u_max**2 + robot.start_sd**2
