"""The one height of a flight, from all settings that state it, and the air that is there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from flight_quantities.atmosphere import FREEZING, HIGHEST, LOWEST, standard_air
from flight_quantities.heights import (
    FlownAir,
    Height,
    MeasuredAir,
    level_height,
    pressure_at,
    temperature_at,
)
from flight_quantities.levels import ALTITUDE, DEPTH, HEIGHT, PRESSURE, Level, parse_level
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.levels import wind_level

if TYPE_CHECKING:
    from pareto_ltl.settings import Settings

CONTRADICTION = 15.0  # [K] between the temperatures of the settings and of a wind file


@runtime_checkable
class StatesHeight(Protocol):
    """A section of settings, of any package, that can state the height of the flight."""

    def stated_height(self) -> tuple[str, Level] | None:
        """``key=value`` and the level, if the section states it."""


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
        return level_height(wind_level(settings.wind.level), stated=False)
    (key, height), *others = stated
    for other, second in others:
        if not height.agrees(second, settings.scene.ground):
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
        stated.append((f"robot.level={robot}", level_height(wind_level(robot, "robot.level"))))
    if scene is not None:
        grounded = bool(stated) and not stated[0][1].above_sea
        kind = DEPTH if scene < 0.0 else HEIGHT if grounded else ALTITUDE
        stated.append((f"scene.altitude={scene:g}", level_height(Level(kind, abs(scene)))))
    others = (section for section in settings.sections() if isinstance(section, StatesHeight))
    further = filter(None, (section.stated_height() for section in others))
    return stated + [(words, level_height(level)) for words, level in further]


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
    warmth = None if measured is None else temperature_at(height, measured, ground)
    if measured is not None and warmth is not None:
        temperature, words = warmth, f", but {warmth - FREEZING:.1f} °C, the temperature of the wind file"
    if (celsius := settings.robot.air_temperature) is not None:
        temperature, words = celsius + FREEZING, f", but {celsius:g} °C (robot.air_temperature)"
    if level.kind == PRESSURE:
        pressure = level.value
    elif measured is not None and (found := pressure_at(height, measured, ground)) is not None:
        pressure, source = found, f"{found / 100.0:.1f} hPa, from the pressure of the wind file"
        words = words.replace(", but", " and")
    return FlownAir(pressure, temperature, source + words)


def temperature_doubt(settings: Settings, height: Height, measured: MeasuredAir) -> str:
    """A warning if ``robot.air_temperature`` contradicts a ``measured`` temperature; else empty."""
    celsius = settings.robot.air_temperature
    warmth = temperature_at(height, measured, settings.scene.ground)
    if celsius is None or warmth is None or abs(celsius + FREEZING - warmth) <= CONTRADICTION:
        return ""
    return (
        f"robot.air_temperature={celsius:g} is used, but the wind file has {warmth - FREEZING:.1f} °C at the "
        "height of the flight: correct it, or set robot.air_temperature=null to use the file"
    )
