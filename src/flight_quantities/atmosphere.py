"""The standard atmosphere, and the two airspeeds: true, and calibrated as autopilots mean it.

A pitot tube measures the dynamic pressure ½ρv². Instruments and autopilots turn it into a speed with the
density of the standard atmosphere at sea level, ρ0: the calibrated airspeed (CAS). The speed through the air
that surrounds the robot is the true airspeed (TAS):

    TAS = CAS √(ρ0 / ρ)

This is the formula of the equivalent airspeed (EAS). Up to a Mach number M of 0.25, where small aircraft
fly, the calibrated airspeed exceeds it by less than 1 % (by M²/8).

Source: ISO 2533:1975, the same as the U.S. Standard Atmosphere (1976) up to 32 km of geopotential height.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, TypeVar

if TYPE_CHECKING:  # NumPy takes long to import, and nothing here needs it
    from flight_quantities.arrays import FloatArray

Speed = TypeVar("Speed", float, "FloatArray")

GRAVITY = 9.80665  # [m/s2]
GAS = 287.05287  # specific gas constant of dry air [J/(kg K)]
FREEZING = 273.15  # [K] 0 °C
SEA_PRESSURE, SEA_TEMPERATURE = 101_325.0, 288.15  # [Pa], [K]
SEA_DENSITY = SEA_PRESSURE / (GAS * SEA_TEMPERATURE)  # 1.225 [kg/m3]
SCALES = {  # factor and offset that turn a temperature into kelvin, by its unit in lower case
    **dict.fromkeys(("k", "kelvin", "degk", "deg_k", "degree_kelvin"), (1.0, 0.0)),
    **dict.fromkeys(
        ("c", "degc", "deg_c", "°c", "celsius", "degree_celsius", "degrees_celsius", "degree_c"),
        (1.0, FREEZING),
    ),
    **dict.fromkeys(("f", "degf", "deg_f", "°f", "fahrenheit"), (5.0 / 9.0, FREEZING - 160.0 / 9.0)),
}
LOWEST, HIGHEST = -2_000.0, 32_000.0  # [m] geopotential heights between which the layers hold


class Layer(NamedTuple):
    """A layer from ``base`` [m] upwards, with the pressure [Pa] and temperature [K] there.

    ``lapse`` is dT/dh [K/m].
    """

    base: float
    pressure: float
    temperature: float
    lapse: float

    def pressure_at(self, height: float) -> float:
        """Pressure [Pa] at ``height`` [m]: hydrostatic, of dry air."""
        if self.lapse == 0.0:
            return self.pressure * math.exp(-GRAVITY * (height - self.base) / (GAS * self.temperature))
        warmth = self.temperature_at(height) / self.temperature
        return float(self.pressure * warmth ** (-GRAVITY / (GAS * self.lapse)))

    def temperature_at(self, height: float) -> float:
        """Temperature [K] at ``height`` [m]."""
        return self.temperature + self.lapse * (height - self.base)

    def height_of(self, pressure: float) -> float:
        """Height [m] of ``pressure`` [Pa], the inverse of :meth:`pressure_at`."""
        if self.lapse == 0.0:
            return self.base + GAS * self.temperature / GRAVITY * math.log(self.pressure / pressure)
        warmth = (pressure / self.pressure) ** (-GAS * self.lapse / GRAVITY)
        return float(self.base + self.temperature / self.lapse * (warmth - 1.0))


def _layers() -> tuple[Layer, ...]:
    """The layers of the standard atmosphere, each from the top of the one below."""
    layers = [Layer(0.0, SEA_PRESSURE, SEA_TEMPERATURE, -0.0065)]
    for base, lapse in ((11_000.0, 0.0), (20_000.0, 0.001)):
        below = layers[-1]
        layers.append(Layer(base, below.pressure_at(base), below.temperature_at(base), lapse))
    return tuple(layers)


LAYERS = _layers()


class Air(NamedTuple):
    """Static pressure [Pa] and temperature [K] of the air somewhere."""

    pressure: float
    temperature: float

    @property
    def density_ratio(self) -> float:
        """ρ / ρ0: the density of dry air, relative to the standard atmosphere at sea level."""
        return self.pressure / (GAS * self.temperature) / SEA_DENSITY


def standard_air(height: float) -> Air:
    """The standard atmosphere at a geopotential ``height`` [m] above mean sea level.

    Raises
    ------
    ValueError
        If ``height`` is not between -2 and 32 km.

    Examples
    --------
    >>> round(standard_air(0.0).density_ratio, 6), round(standard_air(1600.0).density_ratio, 4)
    (1.0, 0.8552)
    """
    if not LOWEST <= height <= HIGHEST:
        raise ValueError(f"height {height:g} m is not between {LOWEST:g} and {HIGHEST:g} m")
    layer = next(layer for layer in reversed(LAYERS) if height >= layer.base or layer is LAYERS[0])
    return Air(layer.pressure_at(height), layer.temperature_at(height))


def standard_height(pressure: float) -> float:
    """Geopotential height [m] above mean sea level of ``pressure`` [Pa] in the standard atmosphere.

    Raises
    ------
    ValueError
        If the height is not between -2 and 32 km.

    Examples
    --------
    >>> round(standard_height(92_500.0)), round(standard_height(5_000.0))
    (762, 20576)
    """
    if not LAYERS[-1].pressure_at(HIGHEST) <= pressure <= LAYERS[0].pressure_at(LOWEST):
        raise ValueError(f"pressure {pressure:g} Pa is not one between {LOWEST:g} and {HIGHEST:g} m")
    layer = next(layer for layer in reversed(LAYERS) if pressure <= layer.pressure or layer is LAYERS[0])
    return layer.height_of(pressure)


def pressure_above(pressure: float, temperature: float, rise: float) -> float:
    """Pressure [Pa] ``rise`` [m] above the height of ``pressure`` [Pa], in air of one ``temperature`` [K].

    Examples
    --------
    >>> round(pressure_above(101_325.0, 288.15, 100.0))
    100131
    """
    return pressure * math.exp(-GRAVITY * rise / (GAS * temperature))


def true_airspeed(calibrated: Speed, density_ratio: float) -> Speed:
    """True airspeed of a calibrated one, in the same unit.

    Examples
    --------
    >>> round(true_airspeed(30.0, standard_air(1600.0).density_ratio), 2)
    32.44
    """
    return calibrated / math.sqrt(density_ratio)


def calibrated_airspeed(true: Speed, density_ratio: float) -> Speed:
    """Calibrated airspeed of a true one, in the same unit; the inverse of :func:`true_airspeed`."""
    return true * math.sqrt(density_ratio)


def temperature_scale(unit: str) -> tuple[float, float] | None:
    """Factor and offset that turn a temperature in ``unit`` into kelvin; None for other units."""
    return SCALES.get(unit.strip().lower().replace(" ", "_"))
