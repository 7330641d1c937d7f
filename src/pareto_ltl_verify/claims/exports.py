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
from pareto_ltl.support.reading import read_json, read_text
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, no_fault
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.geometry import outline_distance
from pareto_ltl_verify.turns import fly_table

METRE, SECOND = 1.0, 1.0  # largest allowed difference of two places [m] and of two times [s]
ANGLE = 0.01  # [deg] largest allowed difference of two directions
AHEAD = 1.0  # [m] distance from a place to the second point that gives the direction there
RADIUS = 0.95  # share of the positions within radius_95_m
TABLE, CARD = "dead_reckoning.csv", "flight_card.csv"
WAYPOINT, CHANGE_SPEED, AIRSPEED, HEADING = 16, 178, 43000, 43002  # MAV_CMD
LEAST_CHANGE = 0.051  # [m/s] changes of airspeed up to 0.05 m/s have no item
NAMESPACES = {
    "gpx": "{http://www.topografix.com/GPX/1/1}",
    "kml": "{http://www.opengis.net/kml/2.2}",
    "fpl": "{http://www8.garmin.com/xmlschemas/FlightPlan/v1}",
}


# --- places and times -------------------------------------------------------------------------


def place_faults(result: Evidence, lat: Iterable[Any], lon: Iterable[Any], first: int = 0) -> list[str]:
    """Steps from ``first`` on whose place differs from plan.json, or from the table if the aircraft banks."""
    from pyproj import Geod

    if result.plan["lat"] is None:
        return ["the plan has no place on Earth"]
    stated = np.array([list(map(float, lon)), list(map(float, lat))])
    if _banks(result):
        rows = result.table(TABLE)[first:]
        true = np.array([_column(rows, "lon_deg"), _column(rows, "lat_deg")])
    else:
        true = np.array([result.plan["lon"][first:], result.plan["lat"][first:]], float)
    if stated.shape != true.shape:
        return [f"{stated.shape[1]} places, not {true.shape[1]}"]
    gap = np.asarray(Geod(ellps="WGS84").inv(*stated, *true)[2])
    return [f"step {first + t}: {gap[t]:.3g} m off" for t in np.flatnonzero(~(gap <= METRE))]


def _banks(result: Evidence) -> bool:
    """Whether turns move the places and times of legs and the table holds the moved ones.

    A separate claim judges that table.
    """
    return result.robot.bank > 0.0 and result.has(TABLE)


def time_faults(result: Evidence, times: Iterable[str | None]) -> list[str]:
    """Steps whose time differs from plan.json; if the plan has no times, its files must have none."""
    stated, plan = list(times), result.plan["time_utc"]
    if plan is None:
        return [] if not any(stated) else ["times, and the plan has none"]
    if _banks(result):
        plan = [row["time_utc"] for row in result.table(TABLE)]
    elif result.robot.bank > 0.0:
        return []  # turns make them later than in the plan; without the table the delay is unknown
    if len(stated) != len(plan):
        return [f"{len(stated)} times, not {len(plan)}"]
    pairs = [
        (datetime.fromisoformat(str(a)), datetime.fromisoformat(b)) for a, b in zip(stated, plan, strict=True)
    ]
    gaps = [abs((a - b).total_seconds()) for a, b in pairs]
    return [f"step {t}: {gap:.3g} s off" for t, gap in enumerate(gaps) if not gap <= SECOND]


class Route(NamedTuple):
    """Positions (latitude, longitude [deg], time) in a file, and the airspeed [m/s] of each leg.

    ``times`` and ``airspeed`` are None in files that do not have them.
    """

    lat: list[Any]
    lon: list[Any]
    times: list[str | None] | None = None
    airspeed: list[float] | None = None


def route(name: str, result: Evidence) -> Verdict:
    """Places, times and airspeeds of an exported file."""
    lat, lon, times, airspeed = ROUTES[name](result)
    faults = place_faults(result, lat, lon)
    if times is not None:
        faults += time_faults(result, times)
    if airspeed is not None:
        wanted = [*np.hypot(*result.u.T), math.inf]  # a leg without airspeed has none in mission.plan
        unlike = _unlike(airspeed, wanted[:-1], LEAST_CHANGE)
        faults += [f"leg {k}: airspeed" for k in unlike if wanted[k] > 0.0]
    faults += _mission_faults(result) if name == "mission.plan" else []
    return no_fault(f"{len(lat)} positions", faults)


