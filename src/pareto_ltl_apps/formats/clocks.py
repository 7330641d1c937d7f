"""The one rule for times in NetCDF files: which variable is the valid time, the start of the run, the lead.

A coordinate of time has a role, by its standard name, else by its long name, else by its name. The valid
time is the one with this role; without one, it is the start of the run plus the lead; else it is the only
clock that has no role. Of two different clocks without a role none is taken. The lead is the valid time minus
the start of the run; without a start it is the lead that the file states, else it is not known (NaN).
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from careful_io.messages import shown_text, shown_value
from careful_io.times import seconds
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

SECONDS = "seconds since 1970-01-01"
MAX_LETTERS = 1_000_000  # of a clock that is text
UNITS = {"d": "days", "h": "hours", "hr": "hours", "min": "minutes", "s": "seconds", "sec": "seconds"}
UNITS |= {"hrs": "hours", "mins": "minutes", "secs": "seconds", "msec": "milliseconds"}
SPANS = {  # [s]
    **dict.fromkeys(("nanosecond", "nanoseconds", "ns"), 1e-9),
    **dict.fromkeys(("microsecond", "microseconds", "us"), 1e-6),
    **dict.fromkeys(("millisecond", "milliseconds", "msec", "ms"), 1e-3),
    **dict.fromkeys(("second", "seconds", "sec", "secs", "s"), 1.0),
    **dict.fromkeys(("minute", "minutes", "min", "mins"), 60.0),
    **dict.fromkeys(("hour", "hours", "hr", "hrs", "h"), 3600.0),
    **dict.fromkeys(("day", "days", "d"), 86_400.0),
}
EARLIEST, LATEST = -6e9, 8e9  # [s since 1970] limits of valid times: 1779 and 2223
VALID, START, LEAD, CLOCK = "valid time", "start of the run", "lead", "clock"
STANDARD = {"time": VALID, "forecast_reference_time": START, "forecast_period": LEAD}
DESCRIBED = {
    LEAD: r"\blead|since (the )?(forecast|analysis|initial|model|run|simulation|start)|from start|^ *tau *$"
    r"|forecast (period|step|hour)",
    VALID: r"\bvalid|\bverif|forecast or observation time",
    START: r"\binitial|\breference|\banalysis|\bmodel run|\brun time|\bbase time|\bcycle"
    r"|start of (the )?(forecast|run)",
}  # of long names; the first that matches
NAMED = {
    VALID: r"(forecast_)?(valid|validity|verification|verif)(_?(time|date|datetime))?",
    START: r"(forecast_)?(init(ial(i[sz]ation)?)?|ref(erence)?|anal(ysis)?|(model_?)?run|cycle|base|issued?"
    r"|start)(_?(time|date|datetime|hour))?\d*",
    LEAD: r"steps?|lead(_?(time|hour|hours))?|tau|(forecast|prediction)_(period|hour|step|lead|timedelta)"
    r"|f?hour|fh|time_offset\d*|xtime",
}  # of variables
ABSOLUTE = re.compile(r"days? as %Y%m%d(\.%f)?")  # units of CDO and HYCOM
DATED = re.compile(r"\bsince\s+[-+]?\d")
WAY_OUT = (
    "give the valid time the attribute standard_name='time', and the start of the run "
    "standard_name='forecast_reference_time'"
)
TEXT_CLOCK = re.compile(r"\d{4}-\d\d-\d\d([T_ ]\d\d(:\d\d(:\d\d(\.\d+)?)?)?)?Z?")


class Clock(NamedTuple):
    """Times of an array along ``dims``: valid times [s since 1970] and leads [s], NaN if not known."""

    dims: tuple[str, ...]
    times: FloatArray
    leads: FloatArray
    notes: tuple[str, ...] = ()


class _Timer(NamedTuple):
    """A coordinate of time: its role, how it is stated (see :func:`_role`), and its values [s]."""

    name: str
    role: str
    rank: int
    values: xr.DataArray


def clock_of(file: Path, array: xr.DataArray) -> Clock:
    """Valid times and leads of ``array``.

    Raises
    ------
    DataError
        If there is no valid time, several that differ, or one that cannot be read.
    """
    timers = [
        timer for name, other in array.coords.items() if (timer := _timer(file, str(name), other, array))
    ]
    valid = _valid_time(file, array, timers)
    starts, leads = ([t for t in timers if t.role == role and t.name != valid.name] for role in (START, LEAD))
    notes: tuple[str, ...] = ()
    ahead = valid.values * np.nan
    if starts:
        ahead = valid.values - _one(file, array, starts).values
    elif leads:
        ahead = valid.values * 0.0 + _one(file, array, leads).values
    if starts and leads and _differ(ahead, leads[0].values):
        notes = (
            f"{leads[0].name} is not {valid.name} minus {starts[0].name}, which is used as the age of the "
            "forecast",
        )
    both = valid.values, ahead
    dims = tuple(str(name) for name in array.dims if any(name in part.dims for part in both))
    shape = tuple(array.sizes[name] for name in dims)
    times, found = (np.broadcast_to(_in_order(part, dims), shape) for part in both)
    known = times[np.isfinite(found)]
    if not (np.isfinite(times).all() and (times > EARLIEST).all() and (times < LATEST).all()):
        raise DataError(f"wind file {file}: {valid.name} has an invalid time; fetch the file again")
    if len(known) and np.nanmin(found) < -1.0:
        raise DataError(
            f"wind file {file}: {valid.name}, taken as the valid time, lies before the start of the run; "
            f"{WAY_OUT}"
        )
    return Clock(dims, times, np.asarray(found), notes)


def _in_order(values: xr.DataArray, dims: tuple[str, ...]) -> FloatArray:
    """The values with an axis for each of ``dims``, of length 1 where they do not have it."""
    lacking = [name for name in dims if name not in values.dims]
    ordered: FloatArray = values.expand_dims(lacking).transpose(*dims).values
    return ordered


def _differ(one: xr.DataArray, two: xr.DataArray) -> bool:
    return bool((np.abs(one - two) > 60.0).any())


# --- roles -----------------------------------------------------------------------------------


def _timer(file: Path, name: str, other: xr.DataArray, array: xr.DataArray) -> _Timer | None:
    """``other`` as a coordinate of time of ``array``; None if it is none."""
    if not set(other.dims) <= set(array.dims) or other.dtype.kind not in "iuf":
        return None
    units = str(other.attrs.get("units", "")).strip()
    since = " since " in units.lower()
    dated = DATED.search(units.lower()) is not None or ABSOLUTE.fullmatch(units) is not None
    role, rank = _role(name, other)
    if role == LEAD and not dated:
        second = SPANS.get(units.lower().partition(" ")[0])
        if second is None:
            return None
        return _Timer(name, role, rank, _plain(other.values.astype(float) * second, other.dims))
    if not (dated or since or rank == 2):
        return None
    values = _plain(_seconds(file, other).reshape(other.shape), other.dims)
    return _Timer(name, CLOCK if role == LEAD else role, rank, values)


def _plain(values: FloatArray, dims: tuple[Hashable, ...]) -> xr.DataArray:
    """An array with names of dimensions, and nothing else."""
    import xarray as xr

    return xr.DataArray(values, dims=dims)


def _role(name: str, other: xr.DataArray) -> tuple[str, int]:
    """Role and how it is stated: 2 by the standard name, 1 by the long name, 0 by the name or not at all."""
    if (role := STANDARD.get(str(other.attrs.get("standard_name", "")))) is not None:
        return role, 2
    words = " ".join(str(other.attrs.get(key, "")) for key in ("long_name", "description"))
    for role, pattern in DESCRIBED.items():
        if re.search(pattern, words.lower().replace("_", " ")):
            return role, 1
    for role, pattern in NAMED.items():
        if re.fullmatch(pattern, name.lower()):
            return role, 0
    return CLOCK, 0


def _valid_time(file: Path, array: xr.DataArray, timers: list[_Timer]) -> _Timer:
    by_role = {role: [t for t in timers if t.role == role] for role in (VALID, START, LEAD, CLOCK)}
    leads, clocks = by_role[LEAD], by_role[CLOCK]
    if by_role[VALID]:
        return _one(file, array, by_role[VALID], leads)
    starts = by_role[START]
    if len(clocks) == len(leads) == 1 and not starts and _beside(leads[0], clocks[0]):
        starts, clocks = clocks, []  # beside a dimension of leads, the clock has the starts of the runs
    if clocks:
        return _one(file, array, clocks, leads)
    if starts and leads:
        run, lead = (_one(file, array, found) for found in (starts, leads))
        return _Timer(f"{run.name} + {lead.name}", VALID, 2, run.values + lead.values)
    if starts:
        raise DataError(
            f"wind file {file}: {array.name} has the start of the run ({starts[0].name}) and no valid time; "
            f"expected the valid time or the lead beside it: {WAY_OUT}"
        )
    raise DataError(
        f"wind file {file}: {array.name} has no time; expected a coordinate with units such as "
        "'hours since 2018-10-09 00:00'"
    )


def _beside(lead: _Timer, clock: _Timer) -> bool:
    """Whether the leads are along a dimension of several values that the clock does not have."""
    return any(lead.values.sizes[name] > 1 for name in set(lead.values.dims) - set(clock.values.dims))


def _one(file: Path, array: xr.DataArray, timers: list[_Timer], leads: Sequence[_Timer] = ()) -> _Timer:
    """The one of ``timers``, which have one role; if they differ, the one that is another plus a lead."""
    ordered = sorted(timers, key=lambda t: (-t.rank, not set(t.values.dims) & set(array.dims), t.name))
    first, *others = ordered
    if not any(_differ(first.values, other.values) for other in others):
        return first
    for late in ordered:
        for early in ordered:
            if late is not early and any(not _differ(late.values, early.values + t.values) for t in leads):
                return late
    names = ", ".join(shown_text(timer.name) for timer in ordered)
    raise DataError(
        f"wind file {file}: {names} are times of {array.name} that differ, and the file does not state which "
        f"is its {first.role if first.role != CLOCK else VALID}: {WAY_OUT}"
    )


# --- values ----------------------------------------------------------------------------------


def _seconds(file: Path, array: xr.DataArray) -> FloatArray:
    """Times [s since 1970] of a coordinate, shape (n,)."""
    import xarray as xr

    units = str(array.attrs.get("units", ""))
    calendar = str(array.attrs.get("calendar", "")) or "standard"
    if ABSOLUTE.fullmatch(units.strip()):
        return _absolute_days(file, array)
    unit, _, since = units.strip().lower().partition(" ")
    plain = array.variable.copy()
    plain.attrs = {"units": f"{UNITS.get(unit, unit)} {since}", "calendar": calendar}
    try:
        coder = xr.coders.CFDatetimeCoder(use_cftime=False, time_unit="us")
        found = coder.decode(plain, array.name).values.reshape(-1)
        return np.where(np.isnat(found), np.nan, found.astype("M8[us]").astype(np.int64) / 1e6)
    except (ValueError, KeyError, OverflowError, TypeError):
        raise DataError(
            f"wind file {file}: {array.name}: its time units {shown_value(units)} in the calendar "
            f"{shown_value(calendar)} are not known; expected 'hours since 2018-10-09' in the standard "
            "calendar, from 1582 on"
        ) from None


def _absolute_days(file: Path, array: xr.DataArray) -> FloatArray:
    """Times [s since 1970] of dates such as 20181009.75."""
    found = []
    for value in np.ravel(array.values).astype(float):
        day, share = divmod(value, 1.0)
        try:
            found.append(seconds(f"{int(day):08d}") + round(share * 86_400.0))
        except (ValueError, OverflowError):
            raise DataError(
                f"wind file {file}: {array.name} has the time {value:.10g}; expected a date: 20181009.75"
            ) from None
    return np.array(found)


def with_text_clocks(data: xr.Dataset) -> xr.Dataset:
    """``data`` with clocks that are texts, such as ``Times`` of WRF, as seconds since 1970.

    WRF states the start of its run as an attribute of the file.
    """
    found: dict[Hashable, tuple[tuple[Hashable, ...], Any, dict[str, str]]] = {}
    for name, array in data.variables.items():
        text = "time" in str(name).lower() and array.dtype.kind in "SUO" and array.size <= MAX_LETTERS
        if text and (clock := _text_clock(array)) is not None:
            found[name] = clock
    if (start := data.attrs.get("SIMULATION_START_DATE")) is not None and TEXT_CLOCK.fullmatch(str(start)):
        described = {"units": SECONDS, "standard_name": "forecast_reference_time"}
        found["SIMULATION_START_DATE"] = ((), seconds(str(start).replace("_", "T")), described)
    return data.drop_vars([name for name in found if name in data]).assign(found)


def _text_clock(array: xr.Variable) -> tuple[tuple[Hashable, ...], FloatArray, dict[str, str]] | None:
    values = array.values
    dims = array.dims
    if array.dtype.kind == "S" and array.dtype.itemsize == 1 and array.ndim:  # one letter a value
        values = values.reshape(*values.shape[:-1], -1).view(f"S{values.shape[-1]}")[..., 0]
        dims = dims[:-1]
    texts = [
        t.decode("ascii", "replace") if isinstance(t, bytes) else str(t) for t in np.ravel(values).tolist()
    ]
    if not texts or not all(TEXT_CLOCK.fullmatch(text.strip()) for text in texts):
        return None
    try:
        times = [seconds(text.strip().replace("_", "T")) for text in texts]
    except ValueError:
        return None
    kept = {key: str(array.attrs[key]) for key in ("standard_name", "long_name") if key in array.attrs}
    role = {} if kept else {"standard_name": "time"}
    return dims, np.reshape(times, np.shape(values)), {"units": SECONDS} | kept | role
