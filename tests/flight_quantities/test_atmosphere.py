"""The standard atmosphere against published tables, and the two airspeeds."""

from __future__ import annotations

import doctest
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flight_quantities import atmosphere
from flight_quantities.atmosphere import (
    HIGHEST,
    LOWEST,
    SEA_DENSITY,
    Air,
    calibrated_airspeed,
    standard_air,
    standard_height,
    temperature_scale,
    true_airspeed,
)

# Geopotential height [m], pressure [Pa], temperature [K], density [kg/m3]:
# U.S. Standard Atmosphere, 1976, Table II.
PUBLISHED = [
    (-1000, 113_929, 294.650, 1.3470),
    (0, 101_325, 288.150, 1.2250),
    (1000, 89_874.6, 281.650, 1.1116),
    (3000, 70_108.5, 268.650, 0.90912),
    (11_000, 22_632.1, 216.650, 0.36392),
    (20_000, 5_474.89, 216.650, 0.088035),
    (30_000, 1_171.87, 226.650, 0.018012),
]


@pytest.mark.parametrize(("height", "pressure", "temperature", "density"), PUBLISHED)
def test_the_atmosphere_is_that_of_the_published_table(height, pressure, temperature, density):
    air = standard_air(height)
    assert air.pressure == pytest.approx(pressure, rel=2e-5)
    assert air.temperature == pytest.approx(temperature, abs=1e-3)
    assert air.density_ratio * SEA_DENSITY == pytest.approx(density, rel=5e-5)


@given(st.floats(LOWEST, HIGHEST))
def test_the_height_of_a_pressure_is_the_inverse(height):
    assert standard_height(standard_air(height).pressure) == pytest.approx(height, abs=1e-3)


def test_pressure_falls_by_the_weight_of_the_air_at_every_height():
    for height in range(-1900, 31_900, 50):
        lower, upper, middle = standard_air(height - 5), standard_air(height + 5), standard_air(height)
        weight = middle.density_ratio * SEA_DENSITY * 9.80665
        assert (lower.pressure - upper.pressure) / 10 == pytest.approx(weight, rel=1e-4)


@pytest.mark.parametrize(("height", "factor"), [(762, 1.0377), (1600, 1.0813), (3000, 1.1608)])
def test_the_true_airspeed_exceeds_the_calibrated_one_aloft(height, factor):
    ratio = standard_air(height).density_ratio
    assert true_airspeed(1.0, ratio) == pytest.approx(factor, abs=2e-4)
    assert calibrated_airspeed(true_airspeed(27.5, ratio), ratio) == pytest.approx(27.5)


def test_warm_air_is_thinner():
    hot = Air(101_325.0, 313.15)
    assert true_airspeed(30.0, hot.density_ratio) == pytest.approx(30.0 * math.sqrt(313.15 / 288.15))


@pytest.mark.parametrize("height", [-3000.0, 40_000.0, math.nan])
def test_heights_outside_the_layers_are_refused(height):
    with pytest.raises(ValueError, match="between -2000 and 32000 m"):
        standard_air(height)


@pytest.mark.parametrize("pressure", [0.0, -5.0, 200_000.0, math.nan])
def test_pressures_outside_the_layers_are_refused(pressure):
    with pytest.raises(ValueError, match="between -2000 and 32000 m"):
        standard_height(pressure)


@pytest.mark.parametrize(
    ("unit", "value", "kelvin"),
    [
        ("K", 280.0, 280.0),
        ("degC", 100.0, 373.15),
        ("°F", 212.0, 373.15),
        ("degF", 32.0, 273.15),
        ("F", -40.0, 233.15),
    ],
)
def test_temperatures_of_any_unit_become_kelvin(unit: str, value: float, kelvin: float) -> None:
    scale = temperature_scale(unit)
    assert scale is not None
    assert scale[0] * value + scale[1] == pytest.approx(kelvin)


def test_units_become_kelvin() -> None:
    for unit, value in (("K", 273.15), ("degC", 0.0), ("deg C", 0.0), ("°F", 32.0)):
        scale = temperature_scale(unit)
        assert scale is not None
        assert value * scale[0] + scale[1] == pytest.approx(273.15)
    assert temperature_scale("") is None


def test_the_examples_in_docstrings_are_true():
    failed, tried = doctest.testmod(atmosphere)
    assert failed == 0
    assert tried > 0