def _gpx(result: Evidence) -> Route:
    tag = NAMESPACES["gpx"]
    points = list(xml_root(result, "plan.gpx").iter(f"{tag}rtept"))
    places = [[point.get(key) for point in points] for key in ("lat", "lon")]
    return Route(places[0], places[1], [point.findtext(f"{tag}time") for point in points])


def _kml(result: Evidence) -> Route:
    tag = NAMESPACES["kml"]
    every = xml_root(result, "plan.kml").iter(f"{tag}Placemark")
    marks = [mark for mark in every if mark.find(f"{tag}Point") is not None]
    places = [str(m.findtext(f"{tag}Point/{tag}coordinates")).split(",") for m in marks]
    times = [m.findtext(f"{tag}TimeStamp/{tag}when") for m in marks]
    return Route([p[1] for p in places], [p[0] for p in places], times)


def _geojson(result: Evidence) -> Route:
    positions = [f for f in features_of(result, "plan.geojson") if f["properties"]["role"] == "position"]
    places = [f["geometry"]["coordinates"] for f in positions]
    times = [f["properties"]["time_utc"] for f in positions]
    return Route([p[1] for p in places], [p[0] for p in places], times)


def _trajectory(result: Evidence) -> Route:
    from pareto_ltl.support.netcdf4 import File

    with File(result.directory / "trajectory.nc", "r") as file:
        lat, lon, t, airspeed = (
            np.asarray(file[key][...], float).tolist() for key in ("lat", "lon", "time", "airspeed")
        )
        since = str(file["time"].attrs["units"]).removeprefix("seconds since ")
    zero = datetime.fromisoformat(f"{since}+00:00")
    return Route(lat, lon, [(zero + timedelta(seconds=s)).isoformat() for s in t], airspeed[:-1])


def _mission(result: Evidence) -> Route:
    mission = json_file(result, "mission.plan")["mission"]
    places, airspeed, speed = [mission["plannedHomePosition"]], list[float](), 0.0
    for item in mission["items"]:
        if item["command"] == CHANGE_SPEED:
            speed = item["params"][1]
        elif item["command"] == WAYPOINT:
            places.append(item["params"][4:])
            airspeed.append(speed)
    return Route([p[0] for p in places], [p[1] for p in places], None, airspeed)


def _fpl(result: Evidence) -> Route:
    tag = NAMESPACES["fpl"]
    root = xml_root(result, "plan.fpl")
    places = {str(p.findtext(f"{tag}identifier")): p for p in root.iter(f"{tag}waypoint")}
    flown = [places[str(p.findtext(f"{tag}waypoint-identifier"))] for p in root.iter(f"{tag}route-point")]
    lat, lon = ([p.findtext(f"{tag}{key}") for p in flown] for key in ("lat", "lon"))
    return Route(lat, lon, None)


ROUTES: dict[str, Callable[[Evidence], Route]] = {
    "plan.gpx": _gpx, "plan.kml": _kml, "plan.geojson": _geojson, "trajectory.nc": _trajectory,
    "mission.plan": _mission, "plan.fpl": _fpl,
}  # fmt: skip
Rows = Sequence[dict[str, str]]


def xml_root(result: Evidence, name: str) -> ElementTree.Element:
    """The root of an XML file; ValueError if the file is not XML."""
    try:
        return ElementTree.fromstring(read_text(result.directory / name))
    except ElementTree.ParseError as error:
        raise ValueError(f"{name} is not XML: {error}") from None


def json_file(result: Evidence, name: str) -> dict[str, Any]:
    """The content of a JSON file."""
    return read_json(result.directory / name)


def features_of(result: Evidence, name: str) -> list[dict[str, Any]]:
    """The features of a GeoJSON file."""
    features: list[dict[str, Any]] = json_file(result, name)["features"]
    return features


# --- legs -------------------------------------------------------------------------------------


