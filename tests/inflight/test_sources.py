"""Whose messages count, by which clock, and how old they may be."""

from __future__ import annotations

import math
import os
import struct
from pathlib import Path
from typing import Any

import pytest

os.environ["MAVLINK20"] = "1"  # read when pymavlink is imported

from pymavlink.dialects.v20 import all as mavlink2

from flight_quantities.atmosphere import standard_air
from pareto_ltl_apps.flight.airspeeds import Airspeeds
from pareto_ltl_apps.flight.clocks import StampClock, SteadyClock
from pareto_ltl_apps.flight.link import logged_readings
from pareto_ltl_apps.flight.telemetry import Reading, Sieve
from pareto_ltl_apps.flight.vehicle import OURS, Vehicle

AUTOPILOT = (7, 1)


class Sender:
    """Messages of one source, with increasing numbers, as they arrive packed."""

    def __init__(self, source: tuple[int, int] = AUTOPILOT) -> None:
        self.coder = mavlink2.MAVLink(None, srcSystem=source[0], srcComponent=source[1])

    def packed(self, message: Any) -> Any:
        message.pack(self.coder)
        self.coder.seq = (self.coder.seq + 1) % 256
        return message

    def beat(self, kind: int = 1, pilot: int = 3) -> Any:
        return self.packed(mavlink2.MAVLink_heartbeat_message(kind, pilot, 129, 15, 4, 3))

    def attitude(self, boot: float, yaw: float = 0.5) -> Any:
        return self.packed(mavlink2.MAVLink_attitude_message(round(1e3 * boot), 0.0, 0.0, yaw, 0.0, 0.0, 0.0))

    def hud(self, airspeed: float = 20.0) -> Any:
        return self.packed(mavlink2.MAVLink_vfr_hud_message(airspeed, 25.0, 0, 50, 100.0, 0.0))

    def gps(self, place: tuple[float, float], usec: int = 0) -> Any:
        lat, lon = (round(1e7 * value) for value in place)
        return self.packed(
            mavlink2.MAVLink_gps_raw_int_message(usec, 3, lat, lon, 0, 100, 100, 0, 0, 9, 0, 5000)
        )

    def estimate(self, place: tuple[float, float], at: float = 5.0) -> Any:
        lat, lon = (round(1e7 * value) for value in place)
        return self.packed(
            mavlink2.MAVLink_command_int_message(7, 1, 0, 43003, 0, 0, at, 0.0, 80.0, 0.0, lat, lon, 0.0)
        )


def flying(vehicle: Vehicle, sender: Sender, seconds: range) -> list[Reading]:
    """An autopilot that reports a heading and an airspeed each second."""
    found = []
    for second in seconds:
        messages = (sender.beat(), sender.attitude(1000.0 + second), sender.hud())
        found += [vehicle.reading(message, float(second)) for message in messages]
    return [one for one in found if one is not None]


def test_one_heading_is_not_flown_for_an_hour() -> None:
    vehicle, sender = Vehicle(), Sender()
    assert flying(vehicle, sender, range(3))[-1].heading == pytest.approx(math.degrees(0.5))
    for second in range(3, 3600):
        reading = vehicle.reading(sender.hud(), float(second))
        assert reading is not None
        if second <= 4:
            assert math.isfinite(reading.heading)
        else:
            assert math.isnan(reading.heading)
            assert reading.lost == ("heading",)
    again = vehicle.reading(sender.attitude(4600.0), 3600.0)
    assert again is None or math.isnan(again.heading)
    assert vehicle.reading(sender.hud(), 3600.0).heading == pytest.approx(math.degrees(0.5))  # type: ignore[union-attr]


def test_a_gap_of_both_signals_is_named_when_it_ends() -> None:
    vehicle, sender = Vehicle(), Sender()
    flying(vehicle, sender, range(3))
    reading = vehicle.reading(sender.attitude(1100.0), 100.0)
    assert reading is not None
    assert reading.lost == ("airspeed",) or set(reading.lost) == {"heading", "airspeed"}
    assert vehicle.lost(103.5) == ("heading", "airspeed")


def test_what_we_have_sent_is_no_measurement_when_a_router_sends_it_back() -> None:
    vehicle, sender = Vehicle(), Sender()
    flying(vehicle, sender, range(2))
    for second in range(2, 60):
        assert vehicle.reading(Sender(OURS).estimate((37.1, -94.5), float(second)), float(second)) is None
    pilot = Sender((255, 190))
    one = vehicle.reading(pilot.estimate((37.1, -94.5)), 60.0)
    assert one is not None
    assert one.place == (pytest.approx(37.1), pytest.approx(-94.5))
    again = vehicle.reading(pilot.estimate((37.1, -94.5)), 61.0)
    assert again is not None
    assert again.fault == "doubled"


