"""Telemetry from an autopilot and messages to it, by MAVLink (pymavlink, the extra ``follow``).

A position is trusted only from a receiver that reports a fix in three dimensions; what an autopilot without
satellites believes of its own position is no measurement. Nothing here arms, disarms or changes a mode.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.exports.mavlink import (
    AIRSPEED,
    AT_ONCE,
    CHANGE_HEADING,
    CHANGE_SPEED,
    DEGREE,
    GLOBAL,
    HEADING,
    NAMES,
    POSITION_ESTIMATE,
    TURN,
    WIND_ESTIMATE,
)
from pareto_ltl.inflight.telemetry import Reading
from pareto_ltl.inflight.watch import ELLIPSE, Event, Watch
from pareto_ltl.support.errors import ConfigError, DataError

KINDS = {
    "wind": WIND_ESTIMATE, "heading": CHANGE_HEADING, "speed": CHANGE_SPEED, "position": POSITION_ESTIMATE,
}  # fmt: skip
GUIDED = 15  # custom mode of ArduPlane in which it takes headings and airspeeds
FIX_3D, NO_AUTOPILOT = 3, 8  # GPS_FIX_TYPE_3D_FIX, MAV_AUTOPILOT_INVALID
ARDUPILOT = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
AEROPLANES = (1, *range(19, 26))  # MAV_TYPE of ArduPlane: fixed wings, and those that take off vertically
STALE = 5.0  # [s] after its last heartbeat the mode of a vehicle is not known any longer
ACCEPTED = (0, 5)  # MAV_RESULT_ACCEPTED, MAV_RESULT_IN_PROGRESS
ARMED = 128  # bit of base_mode
TRIES, PATIENCE = 3, 2.0  # how often a command is sent, and seconds to wait for its acknowledgement
BEAT = 1.0  # [s] between two heartbeats, and the longest wait for a message
IDLE = 5.0  # [s] without a message after which the time is passed on
USUAL_SD = 5.0  # [m] of a satellite fix without an accuracy


def departure_time(time_zero: str | None, given: str | None) -> float | None:
    """Unix time of the departure [s]; None: the first message. ``given`` is ``now`` or an ISO 8601 time.

    Raises
    ------
    ConfigError
        If ``given`` is no time.
    """
    if given == "now":
        return None
    text = given or time_zero
    if text is None:
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ConfigError(
            f"--departure must be now or a time such as 2018-10-09T06:00:00Z, got {text}"
        ) from None
    return (moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment).timestamp()


# --- messages -------------------------------------------------------------------------------------


def _hud(message: Any) -> dict[str, float]:
    return {"airspeed": float(message.airspeed)}


def _yaw(message: Any) -> dict[str, float]:
    return {"heading": math.degrees(message.yaw) % 360.0}


def _receiver(message: Any) -> dict[str, float]:
    if message.fix_type < FIX_3D:
        return {}
    accuracy = float(getattr(message, "h_acc", 0) or 0) / 1e3
    return {"lat": message.lat / DEGREE, "lon": message.lon / DEGREE, "sd": accuracy or USUAL_SD}


def _logged_receiver(message: Any) -> dict[str, float]:
    if message.Status < FIX_3D:
        return {}
    return {"lat": float(message.Lat), "lon": float(message.Lng), "sd": USUAL_SD}


MESSAGES: dict[str, Callable[[Any], dict[str, float]]] = {
    "VFR_HUD": _hud,
    "ATTITUDE": _yaw,
    "GPS_RAW_INT": _receiver,
    "ARSP": lambda message: {"airspeed": float(message.Airspeed)},
    "ATT": lambda message: {"heading": float(message.Yaw) % 360.0},
    "GPS": _logged_receiver,
}  # of MAVLink, and of ArduPilot's logs


@dataclass(slots=True)
class Vehicle:
    """What is known of the autopilot: the first one that is heard, its mode and its acknowledgements."""

    system: int = 0
    component: int = 0
    guided: bool = False
    beaten: float = -math.inf
    heading: float = math.nan
    acknowledged: list[tuple[int, int]] = field(default_factory=list)

    def reading(self, message: Any, departure: float) -> Reading | None:
        """The reading of a message of this vehicle; None if it has none."""
        kind, source = message.get_type(), (0, 0)
        if hasattr(message, "get_srcSystem"):  # logs that ArduPilot writes itself are of one vehicle
            source = message.get_srcSystem(), message.get_srcComponent()
        if kind == "HEARTBEAT" and message.autopilot != NO_AUTOPILOT and not self.system:
            self.system, self.component = source
        if source[0] != self.system:  # nothing is known of a vehicle before its first heartbeat
            return None
        if kind == "HEARTBEAT" and source == (self.system, self.component):
            plane = message.autopilot == ARDUPILOT and message.type in AEROPLANES
            self.guided = plane and message.custom_mode == GUIDED and bool(message.base_mode & ARMED)
            self.beaten = message._timestamp  # noqa: SLF001
        if kind == "COMMAND_ACK":
            self.acknowledged.append((message.command, message.result))
        values = MESSAGES[kind](message) if kind in MESSAGES else {}
        self.heading = values.get("heading", self.heading)
        time = message._timestamp - departure  # noqa: SLF001
        if "lat" in values:
            return Reading(time, place=(values["lat"], values["lon"]), sd=values["sd"])
        if "airspeed" in values and math.isfinite(self.heading):
            return Reading(time, self.heading, values["airspeed"])
        return None


def logged_readings(path: Path, time_zero: str | None, given: str | None) -> Iterator[Reading]:
    """The readings of a ``.tlog``, ``.bin`` or ``.log`` file.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    mavutil = _mavutil()
    if not path.is_file():
        raise DataError(f"{path}: no such file; give a .tlog, .bin, .log or .csv file")
    try:
        log = mavutil.mavlink_connection(str(path), dialect="all")
    except (OSError, ValueError, IndexError, KeyError) as error:
        raise DataError(f"{path}: cannot be read as a log of an autopilot ({error})") from None
    departure, vehicle = departure_time(time_zero, given), Vehicle()
    with closing(log):
        while (message := log.recv_msg()) is not None:
            if message.get_type() == "BAD_DATA":
                yield Reading(math.nan)
                continue
            departure = message._timestamp if departure is None else departure  # noqa: SLF001
            if (reading := vehicle.reading(message, departure)) is not None:
                yield reading


