"""Lengths and heights with units, as map files state them: ``5 km``, ``0.5 NM``, ``500 ft AMSL``, ``FL95``.

A number without a unit is in metres. A height has a datum: ``AMSL`` (mean sea level), ``AGL`` (ground),
``FL`` (flight level: the height in the standard atmosphere, 100 ft each), or none: the datum of the map.
"""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

from careful_io.errors import DataError
from careful_io.messages import shown_value
from flight_quantities.levels import FOOT

NAUTICAL_MILE = 1852.0  # [m]
MAX_METRES = 1e7  # largest length or height

_UNITS = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters", "mtr"), 1.0),
    **dict.fromkeys(("km", "kilometre", "kilometres", "kilometer", "kilometers"), 1000.0),
    **dict.fromkeys(("ft", "feet", "foot", "'"), FOOT),
    **dict.fromkeys(("nm", "nmi", "nautical mile", "nautical miles"), NAUTICAL_MILE),
    **dict.fromkeys(("mi", "sm", "mile", "miles", "statute mile", "statute miles"), 1609.344),
    **dict.fromkeys(("yd", "yard", "yards"), 0.9144),
}
_DATUMS = {
    **dict.fromkeys(("amsl", "msl", "asl", "alt", "qnh", "wgs84"), "AMSL"),
    **dict.fromkeys(("agl", "gnd", "sfc", "asfc", "agnd", "above ground"), "AGL"),
    **dict.fromkeys(("std", "qne"), "FL"),
}
_GROUND = ("gnd", "sfc", "ground", "surface", "gnd/sea", "agl", "sfc agl", "gnd agl")
_UNLIMITED = ("unl", "unlim", "unltd", "unlimited", "inf", "none", "unl std")
_NUMBER = r"(?P<number>[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?)"
_LENGTH = re.compile(rf"{_NUMBER}\s*(?P<unit>'|[a-z]+(?: [a-z]+)?)?")
_HEIGHT = re.compile(
    rf"(?P<above>above\s+)?{_NUMBER}\s*(?P<unit>'|{'|'.join(sorted(_UNITS, key=len, reverse=True))})?\s*"
    rf"(?P<datum>{'|'.join(_DATUMS)})?"
)
_FLIGHT_LEVEL = re.compile(r"(?:flight level|fl)\s*(\d{1,3})(?:\s*std)?")

LENGTHS = "expected a number of metres, or a length such as '5 km', '3 NM' or '500 ft'"
HEIGHTS = (
    "expected a number of metres, or a height such as '500 ft AMSL', '120 m AGL', 'FL95', 'GND' or 'UNL'"
)


class Height(NamedTuple):
    """A height [m], infinite for no limit, and its datum: ``AMSL``, ``AGL``, ``FL`` or empty."""

    metres: float
    datum: str = ""


LOWEST, HIGHEST = Height(-math.inf), Height(math.inf)


def length_in_metres(what: str, value: Any) -> float | None:
    """The length ``value`` [m], a number or a text; None if it is missing.

    Raises
    ------
    DataError
        If it is no length; ``what`` begins the message.
    """
    if value is None or value == "":
        return None
    number = _plain_number(value)
    if number is None and isinstance(value, str) and (match := _LENGTH.fullmatch(_simple(value))):
        number = float(match["number"]) * _UNITS.get(match["unit"] or "m", math.nan)
    if number is None or not abs(number) <= MAX_METRES:
        raise DataError(f"{what} is {shown_value(value)}; {LENGTHS}")
    return number


def height(what: str, value: Any, unit: str = "m") -> Height | None:
    """The height ``value``, a number in ``unit`` or a text; None if it is missing.

    ``above 400 ft`` is the lowest height above 400 ft.

    Raises
    ------
    DataError
        If it is no height; ``what`` begins the message.
    """
    if value is None or value == "":
        return None
    found = _height_of(value, unit)
    if found is None or not (abs(found.metres) <= MAX_METRES or math.isinf(found.metres)):
        raise DataError(f"{what} is {shown_value(value)}; {HEIGHTS}")
    return found


def _height_of(value: Any, unit: str) -> Height | None:
    if (number := _plain_number(value)) is not None:
        return Height(number * _UNITS[unit]) if math.isfinite(number) else None
    if not isinstance(value, str):
        return None
    text = _simple(value)
    if text in _GROUND:
        return Height(0.0, "AGL")
    if text in _UNLIMITED:
        return Height(math.inf)
    if text in ("msl", "amsl", "sea level"):
        return Height(0.0, "AMSL")
    if level := _FLIGHT_LEVEL.fullmatch(text):
        return Height(100.0 * FOOT * int(level[1]), "FL")
    match = _HEIGHT.fullmatch(text)
    if match is None:
        return None
    metres = float(match["number"]) * _UNITS[match["unit"] or unit]
    if match["above"]:
        metres = math.nextafter(metres, math.inf)
    return Height(metres, _DATUMS[match["datum"]] if match["datum"] else "")


def _plain_number(value: Any) -> float | None:
    """``value`` as a number without a unit; None if it is another kind of value or text."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return float(value)
    except (ValueError, OverflowError):
        return None


def _simple(text: str) -> str:
    return " ".join(text.lower().replace("_", " ").replace("(", " ").replace(")", " ").split())
