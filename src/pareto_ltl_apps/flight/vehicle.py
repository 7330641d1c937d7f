"""What an autopilot reports by MAVLink messages and in ArduPilot's logs.

Sensors count from the component of the autopilot only: a gimbal or a companion computer has an attitude and a
receiver too. A position is trusted from a satellite receiver that reports a fix in three dimensions, from
odometry of a camera or lidar with its covariance, and from an external estimate that somebody else sends to
the vehicle. What an autopilot believes of its position without satellites is no measurement, nor is what this
program has sent and a router sends back. A heading or an airspeed older than :data:`AGE` is not flown.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pareto_ltl_apps.exports import mavlink
from pareto_ltl_apps.flight.airspeeds import Airspeeds
from pareto_ltl_apps.flight.clocks import ODD, Clock, SteadyClock
from pareto_ltl_apps.flight.telemetry import Reading

GUIDED = 15  # custom mode of ArduPlane in which it takes headings and airspeeds
FIX_3D, NO_AUTOPILOT = 3, 8  # GPS_FIX_TYPE_3D_FIX, MAV_AUTOPILOT_INVALID
ARDUPILOT, PX4 = 3, 12  # MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_AUTOPILOT_PX4
AEROPLANES = (1, *range(19, 26))  # MAV_TYPE of ArduPlane: fixed wings, and those that take off vertically
NO_VEHICLES = (6, 18, 26, 27, 30)  # MAV_TYPE: ground station, companion computer, gimbal, ADS-B, camera
AUTOPILOT1 = 1  # MAV_COMP_ID_AUTOPILOT1
OURS = (255, 25)  # system and component that we send as: a ground station, MAV_COMP_ID_USER1
ARMED = 128  # bit of base_mode
USUAL_SD = 5.0  # [m] of a satellite fix without an accuracy
MEASURED = (2, 3, 4, 6, 7)  # MAV_ESTIMATOR_TYPE: vision, vision with inertia, GPS, motion capture, lidar
LOCAL_NED = 1  # MAV_FRAME with its axes to north and east
EARTH = 6_371_008.8  # [m] mean radius, for the few kilometres of odometry
AGE = 2.0  # [s] above which a heading or an airspeed is not flown any longer
SIGNALS = ("heading", "airspeed")
REPEATS = 100  # messages of a component among which one is looked for again; their numbers repeat after 256

Values = dict[str, Any]


def _receiver(message: Any) -> Values:
    if message.fix_type < FIX_3D:
        return {"satellites": False}
    accuracy = float(getattr(message, "h_acc", 0) or 0) / 1e3
    place = (message.lat / mavlink.DEGREE, message.lon / mavlink.DEGREE)
    at = (message.time_usec, place) if message.time_usec else None
    return {"satellites": True, "place": place, "sd": accuracy or USUAL_SD, "measured": at}


def _logged_receiver(message: Any) -> Values:
    if message.Status < FIX_3D:
        return {}
    return {"place": (float(message.Lat), float(message.Lng)), "sd": USUAL_SD}


def _odometry(message: Any) -> Values:
    """North and east [m] from the origin, if something other than the autopilot's filter measured them."""
    variance = message.pose_covariance[0], message.pose_covariance[6]  # of north and east
    if message.estimator_type not in MEASURED or message.frame_id != LOCAL_NED or not min(variance) > 0.0:
        return {}
    at = (message.time_usec, message.x, message.y) if message.time_usec else None
    return {"north_east": (message.x, message.y), "sd": math.sqrt(0.5 * sum(variance)), "measured": at}


def _external(message: Any) -> Values:
    """The position of a command ``EXTERNAL_POSITION_ESTIMATE``, with its standard deviation."""
    if message.command != mavlink.POSITION_ESTIMATE or message.frame != mavlink.GLOBAL:
        return {}
    place = (message.x / mavlink.DEGREE, message.y / mavlink.DEGREE)
    at = (message.param1, place) if message.param1 else None
    return {"place": place, "sd": float(message.param3), "measured": at}


def _charge(message: Any) -> Values:
    left = float(message.battery_remaining)
    return {"battery": left / 100.0} if left >= 0.0 else {}


