"""What MAVLink messages and ArduPilot's logs report about one vehicle.

A position is trusted from a satellite receiver that reports a fix in three dimensions, from odometry of a
camera or lidar with its covariance, and from an external estimate that somebody else sends to the vehicle.
The position that an autopilot estimates without satellites is not a measurement.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pareto_ltl.exports.mavlink import DEGREE, GLOBAL, POSITION_ESTIMATE
from pareto_ltl.inflight.telemetry import Reading

GUIDED = 15  # custom mode of ArduPlane in which it takes headings and airspeeds
FIX_3D, NO_AUTOPILOT = 3, 8  # GPS_FIX_TYPE_3D_FIX, MAV_AUTOPILOT_INVALID
ARDUPILOT = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
AEROPLANES = (1, *range(19, 26))  # MAV_TYPE of ArduPlane: fixed wings, and those that take off vertically
ARMED = 128  # bit of base_mode
USUAL_SD = 5.0  # [m] of a satellite fix without an accuracy
MEASURED = (2, 3, 4, 6, 7)  # MAV_ESTIMATOR_TYPE: vision, vision with inertia, GPS, motion capture, lidar
LOCAL_NED = 1  # MAV_FRAME with its axes to north and east
EARTH = 6_371_008.8  # [m] mean radius, for the few kilometres of odometry

Values = dict[str, Any]


def _receiver(message: Any) -> Values:
    if message.fix_type < FIX_3D:
        return {"satellites": False}
    accuracy = float(getattr(message, "h_acc", 0) or 0) / 1e3
    place = (message.lat / DEGREE, message.lon / DEGREE)
    return {"satellites": True, "place": place, "sd": accuracy or USUAL_SD}


def _logged_receiver(message: Any) -> Values:
    if message.Status < FIX_3D:
        return {}
    return {"place": (float(message.Lat), float(message.Lng)), "sd": USUAL_SD}


def _odometry(message: Any) -> Values:
    """North and east [m] from the origin, if something other than the autopilot's filter measured them."""
    variance = message.pose_covariance[0], message.pose_covariance[6]  # of north and east
    if message.estimator_type not in MEASURED or message.frame_id != LOCAL_NED or not min(variance) > 0.0:
        return {}
    return {"north_east": (message.x, message.y), "sd": math.sqrt(0.5 * sum(variance))}


def _external(message: Any) -> Values:
    """The position of a command ``EXTERNAL_POSITION_ESTIMATE``, with its standard deviation."""
    if message.command != POSITION_ESTIMATE or message.frame != GLOBAL:
        return {}
    return {"place": (message.x / DEGREE, message.y / DEGREE), "sd": float(message.param3)}


def _charge(message: Any) -> Values:
    left = float(message.battery_remaining)
    return {"battery": left / 100.0} if left >= 0.0 else {}


MESSAGES: dict[str, Callable[[Any], Values]] = {
    "VFR_HUD": lambda message: {"airspeed": float(message.airspeed)},
    "ATTITUDE": lambda message: {"heading": math.degrees(message.yaw) % 360.0},
    "GPS_RAW_INT": _receiver,
    "ODOMETRY": _odometry,
    "GPS_GLOBAL_ORIGIN": lambda message: {"origin": (message.latitude / DEGREE, message.longitude / DEGREE)},
    "WIND": lambda message: {"wind": (float(message.direction) % 360.0, float(message.speed))},
    "SYS_STATUS": _charge,
    "BATTERY_STATUS": _charge,
    "ARSP": lambda message: {"airspeed": float(message.Airspeed)},
    "ATT": lambda message: {"heading": float(message.Yaw) % 360.0},
    "GPS": _logged_receiver,
}  # of MAVLink, and of ArduPilot's logs


@dataclass(slots=True)
class Vehicle:
    """What is known of the autopilot: its mode, its acknowledgements, and what it reports.

    Attributes
    ----------
    system, component : int
        Numbers of the vehicle; ``system`` 0: the first autopilot that is ``heard``.
    guided, armed, plane : bool
        As reported by the heartbeat at ``beaten`` [Unix time, s].
    satellites : bool or None
        Whether its receiver has a fix; None: it has not reported this yet.
    boot : float
        Time of the vehicle [s], from its last message with a time.
    strangers : set of int
        Other vehicles on the same link, which are ignored.
    """

    system: int = 0
    component: int = 0
    heard: bool = False
    guided: bool = False
    beaten: float = -math.inf
    heading: float = math.nan
    armed: bool = False
    plane: bool = False
    satellites: bool | None = None
    origin: tuple[float, float] | None = None
    boot: float = math.nan
    acknowledged: list[tuple[int, int]] = field(default_factory=list)
    strangers: set[int] = field(default_factory=set)

    def reading(self, message: Any, departure: float) -> Reading | None:
        """The reading of a message of this vehicle, or of a position that somebody sends to it; else None."""
        kind, source = message.get_type(), (0, 0)
        if hasattr(message, "get_srcSystem"):  # logs that ArduPilot writes itself are of one vehicle
            source = message.get_srcSystem(), message.get_srcComponent()
        time = message._timestamp - departure  # noqa: SLF001
        if kind == "COMMAND_INT" and message.target_system in (0, self.system) and self.heard:
            return self._reading(_external(message), time)
        if kind == "HEARTBEAT" and message.autopilot != NO_AUTOPILOT:
            if not self.heard and self.system in (0, source[0]):
                (self.system, self.component), self.heard = source, True
            elif source[0] != self.system:
                self.strangers.add(source[0])
        if source[0] != self.system:  # nothing is known of a vehicle before its first heartbeat
            return None
        if kind == "HEARTBEAT" and source == (self.system, self.component):
            self.plane = message.autopilot == ARDUPILOT and message.type in AEROPLANES
            self.armed = bool(message.base_mode & ARMED)
            self.guided = self.plane and message.custom_mode == GUIDED and self.armed
            self.beaten = message._timestamp  # noqa: SLF001
        if hasattr(message, "time_boot_ms"):
            self.boot = message.time_boot_ms / 1e3
        if kind == "COMMAND_ACK":
            self.acknowledged.append((message.command, message.result))
        return self._reading(MESSAGES[kind](message), time) if kind in MESSAGES else None

    def _reading(self, values: Values, time: float) -> Reading | None:
        for name in ("heading", "satellites", "origin"):
            setattr(self, name, values.get(name, getattr(self, name)))
        if "north_east" in values and self.origin is not None:
            values["place"] = beside(self.origin, *values["north_east"])
        if "place" in values:
            return Reading(time, place=values["place"], sd=values["sd"])
        if "airspeed" in values and math.isfinite(self.heading):
            return Reading(time, self.heading, values["airspeed"])
        if "wind" in values or "battery" in values:
            return Reading(time, wind=values.get("wind"), battery=values.get("battery", math.nan))
        return None


def beside(origin: tuple[float, float], north: float, east: float) -> tuple[float, float]:
    """Latitude and longitude [deg] of a place ``north`` and ``east`` [m] of ``origin``, on a sphere."""
    lat, lon = origin
    return (
        lat + math.degrees(north / EARTH),
        lon + math.degrees(east / (EARTH * math.cos(math.radians(lat)))),
    )
