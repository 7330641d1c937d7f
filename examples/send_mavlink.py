"""Send wind, airspeed and heading of each leg of a plan to an autopilot that can fly by them.

    pip install pymavlink
    python examples/send_mavlink.py mavlink_script.json --to udpout:127.0.0.1:14550 --ground 250

With ``--ground``, the height of the start above mean sea level [m], first sends what an aeroplane without
satellites must know: origin, home, position. Acknowledgements are not waited for: ``pareto-ltl follow`` does
that, and checks the vehicle.

Without arguments the script makes a plan first, then encodes and prints its messages; it sends nothing.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import all as dialect

import pareto_ltl

AUTOPILOT = (1, 1)  # system and component that commands are for


def commands(script: dict[str, Any]) -> Iterator[tuple[float, str, dialect.MAVLink_message]]:
    """When to send each message [s after departure], its name, and the message."""
    for told in script["messages"]:
        if told.get("fill_in"):
            continue  # a position that somebody must measure: the plan's expectation is none
        message = dialect.MAVLink_command_long_message(*AUTOPILOT, told["command"], 0, *told["params"])
        yield told["t"], told["name"], message


def before_take_off(script: dict[str, Any]) -> Iterator[dialect.MAVLink_message]:
    """The wind of the first leg, which an autopilot takes best on the ground."""
    for told in script["before_take_off"]:
        yield dialect.MAVLink_command_long_message(*AUTOPILOT, told["command"], 0, *told["params"])


def prologue(script: dict[str, Any], ground: float) -> Iterator[dialect.MAVLink_message]:
    """Origin, home and position at the start, ``ground`` [m] above mean sea level."""
    for told in script["prologue"]:
        x, y, z = told["x"], told["y"], ground if "z" in told["fill_in"] else math.nan
        if told["message"] == "SET_GPS_GLOBAL_ORIGIN":
            yield dialect.MAVLink_set_gps_global_origin_message(AUTOPILOT[0], x, y, round(1e3 * z))
        else:
            head = (*AUTOPILOT, told["frame"], told["command"], 0, 0)
            yield dialect.MAVLink_command_int_message(*head, *told["params"], x, y, z)


def position_estimate(t: float, lat: float, lon: float, sd: float) -> dialect.MAVLink_message:
    """A position [deg] with its standard deviation [m], measured at a landmark at time ``t`` [s]."""
    command, frame = dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE, dialect.MAV_FRAME_GLOBAL
    place = (round(lat * 1e7), round(lon * 1e7), math.nan)
    return dialect.MAVLink_command_int_message(*AUTOPILOT, frame, command, 0, 0, t, 0, sd, 0, *place)


def send(script: dict[str, Any], address: str, speedup: float, ground: float | None) -> None:
    """Send each message at its time; ``speedup`` shortens the waits."""
    link = mavutil.mavlink_connection(address, source_system=255, dialect="all")
    for message in (*(() if ground is None else prologue(script, ground)), *before_take_off(script)):
        link.mav.send(message)
        print(f"   before  {message.get_type()}")
    departure = time.monotonic()
    for t, name, message in commands(script):
        time.sleep(max(0.0, departure + t / speedup - time.monotonic()))
        link.mav.send(message)
        print(f"{t:9.0f} s  {name}")


def main() -> None:
    """Read the command line and send."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("script", nargs="?", type=Path)
    parser.add_argument("--to", default="udpout:127.0.0.1:14550", help="address, as pymavlink writes it")
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--ground", type=float, help="height of the start above mean sea level [m]")
    options = parser.parse_args()
    if options.script is not None:
        send(json.loads(options.script.read_text()), options.to, options.speedup, options.ground)
        return
    with tempfile.TemporaryDirectory() as folder:
        result = pareto_ltl.plan("phi1", "F a", planner={"trees": 2, "n_max": 800}, wind="calm")
        (path,) = pareto_ltl.export(result, folder, ["mavlink"])
        script = json.loads(path.read_text())
    coder = dialect.MAVLink(None, srcSystem=255)
    for message in (*prologue(script, 250.0), *before_take_off(script)):
        print(f"   before  {message.get_type():32} {len(message.pack(coder))} bytes")
    for t, name, message in commands(script):
        print(f"{t:9.0f} s  {name:32} {len(message.pack(coder))} bytes")
    estimate = position_estimate(3600.0, 37.0, -92.0, 100.0)
    print(f"at a landmark: {estimate.get_type()} of {len(estimate.pack(coder))} bytes, when it is seen")


if __name__ == "__main__":
    main()
