"""Claims about the exported routes: places, times and speeds agree with plan.json."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime, timedelta
from functools import partial
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from careful_io.reading import read_text
from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, no_fault
from pareto_ltl_verify.evidence import Evidence

METRE, SECOND = 1.0, 1.0  # largest allowed difference of two places [m] and of two times [s]
TABLE = "dead_reckoning.csv"
WAYPOINT, CHANGE_SPEED = 16, 178  # MAV_CMD
LEAST_CHANGE = 0.051  # [m/s] changes of airspeed up to 0.05 m/s have no item
GPX = {"": "http://www.topografix.com/GPX/1/1"}
KML = {"": "http://www.opengis.net/kml/2.2"}
FPL = {"": "http://www8.garmin.com/xmlschemas/FlightPlan/v1"}
Rows = Sequence[dict[str, str]]


# --- formats ----------------------------------------------------------------------------------


class Route(NamedTuple):
    """Text of a file, its places (longitude, latitude [deg]), their times, and each leg's speed [m/s].

    ``times`` and ``speed`` are None in files that do not have them. The speed is the true airspeed, in a
    mission the speed that its autopilot holds.
    """

    text: str | None
    places: Sequence[Sequence[Any]]
    times: Sequence[str | None] | None = None
    speed: Sequence[float] | None = None


def xml_root(result: Evidence, name: str) -> ElementTree.Element:
    """The root of an XML file; ValueError if the file is not XML."""
    try:
        return ElementTree.fromstring(read_text(result.directory / name))
    except ElementTree.ParseError as error:
        raise ValueError(f"{name} is not XML: {error}") from None


def _gpx(result: Evidence) -> Route:
    root = xml_root(result, "plan.gpx")
    points = root.findall(".//rtept", GPX)
    places = [(point.get("lon"), point.get("lat")) for point in points]
    times = [point.findtext("time", None, GPX) for point in points]
    return Route(root.findtext("metadata/desc", None, GPX), places, times)


def _kml(result: Evidence) -> Route:
    root = xml_root(result, "plan.kml")
    marks = root.findall(".//Placemark[Point]", KML)
    places = [str(mark.findtext("Point/coordinates", None, KML)).split(",") for mark in marks]
    times = [mark.findtext("TimeStamp/when", None, KML) for mark in marks]
    return Route(root.findtext("Document/description", None, KML), places, times)


def _fpl(result: Evidence) -> Route:
    root = xml_root(result, "plan.fpl")
    points = {point.findtext("identifier", None, FPL): point for point in root.findall(".//waypoint", FPL)}
    flown = [points[name.text] for name in root.findall(".//route-point/waypoint-identifier", FPL)]
    places = [[point.findtext(key, None, FPL) for key in ("lon", "lat")] for point in flown]
    return Route(root.findtext("file-description", None, FPL), places)


def _geojson(result: Evidence) -> Route:
    content = result.document("plan.geojson")
    positions = [f for f in content["features"] if f["properties"]["role"] == "position"]
    places = [f["geometry"]["coordinates"] for f in positions]
    times = [f["properties"]["time_utc"] for f in positions]
    return Route(content["description"], places, times)


def _trajectory(result: Evidence) -> Route:
    from careful_io.netcdf4 import opened_netcdf

    with opened_netcdf(result.directory / "trajectory.nc") as file:
        lon, lat, t, airspeed = (
            np.asarray(file[key][...], float).tolist() for key in ("lon", "lat", "time", "airspeed")
        )
        since = str(file["time"].attrs["units"]).removeprefix("seconds since ")
        text = str(file.attrs["comment"])
    zero = datetime.fromisoformat(f"{since}+00:00")
    times = [(zero + timedelta(seconds=s)).isoformat() for s in t]
    return Route(text, list(zip(lon, lat, strict=True)), times, airspeed[:-1])


def _mission(result: Evidence) -> Route:
    content = result.document("mission.plan")
    places, airspeed, speed = [content["mission"]["plannedHomePosition"]], list[float](), 0.0
    for item in content["mission"]["items"]:
        if item["command"] == CHANGE_SPEED:
            speed = item["params"][1]
        elif item["command"] == WAYPOINT:
            places.append(item["params"][4:])
            airspeed.append(speed)
    return Route(content["pareto_ltl"]["note"], [(lon, lat) for lat, lon, *_ in places], None, airspeed)


ROUTES: dict[str, Callable[[Evidence], Route]] = {
    "plan.gpx": _gpx, "plan.kml": _kml, "plan.geojson": _geojson, "trajectory.nc": _trajectory,
    "mission.plan": _mission, "plan.fpl": _fpl,
}  # fmt: skip


# --- places and times -------------------------------------------------------------------------


def place_faults(result: Evidence, places: Iterable[Sequence[Any]]) -> list[str]:
    """Steps whose place differs from plan.json, or from the table if the aircraft banks."""
    from pyproj import Geod

    if result.plan["lat"] is None:
        return ["the plan has no place on Earth"]
    stated = np.array([list(map(float, place[:2])) for place in places]).reshape(-1, 2).T
    rows = result.table(TABLE) if _banks(result) else []
    true = np.array([result.plan["lon"], result.plan["lat"]], float)
    true = lonlat(rows).T if rows else true
    if stated.shape != true.shape:
        return [f"{stated.shape[1]} places, not {true.shape[1]}"]
    gap = np.asarray(Geod(ellps="WGS84").inv(*stated, *true)[2])
    return [f"step {t}: {gap[t]:.3g} m off" for t in np.flatnonzero(~(gap <= METRE))]


def _banks(result: Evidence) -> bool:
    """Whether turns move the places and times of legs and the table holds the moved ones.

    A separate claim judges that table.
    """
    return result.robot.bank > 0.0 and result.has(TABLE)


def time_faults(result: Evidence, stated: Sequence[str | None]) -> list[str]:
    """Steps whose time differs from plan.json; if the plan has no times, its files must have none."""
    plan = result.plan["time_utc"]
    if plan is None:
        return [] if not any(stated) else ["times, and the plan has none"]
    if _banks(result):
        plan = [row["time_utc"] for row in result.table(TABLE)]
    elif result.robot.bank > 0.0:
        return []  # turns make them later than in the plan; without the table the delay is unknown
    if len(stated) != len(plan):
        return [f"{len(stated)} times, not {len(plan)}"]
    pairs = zip(stated, plan, strict=True)
    gaps = [datetime.fromisoformat(str(a)) - datetime.fromisoformat(b) for a, b in pairs]
    late = [abs(gap.total_seconds()) for gap in gaps]
    return [f"step {t}: {gap:.3g} s off" for t, gap in enumerate(late) if not gap <= SECOND]


def route(name: str, result: Evidence) -> Verdict:
    """Places, times and speeds of an exported file; of a mission also cruise speeds."""
    _, places, times, held = ROUTES[name](result)
    faults = place_faults(result, places)
    if times is not None:
        faults += time_faults(result, times)
    if held is not None:
        speed = held_speed(result) if name == "mission.plan" else np.hypot(*result.u.T)
        known = speed > 0.0  # a leg without airspeed has none in mission.plan
        stated = np.where(known, held, 0.0) if len(held) == len(speed) else held
        faults += unlike_at("leg {}: speed", stated, speed, LEAST_CHANGE)
    if name == "mission.plan":
        cruise = [result.document(name)["mission"][key] for key in ("cruiseSpeed", "hoverSpeed")]
        faults += unlike_at("cruise speed {}", cruise, [held_speed(result).max(initial=0.0)] * 2)
    return no_fault(f"{len(places)} positions", faults)


def held_speed(result: Evidence) -> FloatArray:
    """Speed (T,) [m/s] that the autopilot of a mission holds: calibrated, of a multirotor over ground."""
    from pyproj import Geod

    if (result.settings["robot"].get("power") or {}).get("kind") == "rotor":
        lat, lon = np.array(result.plan["lat"], float), np.array(result.plan["lon"], float)
        ways = np.asarray(Geod(ellps="WGS84").inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2], float)
        return np.asarray(ways / np.diff(np.array(result.plan["t"], float)))
    return stated_airspeed(result)


def stated_airspeed(result: Evidence) -> FloatArray:
    """Calibrated airspeeds (T,) [m/s] of plan.json, which another claim judges; in the water the speeds."""
    calibrated = result.plan.get("airspeed_calibrated")
    return np.hypot(*result.u.T) if calibrated is None else np.array(calibrated, float)


# --- numbers ----------------------------------------------------------------------------------


def column(rows: Rows, key: str) -> FloatArray:
    """Numbers (P,) of a column; NaN where it is empty."""
    return np.array([float(row[key]) if row[key] else math.nan for row in rows])


def lonlat(rows: Rows) -> FloatArray:
    """Longitudes and latitudes (P, 2) [deg] of the rows."""
    return np.column_stack([column(rows, "lon_deg"), column(rows, "lat_deg")])


def unlike_at(
    fault: str, stated: Iterable[Any], wanted: Iterable[Any], least: float = 1e-6, share: float = 1e-4
) -> list[str]:
    """``fault`` with the number of entries that are off by more than ``share`` of the value and ``least``."""
    a, b = np.array(list(stated), float), np.array(list(wanted), float)
    if a.shape != b.shape:
        return [fault.format(min(len(a), len(b)))]
    return [fault.format(k) for k in np.flatnonzero(~(np.abs(a - b) <= np.maximum(share * np.abs(b), least)))]


PLAN = ("plan.json", "scene.json")
CLAIMS: tuple[Claim, ...] = tuple(
    Claim(f"exports: {name}", (name, *PLAN, "cells.json", "automaton.json"), partial(route, name))
    for name in ROUTES
)
