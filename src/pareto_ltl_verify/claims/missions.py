"""Claims about files that machines fly: items and fences of a mission, scripts, volumes in time, names."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
from typing import Any

import numpy as np

from careful_io.names import joined_names
from careful_io.reading import read_text
from pareto_ltl_verify.areas import TOLERANCE, area_fault, drawn_fault
from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, no_fault, unlike
from pareto_ltl_verify.claims.exports import (
    CHANGE_SPEED,
    FPL,
    GPX,
    PLAN,
    TABLE,
    WAYPOINT,
    Rows,
    unlike_at,
    xml_root,
)
from pareto_ltl_verify.claims.height import flown
from pareto_ltl_verify.claims.outlines import ellipse_polygons, map_areas, tube_size, whole_size
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.geometry import in_plane, on_earth, outline_distance

HOVER, TAKE_OFF = 17, 22  # MAV_CMD
FENCE_SAG = 50.0  # [m] by which edges of a fence may leave straight edges of the plane
SUBMARINE, MULTIROTOR, FIXED_WING, GENERIC = 12, 2, 1, 0  # MAV_TYPE
ALTITUDE_MODES = {False: 1, True: 2}  # of QGroundControl: above the launch place, above mean sea level
WIND = 43004  # MAV_CMD
SCRIPT = {
    "schema": "pareto_ltl.mavlink_script/1", "dialect": "all", "firmware": "ArduPlane 4.6 or later",
    "mode": "GUIDED (15)",
}  # fmt: skip
PROLOGUE = [
    ("SET_GPS_GLOBAL_ORIGIN", None, "SET_GPS_GLOBAL_ORIGIN", None, None, "z"),
    ("COMMAND_INT", 179, "MAV_CMD_DO_SET_HOME", 0, None, "z"),
    ("COMMAND_INT", 43003, "MAV_CMD_EXTERNAL_POSITION_ESTIMATE", 0, None),
]  # fmt: skip - message, command, name, frame, height, and what the sender fills in
SENT = {
    ("COMMAND_LONG", 43000, "MAV_CMD_GUIDED_CHANGE_SPEED"),
    ("COMMAND_LONG", 43002, "MAV_CMD_GUIDED_CHANGE_HEADING"),
    ("COMMAND_LONG", 43004, "MAV_CMD_EXTERNAL_WIND_ESTIMATE"),
    ("COMMAND_INT", 43003, "MAV_CMD_EXTERNAL_POSITION_ESTIMATE"),
}
FIXED: dict[int, dict[int, int]] = {  # parameters of each command that are the same in every message
    43000: {0: 0, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0}, 43002: {0: 1, 3: 0, 4: 0, 5: 0, 6: 0},
    43004: {4: 0, 5: 0, 6: 0}, 43003: {1: 0, 3: 0},
}  # fmt: skip
NOWHERE = 2  # MAV_FRAME_MISSION: the item has no place
DEGREE = 1e7  # units of places of MAVLink in a degree
LEG = re.compile(r"^ {4}\{ (.*) \},$", re.MULTILINE)
START = re.compile(r"^local START = \{ lat = (-?\d+), lng = (-?\d+), sd = ([\d.e+-]+) \}", re.MULTILINE)
END = re.compile(r"^local END = ([\d.e+-]+)", re.MULTILINE)
LUA_COLUMNS = ("t_s", "heading_true_deg", "wind_m_s", "wind_from_deg")
LUA_PLACES = (0, 2, 3, 5)  # of these columns in a leg of plan.lua
SIX = 1e-6  # relative accuracy of numbers of plan.lua
FLOOR = 10.0  # [m] least distance of a leg from the edge of its volume
VOLUME = 0.95  # share of whole flights in the volumes


# --- mission.plan -----------------------------------------------------------------------------------


def items(result: Evidence) -> Verdict:
    """The items are a waypoint for each leg, changes of speed, take-off and hovering of rotors; no others."""
    content, rotor = result.document("mission.plan"), _has_rotors(result)
    height, mission = flown(result), content["mission"]
    takes_off = rotor and height.metres > 0.0 and not height.above_sea
    listed = mission["items"]
    fixed = [one["command"] for one in listed if one["command"] != CHANGE_SPEED]
    wanted = [TAKE_OFF] * takes_off + [WAYPOINT] * len(result.u) + [HOVER] * rotor
    of_wing = FIXED_WING if result.robot.u_min > 0.0 else GENERIC
    kind = SUBMARINE if height.metres < 0.0 else MULTIROTOR if rotor else of_wing
    modes = {"globalPlanAltitudeMode": ALTITUDE_MODES[height.above_sea]}
    faults = unlike(mission, {"vehicleType": kind, "firmwareType": 0, **modes})
    faults += unlike(content, {"fileType": "Plan", "version": 1, "groundStation": "pareto_ltl"})
    parts = [content["geoFence"], mission, content["rallyPoints"]]
    faults += [f"versions {[part['version'] for part in parts]}"] * any(
        part["version"] != 2 for part in parts
    )
    faults += [f"commands {sorted(set(fixed))}"] * (fixed != wanted)
    faults += ["rally points"] * bool(content["rallyPoints"]["points"])
    for number, item in enumerate(listed, 1):
        about = {"type": "SimpleItem", "autoContinue": True, "doJumpId": number}
        faults += [f"item {number}: {fault}" for fault in unlike(item, about)]
        if item["command"] == CHANGE_SPEED:
            good = item["params"][:1] + item["params"][2:] == [int(rotor), -1, 0, 0, 0, 0]
            faults += [f"item {number}: frame {item['frame']}"] * (item["frame"] != NOWHERE)
        else:
            good = item["params"][:4] == [0, 0, 0, None]
        faults += [f"item {number}: parameters {item['params']}"] * (not good)
    ends = {TAKE_OFF: 0, HOVER: -1}
    for item in (one for one in listed if one["command"] in ends):
        step = ends[item["command"]]
        place = [result.plan["lat"][step], result.plan["lon"][step]]
        faults += unlike_at("place {} of take-off or hovering", item["params"][4:6], place, 1e-6)
    return no_fault(f"{len(listed)} items", faults)


def _has_rotors(result: Evidence) -> bool:
    return (result.settings["robot"].get("power") or {}).get("kind") == "rotor"


def fences(result: Evidence) -> Verdict:
    """The fences are the obstacles and, if border=wall, the border: every corner and every edge."""
    content, crs = result.document("mission.plan")["geoFence"], result.scene["crs"]
    *rest, border = map_areas(result)
    areas = [(False, one.title, one.outlines[0]) for one in rest if one.role == "obstacle"]
    if result.ground.walled and not _crosses_180(crs, border.outlines[0]):  # no area to stay in can be cut
        areas.insert(0, (True, border.title, border.outlines[0]))
    polygons = content["polygons"]
    drawn = [np.array(fence["polygon"], float)[:, ::-1] for fence in polygons]
    inside = [fence["inclusion"] for fence in polygons]
    faults = ["circles"] * bool(content["circles"])
    faults += [f"fence {number}: version" for number, one in enumerate(polygons, 1) if one["version"] != 1]
    for keep_in, title, corners in areas:
        parts = 1
        if _crosses_180(crs, corners):
            on = (outline_distance(corners, in_plane(crs, one)).max() <= FENCE_SAG for one in drawn[1:])
            parts += sum(1 for _ in takewhile(bool, on))
        rings = [np.concatenate([one, one[:1]]) for one in drawn[:parts]]
        fault = drawn_fault(crs, rings, [corners], FENCE_SAG) if rings else "no fence"
        faults += [f"{title}: {fault}"] * bool(fault)
        faults += [f"{title}: kept out and in"] * any(one is not keep_in for one in inside[:parts])
        drawn, inside = drawn[parts:], inside[parts:]
    faults += [f"{len(drawn)} fences more"] * bool(drawn)
    return no_fault(f"{len(polygons)} fences", faults)


def _crosses_180(crs: str, corners: FloatArray) -> bool:
    """Whether the 180th meridian crosses the outline through ``corners`` (n, 2) [m]; no pole is inside."""
    ends = np.roll(corners, -1, axis=0)
    points = corners[:, None] + np.linspace(0.0, 1.0, 200)[:, None] * (ends - corners)[:, None]
    lon, _ = on_earth(crs, points.reshape(-1, 2))
    turned = np.unwrap(np.deg2rad(lon))
    return bool(np.abs(np.diff(lon)).max() > 180.0 and abs(turned[-1] - turned[0]) < np.pi)


# --- scripts ----------------------------------------------------------------------------------------


def script_winds(result: Evidence) -> Verdict:
    """Winds, times and the place of the start in the MAVLink script agree with the table."""
    script, rows = result.document("mavlink_script.json"), result.table(TABLE)
    at = {float(row["t_s"]): row for row in rows}
    faults = unlike(script, {"start_utc": rows[0]["time_utc"] or None, "name": result.settings["name"]})
    for message in script["messages"]:
        row = at.get(float(message["t"]), {})
        faults += [f"time {message['utc']}"] * ((message["utc"] or "") != row.get("time_utc"))
        if message["command"] == WIND:
            faults += _wind_faults(message, row)
    for message in script["before_take_off"]:
        faults += _wind_faults(message, rows[0])
    place = [float(rows[0][key]) * DEGREE for key in ("lat_deg", "lon_deg")]
    faults += unlike(script, SCRIPT)
    filled = [
        (one["message"], one.get("command"), one["name"], one.get("frame"), one["z"], *one["fill_in"])
        for one in script["prologue"]
    ]
    faults += [f"prologue {filled}"] * (filled != PROLOGUE)
    before = script["before_take_off"]
    sent = {(one["message"], one["command"], one["name"]) for one in (*script["messages"], *before)}
    faults += ["before take-off"] * any(one["command"] != WIND for one in before)
    faults += [f"messages {sorted(sent - SENT)}"] * bool(sent - SENT)
    for message in (*script["messages"], *before):
        params = dict(enumerate(message["params"]))
        wrong = {k: value for k, value in FIXED[message["command"]].items() if params.get(k) != value}
        faults += [f"{message['name']} at {message.get('t', 0.0):g} s: parameters {sorted(wrong)}"] * bool(
            wrong
        )
    for message in script["prologue"]:
        faults += unlike_at("place {} of the start", [message["x"], message["y"]], place, 1.0)
    return no_fault(f"{len(script['messages'])} messages", faults)


def _wind_faults(message: Mapping[str, Any], row: Mapping[str, str]) -> Iterator[str]:
    """A wind message that differs from its row; its sd along the wind is at most √2 of the sd there."""
    speed, sd, bearing, _ = message["params"][:4]
    wanted = [float(row[key]) for key in ("wind_m_s", "wind_sd_m_s", "wind_from_deg")]
    turn = abs((bearing - wanted[2] + 180.0) % 360.0 - 180.0)
    known = close(speed, wanted[0], 1e-6, 1e-6) and turn <= 1e-3
    if not (known and 0.0 < sd <= math.sqrt(2.0) * wanted[1] + 1e-9):
        yield f"wind at {row['t_s']} s"


def lua(result: Evidence) -> Verdict:
    """Times, airspeeds, headings and winds of plan.lua, its start and its end agree with the table."""
    text, rows = read_text(result.directory / "plan.lua"), result.table(TABLE)
    legs = [[float(word) for word in found.split(", ")] for found in LEG.findall(text)]
    if len(legs) != len(rows) - 1 or min(map(len, legs), default=7) != 7:
        return no_fault(f"{len(legs)} legs", [f"{len(rows) - 1} are expected"])
    reported = "airspeed_tas_m_s" if result.plan.get("airspeed_calibrated") is None else "airspeed_cas_m_s"
    faults = list[str]()
    for k, (leg, row) in enumerate(zip(legs, rows, strict=False)):
        wanted = [float(row[key] or -1.0) for key in (*LUA_COLUMNS, reported)]
        stated = [leg[place] for place in (*LUA_PLACES, 1)]
        pairs = zip(stated, wanted, strict=True)
        faults += [f"leg {k}: {a} is {b}" for a, b in pairs if not close(a, b, SIX, SIX)]
    start, end = START.findall(text), END.findall(text)
    if len(start) != 1 or len(end) != 1:
        return no_fault(f"{len(legs)} legs", [*faults, "no start or end"])
    place = [float(rows[0][key]) * DEGREE for key in ("lat_deg", "lon_deg")]
    faults += unlike_at("place {} of the start", list(map(float, start[0][:2])), place, 1.0)
    faults += ["the end"] * (not close(float(end[0]), float(rows[-1]["t_s"]), SIX, SIX))
    return no_fault(f"{len(legs)} legs", faults)


# --- volumes in time --------------------------------------------------------------------------------


def volumes(result: Evidence) -> Verdict:
    """Each leg of operational_intent.json has its hull, its times and the heights of the settings."""
    content, crs, plan = result.document("operational_intent.json"), result.scene["crs"], result.plan
    listed, exports = content["volumes"], result.settings["exports"]
    if len(listed) != len(result.u):
        return no_fault(f"{len(listed)} volumes", [f"{len(result.u)} legs"])
    rings = []
    for one in listed:
        corners = [(place["lng"], place["lat"]) for place in one["volume"]["outline_polygon"]["vertices"]]
        rings.append(in_plane(crs, np.array(corners, float)))
    size, faults = _size_of(result, rings), list[str]()
    for k, (one, ring) in enumerate(zip(listed, rings, strict=True)):
        about = one["volume"]
        for key, limit in (("altitude_lower", "altitude_lower"), ("altitude_upper", "altitude_upper")):
            wanted = {"value": exports[limit], "reference": "W84", "units": "M"}
            faults += [f"volume {k}: {fault}" for fault in unlike(about[key], wanted)]
        if result.robot.bank == 0.0:
            times = [one[key]["value"] for key in ("time_start", "time_end")]
            faults += [f"volume {k}: times"] * (times != plan["time_utc"][k : k + 2])
        fault = area_fault([ring], [_volume(result, size, k)], 2.0 * TOLERANCE)
        faults += [f"volume {k}: {fault}"] * bool(fault)
    faults += ["off-nominal volumes"] * bool(content["off_nominal_volumes"])
    return no_fault(f"{len(listed)} volumes", faults)


def _size_of(result: Evidence, rings: Sequence[FloatArray]) -> float:
    """The size of the ellipses: of corridor.geojson, else the one that reaches as far as the volumes."""
    size = whole_size(result, VOLUME)
    return tube_size(result, np.concatenate(list(rings))) if size is None else size


def _volume(result: Evidence, size: float, k: int) -> FloatArray:
    """The corners [m] of the hull of leg ``k``: both ellipses, and a circle of 10 m around both ends."""
    from scipy.spatial import ConvexHull

    angle = np.arange(64) * (2.0 * np.pi / 64)
    circle = FLOOR * np.column_stack([np.cos(angle), np.sin(angle)])
    ends = [*ellipse_polygons(result, size)[k : k + 2], *(circle + place for place in result.x[k : k + 2])]
    points = np.concatenate(ends)
    return np.asarray(points[ConvexHull(points).vertices], float)


# --- names ------------------------------------------------------------------------------------------


def gpx_names(result: Evidence) -> Verdict:
    """Names and descriptions of the points of plan.gpx, and its departure."""
    root, rows = xml_root(result, "plan.gpx"), _table(result)
    height = flown(result)
    of_sea = height.above_sea or height.metres < 0.0
    above = "" if of_sea else f", {height.metres:g} m above the ground of the start"
    faults = list[str]()
    for k, point in enumerate(root.findall(".//rtept", GPX)):
        name = f"{k} {joined_names(result.plan['label'][k])}".strip()
        faults += [f"point {k}: name"] * (point.findtext("name", None, GPX) != name)
        radius = float(rows[k]["radius_95_m"]) / 1e3 if rows else math.nan
        stated = point.findtext("desc", "", GPX)
        found = re.fullmatch(r"95 % of positions within ([\d.]+) km, (\w+ \w+)(.*)", stated)
        laws = [f"{result.planned_law} {flow}" for flow in result.flows]
        good = found is not None and found[2] in laws and found[3] == above
        near = found is not None and (not rows or abs(float(found[1]) - radius) <= 5.1e-4)
        faults += [f"point {k}: {stated}"] * (not good or not near)
    times = [*root.iterfind("metadata/time", GPX), *root.iterfind(".//{*}planned_departure")]
    begin = (result.plan["time_utc"] or [None])[0]
    faults += [f"departure {one.text}" for one in times if one.text != begin]
    names = {one.text for one in (*root.iterfind("metadata/name", GPX), *root.iterfind("rte/name", GPX))}
    faults += [f"name {name}" for name in names if name != result.settings["name"]]
    return no_fault(f"{len(root.findall('.//rtept', GPX))} points", faults)


def fpl_names(result: Evidence) -> Verdict:
    """The route of plan.fpl has one waypoint for each step, in order, and its departure."""
    root = xml_root(result, "plan.fpl")
    names = [one.text for one in root.iterfind(".//route-point/waypoint-identifier", FPL)]
    faults = [] if names == [f"P{k:03d}" for k in range(len(result.x))] else ["other waypoints"]
    begin = (result.plan["time_utc"] or [None])[0]
    faults += ["created"] * (root.findtext("created", None, FPL) != begin)
    return no_fault(f"{len(names)} waypoints", faults)


def _table(result: Evidence) -> Rows:
    return result.table(TABLE) if result.has(TABLE) else []


WORLD = (*PLAN, "cells.json", "automaton.json")
CLAIMS: tuple[Claim, ...] = (
    Claim("exports: items of mission.plan", ("mission.plan", *PLAN), items),
    Claim("exports: fences of mission.plan", ("mission.plan", *WORLD), fences),
    Claim("exports: winds of mavlink_script.json", ("mavlink_script.json", TABLE, *PLAN), script_winds),
    Claim("exports: plan.lua", ("plan.lua", TABLE, *PLAN), lua),
    Claim("exports: operational_intent.json", ("operational_intent.json", *PLAN), volumes),
    Claim("exports: names in plan.gpx", ("plan.gpx", *PLAN), gpx_names),
    Claim("exports: names in plan.fpl", ("plan.fpl", *PLAN), fpl_names),
)
