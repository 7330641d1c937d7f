"""Geofences of ground stations as GeoJSON features: QGroundControl plans, and waypoint files (QGC WPL 110).

Areas of inclusion are the border, areas of exclusion are obstacles. Waypoints of a mission are not read.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from careful_io.messages import shown_text
from pareto_ltl.extend import Unread
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.map_file import MapFile

CORNERS = 64  # of the polygon in a circle of inclusion; it lacks 0.2 % of the area
FENCES = {5001: "border", 5002: "obstacle", 5003: "border", 5004: "obstacle"}  # MAV_CMD_NAV_FENCE_...
POLYGONS, RETURN_POINT, COLUMNS = (5001, 5002), 5000, 12
PLAN_KIND, WAYPOINT_KIND = (
    "a QGroundControl plan",
    "a waypoint file (QGC WPL) of Mission Planner or QGroundControl",
)


def is_plan(data: Any) -> bool:
    """Whether ``data`` is a plan of QGroundControl."""
    return isinstance(data, dict) and (
        data.get("fileType") == "Plan" or data.get("groundStation") == "QGroundControl"
    )


def read_plan(where: str, data: Mapping[str, Any]) -> MapFile:
    """The geofence of a QGroundControl plan."""
    fence, features, unread, faults = data.get("geoFence"), list[dict[str, Any]](), Unread(), list[str]()
    for key, kind in (("polygons", "polygon"), ("circles", "circle")):
        for number, item in enumerate(_items(fence, key), 1):
            what = f"{where}: {kind} {number} of the geofence"
            try:
                features.append(_plan_feature(what, kind, item))
            except (TypeError, ValueError, KeyError, AttributeError):
                faults.append(f"{what} is not as QGroundControl writes it")
    mission = data.get("mission")
    if items := len(_items(mission, "items")):
        unread.passed[f"{items} mission items: draw what the mission visits as regions"] += 1
    if isinstance(mission, dict) and mission.get("plannedHomePosition"):
        unread.passed["plannedHomePosition: draw the start in the map"] += 1
    if len(_items(data.get("rallyPoints"), "points")):
        unread.passed["rally points"] += 1
    return MapFile(where, PLAN_KIND, features, unread=unread, faults=tuple(faults))


def _items(part: Any, key: str) -> list[Any]:
    found = part.get(key) if isinstance(part, dict) else None
    return found if isinstance(found, list) else []


def _plan_feature(what: str, kind: str, item: Any) -> dict[str, Any]:
    inside = bool(item.get("inclusion", True))
    if kind == "polygon":
        return _polygon([(float(lon), float(lat)) for lat, lon in (c[:2] for c in item["polygon"])], inside)
    lat, lon = item["circle"]["center"][:2]
    return _circle(what, float(lon), float(lat), float(item["circle"]["radius"]), inside)


def _polygon(corners: Sequence[tuple[float, float]], inside: bool) -> dict[str, Any]:
    outline = [list(corner) for corner in corners]
    return _feature({"type": "Polygon", "coordinates": [[*outline, *outline[:1]]]}, inside, {})


def _circle(what: str, lon: float, lat: float, radius: float, inside: bool) -> dict[str, Any]:
    if not 0 < radius < 1e7 or not abs(lat) <= 90 or not abs(lon) <= 360:
        raise DataError(f"{what} has the radius {radius:g} m at {lat:g}, {lon:g}; that is no circle on Earth")
    if not inside:
        return _feature({"type": "Point", "coordinates": [lon, lat]}, inside, {"buffer": radius})
    import pyproj

    turns = [360.0 * k / CORNERS for k in range(CORNERS)]
    east, north, _ = pyproj.Geod(ellps="WGS84").fwd(
        [lon] * CORNERS, [lat] * CORNERS, turns, [radius] * CORNERS
    )
    return _polygon(list(zip(map(float, east), map(float, north), strict=True)), inside)


def _feature(geometry: dict[str, Any], inside: bool, more: Mapping[str, Any]) -> dict[str, Any]:
    properties = {"role": "border" if inside else "obstacle", **({} if inside else {"name": "fence"}), **more}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


# --- waypoint files -------------------------------------------------------------------------------------


def is_waypoints(text: str) -> bool:
    """Whether ``text`` is a file of waypoints or of a fence."""
    return text.lstrip().startswith("QGC WPL")


def read_waypoints(where: str, text: str) -> MapFile:
    """The fence in a file of waypoints; DataError for a line that is no item."""
    features, unread, missions = list[dict[str, Any]](), Unread(), 0
    corners: list[tuple[float, float]] = []
    for number, line in enumerate(text.strip().splitlines()[1:], 2):
        if not line.strip():
            continue
        what = f"{where}: line {number}"
        command, values, lat, lon = _item(what, line)
        if command in POLYGONS:
            corners.append((lon, lat))
            if len(corners) >= max(3, values[0]):
                features.append(_polygon(corners, FENCES[command] == "border"))
                corners = []
        elif command in FENCES:
            features.append(_circle(what, lon, lat, values[0], FENCES[command] == "border"))
        elif command != RETURN_POINT:
            missions += 1
    if corners:
        unread.lost[f"a polygon of {len(corners)} corners, which is not complete"] += 1
    if missions:
        unread.passed[f"{missions} waypoints: draw what the mission visits as regions"] += 1
    return MapFile(where, WAYPOINT_KIND, features, unread=unread)


def _item(what: str, line: str) -> tuple[int, list[float], float, float]:
    """Command, four parameters, latitude and longitude of a line."""
    parts = line.split()
    try:
        numbers = [float(part) for part in parts]
        command = int(numbers[3])
    except (ValueError, IndexError, OverflowError):
        numbers, command = [], 0
    if len(numbers) != COLUMNS or not all(map(math.isfinite, numbers)):
        raise DataError(f"{what} is {shown_text(line)!r}; expected {COLUMNS} numbers, as in QGC WPL 110")
    return command, numbers[4:8], numbers[8], numbers[9]