MESSAGES: dict[str, Callable[[Any], Values]] = {
    "VFR_HUD": lambda message: {"airspeed": float(message.airspeed)},
    "ATTITUDE": lambda message: {"heading": math.degrees(message.yaw) % 360.0},
    "SCALED_PRESSURE": lambda message: {"pressure": 100.0 * float(message.press_abs)},
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
    "BARO": lambda message: {"pressure": float(message.Press)},
    "GPS": _logged_receiver,
}  # of MAVLink, and of ArduPilot's logs
OTHERS = ("HEARTBEAT", "COMMAND_ACK", "COMMAND_INT")


@dataclass(slots=True)
class Vehicle:
    """What is known of the autopilot: its mode, its acknowledgements, and what it reports.

    Attributes
    ----------
    system, component : int
        Numbers of the vehicle; ``system`` 0: the first autopilot that is ``heard``.
    guided, armed, plane : bool
        As reported by the heartbeat at ``beaten`` [s after departure, by our clock].
    autopilot : int
        MAV_AUTOPILOT.
    satellites : bool or None
        Whether its receiver has a fix; None: it has not reported this yet.
    clock : Clock
        Tells the times of messages.
    airspeeds : Airspeeds
        Turns its airspeeds into true ones.
    strangers : set of int
        Other vehicles on the same link, which are ignored.
    signals : dict of str to float
        When heading and airspeed were measured last [s after departure].
    """

    system: int = 0
    component: int = 0
    clock: Clock = field(default_factory=SteadyClock)
    airspeeds: Airspeeds = field(default_factory=Airspeeds)
    heard: bool = False
    guided: bool = False
    beaten: float = -math.inf
    heading: float = math.nan
    armed: bool = False
    plane: bool = False
    autopilot: int = 0
    satellites: bool | None = None
    origin: tuple[float, float] | None = None
    signals: dict[str, float] = field(default_factory=dict)
    acknowledged: list[tuple[int, int]] = field(default_factory=list)
    strangers: set[int] = field(default_factory=set)
    recent: dict[tuple[int, int], deque[bytes]] = field(default_factory=dict)
    newest: dict[str, float] = field(default_factory=dict)  # time of the vehicle of the last of each kind [s]
    measured: dict[tuple[Any, ...], Any] = field(default_factory=dict)  # the last position of each source

    def reading(self, message: Any, arrival: float) -> Reading | None:
        """The reading of a message of this vehicle, or of a position that somebody sends to it; else None.

        ``arrival`` is when it came [s after departure].
        """
        kind = message.get_type()
        if kind not in MESSAGES and kind not in OTHERS:
            return None
        if not hasattr(message, "get_srcSystem"):  # logs that ArduPilot writes itself are of one vehicle
            second = getattr(message, "I", 0) != 0  # instance of a sensor
            return None if second else self._of_autopilot(message, kind, arrival)
        source = message.get_srcSystem(), message.get_srcComponent()
        if source == OURS:
            return None
        if self._repeated(message, source):
            return Reading(math.nan, fault="doubled")
        if kind == "COMMAND_INT":
            return self._estimate(message, source, arrival)
        if kind == "HEARTBEAT":
            self._choose(message, source)
        if not self.heard or source != (self.system, self.component):
            return None  # nothing is known of a vehicle before its first heartbeat
        if kind == "HEARTBEAT":
            self.autopilot = message.autopilot
            self.plane = message.autopilot == ARDUPILOT and message.type in AEROPLANES
            self.armed = bool(message.base_mode & ARMED)
            self.guided = self.plane and message.custom_mode == GUIDED and self.armed
            self.beaten = arrival
        if kind == "COMMAND_ACK" and getattr(message, "target_system", 0) in (0, OURS[0]):
            self.acknowledged.append((message.command, message.result))
        return self._of_autopilot(message, kind, arrival)

    # --- whose message it is ---

    def _choose(self, message: Any, source: tuple[int, int]) -> None:
        """Take the first autopilot that is heard; of several of one vehicle, its first autopilot."""
        if message.autopilot == NO_AUTOPILOT or message.type in NO_VEHICLES:
            return
        if not self.heard and self.system in (0, source[0]):
            (self.system, self.component), self.heard = source, True
        elif source[0] != self.system:
            self.strangers.add(source[0])
        elif source[1] == AUTOPILOT1:
            self.component = AUTOPILOT1

    def _repeated(self, message: Any, source: tuple[int, int]) -> bool:
        """Whether the same bytes with the same number have come from ``source`` a moment ago."""
        data = message.get_msgbuf()
        if not data:
            return False
        recent = self.recent.setdefault(source, deque(maxlen=REPEATS))
        if (data := bytes(data)) in recent:
            return True
        recent.append(data)
        return False

    # --- what it says ---

    def _estimate(self, message: Any, source: tuple[int, int], arrival: float) -> Reading | None:
        """The position of a command to this vehicle."""
        theirs = message.target_system in (0, self.system) and message.target_component in (0, self.component)
        if not self.heard or not theirs:
            return None
        time = self.clock.of_message(math.nan, arrival)
        assert time is not None  # without a time of the vehicle
        return self._place(_external(message), time, (*source, "COMMAND_INT"), ())

    def _of_autopilot(self, message: Any, kind: str, arrival: float) -> Reading | None:
        """The reading of a message of the autopilot."""
        boot, jumps = _boot(message), len(self.clock.jumps)
        time = self.clock.of_message(boot, arrival)
        if time is None:
            return Reading(math.nan, fault="old, or of another clock")
        if len(self.clock.jumps) > jumps:
            self.newest.clear()
        if kind in MESSAGES and self.newest.get(kind, -math.inf) - ODD < boot <= self.newest.get(kind, -1.0):
            return Reading(math.nan, fault="doubled")
        self.newest[kind] = boot
        for name in SIGNALS:
            self.signals.setdefault(name, time)
        lost, values = self.lost(time), MESSAGES[kind](message) if kind in MESSAGES else {}
        for name in ("satellites", "origin"):
            setattr(self, name, values.get(name, getattr(self, name)))
        if "pressure" in values:
            self.airspeeds.take_pressure(values["pressure"], time)
        if "north_east" in values and self.origin is not None:
            values["place"] = beside(self.origin, *values["north_east"])
        for name in SIGNALS:
            if math.isfinite(values.get(name, math.nan)):
                self.signals[name] = time
        self.heading = values.get("heading", self.heading)
        if "place" in values:
            return self._place(values, time, (kind,), lost)
        if "airspeed" in values and "heading" not in self.lost(time) and math.isfinite(self.heading):
            airspeed = self.airspeeds.true(values["airspeed"], time)
            return Reading(time, self.heading, airspeed, lost=lost)
        if "wind" in values or "battery" in values or lost:
            return Reading(
                time, wind=values.get("wind"), battery=values.get("battery", math.nan), lost=self.lost(time)
            )
        return None

    def lost(self, time: float) -> tuple[str, ...]:
        """The signals that are older than :data:`AGE` at ``time``."""
        return tuple(name for name in SIGNALS if time - self.signals.get(name, time) > AGE)

    def _place(
        self, values: Values, time: float, source: tuple[Any, ...], lost: tuple[str, ...]
    ) -> Reading | None:
        """The reading of a position; one that the same sensor has measured at the same time is doubled."""
        if "place" not in values:
            return None
        if values.get("measured") is not None and self.measured.get(source) == values["measured"]:
            return Reading(math.nan, fault="doubled")
        self.measured[source] = values.get("measured")
        return Reading(time, place=values["place"], sd=values["sd"], lost=lost)


def _boot(message: Any) -> float:
    """Time of the vehicle of a message [s]; NaN if it has none: senders without a clock write 0."""
    milliseconds = getattr(message, "time_boot_ms", 0) or 1e-3 * getattr(message, "TimeUS", 0)
    return milliseconds / 1e3 if milliseconds > 0 else math.nan


def beside(origin: tuple[float, float], north: float, east: float) -> tuple[float, float]:
    """Latitude and longitude [deg] of a place ``north`` and ``east`` [m] of ``origin``, on a sphere."""
    lat, lon = origin
    return (
        lat + math.degrees(north / EARTH),
        lon + math.degrees(east / (EARTH * math.cos(math.radians(lat)))),
    )
