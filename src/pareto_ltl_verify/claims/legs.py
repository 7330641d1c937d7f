"""Claims about legs: the table of dead reckoning, the card of a pilot, and the messages of the script."""

from __future__ import annotations

import math
from datetime import datetime

import numpy as np
from scipy.special import ndtr

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, no_fault, same, unlike
from pareto_ltl_verify.claims.exports import (
    METRE,
    PLAN,
    SECOND,
    TABLE,
    Rows,
    column,
    lonlat,
    place_faults,
    stated_airspeed,
    time_faults,
    unlike_at,
)
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.geometry import azimuths, in_plane
from pareto_ltl_verify.robot import fly_table

ANGLE = 0.01  # [deg] largest allowed difference of two directions
ROUND, DIRECTION = 1e-3, 0.1  # relative difference of the axes of a circle; [deg] of the axis of an ellipse
RADIUS = 0.95  # share of the positions within radius_95_m
CARD = "flight_card.csv"
AIRSPEED, HEADING = 43000, 43002  # MAV_CMD
INEXACT = 0.01  # [m/s] error of the wind of a leg: the motion of a step is exact to 0.5 m only
ROUNDED = (
    ("lat_deg", "lat_deg", 1.0, 5.1e-5),
    ("lon_deg", "lon_deg", 1.0, 5.1e-5),
    ("radius_95_km", "radius_95_m", 1e3, 51.0),
    ("t_s", "t_s", 1.0, 0.51),
)  # fmt: skip - columns of the card and of the table, their ratio, and the largest difference
OF_LEGS = (
    "heading_true_deg", "airspeed_tas_m_s", "airspeed_cas_m_s", "duration_s", "wind_m_s", "wind_from_deg",
    "wind_sd_m_s", "track_true_deg", "ground_speed_m_s", "distance_m",
)  # fmt: skip
AIRSPEEDS = ("airspeed_cas_m_s", "airspeed_tas_m_s")
SUMMED = (("duration_s", "duration_s", 1.0, 0.51), ("distance_km", "distance_m", 1e3, 51.0))


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
        _track_faults(rows),
        _row_faults(result, rows),
    )


def _track_faults(rows: Rows) -> list[str]:
    """Legs whose track, length or speed over ground differs from the places of the table."""
    from pyproj import Geod

    places, legs = lonlat(rows), rows[:-1]
    track, _, way = Geod(ellps="WGS84").inv(*places[:-1].T, *places[1:].T)
    ways = np.asarray(way, float)
    over_ground = ways / column(legs, "duration_s")
    return [
        *unlike_at("leg {}: distance_m", column(legs, "distance_m"), ways, 1e-2, 1e-7),
        *unlike_at("leg {}: ground_speed_m_s", column(legs, "ground_speed_m_s"), over_ground),
        *_direction_faults(legs, "track_true_deg", np.asarray(track, float), ways),
    ]


def _row_faults(result: Evidence, rows: Rows) -> list[str]:
    """Rows with another number, wind law or fix; the row of the arrival has no leg."""
    faults = [f"row {k} is {row['leg']}" for k, row in enumerate(rows) if row["leg"] != str(k)]
    faults += [f"row {k}: {row['wind_law']} winds" for k, row in enumerate(rows)
               if row["wind_law"] != result.planned_law]  # fmt: skip
    fixes = [k for k, row in enumerate(rows) if row["fix"] == "1"]
    faults += [f"fixes {fixes}"] * (
        fixes != list(result.plan["fixes"]) or {row["fix"] for row in rows} - {"0", "1"} != set()
    )
    return faults + [f"{key} at the arrival" for key in OF_LEGS if rows[-1][key]]


