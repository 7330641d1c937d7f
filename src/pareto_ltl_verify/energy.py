"""Power of a robot at an airspeed, from the settings alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

Power = Callable[[float], float]


def power_law(settings: Mapping[str, Any]) -> Power | None:
    """Power [W] at an airspeed [m/s]; None without a power curve."""
    kind = settings.get("kind", "none")
    if kind == "none":
        return None
    return lambda v: float(settings["base"] + LAWS[kind](settings, v))


def energy_limits(settings: Mapping[str, Any]) -> dict[str, Any]:
    """``power`` [W] at an airspeed and ``capacity`` [J]; None where there is no curve or no limit."""
    power, hours = power_law(settings), settings.get("capacity")
    return {"power": power, "capacity": None if hours is None or power is None else 3600.0 * hours}


def _body(settings: Mapping[str, Any], v: float) -> float:
    return float(settings["drag"] * v**3)


def _wing(settings: Mapping[str, Any], v: float) -> float:
    return float(settings["drag"] * v**3 + settings["lift"] / v)


def _rotor(settings: Mapping[str, Any], v: float) -> float:
    induced = math.sqrt(1 + v**4 / (4 * settings["wake"] ** 4)) - v**2 / (2 * settings["wake"] ** 2)
    profile = settings["blade"] * (1 + 3 * v**2 / settings["tip"] ** 2)
    return float(profile + settings["lifting"] * math.sqrt(max(induced, 0.0)) + settings["drag"] * v**3)


def _table(settings: Mapping[str, Any], v: float) -> float:
    for (low, before), (high, after) in pairwise(settings["points"]):
        if low <= v <= high:
            return float(before + (after - before) * (v - low) / (high - low))
    return float(settings["points"][0 if v < settings["points"][0][0] else -1][1])


LAWS = {"body": _body, "wing": _wing, "rotor": _rotor, "table": _table}