def test_sensors_count_from_the_autopilot_alone() -> None:
    vehicle, sender = Vehicle(), Sender()
    flying(vehicle, sender, range(2))
    for source in ((7, 154), (7, 191), (9, 1)):
        other = Sender(source)
        beat = other.beat(*((1, 3) if source == (9, 1) else (18, 8)))
        for message in (beat, other.attitude(1002.0, 3.0), other.hud(1.0), other.gps((1.0, 1.0))):
            assert vehicle.reading(message, 2.0) is None
    assert vehicle.strangers == {9}
    reading = vehicle.reading(sender.hud(), 2.1)
    assert reading is not None
    assert (reading.heading, reading.airspeed) == (pytest.approx(math.degrees(0.5)), pytest.approx(20.0))


def test_a_companion_that_claims_to_be_an_autopilot_gives_way_to_the_first_autopilot() -> None:
    vehicle, companion, sender = Vehicle(), Sender((7, 191)), Sender()
    vehicle.reading(companion.beat(), 0.0)
    assert vehicle.component == 191
    vehicle.reading(sender.beat(), 0.1)
    assert vehicle.component == 1
    assert not flying(Vehicle(), Sender((7, 191)), range(0))
    assert Vehicle().reading(companion.beat(18, 3), 0.0) is None


def test_a_copy_of_a_router_is_doubled_and_a_position_with_the_stamp_of_another_message_is_not() -> None:
    vehicle, sender, sieve = Vehicle(), Sender(), Sieve(30.0)
    stream = []
    for second in range(20):
        messages = [sender.beat(), sender.attitude(1000.0 + second), sender.hud()]
        messages.append(sender.gps((37.0, -94.0 + 0.001 * second), usec=1 + second))
        for message in messages:
            stream += [
                vehicle.reading(message, float(second)) for _ in range(2)
            ]  # one time stamp, two copies
    passed = list(sieve.usable(one for one in stream if one is not None))
    assert sum(one.place is not None for one in passed) == 20
    assert sieve.refused == {"doubled": 80}


def test_a_position_that_the_same_sensor_measured_before_is_doubled() -> None:
    vehicle, sender = Vehicle(), Sender()
    flying(vehicle, sender, range(2))
    first = vehicle.reading(sender.gps((37.0, -94.0), usec=7), 2.0)
    second = vehicle.reading(sender.gps((37.0, -94.0), usec=7), 3.0)
    third = vehicle.reading(sender.gps((37.0, -94.0), usec=8), 4.0)
    assert [one.fault for one in (first, second, third) if one is not None] == ["", "doubled", ""]


def test_a_position_that_is_a_little_late_counts_with_a_larger_error() -> None:
    sieve = Sieve(20.0)
    late = Reading(9.5, place=(1.0, 2.0), sd=30.0)
    old = Reading(8.0, place=(1.0, 2.0), sd=30.0)
    passed = list(sieve.usable([Reading(10.0, 5.0, 5.0), late, old]))
    assert [one.time for one in passed] == [10.0, 10.0]
    assert passed[1].sd == pytest.approx(math.hypot(30.0, 1.5 * 20.0 * 0.5))
    assert sieve.refused == {"late": 1}


# --- clocks ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("jump", [-3000.0, -30.0, 30.0, 3000.0])
def test_a_jump_of_the_vehicle_clock_is_no_time_of_flight(jump: float) -> None:
    clock, times = SteadyClock(), []
    for second in range(100):
        boot = 5000.0 + second + (jump if second >= 40 else 0.0)
        times.append(clock.of_message(boot, float(second)))
    assert times[:40] == pytest.approx(list(range(40)))
    assert times[40:50] == [None] * 10
    assert times[50:] == pytest.approx(list(range(50, 100)))
    assert clock.jumps == [pytest.approx(jump, abs=0.1)]


def test_an_old_message_is_not_used_while_others_come() -> None:
    clock = SteadyClock()
    for second in range(200):
        assert clock.of_message(1000.0 + second, float(second)) == pytest.approx(second)
        assert clock.of_message(700.0 + second, second + 0.5) is None
    assert not clock.jumps


def test_a_slow_crystal_and_a_late_link_are_followed() -> None:
    clock = SteadyClock()
    for tenth in range(360_000):  # 10 h with 100 parts in a million
        arrival = 0.1 * tenth
        time = clock.of_message(50.0 + (1.0 - 1e-4) * arrival, arrival)
        assert time is not None
        assert abs(time - arrival) < 0.1


@pytest.mark.parametrize("step", [-119.0, -3.0, 3.0, 119.0])
def test_a_step_of_the_stamps_of_a_log_is_not_flown(step: float) -> None:
    clock, times = StampClock(), []
    for second in range(100):
        stamp = second + (step if second >= 40 else 0.0)
        times.append(clock.of_message(5000.0 + second, stamp))
        times.append(clock.of_message(math.nan, stamp + 0.5))
    wanted = [second + part for second in range(100) for part in (0.0, 0.5)]
    assert times == pytest.approx(wanted)
    assert len(clock.jumps) == 1