def _calibrated_faults(result: Evidence, legs: Rows) -> list[str]:
    """Legs whose calibrated airspeed differs from plan.json; in the water there are none."""
    stated = column(legs, "airspeed_cas_m_s")
    if result.plan.get("airspeed_calibrated") is None:
        return [f"leg {k}: airspeed_cas_m_s" for k in np.flatnonzero(np.isfinite(stated))]
    return unlike_at("leg {}: airspeed_cas_m_s", stated, stated_airspeed(result))


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
        _azimuth_faults(result, rows, cov),
        unlike_at("row {}: major axis", column(rows, "ellipse_major_m"), major, 1e-3),
        unlike_at("row {}: minor axis", column(rows, "ellipse_minor_m"), minor, 1e-3),
        (f"row {k}: the radius holds {held[k]:.4g}" for k in np.flatnonzero(wrong)),
    )


def _azimuth_faults(result: Evidence, rows: Rows, cov: FloatArray) -> list[str]:
    """Rows whose ellipse lies in another direction; a circle has none that is judged."""
    values, vectors = np.linalg.eigh(cov)
    round_ = values[:, 1] - values[:, 0] <= ROUND * values[:, 1]
    azimuth = azimuths(result.scene["crs"], result.x, vectors[:, :, 1])
    turn = np.abs((column(rows, "ellipse_azimuth_deg") - azimuth + 90.0) % 180.0 - 90.0)
    return [f"row {k}: ellipse_azimuth_deg" for k in np.flatnonzero(~round_ & ~(turn <= DIRECTION))]


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
    reported = "airspeed_tas_m_s" if result.plan.get("airspeed_calibrated") is None else "airspeed_cas_m_s"
    for command, key in ((AIRSPEED, reported), (HEADING, "heading_true_deg")):
        sent = {float(m["t"]): float(m["params"][1]) for m in script["messages"] if m["command"] == command}
        stated = {float(row["t_s"]): float(row[key]) for row in rows if row[key]}
        faults += [f"{key} at {t:g} s, where no leg begins" for t in sent if t not in stated]
        wrong = [t for t in stated if not close(sent.get(t, math.nan), stated[t], 1e-9, 1e-9)]
        faults += [f"{key} at {t:g} s" for t in wrong]
    return no_fault(f"{len(script['messages'])} messages", faults)


# --- the card of a pilot ----------------------------------------------------------------------


def flight_card(result: Evidence) -> Verdict:
    """Each row is the legs that it names, by ``dead_reckoning.csv``, in whole seconds and degrees."""
    rows, legs = result.table(CARD), result.table(TABLE)
    faults, after = list[str](), 0
    for row in rows:
        first, _, last = row["legs"].partition("-")
        leg = legs[int(first)]
        off = [
            key for key, of, unit, limit in ROUNDED if abs(unit * float(row[key]) - float(leg[of])) > limit
        ]
        off += ["time_utc"] * (not _same_second(row["time_utc"], leg["time_utc"]))
        if row is rows[-1]:
            off += [key for key in (*AIRSPEEDS, "heading_true_deg", "duration_s", "distance_km") if row[key]]
        else:
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
    sums = [(key, unit * float(row[key]) - column(legs, of).sum(), limit) for key, of, unit, limit in SUMMED]
    return off + [key for key, gap, limit in sums if not abs(gap) <= limit]


def _same_second(whole: str, exact: str) -> bool:
    """Whether a time in whole seconds is within half a second of another one; or neither is known."""
    if not whole or not exact:
        return whole == exact
    return len(whole) == len("2018-10-09T00:00:00Z") and bool(
        abs(np.datetime64(whole[:-1], "us") - np.datetime64(exact[:-1], "us"))
        <= np.timedelta64(500_000, "us")
    )


def _rounded(text: str, digits: int) -> str:
    return f"{float(text):.{digits}f}" if text else ""


def _whole_heading(leg: dict[str, str]) -> str:
    return f"{round(float(leg['heading_true_deg'])) % 360:d}" if leg["heading_true_deg"] else ""


CLAIMS: tuple[Claim, ...] = (
    Claim("exports: dead_reckoning.csv", (TABLE, *PLAN, "wind.nc"), dead_reckoning),
    Claim("exports: flight_card.csv", (CARD, TABLE, *PLAN), flight_card),
    Claim("exports: ellipses and radii", (TABLE, *PLAN), spreads),
    Claim("exports: mavlink_script.json", ("mavlink_script.json", TABLE, *PLAN), messages),
)
