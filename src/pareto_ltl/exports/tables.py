"""``dead_reckoning.csv``, a row for each leg with all digits, and ``flight_card.csv``, to fly by hand.

The card has seconds, whole degrees and tenths of m/s; the airspeeds of a slow robot, such as a glider in the
water, have hundredths.
"""

from __future__ import annotations

import math
from itertools import groupby

from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.exports.navigation_log import LEG_COLUMNS, SPREAD_COLUMNS
from pareto_ltl.support.display import speed_digits
from pareto_ltl.support.files import csv_text

TABLE_COLUMNS = (
    "leg", "time_utc", "t_s", *LEG_COLUMNS, "lat_deg", "lon_deg", *SPREAD_COLUMNS, "fix", "wind_law",
)  # fmt: skip
CARD_COLUMNS = (
    "legs", "time_utc", "t_s", "heading_true_deg", "airspeed_m_s", "duration_s", "distance_km", "lat_deg",
    "lon_deg", "radius_95_km",
)  # fmt: skip


def dead_reckoning_csv(exported: ExportedPlan) -> bytes:
    """The table, and a row for the arrival; positions, radius and ellipse are those at the start of a leg."""
    log = exported.log
    nothing = [""] * len(LEG_COLUMNS)
    rows = [
        (
            k, log.time_utc(k), log.t[k], *(log.leg(k).values() if k < log.legs else nothing), log.lat[k],
            log.lon[k], *log.spread(k).values(), int(k in log.fixes), log.law,
        )
        for k in range(log.legs + 1)
    ]  # fmt: skip
    return csv_text(TABLE_COLUMNS, rows).encode()


def flight_card(exported: ExportedPlan) -> bytes:
    """The card: successive legs of one rounded heading and airspeed are one row; the last is the arrival.

    Position and radius are those at the begin of a row. ``dead_reckoning.csv`` has all digits.
    """
    log = exported.log
    digits = speed_digits(max(log.airspeed.tolist(), default=math.inf))
    commands = [
        ("" if math.isnan(heading) else f"{round(heading) % 360:d}", f"{airspeed:.{digits}f}")
        for heading, airspeed in zip(log.heading.tolist(), log.airspeed.tolist(), strict=True)
    ]

    def row(k: int, name: str, *flown: str) -> list[str | None]:
        place = f"{log.lat[k]:.4f}", f"{log.lon[k]:.4f}", f"{log.radius[k] / 1e3:.1f}"
        return [name, log.time_utc(k), f"{log.t[k]:.0f}", *flown, *place]

    rows = []
    for command, same in groupby(range(log.legs), key=commands.__getitem__):
        legs = list(same)
        name = str(legs[0]) if len(legs) == 1 else f"{legs[0]}-{legs[-1]}"
        flown = f"{log.duration[legs].sum():.0f}", f"{log.distance[legs].sum() / 1e3:.1f}"
        rows.append(row(legs[0], name, *command, *flown))
    return csv_text(CARD_COLUMNS, [*rows, row(log.legs, str(log.legs), *[""] * 4)]).encode()
