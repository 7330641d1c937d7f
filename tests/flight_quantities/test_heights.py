"""Heights of a flight that agree, and the air there by what was measured nearby."""

from __future__ import annotations

import pytest

from careful_io.errors import ConfigError
from flight_quantities.atmosphere import standard_air
from flight_quantities.heights import FlownAir, Height, MeasuredAir, level_height, pressure_at, temperature_at
from flight_quantities.levels import Level, parse_level


def height_of(text: str) -> Height:
    return level_height(parse_level(text))


@pytest.mark.parametrize(
    ("one", "other", "ground", "agree"),
    [("100m", "101m", None, True), ("100m", "102m", None, False), ("400m amsl", "100m", 300.0, True),
     ("100m", "400m amsl", 300.0, True), ("400m amsl", "100m", None, False),
     ("100m", "100m amsl", None, True)],
)  # fmt: skip
def test_heights_above_the_ground_and_above_the_sea_agree_by_the_ground(one, other, ground, agree):
    assert height_of(one).agrees(height_of(other), ground) is agree


def test_a_temperature_keeps_its_deviation_from_the_standard_atmosphere():
    measured = MeasuredAir(standard_air(302.0).temperature + 5.0, "2m")
    found = temperature_at(height_of("500m amsl"), measured, 300.0)
    assert found == pytest.approx(standard_air(500.0).temperature + 5.0)
    assert temperature_at(height_of("900m amsl"), measured, 300.0) is None
    assert temperature_at(height_of("100m"), MeasuredAir(280.0, "40000m"), None) is None


def test_a_pressure_falls_with_the_height():
    measured = MeasuredAir(288.15, "2m", 101_325.0)
    expected = standard_air(100.0).pressure
    assert pressure_at(height_of("100m"), measured, None) == pytest.approx(expected, rel=1e-4)
    assert pressure_at(height_of("100m amsl"), measured, None) is None
    assert pressure_at(height_of("700m"), measured, None) is None
    assert pressure_at(height_of("100m"), measured._replace(pressure=None), None) is None


def test_thin_air_makes_the_calibrated_airspeed_smaller():
    air = FlownAir(*standard_air(1600.0), "the standard atmosphere")
    assert air.calibrated(32.44) == pytest.approx(30.0, abs=0.01)


def test_a_pressure_outside_the_atmosphere_is_refused():
    with pytest.raises(ConfigError, match=r"level 1hPa: .* of the standard atmosphere"):
        level_height(Level("pressure", 100.0))
