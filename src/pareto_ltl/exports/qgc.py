"""``mission.plan``: waypoints and a geofence for QGroundControl, PX4 and ArduPilot.

An autopilot flies such a mission by position, so the plan's promise does not hold for it: the file also
states the failure rate of the plan with ``robot.feedback_time=60``. Take-off and landing are left out. The
height of the ground is unknown: the home position has altitude 0, and QGroundControl replaces it by the
terrain or by the position of the vehicle.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from pareto_ltl.exports.degrees import outline_degrees
from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.exports.geojson import border_corners
from pareto_ltl.exports.mavlink import AIRSPEED, POSITION_FRAMES
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.files import plain_data

WAYPOINT, CHANGE_SPEED = 16, 178  # MAV_CMD_NAV_WAYPOINT, MAV_CMD_DO_CHANGE_SPEED
MISSION_FRAME = 2  # MAV_FRAME_MISSION
KEEP_THROTTLE = -1
ALTITUDE_MODES = {False: 1, True: 2}  # of QGroundControl: above the launch place, above mean sea level
FENCE_SAG = 50.0  # [m] error of the edges of the fence: autopilots store few corners
GENERIC, FIXED_WING, SUBMARINE = 0, 1, 12  # MAV_TYPE
LEAST_CHANGE = 0.05  # [m/s] least change of airspeed for which an item is written


def mission_plan(exported: ExportedPlan) -> bytes:
    """The file; waypoints are the expected positions at the end of each leg."""
    log, height = exported.log, exported.height
    content = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "pareto_ltl",
        "pareto_ltl": _note(exported),
        "mission": {
            "version": 2,
            "firmwareType": 0,
            "vehicleType": vehicle_type(exported),
            "cruiseSpeed": log.airspeed.max(initial=0.0),
            "hoverSpeed": log.airspeed.max(initial=0.0),
            "globalPlanAltitudeMode": ALTITUDE_MODES[height.above_sea],
            "plannedHomePosition": [log.lat[0], log.lon[0], 0.0],
            "items": mission_items(exported),
        },
        "geoFence": {"version": 2, "circles": [], "polygons": fence_polygons(exported)},
        "rallyPoints": {"version": 2, "points": []},
    }
    return (json.dumps(plain_data(content), indent=1, allow_nan=False) + "\n").encode()


def vehicle_type(exported: ExportedPlan) -> int:
    """MAV_TYPE: submarine below the surface, fixed wing if the robot has a least airspeed, else generic."""
    if exported.height.metres < 0.0:
        return SUBMARINE
    return FIXED_WING if exported.least_airspeed > 0.0 else GENERIC


def mission_items(exported: ExportedPlan) -> list[dict[str, Any]]:
    """A waypoint for each leg's end, and before it the leg's airspeed where that changes."""
    log, height = exported.log, exported.height
    frame, speed = POSITION_FRAMES[height.above_sea], -1.0
    items: list[dict[str, Any]] = []
    for k, airspeed in enumerate(log.airspeed):
        if abs(airspeed - speed) > LEAST_CHANGE and airspeed > 0.0:
            speed = float(airspeed)
            items.append(
                _item(len(items), CHANGE_SPEED, MISSION_FRAME, [AIRSPEED, speed, KEEP_THROTTLE, 0, 0, 0, 0])
            )
        place = [log.lat[k + 1], log.lon[k + 1], height.metres]
        waypoint = _item(len(items), WAYPOINT, frame, [0, 0, 0, None, *place])
        items.append(waypoint | {
            "AMSLAltAboveTerrain": None, "Altitude": height.metres,
            "AltitudeMode": ALTITUDE_MODES[height.above_sea],
        })  # fmt: skip
    return items


def _item(number: int, command: int, frame: int, params: list[Any]) -> dict[str, Any]:
    return {
        "type": "SimpleItem", "autoContinue": True, "doJumpId": number + 1, "command": command,
        "frame": frame, "params": params,
    }  # fmt: skip


def fence_polygons(exported: ExportedPlan) -> list[dict[str, Any]]:
    """The obstacles to stay out of and, where the border is a wall, the map to stay in."""
    scene = exported.scene
    areas: list[tuple[bool, FloatArray]] = [(False, polygon) for polygon in scene.obstacles]
    if scene.walled:
        areas.insert(0, (True, border_corners(scene.bounds)))
    return [
        {
            "version": 1,
            "inclusion": inside,
            "polygon": outline_degrees(exported.crs, corners, FENCE_SAG)[:-1, ::-1],
        }
        for inside, corners in areas
    ]


def _note(exported: ExportedPlan) -> dict[str, Any]:
    promise = exported.plan.promise
    return {
        "note": "An autopilot flies this mission by position. Take-off and landing are not part of it. "
        + " ".join(exported.sentences()),
        "failure_by_heading": None if promise is None else asdict(promise.rate),
        "failure_by_position": None if exported.held is None else asdict(exported.held),
    }
