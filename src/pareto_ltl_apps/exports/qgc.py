"""``mission.plan``: waypoints and a geofence for QGroundControl, PX4 and ArduPilot.

An autopilot flies such a mission by position, so the plan's promise does not hold for it: the file also
states the failure rate of the plan with ``robot.feedback_time=60``. A robot with rotors takes off vertically
and hovers at the end until the pilot takes over; take-offs of others are left out, and all landings: the plan
may end over water. The height of the ground is unknown: the home position has altitude 0, and QGroundControl
replaces it by the terrain or by the position of the vehicle.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from careful_io.files import plain_data
from pareto_ltl.extend import Frame
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.degrees import closes, crosses, polygon_parts
from pareto_ltl_apps.exports.exported import ExportedPlan
from pareto_ltl_apps.exports.geojson import border_corners
from pareto_ltl_apps.exports.mavlink import AIRSPEED, GROUND_SPEED, POSITION_FRAMES

WAYPOINT, CHANGE_SPEED = 16, 178  # MAV_CMD_NAV_WAYPOINT, MAV_CMD_DO_CHANGE_SPEED
HOVER, TAKE_OFF = 17, 22  # MAV_CMD_NAV_LOITER_UNLIM, MAV_CMD_NAV_TAKEOFF
MISSION_FRAME = 2  # MAV_FRAME_MISSION
KEEP_THROTTLE = -1
ALTITUDE_MODES = {False: 1, True: 2}  # of QGroundControl: above the launch place, above mean sea level
FENCE_SAG = 50.0  # [m] error of the edges of the fence: autopilots store few corners
HOVERS = (
    "The last item hovers at the end of the plan until the pilot takes over; the energy of the plan is "
    "without it. "
)
LEAST_CHANGE = 0.05  # [m/s] least change of speed for which an item is written


def mission_plan(exported: ExportedPlan) -> bytes:
    """The file; waypoints are the expected positions at the end of each leg."""
    log, height = exported.log, exported.height
    cruise = mission_speeds(exported).max(initial=0.0)
    content = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "pareto_ltl",
        "pareto_ltl": _note(exported),
        "mission": {
            "version": 2,
            "firmwareType": 0,
            "vehicleType": exported.vehicle.kind,
            "cruiseSpeed": cruise,
            "hoverSpeed": cruise,
            "globalPlanAltitudeMode": ALTITUDE_MODES[height.above_sea],
            "plannedHomePosition": [log.lat[0], log.lon[0], 0.0],
            "items": mission_items(exported),
        },
        "geoFence": {"version": 2, "circles": [], "polygons": fence_polygons(exported)},
        "rallyPoints": {"version": 2, "points": []},
    }
    return (json.dumps(plain_data(content), indent=1, allow_nan=False) + "\n").encode()


def mission_speeds(exported: ExportedPlan) -> FloatArray:
    """Speed of each leg (T,) [m/s] as the autopilot holds it.

    That is the calibrated airspeed; of a multirotor, whose autopilot holds speeds over ground, the expected
    ground speed.
    """
    return exported.log.ground_speed if exported.vehicle.hovers else exported.autopilot_airspeed


def mission_items(exported: ExportedPlan) -> list[dict[str, Any]]:
    """A waypoint for each leg's end, and before it the leg's speed where that changes."""
    log, height, speed = exported.log, exported.height, -1.0
    kind = GROUND_SPEED if exported.vehicle.hovers else AIRSPEED
    items = list[dict[str, Any]]()

    def add(command: int, frame: int, *params: float | None) -> None:
        items.append({
            "type": "SimpleItem", "autoContinue": True, "doJumpId": len(items) + 1, "command": command,
            "frame": frame, "params": list(params),
        })  # fmt: skip

    def add_place(command: int, step: int) -> None:
        """An item at the expected position of ``step``."""
        place = log.lat[step], log.lon[step], height.metres
        add(command, POSITION_FRAMES[height.above_sea], 0, 0, 0, None, *place)
        items[-1] |= {
            "AMSLAltAboveTerrain": None, "Altitude": height.metres,
            "AltitudeMode": ALTITUDE_MODES[height.above_sea],
        }  # fmt: skip

    if exported.vehicle.takes_off:
        add_place(TAKE_OFF, 0)
    for k, held in enumerate(mission_speeds(exported)):
        if abs(held - speed) > LEAST_CHANGE and held > 0.0:
            speed = float(held)
            add(CHANGE_SPEED, MISSION_FRAME, kind, speed, KEEP_THROTTLE, 0, 0, 0, 0)
        add_place(WAYPOINT, k + 1)
    if exported.vehicle.hovers:
        add_place(HOVER, log.legs)
    return items


def fence_polygons(exported: ExportedPlan) -> list[dict[str, Any]]:
    """The obstacles to stay out of and, where the border is a wall, the map to stay in.

    Areas that the 180th meridian crosses are cut there. A border that it crosses is left out: some autopilots
    take several areas to stay in as areas that all contain the vehicle.
    """
    fences = list[tuple[bool, FloatArray]]()
    border = Frame(exported.crs).outline_degrees(border_corners(exported.scene.bounds), FENCE_SAG)
    cut = crosses(border) and closes(border)  # one around a pole crosses the meridian too
    if exported.scene.walled and not cut:
        fences.append((True, border))
    for corners in exported.scene.obstacles:
        ring = Frame(exported.crs).outline_degrees(corners, FENCE_SAG)
        parts = polygon_parts([ring]) if closes(ring) else [[ring]]
        fences += [(False, outline) for outline, *_ in parts]
    return [{"version": 1, "inclusion": inside, "polygon": ring[:-1, ::-1]} for inside, ring in fences]


def _note(exported: ExportedPlan) -> dict[str, Any]:
    promise = exported.plan.promise
    missing = "A landing is" if exported.vehicle.takes_off else "Take-off and landing are"
    fences = fence_polygons(exported)
    open_border = exported.scene.walled and not any(fence["inclusion"] for fence in fences)
    cut = "The border of the map is no fence, since the 180th meridian crosses it. " if open_border else ""
    hovers = HOVERS if exported.vehicle.hovers else ""
    return {
        "note": f"An autopilot flies this mission by position. {missing} not part of it. {hovers}{cut}"
        + " ".join(exported.sentences()),
        "failure_by_heading": None if promise is None else asdict(promise.rate),
        "failure_by_position": None if exported.held is None else asdict(exported.held),
    }
