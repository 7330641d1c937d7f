"""Files for an autopilot that flies by heading and airspeed: ``mavlink_script.json`` and ``plan.lua``.

The first has messages with their times. Each message is a MAVLink command; ``examples/send_mavlink.py`` sends
them with pymavlink. The sender replaces the values of a position estimate by a measurement at the landmark:
those in the file are only what the plan expects. The second is the table as a script that ArduPlane runs,
without a companion computer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from importlib.resources import files
from typing import Any

import numpy as np

from careful_io.files import plain_data
from pareto_ltl.extend import Branching
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.exports.branches import track_bearing
from pareto_ltl_apps.exports.exported import ExportedPlan
from pareto_ltl_apps.exports.geojson import listed_json
from pareto_ltl_apps.exports.navigation_log import NavigationLog

SCHEMA = "pareto_ltl.mavlink_script/1"
CHANGE_SPEED, CHANGE_HEADING, POSITION_ESTIMATE, WIND_ESTIMATE = 43000, 43002, 43003, 43004
SET_HOME = 179
SET_ORIGIN = "SET_GPS_GLOBAL_ORIGIN"  # a message, not a command
FIRMWARE, MODE = "ArduPlane 4.6 or later", "GUIDED (15)"
NAMES = {
    SET_HOME: "MAV_CMD_DO_SET_HOME",
    CHANGE_SPEED: "MAV_CMD_GUIDED_CHANGE_SPEED",
    CHANGE_HEADING: "MAV_CMD_GUIDED_CHANGE_HEADING",
    POSITION_ESTIMATE: "MAV_CMD_EXTERNAL_POSITION_ESTIMATE",
    WIND_ESTIMATE: "MAV_CMD_EXTERNAL_WIND_ESTIMATE",
}
AIRSPEED, GROUND_SPEED, HEADING = 0, 1, 1  # SPEED_TYPE_AIRSPEED, _GROUNDSPEED, HEADING_TYPE_HEADING
AT_ONCE = 0.0  # acceleration that means no limit
TURN = 5.0  # [m/s²] centripetal acceleration if robot.bank is 0: a bank of 27 degrees
GLOBAL, RELATIVE = 0, 3  # MAV_FRAME_GLOBAL, MAV_FRAME_GLOBAL_RELATIVE_ALT
POSITION_FRAMES = {True: GLOBAL, False: RELATIVE}  # by whether heights are above mean sea level
LEAST_SD = 1.0  # [m] of the position at the start
DEGREE = 1e7  # units of x and y of COMMAND_INT in a degree


def mavlink_script(exported: ExportedPlan) -> bytes:
    """The file, one message a line."""
    log = exported.log
    head = {
        "schema": SCHEMA,
        "name": exported.name,
        "description": " ".join(exported.sentences()),
        "start_utc": log.time_utc(0),
        "wind_law": log.law,
        "dialect": "all",
        "firmware": FIRMWARE,
        "mode": MODE,
        "before_take_off": plain_data(first_wind(exported)),
        "prologue": plain_data(prologue(log.lat[0], log.lon[0], start_sd(exported))),
    }
    return listed_json(head, "messages", plain_data(script_messages(exported)))


def start_sd(exported: ExportedPlan) -> float:
    """Standard deviation of the position at the start [m], at least the one of a good survey."""
    log = exported.log
    return max(math.hypot(log.major[0], log.minor[0]) / math.sqrt(2.0), LEAST_SD)


def prologue(lat: float, lon: float, sd: float) -> list[dict[str, Any]]:
    """What an aeroplane without satellites must hear before its departure: origin, home, position.

    ``z`` is the height of the ground above mean sea level [m], which the sender fills in.
    """
    place = {"x": round(lat * DEGREE), "y": round(lon * DEGREE), "z": None, "fill_in": ["z"]}
    home = {"message": "COMMAND_INT", "command": SET_HOME, "name": NAMES[SET_HOME], "frame": GLOBAL}
    at = home | {"command": POSITION_ESTIMATE, "name": NAMES[POSITION_ESTIMATE]}
    return [
        {"message": SET_ORIGIN, "name": SET_ORIGIN, **place},
        home | {"params": [0, 0, 0, 0], **place},
        at | {"params": [0, 0, sd, 0], **place, "fill_in": []},
    ]


def first_wind(exported: ExportedPlan) -> list[dict[str, Any]]:
    """The wind of the first leg, if it is uncertain, to be sent on the ground: PX4 takes none in the air."""
    log = exported.log
    if not log.legs or not log.wind_speed_sd[0] > 0.0:  # an estimate without an error would claim certainty
        return []
    return [{
        "message": "COMMAND_LONG", "command": WIND_ESTIMATE, "name": NAMES[WIND_ESTIMATE],
        "params": [*_wind(exported, 0), 0, 0, 0],
    }]  # fmt: skip


def _wind(exported: ExportedPlan, k: int) -> list[float]:
    """Speed [m/s], its sd, direction it comes from [deg] and its sd of the wind of leg ``k``."""
    log = exported.log
    columns = (log.wind_speed, log.wind_speed_sd, log.wind_from, log.wind_from_sd)
    return [float(column[k]) for column in columns]


def script_messages(exported: ExportedPlan) -> list[dict[str, Any]]:
    """At the start of each leg wind if uncertain, airspeed, heading; at a fix of the plan, the position.

    Airspeeds are calibrated, as ArduPilot holds them.
    """
    log, messages = exported.log, list[dict[str, Any]]()

    def add(k: int, command: int, *params: float) -> None:
        messages.append({
            "t": log.t[k], "utc": log.time_utc(k), "message": "COMMAND_LONG", "command": command,
            "name": NAMES[command], "params": list(params),
        })  # fmt: skip

    for k in range(log.legs + 1):
        if k in log.fixes:  # x and y are latitude and longitude in 1e-7 degrees, ``params`` are params 1 to 4
            sd = math.hypot(log.major[k], log.minor[k]) / math.sqrt(2.0)
            add(k, POSITION_ESTIMATE, log.t[k], 0, sd, 0)
            messages[-1] |= {
                "message": "COMMAND_INT", "frame": GLOBAL, "x": round(log.lat[k] * DEGREE),
                "y": round(log.lon[k] * DEGREE), "z": None, "fill_in": ["params", "x", "y"],
            }  # fmt: skip
        if k == log.legs:
            break
        if log.wind_speed_sd[k] > 0.0:
            add(k, WIND_ESTIMATE, *_wind(exported, k), 0, 0, 0)
        add(k, CHANGE_SPEED, AIRSPEED, exported.autopilot_airspeed[k], AT_ONCE, 0, 0, 0, 0)
        if math.isfinite(log.heading[k]):
            add(k, CHANGE_HEADING, HEADING, log.heading[k], turn_of(exported), 0, 0, 0, 0)
    return messages


def turn_of(exported: ExportedPlan) -> float:
    """Centripetal acceleration of turns [m/s²] for the autopilot."""
    return TURN if exported.turn is None else exported.turn


# --- a script for ArduPlane -----------------------------------------------------------------------

TEMPLATE = "plan.lua"
NO_HEADING = -1.0  # of a leg without airspeed


def plan_lua(exported: ExportedPlan) -> bytes:
    """The script; :file:`plan.lua` of this folder with the table of the plan.

    Raises
    ------
    DataError
        If the plan counts on position fixes: nothing in the script would give them to the autopilot.
    """
    log = exported.log
    if log.fixes:
        raise DataError(
            "plan.lua: the plan counts on position fixes at landmarks, which a script cannot measure; use "
            "mavlink_script.json"
        )
    legs = _lua_legs(log, exported.autopilot_airspeed)
    about = "\n".join([exported.name, *exported.sentences()]).replace("]]", "] ]")  # which ends a comment
    values = {
        "@TEXT@": about, "@LEGS@": "\n".join(legs), "@LAT@": str(round(log.lat[0] * DEGREE)),
        "@LON@": str(round(log.lon[0] * DEGREE)), "@SD@": _number(start_sd(exported)),
        "@END@": _number(log.t[-1]), "@TURN@": _number(turn_of(exported)),
        **_lua_branches(exported),
    }  # fmt: skip
    return _filled(TEMPLATE, values).encode()


def _filled(template: str, values: Mapping[str, str]) -> str:
    """The file ``template`` of this folder with ``values`` in the place of their names."""
    text = files("pareto_ltl_apps.exports").joinpath(template).read_text(encoding="utf-8")
    for key, value in values.items():
        text = text.replace(key, value)
    return text


def _lua_legs(log: NavigationLog, airspeed: FloatArray, indent: str = "    ") -> list[str]:
    """The legs of ``log`` as rows of a table of Lua."""
    columns = (
        log.t[:-1], airspeed, log.heading, log.wind_speed, log.wind_speed_sd, log.wind_from,
        log.wind_from_sd,
    )  # fmt: skip
    return [f"{indent}{{ {', '.join(map(_number, row))} }}," for row in zip(*columns, strict=True)]


def _lua_branches(exported: ExportedPlan) -> dict[str, str]:
    """What the script needs to branch: the tree of its tables, the choice; empty without branches."""
    tree = exported.plan.branching
    if tree is None:
        return dict.fromkeys(("@BRANCHES@", "@CHOOSER@", "@CHOOSE@", "@RESET@", "@CHANGED@"), "")
    rejoins = any(one.tree.fix.rejoin for one in exported.branches)
    legs = {"@TREE@": "\n".join(_lua_tree(exported, tree, "    ")), "@REJOINED@": ""}
    if rejoins:
        legs["@REJOINED@"] = _lua_airspeeds(exported) + _filled("rejoin.lua", {})
    return {
        "@BRANCHES@": "\n" + _filled("branches.lua", legs),
        "@CHOOSER@": _filled(
            "branch_choice.lua", {"@REJOIN@": _filled("rejoin_choice.lua", {}) if rejoins else ""}
        ),
        "@CHOOSE@": "    choose(time)\n",
        "@RESET@": f"        here, level, LEGS, END{', change' * rejoins} = ROOT, 1, PLAN, PLAN_END"
        f"{', nil' * rejoins}\n",
        "@CHANGED@": "    airspeed, heading = rejoined(LEGS[number][1], airspeed, heading)\n" * rejoins,
    }


def _lua_airspeeds(exported: ExportedPlan) -> str:
    """The limits of the true airspeed, and its ratio to the airspeed of the legs, as variables of Lua."""
    (slowest, fastest), air = exported.airspeeds, exported.air
    ratio = 1.0 if air is None else fastest / float(air.calibrated(np.array([fastest]))[0])
    values = (("SLOWEST", slowest), ("FASTEST", fastest), ("RATIO", ratio))
    what = "true airspeeds [m/s]; true to calibrated airspeed"
    names, numbers = zip(*((name, _number(value)) for name, value in values), strict=True)
    return f"local {', '.join(names)} = {', '.join(numbers)} -- {what}\n"


def _lua_tree(exported: ExportedPlan, tree: Branching, indent: str) -> Iterator[str]:
    """Fix and branches of ``tree`` as entries of a table of Lua; a branch that branches again has its own."""
    frame, fix, dt = exported.scene.frame, tree.fix, exported.plan.dt
    lon, lat = (float(part[0]) for part in frame.to_geographic(fix.place[None]))
    moment, rejoins = fix.step * dt, any(one.tree.fix.rejoin for one in exported.branches)
    yield (
        f"{indent}fix = {{ t = {_number(moment)}, last = {_number(moment + 0.5 * dt)}, "
        f"lat = {round(lat * DEGREE)}, lng = {round(lon * DEGREE)}, "
        f"track = {_number(track_bearing(frame, tree))}"
        f"{f', rejoin = {_number(fix.rejoin * dt)}, counter = {_number(fix.counter)}' if rejoins else ''} }},"
    )
    yield f"{indent}branches = {{"
    inside = indent + "    "
    for one in exported.branches:
        if one.tree is not tree:
            continue
        cell = one.branch.cell
        airspeed = one.log.airspeed if exported.air is None else one.log.calibrated
        along, left = (", ".join(map(_end_text, ends)) for ends in (cell.along, cell.left))
        yield f"{inside}{{"
        yield (
            f'{inside}    name = "{one.name}", along = {{ {along} }}, left = {{ {left} }}, '
            f"t_end = {_number(one.log.t[-1])},"
        )
        yield f"{inside}    legs = {{"
        yield from _lua_legs(one.log, airspeed, inside + "        ")
        yield f"{inside}    }},"
        if one.branch.then is not None:
            yield from _lua_tree(exported, one.branch.then, inside + "    ")
        yield f"{inside}}},"
    yield f"{indent}}},"


def _end_text(end: float) -> str:
    """An end of an interval [m] in Lua."""
    return _number(end) if math.isfinite(end) else "math.huge" if end > 0.0 else "-math.huge"


def _number(value: float) -> str:
    """Six digits and more: numbers are single precision in ArduPilot's Lua."""
    return f"{NO_HEADING if math.isnan(value) else value:.9g}"
