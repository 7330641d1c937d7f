"""Claims about the height of the flight: one height everywhere, and the airspeeds that belong to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, no_fault, unlike
from pareto_ltl_verify.claims.exports import GPX, KML, unlike_at, xml_root
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.heights import (
    CONSTANT,
    Flight,
    agree,
    level_flight,
    pressure_at,
    stated_flights,
    temperature_at,
)

METRES = 0.06  # [m] files state heights to 0.1 m
NEAR = 500.0  # [m] from the flight, within which the air of the wind file counts
AIR = 1e-4  # largest allowed relative difference of pressures and temperatures
ZERO_CELSIUS = 273.15  # [K]
WAYPOINTS = (16, 17, 22)  # MAV_CMD of items with a place
GROUND_FRAME, SEA_FRAME = 3, 0  # MAV_FRAME_GLOBAL_RELATIVE_ALT, MAV_FRAME_GLOBAL


def flown(result: Evidence) -> Flight:
    """The height of the flight by the settings: the first that states it, else the level of the wind."""
    stated = stated_flights(result.settings)
    return stated[0] if stated else level_flight(result.settings["wind"]["level"])


def _ground(result: Evidence) -> float:
    """Height of the ground above mean sea level [m]; 0 where it is not known."""
    return float(result.settings["scene"].get("ground") or 0.0)


def one_height(result: Evidence) -> Verdict:
    """All settings that state a height agree with each other, plan.json and the places left out."""
    height, reported = flown(result), result.plan.get("height")
    if reported is None:
        return no_fault("no height", ["plan.json states no height"])
    stated = stated_flights(result.settings)
    others = [other for other in stated[1:] if not agree(height, other, _ground(result))]
    faults = [f"settings state {other.metres:g} m" for other in others]
    faults += unlike(reported, {"above_sea": height.above_sea, "stated": bool(stated)})
    faults += [] if close(reported["metres"], height.metres, 1e-6, METRES) else [f"{reported['metres']:g} m"]
    for place in result.scene.get("absent", ()):
        floor = -math.inf if place.get("floor") is None else place["floor"]
        ceiling = math.inf if place.get("ceiling") is None else place["ceiling"]
        faults += [f"{place['what']} is left out"] * bool(not stated or floor <= height.metres <= ceiling)
    return no_fault(f"{reported['metres']:.6g} m", faults)


def airspeeds(result: Evidence) -> Verdict | None:
    """Pressure and temperature are those at the height; calibrated airspeeds follow from them."""
    plan, air, height = result.plan, result.plan.get("air"), flown(result)
    if height.metres < 0.0 or result.wind.level.endswith("depth") or "height" not in plan:
        return None if air is None else no_fault("air", ["air in the water, or without a height"])
    if air is None or "airspeed_calibrated" not in plan:
        return no_fault("no air", ["plan.json has no calibrated airspeeds"])
    metres = height.metres + (0.0 if height.above_sea else _ground(result))
    celsius = result.settings["robot"].get("air_temperature")
    warmth, there = _of_the_wind(result, height, metres)
    pressure = there if height.pressure is None else height.pressure
    temperature = warmth if celsius is None else celsius + ZERO_CELSIUS
    ratio = pressure / temperature * 288.15 / 101_325.0
    wanted = {"pressure": pressure, "temperature": temperature, "density_ratio": ratio}
    faults = [f"{key} {air[key]:.6g}" for key, value in wanted.items() if not close(air[key], value, AIR)]
    speed = np.hypot(*result.u.T)
    faults += unlike_at("leg {}: airspeed_calibrated", plan["airspeed_calibrated"], speed * math.sqrt(ratio))
    return no_fault(f"density ratio {air['density_ratio']:.5g}", faults)


def _of_the_wind(result: Evidence, height: Flight, metres: float) -> tuple[float, float]:
    """Temperature [K] and pressure [Pa] at ``metres`` above the sea, by wind.nc where they are near enough.

    A temperature keeps its difference from the standard atmosphere. A pressure falls off in air of one
    temperature; if the height counts from the sea, the ground must be known.
    """
    air, standard = result.wind.air, (temperature_at(metres), pressure_at(metres))
    if air is None:
        return standard
    moments = np.array(result.plan["t"], float)
    warmth, pressure = (
        float(np.mean(_linear(moments, air.times, row))) for row in (air.temperature, air.pressure)
    )
    places = [level_flight(level) for level in (air.level, air.pressure_level)]
    ground, known = _ground(result), result.settings["scene"].get("ground") is not None
    heights = [place.metres + (0.0 if place.above_sea else ground) for place in places]
    near = [abs(metres - there) <= NEAR for there in heights]
    falls = (known or not height.above_sea) and near[1] and math.isfinite(pressure)
    return (
        standard[0] + warmth - temperature_at(heights[0]) if near[0] else standard[0],
        pressure * math.exp(-CONSTANT * (metres - heights[1]) / warmth) if falls else standard[1],
    )


def _linear(at: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    """Values at ``at`` between ``times``, held before the first one and after the last one."""
    if len(times) == 1:
        return np.full(len(at), values[0])
    k = np.clip(np.searchsorted(times, at) - 1, 0, len(times) - 2)
    share = np.clip((at - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0)
    return np.asarray((1.0 - share) * values[k] + share * values[k + 1], float)


def exported(name: str, result: Evidence) -> Verdict:
    """Every height in an exported file agrees with plan.json, counted from the same place."""
    metres, above_sea = result.plan["height"]["metres"], result.plan["height"]["above_sea"]
    found = HEIGHTS[name](result)
    of_sea = above_sea or metres < 0.0
    faults = [f"{value:g} m" for value, _ in found if not abs(value - metres) <= METRES]
    counted = above_sea if name == "mission.plan" else of_sea
    faults += ["counted from another place" for _, sea in found if sea != counted]
    if name == "plan.gpx" and not of_sea:
        faults = [f"{value:g} m above the sea" for value, _ in found]
    return no_fault(f"{len(found)} heights", faults)


def _mission(result: Evidence) -> list[tuple[float, bool | None]]:
    items = result.document("mission.plan")["mission"]["items"]
    placed = [item for item in items if item["command"] in WAYPOINTS]
    return [(float(value), _sea(item)) for item in placed for value in (item["params"][6], item["Altitude"])]


def _sea(item: dict[str, Any]) -> bool | None:
    """Whether an item counts from the sea; None if its frame and its mode differ."""
    modes = {(SEA_FRAME, 2): True, (GROUND_FRAME, 1): False}
    return modes.get((item["frame"], item["AltitudeMode"]))


def _kml(result: Evidence) -> list[tuple[float, bool]]:
    root, found = xml_root(result, "plan.kml"), []
    for kind in ("Point", "LineString"):
        for shape in root.findall(f".//{kind}", KML):
            sea = shape.findtext("altitudeMode", None, KML) == "absolute"
            texts = str(shape.findtext("coordinates", "", KML)).split()
            found += [(float(text.split(",")[2]), sea) for text in texts if text.count(",") == 2]
    return found


def _gpx(result: Evidence) -> list[tuple[float, bool]]:
    root = xml_root(result, "plan.gpx")
    texts = [point.findtext("ele", None, GPX) for point in root.findall(".//rtept", GPX)]
    return [(float(text), True) for text in texts if text is not None]


FILES = ("plan.json", "scene.json")
HEIGHTS: dict[str, Callable[[Evidence], Sequence[tuple[float, bool | None]]]] = {
    "mission.plan": _mission, "plan.kml": _kml, "plan.gpx": _gpx,
}  # fmt: skip
CLAIMS: tuple[Claim, ...] = (
    Claim("height: one for all", FILES, one_height),
    Claim("height: air and calibrated airspeeds", (*FILES, "wind.nc"), airspeeds),
    *(Claim(f"height: {name}", (name, *FILES), partial(exported, name)) for name in HEIGHTS),
)
