"""The one height of a flight, from all settings that state it, and the air that is there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from pareto_ltl.support.atmosphere import (
    FREEZING,
    HIGHEST,
    LOWEST,
    Air,
    calibrated_airspeed,
    pressure_above,
    standard_air,
)
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.levels import ALTITUDE, DEPTH, HEIGHT, PRESSURE, Level, parse_level

if TYPE_CHECKING:
    from pareto_ltl.settings import Settings
    from pareto_ltl.support.arrays import FloatArray

ALIKE = 0.01  # largest relative difference of two statements of one height ...
ALIKE_METRES = 1.0  # ... and the difference that is always allowed [m]
CONTRADICTION = 15.0  # [K] between the temperatures of the settings and of a wind file
REACH = 500.0  # [m] from the flight, within which a temperature or pressure of a wind file is used


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
        As settings state a level: ``925hPa``, ``100m``, ``300m amsl``, ``30m depth``.
    stated : bool
        False if no setting states it, so that it is taken from the level of the wind.
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

    @property
    def text(self) -> str:
        """For people: ``762 m above mean sea level``."""
        if self.metres < 0.0:
            return f"{-round(self.metres, 1):g} m below the surface"
        return f"{round(self.metres, 1):g} m above {'mean sea level' if self.above_sea else 'the ground'}"


@dataclass(frozen=True, slots=True)
class FlownAir:
    """The air around the robot, which turns true into calibrated airspeed.

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
    """The air of a wind file during a flight.

    Attributes
    ----------
    temperature : float
        [K]
    level : str
        Where this is, as settings state a level.
    pressure : float or None
        [Pa]; None if it is not known.
    pressure_level : str
        Where this is.
    """

    temperature: float
    level: str
    pressure: float | None = None
    pressure_level: str = "0m"


@runtime_checkable
class StatesHeight(Protocol):
    """A section of settings, of any package, that can state the height of the flight."""

    def stated_height(self) -> tuple[str, Level] | None:
        """``key=value`` and the level, if the section states it."""


def level_height(level: Level, stated: bool = True) -> Height:
    """The height of a ``level``; ConfigError for a pressure outside the standard atmosphere."""
    try:
        metres = level.standard_height
    except ValueError as error:
        raise ConfigError(f"level {level.text}: {error} of the standard atmosphere") from None
    return Height(metres, level.kind in (ALTITUDE, PRESSURE), level.text, stated)


def flight_height(settings: Settings) -> Height:
    """The height of the flight; without a setting that states it, the level of the wind.

    ``robot.level``, ``scene.altitude`` and sections of other packages state the same height. The second is
    above mean sea level, or above ground with a ``robot.level`` above ground; below 0 it is a depth.

    Raises
    ------
    ConfigError
        If two of them differ by more than 1 % and 1 m.
    """
    stated = _stated(settings)
    if not stated:
        return level_height(parse_level(settings.wind.level), stated=False)
    (key, height), *others = stated
    for other, second in others:
        if not _alike(height.metres, _as_above(height, second, settings)):
            raise ConfigError(
                f"{key} is {height.text}, and {other} is {second.text}: a flight has one height. "
                f"Set {_cure(key, other, height, second)}"
            )
    return height


def _stated(settings: Settings) -> list[tuple[str, Height]]:
    """The settings that state a height, as ``key=value``, and the heights."""
    robot, scene = settings.robot.level, settings.scene.altitude
    stated = []
    if robot:
        stated.append((f"robot.level={robot}", level_height(parse_level(robot, "robot.level"))))
    if scene is not None:
        grounded = bool(stated) and not stated[0][1].above_sea
        kind = DEPTH if scene < 0.0 else HEIGHT if grounded else ALTITUDE
        stated.append((f"scene.altitude={scene:g}", level_height(Level(kind, abs(scene)))))
    others = (section for section in settings.sections() if isinstance(section, StatesHeight))
    further = filter(None, (section.stated_height() for section in others))
    return stated + [(words, level_height(level)) for words, level in further]


def _as_above(height: Height, other: Height, settings: Settings) -> float:
    """The metres of ``other`` from where ``height`` is counted; a ground that is not known is at 0."""
    if height.above_sea == other.above_sea or other.metres < 0.0:
        return other.metres
    ground = settings.scene.ground or 0.0
    return other.metres + ground if height.above_sea else other.metres - ground


