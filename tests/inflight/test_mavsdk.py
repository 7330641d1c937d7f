"""Every message that ``follow`` sends, read by MAVSDK, whose parser (libmav) is independent of pymavlink."""

from __future__ import annotations

import json
import math
import os
import socket
import sys
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

if sys.platform == "win32":
    pytest.skip("mavsdk is not installed on Windows", allow_module_level=True)

os.environ["MAVLINK20"] = "1"  # read when pymavlink is imported
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mavlink_direct import MavlinkDirect
from pymavlink import mavutil

from flight_quantities.frames import local_plane
from pareto_ltl_apps.exports.mavlink import NAMES, SET_ORIGIN
from pareto_ltl_apps.flight.sends import KINDS, Sender, at_leg, at_status, prologue_of
from problems import box, make_scene

SENT = ("COMMAND_LONG", "COMMAND_INT", SET_ORIGIN, "HEARTBEAT")
MOST = 20.0  # [s] for messages over the loopback


def messages() -> list[dict[str, Any]]:
    """One message of every kind that ``--send`` knows."""
    event: Any = {
        "wind": (3.0, -4.0), "wind_sd": 1.25, "wind_from": 323.1, "major": 900.0, "minor": 400.0,
        "time": 1234.5, "lat": 44.3217, "lon": -87.5001,
    }  # fmt: skip
    navigation = SimpleNamespace(heading_true=np.array([271.5]))
    path = SimpleNamespace(u=np.array([[12.0, -5.0]]))
    plan: Any = SimpleNamespace(navigation=navigation, path=path)
    scene = replace(make_scene({"a": box(13, 2, 17, 6)}), crs=local_plane(44.0, -87.0))
    told = [*at_status(KINDS, event), *at_leg(KINDS, plan, 0, 0.97)]
    return [*(message for _, message in told), *prologue_of(scene, 183.0)]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def test_mavsdk_reads_every_message_as_it_was_meant() -> None:
    port, seen = free_port(), []
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
    sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    link = mavutil.mavlink_connection(
        f"udpout:127.0.0.1:{port}", source_system=245, source_component=191, dialect="all"
    )
    try:
        direct, last = None, time.monotonic() + MOST
        while direct is None and time.monotonic() < last:
            link.mav.heartbeat_send(18, 8, 0, 0, 4)  # an onboard computer, no autopilot
            time.sleep(0.1)
            found = [system for system in sdk.get_systems() if system.get_system_id() == 245]
            direct = MavlinkDirect(found[0]) if found else None
        assert direct is not None
        for name in SENT:
            direct.subscribe_message(name, lambda message, _: seen.append(message))
        sender, told = Sender(link.mav, SimpleNamespace(system=1, component=1, acknowledged=[])), messages()
        for message in told:
            sender.send(message, time.monotonic())
            time.sleep(0.01)
        link.mav.heartbeat_send(18, 8, 0, 0, 4)
        while len([one for one in seen if one.message_name != "HEARTBEAT"]) < len(told):
            assert time.monotonic() < last, f"{len(seen)} of {len(told)} messages arrived"
            time.sleep(0.05)
        read = [one for one in seen if one.message_name != "HEARTBEAT"]
        assert {one.message_name for one in seen} >= set(SENT) - {"HEARTBEAT"}
        for one, meant in zip(sorted(read, key=by_kind), sorted(told, key=kind_of), strict=True):
            compare(json.loads(one.fields_json), meant)
        direct.destroy()
    finally:
        link.close()
        sdk.destroy()


def kind_of(message: dict[str, Any]) -> tuple[str, int]:
    if message.get("message") == SET_ORIGIN:
        return SET_ORIGIN, 0
    return ("COMMAND_INT" if "x" in message else "COMMAND_LONG"), message["command"]


def by_kind(message: Any) -> tuple[str, int]:
    return message.message_name, json.loads(message.fields_json).get("command", 0)


def compare(read: dict[str, Any], meant: dict[str, Any]) -> None:
    """The fields that MAVSDK has read agree with the command."""
    if meant.get("message") == SET_ORIGIN:
        assert (read["latitude"], read["longitude"]) == (meant["x"], meant["y"])
        assert read["altitude"] == round(1e3 * meant["z"])
        return
    assert read["command"] == meant["command"], NAMES[meant["command"]]
    assert (read["target_system"], read["target_component"]) == (1, 1)
    for number, value in enumerate(meant["params"], 1):
        known = read[f"param{number}"]
        if value is None or math.isnan(value):
            assert known is None or math.isnan(float(known))
        else:
            assert float(known) == pytest.approx(value, rel=1e-6)
    if "x" in meant:
        assert (read["x"], read["y"]) == (meant["x"], meant["y"])
