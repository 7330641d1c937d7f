"""A watch connected to a vehicle over the loopback by MAVLink, read and written by pymavlink's own parser."""

from __future__ import annotations

import io
import math
import os
import struct
import threading
import time as clock
from collections import deque
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence

os.environ["MAVLINK20"] = "1"  # read when pymavlink is imported

from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink2

from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.exports.mavlink import prologue
from pareto_ltl_apps.flight import link as links
from pareto_ltl_apps.flight.clocks import VehicleClock
from pareto_ltl_apps.flight.following import follow
from pareto_ltl_apps.flight.link import Link, LinkSettings, departure_time, logged_readings, signing_key
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.sends import Sender
from pareto_ltl_apps.flight.telemetry import Typed
from pareto_ltl_apps.flight.vehicle import Vehicle as Known
from pareto_ltl_apps.flight.watch import Watch, WatchSettings
from watched import PATH, PLAN, PROBLEM, heading_of

FORBIDDEN = {176, 400, 21, 22}  # DO_SET_MODE, COMPONENT_ARM_DISARM, LAND, TAKEOFF
ACKNOWLEDGED = 0


class Vehicle(threading.Thread):
    """A vehicle that flies its plan 200 times as fast, and keeps what it is sent."""

    def __init__(
        self, port: int, *, mode: int = 15, answer: int | None = ACKNOWLEDGED, kind: int = 1,
        beats: int = 10**6, armed: bool = True, fix: int | None = None, key: bytes = b"",
    ) -> None:  # fmt: skip
        super().__init__(daemon=True)
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", dialect="all", source_system=7)
        self.mode, self.answer, self.stopped = mode, answer, threading.Event()
        self.kind, self.beats = kind, beats
        self.armed, self.fix = armed, fix
        if key:
            self.link.setup_signing(key)
        self.sent: list[tuple[int, list[float]]] = []
        self.origins: list[tuple[int, int, int]] = []

    def run(self) -> None:
        mav = self.link.mav
        while not self.stopped.wait(0.02):
            if self.fix is not None:
                mav.gps_raw_int_send(0, self.fix, 0, 0, 0, 100, 100, 0, 0, 9)
            if self.beats > 0:
                self.beats -= 1
                mav.heartbeat_send(self.kind, 3, (128 if self.armed else 0) | 1, self.mode, 4)
            heading, airspeed = heading_of(PATH.u[0])
            mav.attitude_send(0, 0.0, 0.0, math.radians(heading), 0.0, 0.0, 0.0)
            mav.vfr_hud_send(airspeed, 25.0, round(heading), 50, 100.0, 0.0)
            mav.global_position_int_send(0, 0, 0, 0, 0, 0, 0, 0, 0)
            while (message := self.link.recv_match(blocking=False)) is not None:
                if message.get_type() == "SET_GPS_GLOBAL_ORIGIN":
                    self.origins.append((message.latitude, message.longitude, message.altitude))
                if message.get_type() not in ("COMMAND_LONG", "COMMAND_INT"):
                    continue
                self.sent.append((message.command, [message.param1, message.param2, message.param3]))
                if self.answer is not None:
                    mav.command_ack_send(message.command, self.answer)


def listened(port: int, vehicle: Vehicle, sends: tuple[str, ...], seconds: float, **more: Any) -> list[Event]:
    """What a watch says in so many seconds."""
    settings = LinkSettings(datetime.now(UTC).isoformat(), sends, **more)
    link = Link(f"udpin:127.0.0.1:{port}", None, settings)
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
    link.vehicle, link.settings = (
        Known(7, 1, heard=True, guided=True, beaten=-6.0),
        LinkSettings(None, ("heading",)),
    )
    link.leg, link.known, link.sender, link.notes = None, 0, Sender(None, link.vehicle), deque()
    link.departure = clock.monotonic()
    sent: list[dict[str, Any]] = []
    monkeypatch.setattr(Sender, "send", lambda _self, message, _now: sent.append(message))
    watch = Watch(PROBLEM, PLAN, WatchSettings(members=50), SeedSequence(1))
    assert not list(link.answers(watch, {"event": "flown", "time": 1.0}))
    link.vehicle.beaten = 0.0
    assert [event["event"] for event in link.answers(watch, {"event": "flown", "time": 1.0})] == ["sent"]
    assert [message["command"] for message in sent] == [43002]


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
    assert [reading.place is None for reading in found] == [True, False, True]  # no fix, no position
    assert found[2].lost == ("heading",)  # its last message is 3 s old


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


