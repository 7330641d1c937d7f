"""Power of a robot at an airspeed, from the settings alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

Power = Callable[[float], float]


def power_law(told: Mapping[str, Any]) -> Power | None:
    """Power [W] at an airspeed [m/s]; None without a power curve."""
    kind = told.get("kind", "none")
    if kind == "none":
        return None
    return lambda v: float(told["base"] + LAWS[kind](told, v))


def energy_limits(told: Mapping[str, Any]) -> dict[str, Any]:
    """``power`` [W] at an airspeed and ``capacity`` [J]; None where there is no curve or no limit."""
    power, hours = power_law(told), told.get("capacity")
    return {"power": power, "capacity": None if hours is None or power is None else 3600.0 * hours}


def _body(told: Mapping[str, Any], v: float) -> float:
    return float(told["drag"] * v**3)


def _wing(told: Mapping[str, Any], v: float) -> float:
    return float(told["drag"] * v**3 + told["lift"] / v)


def _rotor(told: Mapping[str, Any], v: float) -> float:
    induced = math.sqrt(1 + v**4 / (4 * told["wake"] ** 4)) - v**2 / (2 * told["wake"] ** 2)
    profile = told["blade"] * (1 + 3 * v**2 / told["tip"] ** 2)
    return float(profile + told["lifting"] * math.sqrt(max(induced, 0.0)) + told["drag"] * v**3)


def _table(told: Mapping[str, Any], v: float) -> float:
    for (low, before), (high, after) in pairwise(told["points"]):
        if low <= v <= high:
            return float(before + (after - before) * (v - low) / (high - low))
    return float(told["points"][0 if v < told["points"][0][0] else -1][1])


LAWS = {"body": _body, "wing": _wing, "rotor": _rotor, "table": _table}
