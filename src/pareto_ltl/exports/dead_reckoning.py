"""``dead_reckoning.csv``: a row for each leg, and one for the arrival."""

from __future__ import annotations

import csv
import io
from typing import Any

from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.support.files import plain_data

COLUMNS = (
    "leg", "time_utc", "t_s", "heading_true_deg", "airspeed_m_s", "duration_s",
    "wind_m_s", "wind_from_deg", "wind_sd_m_s", "track_true_deg", "ground_speed_m_s", "distance_m",
    "lat_deg", "lon_deg", "radius_95_m", "ellipse_major_m", "ellipse_minor_m", "ellipse_azimuth_deg",
    "fix", "wind_law",
)  # fmt: skip


def dead_reckoning_csv(exported: ExportedPlan) -> bytes:
    """The file; positions, radius and ellipse are those at the start of each leg."""
    log, text = exported.log, io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    legs = len(log.airspeed)
    for k in range(legs + 1):
        flown: list[Any] = [""] * 9
        if k < legs:
            flown = [
                log.heading[k], log.airspeed[k], log.duration[k], log.wind_speed[k], log.wind_from[k],
                log.wind_sd[k], log.track[k], log.ground_speed[k], log.distance[k],
            ]  # fmt: skip
        spread = (log.radius[k], log.major[k], log.minor[k], log.azimuth[k])
        row = [
            k, "" if log.utc is None else log.utc[k], log.t[k], *flown, log.lat[k], log.lon[k], *spread,
            int(k in log.fixes), log.law,
        ]  # fmt: skip
        table.writerow([plain_data(cell) for cell in row])
    return text.getvalue().encode()
