"""Commands to an autopilot: what is sent, how often, and what its answer means.

Commands are acknowledged, and sent again where they are not. An answer ACCEPTED is no proof that a command is
used: :data:`ACCEPTED_MEANS` says what is known of each autopilot (docs/follow.md has the sources). Nothing
here arms, disarms or changes a mode. Airspeeds that are sent are calibrated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pareto_ltl import Scene
from pareto_ltl.extend import Plan
from pareto_ltl_apps.exports import mavlink
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.vehicle import AGE, ARDUPILOT, PX4, Vehicle
from pareto_ltl_apps.flight.watch import ELLIPSE, Watch

KINDS = ("wind", "heading", "speed", "position", "prologue")
ACCEPTED, UNDER_WAY = 0, 5  # MAV_RESULT_ACCEPTED, MAV_RESULT_IN_PROGRESS
TRIES, PATIENCE = 3, 2.0  # how often a command is sent, and seconds to wait for its acknowledgement
ACCEPTED_MEANS = {
    (ARDUPILOT, mavlink.WIND_ESTIMATE): "ArduPilot gives it to DCM only, not to EKF3, by which it flies",
    (PX4, mavlink.WIND_ESTIMATE): "PX4 answers so in the air too, where it does not use it: it takes a wind "
    "on the ground only",
    (ARDUPILOT, mavlink.POSITION_ESTIMATE): "ArduPilot's EKF3 moves its position there while it has no "
    "satellites, and does not learn the wind from it",
    (PX4, mavlink.POSITION_ESTIMATE): "PX4's EKF2 moves its position there while it reckons without "
    "satellites",
    (ARDUPILOT, mavlink.CHANGE_SPEED): "ArduPlane holds this calibrated airspeed while it is in GUIDED",
    (ARDUPILOT, mavlink.CHANGE_HEADING): "ArduPlane holds this heading while it is in GUIDED",
}

Command = tuple[str, dict[str, Any]]  # its text, and the object of mavlink_script.json


@dataclass(slots=True)
class Waiting:
    """A command that is not acknowledged yet."""

    message: dict[str, Any]
    tries: int
    since: float


class Sender:
    """Sends commands to ``vehicle`` through ``mav``, an encoder of pymavlink.

    A command is an object of ``mavlink_script.json``: ``command`` and ``params``, with ``x``, ``y`` and ``z``
    for a COMMAND_INT. Times are of any clock that does not step.
    """

    def __init__(self, mav: Any, vehicle: Vehicle) -> None:
        self.mav, self.vehicle = mav, vehicle
        self.waiting: dict[int, Waiting] = {}
        self.explained: set[int] = set()  # commands whose acceptance was explained

    def send(self, message: dict[str, Any], now: float) -> None:
        """Send a command for the first time; one of the same kind is not waited for any longer."""
        self._encode(message, 0)
        if message.get("message") != mavlink.SET_ORIGIN:  # which has no acknowledgement
            self.waiting[message["command"]] = Waiting(message, 1, now)

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

    def answers(self) -> Iterator[tuple[int, int]]:
        """The commands that were acknowledged, each with its MAV_RESULT."""
        while self.vehicle.acknowledged:
            command, result = self.vehicle.acknowledged.pop(0)
            if command in self.waiting and result != UNDER_WAY:
                del self.waiting[command]
                yield command, result

    def unanswered(self, now: float) -> Iterator[int]:
        """Send again what has no answer; yields the commands that have none after :data:`TRIES` times.

        An estimate in flight is sent ``once``: it is old by then, and the next status has a new one.
        """
        for command, one in list(self.waiting.items()):
            if now < one.since + PATIENCE:
                continue
            if one.tries < TRIES:
                if not one.message.get("once"):
                    self._encode(one.message, one.tries)
                one.tries, one.since = one.tries + 1, now
                continue
            del self.waiting[command]
            yield command

    def explanation(self, command: int) -> str:
        """What the answer ACCEPTED to ``command`` means, the first time; empty later."""
        if command in self.explained:
            return ""
        self.explained.add(command)
        means = ACCEPTED_MEANS.get((self.vehicle.autopilot, command), "whether it uses it is not known")
        return f"the autopilot answered ACCEPTED to {mavlink.NAMES.get(command, command)}; {means}"


# --- what is sent ---------------------------------------------------------------------------------


def prologue_of(scene: Scene, ground: float) -> tuple[dict[str, Any], ...]:
    """Origin, home and position at the start of ``scene``, ``ground`` [m] above mean sea level."""
    assert scene.crs is not None
    lon, lat = scene.frame.to_geographic(scene.start[None])
    return tuple(
        message | {"z": ground if "z" in message["fill_in"] else None}
        for message in mavlink.prologue(float(lat[0]), float(lon[0]), mavlink.LEAST_SD)
    )


def wind_command(event: Event) -> Command:
    """Text and command of the wind of a status, or of :meth:`Watch.wind_now`."""
    speed, sd, come_from = math.hypot(*event["wind"]), event["wind_sd"], event["wind_from"]
    doubt = min(math.degrees(math.atan2(sd, max(speed, 1e-6))), 180.0)
    text = f"wind {come_from:03.0f}/{speed:.1f} m/s, sd {sd:.1f} m/s and {doubt:.0f} deg"
    return text, {"command": mavlink.WIND_ESTIMATE, "params": [speed, sd, come_from, doubt, 0, 0, 0]}


def at_status(sends: Sequence[str], event: Event) -> Iterator[Command]:
    """Text and command of the wind and the position that a status reports."""
    if "wind" in sends:
        text, command = wind_command(event)
        yield text, command | {"once": True}
    if "position" in sends:
        sd = math.sqrt(0.5 * (event["major"] ** 2 + event["minor"] ** 2)) / ELLIPSE
        yield f"position estimate, sd {sd:.0f} m", {
            "command": mavlink.POSITION_ESTIMATE, "params": [event["time"], 0.0, sd, 0.0],
            "x": round(event["lat"] * mavlink.DEGREE), "y": round(event["lon"] * mavlink.DEGREE),
            "once": True,
        }  # fmt: skip


def trusted(sends: Sequence[str], watch: Watch, time: float) -> list[str]:
    """Which of ``sends`` a status at ``time`` may send: nothing from signals that are older than 2 s.

    A position that a fix contradicts is not sent.
    """
    if not time - watch.heard <= AGE:
        return []
    return [kind for kind in sends if kind != "position" or not watch.raised & {"fix", "map"}]


def at_leg(sends: Sequence[str], plan: Plan, step: int, factor: float) -> Iterator[Command]:
    """Text and command of the airspeed and the heading of a step; ``factor``: CAS / TAS."""
    east, north = plan.path.u[step]
    if "speed" in sends:
        true = float(np.hypot(east, north))
        calibrated = factor * true
        yield (
            f"calibrated airspeed {calibrated:.1f} m/s (true {true:.1f})",
            {
                "command": mavlink.CHANGE_SPEED,
                "params": [mavlink.AIRSPEED, calibrated, mavlink.AT_ONCE, 0, 0, 0, 0],
            },
        )
    if "heading" in sends:
        heading = math.degrees(math.atan2(east, north)) % 360.0  # on a map without a place on Earth
        if plan.navigation is not None and plan.navigation.heading_true is not None:
            heading = float(plan.navigation.heading_true[step])
        if math.isfinite(heading):
            params = [mavlink.HEADING, heading, mavlink.TURN, 0, 0, 0, 0]
            yield f"heading {heading:.0f} deg", {"command": mavlink.CHANGE_HEADING, "params": params}
