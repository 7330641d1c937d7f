"""The height of a flight and the air there, by the checker's own road.

The pressure of the standard atmosphere is integrated here: dp/dh = -g p / (R T(h)), with the temperature that
ISO 2533 gives at its nodes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

FOOT = 0.3048  # [m]
CONSTANT = 9.80665 / 287.05287  # [K/m] g / R of dry air
SEA_LEVEL = 101_325.0, 288.15  # [Pa], [K]
NODES = (-2_000.0, 11_000.0, 20_000.0, 32_000.0)  # [m] ...
WARMTH = (301.15, 216.65, 216.65, 228.65)  # ... and the temperature there [K]
HEIGHTS = np.arange(-2_000.0, 32_001.0, 1.0)
_slopes = CONSTANT / np.interp(HEIGHTS, NODES, WARMTH)
_fallen = np.concatenate([[0.0], np.cumsum(0.5 * (_slopes[1:] + _slopes[:-1]))])
LOG_PRESSURES = math.log(SEA_LEVEL[0]) - (_fallen - np.interp(0.0, HEIGHTS, _fallen))


class Flight(NamedTuple):
    """Metres of a height, whether above mean sea level, and the pressure of its level [Pa], if it is one."""

    metres: float
    above_sea: bool
    pressure: float | None = None


def pressure_at(metres: float) -> float:
    """Pressure [Pa] of the standard atmosphere at a height above mean sea level [m]."""
    return float(np.exp(np.interp(metres, HEIGHTS, LOG_PRESSURES)))


def height_of(pressure: float) -> float:
    """Height [m] above mean sea level of a pressure [Pa] in the standard atmosphere."""
    return float(np.interp(-math.log(pressure), -LOG_PRESSURES, HEIGHTS))


def temperature_at(metres: float) -> float:
    """Temperature [K] of the standard atmosphere at a height above mean sea level [m]."""
    return float(np.interp(metres, NODES, WARMTH))


def level_flight(text: str) -> Flight:
    """The height that a level names: 100m, 300m amsl, 925hPa, FL45, 30m depth; ValueError for others."""
    found = re.fullmatch(r"(?:fl)?\s*([\d.]+)\s*([a-z]*)\s*([a-z]*)", text.strip().lower())
    if found is None:
        raise ValueError(f"{text!r} is no level")
    value, unit, side = float(found[1]), found[2], found[3]
    if text.strip().lower().startswith("fl"):
        unit, value = "pa", float(round(pressure_at(100.0 * FOOT * value), -1))
    factors = {"pa": 1.0, "hpa": 100.0, "mb": 100.0, "mbar": 100.0}
    if unit in factors:
        return Flight(height_of(value * factors[unit]), True, value * factors[unit])
    metres = value * {"m": 1.0, "km": 1000.0, "ft": FOOT}[unit]
    return Flight(-metres if side == "depth" else metres, side in ("amsl", "msl"))


def stated_level(settings: Mapping[str, Any]) -> str:
    """The level of the flight as text, by the first setting that states it; else empty."""
    level, drawn = settings["robot"].get("level"), settings["scene"].get("altitude")
    if level or drawn is None:
        exported = settings["exports"].get("altitude")
        return level or ("" if exported is None else _signed(exported, ""))
    return _signed(drawn, " amsl")


def _signed(metres: float, above: str) -> str:
    return f"{abs(metres):.10g}m{' depth' if metres < 0.0 else above}"


def stated_flights(settings: Mapping[str, Any]) -> list[Flight]:
    """The height as each setting states it; nothing where none does."""
    level, exported = settings["robot"].get("level"), settings["exports"].get("altitude")
    drawn = settings["scene"].get("altitude")
    found = [level_flight(level)] if level else []
    if drawn is not None:
        found.append(Flight(drawn, found[0].above_sea if found else drawn >= 0.0))
    if exported is not None:
        found.append(Flight(exported, False))
    return found


def agree(one: Flight, other: Flight, ground: float) -> bool:
    """Whether two statements are one height, to 1 % or 1 m; ``ground`` [m] is above mean sea level."""
    shift = 0.0
    if one.above_sea != other.above_sea and other.metres >= 0.0:
        shift = ground if one.above_sea else -ground
    gap = abs(one.metres - other.metres - shift)
    return gap <= max(1.0, 0.01 * max(abs(one.metres), abs(other.metres + shift)))
