"""One height of a flight, whichever settings state it, and the air that is there."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flight_quantities.heights import FlownAir, Height, MeasuredAir
from flight_quantities.levels import parse_level
from pareto_ltl.settings import RobotConfig, SceneConfig, Settings, WindConfig
from pareto_ltl.settings.heights import flight_air, flight_height, temperature_doubt
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.exports.settings import ExportsConfig


def settings_of(
    level: str | None = None, altitude: float | None = None, exported: float | None = None, **keys: Any
) -> Settings:
    return Settings(
        robot=RobotConfig(level=level, air_temperature=keys.pop("celsius", None)),
        scene=SceneConfig(altitude=altitude, ground=keys.pop("ground", None)),
        exports=ExportsConfig(altitude=exported),
        wind=WindConfig(level=keys.pop("wind", "10m")),
    )


@pytest.mark.parametrize(
    ("stated", "metres", "above_sea"),
    [
        ({"level": "100m"}, 100.0, False),
        ({"level": "300m amsl"}, 300.0, True),
        ({"level": "1000ft amsl"}, 304.8, True),
        ({"level": "925hPa"}, 762.0, True),
        ({"level": "850hPa"}, 1457.0, True),
        ({"level": "50hPa"}, 20_576.0, True),
        ({"level": "FL45"}, 1371.6, True),
        ({"level": "30m depth"}, -30.0, False),
        ({"altitude": 800.0}, 800.0, True),
        ({"altitude": -30.0}, -30.0, False),
        ({"exported": 120.0}, 120.0, False),
        ({"level": "100m", "altitude": 100.0, "exported": 100.0}, 100.0, False),
        ({"level": "925hPa", "altitude": 760.0}, 762.0, True),
        ({"level": "400m amsl", "exported": 100.0, "ground": 300.0}, 400.0, True),
        ({"wind": "80m"}, 80.0, False),
    ],
)
def test_the_height_is_what_any_setting_states(
    stated: dict[str, Any], metres: float, above_sea: bool
) -> None:
    height = flight_height(settings_of(**stated))
    assert height.metres == pytest.approx(metres, abs=0.6)
    assert height.above_sea == above_sea
    assert height.stated == ("wind" not in stated)
    assert parse_level(height.level).standard_height == pytest.approx(height.metres)


@pytest.mark.parametrize(
    ("stated", "words", "cured"),
    [
        (
            {"level": "925hPa", "altitude": 800.0},
            "robot.level=925hPa is 762 m above mean sea level, and scene.altitude=800 is 800 m above mean "
            "sea level: a flight has one height. Set robot.level='800m amsl', or scene.altitude=null",
            ({"level": "800m amsl", "altitude": 800.0}, {"level": "925hPa"}),
        ),
        (
            {"level": "100m", "exported": 120.0},
            "robot.level=100m is 100 m above the ground, and exports.altitude=120 is 120 m above the ground",
            ({"level": "120m", "exported": 120.0}, {"level": "100m"}),
        ),
        (
            {"level": "100m depth", "altitude": -30.0},
            "robot.level=100m depth is 100 m below the surface, and scene.altitude=-30 is 30 m below the "
            "surface",
            ({"level": "30m depth", "altitude": -30.0}, {"level": "100m depth"}),
        ),
        (
            {"altitude": 300.0, "exported": 100.0},
            "Set exports.altitude=null, and robot.level for the height",
            ({"level": "300m amsl", "altitude": 300.0},),
        ),
        (
            {"level": "925hPa", "exported": 100.0, "ground": 300.0},
            "exports.altitude=100 is 100 m above the ground",
            ({"level": "925hPa"},),
        ),
    ],
)
def test_two_heights_are_an_error_with_both_values_and_its_cure_works(
    stated: dict[str, Any], words: str, cured: tuple[dict[str, Any], ...]
) -> None:
    with pytest.raises(ConfigError) as refused:
        settings_of(**stated)
    assert words in str(refused.value)
    for other in cured:
        settings_of(**other)


@given(st.floats(1.0, 11_900.0), st.floats(-0.3, 0.3))
def test_statements_of_one_height_differ_by_at_most_one_per_cent(metres: float, share: float) -> None:
    other = metres * (1.0 + share)
    alike = abs(other - metres) <= max(1.0, 0.01 * max(metres, other))
    if alike:
        assert flight_height(settings_of(f"{metres:.6f}m amsl", other)).metres == pytest.approx(metres)
    else:
        with pytest.raises(ConfigError, match="a flight has one height"):
            settings_of(f"{metres:.6f}m amsl", other)


@pytest.mark.parametrize("level", ["up", "100", "m", "925hPa amsl", "0hPa", "-5m", "FL4500"])
def test_a_level_that_is_none_is_refused_by_the_name_of_its_setting(level: str) -> None:
    with pytest.raises(ConfigError, match=r"robot\.level .* is not a level; expected a height above ground"):
        settings_of(level)


def test_a_flight_above_the_standard_atmosphere_is_refused() -> None:
    with pytest.raises(ConfigError, match="the flight is 50000 m above mean sea level"):
        settings_of("50km amsl")


@pytest.mark.parametrize(
    ("stated", "factor"),
    [
        ({"level": "925hPa"}, 1.0377),
        ({"level": "1600m amsl"}, 1.0813),
        ({"level": "100m", "ground": 1500.0}, 1.0813),
        ({"level": "100m"}, 1.0048),
        ({"level": "925hPa", "celsius": 30.0}, math.sqrt(101_325 / 92_500 * 303.15 / 288.15)),
    ],
)
def test_the_air_gives_the_ratio_of_true_and_calibrated_airspeed(
    stated: dict[str, Any], factor: float
) -> None:
    settings = settings_of(**stated)
    air = flight_air(settings, flight_height(settings))
    assert air is not None
    assert 1.0 / air.calibrated(np.ones(1))[0] == pytest.approx(factor, abs=2e-4)
    assert ("scene.ground is not set" in air.source) == (stated == {"level": "100m"})
    assert ("robot.air_temperature" in air.source) == ("celsius" in stated)


def test_there_is_no_air_in_the_water() -> None:
    settings = settings_of("30m depth", wind="30m depth")
    assert flight_air(settings, flight_height(settings)) is None


@pytest.mark.parametrize(
    "robot", ["fixed_wing", "light_aircraft", "long_endurance", "multirotor", "stratospheric"]
)
def test_every_aircraft_has_air(robot: str) -> None:
    settings = Settings(robot=Settings.of_section("robot", robot))
    air = flight_air(settings, flight_height(settings))
    assert air is not None
    assert 0.05 < air.density_ratio < 1.0


# --- the air of a wind file ----------------------------------------------------------------------


def air_of(measured: MeasuredAir, **stated: Any) -> FlownAir:
    settings = settings_of(**stated)
    air = flight_air(settings, flight_height(settings), measured)
    assert air is not None
    return air


def test_at_the_level_of_the_wind_the_air_is_that_of_the_file() -> None:
    air = air_of(MeasuredAir(289.45, "925hPa"), level="925hPa")
    assert air.temperature == pytest.approx(289.45)
    assert air.pressure == 92_500.0
    assert air.density_ratio == pytest.approx(92_500.0 / (287.05287 * 289.45) / 1.225)
    assert air.source == "the standard atmosphere at 925 hPa, but 16.3 °C, the temperature of the wind file"


def test_a_temperature_at_another_height_keeps_its_deviation_from_the_standard() -> None:
    """20 K above the standard at 2 m are 20 K above the standard at 300 m, where this is 286.2 K."""
    air = air_of(MeasuredAir(288.15 - 0.0065 * 2.0 + 20.0, "2m"), level="300m")
    assert air.temperature == pytest.approx(288.15 - 0.0065 * 300.0 + 20.0)
    ground = air_of(MeasuredAir(288.15 - 0.0065 * 1502.0, "2m"), level="300m", ground=1500.0)
    assert ground.temperature == pytest.approx(288.15 - 0.0065 * 1800.0)


def test_a_pressure_at_the_ground_falls_off_with_the_height() -> None:
    air = air_of(MeasuredAir(290.0, "2m", 90_000.0), level="200m")
    assert air.pressure == pytest.approx(90_000.0 * math.exp(-9.80665 * 200.0 / (287.05287 * 290.0)))
    assert "from the pressure of the wind file and 15.6 °C, the temperature of the wind file" in air.source
    amsl = MeasuredAir(290.0, "2m", 90_000.0)
    assert air_of(amsl, level="1200m amsl", ground=1000.0).pressure == pytest.approx(air.pressure)
    assert "standard atmosphere" in air_of(amsl, level="400m amsl").source  # the ground is not known


def test_air_far_above_or_below_the_flight_is_not_used() -> None:
    stated = {"level": "700hPa", "ground": 0.0}
    settings = settings_of(**stated)
    assert air_of(MeasuredAir(310.0, "2m", 101_000.0), **stated) == flight_air(
        settings, flight_height(settings)
    )


def test_a_temperature_of_the_settings_wins_and_a_contradiction_is_said() -> None:
    measured = MeasuredAir(289.15, "925hPa")
    near, far = (settings_of(level="925hPa", celsius=celsius) for celsius in (2.0, -2.0))
    for settings, celsius in ((near, 2.0), (far, -2.0)):
        air = flight_air(settings, flight_height(settings), measured)
        assert air is not None
        assert air.temperature == pytest.approx(celsius + 273.15)
    assert temperature_doubt(near, flight_height(near), measured) == ""
    words = temperature_doubt(far, flight_height(far), measured)
    assert words.startswith("robot.air_temperature=-2 is used, but the wind file has 16.0 °C at the height")
    cured = settings_of(level="925hPa")
    assert temperature_doubt(cured, flight_height(cured), measured) == ""


def test_there_is_air_at_the_surface_and_a_height_is_stated_unless_it_is_said_otherwise() -> None:
    surface = Height(0.0, above_sea=False, level="0m")
    assert surface.stated
    assert not surface.of_sea
    assert flight_air(Settings(), surface) is not None
    assert flight_air(Settings(), replace(surface, metres=-1.0)) is None
