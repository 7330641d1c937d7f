"""Airspace with limits in several dialects of JSON, as features with ``floor`` and ``ceiling``.

- OpenAIP: ``lowerLimit`` and ``upperLimit`` with value, unit and datum as numbers (docs.openaip.net);
- ED-269 (EUROCAE) zones for drones, whose ``geometry`` is a list of volumes; ED-318, its successor;
- FAA airspace: ``LOWER_VAL``, ``LOWER_UOM``, ``LOWER_CODE`` and the same with ``UPPER``;
- FAA UAS facility maps: ``CEILING`` [``UNIT``] is the height above ground up to which flight is permitted, so
  the obstacle begins there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeVar

from careful_io.messages import shown_text, shown_value
from flight_quantities.lengths import Height
from flight_quantities.levels import FOOT
from pareto_ltl.extend import Unread
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.map_file import MapFile
from pareto_ltl_apps.formats.map_openair import limit_text

Value = TypeVar("Value")
OPENAIP_UNITS = {0: 1.0, 1: FOOT, 6: 100.0 * FOOT}  # metre, foot, flight level
OPENAIP_DATUMS = {0: "AGL", 1: "AMSL", 2: "FL"}
UNITS = {"M": 1.0, "MT": 1.0, "METERS": 1.0, "FT": FOOT, "FEET": FOOT, "FL": 100.0 * FOOT}
DATUMS = {
    "AGL": "AGL",
    "SFC": "AGL",
    "GND": "AGL",
    "MSL": "AMSL",
    "AMSL": "AMSL",
    "WGS84": "AMSL",
    "STD": "FL",
}
UNKNOWN = -9000.0  # values below are codes of "unknown" in FAA files
FAA_KEYS = ("APT1_ICAO", "APT1_FAAID", "APT1_NAME", "APT1_LAANC", "ARPT_COUNT", "MAP_EFF", "AIRSPACE_1")


def with_limits(where: str, what: str, feature: Mapping[str, Any]) -> dict[str, Any]:
    """``feature`` with ``floor`` and ``ceiling`` if it is airspace, then with the member ``airspace``.

    Any other feature is returned as it is. DataError if ``CEILING`` may be the end of an obstacle or the
    height up to which flight is permitted.
    """
    properties, geometry = feature.get("properties"), feature.get("geometry")
    if not isinstance(properties, dict):
        return dict(feature)
    if isinstance(properties.get("lowerLimit"), dict) or isinstance(properties.get("upperLimit"), dict):
        limits = {
            "floor": _openaip_limit(properties.get("lowerLimit"), "GND"),
            "ceiling": _openaip_limit(properties.get("upperLimit"), "UNL"),
        }
        return _airspace(feature, "OpenAIP", limits)
    if isinstance(geometry, dict) and isinstance(layer := geometry.get("layer"), dict):
        shape, more = _extent(geometry)
        return _airspace(
            {**feature, "geometry": shape},
            "ED-318",
            _volume_limits(layer, "lower", "upper", "Reference") | more,
        )
    if "UPPER_VAL" in properties or "LOWER_VAL" in properties:
        limits = {
            "floor": _faa_limit(properties, "LOWER", "GND"),
            "ceiling": _faa_limit(properties, "UPPER", "UNL"),
        }
        return _airspace(feature, "FAA airspace", limits)
    return _facility(where, what, feature, properties)


def _airspace(feature: Mapping[str, Any], kind: str, limits: Mapping[str, Any]) -> dict[str, Any]:
    """``feature`` with ``limits``, unless its author gives others."""
    return {**feature, "airspace": kind, "properties": {**limits, **feature["properties"]}}


def _facility(
    where: str, what: str, feature: Mapping[str, Any], properties: Mapping[str, Any]
) -> dict[str, Any]:
    """A cell of an FAA UAS facility map, which is an obstacle above its ceiling; other features unchanged."""
    simple = {str(key).strip().lower(): value for key, value in properties.items()}
    if "ceiling" not in simple or "unit" not in simple or simple.get("floor") not in (None, ""):
        return dict(feature)
    own = [key for key in properties if key in (*FAA_KEYS, "CEILING")]
    if not own:
        value, unit = shown_value(simple["ceiling"]), shown_text(str(simple["unit"]))
        raise DataError(
            f"{where}: {what}: ceiling is {value} with unit {unit}: if flight is permitted up to it, as in "
            "FAA facility maps, write it as floor, with its unit; if the obstacle ends there, write the unit "
            "into ceiling, e.g. '400 ft AGL'"
        )
    factor = UNITS.get(str(simple["unit"]).strip().upper())
    try:
        permitted = float(simple["ceiling"])
    except (TypeError, ValueError):
        permitted = math.nan
    if factor is None or not 0 <= permitted < 1e6:
        raise DataError(
            f"{where}: {what}: CEILING is {shown_value(simple['ceiling'])} "
            f"{shown_text(str(simple['unit']))}; expected a number of feet"
        )
    rest = {key: value for key, value in properties.items() if key.strip().lower() not in ("ceiling", "unit")}
    floor = f"above {limit_text(Height(permitted * factor, 'AGL'))}" if permitted else "GND"
    return {**feature, "airspace": "FAA facility map", "properties": {**rest, "floor": floor}}


def _extent(geometry: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """A geometry of ED-318 without its own members, and the buffer of a circle."""
    shape = {key: geometry.get(key) for key in ("type", "coordinates", "geometries") if key in geometry}
    extent = geometry.get("extent")
    if isinstance(extent, dict) and isinstance(radius := extent.get("radius"), int | float):
        return shape, {"buffer": radius}
    return shape, {}


def _entry(table: Mapping[int, Value], key: Any, missing: Value) -> Value:
    """The entry of ``table`` for a number; ``missing`` for other numbers and other values."""
    return table.get(key, missing) if isinstance(key, int) else missing


def _openaip_limit(limit: Any, missing: str) -> str:
    if not isinstance(limit, dict):
        return missing
    value, unit = limit.get("value"), _entry(OPENAIP_UNITS, limit.get("unit", 1), math.nan)
    return _limit(value, unit, _entry(OPENAIP_DATUMS, limit.get("referenceDatum", 1), ""), missing)


def _faa_limit(properties: Mapping[str, Any], side: str, missing: str) -> str:
    unit = str(properties.get(f"{side}_UOM", "FT") or "FT").upper()
    datum = (
        "FL" if unit == "FL" else DATUMS.get(str(properties.get(f"{side}_CODE", "MSL") or "MSL").upper(), "")
    )
    return _limit(properties.get(f"{side}_VAL"), UNITS.get(unit, math.nan), datum, missing)


def _volume_limits(volume: Mapping[str, Any], lower: str, upper: str, reference: str) -> dict[str, Any]:
    """Floor and ceiling of a volume of ED-269 or ED-318."""
    unit = UNITS.get(str(volume.get("uomDimensions", volume.get("uom", "M"))).upper(), math.nan)

    def limit(side: str, missing: str) -> str:
        key = f"{side}{reference}" if reference == "Reference" else f"{side.removesuffix('Limit')}{reference}"
        return _limit(volume.get(side), unit, DATUMS.get(str(volume.get(key, "AGL")).upper(), ""), missing)

    return {"floor": limit(lower, "GND"), "ceiling": limit(upper, "UNL")}


def _limit(value: Any, unit: float, datum: str, missing: str) -> str:
    """The text of a limit; ``missing`` for a value that is none, which is on the careful side."""
    try:
        metres = math.nan if isinstance(value, bool) else float(value) * unit
    except (TypeError, ValueError, OverflowError):
        return missing
    if not math.isfinite(metres) or float(value) < UNKNOWN or abs(metres) > 1e6:
        return missing
    return limit_text(Height(metres, datum)) if metres or datum != "AGL" or missing == "UNL" else "GND"


# --- files ------------------------------------------------------------------------------------------------


def is_openaip(items: Any) -> bool:
    """Whether ``items`` is a list of airspaces as the interface of OpenAIP delivers them."""
    return (
        isinstance(items, list)
        and bool(items)
        and all(isinstance(item, dict) and "geometry" in item for item in items)
    )


def read_openaip(where: str, items: list[dict[str, Any]]) -> MapFile:
    """Airspaces that are no GeoJSON features: their geometry stands among their properties."""
    features = [
        {
            "type": "Feature",
            "properties": {key: value for key, value in item.items() if key != "geometry"}
            if "properties" not in item else item["properties"],
            "geometry": item["geometry"],
        }
        for item in items
    ]  # fmt: skip
    return MapFile(where, "OpenAIP", features, None, "obstacle")


def is_ed269(data: Any) -> bool:
    """Whether ``data`` is a document of ED-269: features with a list of volumes as geometry."""
    features = data.get("features") if isinstance(data, dict) else None
    return isinstance(features, list) and any(
        isinstance(one, dict) and isinstance(one.get("geometry"), list) for one in features
    )


def read_ed269(where: str, data: Mapping[str, Any]) -> MapFile:
    """Zones of ED-269; zones without a restriction are left out."""
    found, unread, faults = list[dict[str, Any]](), Unread(), list[str]()
    for number, zone in enumerate(data["features"], 1):
        if not isinstance(zone, dict) or not isinstance(zone.get("geometry"), list):
            faults.append(f"{where}: zone {number} has no list of volumes as geometry")
            continue
        name = str(zone.get("name") or zone.get("identifier") or f"zone {number}")
        if str(zone.get("restriction", "")).upper() == "NO_RESTRICTION":
            unread.passed["a zone with the restriction NO_RESTRICTION"] += 1
            continue
        known = {key: zone[key] for key in ("identifier", "country", "type", "restriction") if key in zone}
        properties = {"name": name, **known, **_times(zone.get("applicability"), unread)}
        for volume in zone["geometry"]:
            try:
                found.append(_zone(where, name, properties, volume))
            except DataError as error:
                faults.append(str(error))
    return MapFile(where, "ED-269", found, None, "obstacle", unread=unread, faults=tuple(faults))


def _zone(where: str, name: str, properties: Mapping[str, Any], volume: Any) -> dict[str, Any]:
    flat = volume.get("horizontalProjection") if isinstance(volume, dict) else None
    if not isinstance(flat, dict):
        raise DataError(f"{where}: zone {shown_text(name)!r} has a volume without horizontalProjection")
    limits: dict[str, Any] = _volume_limits(volume, "lowerLimit", "upperLimit", "VerticalReference")
    geometry = {"type": flat.get("type"), "coordinates": flat.get("coordinates")}
    if str(flat.get("type")).lower() == "circle":
        unit = UNITS.get(str(volume.get("uomDimensions", "M")).upper(), 1.0)
        radius = flat.get("radius")
        if isinstance(radius, bool) or not isinstance(radius, int | float):
            raise DataError(f"{where}: zone {shown_text(name)!r} has a circle without a radius")
        geometry, limits["buffer"] = {"type": "Point", "coordinates": flat.get("center")}, radius * unit
    return {"type": "Feature", "properties": {**properties, **limits}, "geometry": geometry}


def _times(periods: Any, unread: Unread) -> dict[str, Any]:
    """``from`` and ``until`` of a zone: the span of its periods; none if one of them has no end."""
    known = [period for period in periods if isinstance(period, dict)] if isinstance(periods, list) else []
    if any(period.get("schedule") for period in known):
        unread.passed["a daily schedule: the zone is active all day"] += 1
    ends = [(p.get("startDateTime"), p.get("endDateTime")) for p in known if p.get("permanent") != "YES"]
    if not ends or len(ends) < len(known):
        return {}
    begins, stops = ([end[k] for end in ends] for k in (0, 1))
    return {
        key: pick(map(str, times))
        for key, times, pick in (("from", begins, min), ("until", stops, max))
        if all(isinstance(time, str) for time in times)
    }