def test_a_serial_port_that_is_pulled_out_is_opened_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    device = tmp_path / "ttyUSB0"

    def plugged() -> int:
        ours, theirs = os.openpty()
        device.unlink(missing_ok=True)
        device.symlink_to(os.ttyname(theirs))
        os.close(theirs)
        return ours

    mav = mavlink2.MAVLink(None, srcSystem=7)

    def speak(port: int) -> None:
        mav.seq = (mav.seq + 3) % 256
        beat = mav.heartbeat_encode(1, 3, 129, 15, 4).pack(mav)
        turned = mav.attitude_encode(0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0).pack(mav)
        os.write(port, beat + turned + mav.vfr_hud_encode(25.0, 25.0, 29, 50, 100.0, 0.0).pack(mav))

    port = plugged()
    link = Link(f"{device},57600", None, LinkSettings("now"))
    readings = link.readings()
    speak(port)
    assert next(reading for reading in readings if math.isfinite(reading.airspeed)).heading > 0.0
    os.close(port)
    back: list[int] = []

    def plug_again() -> None:
        back.append(plugged())
        while not heard.wait(0.1):
            speak(back[0])

    heard = threading.Event()
    returning = threading.Timer(0.5, plug_again)
    returning.start()
    assert next(reading for reading in readings if math.isfinite(reading.airspeed)).heading > 0.0
    heard.set()
    returning.join()
    os.close(back[0])
    link.port.close()
    assert capsys.readouterr().out == ""


def test_addresses_and_times_that_are_none(tmp_path) -> None:
    with pytest.raises(
        ConfigError, match="--send wings: expected some of wind, heading, speed, position, prologue"
    ):
        Link("udpin:127.0.0.1:0", None, LinkSettings("now", ("wings",)))
    with pytest.raises(DataError, match="cannot be opened"):
        Link(str(tmp_path / "no-such-port"), None, LinkSettings("now"))
    with pytest.raises(ConfigError, match="--departure must be now or a time"):
        departure_time(None, "noon")
    assert departure_time("1970-01-01T00:01:00Z", None) == 60.0
    with pytest.raises(ConfigError, match="must be 1 to 86,400 s"):
        follow(tmp_path, [], settings=WatchSettings(every=0.0))


# --- what is read ---------------------------------------------------------------------------------


def heard(*messages: Any, known: Known | None = None) -> list[Any]:
    """The readings of messages of vehicle 7, 0.1 s apart, after its heartbeat."""
    vehicle, found = known or Known(), []
    for count, message in enumerate(messages):
        if not message.get_srcSystem():
            addressed(message, 7, 1)
        found.append(vehicle.reading(message, 0.1 * count))
    return [reading for reading in found if reading is not None]


def addressed(message: Any, system: int, component: int) -> None:
    """Let a message come from a system."""
    message._header = mavlink2.MAVLink_header(message.id, srcSystem=system, srcComponent=component)  # noqa: SLF001


def odometry(estimator: int, variance: float = 9.0, frame: int = 1) -> Any:
    cov = [math.nan] * 21
    cov[0], cov[6] = variance, variance
    return mavlink2.MAVLink_odometry_message(
        0, frame, 1, 1000.0, 2000.0, 0.0, [1.0, 0.0, 0.0, 0.0], *[0.0] * 6, cov, [math.nan] * 21, 0, estimator
    )


