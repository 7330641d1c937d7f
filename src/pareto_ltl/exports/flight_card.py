"""``flight_card.csv``: the plan as it can be flown by hand, in seconds, whole degrees and tenths of m/s.

The airspeeds of a slow robot, such as a glider in the water, have hundredths.
"""

from __future__ import annotations

import csv
import io
import math
from itertools import groupby

from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.support.display import speed_digits

COLUMNS = (
    "legs", "time_utc", "t_s", "heading_true_deg", "airspeed_m_s", "duration_s", "distance_km", "lat_deg",
    "lon_deg", "radius_95_km",
)  # fmt: skip


def flight_card(exported: ExportedPlan) -> bytes:
    """The file: successive legs of one rounded heading and airspeed are one row; the last is the arrival.

    Position and radius are those at the begin of a row. ``dead_reckoning.csv`` has all digits.
    """
    log, text = exported.log, io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    digits = speed_digits(max(log.airspeed.tolist(), default=math.inf))
    commands = [
        ("" if math.isnan(heading) else f"{round(heading) % 360:d}", f"{airspeed:.{digits}f}")
        for heading, airspeed in zip(log.heading.tolist(), log.airspeed.tolist(), strict=True)
    ]
    for command, legs in groupby(range(len(commands)), key=commands.__getitem__):
        rows = list(legs)
        first, last = rows[0], rows[-1]
        flown = f"{log.duration[rows].sum():.0f}", f"{log.distance[rows].sum() / 1e3:.1f}"
        name = str(first) if first == last else f"{first}-{last}"
        table.writerow([name, *_begin(exported, first), *command, *flown, *_place(exported, first)])
    end = len(commands)
    table.writerow([end, *_begin(exported, end), *[""] * 4, *_place(exported, end)])
    return text.getvalue().encode()


def _begin(exported: ExportedPlan, k: int) -> tuple[str, str]:
    """Time of step ``k``: in UTC, if the map names a departure, and since departure [s]."""
    log = exported.log
    return "" if log.utc is None else log.utc[k], f"{log.t[k]:.0f}"


def _place(exported: ExportedPlan, k: int) -> tuple[str, str, str]:
    log = exported.log
    return f"{log.lat[k]:.4f}", f"{log.lon[k]:.4f}", f"{log.radius[k] / 1e3:.1f}"
