"""Levels of winds and currents: ``10m`` above ground, ``925hPa``, ``50m depth``."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.medium import medium_of
from pareto_ltl.support.messages import shown_text, shown_value

HEIGHT, PRESSURE, DEPTH = "height", "pressure", "depth"
LENGTHS = {"m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1000.0}  # [m]
PRESSURES = {"pa": 1.0, "pascal": 1.0, "kpa": 1000.0}  # [Pa]
PRESSURES |= dict.fromkeys(("hpa", "mb", "mbar", "millibar", "millibars"), 100.0)
SHOWN_LEVELS = 12
ALIKE = 0.2  # largest relative difference of two heights or depths whose winds count as the same


@dataclass(frozen=True, slots=True, order=True)
class Level:
    """A level.

    Attributes
    ----------
    kind : str
        ``height`` above ground, ``pressure``, or ``depth`` below the surface of the sea.
    value : float
        Height or depth [m], or pressure [Pa].
    """

    kind: str
    value: float

    @property
    def text(self) -> str:
        """The level as written in ``wind.level``: ``10m``, ``925hPa``; for a current ``0m depth``."""
        if self.kind == PRESSURE:
            return f"{self.value / 100:.10g}hPa"
        return f"{self.value:.10g}m" + (" depth" if self.kind == DEPTH else "")

    @property
    def phrase(self) -> str:
        """The level for messages: ``10 m above ground``, ``at 925 hPa``, ``50 m below the surface``."""
        if self.kind == PRESSURE:
            return f"at {self.value / 100:.10g} hPa"
        return f"{self.value:.10g} m {'below the surface' if self.kind == DEPTH else 'above ground'}"


def parse_level(text: str) -> Level:
    """The level that ``text`` names; ConfigError if it is not a level.

    Examples
    --------
    >>> parse_level("80 m"), parse_level("92500Pa").text
    (Level(kind='height', value=80.0), '925hPa')
    """
    text = "10m" if text == "auto" else text  # settings of a run have replaced auto already
    found = re.fullmatch(r"(\d+(?:\.\d*)?)\s*(km|m|hpa|pa|mbar|mb)(\s*depth)?", text.strip().lower())
    value = float(found[1]) * (LENGTHS | PRESSURES)[found[2]] if found else -1.0
    pressure = found is not None and found[2] not in ("m", "km")
    if found is None or not value <= 1e6 or (pressure and (value == 0 or found[3])):
        raise ConfigError(
            f"wind.level {shown_value(text)} is not a level; expected a height above ground (10m, 80m), "
            "a pressure (925hPa), or for currents a depth (0m, 50m)"
        )
    return Level(PRESSURE if pressure else DEPTH if found[3] else HEIGHT, value)


def level_mismatch(flown: str, known: str) -> str:
    """A message if a wind at level ``known`` does not apply to a robot at ``flown``; empty if it does.

    Raises
    ------
    ConfigError
        If one is in the water and the other in the air.

    Examples
    --------
    >>> level_mismatch("100m", "80m"), level_mismatch("925hPa", "10m")
    ('', 'the robot flies at 925 hPa (robot.level), and the wind used is 10 m above ground')
    """
    robot, wind = parse_level(flown), parse_level(known)
    if (robot.kind == DEPTH) != (wind.kind == DEPTH):
        raise ConfigError(
            f"robot.level={flown} is {'a depth' if robot.kind == DEPTH else 'in the air'}, and what is known "
            f"is {'a wind' if robot.kind == DEPTH else 'a current'} {wind.phrase}: set wind=currents for a "
            "robot in the water, another source for one in the air, or robot.level"
        )
    if robot.kind == wind.kind and abs(robot.value - wind.value) <= ALIKE * max(robot.value, wind.value):
        return ""
    medium = medium_of(robot.text)
    return (
        f"the robot {medium.moves} {robot.phrase} (robot.level), and the {medium.flow} used is {wind.phrase}"
    )


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
