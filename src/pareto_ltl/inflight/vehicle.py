"""What an autopilot reports by MAVLink messages and in ArduPilot's logs, and the commands for it.

A position is trusted from a satellite receiver that reports a fix in three dimensions, from odometry of a
camera or lidar with its covariance, and from an external estimate that somebody else sends to the vehicle.
The position that an autopilot estimates without satellites is not a measurement. Commands are acknowledged,
and sent again where they are not. Nothing here arms, disarms or changes a mode.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pareto_ltl.exports import mavlink
from pareto_ltl.inflight.telemetry import Reading
from pareto_ltl.inflight.watch import ELLIPSE, Event, Watch
from pareto_ltl.world.projection import to_geographic
from pareto_ltl.world.scene import Scene

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
    place = (message.lat / mavlink.DEGREE, message.lon / mavlink.DEGREE)
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
    if message.command != mavlink.POSITION_ESTIMATE or message.frame != mavlink.GLOBAL:
        return {}
    return {"place": (message.x / mavlink.DEGREE, message.y / mavlink.DEGREE), "sd": float(message.param3)}


def _charge(message: Any) -> Values:
    left = float(message.battery_remaining)
    return {"battery": left / 100.0} if left >= 0.0 else {}


MESSAGES: dict[str, Callable[[Any], Values]] = {
    "VFR_HUD": lambda message: {"airspeed": float(message.airspeed)},
    "ATTITUDE": lambda message: {"heading": math.degrees(message.yaw) % 360.0},
    "GPS_RAW_INT": _receiver,
    "ODOMETRY": _odometry,
    "GPS_GLOBAL_ORIGIN": lambda message: {
        "origin": (message.latitude / mavlink.DEGREE, message.longitude / mavlink.DEGREE)
    },
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


# --- commands -----------------------------------------------------------------------------------


KINDS = ("wind", "heading", "speed", "position", "prologue")
ACCEPTED = (0, 5)  # MAV_RESULT_ACCEPTED, MAV_RESULT_IN_PROGRESS
TRIES, PATIENCE = 3, 2.0  # how often a command is sent, and seconds to wait for its acknowledgement


@dataclass(slots=True)
class Waiting:
    """A command that is not acknowledged yet."""

    message: dict[str, Any]
    tries: int
    since: float


class Sender:
    """Sends commands to ``vehicle`` through ``mav``, an encoder of pymavlink.

    A command is an object of ``mavlink_script.json``: ``command`` and ``params``, with ``x``, ``y`` and ``z``
    for a COMMAND_INT.
    """

    def __init__(self, mav: Any, vehicle: Vehicle) -> None:
        self.mav, self.vehicle = mav, vehicle
        self.waiting: dict[int, Waiting] = {}

    def send(self, message: dict[str, Any]) -> None:
        """Send a command for the first time; one of the same kind is not waited for any longer."""
        self._encode(message, 0)
        if message.get("message") != mavlink.SET_ORIGIN:  # which has no acknowledgement
            self.waiting[message["command"]] = Waiting(message, 1, clock.time())

    def _encode(self, message: dict[str, Any], confirmation: int) -> None:
        target = (self.vehicle.system, self.vehicle.component)
        z = math.nan if message.get("z") is None else float(message["z"])
        if message.get("message") == mavlink.SET_ORIGIN:
            self.mav.set_gps_global_origin_send(target[0], message["x"], message["y"], round(1e3 * z))
        elif "x" in message:
            place = (message["x"], message["y"], z)
            self.mav.command_int_send(
                *target, mavlink.GLOBAL, message["command"], 0, 0, *message["params"], *place
            )
        else:
            self.mav.command_long_send(*target, message["command"], confirmation, *message["params"])

    def checked(self) -> Iterator[tuple[str, str]]:
        """Take acknowledgements, and send again what has none; yields kinds and texts of alarms."""
        while self.vehicle.acknowledged:
            command, result = self.vehicle.acknowledged.pop()
            if self.waiting.pop(command, None) is not None and result not in ACCEPTED:
                yield (
                    "refused",
                    f"the autopilot refuses {mavlink.NAMES.get(command, command)} (result {result})",
                )
        for command, one in list(self.waiting.items()):
            if clock.time() < one.since + PATIENCE:
                continue
            if one.tries < TRIES:
                self._encode(one.message, one.tries)
                one.tries, one.since = one.tries + 1, clock.time()
                continue
            del self.waiting[command]
            yield (
                "unacknowledged",
                f"the autopilot does not acknowledge {mavlink.NAMES[command]}, sent {TRIES} times",
            )


def prologue_of(scene: Scene, ground: float) -> tuple[dict[str, Any], ...]:
    """Origin, home and position at the start of ``scene``, ``ground`` [m] above mean sea level."""
    assert scene.crs is not None
    lon, lat = to_geographic(scene.crs, scene.start[None])
    return tuple(
        message | {"z": ground if "z" in message["fill_in"] else None}
        for message in mavlink.prologue(float(lat[0]), float(lon[0]), mavlink.LEAST_SD)
    )


# --- what is sent ---------------------------------------------------------------------------------


def at_status(sends: Sequence[str], event: Event) -> Iterator[tuple[str, dict[str, Any]]]:
    """Text and command of the wind and the position that a status reports."""
    if "wind" in sends:
        speed, sd, come_from = math.hypot(*event["wind"]), event["wind_sd"], event["wind_from"]
        doubt = min(math.degrees(math.atan2(sd, max(speed, 1e-6))), 180.0)
        text = f"wind {come_from:03.0f}/{speed:.1f} m/s, sd {sd:.1f} m/s and {doubt:.0f} deg"
        yield text, {"command": mavlink.WIND_ESTIMATE, "params": [speed, sd, come_from, doubt, 0, 0, 0]}
    if "position" in sends:
        sd = math.sqrt(0.5 * (event["major"] ** 2 + event["minor"] ** 2)) / ELLIPSE
        yield f"position estimate, sd {sd:.0f} m", {
            "command": mavlink.POSITION_ESTIMATE, "params": [event["time"], 0.0, sd, 0.0],
            "x": round(event["lat"] * mavlink.DEGREE), "y": round(event["lon"] * mavlink.DEGREE),
        }  # fmt: skip


def at_leg(sends: Sequence[str], watch: Watch) -> Iterator[tuple[str, dict[str, Any]]]:
    """Text and command of the airspeed and the heading of the step that the watch is in."""
    step, navigation = watch.belief.step, watch.plan.navigation
    east, north = watch.plan.path.u[step]
    if "speed" in sends:
        u = float(np.hypot(east, north))
        yield (
            f"airspeed {u:.1f} m/s",
            {"command": mavlink.CHANGE_SPEED, "params": [mavlink.AIRSPEED, u, mavlink.AT_ONCE, 0, 0, 0, 0]},
        )
    if "heading" in sends:
        heading = math.degrees(math.atan2(east, north)) % 360.0  # on a map without a place on Earth
        if navigation is not None and navigation.heading_true is not None:
            heading = float(navigation.heading_true[step])
        if math.isfinite(heading):
            params = [mavlink.HEADING, heading, mavlink.TURN, 0, 0, 0, 0]
            yield f"heading {heading:.0f} deg", {"command": mavlink.CHANGE_HEADING, "params": params}
