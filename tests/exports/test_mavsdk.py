"""``mission.plan`` in MAVSDK: its parser takes the file, and an upload over loopback arrives whole."""

from __future__ import annotations

import os
import socket
import sys
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from exported_plans import Flown, metres_apart

if sys.platform == "win32":
    pytest.skip("mavsdk is not installed on Windows", allow_module_level=True)

os.environ["MAVLINK20"] = "1"  # read when pymavlink is imported
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionRaw
from pymavlink import mavutil

WAYPOINT, CHANGE_SPEED, STAY_IN, STAY_OUT = 16, 178, 5001, 5002
MISSION, FENCE = 0, 1  # MAV_MISSION_TYPE
BEAT = 0.2  # [s] between heartbeats


class Vehicle(threading.Thread):
    """An autopilot that knows the mission protocol and nothing else."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.link = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=1, source_component=1, dialect="all"
        )
        self.items: dict[int, list[Any]] = {}
        self.counts: dict[int, int] = {}
        self.ended = threading.Event()

    def run(self) -> None:
        while not self.ended.is_set():
            self.link.mav.heartbeat_send(2, 12, 0, 0, 3)  # quadrotor, PX4
            while (message := self.link.recv_match(blocking=True, timeout=BEAT)) is not None:
                self.answer(message)

    def answer(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "MISSION_COUNT":
            self.counts[message.mission_type], self.items[message.mission_type] = message.count, []
        elif kind == "MISSION_ITEM_INT" and message.seq == len(self.items[message.mission_type]):
            self.items[message.mission_type].append(message)
        else:
            return
        sender, got = (message.get_srcSystem(), message.get_srcComponent()), self.items[message.mission_type]
        if len(got) < self.counts[message.mission_type]:
            self.link.mav.mission_request_int_send(*sender, len(got), message.mission_type)
        else:
            self.link.mav.mission_ack_send(*sender, 0, message.mission_type)


@pytest.fixture(scope="module")
def station() -> Iterator[tuple[MissionRaw, Vehicle]]:
    """A ground station of MAVSDK, and the vehicle that it has found."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    vehicle = Vehicle(port)
    vehicle.start()
    system = sdk.first_autopilot(30.0)
    assert system is not None
    missions = MissionRaw(system)
    yield missions, vehicle
    vehicle.ended.set()
    vehicle.join()
    vehicle.link.close()
    missions.destroy()
    sdk.destroy()


def test_the_parser_takes_the_file_and_the_upload_arrives_whole(
    flown: Flown, station: tuple[MissionRaw, Vehicle]
) -> None:
    missions, vehicle = station
    read = missions.import_qgroundcontrol_mission(str(flown.folder / "mission.plan"))
    log = flown.exported.log
    waypoints = [item for item in read.mission_items if item.command == WAYPOINT]
    assert (
        metres_apart([i.x / 1e7 for i in waypoints], [i.y / 1e7 for i in waypoints], flown.exported, 1) < 0.1
    )
    assert {item.z for item in waypoints} == {10.0}  # the height of the wind
    speeds = [item.param2 for item in read.mission_items if item.command == CHANGE_SPEED]
    assert speeds[0] == pytest.approx(log.calibrated[0], rel=1e-6)
    assert 0 < min(speeds) <= max(speeds) <= 30.0

    missions.upload_mission(read.mission_items)
    missions.upload_geofence(read.geofence_items)
    for kind, sent in ((MISSION, read.mission_items), (FENCE, read.geofence_items)):
        got = vehicle.items[kind]
        assert [(i.command, i.frame, i.x, i.y, i.z) for i in got] == [
            (i.command, i.frame, i.x, i.y, i.z) for i in sent
        ]


def test_the_fence_is_the_border_and_the_obstacles(flown: Flown, station: tuple[MissionRaw, Vehicle]) -> None:
    missions, _ = station
    read = missions.import_qgroundcontrol_mission(str(flown.folder / "mission.plan"))
    commands = [item.command for item in read.geofence_items]
    assert set(commands) == {STAY_IN, STAY_OUT}  # phi1 with fidelity=full: the border is a wall
    told = flown.json("mission.plan")["geoFence"]["polygons"]
    assert [polygon["inclusion"] for polygon in told] == [True] + [False] * len(flown.result.scene.obstacles)
    assert commands == [
        STAY_IN if polygon["inclusion"] else STAY_OUT for polygon in told for _ in polygon["polygon"]
    ]


def test_the_file_says_how_often_such_a_flight_fails(flown: Flown) -> None:
    note = flown.json("mission.plan")["pareto_ltl"]
    assert note["failure_by_heading"]["law"] == note["failure_by_position"]["law"] == "coherent"
    assert note["failure_by_position"]["failure"] == flown.exported.held.failure
    assert note["failure_by_heading"]["failure"] == flown.exported.plan.promise.rate.failure
    assert "by position" in note["note"]
    assert "robot.feedback_time=60" in note["note"]
    assert np.isfinite(note["failure_by_position"]["high"])