def dead_reckoning(result: Evidence) -> Verdict:
    """Places, times, headings, airspeeds and expected winds of the table agree with plan.json."""
    rows = result.table(TABLE)
    if len(rows) != len(result.x):
        return no_fault(f"{len(rows)} rows", [f"{len(rows)} rows, not {len(result.x)}"])
    legs, robot, x = rows[:-1], result.robot, result.x
    wind = (x[1:] - x[:-1] @ robot.a.T) / robot.dt - result.u @ robot.b.T
    banks = robot.bank > 0.0
    faults = _flown_with_turns(result, rows, wind) if banks else _flown_on_the_spot(result, rows)
    faults += [f"{row['wind_law']} winds" for row in rows[:1] if row["wind_law"] != result.planned_law]
    if faults:
        return no_fault(f"{len(rows)} rows", faults)
    wanted = {
        "airspeed_m_s": np.hypot(*result.u.T),
        "wind_m_s": np.hypot(*wind.T),
        "wind_sd_m_s": np.sqrt(_wind_variance(result).mean(axis=1)),
    }
    least = {"wind_m_s": 0.01, "wind_sd_m_s": 0.01}  # [m/s]: the motion of a step is exact to 0.5 m only
    for key, values in wanted.items():
        faults += [f"leg {k}: {key}" for k in _unlike(_column(legs, key), values, least.get(key, 1e-6))]
    faults += _direction_faults(legs, "wind_from_deg", azimuths(result, x[:-1], -wind), np.hypot(*wind.T))
    return no_fault(f"{len(rows)} rows", faults)


def _flown_on_the_spot(result: Evidence, rows: Rows) -> list[str]:
    """Faults of places, times and headings, for a robot whose turns take no time."""
    faults = place_faults(result, _column(rows, "lat_deg"), _column(rows, "lon_deg"))
    faults += time_faults(result, [row["time_utc"] or None for row in rows])
    duration = _column(rows[:-1], "duration_s")
    faults += [f"leg {k}: duration_s" for k in _unlike(duration, np.diff(result.plan["t"]))]
    middle = 0.5 * (result.x[:-1] + result.x[1:])
    heading, size = azimuths(result, middle, result.u), np.hypot(*result.u.T)
    return faults + _direction_faults(rows[:-1], "heading_true_deg", heading, size)


def _flown_with_turns(result: Evidence, rows: Rows, wind: FloatArray) -> list[str]:
    """Faults of places, times and headings, for an aircraft that banks.

    Each leg, integrated in small time steps, must end at the next place of the table. That place is the
    planned one unless the leg is too short for its turn.
    """
    heading, airspeed, duration = (
        _column(rows[:-1], key) for key in ("heading_true_deg", "airspeed_m_s", "duration_s")
    )
    places = in_plane(result, np.column_stack([_column(rows, "lon_deg"), _column(rows, "lat_deg")]))
    north = azimuths(result, 0.5 * (places[:-1] + places[1:]), np.tile([0.0, 1.0], (len(heading), 1)))
    ways, roomy = fly_table(result.robot, np.deg2rad(90.0 + north - heading), airspeed, duration, wind)
    off = np.linalg.norm(places[:-1] + ways - places[1:], axis=1)
    faults = [f"leg {k} ends {off[k]:.3g} m from the next place" for k in np.flatnonzero(~(off <= METRE))]
    moved = np.linalg.norm(places - result.x, axis=1)
    held = np.concatenate([[True], roomy])
    faults += [f"step {k}: {moved[k]:.3g} m off" for k in np.flatnonzero(held & ~(moved <= METRE))]
    t = result.plan["t"][0] + np.concatenate([[0.0], np.cumsum(duration)])
    faults += [f"step {k}: t_s" for k in _unlike(_column(rows, "t_s"), t, 1e-3)]
    if (plan := result.plan["time_utc"]) is not None:
        begin = datetime.fromisoformat(plan[0])
        elapsed = [datetime.fromisoformat(row["time_utc"]) - begin for row in rows]
        gaps = np.abs(np.array([gap.total_seconds() for gap in elapsed]) - (t - t[0]))
        faults += [f"step {k}: {gaps[k]:.3g} s off" for k in np.flatnonzero(~(gaps <= SECOND))]
    return faults


