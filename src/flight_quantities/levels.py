"""Levels of winds, currents and flights: ``10m`` above ground, ``300m amsl``, ``925hPa``, ``50m depth``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from careful_io.errors import ConfigError
from careful_io.messages import shown_value
from flight_quantities.atmosphere import standard_air, standard_height

HEIGHT, ALTITUDE, PRESSURE, DEPTH = "height", "altitude", "pressure", "depth"
LENGTHS = {"m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1000.0}  # [m]
FOOT = 0.3048  # [m]
FLIGHT_LEVEL = 100.0 * FOOT  # [m] in the standard atmosphere
PHRASES = {HEIGHT: "above ground", ALTITUDE: "above mean sea level", DEPTH: "below the surface"}
SUFFIXES = {HEIGHT: "", ALTITUDE: " amsl", DEPTH: " depth"}  # of a level as text
LEVEL = r"(\d+(?:\.\d*)?)\s*(km|m|ft|hpa|pa|mbar|mb)(?:\s*(depth|amsl|msl|agl))?"
PRESSURES = {"pa": 1.0, "pascal": 1.0, "kpa": 1000.0}  # [Pa]
PRESSURES |= dict.fromkeys(("hpa", "mb", "mbar", "millibar", "millibars"), 100.0)
SHOWN_LEVELS = 12
FARTHEST = 300.0  # [m] between the level of a wind above ground and the level of its temperature
SAME_PRESSURE = 1e-3  # largest relative difference of two pressures that are one level
ALIKE = 0.2  # largest relative difference of two heights or depths whose winds count as the same


@dataclass(frozen=True, slots=True, order=True)
class Level:
    """A level.

    Attributes
    ----------
    kind : str
        ``height`` above ground, ``altitude`` above mean sea level, ``pressure``, or ``depth`` below the
        surface of the sea.
    value : float
        Height or depth [m], or pressure [Pa].
    """

    kind: str
    value: float

    @property
    def text(self) -> str:
        """The level as :func:`parse_level` reads it: ``10m``, ``300m amsl``, ``925hPa``, ``0m depth``."""
        if self.kind == PRESSURE:
            return f"{_digits(self.value / 100.0)}hPa"
        return f"{_digits(self.value)}m{SUFFIXES[self.kind]}"

    @property
    def phrase(self) -> str:
        """The level for messages: ``10 m above ground``, ``at 925 hPa``, ``50 m below the surface``."""
        if self.kind == PRESSURE:
            return f"at {_digits(self.value / 100.0)} hPa"
        return f"{_digits(self.value)} m {PHRASES[self.kind]}"

    @property
    def standard_height(self) -> float:
        """Height [m]: of a pressure in the standard atmosphere, negative for a depth."""
        if self.kind == PRESSURE:
            return standard_height(self.value)
        return -self.value if self.kind == DEPTH else self.value


def _digits(value: float) -> str:
    """``value`` without an exponent, which a level cannot have."""
    return f"{value:.6f}".rstrip("0").rstrip(".")


def parse_level(text: str, key: str = "level") -> Level:
    """The level that ``text`` names; a ConfigError, which begins with ``key``, if it is not a level.

    Examples
    --------
    >>> parse_level("80 m"), parse_level("92500Pa").text, parse_level("1000ft amsl").text
    (Level(kind='height', value=80.0), '925hPa', '304.8m amsl')
    >>> parse_level("FL45").phrase
    'at 859 hPa'
    """
    plain = text.strip().lower()
    if flown := re.fullmatch(r"fl\s*(\d{1,3})", plain):
        pressure = standard_air(float(flown[1]) * FLIGHT_LEVEL).pressure
        return Level(PRESSURE, round(pressure, -1))  # [Pa], 1 m
    found = re.fullmatch(LEVEL, plain)
    value = float(found[1]) * (LENGTHS | PRESSURES | {"ft": FOOT})[found[2]] if found else -1.0
    pressed = found is not None and found[2] in PRESSURES
    if found is None or not value <= 1e6 or (pressed and (value == 0 or found[3])):
        raise ConfigError(
            f"{key} {shown_value(text)} is not a level; expected a height above ground (10m, 80m), "
            "a height above mean sea level (300m amsl), a pressure (925hPa), or in the water a depth "
            "(0m depth, 50m depth)"
        )
    if pressed:
        return Level(PRESSURE, value)
    return Level({"depth": DEPTH, "amsl": ALTITUDE, "msl": ALTITUDE}.get(found[3], HEIGHT), value)


def same_wind(one: Level, other: Level) -> bool:
    """Whether the wind at ``other`` counts as the one at ``one``: within 20 % of the height.

    A height above ground and one above sea level differ by the height of the ground, which is not known here.

    Examples
    --------
    >>> ground = Level(HEIGHT, 100.0)
    >>> same_wind(ground, Level(HEIGHT, 80.0)), same_wind(ground, Level(PRESSURE, 92_500.0))
    (True, False)
    """
    a, b = one.value, other.value
    if {one.kind, other.kind} == {ALTITUDE, PRESSURE}:
        a, b = one.standard_height, other.standard_height
    elif one.kind != other.kind:
        return False
    return abs(a - b) <= ALIKE * max(a, b)


def level_list(levels: Iterable[Level]) -> str:
    """Levels of a file, for messages: ``10m, 80m, 1000hPa and 3 more``."""
    texts = [level.text for level in sorted(set(levels))]
    more = f" and {len(texts) - SHOWN_LEVELS} more" if len(texts) > SHOWN_LEVELS else ""
    return ", ".join(texts[:SHOWN_LEVELS]) + more


def nearest_level(found: Sequence[Level], wind: Level) -> Level | None:
    """The level among ``found`` whose temperature belongs to a wind at ``wind``; None if there is none."""
    limit = SAME_PRESSURE * wind.value if wind.kind == PRESSURE else FARTHEST
    fitting = [level for level in found if level.kind == wind.kind and _gap(level, wind) <= limit]
    return min(fitting, key=lambda level: _gap(level, wind), default=None)


def _gap(one: Level, other: Level) -> float:
    return abs(one.value - other.value)
