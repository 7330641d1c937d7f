"""Commands to an autopilot: encoded, acknowledged, and sent again where they are not.

Nothing here arms, disarms or changes a mode.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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
    LEAST_SD,
    NAMES,
    POSITION_ESTIMATE,
    SET_ORIGIN,
    TURN,
    WIND_ESTIMATE,
    prologue,
)
from pareto_ltl.inflight.vehicle import Vehicle
from pareto_ltl.inflight.watch import ELLIPSE, Event, Watch
from pareto_ltl.world.scene import Scene

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
        if message.get("message") != SET_ORIGIN:  # which has no acknowledgement
            self.waiting[message["command"]] = Waiting(message, 1, clock.time())

    def _encode(self, message: dict[str, Any], confirmation: int) -> None:
        target = (self.vehicle.system, self.vehicle.component)
        z = math.nan if message.get("z") is None else float(message["z"])
        if message.get("message") == SET_ORIGIN:
            self.mav.set_gps_global_origin_send(target[0], message["x"], message["y"], round(1e3 * z))
        elif "x" in message:
            place = (message["x"], message["y"], z)
            self.mav.command_int_send(*target, GLOBAL, message["command"], 0, 0, *message["params"], *place)
        else:
            self.mav.command_long_send(*target, message["command"], confirmation, *message["params"])

    def checked(self) -> Iterator[tuple[str, str]]:
        """Take acknowledgements, and send again what has none; yields kinds and texts of alarms."""
        while self.vehicle.acknowledged:
            command, result = self.vehicle.acknowledged.pop()
            if self.waiting.pop(command, None) is not None and result not in ACCEPTED:
                yield "refused", f"the autopilot refuses {NAMES.get(command, command)} (result {result})"
        for command, one in list(self.waiting.items()):
            if clock.time() < one.since + PATIENCE:
                continue
            if one.tries < TRIES:
                self._encode(one.message, one.tries)
                one.tries, one.since = one.tries + 1, clock.time()
                continue
            del self.waiting[command]
            yield "unacknowledged", f"the autopilot does not acknowledge {NAMES[command]}, sent {TRIES} times"


def prologue_of(scene: Scene, ground: float, sd: float = LEAST_SD) -> tuple[dict[str, Any], ...]:
    """Origin, home and position at the start of ``scene``, ``ground`` [m] above mean sea level."""
    from pareto_ltl.world.projection import to_geographic

    assert scene.crs is not None
    lon, lat = to_geographic(scene.crs, scene.start[None])
    return tuple(
        message | {"z": ground if "z" in message["fill_in"] else None}
        for message in prologue(float(lat[0]), float(lon[0]), sd)
    )


# --- what is sent ---------------------------------------------------------------------------------


def at_status(sends: Sequence[str], event: Event) -> Iterator[tuple[str, dict[str, Any]]]:
    """Text and command of the wind and the position that a status reports."""
    if "wind" in sends:
        yield _wind(event)
    if "position" in sends:
        yield _position(event)


def at_leg(sends: Sequence[str], watch: Watch) -> Iterator[tuple[str, dict[str, Any]]]:
    """Text and command of the airspeed and the heading of the step that the watch is in."""
    step, navigation = watch.belief.step, watch.plan.navigation
    east, north = watch.plan.path.u[step]
    if "speed" in sends:
        u = float(np.hypot(east, north))
        yield f"airspeed {u:.1f} m/s", {"command": CHANGE_SPEED, "params": [AIRSPEED, u, AT_ONCE, 0, 0, 0, 0]}
    if "heading" in sends:
        heading = math.degrees(math.atan2(east, north)) % 360.0  # on a map without a place on Earth
        if navigation is not None and navigation.heading_true is not None:
            heading = float(navigation.heading_true[step])
        if math.isfinite(heading):
            params = [HEADING, heading, TURN, 0, 0, 0, 0]
            yield f"heading {heading:.0f} deg", {"command": CHANGE_HEADING, "params": params}


def _wind(event: Event) -> tuple[str, dict[str, Any]]:
    speed, sd, come_from = math.hypot(*event["wind"]), event["wind_sd"], event["wind_from"]
    doubt = min(math.degrees(math.atan2(sd, max(speed, 1e-6))), 180.0)
    text = f"wind {come_from:03.0f}/{speed:.1f} m/s, sd {sd:.1f} m/s and {doubt:.0f} deg"
    return text, {"command": WIND_ESTIMATE, "params": [speed, sd, come_from, doubt, 0, 0, 0]}


def _position(event: Event) -> tuple[str, dict[str, Any]]:
    sd = math.sqrt(0.5 * (event["major"] ** 2 + event["minor"] ** 2)) / ELLIPSE
    return f"position estimate, sd {sd:.0f} m", {
        "command": POSITION_ESTIMATE, "params": [event["time"], 0.0, sd, 0.0],
        "x": round(event["lat"] * DEGREE), "y": round(event["lon"] * DEGREE),
    }  # fmt: skip