def test_odometry_of_a_camera_is_a_position_and_the_filter_of_an_autopilot_is_none() -> None:
    beat = mavlink2.MAVLink_heartbeat_message(1, 3, 128, 15, 4, 3)
    origin = mavlink2.MAVLink_gps_global_origin_message(371000000, -945000000, 0)
    assert not heard(beat, odometry(3))  # the origin is not known
    (one,) = heard(beat, origin, odometry(3))
    north = 1000.0 / 111_195.0
    assert one.place == (pytest.approx(37.1 + north, abs=1e-5), pytest.approx(-94.5 + 0.022544, abs=1e-4))
    assert one.sd == 3.0
    assert not heard(beat, origin, odometry(8), odometry(0), odometry(3, math.nan), odometry(3, frame=20))


def test_positions_that_others_send_to_the_vehicle_count() -> None:
    beat = mavlink2.MAVLink_heartbeat_message(1, 3, 128, 15, 4, 3)
    place = (371000000, -945000000, 0.0)
    sent = mavlink2.MAVLink_command_int_message(7, 1, 0, 43003, 0, 0, 5.0, 0.0, 80.0, 0.0, *place)
    other = mavlink2.MAVLink_command_int_message(9, 1, 0, 43003, 0, 0, 5.0, 0.0, 80.0, 0.0, *place)
    for message in (sent, other):
        addressed(message, 255, 190)
    (one,) = heard(beat, sent, other)
    assert one.place == (pytest.approx(37.1), pytest.approx(-94.5))
    assert one.sd == 80.0


def test_wind_and_battery_are_read() -> None:
    beat = mavlink2.MAVLink_heartbeat_message(1, 3, 128, 15, 4, 3)
    wind = mavlink2.MAVLink_wind_message(-90.0, 8.0, 0.0)
    power = mavlink2.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, 55, 0, 0, 0, 0, 0, 0)
    found = heard(beat, wind, power)
    assert found[0].wind == (270.0, 8.0)
    assert found[1].battery == 0.55


def test_other_vehicles_are_ignored_and_named(free_port: int) -> None:
    known = Known(7)
    others = [mavlink2.MAVLink_heartbeat_message(1, 3, 128, 15, 4, 3) for _ in range(2)]
    hud = mavlink2.MAVLink_vfr_hud_message(25.0, 25.0, 30, 50, 100.0, 0.0)
    for message in (others[0], hud):
        addressed(message, 3, 1)
    assert not heard(others[0], others[1], hud, known=known)
    assert (known.system, known.component, known.strangers) == (7, 1, {3})
    vehicle = Vehicle(free_port)
    events = listened(free_port, vehicle, ("heading",), 1.5, system=8)
    assert "others on this link are ignored: 7" in next(e["text"] for e in events if e["event"] == "alarm")
    assert not vehicle.sent


# --- the prologue, signatures, and what is typed --------------------------------------------------


def test_the_prologue_goes_to_an_aeroplane_that_is_not_armed(free_port: int) -> None:
    messages = tuple(
        told | {"z": 300.0 if "z" in told["fill_in"] else None} for told in prologue(37.1, -94.5, 2.0)
    )
    vehicle = Vehicle(free_port, armed=False, fix=1)
    events = listened(free_port, vehicle, ("prologue", "wind", "heading"), 2.5, prologue=messages)
    assert vehicle.origins == [(371000000, -945000000, 300_000)]
    assert [command for command, _ in vehicle.sent if command != 43004] == [179, 43003]
    assert not [event for event in events if event["event"] == "alarm"]


def test_nothing_of_the_prologue_goes_to_an_armed_vehicle_or_to_one_with_satellites(free_port: int) -> None:
    messages = tuple(told | {"z": 300.0} for told in prologue(37.1, -94.5, 2.0))
    flying = Vehicle(free_port, fix=1)
    events = listened(free_port, flying, ("prologue",), 1.5, prologue=messages)
    assert any("armed already" in event.get("text", "") for event in events)
    located = Vehicle(free_port, armed=False, fix=3)
    listened(free_port, located, ("prologue",), 1.5, prologue=messages)
    unknown = Vehicle(free_port, armed=False)
    listened(free_port, unknown, ("prologue",), 1.5, prologue=messages)
    assert not [one for vehicle in (flying, located, unknown) for one in (*vehicle.sent, *vehicle.origins)]