def _alike(a: float, b: float) -> bool:
    return abs(a - b) <= max(ALIKE_METRES, ALIKE * max(abs(a), abs(b)))


def _cure(key: str, other: str, height: Height, second: Height) -> str:
    """What makes two statements agree: the second as the level of the robot, or without the second."""
    name = other.partition("=")[0]
    if key.startswith("robot."):
        return f"robot.level='{second.level}', or {name}=null for {height.text}"
    return f"{name}=null, and robot.level for the height"


def flight_air(settings: Settings, height: Height, measured: MeasuredAir | None = None) -> FlownAir | None:
    """The air at ``height``; None in the water.

    The pressure is ``robot.level`` where this is one, else follows from a ``measured`` one, else comes from
    the standard atmosphere. The temperature is ``robot.air_temperature``, else follows from the ``measured``
    one, else comes from the standard atmosphere at that pressure. For a height above ground, ``scene.ground``
    is added; without it the ground is taken to be at sea level.

    A temperature measured at another height keeps its deviation from the standard atmosphere, within
    ``REACH``; a pressure is reduced hydrostatically.

    Raises
    ------
    ConfigError
        If the height is outside the standard atmosphere.
    """
    if settings.medium.matter == "water" or height.metres < 0.0:
        return None
    ground = settings.scene.ground
    metres = height.above_sea_level(ground)
    if not LOWEST <= metres <= HIGHEST:
        raise ConfigError(
            f"the flight is {height.text}, and the standard atmosphere, which gives the calibrated airspeed, "
            f"reaches from {LOWEST:g} to {HIGHEST:g} m: set another robot.level"
        )
    standard = standard_air(metres)
    level = parse_level(height.level)
    source = f"the standard atmosphere at {round(metres, 1):g} m above mean sea level"
    if level.kind == PRESSURE:
        source = f"the standard atmosphere {level.phrase}"
    elif not height.above_sea and ground is None:
        source += ", with the ground at sea level, as scene.ground is not set"
    pressure, temperature, words = standard.pressure, standard.temperature, ""
    warmth = None if measured is None else measured_temperature(settings, height, measured)
    if measured is not None and warmth is not None:
        temperature, words = warmth, f", but {warmth - FREEZING:.1f} °C, the temperature of the wind file"
    if (celsius := settings.robot.air_temperature) is not None:
        temperature, words = celsius + FREEZING, f", but {celsius:g} °C (robot.air_temperature)"
    if level.kind == PRESSURE:
        pressure = level.value
    elif measured is not None and (found := _measured_pressure(settings, height, measured)) is not None:
        pressure, source = found, f"{found / 100.0:.1f} hPa, from the pressure of the wind file"
        words = words.replace(", but", " and")
    return FlownAir(pressure, temperature, source + words)


def measured_temperature(settings: Settings, height: Height, measured: MeasuredAir) -> float | None:
    """Temperature [K] at ``height`` by a ``measured`` one; None if it is measured too far above or below."""
    ground = settings.scene.ground
    there = level_height(parse_level(measured.level)).above_sea_level(ground)
    here = height.above_sea_level(ground)
    if abs(here - there) > REACH or not LOWEST <= there <= HIGHEST:
        return None
    return standard_air(here).temperature + measured.temperature - standard_air(there).temperature


def _measured_pressure(settings: Settings, height: Height, measured: MeasuredAir) -> float | None:
    """Pressure [Pa] at ``height`` by a ``measured`` one above ground; None if the ground is not known."""
    start = level_height(parse_level(measured.pressure_level))
    if measured.pressure is None or (height.above_sea and settings.scene.ground is None):
        return None
    ground = settings.scene.ground
    rise = height.above_sea_level(ground) - start.above_sea_level(ground)
    return None if abs(rise) > REACH else pressure_above(measured.pressure, measured.temperature, rise)


def temperature_doubt(settings: Settings, height: Height, measured: MeasuredAir) -> str:
    """A warning if ``robot.air_temperature`` contradicts a ``measured`` temperature; else empty."""
    celsius, warmth = settings.robot.air_temperature, measured_temperature(settings, height, measured)
    if celsius is None or warmth is None or abs(celsius + FREEZING - warmth) <= CONTRADICTION:
        return ""
    return (
        f"robot.air_temperature={celsius:g} is used, but the wind file has {warmth - FREEZING:.1f} °C at the "
        "height of the flight: correct it, or set robot.air_temperature=null to use the file"
    )
