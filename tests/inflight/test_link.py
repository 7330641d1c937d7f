"""A watch connected to a vehicle over the loopback by MAVLink, read and written by pymavlink's own parser."""

from __future__ import annotations

import math
import struct
import threading
import time as clock
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.random import SeedSequence
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink2

from pareto_ltl.inflight.following import follow
from pareto_ltl.inflight.link import Link, departure_time, logged_readings
from pareto_ltl.inflight.link import Vehicle as Known
from pareto_ltl.inflight.watch import Event, Watch, WatchSettings
from pareto_ltl.support.errors import ConfigError, DataError
from watched import PATH, PLAN, PROBLEM, heading_of

FORBIDDEN = {176, 400, 21, 22}  # DO_SET_MODE, COMPONENT_ARM_DISARM, LAND, TAKEOFF
ACKNOWLEDGED = 0


class Vehicle(threading.Thread):
    """A vehicle that flies its plan 200 times as fast, and keeps what it is sent."""

    def __init__(
        self, port: int, *, mode: int = 15, answer: int | None = ACKNOWLEDGED, kind: int = 1,
        beats: int = 10**6,
    ) -> None:  # fmt: skip
        super().__init__(daemon=True)
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", dialect="all", source_system=7)
        self.mode, self.answer, self.stopped = mode, answer, threading.Event()
        self.kind, self.beats = kind, beats
        self.sent: list[tuple[int, list[float]]] = []

    def run(self) -> None:
        mav = self.link.mav
        while not self.stopped.wait(0.02):
            if self.beats > 0:
                self.beats -= 1
                mav.heartbeat_send(self.kind, 3, 128 | 1, self.mode, 4)
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


def test_a_copter_in_its_mode_15_gets_no_heading(free_port: int) -> None:
    vehicle = Vehicle(free_port, kind=2)
    listened(free_port, vehicle, ("wind", "heading", "speed"), 2.0)
    assert {command for command, _ in vehicle.sent} == {43004}


def test_nothing_is_sent_before_a_heartbeat(free_port: int) -> None:
    vehicle = Vehicle(free_port, beats=0)
    events = listened(free_port, vehicle, ("wind", "heading", "speed"), 2.0)
    assert not vehicle.sent
    assert not any(event["event"] == "sent" for event in events)


def test_a_mode_is_forgotten_without_heartbeats(monkeypatch: pytest.MonkeyPatch) -> None:
    link = object.__new__(Link)
    link.vehicle, link.sends, link.leg, link.waiting = (
        Known(7, 1, True, clock.time() - 6.0),
        ("heading",),
        -1,
        {},
    )
    watch = Watch(PROBLEM, PLAN, WatchSettings(members=50), SeedSequence(1))
    assert not list(link.answers(watch, {"event": "flown", "time": 1.0}))
    link.vehicle.beaten = clock.time()
    monkeypatch.setattr(Link, "_send", lambda _self, kind, _message, _time: {"event": "sent", "kind": kind})
    assert [event["kind"] for event in link.answers(watch, {"event": "flown", "time": 1.0})] == ["heading"]


def test_a_refusal_and_a_silent_autopilot_are_alarms(free_port: int) -> None:
    refusing = listened(free_port, Vehicle(free_port, answer=3), ("wind",), 2.0)
    assert any("refuses MAV_CMD_EXTERNAL_WIND_ESTIMATE" in event.get("text", "") for event in refusing)


def test_commands_are_sent_three_times(free_port: int) -> None:
    vehicle = Vehicle(free_port, answer=None)
    events = listened(free_port, vehicle, ("heading",), 7.5)
    assert [command for command, _ in vehicle.sent].count(43002) == 3
    assert any("does not acknowledge" in event.get("text", "") for event in events)


def test_a_log_of_a_ground_station_is_read(tmp_path: Path) -> None:
    """Time stamps of 8 bytes before each message, as ground stations write them."""
    mav = mavlink2.MAVLink(None, srcSystem=7, srcComponent=1)
    messages = [
        mav.heartbeat_encode(1, 3, 128, 15, 4), mav.attitude_encode(0, 0.0, 0.0, math.radians(30.0), 0, 0, 0),
        mav.vfr_hud_encode(21.0, 25.0, 30, 50, 100.0, 0.0),
        mav.gps_raw_int_encode(0, 3, 371000000, -945000000, 0, 100, 100, 0, 0, 9, h_acc=2500),
        mav.gps_raw_int_encode(0, 1, 1, 1, 0, 100, 100, 0, 0, 0),
    ]  # fmt: skip
    data = b""
    for second, message in enumerate(messages):
        data += struct.pack(">Q", (1_539_000_000 + second) * 10**6) + message.pack(mav)
    file = tmp_path / "flight.tlog"
    file.write_bytes(data)
    found = list(logged_readings(file, None, "now"))
    assert [(r.time, r.heading, r.airspeed) for r in found[:1]] == [
        (pytest.approx(2.0), pytest.approx(30.0), pytest.approx(21.0))
    ]
    assert found[1].place == (pytest.approx(37.1), pytest.approx(-94.5))
    assert found[1].sd == 2.5
    assert len(found) == 2  # a receiver without a fix measures nothing


def test_a_log_of_ardupilot_is_read(tmp_path: Path) -> None:
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 130, 19, ATT, Qcc, TimeUS,Roll,Yaw", "FMT, 131, 15, ARSP, Qf, TimeUS,Airspeed",
        "FMT, 132, 40, GPS, QBIHLL, TimeUS,Status,GMS,GWk,Lat,Lng",
        "GPS, 1000000, 3, 1000, 2022, 37.1, -94.5", "ATT, 2000000, 1.0, 40.0", "ARSP, 3000000, 19.5",
    ]  # fmt: skip
    file = tmp_path / "flight.log"
    file.write_text("\n".join(lines) + "\n")
    found = list(logged_readings(file, None, "now"))
    assert found[0].place == (37.1, -94.5)
    assert (found[-1].heading, found[-1].airspeed) == (40.0, 19.5)
    with pytest.raises(DataError, match="no such file"):
        list(logged_readings(tmp_path / "none.tlog", None, "now"))


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