@pytest.mark.parametrize(("theirs", "some"), [(b"k" * 32, True), (b"w" * 32, False), (b"", False)])
def test_with_a_key_only_its_signatures_count(theirs: bytes, some: bool, free_port: int) -> None:
    vehicle = Vehicle(free_port, key=theirs)
    events = listened(free_port, vehicle, ("wind",), 2.0, key=b"k" * 32)
    assert any(event["event"] == "status" for event in events) is some
    assert bool(vehicle.sent) is some


def test_a_key_is_hexadecimal_or_a_passphrase(tmp_path: Path) -> None:
    file = tmp_path / "key"
    file.write_text("ab" * 32 + "\n")
    assert signing_key(file) == b"\xab" * 32
    file.write_text("secret\n")
    assert signing_key(file).hex() == "2bb80d537b1da3e38bd30361aa855686bde0eacd7162fef6a25fe97bf527a25b"
    file.write_text(" \n")
    with pytest.raises(DataError, match="the key is empty"):
        signing_key(file)
    with pytest.raises(DataError, match="cannot be read"):
        signing_key(tmp_path / "none")


def test_what_is_typed_is_a_fix_or_an_answer() -> None:
    said: list[str] = []
    typed = Typed(
        io.StringIO("fix 37.1,-94.5,200\nfix 1,2\nfix nan,1,2\nhello\n\nfix 1,2,-3\ny\n"), said.append
    )
    typed.start()
    end = clock.time() + 10.0
    while not typed.agreed.is_set() and clock.time() < end:
        clock.sleep(0.01)
    assert list(typed.fixes) == [(37.1, -94.5, 200.0)]
    assert typed.agreed.is_set()
    assert len(said) == 4


def test_a_typed_fix_becomes_a_reading(free_port: int) -> None:
    typed = Typed(io.StringIO("fix 37.1,-94.5,200\n"), print)
    link, vehicle = Link(f"udpin:127.0.0.1:{free_port}", None, LinkSettings("now"), typed), Vehicle(free_port)
    vehicle.start()
    found = next(reading for reading in link.readings() if reading.place is not None)
    vehicle.stopped.set()
    vehicle.join()
    vehicle.link.close()
    link.port.close()
    assert (found.place, found.sd) == ((37.1, -94.5), 200.0)


def test_the_clock_of_a_vehicle_goes_on_at_its_rate_when_it_is_silent() -> None:
    own = VehicleClock()
    assert own.without_message(1.0) == 1.0
    assert own.of_message(100.0, 2.0) == 2.0
    assert own.without_message(2.5) == 2.0
    assert own.of_message(130.0, 3.0) == 32.0
    assert own.of_message(130.0, 3.1) == 32.0
    assert own.of_message(129.0, 3.1) is None
    assert own.of_message(math.nan, 3.1) == 32.0
    assert own.without_message(13.1) == pytest.approx(32.0 + 10.0 * 30.0 / 1.1)


def test_a_watch_by_the_clock_of_a_vehicle_ends_after_its_telemetry(
    free_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(links, "IDLE", 0.2)
    link = Link(f"udpin:127.0.0.1:{free_port}", None, LinkSettings("now", own_clock=True))
    vehicle = mavutil.mavlink_connection(f"udpout:127.0.0.1:{free_port}", dialect="all", source_system=7)
    end, times = 1e3 * PROBLEM.motion.dt * len(PATH.u), list[float]()
    stream = link.readings()
    for boot in (0.0, 0.5 * end, 0.9 * end):  # [ms]
        vehicle.mav.heartbeat_send(1, 3, 129, 15, 4)
        vehicle.mav.attitude_send(round(boot), 0.0, 0.0, 0.1, 0.0, 0.0, 0.0)
        vehicle.mav.vfr_hud_send(20.0, 20.0, 6, 50, 100.0, 0.0)
        times.append(next(stream).time)
        clock.sleep(0.1)
    while times[-1] < 1e-3 * end:
        times.append(next(stream).time)
    assert times == sorted(times)
    vehicle.close()
    link.port.close()
