"""False lines, areas and names in exported files, each lie in one file or in all that draw the same."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lies.editing import Lie, both, in_json, in_text

GEOJSON, KML = "exports: shapes of plan.geojson", "exports: shapes of plan.kml"
AREAS, FENCES, ITEMS = (
    "exports: areas of corridors",
    "exports: fences of mission.plan",
    "exports: items of mission.plan",
)
WAYPOINT = 16  # MAV_CMD


def moved_places(places: Any, degrees: float) -> Any:
    """Nested coordinates, farther east."""
    if isinstance(places[0], float | int):
        return [places[0] + degrees, *places[1:]]
    return [moved_places(place, degrees) for place in places]


def in_features(name: str, change: Callable[[list[dict[str, Any]]], Any]) -> Callable[[Path], Any]:
    """Change the features of a GeoJSON file."""
    return in_json(name, lambda content: change(content["features"]))


def of_role(features: list[dict[str, Any]], role: str) -> list[dict[str, Any]]:
    """The features of a role."""
    return [feature for feature in features if feature["properties"]["role"] == role]


def _no_obstacle(features: list[dict[str, Any]]) -> None:
    features.remove(of_role(features, "obstacle")[0])


def _moved(role: str, degrees: float = 0.3, number: int = 0) -> Callable[[list[dict[str, Any]]], None]:
    def change(features: list[dict[str, Any]]) -> None:
        shape = of_role(features, role)[number]["geometry"]
        shape["coordinates"] = moved_places(shape["coordinates"], degrees)

    return change


def _swapped_names(features: list[dict[str, Any]]) -> None:
    first, second = (one["properties"] for one in of_role(features, "region")[:2])
    first["name"], second["name"] = second["name"], first["name"]


def _property(role: str, key: str, value: Any) -> Callable[[list[dict[str, Any]]], None]:
    def change(features: list[dict[str, Any]]) -> None:
        of_role(features, role)[1]["properties"][key] = value

    return change


def _moved_corridor(meaning: str) -> Callable[[list[dict[str, Any]]], None]:
    def change(features: list[dict[str, Any]]) -> None:
        area = [one for one in features if one["properties"]["meaning"] == meaning][-1]["geometry"]
        area["coordinates"] = moved_places(area["coordinates"], 0.3)

    return change


def _in_kml(pattern: str, new: str) -> Callable[[Path], Any]:
    return in_text("plan.kml", pattern, new)


def _kml_area_moved(place: Path) -> None:
    path = place / "plan.kml"
    text = path.read_text(encoding="utf-8")
    begin = text.index("<name>obstacle 1")
    start, end = text.index("<coordinates>", begin), text.index("</coordinates>", begin)
    numbers = [word.split(",") for word in text[start + len("<coordinates>") : end].split()]
    moved = " ".join(f"{float(lon) + 0.1:.8f},{lat}" for lon, lat, *_ in numbers)
    path.write_text(text[:start] + "<coordinates>" + moved + text[end:], encoding="utf-8")


def _fence_moved(mission: dict[str, Any]) -> None:
    fence = mission["geoFence"]["polygons"][-1]
    fence["polygon"] = [[lat, lon + 0.01] for lat, lon in fence["polygon"]]


def _fence_thinned(mission: dict[str, Any]) -> None:
    """Only corners of the obstacle are left: between them an autopilot draws other lines."""
    fence = mission["geoFence"]["polygons"][-1]
    fence["polygon"] = fence["polygon"][::2]


def _flown_into(mission: dict[str, Any]) -> None:
    for fence in mission["geoFence"]["polygons"]:
        fence["inclusion"] = not fence["inclusion"]


def _more_items(mission: dict[str, Any]) -> None:
    items = mission["mission"]["items"]
    jump = dict(items[-1], command=177, params=[1, -1, 0, 0, 0, 0, 0], doJumpId=len(items) + 1)
    items.append(jump)


def _waits(mission: dict[str, Any]) -> None:
    next(one for one in mission["mission"]["items"] if one["command"] == WAYPOINT)["params"][0] = 3600


def _script_wind(script: dict[str, Any]) -> None:
    for message in script["messages"]:
        if message["command"] == 43004:
            message["params"][0] *= 1.943844


def _gpx_radius(place: Path) -> None:
    path = place / "plan.gpx"
    text = path.read_text(encoding="utf-8")
    path.write_text(re.sub(r"within ([\d.]+) km", "within 0.010 km", text), encoding="utf-8")


def _no_hull(place: Path) -> None:
    content = json.loads((place / "corridor.geojson").read_text())
    shape = content["features"][-1]["geometry"]
    shape["coordinates"] = [
        shape["coordinates"][0][:1] + shape["coordinates"][0][::3] + shape["coordinates"][0][:1]
    ]
    (place / "corridor.geojson").write_text(json.dumps(content))


SHAPE_LIES = (
    Lie("plan.geojson has no first obstacle", in_features("plan.geojson", _no_obstacle), (GEOJSON,)),
    Lie(
        "an obstacle of plan.geojson is 27 km farther",
        in_features("plan.geojson", _moved("obstacle")),
        (GEOJSON,),
    ),
    Lie(
        "an obstacle of plan.geojson is a metre farther",
        in_features("plan.geojson", _moved("obstacle", 1.2e-5)),
        (GEOJSON,),
    ),
    Lie(
        "a leg of plan.geojson leads elsewhere",
        in_features("plan.geojson", _moved("leg", 0.1, 3)),
        (GEOJSON,),
    ),
    Lie(
        "the start of plan.geojson is elsewhere",
        in_features("plan.geojson", _moved("start", 0.1)),
        (GEOJSON,),
    ),
    Lie(
        "the route of plan.geojson is elsewhere",
        in_features("plan.geojson", _moved("route", 0.1)),
        (GEOJSON,),
    ),
    Lie(
        "the border of plan.geojson is wider", in_features("plan.geojson", _moved("bounds", 0.1)), (GEOJSON,)
    ),
    Lie(
        "two regions of plan.geojson have each other's name",
        in_features("plan.geojson", _swapped_names),
        (GEOJSON,),
    ),
    Lie(
        "a leg of plan.geojson has less wind",
        in_features("plan.geojson", _property("leg", "wind_m_s", 0.1)),
        (GEOJSON,),
    ),
    Lie(
        "a leg of plan.geojson is shorter",
        in_features("plan.geojson", _property("leg", "distance_m", 9.0)),
        (GEOJSON,),
    ),
    Lie(
        "a position of plan.geojson is surer",
        in_features("plan.geojson", _property("position", "radius_95_m", 1.0)),
        (GEOJSON,),
    ),
    Lie(
        "a position of plan.geojson is a fix",
        in_features("plan.geojson", _property("position", "fix", True)),
        (GEOJSON,),
    ),
    Lie(
        "a position of plan.geojson is in a region",
        in_features("plan.geojson", _property("position", "regions", ["b"])),
        (GEOJSON,),
    ),
    Lie("an obstacle of plan.kml is farther", _kml_area_moved, (KML,)),
    Lie(
        "plan.kml has no first obstacle",
        _in_kml(r"<Placemark>\s*<name>obstacle 1<.*?</Placemark>", ""),
        (KML,),
    ),
    Lie(
        "an obstacle of plan.kml has another number",
        _in_kml("<name>obstacle 1<", "<name>obstacle 9<"),
        (KML,),
    ),
    Lie(
        "plan.kml has a note more",
        _in_kml("</Document>", "<Placemark><name>Certified by the FAA</name></Placemark></Document>"),
        (KML,),
    ),
    Lie("the tube of plan.kml holds more", _in_kml("<name>95 % of whole", "<name>99 % of whole"), (KML,)),
    Lie(
        "an obstacle of plan.kml is not shown",
        _in_kml("(<name>obstacle 1<)", r"<visibility>0</visibility>\1"),
        (KML,),
    ),
    Lie(
        "a corridor of whole flights is 27 km farther",
        in_features("corridor.geojson", _moved_corridor("whole_flight")),
        (AREAS,),
    ),
    Lie(
        "a corridor at a time is 27 km farther",
        in_features("corridor.geojson", _moved_corridor("at_time")),
        (AREAS,),
    ),
    Lie("a corridor is thinned out", _no_hull, (AREAS,)),
    Lie("a fence is a kilometre farther", in_json("mission.plan", _fence_moved), (FENCES,)),
    Lie("a fence is thinned out", in_json("mission.plan", _fence_thinned), (FENCES,)),
    Lie("fences keep the robot in the obstacles", in_json("mission.plan", _flown_into), (FENCES,)),
    Lie("the mission begins again at its end", in_json("mission.plan", _more_items), (ITEMS,)),
    Lie("the mission waits an hour", in_json("mission.plan", _waits), (ITEMS,)),
    Lie(
        "the script is told winds in knots",
        in_json("mavlink_script.json", _script_wind),
        ("exports: winds of mavlink_script.json",),
    ),
    Lie("the points of plan.gpx are sure", _gpx_radius, ("exports: names in plan.gpx",)),
    Lie(
        "all maps are without the first obstacle",
        both(
            in_features("plan.geojson", _no_obstacle),
            _in_kml(r"<Placemark>\s*<name>obstacle 1<.*?</Placemark>", ""),
        ),
        (GEOJSON, KML),
    ),
)
