"""Levels of winds, currents and flights: ``10m`` above ground, ``300m amsl``, ``925hPa``, ``50m depth``."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from careful_io.messages import shown_text, shown_value
from pareto_ltl.support.atmosphere import standard_air, standard_height
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.medium import medium_of

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
        """The level as settings state it: ``10m``, ``300m amsl``, ``925hPa``; for a current ``0m depth``."""
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


def parse_level(text: str, key: str = "wind.level") -> Level:
    """The level that ``text`` names; ConfigError if it is not a level. ``key``: the setting that has it.

    Examples
    --------
    >>> parse_level("80 m"), parse_level("92500Pa").text, parse_level("1000ft amsl").text
    (Level(kind='height', value=80.0), '925hPa', '304.8m amsl')
    >>> parse_level("FL45").phrase
    'at 859 hPa'
    """
    text = "10m" if text == "auto" else text  # settings of a run have replaced auto already
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


def level_mismatch(flown: str, known: str) -> str:
    """A message if a wind at level ``known`` does not apply to a robot at ``flown``; empty if it does.

    Raises
    ------
    ConfigError
        If one is in the water and the other in the air.

    Examples
    --------
    >>> level_mismatch("100m", "80m"), level_mismatch("925hPa", "10m")
    ('', 'the robot flies at 925 hPa, and the wind used is 10 m above ground')
    """
    robot, wind = parse_level(flown), parse_level(known)
    if (robot.kind == DEPTH) != (wind.kind == DEPTH):
        raise ConfigError(
            f"robot.level={flown} is {'a depth' if robot.kind == DEPTH else 'in the air'}, and what is known "
            f"is {'a wind' if robot.kind == DEPTH else 'a current'} {wind.phrase}: set wind=currents for a "
            "robot in the water, another source for one in the air, or robot.level"
        )
    a, b = robot.value, wind.value
    if {robot.kind, wind.kind} == {ALTITUDE, PRESSURE}:
        a, b = robot.standard_height, wind.standard_height
    elif robot.kind != wind.kind:
        a, b = 0.0, 1.0  # the height of the ground between them is not known
    if abs(a - b) <= ALIKE * max(a, b):
        return ""
    medium = medium_of(robot.text)
    return f"the robot {medium.moves} {robot.phrase}, and the {medium.flow} used is {wind.phrase}"


def table_level(text: str, kinds: Collection[str], holds: str) -> Level:
    """The level of a table, which only ``wind.level`` states; ``holds`` says what the table has.

    ConfigError if the kind of the level is not in ``kinds``, or if the height is 0.
    """
    level = parse_level(text)
    if level.kind not in kinds or (level.kind == HEIGHT and level.value == 0):
        others = " or a pressure (925hPa), for a current a depth ('50m depth')" if DEPTH in kinds else ""
        raise ConfigError(
            f"wind.level={shown_text(text)} is {level.phrase}; {holds}: expected a height above ground such "
            f"as 10m{others}"
        )
    return level


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