def test_a_log_goes_on_where_the_autopilot_restarts() -> None:
    clock = StampClock()
    for second in range(100):
        boot = 500.0 + second if second < 50 else 1.0 + second - 50
        time = clock.of_message(boot, float(second))
        assert time is None if 50 <= second < 60 else time == pytest.approx(second)
    assert len(clock.jumps) == 1


# --- airspeeds ------------------------------------------------------------------------------------


def test_an_airspeed_of_a_vehicle_is_calibrated_and_becomes_a_true_one() -> None:
    planned = standard_air(1600.0).density_ratio
    vehicle, sender = Vehicle(airspeeds=Airspeeds(planned)), Sender()
    assert flying(vehicle, sender, range(2))[-1].airspeed == pytest.approx(20.0 / math.sqrt(planned))
    high = standard_air(3000.0)
    pressure = mavlink2.MAVLink_scaled_pressure_message(1001_500, high.pressure / 100.0, 0.0, 4500, 0)
    assert vehicle.reading(sender.packed(pressure), 1.5) is None
    reading = vehicle.reading(sender.hud(), 1.6)
    assert reading is not None
    assert reading.airspeed == pytest.approx(20.0 / math.sqrt(high.density_ratio), rel=1e-5)
    air = vehicle.airspeeds
    assert air.calibrated(air.true(20.0, 2.0), 2.0) == pytest.approx(20.0)
    assert air.true(20.0, 100.0) == pytest.approx(20.0 / math.sqrt(planned))  # the pressure is old
    air.take_pressure(-5.0, 200.0)
    assert air.density_ratio(200.0) == planned
    water = Airspeeds(1.0, measures=False)
    water.take_pressure(5e4, 0.0)
    assert water.true(0.3, 0.0) == 0.3


# --- logs -----------------------------------------------------------------------------------------


def test_damaged_records_of_a_ground_station_are_skipped_and_counted(tmp_path: Path) -> None:
    sender, records = Sender(), []
    for second in range(60):
        stamp = struct.pack(">Q", round((1.539e9 + second) * 1e6))
        messages = (sender.beat(), sender.attitude(1000.0 + second), sender.hud())
        records += [stamp + bytes(message.get_msgbuf()) for message in messages]
    whole, spoilt = tmp_path / "whole.tlog", tmp_path / "spoilt.tlog"
    whole.write_bytes(b"".join(records))
    records[40] = records[40][:12] + b"\x00" * 10 + records[40][22:]
    records[90] = records[90][:-7]
    records[130] = b"\xfd\xff" + records[130]
    spoilt.write_bytes(b"".join(records) + records[-1][:13])
    one, other = (list(logged_readings(file, None, "now")) for file in (whole, spoilt))
    flown = [sum(math.isfinite(reading.heading) for reading in found) for found in (one, other)]
    assert flown[0] == 60
    assert flown[1] >= 55
    faults = [reading.fault for reading in other if reading.fault]
    assert 3 <= faults.count("damaged record") <= 12
    times = [reading.time for reading in other if math.isfinite(reading.heading)]
    assert times == pytest.approx(sorted(times))
    assert times[-1] == pytest.approx(59.0, abs=0.5)


def dataflash(damage: bytes) -> bytes:
    """A ``.bin`` file of ArduPilot: formats, then an attitude and an airspeed each second, ``damage``."""

    def fmt(kind: int, length: int, name: bytes, form: bytes, columns: bytes) -> bytes:
        return struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, kind, length, name, form, columns)

    data = fmt(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    data += fmt(130, 15, b"ATT", b"Qf", b"TimeUS,Yaw") + fmt(131, 15, b"ARSP", b"Qf", b"TimeUS,Airspeed")
    data += fmt(132, 26, b"GPS", b"QBIHLL", b"TimeUS,Status,GMS,GWk,Lat,Lng")
    data += struct.pack("<BBBQBIHii", 0xA3, 0x95, 132, 1_000_000, 3, 1000, 2022, 371000000, -945000000)
    for second in range(2, 62):
        at = 1_000_000 * second
        data += struct.pack("<BBBQf", 0xA3, 0x95, 130, at, 40.0)
        data += struct.pack("<BBBQf", 0xA3, 0x95, 131, at + 100_000, 19.5)
        data += damage if second in (20, 40) else b""
    return data


def test_damaged_records_of_ardupilot_are_skipped_and_counted(tmp_path: Path) -> None:
    file = tmp_path / "flight.bin"
    for damage in (b"", b"\x11\x95\xa3\x00" * 9):
        file.write_bytes(dataflash(damage) + (b"\xa3\x95\x82\x01" if damage else b""))
        found = list(logged_readings(file, None, "now"))
        assert sum(math.isfinite(reading.heading) for reading in found) == 60
        count = [reading.fault for reading in found].count("damaged record")
        assert count == (3 if damage else 0)
