"""Moments as seconds after the departure."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Any

from careful_io.messages import shown_text
from careful_io.times import duration_seconds, utc_moment
from pareto_ltl.support.errors import DataError

_EXPECTED = (
    "expected an ISO 8601 time (UTC) such as 2018-10-09T18:00:00Z, or a time after departure such as 6h"
)


def seconds_after(what: str, value: Any, departure: str | None) -> float:
    """The moment ``value`` [s after ``departure``]: an ISO 8601 time, or a time after departure.

    DataError, which begins with ``what``, if it is neither.
    """
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    text = value.isoformat() if isinstance(value, datetime) else str(value).strip()
    if (duration := duration_seconds(text)) is not None:
        return duration
    try:
        moment = utc_moment(text)
    except ValueError:
        raise DataError(f"{what} is {shown_text(repr(value))}; {_EXPECTED}") from None
    if departure is None:
        raise DataError(f"{what} is {shown_text(text)}; the departure has no date: set mission.start_time")
    return (moment - utc_moment(departure)).total_seconds()
