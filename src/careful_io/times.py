"""Times and durations as text: ISO 8601 in UTC, and ``6h``."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any

HOUR = 3600.0  # [s]
UNITS = {"s": 1.0, "min": 60.0, "h": HOUR, "d": 24.0 * HOUR}
_DURATION = re.compile(r"([+-]?\d+(?:\.\d*)?|\.\d+)\s*(s|min|h|d)?")


@lru_cache(maxsize=4096)  # many rows of a table share few times
def seconds(text: str) -> float:
    """Seconds since 1970 of an ISO 8601 time; UTC if it has no offset. ValueError if it is not a time."""
    return utc_moment(text).timestamp()


def iso(time: float) -> str:
    """ISO 8601 UTC text of ``time`` [s since 1970]."""
    return datetime.fromtimestamp(time, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def utc_moment(text: str) -> datetime:
    """The moment of an ISO 8601 time, in UTC unless it names a zone.

    ValueError for other texts, and for a moment whose year in UTC is not within 1 to 9999.
    """
    moment = datetime.fromisoformat(text.strip())
    if moment.tzinfo is None:
        return moment.replace(tzinfo=UTC)
    try:
        return moment.astimezone(UTC)
    except OverflowError:
        raise ValueError(f"{text} is outside of the calendar in UTC") from None


def lacks_zone(value: Any) -> bool:
    """Whether ``value`` is an ISO 8601 time without a zone, which is read as UTC."""
    text = value.isoformat() if isinstance(value, datetime) else str(value).strip()
    try:
        return duration_seconds(text) is None and datetime.fromisoformat(text).tzinfo is None
    except ValueError:  # whoever reads it says so
        return False


def duration_seconds(text: str, unit: str | None = None) -> float | None:
    """``6h``, ``90 min``, ``1.5d``, ``30s``, or a number with the default ``unit``, in [s]; else None.

    Without ``unit``, a number alone is allowed only if it is 0.
    """
    match = _DURATION.fullmatch(text.strip())
    if match is None:
        return None
    number, own = float(match[1]), match[2] or unit
    if own is None:
        return 0.0 if number == 0.0 else None
    return number * UNITS[own]


def hours_text(seconds: float) -> str:
    """A duration [s] as text: ``6 h``, ``90 min`` or ``30 s``."""
    for unit in ("h", "min"):
        if abs(seconds) >= UNITS[unit] and (seconds / UNITS[unit]) % 0.5 == 0:
            return f"{seconds / UNITS[unit]:g} {unit}"
    return f"{seconds:g} s"
