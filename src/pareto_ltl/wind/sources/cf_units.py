"""Units of speed, time and height in CF files, with their factors to SI."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta, timezone

from pareto_ltl.support.messages import shown_value
from pareto_ltl.wind.levels import HEIGHT, PRESSURE
from pareto_ltl.wind.readings import KNOT

SPEEDS = {
    **dict.fromkeys(("ms-1", "m/s", "m/sec", "meters/second", "meter/second", "metersecond-1", "mps"), 1.0),
    **dict.fromkeys(("meterspersecond", "meters-1", "metres-1", "msec-1", "ms**-1", "ms^-1"), 1.0),
    **dict.fromkeys(("knot", "knots", "kt", "kts", "kn"), KNOT),
    **dict.fromkeys(("cms-1", "cm/s", "cm/sec", "centimeter/second", "cms**-1", "cms^-1"), 0.01),
    **dict.fromkeys(("km/h", "kmh-1", "km/hr", "kmhr-1"), 1 / 3.6),
}
TIMES = {"s": 1.0, "second": 1.0, "sec": 1.0, "minute": 60.0, "min": 60.0, "hour": 3600.0, "hr": 3600.0}
TIMES |= {"h": 3600.0, "day": 86400.0, "d": 86400.0, "millisecond": 1e-3, "msec": 1e-3}
HEIGHTS = {"m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1000.0}
PRESSURES = {"pa": 1.0, "pascal": 1.0, "hpa": 100.0, "mb": 100.0, "mbar": 100.0, "millibar": 100.0}
PRESSURES |= {"millibars": 100.0, "kpa": 1000.0}
CALENDARS = ("", "standard", "gregorian", "proleptic_gregorian")
REFORM = datetime(1582, 10, 15, tzinfo=UTC)  # calendars agree from here on
EPOCH = re.compile(
    r"([a-z]+)\s+since\s+(\d{1,4})-(\d{1,2})-(\d{1,2})"
    r"(?:[t ]\s*(\d{1,2})(?::(\d{1,2}))?(?::(\d{1,2})(?:\.\d*)?)?)?\s*(z|utc|gmt|[+-]\d{1,2}(?::?\d{2})?)?"
)


def speed_factor(units: str) -> float | None:
    """Metres per second in one unit; None if ``units`` are not known."""
    plain = re.sub(r"[\s.*]+", "", units.strip().lower().replace("**", "^"))
    return SPEEDS.get(plain.replace("^", ""), SPEEDS.get(plain))


def time_scale(units: str, calendar: str) -> tuple[float, float]:
    """Seconds in one unit, and the reference time [s since 1970-01-01 UTC], of CF time units.

    ValueError if the units or the calendar are not known.
    """
    if calendar.strip().lower() not in CALENDARS:
        raise ValueError(f"its calendar {shown_value(calendar)} is not supported; expected standard")
    found = EPOCH.fullmatch(units.strip().lower())
    unit = found[1] if found else ""
    factor = TIMES.get(unit, TIMES.get(unit.removesuffix("s")))
    if found is None or factor is None:
        raise ValueError(
            f"its time units {shown_value(units)} are not known; expected 'hours since 2018-10-09'"
        )
    year, month, day, hour, minute, second = (int(part or 0) for part in found.groups()[1:7])
    zero = datetime(year, month, day, hour, minute, second, tzinfo=_zone(found[8]))
    if zero < REFORM and calendar.strip().lower() != "proleptic_gregorian":
        raise ValueError(f"its time units {shown_value(units)} begin before 1582, where calendars differ")
    return factor, zero.timestamp()


def duration_factor(units: str) -> float | None:
    """Seconds in one unit, e.g. of a forecast period; None if ``units`` are not known."""
    unit = units.strip().lower()
    return TIMES.get(unit, TIMES.get(unit.removesuffix("s")))


def level_unit(units: str) -> tuple[str, float] | None:
    """Kind of level of ``units`` (``height`` also for depths), and factor to m or Pa; None if unknown."""
    unit = units.strip().lower()
    if unit in HEIGHTS:
        return HEIGHT, HEIGHTS[unit]
    return (PRESSURE, PRESSURES[unit]) if unit in PRESSURES else None


def _zone(text: str | None) -> timezone:
    if text is None or text in ("z", "utc", "gmt"):
        return UTC
    digits = text[1:].replace(":", "").rjust(2, "0")
    shift = timedelta(hours=int(digits[:2]), minutes=int(digits[2:] or 0))
    return timezone(-shift if text[0] == "-" else shift)