def _direction_faults(legs: Rows, key: str, values: FloatArray, size: FloatArray) -> list[str]:
    """Legs whose direction in column ``key`` differs from ``values`` (T,) [deg].

    Vectors whose ``size`` (T,) [m/s] is at most 0.1 have no direction that is judged.
    """
    gap = np.abs((_column(legs, key) - values + 180.0) % 360.0 - 180.0)
    bad = (size > 0.1) & ~(gap <= ANGLE * (1 + 10 / np.maximum(size, 0.1)))
    return [f"leg {k}: {key}" for k in np.flatnonzero(bad)]


def _wind_variance(result: Evidence) -> FloatArray:
    """Variance (T, 2) [m²/s²] of the wind of each leg under the wind law of the plan."""
    return np.asarray((result.course.psi**2).sum(axis=2) + result.course.white, float)


def azimuths(result: Evidence, x: FloatArray, toward: FloatArray) -> FloatArray:
    """True directions (T,) [deg], clockwise from north, at ``x`` (T, 2) [m] of plane vectors (T, 2)."""
    from pyproj import Geod, Transformer

    back = Transformer.from_crs(result.scene["crs"], "EPSG:4326", always_xy=True)
    ahead = x + AHEAD * toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)
    return np.asarray(Geod(ellps="WGS84").inv(*back.transform(*x.T), *back.transform(*ahead.T))[0], float)


def spreads(result: Evidence) -> Verdict:
    """Ellipses and radii of the table follow from the covariances of plan.json."""
    rows, cov = result.table(TABLE), np.array(result.plan["cov"], float)
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(cov), 0.0))
    faults = [f"row {k}: major axis" for k in _unlike(_column(rows, "ellipse_major_m"), values[:, 1], 1e-3)]
    faults += [f"row {k}: minor axis" for k in _unlike(_column(rows, "ellipse_minor_m"), values[:, 0], 1e-3)]
    radii = _column(rows, "radius_95_m")
    if len(radii) != len(cov):
        return no_fault(f"{len(rows)} rows", [f"{len(rows)} rows"])
    for k, (minor, major) in enumerate(values):
        held = held_within(float(radii[k]), float(major), float(minor))
        if not abs(held - RADIUS) <= 1e-3 and max(major, radii[k]) > 1e-6:
            faults.append(f"row {k}: the radius holds {held:.4g}")
    return no_fault(f"radius {radii[-1]:.4g} m at the end", faults)


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
    script = json_file(result, "mavlink_script.json")
    rows = result.table(TABLE)[:-1]
    faults = [f"{script['wind_law']} winds"] * (script["wind_law"] != result.planned_law)
    for command, key in ((AIRSPEED, "airspeed_m_s"), (HEADING, "heading_true_deg")):
        sent = {float(m["t"]): float(m["params"][1]) for m in script["messages"] if m["command"] == command}
        stated = {float(row["t_s"]): float(row[key]) for row in rows if row[key]}
        wrong = [t for t in stated if not close(sent.get(t, math.nan), stated[t], 1e-9, 1e-9)]
        faults += [f"{key} at {t:g} s" for t in wrong]
        faults += [f"{key} at {t:g} s, where no leg begins" for t in sent if t not in stated]
    return no_fault(f"{len(script['messages'])} messages", faults)


# --- the mission of an autopilot --------------------------------------------------------------


def _mission_faults(result: Evidence) -> list[str]:
    """Fences are the obstacles and, if border=wall, the border; cruise speeds are the largest of the plan."""
    content, scene = json_file(result, "mission.plan"), result.scene
    speeds = [content["mission"][key] for key in ("cruiseSpeed", "hoverSpeed")]
    fastest = np.hypot(*result.u.T).max(initial=0.0)
    faults = ["cruise speed"] * bool(_unlike(speeds, [fastest] * 2))
    fences = content["geoFence"]["polygons"]
    (west, south), (east, north) = scene["bounds"]
    areas = [(False, np.array(corners)) for corners in scene["obstacles"]]
    if result.ground.walled:
        areas.insert(0, (True, np.array([(west, south), (east, south), (east, north), (west, north)])))
    drawn = [in_plane(result, np.array(fence["polygon"], float)[:, ::-1]) for fence in fences]
    if areas and areas[0][0] and _crosses_180(result, areas[0][1]):
        del areas[0]  # no area to stay in can be cut
    for number, (inside, corners) in enumerate(areas):
        parts = 1 + (_crosses_180(result, corners) and _parts_of(corners, drawn[1:]))
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


