"""A watch connected to a vehicle over the loopback by MAVLink, read and written by pymavlink's own parser."""

from __future__ import annotations

import math
import threading
import time as clock
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.random import SeedSequence
from pymavlink import mavutil

from pareto_ltl.inflight.following import follow
from pareto_ltl.inflight.link import Link, departure_time
from pareto_ltl.inflight.watch import Event, Watch, WatchSettings
from pareto_ltl.support.errors import ConfigError, DataError
from watched import PATH, PLAN, PROBLEM, heading_of

FORBIDDEN = {176, 400, 21, 22}  # DO_SET_MODE, COMPONENT_ARM_DISARM, LAND, TAKEOFF
ACKNOWLEDGED = 0


class Vehicle(threading.Thread):
    """A vehicle that flies its plan 200 times as fast, and keeps what it is sent."""

    def __init__(self, port: int, *, mode: int = 15, answer: int | None = ACKNOWLEDGED) -> None:
        super().__init__(daemon=True)
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", dialect="all", source_system=7)
        self.mode, self.answer, self.stopped = mode, answer, threading.Event()
        self.sent: list[tuple[int, list[float]]] = []

    def run(self) -> None:
        mav = self.link.mav
        while not self.stopped.wait(0.02):
            mav.heartbeat_send(1, 3, 128 | 1, self.mode, 4)
            heading, airspeed = heading_of(PATH.u[0])
            mav.attitude_send(0, 0.0, 0.0, math.radians(heading), 0.0, 0.0, 0.0)
            mav.vfr_hud_send(airspeed, 25.0, round(heading), 50, 100.0, 0.0)
            mav.global_position_int_send(0, 0, 0, 0, 0, 0, 0, 0, 0)
            while (message := self.link.recv_match(blocking=False)) is not None:
                if message.get_type() not in ("COMMAND_LONG", "COMMAND_INT"):
                    continue
                self.sent.append((message.command, [message.param1, message.param2, message.param3]))
                if self.answer is not None:
                    mav.command_ack_send(message.command, self.answer)


def listened(port: int, vehicle: Vehicle, sends: tuple[str, ...], seconds: float) -> list[Event]:
    """What a watch says in so many seconds."""
    link = Link(f"udpin:127.0.0.1:{port}", None, "now", sends)
    watch = Watch(PROBLEM, PLAN, WatchSettings(every=1.0, members=50, alarm=1.0), SeedSequence(1))
    events: list[Event] = []

    def until() -> Iterator:
        end = clock.time() + seconds
        for reading in link.readings():
            if clock.time() > end:
                return
            yield reading

    vehicle.start()
    for event in watch.events(until()):
        events += [event, *link.answers(watch, event)]
    vehicle.stopped.set()
    vehicle.join()
    vehicle.link.close()
    link.port.close()
    return events


def test_nothing_is_sent_unless_it_is_asked_for(free_port: int) -> None:
    vehicle = Vehicle(free_port)
    events = listened(free_port, vehicle, (), 2.0)
    assert not vehicle.sent
    assert {"status", "flown"} <= {event["event"] for event in events}
    assert sum(event["seconds"] for event in events if event["event"] == "flown") > 1.0


def test_wind_heading_and_speed_reach_a_guided_vehicle(free_port: int) -> None:
    vehicle = Vehicle(free_port)
    events = listened(free_port, vehicle, ("wind", "heading", "speed"), 3.0)
    commands = {command for command, _ in vehicle.sent}
    assert commands == {43000, 43002, 43004}
    assert not commands & FORBIDDEN
    _, airspeed = heading_of(PATH.u[0])
    assert next(p for c, p in vehicle.sent if c == 43000)[1] == pytest.approx(airspeed, rel=1e-5)
    status = next(event for event in events if event["event"] == "status")
    wind = next(p for c, p in vehicle.sent if c == 43004)
    assert wind[0] == pytest.approx(float(np.hypot(*status["wind"])), rel=1e-4)
    assert wind[1] > 0.1  # an honest standard deviation
    assert not [event for event in events if event["event"] == "alarm"]


def test_a_vehicle_in_another_mode_gets_no_heading(free_port: int) -> None:
    vehicle = Vehicle(free_port, mode=10)
    listened(free_port, vehicle, ("wind", "heading", "speed"), 2.0)
    assert {command for command, _ in vehicle.sent} == {43004}


def test_a_refusal_and_a_silent_autopilot_are_alarms(free_port: int) -> None:
    refusing = listened(free_port, Vehicle(free_port, answer=3), ("wind",), 2.0)
    assert any("refuses MAV_CMD_EXTERNAL_WIND_ESTIMATE" in event.get("text", "") for event in refusing)


def test_commands_are_sent_three_times(free_port: int) -> None:
    vehicle = Vehicle(free_port, answer=None)
    events = listened(free_port, vehicle, ("heading",), 7.5)
    assert [command for command, _ in vehicle.sent].count(43002) == 3
    assert any("does not acknowledge" in event.get("text", "") for event in events)


def test_addresses_and_times_that_are_none(tmp_path) -> None:
    with pytest.raises(ConfigError, match="--send wings: expected some of wind, heading, speed, position"):
        Link("udpin:127.0.0.1:0", None, "now", ["wings"])
    with pytest.raises(DataError, match="cannot be opened"):
        Link(str(tmp_path / "no-such-port"), None, "now")
    with pytest.raises(ConfigError, match="--departure must be now or a time"):
        departure_time(None, "noon")
    assert departure_time("1970-01-01T00:01:00Z", None) == 60.0
    with pytest.raises(ConfigError, match="must be 1 to 86,400 s"):
        follow(tmp_path, [], settings=WatchSettings(every=0.0))
