"""Claims about the exported files: places, times, legs and fences agree with plan.json and the map."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime, timedelta
from functools import partial
from itertools import takewhile
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.special import ndtr

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.reading import read_text
from pareto_ltl_verify.claims import Claim, Verdict, close, no_fault, same, unlike
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.geometry import azimuths, in_plane, on_earth, outline_distance
from pareto_ltl_verify.robot import fly_table

METRE, SECOND = 1.0, 1.0  # largest allowed difference of two places [m] and of two times [s]
ANGLE = 0.01  # [deg] largest allowed difference of two directions
RADIUS = 0.95  # share of the positions within radius_95_m
TABLE, CARD = "dead_reckoning.csv", "flight_card.csv"
WAYPOINT, CHANGE_SPEED, AIRSPEED, HEADING = 16, 178, 43000, 43002  # MAV_CMD
INEXACT = 0.01  # [m/s] error of the wind of a leg: the motion of a step is exact to 0.5 m only
LEAST_CHANGE = 0.051  # [m/s] changes of airspeed up to 0.05 m/s have no item
GPX = {"": "http://www.topografix.com/GPX/1/1"}
KML = {"": "http://www.opengis.net/kml/2.2"}
FPL = {"": "http://www8.garmin.com/xmlschemas/FlightPlan/v1"}
ROUNDED = (
    ("lat_deg", "lat_deg", 1.0, 5.1e-5),
    ("lon_deg", "lon_deg", 1.0, 5.1e-5),
    ("radius_95_km", "radius_95_m", 1e3, 51.0),
    ("t_s", "t_s", 1.0, 0.51),
)  # fmt: skip - columns of the card and of the table, their ratio, and the largest difference
AIRSPEEDS = ("airspeed_cas_m_s", "airspeed_tas_m_s")
SUMMED = (("duration_s", "duration_s", 1.0, 0.51), ("distance_km", "distance_m", 1e3, 51.0))
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
    from pareto_ltl.support.netcdf4 import opened_netcdf

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
    """Places, times and speeds of an exported file; of a mission also fences and cruise speeds."""
    _, places, times, held = ROUTES[name](result)
    faults = place_faults(result, places)
    if times is not None:
        faults += time_faults(result, times)
    if held is not None:
        speed = _held_speed(result) if name == "mission.plan" else np.hypot(*result.u.T)
        known = speed > 0.0  # a leg without airspeed has none in mission.plan
        stated = np.where(known, held, 0.0) if len(held) == len(speed) else held
        faults += unlike_at("leg {}: speed", stated, speed, LEAST_CHANGE)
    faults += _mission_faults(result) if name == "mission.plan" else []
    return no_fault(f"{len(places)} positions", faults)


def _held_speed(result: Evidence) -> FloatArray:
    """Speed (T,) [m/s] that the autopilot of a mission holds: calibrated, of a multirotor over ground."""
    from pyproj import Geod

    if (result.settings["robot"].get("power") or {}).get("kind") == "rotor":
        lat, lon = np.array(result.plan["lat"], float), np.array(result.plan["lon"], float)
        ways = np.asarray(Geod(ellps="WGS84").inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2], float)
        return np.asarray(ways / np.diff(np.array(result.plan["t"], float)))
    return _told_speed(result)


def _told_speed(result: Evidence) -> FloatArray:
    """Calibrated airspeeds (T,) [m/s] of plan.json, which another claim judges; in the water the speeds."""
    calibrated = result.plan.get("airspeed_calibrated")
    return np.hypot(*result.u.T) if calibrated is None else np.array(calibrated, float)


# --- legs -------------------------------------------------------------------------------------


def dead_reckoning(result: Evidence) -> Verdict:
    """Places, times, headings, airspeeds and expected winds of the table agree with plan.json.

    The wind of a leg is the one with which the controls lead from one expected position to the next.
    """
    rows, robot, x, crs = result.table(TABLE), result.robot, result.x, result.scene["crs"]
    if len(rows) != len(x):
        return same(f"{len(rows)} rows", f"{len(x)} rows")
    legs = rows[:-1]
    law = result.law(result.planned_law)
    wind = (x[1:] - x[:-1] @ robot.a.T) / robot.dt - result.u @ robot.b.T
    faults = _flown_with_turns(result, rows, wind) if robot.bank > 0.0 else _flown_on_the_spot(result, rows)
    faults += [f"{row['wind_law']} winds" for row in rows[:1] if row["wind_law"] != result.planned_law]
    if faults:
        return no_fault(f"{len(rows)} rows", faults)
    speed, course = np.hypot(*wind.T), result.course
    of_wind = course.psi[:, :, : law.modes]
    sd = np.sqrt(((of_wind**2).sum(axis=2) + course.white).mean(axis=1))
    return no_fault(
        f"{len(rows)} rows",
        unlike_at("leg {}: airspeed_tas_m_s", column(legs, "airspeed_tas_m_s"), np.hypot(*result.u.T)),
        _calibrated_faults(result, legs),
        unlike_at("leg {}: wind_m_s", column(legs, "wind_m_s"), speed, INEXACT),
        unlike_at("leg {}: wind_sd_m_s", column(legs, "wind_sd_m_s"), sd, INEXACT),
        _direction_faults(legs, "wind_from_deg", azimuths(crs, x[:-1], -wind), speed),
    )


def _calibrated_faults(result: Evidence, legs: Rows) -> list[str]:
    """Legs whose calibrated airspeed differs from plan.json; in the water there are none."""
    stated = column(legs, "airspeed_cas_m_s")
    if result.plan.get("airspeed_calibrated") is None:
        return [f"leg {k}: airspeed_cas_m_s" for k in np.flatnonzero(np.isfinite(stated))]
    return unlike_at("leg {}: airspeed_cas_m_s", stated, _told_speed(result))


def _flown_on_the_spot(result: Evidence, rows: Rows) -> list[str]:
    """Faults of places, times and headings, for a robot whose turns take no time."""
    middle = 0.5 * (result.x[:-1] + result.x[1:])
    heading = azimuths(result.scene["crs"], middle, result.u)
    return [
        *place_faults(result, lonlat(rows)),
        *time_faults(result, [row["time_utc"] or None for row in rows]),
        *unlike_at("leg {}: duration_s", column(rows[:-1], "duration_s"), np.diff(result.plan["t"])),
        *_direction_faults(rows[:-1], "heading_true_deg", heading, np.hypot(*result.u.T)),
    ]


def _flown_with_turns(result: Evidence, rows: Rows, wind: FloatArray) -> list[str]:
    """Faults of places, times and headings, for an aircraft that banks.

    Each leg, integrated in small time steps, must end at the next place of the table. That place is the
    planned one unless the leg is too short for its turn.
    """
    keys, crs, plan = ("heading_true_deg", "airspeed_tas_m_s", "duration_s"), result.scene["crs"], result.plan
    heading, airspeed, duration = (column(rows[:-1], key) for key in keys)
    places = in_plane(crs, lonlat(rows))
    north = azimuths(crs, 0.5 * (places[:-1] + places[1:]), np.tile([0.0, 1.0], (len(heading), 1)))
    ways, roomy = fly_table(result.robot, np.deg2rad(90.0 + north - heading), airspeed, duration, wind)
    off = np.linalg.norm(places[:-1] + ways - places[1:], axis=1)
    moved = np.where(np.append(True, roomy), np.linalg.norm(places - result.x, axis=1), 0.0)
    t = plan["t"][0] + np.append(0.0, np.cumsum(duration))
    late = np.zeros(len(t))
    if plan["time_utc"] is not None:
        begin = datetime.fromisoformat(plan["time_utc"][0])
        elapsed = [datetime.fromisoformat(row["time_utc"]) - begin for row in rows]
        late = np.abs(np.array([gap.total_seconds() for gap in elapsed]) - (t - t[0]))
    return [
        *(f"leg {k} ends {off[k]:.3g} m from the next place" for k in np.flatnonzero(~(off <= METRE))),
        *(f"step {k}: {moved[k]:.3g} m off" for k in np.flatnonzero(~(moved <= METRE))),
        *unlike_at("step {}: t_s", column(rows, "t_s"), t, 1e-3),
        *(f"step {k}: {late[k]:.3g} s off" for k in np.flatnonzero(~(late <= SECOND))),
    ]


def _direction_faults(legs: Rows, key: str, values: FloatArray, size: FloatArray) -> list[str]:
    """Legs whose direction in column ``key`` differs from ``values`` (T,) [deg].

    Vectors whose ``size`` (T,) [m/s] is at most 0.1 have no direction that is judged.
    """
    gap = np.abs((column(legs, key) - values + 180.0) % 360.0 - 180.0)
    bad = (size > 0.1) & ~(gap <= ANGLE * (1 + 10 / np.maximum(size, 0.1)))
    return [f"leg {k}: {key}" for k in np.flatnonzero(bad)]


def spreads(result: Evidence) -> Verdict:
    """Ellipses and radii of the table follow from the covariances of plan.json."""
    rows, cov = result.table(TABLE), np.array(result.plan["cov"], float)
    minor, major = np.sqrt(np.maximum(np.linalg.eigvalsh(cov), 0.0)).T
    radii = column(rows, "radius_95_m")
    if len(radii) != len(cov):
        return same(f"{len(rows)} rows", f"{len(cov)} rows")
    held = [held_within(*sizes) for sizes in zip(radii.tolist(), major.tolist(), minor.tolist(), strict=True)]
    wrong = (np.maximum(major, radii) > 1e-6) & ~(np.abs(np.array(held) - RADIUS) <= 1e-3)
    return no_fault(
        f"radius {radii[-1]:.4g} m at the end",
        unlike_at("row {}: major axis", column(rows, "ellipse_major_m"), major, 1e-3),
        unlike_at("row {}: minor axis", column(rows, "ellipse_minor_m"), minor, 1e-3),
        (f"row {k}: the radius holds {held[k]:.4g}" for k in np.flatnonzero(wrong)),
    )


def held_within(radius: float, major: float, minor: float) -> float:
    """Probability that a Gaussian with these standard deviations [m] lies within ``radius`` [m]::

    ∫ φ(z) P(|e_minor| <= √(r² - major² z²)) dz
    """
    if major <= 0.0:
        return 1.0
    edge = radius / major
    angle = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 4001)
    z = edge * np.sin(angle)  # with this substitution the square root is smooth at the edge
    rest = edge * major * np.cos(angle)
    inside = 2.0 * ndtr(rest / max(minor, 1e-9)) - 1.0
    density = np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi) * edge * np.cos(angle)
    return float(np.trapezoid(density * inside, angle))


def messages(result: Evidence) -> Verdict:
    """Headings, airspeeds and times of the MAVLink script agree with the table."""
    script = result.document("mavlink_script.json")
    rows = result.table(TABLE)[:-1]
    faults = unlike(script, {"wind_law": result.planned_law})
    told = "airspeed_tas_m_s" if result.plan.get("airspeed_calibrated") is None else "airspeed_cas_m_s"
    for command, key in ((AIRSPEED, told), (HEADING, "heading_true_deg")):
        sent = {float(m["t"]): float(m["params"][1]) for m in script["messages"] if m["command"] == command}
        stated = {float(row["t_s"]): float(row[key]) for row in rows if row[key]}
        faults += [f"{key} at {t:g} s, where no leg begins" for t in sent if t not in stated]
        wrong = [t for t in stated if not close(sent.get(t, math.nan), stated[t], 1e-9, 1e-9)]
        faults += [f"{key} at {t:g} s" for t in wrong]
    return no_fault(f"{len(script['messages'])} messages", faults)


# --- the mission of an autopilot --------------------------------------------------------------


def _mission_faults(result: Evidence) -> list[str]:
    """Fences are the obstacles and, if border=wall, the border; cruise speeds are the largest of the plan."""
    content, crs = result.document("mission.plan"), result.scene["crs"]
    speeds = [content["mission"][key] for key in ("cruiseSpeed", "hoverSpeed")]
    faults = unlike_at("cruise speed {}", speeds, [_held_speed(result).max(initial=0.0)] * 2)
    (west, south), (east, north) = result.scene["bounds"]
    map_ = np.array([(west, south), (east, south), (east, north), (west, north)])
    areas = [(False, np.array(corners)) for corners in result.scene["obstacles"]]
    if result.ground.walled and not _crosses_180(crs, map_):  # no area to stay in can be cut
        areas.insert(0, (True, map_))
    fences = content["geoFence"]["polygons"]
    drawn = [in_plane(crs, np.array(fence["polygon"], float)[:, ::-1]) for fence in fences]
    for number, (inside, corners) in enumerate(areas):
        parts = 1 + (_crosses_180(crs, corners) and _parts_of(corners, drawn[1:]))
        points = np.concatenate(drawn[:parts]) if drawn else np.full((1, 2), np.inf)
        nearest = np.linalg.norm(corners[:, None] - points, axis=2).min(axis=1)
        off = nearest.max() > METRE or outline_distance(corners, points).max() > 50 * METRE
        other = any(fence["inclusion"] != inside for fence in fences[:parts])
        faults += [f"fence of area {number}"] * bool(other or off)
        drawn, fences = drawn[parts:], fences[parts:]
    return [*faults, *[f"{len(drawn)} fences more"] * bool(drawn)]


def _parts_of(corners: FloatArray, drawn: list[FloatArray]) -> int:
    """How many of the first polygons of ``drawn`` lie on the outline through ``corners``."""
    on = (outline_distance(corners, points).max() <= 50 * METRE for points in drawn)
    return sum(1 for _ in takewhile(bool, on))


def _crosses_180(crs: str, corners: FloatArray) -> bool:
    """Whether the 180th meridian crosses the outline through ``corners`` (n, 2) [m]; no pole is inside."""
    ends = np.roll(corners, -1, axis=0)
    points = corners[:, None] + np.linspace(0.0, 1.0, 200)[:, None] * (ends - corners)[:, None]
    lon, _ = on_earth(crs, points.reshape(-1, 2))
    turned = np.unwrap(np.deg2rad(lon))
    return bool(np.abs(np.diff(lon)).max() > 180.0 and abs(turned[-1] - turned[0]) < np.pi)


# --- the card of a pilot ----------------------------------------------------------------------


def flight_card(result: Evidence) -> Verdict:
    """Each row is the legs that it names, by ``dead_reckoning.csv``, in whole seconds and degrees."""
    rows, legs = result.table(CARD), result.table(TABLE)
    faults, after = list[str](), 0
    for row in rows:
        first, _, last = row["legs"].partition("-")
        leg = legs[int(first)]
        off = [key for key, of, unit, most in ROUNDED if abs(unit * float(row[key]) - float(leg[of])) > most]
        off += ["time_utc"] * (row["time_utc"] != leg["time_utc"])
        if row is not rows[-1]:
            own = legs[int(first) : int(last or first) + 1]
            off += ["numbers"] * (int(first) != after) + _sums_off(row, own)
            after += len(own)
        faults += [f"{what} of leg {row['legs']}" for what in off]
    faults += [f"{after} of {len(legs) - 1} legs"] * (after != len(legs) - 1)
    return no_fault(f"{len(rows)} rows", faults)


def _sums_off(row: dict[str, str], legs: Rows) -> list[str]:
    """Columns of a row of the card that are not the sum of its legs, or what they have in common."""
    digits = max(len(row["airspeed_tas_m_s"].partition(".")[2]), 1)
    common = {"heading_true_deg": {_whole_heading(leg) for leg in legs}}
    common |= {key: {_rounded(leg[key], digits) for leg in legs} for key in AIRSPEEDS}
    off = [key for key, values in common.items() if values != {row[key]}]
    sums = [(key, unit * float(row[key]) - column(legs, of).sum(), most) for key, of, unit, most in SUMMED]
    return off + [key for key, gap, most in sums if not abs(gap) <= most]


def _rounded(text: str, digits: int) -> str:
    return f"{float(text):.{digits}f}" if text else ""


def _whole_heading(leg: dict[str, str]) -> str:
    return f"{round(float(leg['heading_true_deg'])) % 360:d}" if leg["heading_true_deg"] else ""


# --- numbers ----------------------------------------------------------------------------------


def column(rows: Rows, key: str) -> FloatArray:
    """Numbers (P,) of a column; NaN where it is empty."""
    return np.array([float(row[key]) if row[key] else math.nan for row in rows])


def lonlat(rows: Rows) -> FloatArray:
    """Longitudes and latitudes (P, 2) [deg] of the rows."""
    return np.column_stack([column(rows, "lon_deg"), column(rows, "lat_deg")])


def unlike_at(fault: str, stated: Iterable[Any], wanted: Iterable[Any], least: float = 1e-6) -> list[str]:
    """``fault`` with the number of each entry that differs by more than 10⁻⁴ of its value and ``least``."""
    a, b = np.array(list(stated), float), np.array(list(wanted), float)
    if a.shape != b.shape:
        return [fault.format(min(len(a), len(b)))]
    return [fault.format(k) for k in np.flatnonzero(~(np.abs(a - b) <= np.maximum(1e-4 * np.abs(b), least)))]


PLAN = ("plan.json", "scene.json")
CLAIMS = (
    Claim("exports: dead_reckoning.csv", (TABLE, *PLAN, "wind.nc"), dead_reckoning),
    Claim("exports: flight_card.csv", (CARD, TABLE, *PLAN), flight_card),
    Claim("exports: ellipses and radii", (TABLE, *PLAN), spreads),
    *(
        Claim(f"exports: {name}", (name, *PLAN, "cells.json", "automaton.json"), partial(route, name))
        for name in ROUTES
    ),
    Claim("exports: mavlink_script.json", ("mavlink_script.json", TABLE, *PLAN), messages),
)
