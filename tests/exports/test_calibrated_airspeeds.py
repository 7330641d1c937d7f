"""What autopilots and pilots are told is calibrated airspeed; a flight at another height is told another."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from exported_plans import Flown
from flight_quantities.medium import AIR, WATER
from pareto_ltl.settings import RobotConfig, Settings
from pareto_ltl.settings.heights import flight_air, flight_height
from pareto_ltl_apps.exports.exported import MULTIROTOR, ExportedPlan, Vehicle, height_sentence
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.exports.navigation_log import navigation_log

FACTOR = 1.08136  # TAS / CAS at 1,600 m: U.S. Standard Atmosphere, 1976, density 1.0476 kg/m3 there


@pytest.fixture(scope="module")
def high(flown: Flown) -> ExportedPlan:
    """The same plan, flown 1,600 m above the sea."""
    settings = Settings(robot=RobotConfig(level="1600m amsl"))
    height = flight_height(settings)
    air = flight_air(settings, height)
    log = navigation_log(flown.problem, flown.result.plan.path, air)
    return replace(flown.exported, height=height, air=air, log=log)


def mission_speeds(exported: ExportedPlan) -> list[tuple[float, float]]:
    """Type and speed of the items 178."""
    items = json.loads(FORMATS["qgc"].content(exported))["mission"]["items"]
    return [(item["params"][0], item["params"][1]) for item in items if item["command"] == 178]


def test_autopilots_are_told_calibrated_airspeeds(high: ExportedPlan) -> None:
    true = high.log.airspeed
    script = json.loads(FORMATS["mavlink"].content(high))["messages"]
    sent = [m["params"][1] for m in script if m["command"] == 43000]
    np.testing.assert_allclose(sent, true / FACTOR, rtol=1e-4)
    assert {kind for kind, _ in mission_speeds(high)} == {0}  # SPEED_TYPE_AIRSPEED
    assert mission_speeds(high)[0][1] == pytest.approx(true[0] / FACTOR, rel=1e-4)
    cruise = json.loads(FORMATS["qgc"].content(high))["mission"]["cruiseSpeed"]
    assert cruise == pytest.approx(true.max() / FACTOR, rel=1e-4)
    if high.log.fixes == ():
        legs = [
            line for line in FORMATS["lua"].content(high).decode().splitlines() if line.startswith("    { ")
        ]
        told = [float(line.strip(" {},").split(",")[1]) for line in legs]
        np.testing.assert_allclose(told, true / FACTOR, rtol=1e-4)


def test_tables_name_both_airspeeds(high: ExportedPlan) -> None:
    for name in ("dead_reckoning", "card"):
        rows = list(csv.DictReader(io.StringIO(FORMATS[name].content(high).decode())))
        for row in rows[:-1]:
            true, calibrated = float(row["airspeed_tas_m_s"]), float(row["airspeed_cas_m_s"])
            assert true / calibrated == pytest.approx(FACTOR, rel=5e-3 if name == "card" else 1e-4)


def test_a_multirotor_is_told_the_expected_speed_over_ground(high: ExportedPlan) -> None:
    """Autopilots of multirotors hold no airspeed: they take item 178 as a ground speed."""
    rotor = replace(high, vehicle=Vehicle(MULTIROTOR, hovers=True))
    told = mission_speeds(rotor)
    assert {kind for kind, _ in told} == {1}  # SPEED_TYPE_GROUNDSPEED
    assert told[0][1] == pytest.approx(high.log.ground_speed[0])


def test_every_text_states_the_height_and_the_factor(high: ExportedPlan) -> None:
    sentence = "Height 1600 m above mean sea level. True airspeed is 1.0814 times calibrated airspeed"
    for name in ("kml", "gpx", "qgc", "mavlink", "geojson", "lua"):
        assert sentence in FORMATS[name].content(high).decode(), name


def test_a_height_that_no_setting_states_is_said_to_be_the_level_of_the_wind() -> None:
    settings = Settings()
    height = flight_height(settings)
    text = height_sentence(height, flight_air(settings, height), AIR)
    assert text.startswith("Height 10 m above the ground, the level of the wind, as robot.level is not set.")
    assert "with the ground at sea level, as scene.ground is not set" in text


def test_in_the_water_there_is_one_speed(flown: Flown) -> None:
    log = navigation_log(flown.problem, flown.result.plan.path)
    wet = replace(flown.exported, air=None, log=log, medium=WATER)
    assert np.isnan(log.calibrated).all()
    assert wet.autopilot_airspeed.tolist() == log.airspeed.tolist()
    rows = list(csv.DictReader(io.StringIO(FORMATS["card"].content(wet).decode())))
    assert {row["airspeed_cas_m_s"] for row in rows} == {""}
    assert not any(math.isnan(speed) for _, speed in mission_speeds(wet))
