"""``dead_reckoning.csv``, a row for each leg with all digits, ``flight_card.csv``, and ``trajectory.nc``.

The card, to fly by hand, has seconds, whole degrees and tenths of m/s; the airspeeds of a slow robot, such as
a glider in the water, have hundredths. The last file has the expected flight as a CF-1.8 discrete sampling
geometry, a single trajectory.
"""

from __future__ import annotations

import io
import math
from datetime import datetime, timedelta
from itertools import groupby
from typing import Any

import numpy as np

from careful_io.files import csv_text
from careful_io.texts import speed_digits
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.exported import ExportedPlan
from pareto_ltl_apps.exports.navigation_log import LEG_COLUMNS, SPREAD_COLUMNS, NavigationLog

TABLE_COLUMNS = (
    "leg", "time_utc", "t_s", *LEG_COLUMNS, "lat_deg", "lon_deg", *SPREAD_COLUMNS, "fix", "wind_law",
)  # fmt: skip
CARD_COLUMNS = (
    "legs", "time_utc", "t_s", "heading_true_deg", "airspeed_cas_m_s", "airspeed_tas_m_s", "duration_s",
    "distance_km", "lat_deg", "lon_deg", "radius_95_km",
)  # fmt: skip


def dead_reckoning_csv(exported: ExportedPlan) -> bytes:
    """The table, and a row for the arrival; positions, radius and ellipse are those at the start of a leg."""
    return table_of(exported.log)


def table_of(log: NavigationLog, first: int = 0) -> bytes:
    """The table of a log whose legs count from ``first``."""
    nothing = [""] * len(LEG_COLUMNS)
    rows = [
        (
            first + k, log.time_utc(k), log.t[k],
            *(log.leg(k).values() if k < log.legs else nothing), log.lat[k], log.lon[k],
            *log.spread(k).values(), int(k in log.fixes), log.law,
        )
        for k in range(log.legs + 1)
    ]  # fmt: skip
    return csv_text(TABLE_COLUMNS, rows).encode()


def flight_card(exported: ExportedPlan) -> bytes:
    """The card: successive legs of one rounded heading and airspeed are one row; the last is the arrival.

    A pilot holds the calibrated airspeed, which the instrument shows.

    Position and radius are those at the begin of a row. ``dead_reckoning.csv`` has all digits.
    """
    return card_of(exported.log)


def card_of(log: NavigationLog, first: int = 0) -> bytes:
    """The card of a log whose legs count from ``first``."""
    digits = speed_digits(max(log.airspeed.tolist(), default=math.inf))
    commands = [
        ("" if math.isnan(heading) else f"{round(heading) % 360:d}", *(_speed(v, digits) for v in speeds))
        for heading, *speeds in zip(
            log.heading.tolist(), log.calibrated.tolist(), log.airspeed.tolist(), strict=True
        )
    ]

    def row(k: int, name: str, *flown: str) -> list[str | None]:
        place = f"{log.lat[k]:.4f}", f"{log.lon[k]:.4f}", f"{log.radius[k] / 1e3:.1f}"
        return [name, _whole_second(log.time_utc(k)), f"{log.t[k]:.0f}", *flown, *place]

    rows = []
    for command, same in groupby(range(log.legs), key=commands.__getitem__):
        legs = list(same)
        ends = [first + legs[0], first + legs[-1]]
        name = "-".join(map(str, ends[: len(legs)]))
        flown = f"{log.duration[legs].sum():.0f}", f"{log.distance[legs].sum() / 1e3:.1f}"
        rows.append(row(legs[0], name, *command, *flown))
    return csv_text(CARD_COLUMNS, [*rows, row(log.legs, str(first + log.legs), *[""] * 5)]).encode()


def _whole_second(utc: str | None) -> str | None:
    """A time to the nearest second: ``2016-11-20T00:40:00Z``; None for none."""
    if not utc or "." not in utc:
        return utc
    time = datetime.fromisoformat(utc) + timedelta(seconds=0.5)
    return time.strftime("%Y-%m-%dT%H:%M:%SZ")


def _speed(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


# --- NetCDF -----------------------------------------------------------------------------------

VARIABLES = {  # name: attribute of the log, standard name, unit, meaning
    "heading": ("heading", "platform_orientation", "degree", "true heading to hold on the leg that begins"),
    "airspeed": ("airspeed", "platform_speed_wrt_air", "m s-1", "true airspeed on the leg that begins"),
    "calibrated_airspeed": ("calibrated", None, "m s-1", "calibrated airspeed on the leg that begins"),
    "course": ("track", "platform_course", "degree", "expected true track on the leg that begins"),
    "ground_speed": ("ground_speed", "platform_speed_wrt_ground", "m s-1", "expected speed on that leg"),
    "wind_speed": ("wind_speed", "wind_speed", "m s-1", "expected wind on that leg"),
    "wind_from": ("wind_from", "wind_from_direction", "degree", "direction that it blows from"),
    "wind_sd": ("wind_sd", None, "m s-1", "standard deviation of a component of the wind on that leg"),
    "radius_95": ("radius", None, "m", "of the circle that holds 95 % of the positions at that time"),
    "ellipse_major": ("major", None, "m", "standard deviation of the position along the major axis"),
    "ellipse_minor": ("minor", None, "m", "standard deviation of the position along the minor axis"),
    "ellipse_azimuth": ("azimuth", None, "degree", "true direction of the major axis"),
}


def trajectory_netcdf(exported: ExportedPlan) -> bytes:
    """The file; values of a leg stand at the time at which it begins, so the last ones are missing."""
    import h5netcdf

    log, content = exported.log, io.BytesIO()
    assert log.utc is not None
    since = log.utc[0].replace("T", " ").removesuffix("Z")
    coordinates: dict[str, tuple[FloatArray, dict[str, Any]]] = {
        "time": (log.t - log.t[0], {"standard_name": "time", "units": f"seconds since {since}",
                                    "calendar": "standard", "axis": "T"}),
        "lat": (log.lat, {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"}),
        "lon": (log.lon, {"standard_name": "longitude", "units": "degrees_east", "axis": "X"}),
    }  # fmt: skip
    with h5netcdf.File(content, "w") as file:
        file.attrs.update(
            {
                "Conventions": "CF-1.8",
                "featureType": "trajectory",
                "history": "written by pareto_ltl, from plan.json and wind.nc of the run",
                "title": f"Expected flight of {exported.name}",
                "comment": " ".join(exported.sentences()),
                "wind_law": log.law,
            }
        )
        name = np.frombuffer(exported.name.encode(), "S1")
        file.dimensions.update({"obs": len(log.t), "name_strlen": len(name)})
        file.create_variable("trajectory", ("name_strlen",), data=name).attrs.update(
            {"cf_role": "trajectory_id", "long_name": "name of the run"}
        )
        for key, (values, attributes) in coordinates.items():
            file.create_variable(key, ("obs",), data=values).attrs.update(attributes)
        for key, (source, standard, unit, meaning) in VARIABLES.items():
            values = getattr(log, source)
            padded = np.concatenate([values, np.full(len(log.t) - len(values), np.nan)])
            named = {} if standard is None else {"standard_name": standard}
            file.create_variable(key, ("obs",), data=padded, fillvalue=np.nan).attrs.update(
                named | {"units": unit, "long_name": meaning, "coordinates": "time lat lon"}
            )
    return content.getvalue()
