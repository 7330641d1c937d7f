"""The height of a flight, and the air there: standard, or from what was measured nearby."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from careful_io.errors import ConfigError
from flight_quantities.atmosphere import (
    HIGHEST,
    LOWEST,
    Air,
    calibrated_airspeed,
    pressure_above,
    standard_air,
)
from flight_quantities.levels import ALTITUDE, PRESSURE, Level, parse_level

if TYPE_CHECKING:
    from flight_quantities.arrays import FloatArray

ALIKE = 0.01  # largest relative difference of two statements of one height ...
ALIKE_METRES = 1.0  # ... and the difference that is always allowed [m]
REACH = 500.0  # [m] up or down, within which a measured temperature or pressure is used


@dataclass(frozen=True, slots=True)
class Height:
    """Height of a flight.

    Attributes
    ----------
    metres : float
        Above the ground of the start, or above mean sea level [m]; a depth is negative. The height of a
        pressure is the one in the standard atmosphere.
    above_sea : bool
        Whether it is above mean sea level.
    level : str
        As text, see :mod:`flight_quantities.levels`: ``925hPa``, ``100m``, ``300m amsl``, ``30m depth``.
    stated : bool
        False if it is assumed, for example from the level of a wind.
    """

    metres: float
    above_sea: bool
    level: str
    stated: bool = True

    @property
    def of_sea(self) -> bool:
        """Whether it is above mean sea level or a depth, so that no height of the ground is needed."""
        return self.above_sea or self.metres < 0.0

    def above_sea_level(self, ground: float | None) -> float:
        """Metres above mean sea level; a ``ground`` [m] that is not known is at sea level."""
        return self.metres + (0.0 if self.above_sea else ground or 0.0)

    def agrees(self, other: Height, ground: float | None) -> bool:
        """Whether ``other`` states the same height, within 1 % or 1 m; see :meth:`above_sea_level`."""
        metres = other.metres
        if self.above_sea != other.above_sea and metres >= 0.0:
            metres += (ground or 0.0) if self.above_sea else -(ground or 0.0)
        return abs(self.metres - metres) <= max(ALIKE_METRES, ALIKE * max(abs(self.metres), abs(metres)))

    @property
    def text(self) -> str:
        """For people: ``762 m above mean sea level``."""
        if self.metres < 0.0:
            return f"{-round(self.metres, 1):g} m below the surface"
        return f"{round(self.metres, 1):g} m above {'mean sea level' if self.above_sea else 'the ground'}"


@dataclass(frozen=True, slots=True)
class FlownAir:
    """The air around a craft, which turns true into calibrated airspeed.

    Attributes
    ----------
    pressure, temperature : float
        [Pa], [K]
    source : str
        Where they come from, as a part of a sentence.
    """

    pressure: float
    temperature: float
    source: str

    @property
    def density_ratio(self) -> float:
        """ρ / ρ0 against the standard atmosphere at sea level."""
        return Air(self.pressure, self.temperature).density_ratio

    def calibrated(self, true: FloatArray) -> FloatArray:
        """Calibrated airspeeds of ``true`` ones, in the same unit."""
        return calibrated_airspeed(true, self.density_ratio)


class MeasuredAir(NamedTuple):
    """Air that was measured or forecast near a flight.

    Attributes
    ----------
    temperature : float
        [K]
    level : str
        Where this is, as a level.
    pressure : float or None
        [Pa]; None if it is not known.
    pressure_level : str
        Where this is.
    """

    temperature: float
    level: str
    pressure: float | None = None
    pressure_level: str = "0m"


def level_height(level: Level, stated: bool = True) -> Height:
    """The height of a ``level``; ConfigError for a pressure outside the standard atmosphere."""
    try:
        metres = level.standard_height
    except ValueError as error:
        raise ConfigError(f"level {level.text}: {error} of the standard atmosphere") from None
    return Height(metres, level.kind in (ALTITUDE, PRESSURE), level.text, stated)


def temperature_at(height: Height, measured: MeasuredAir, ground: float | None) -> float | None:
    """Temperature [K] at ``height`` by a ``measured`` one; None if it is measured too far above or below.

    It keeps its deviation from the standard atmosphere. ``ground`` [m] is at sea level if it is not known.
    """
    there = level_height(parse_level(measured.level)).above_sea_level(ground)
    here = height.above_sea_level(ground)
    if abs(here - there) > REACH or not LOWEST <= there <= HIGHEST:
        return None
    return standard_air(here).temperature + measured.temperature - standard_air(there).temperature


def pressure_at(height: Height, measured: MeasuredAir, ground: float | None) -> float | None:
    """Pressure [Pa] at ``height`` by a ``measured`` one above ground, reduced hydrostatically.

    None if it is not known or too far away, or if the ``ground`` below a height above sea level is not known.
    """
    start = level_height(parse_level(measured.pressure_level))
    if measured.pressure is None or (height.above_sea and ground is None):
        return None
    rise = height.above_sea_level(ground) - start.above_sea_level(ground)
    return None if abs(rise) > REACH else pressure_above(measured.pressure, measured.temperature, rise)
