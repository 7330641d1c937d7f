"""Levels in the words of settings: which level a wind has, and whether a robot flies there."""

from __future__ import annotations

from collections.abc import Collection

from careful_io.messages import shown_text
from flight_quantities.levels import DEPTH, HEIGHT, Level, parse_level, same_wind
from flight_quantities.medium import medium_of
from pareto_ltl.support.errors import ConfigError


def wind_level(text: str, key: str = "wind.level") -> Level:
    """The level that the setting ``key`` states; ConfigError if it is not a level."""
    return parse_level("10m" if text == "auto" else text, key)  # settings of a run have replaced auto already


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
    robot, wind = wind_level(flown), wind_level(known)
    if (robot.kind == DEPTH) != (wind.kind == DEPTH):
        raise ConfigError(
            f"robot.level={flown} is {'a depth' if robot.kind == DEPTH else 'in the air'}, and what is known "
            f"is {'a wind' if robot.kind == DEPTH else 'a current'} {wind.phrase}: set wind=currents for a "
            "robot in the water, another source for one in the air, or robot.level"
        )
    if same_wind(robot, wind):
        return ""
    medium = medium_of(robot.text)
    return f"the robot {medium.moves} {robot.phrase}, and the {medium.flow} used is {wind.phrase}"


def table_level(text: str, kinds: Collection[str], holds: str) -> Level:
    """The level of a table, which only ``wind.level`` states; ``holds`` says what the table has.

    ConfigError if the kind of the level is not in ``kinds``, or if the height is 0.
    """
    level = wind_level(text)
    if level.kind not in kinds or (level.kind == HEIGHT and level.value == 0):
        others = " or a pressure (925hPa), for a current a depth ('50m depth')" if DEPTH in kinds else ""
        raise ConfigError(
            f"wind.level={shown_text(text)} is {level.phrase}; {holds}: expected a height above ground such "
            f"as 10m{others}"
        )
    return level
