"""False values in the exported files, each lie in one file."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import h5py

from careful_io.files import write_csv
from lies.editing import Lie, in_json, put
from pareto_ltl_verify.flights import clopper_pearson

TABLE = "exports: dead_reckoning.csv"
CHANGE_SPEED, CHANGE_AIRSPEED = 178, 43000  # MAV_CMD


def in_table(key: str, change: Callable[[float], float]) -> Callable[[Path], Any]:
    """Change a column of the dead-reckoning table."""

    def edit(place: Path) -> None:
        with (place / "dead_reckoning.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        for row in rows:
            if row[key]:
                row[key] = repr(change(float(row[key])))
        write_csv(place / "dead_reckoning.csv", list(rows[0]), (row.values() for row in rows))

    return edit


def in_text(name: str, pattern: str, change: Callable[[str], str]) -> Callable[[Path], Any]:
    """Change what the first group of ``pattern`` matches in a file."""

    def edit(place: Path) -> None:
        text = (place / name).read_text(encoding="utf-8")

        def changed(found: re.Match[str]) -> str:
            start, end = (found.span(1)[i] - found.start() for i in (0, 1))
            return found[0][:start] + change(found[1]) + found[0][end:]

        (place / name).write_text(re.sub(pattern, changed, text), encoding="utf-8")

    return edit


def _later(text: str) -> str:
    return (datetime.fromisoformat(text) + timedelta(seconds=90)).isoformat().replace("+00:00", "Z")


def _elsewhere(text: str) -> str:
    return repr(float(text) + 0.001)


def _often(_text: str) -> str:
    return "33.3"


def _moved_waypoint(mission: dict[str, Any]) -> None:
    waypoints = [item for item in mission["mission"]["items"] if item["command"] == 16]
    waypoints[3]["params"][4] += 0.01


def _other_home(mission: dict[str, Any]) -> None:
    mission["mission"]["plannedHomePosition"][0] += 0.01


def _faster(mission: dict[str, Any]) -> None:
    for item in mission["mission"]["items"]:
        if item["command"] == 178:
            item["params"][1] *= 1.1


def _half_fence(mission: dict[str, Any]) -> None:
    mission["geoFence"]["polygons"].pop()


def _rates(mission: dict[str, Any]) -> None:
    told = mission["pareto_ltl"]["failure_by_position"]
    count = told["runs"] // 3
    told["failure"] = count / told["runs"]
    told["low"], told["high"] = clopper_pearson(count, told["runs"])


def _turned_messages(script: dict[str, Any]) -> None:
    for message in script["messages"]:
        if message["command"] == 43002:
            message["params"][1] = (message["params"][1] + 1.0) % 360.0


def _sizes(factor: float) -> Callable[[Path], Any]:
    def change(corridor: dict[str, Any]) -> None:
        for feature in corridor["features"]:
            feature["properties"]["standard_deviations"] *= factor

    return in_json("corridor.geojson", change)


def _narrow_areas(corridor: dict[str, Any]) -> None:
    for feature in corridor["features"]:
        for ring in feature["geometry"]["coordinates"]:
            middle = [sum(place[i] for place in ring) / len(ring) for i in (0, 1)]
            for place in ring:
                for i in (0, 1):
                    place[i] = middle[i] + 0.8 * (place[i] - middle[i])


def _at_time_for_whole(corridor: dict[str, Any]) -> None:
    """The tube of whole flights gets the size of one time."""
    for feature in corridor["features"]:
        if feature["properties"]["meaning"] == "whole_flight":
            feature["properties"]["standard_deviations"] *= 0.75


def _other_law(corridor: dict[str, Any]) -> None:
    for feature in corridor["features"]:
        law = feature["properties"]["wind_law"]
        feature["properties"]["wind_law"] = "coherent" if law == "independent" else "independent"


def _slow_air(place: Path) -> None:
    with h5py.File(place / "trajectory.nc", "r+") as file:
        file["airspeed"][:] = 0.9 * file["airspeed"][:]


def _northern_air(place: Path) -> None:
    with h5py.File(place / "trajectory.nc", "r+") as file:
        file["lat"][:] = file["lat"][:] + 0.001


def in_knots(name: str) -> Callable[[Path], Any]:
    """Call all speeds of a NetCDF file knots."""

    def edit(place: Path) -> None:
        with h5py.File(place / name, "r+") as file:
            for key in file:
                if str(file[key].attrs.get("units", "")) in ("m s-1", "b'm s-1'"):
                    file[key].attrs["units"] = "knots"

    return edit


def _weaker_wind(place: Path) -> None:
    with h5py.File(place / "trajectory.nc", "r+") as file:
        file["wind_speed"][:] = 0.5 * file["wind_speed"][:]


def _true_airspeeds(script: Any) -> None:
    for message in script["messages"]:
        if message["command"] == CHANGE_AIRSPEED:
            message["params"][1] *= 1.05


def _true_speeds(mission: Any) -> None:
    for item in mission["mission"]["items"]:
        if item["command"] == CHANGE_SPEED:
            item["params"][1] *= 1.05


def _higher(mission: Any) -> None:
    for item in mission["mission"]["items"]:
        if "Altitude" in item:
            item["Altitude"] += 100.0
            item["params"][6] += 100.0


def _from_the_sea(mission: Any) -> None:
    for item in mission["mission"]["items"]:
        if "Altitude" in item:
            item["AltitudeMode"], item["frame"] = 2, 0


def _over_ground(script: dict[str, Any]) -> None:
    first = next(one for one in script["messages"] if one["command"] == CHANGE_AIRSPEED)
    first["params"][0] = 1


EXPORT_LIES = (
    Lie(
        "the exported heading is a degree off",
        in_table("heading_true_deg", lambda v: (v + 1) % 360),
        (TABLE,),
    ),
    Lie(
        "the exported wind blows the other way",
        in_table("wind_from_deg", lambda v: (v + 180) % 360),
        (TABLE,),
    ),
    Lie("the exported wind is surer", in_table("wind_sd_m_s", lambda v: 0.8 * v), (TABLE,)),
    Lie("the exported airspeed is lower", in_table("airspeed_tas_m_s", lambda v: 0.9 * v), (TABLE,)),
    Lie("true airspeeds are called calibrated", in_table("airspeed_cas_m_s", lambda v: 1.05 * v), (TABLE,)),
    Lie(
        "the script is told true airspeeds",
        in_json("mavlink_script.json", _true_airspeeds),
        ("exports: mavlink_script.json",),
    ),
    Lie(
        "the mission is told true airspeeds",
        in_json("mission.plan", _true_speeds),
        ("exports: mission.plan",),
    ),
    Lie(
        "the mission flies higher",
        in_json("mission.plan", _higher),
        ("height: mission.plan",),
    ),
    Lie(
        "the mission counts heights from the sea",
        in_json("mission.plan", _from_the_sea),
        ("height: mission.plan",),
    ),
    Lie(
        "the KML route is lower",
        in_text("plan.kml", r",(10\.0)[ <]", lambda _: "5.0"),
        ("height: plan.kml",),
    ),
    Lie("an exported leg is shorter", in_table("duration_s", lambda v: 0.5 * v), (TABLE,)),
    Lie(
        "the exported radius is smaller",
        in_table("radius_95_m", lambda v: 0.9 * v),
        ("exports: ellipses and radii",),
    ),
    Lie(
        "the exported ellipse is smaller",
        in_table("ellipse_major_m", lambda v: 0.9 * v),
        ("exports: ellipses and radii",),
    ),
    Lie(
        "the card is flown faster",
        in_text("flight_card.csv", r",(\d+\.\d),\d+\.\d,\d+,\d", lambda speed: f"{float(speed) + 1:.1f}"),
        ("exports: flight_card.csv",),
    ),
    Lie(
        "the card turns elsewhere",
        in_text("flight_card.csv", r"Z,\d+,(\d+),", lambda heading: f"{(int(heading) + 2) % 360}"),
        ("exports: flight_card.csv",),
    ),
    Lie(
        "the GPX route lies elsewhere",
        in_text("plan.gpx", r'lat="([^"]+)"', _elsewhere),
        ("exports: plan.gpx",),
    ),
    Lie(
        "the GPX times are late", in_text("plan.gpx", r"<time>([^<]+)</time>", _later), ("exports: plan.gpx",)
    ),
    Lie(
        "the KML times are late", in_text("plan.kml", r"<when>([^<]+)</when>", _later), ("exports: plan.kml",)
    ),
    Lie(
        "the GeoJSON times are late",
        in_text("plan.geojson", r'"time_utc": "([^"]+)"', _later),
        ("exports: plan.geojson",),
    ),
    Lie("the trajectory lies elsewhere", _northern_air, ("exports: trajectory.nc",)),
    Lie("speeds of the trajectory are knots", in_knots("trajectory.nc"), ("units: trajectory.nc",)),
    Lie("winds are knots", in_knots("wind.nc"), ("units: wind.nc",)),
    Lie("the trajectory has less wind", _weaker_wind, ("exports: numbers of trajectory.nc",)),
    Lie("the trajectory is slower", _slow_air, ("exports: trajectory.nc",)),
    Lie(
        "the script turns the robot",
        in_json("mavlink_script.json", _turned_messages),
        ("exports: mavlink_script.json",),
    ),
    Lie("a waypoint lies elsewhere", in_json("mission.plan", _moved_waypoint), ("exports: mission.plan",)),
    Lie(
        "a fence is of another version",
        in_json("mission.plan", lambda plan: put(plan, "geoFence", "polygons", 0, "version", value=0)),
        ("exports: fences of mission.plan",),
    ),
    Lie(
        "legs are 0.5 m longer",
        in_table("distance_m", lambda far: far + 0.5),
        ("exports: dead_reckoning.csv",),
    ),
    Lie("the launch place is elsewhere", in_json("mission.plan", _other_home), ("exports: mission.plan",)),
    Lie(
        "heights of the mission are above the sea",
        in_json("mission.plan", lambda plan: put(plan, "mission", "globalPlanAltitudeMode", value=2)),
        ("exports: items of mission.plan",),
    ),
    Lie(
        "the script asks for a speed over ground",
        in_json("mavlink_script.json", _over_ground),
        ("exports: winds of mavlink_script.json",),
    ),
    Lie(
        "an ellipse holds whole flights",
        in_json(
            "corridor.geojson",
            lambda areas: put(areas, "features", 1, "properties", "meaning", value="all_flights"),
        ),
        ("exports: sizes of corridors",),
    ),
    Lie("the mission is flown faster", in_json("mission.plan", _faster), ("exports: mission.plan",)),
    Lie(
        "the mission cruises faster",
        in_json("mission.plan", lambda m: m["mission"].update(cruiseSpeed=99.0)),
        ("exports: mission.plan",),
    ),
    Lie(
        "the failure rate in the KML file is another",
        in_text("plan.kml", r"winds, ([\d.]+) %", _often),
        ("exports: rates in plan.kml",),
    ),
    Lie(
        "the failure rate in the GPX file is another",
        in_text("plan.gpx", r"winds, ([\d.]+) %", _often),
        ("exports: rates in plan.gpx",),
    ),
    Lie(
        "the GPX file covers all errors",
        in_text("plan.gpx", r"(Not covered: [^<]*)</desc>", lambda _: ""),
        ("exports: rates in plan.gpx",),
    ),
    Lie(
        "an obstacle is not in the fence",
        in_json("mission.plan", _half_fence),
        ("exports: fences of mission.plan",),
    ),
    Lie("an autopilot fails often", in_json("mission.plan", _rates), ("exports: failure of mission.plan",)),
    Lie(
        "corridors are narrower than flights",
        _sizes(0.85),
        ("exports: sizes of corridors", "exports: areas of corridors"),
    ),
    Lie("corridors are wider than flights", _sizes(1.2), ("exports: sizes of corridors",)),
    Lie(
        "areas are smaller than their sizes",
        in_json("corridor.geojson", _narrow_areas),
        ("exports: areas of corridors",),
    ),
    Lie(
        "a corridor at a time is one of whole flights",
        in_json("corridor.geojson", _at_time_for_whole),
        ("exports: sizes of corridors",),
    ),
    Lie(
        "a corridor of another law", in_json("corridor.geojson", _other_law), ("exports: sizes of corridors",)
    ),
)
