"""Valid times and leads of variables in NetCDF files."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.readers.fields import UnreadError

if TYPE_CHECKING:
    import xarray as xr

SPANS = {"d": 86_400.0, "h": 3600.0, "m": 60.0, "s": 1.0}  # [s] by the first letter of the unit
SINCE = re.compile(r"(days?|hours?|hrs?|h|minutes?|mins?|seconds?|secs?|s|d) since (\S.*)", re.I)
SPAN = re.compile(r"(days?|hours?|hrs?|h|minutes?|mins?|seconds?|secs?|s|d)\b.*", re.I)
DAYS = re.compile(r"days? as %Y%m%d(\.%f)?")
START_WORDS = (
    r"\binit|\brefer|\banalysis|\bmodel run|\brun ?time|\bcycle|start of (the )?(forecast|run)|^run$"
)
VALID_WORDS = r"\bvalid|\bverif|forecast or observation time"
LEAD_WORDS = r"^step$|^lead|^tau$|forecast (period|hour|step|timedelta)|prediction timedelta"
DATE = re.compile(
    r"(\d{4})-?(\d\d?)-?(\d\d?)(?:[T ]+(\d\d?)(?::?(\d\d?))?(?::(\d\d?(?:\.\d+)?))?)?"
    r"\s*(?:Z|UTC|[+-]0?0(?::?00)?)?"
)
CALENDARS = ("", "standard", "gregorian", "proleptic_gregorian")


class Clock(NamedTuple):
    """Times [s since 1970] and leads [s], NaN if they are not stated, along ``dims``."""

    dims: tuple[Any, ...]
    times: FloatArray
    leads: FloatArray


def clock_of(data: xr.Dataset, array: xr.DataArray) -> Clock:
    """The valid times of ``array``; UnreadError if two clocks differ and none is named as the valid one."""
    import xarray as xr

    found: dict[str, list[xr.DataArray]] = {"valid": [], "start": [], "lead": [], "clock": []}
    for name, other in data.variables.items():
        if not set(other.dims) <= set(array.dims) and other.dtype.kind not in "SU":
            continue
        known = _clock(str(name), other)
        if known is not None and set(known[1].dims) <= set(array.dims):
            found[known[0]].append(known[1])
    if (text := data.attrs.get("SIMULATION_START_DATE")) is not None:  # of WRF
        found["start"].append(xr.DataArray(_seconds(str(text).replace("_", "T"))))
    starts, leads, clocks = found["start"], found["lead"], found["clock"]
    longer = [lead for lead in leads if clocks and set(lead.dims) - set(clocks[0].dims)]
    if longer and not starts and not found["valid"]:
        starts, clocks = clocks, []  # beside a dimension of leads, the clock has the starts of runs
    if found["valid"] or clocks:
        valid = _one(found["valid"] or clocks)
    elif starts and leads:
        valid = _one(starts) + leads[0]
    else:
        raise UnreadError("no valid time is stated in a way that the second reader knows")
    ahead = valid - _one(starts) if starts else valid * np.nan
    if not starts and leads and set(leads[0].dims) <= set(valid.dims):
        ahead = valid * 0.0 + leads[0]
    times, ahead = xr.broadcast(valid, ahead)
    return Clock(times.dims, np.asarray(times.values, float), np.asarray(ahead.transpose(*times.dims).values))


def _one(clocks: list[xr.DataArray]) -> xr.DataArray:
    for other in clocks[1:]:
        if (np.abs(other - clocks[0]) > 60.0).any():
            raise UnreadError("several clocks differ")
    return max(clocks, key=lambda clock: clock.ndim)


def _clock(name: str, other: xr.Variable) -> tuple[str, xr.DataArray] | None:
    """The role of a clock and its values [s]; None if ``other`` is none."""
    import xarray as xr

    units = str(other.attrs.get("units", "")).strip()
    words = f"{other.attrs.get('long_name', '')}".lower().replace("_", " ")
    standard = other.attrs.get("standard_name")
    plain = name.lower().replace("_", " ")
    if other.dtype.kind in "SU" and plain == "times":
        values = [_seconds(_letters(text).replace("_", "T")) for text in np.ravel(other.values)]
        return "valid", xr.DataArray(np.reshape(values, other.shape), dims=other.dims)
    if other.dtype.kind not in "iuf":
        return None
    lead = standard == "forecast_period" or any(re.search(LEAD_WORDS, text) for text in (plain, words))
    since = SINCE.fullmatch(units)
    dated = since is not None and re.match(r"[-+]?\d", since[2]) is not None
    if lead and not dated:
        span = SPAN.match(units)
        if span is None:
            return None
        return "lead", xr.DataArray(other.values * SPANS[span[1][0].lower()], dims=other.dims)
    if DAYS.fullmatch(units):
        values = [_seconds(f"{int(v):08d}") + round(86_400 * (v % 1)) for v in np.ravel(other.values)]
        return "clock", xr.DataArray(np.reshape(values, other.shape), dims=other.dims)
    if since is None or not dated:
        return None
    if str(other.attrs.get("calendar", "")).lower() not in CALENDARS:
        raise UnreadError("the calendar of the times is not the standard one")
    moments = _seconds(since[2]) + np.asarray(other.values, float) * SPANS[since[1][0].lower()]
    if standard == "time":
        role = "valid"
    elif standard == "forecast_reference_time":
        role = "start"
    elif any(re.search(VALID_WORDS, text) for text in (plain, words)):
        role = "valid"
    elif any(re.search(START_WORDS, text) for text in (plain, words)):
        role = "start"
    else:
        role = "clock"
    return role, xr.DataArray(moments, dims=other.dims)


def _letters(text: Any) -> str:
    return text.decode("ascii", "replace") if isinstance(text, bytes) else str(text)


def _seconds(text: str) -> float:
    """Seconds since 1970 of a date in the units of a clock; UnreadError if it is not understood."""
    parts = DATE.fullmatch(text.strip())
    if parts is None:
        raise UnreadError(f"the date {text[:30]!r} of a clock is not understood")
    year, month, day, hour, minute, second = (float(part or 0) for part in parts.groups())
    try:
        start = datetime(int(year), int(month), int(day), tzinfo=UTC).timestamp()
    except ValueError:
        raise UnreadError(f"the date {text[:30]!r} of a clock is not understood") from None
    return start + 3600.0 * hour + 60.0 * minute + second
