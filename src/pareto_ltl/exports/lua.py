"""``plan.lua``: the table as a script that ArduPlane runs, without a companion computer."""

from __future__ import annotations

import math
from importlib.resources import files

from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.exports.mavlink import DEGREE, TURN, start_sd
from pareto_ltl.support.errors import DataError

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
    columns = (
        log.t[:-1], log.airspeed, log.heading, log.wind_speed, log.wind_speed_sd, log.wind_from,
        log.wind_from_sd,
    )  # fmt: skip
    legs = ["    { " + ", ".join(map(_number, row)) + " }," for row in zip(*columns, strict=True)]
    turn = TURN if exported.turn is None else exported.turn
    values = {
        "@TEXT@": _comment("\n".join([exported.name, *exported.sentences()])), "@LEGS@": "\n".join(legs),
        "@LAT@": str(round(log.lat[0] * DEGREE)), "@LON@": str(round(log.lon[0] * DEGREE)),
        "@SD@": _number(start_sd(exported)), "@END@": _number(log.t[-1]), "@TURN@": _number(turn),
    }  # fmt: skip
    text = files("pareto_ltl.exports").joinpath(TEMPLATE).read_text(encoding="utf-8")
    for key, value in values.items():
        text = text.replace(key, value)
    return text.encode()


def _number(value: float) -> str:
    """Six digits and more: numbers are single precision in ArduPilot's Lua."""
    return f"{NO_HEADING if math.isnan(value) else value:.9g}"


def _comment(text: str) -> str:
    """``text`` without what would end the comment."""
    return text.replace("]]", "] ]")