def _mavutil() -> Any:
    try:
        from pymavlink import mavutil
    except ImportError:
        raise ConfigError("MAVLink needs pymavlink: pip install 'pareto-ltl[follow]'") from None
    return mavutil


# --- a connection ---------------------------------------------------------------------------------


@dataclass(slots=True)
class Waiting:
    """A command that is not acknowledged yet."""

    send: Callable[[int], None]
    tries: int
    since: float


class Link:
    """A connection to an autopilot: its readings, and what is sent to it.

    Parameters
    ----------
    address : str
        As pymavlink writes it, e.g. ``udpin:127.0.0.1:14550``, ``tcp:127.0.0.1:5760`` or
        ``/dev/ttyUSB0,57600``.
    sends : sequence of str
        Which of :data:`KINDS` are sent; nothing by default.
    """

    def __init__(
        self, address: str, time_zero: str | None, given: str | None = None, sends: Sequence[str] = ()
    ) -> None:
        if unknown := [kind for kind in sends if kind not in KINDS]:
            raise ConfigError(f"--send {','.join(unknown)}: expected some of {', '.join(KINDS)}")
        self.departure, self.sends = departure_time(time_zero, given), tuple(sends)
        device, _, rate = address.partition(",")
        try:
            self.port = _mavutil().mavlink_connection(
                device, baud=int(rate or 57600), dialect="all", source_system=255, autoreconnect=True
            )
        except (OSError, ValueError) as error:
            raise DataError(
                f"{address}: cannot be opened ({error}); give an address such as udpin:127.0.0.1:14550"
            ) from None
        self.vehicle, self.leg, self.beaten = Vehicle(), -1, -math.inf
        self.waiting: dict[int, Waiting] = {}

    def readings(self) -> Iterator[Reading]:
        """The readings of the vehicle; without any for a while, the time alone. Ctrl-C ends them."""
        quiet = clock.time()
        while True:
            now = clock.time()
            if self.sends and now > self.beaten + BEAT:
                self.beaten = now
                self.port.mav.heartbeat_send(6, 8, 0, 0, 4)  # a ground station, active
            try:
                message = self.port.recv_match(blocking=True, timeout=BEAT)
            except KeyboardInterrupt:
                return
            except (OSError, TypeError):  # unplugged: pymavlink opens it again
                clock.sleep(0.2)
                message = None
            if message is not None and message.get_type() != "BAD_DATA":
                self.departure = message._timestamp if self.departure is None else self.departure  # noqa: SLF001
                if (reading := self.vehicle.reading(message, self.departure)) is not None:
                    quiet = now
                    yield reading
            if self.departure is not None and now > quiet + IDLE:
                quiet = now
                yield Reading(now - self.departure)

    # --- sending ---

    def answers(self, watch: Watch, event: Event) -> Iterator[Event]:
        """Send what follows from an event; yields what was sent, and alarms about it."""
        yield from self._checked(event["time"])
        if not self.vehicle.system:
            return
        if event["event"] == "status":
            for kind in ("wind", "position"):
                if kind in self.sends:
                    yield self._send(kind, _PARAMETERS[kind](watch, event), event["time"])
        if event["event"] in ("flown", "status") and watch.belief.step != self.leg and not watch.over:
            if not self.vehicle.guided or clock.time() > self.vehicle.beaten + STALE:
                return  # no mode is changed: headings follow once the pilot has chosen GUIDED
            self.leg = watch.belief.step
            for kind in ("speed", "heading"):
                if kind in self.sends:
                    yield self._send(kind, _PARAMETERS[kind](watch, event), event["time"])

    def _send(self, kind: str, message: dict[str, Any], time: float) -> Event:
        command, vehicle = KINDS[kind], self.vehicle

        def send(confirmation: int) -> None:
            mav, target = self.port.mav, (vehicle.system, vehicle.component)
            if "x" in message:
                mav.command_int_send(
                    *target, GLOBAL, command, 0, 0, *message["params"], message["x"], message["y"], math.nan
                )
            else:
                mav.command_long_send(*target, command, confirmation, *message["params"])

        send(0)
        self.waiting[command] = Waiting(send, 1, clock.time())
        return {"event": "sent", "time": time, "kind": kind, "command": command, **message}

    def _checked(self, time: float) -> Iterator[Event]:
        """Take acknowledgements, and send again what has none."""
        while self.vehicle.acknowledged:
            command, result = self.vehicle.acknowledged.pop()
            if self.waiting.pop(command, None) is not None and result not in ACCEPTED:
                text = f"the autopilot refuses {NAMES.get(command, command)} (result {result})"
                yield {"event": "alarm", "time": time, "kind": "refused", "text": text}
        for command, one in list(self.waiting.items()):
            if clock.time() < one.since + PATIENCE:
                continue
            if one.tries < TRIES:
                one.send(one.tries)
                one.tries, one.since = one.tries + 1, clock.time()
                continue
            del self.waiting[command]
            text = f"the autopilot does not acknowledge {NAMES[command]}, sent {TRIES} times"
            yield {"event": "alarm", "time": time, "kind": "unacknowledged", "text": text}