def _crosses_180(result: Evidence, corners: FloatArray) -> bool:
    """Whether the 180th meridian crosses the outline through ``corners`` (n, 2) [m]; no pole is inside."""
    from pyproj import Transformer

    ends = np.roll(corners, -1, axis=0)
    points = (corners[:, None] + np.linspace(0.0, 1.0, 200)[:, None] * (ends - corners)[:, None]).reshape(
        -1, 2
    )
    lon, _ = Transformer.from_crs(result.scene["crs"], "EPSG:4326", always_xy=True).transform(*points.T)
    turned = np.unwrap(np.deg2rad(lon))
    return bool(np.abs(np.diff(lon)).max() > 180.0 and abs(turned[-1] - turned[0]) < np.pi)


def in_plane(result: Evidence, lonlat: FloatArray) -> FloatArray:
    """Positions (N, 2) [m] of longitudes and latitudes (N, 2) [deg]."""
    from pyproj import Transformer

    forth = Transformer.from_crs("EPSG:4326", result.scene["crs"], always_xy=True)
    return np.column_stack(forth.transform(*lonlat.T))


ROUNDED = (
    ("lat_deg", "lat_deg", 1.0, 5.1e-5),
    ("lon_deg", "lon_deg", 1.0, 5.1e-5),
    ("radius_95_km", "radius_95_m", 1e3, 51.0),
    ("t_s", "t_s", 1.0, 0.51),
)  # columns of the card and of the table, their ratio, and the largest difference


def flight_card(result: Evidence) -> Verdict:
    """Each row is the legs that it names, by ``dead_reckoning.csv``, in whole seconds and degrees."""
    rows, legs = result.table(CARD), result.table(TABLE)
    faults, after = list[str](), 0
    for row in rows[:-1]:
        first, _, last = row["legs"].partition("-")
        own = legs[int(first) : int(last or first) + 1]
        digits = max(len(row["airspeed_m_s"].partition(".")[2]), 1)
        heading = {_whole_heading(leg) for leg in own}
        airspeed = {f"{float(leg['airspeed_m_s']):.{digits}f}" for leg in own}
        sums = [sum(float(leg[key]) for leg in own) for key in ("duration_s", "distance_m")]
        stated = [float(row["duration_s"]), 1e3 * float(row["distance_km"])]
        agrees = (
            int(first) == after
            and heading == {row["heading_true_deg"]}
            and airspeed == {row["airspeed_m_s"]}
            and all(abs(a - b) <= half for a, b, half in zip(stated, sums, (0.51, 51.0), strict=True))
        )
        faults += [] if agrees else [f"legs {row['legs']}"]
        after += len(own)
    for row in rows:
        leg = legs[int(row["legs"].partition("-")[0])]
        unlike = [a for a, b, unit, limit in ROUNDED if abs(unit * float(row[a]) - float(leg[b])) > limit]
        unlike += ["time_utc"] if row["time_utc"] != leg["time_utc"] else []
        faults += [f"{what} of leg {row['legs']}" for what in unlike]
    faults += [] if after == len(legs) - 1 else [f"{after} of {len(legs) - 1} legs"]
    return no_fault(f"{len(rows)} rows", faults)


def _whole_heading(leg: dict[str, str]) -> str:
    return f"{round(float(leg['heading_true_deg'])) % 360:d}" if leg["heading_true_deg"] else ""


# --- numbers ----------------------------------------------------------------------------------


def _column(rows: Sequence[dict[str, str]], key: str) -> FloatArray:
    return np.array([float(row[key]) if row[key] else math.nan for row in rows])


def _unlike(stated: Iterable[Any], wanted: Iterable[Any], least: float = 1e-6) -> list[int]:
    """Indices of entries that differ by more than 10⁻⁴ of their value and by more than ``least``."""
    a, b = np.array(list(stated), float), np.array(list(wanted), float)
    if a.shape != b.shape:
        return [min(len(a), len(b))]
    return [int(k) for k in np.flatnonzero(~(np.abs(a - b) <= np.maximum(1e-4 * np.abs(b), least)))]


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