def _wind(_watch: Watch, event: Event) -> dict[str, Any]:
    speed, sd, come_from = math.hypot(*event["wind"]), event["wind_sd"], event["wind_from"]
    doubt = min(math.degrees(math.atan2(sd, max(speed, 1e-6))), 180.0)
    text = f"wind {come_from:03.0f}/{speed:.1f} m/s, sd {sd:.1f} m/s and {doubt:.0f} deg"
    return {"params": [speed, sd, come_from, doubt, 0, 0, 0], "text": text}


def _position(_watch: Watch, event: Event) -> dict[str, Any]:
    sd = math.sqrt(0.5 * (event["major"] ** 2 + event["minor"] ** 2)) / ELLIPSE
    return {
        "params": [event["time"], 0.0, sd, 0.0], "x": round(event["lat"] * DEGREE),
        "y": round(event["lon"] * DEGREE), "text": f"position estimate, sd {sd:.0f} m",
    }  # fmt: skip


def _speed(watch: Watch, _event: Event) -> dict[str, Any]:
    u = float(np.linalg.norm(watch.plan.path.u[watch.belief.step]))
    return {"params": [AIRSPEED, u, AT_ONCE, 0, 0, 0, 0], "text": f"airspeed {u:.1f} m/s"}


def _heading(watch: Watch, _event: Event) -> dict[str, Any]:
    step, navigation = watch.belief.step, watch.plan.navigation
    east, north = watch.plan.path.u[step]
    heading = math.degrees(math.atan2(east, north)) % 360.0  # on a map without a place on Earth
    if navigation is not None and navigation.heading_true is not None:
        heading = float(navigation.heading_true[step])
    return {"params": [HEADING, heading, TURN, 0, 0, 0, 0], "text": f"heading {heading:.0f} deg"}


_PARAMETERS: dict[str, Callable[[Watch, Event], dict[str, Any]]] = {
    "wind": _wind, "position": _position, "speed": _speed, "heading": _heading,
}  # fmt: skip
