"""Tables of forecasts at points, by run, place and lead: CSV, NetCDF and npz.

=======  ==============================================================================================
CSV      columns run, place, lead (hours), u, v; optional lat, lon, and observed_u, observed_v (valid time)
NetCDF   variables u, v by dimensions run, place, lead; optional lat, lon (place)
npz      u, v (run, place, lead), or uv (run, place, lead, 2); run hours, lead hours; optional latlon
=======  ==============================================================================================

In an npz file, names may end with ``_int16``; then ``scale`` [m/s] is the unit and ``missing`` the value of a
gap. Winds are in m/s; a column or an attribute that states another unit is converted.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from careful_io.messages import shown_text
from careful_io.netcdf4 import opened_netcdf
from careful_io.times import HOUR
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.formats.speed_units import EXPECTED, speed_factor
from pareto_ltl_apps.formats.tables import Table, read_table, seconds_of
from pareto_ltl_apps.wind_errors.point_forecasts import PointForecasts

COLUMNS = "run,place,lead,u,v"
KINDS = (".csv", ".csv.gz", ".txt", ".nc", ".nc4", ".npz")
FASTEST = 150.0  # [m/s] a faster wind is refused
LONGEST_LEAD = 1000.0  # [h]
MOST_VALUES = 60_000_000  # of a table
MOST_BYTES = 2**30  # of an array of an npz file
RUNS = ("init_hours_since_1970", "run_hours_since_1970", "run_hours", "init_hours", "run", "init")
LEADS = ("lead_hours", "leads", "lead")
WINDS = ("uv", "det")
NO_LEADS = (
    "has no leads: it holds winds by time, which are no forecasts that a later run verifies; name a table by "
    "run, place and lead"
)
TITLES: Mapping[str, tuple[str, ...]] = {
    "run": ("run", "init", "init_time", "reference_time", "forecast_reference_time", "issued"),
    "place": ("place", "station", "site", "point", "name", "id"),
    "lead": ("lead", "lead_hours", "lead_h", "step", "leadtime"),
    "u": ("u",),
    "v": ("v",),
    "lat": ("lat", "latitude"),
    "lon": ("lon", "longitude"),
    "observed_u": ("observed_u", "obs_u"),
    "observed_v": ("observed_v", "obs_v"),
    "source": ("source", "model"),
}


def read_point_table(file: Path) -> PointForecasts:
    """The forecasts in a table.

    Raises
    ------
    ConfigError
        If there is no such file, or its name says none of ``KINDS``.
    DataError
        If its content is not such a table.
    """
    if not file.is_file():
        raise ConfigError(f"{file}: there is no such file; name a table of forecasts ({', '.join(KINDS)})")
    name = file.name.lower()
    readers = {"npz": _read_npz, "nc": _read_netcdf, "nc4": _read_netcdf}
    if not name.endswith(KINDS):
        raise ConfigError(f"{file}: expected a table {', '.join(KINDS)}, with {COLUMNS}")
    return readers.get(name.rpartition(".")[2], _read_csv)(file)


def _table(
    file: Path, runs: FloatArray, leads: FloatArray, winds: FloatArray, *, places: FloatArray | None = None,
    observed: tuple[FloatArray, FloatArray] | None = None, notes: Iterable[str] = (),
) -> PointForecasts:  # fmt: skip
    """The checked table, with runs and leads in order."""
    if winds.ndim != 4 or winds.shape[-1] != 2 or winds.shape[0] != len(runs) or winds.shape[2] != len(leads):
        raise DataError(
            f"{file}: winds have the shape {winds.shape}; expected ({len(runs)} runs, places, {len(leads)} "
            "leads, 2)"
        )
    if not np.isfinite(winds).all(axis=-1).any():
        raise DataError(f"{file}: holds no wind")
    for what, values in (("run", runs), ("lead", leads)):
        if len(np.unique(values)) < len(values) or not np.isfinite(values).all():
            raise DataError(f"{file}: the same {what} occurs twice, or is no number; are there two sources?")
    if leads.min() < 0 or leads.max() > LONGEST_LEAD * HOUR:
        raise DataError(f"{file}: a lead is not from 0 to {LONGEST_LEAD:g} h; leads are in hours")
    fastest = float(np.nanmax(np.abs(winds)))
    if fastest > FASTEST:
        raise DataError(
            f"{file}: a wind of {fastest:.0f} m/s is above {FASTEST:g} m/s; winds are in m/s, "
            "and a gap is NaN"
        )
    rows, columns = np.argsort(runs), np.argsort(leads)
    times, seen = (np.empty(0), np.empty((0, winds.shape[1], 2))) if observed is None else observed
    return PointForecasts(
        file.name, runs[rows], leads[columns], winds[rows][:, :, columns], places, times, seen, tuple(notes)
    )


# --- npz --------------------------------------------------------------------------------------


def _read_npz(file: Path) -> PointForecasts:
    arrays = npz_arrays(file)
    run, lead = (first_named(arrays, names) for names in (RUNS, LEADS))
    if lead is None or run is None:
        what = NO_LEADS if lead is None else f"has no times of runs ({RUNS[0]})"
        raise DataError(f"{file}: {what}; it has {', '.join(sorted(arrays))}")
    if "u" in arrays and "v" in arrays:
        winds = np.stack([unpacked_winds(arrays, "u"), unpacked_winds(arrays, "v")], axis=-1)
    else:
        names = [name for name in WINDS if name in arrays or f"{name}_int16" in arrays]
        if not names:
            raise DataError(f"{file}: has no winds (uv, or u and v); it has {', '.join(sorted(arrays))}")
        winds = unpacked_winds(arrays, names[0])
    places = None
    if "latlon" in arrays:
        latlon = numbers_of(arrays["latlon"], "latlon")
        if latlon.shape != (winds.shape[1], 2) or np.abs(latlon[:, 0]).max() > 90:
            raise DataError(
                f"{file}: latlon has the shape {latlon.shape}; expected ({winds.shape[1]}, 2), degrees"
            )
        places = latlon[:, ::-1]
    observed = None
    if "obs_int16" in arrays or "obs" in arrays:
        seen = unpacked_winds(arrays, "obs")
        first = float(numbers_of(arrays["obs_first_hour"], "obs_first_hour"))
        observed = (HOUR * (first + np.arange(len(seen), dtype=float)), seen)
    starts, ahead = (HOUR * numbers_of(each, "runs and leads").ravel() for each in (run, lead))
    return _table(file, starts, ahead, winds, places=places, observed=observed)


def npz_arrays(file: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an npz file; DataError if it is damaged, holds objects or unpacks to too much."""
    try:
        with zipfile.ZipFile(file) as archive:
            if any(each.file_size > MOST_BYTES for each in archive.infolist()):
                raise DataError(f"{file}: an array has more than {MOST_BYTES / 2**20:g} MiB")
        with np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, KeyError, NotImplementedError) as error:
        raise DataError(f"{file}: is damaged, or not an npz file of plain arrays ({error})") from None


def first_named(arrays: Mapping[str, NDArray[Any]], names: Sequence[str]) -> NDArray[Any] | None:
    """The first array that has one of ``names``; None if there is none."""
    return next((arrays[name] for name in names if name in arrays), None)


def numbers_of(array: NDArray[Any], name: str) -> FloatArray:
    """The array as floats; DataError if it does not hold numbers."""
    if array.dtype.kind not in "biuf":
        raise DataError(f"{name} holds {array.dtype}; expected numbers")
    return np.asarray(array, float)


def unpacked_winds(arrays: Mapping[str, NDArray[Any]], name: str) -> FloatArray:
    """The winds ``name`` [m/s], with NaN for gaps."""
    packed = f"{name}_int16"
    if packed not in arrays:
        return numbers_of(arrays[name], name)
    values = numbers_of(arrays[packed], packed)
    missing = float(numbers_of(arrays.get("missing", np.array(-32768)), "missing"))
    scale = float(numbers_of(arrays.get("scale", np.array(1.0)), "scale"))
    return np.where(values == missing, np.nan, values * scale)


# --- CSV --------------------------------------------------------------------------------------


def _read_csv(file: Path) -> PointForecasts:
    table = read_table(file, COLUMNS, lambda titles: {"u", "v", "run"} <= set(_roles(titles)))
    roles = _roles(table.titles)
    lacking = [name for name in ("run", "place", "lead", "u", "v") if name not in roles]
    if "lead" in lacking:
        raise DataError(f"{file}: {NO_LEADS}; its columns are {shown_text(', '.join(table.titles))}")
    if lacking:
        raise DataError(f"{file}: lacks the columns {', '.join(lacking)}; expected {COLUMNS}")
    if not table.rows:
        raise DataError(f"{file}: holds no rows below its header")
    factors = {
        name: _column_factor(file, table.titles[roles[name]], name) for name in roles if name[-1] in "uv"
    }
    if "source" in roles:
        _refuse_two_sources(file, table, roles["source"])
    numbers = {
        name: _column(file, table, roles[name], name) * factors.get(name, 1.0)
        for name in roles
        if name not in ("run", "place", "source")
    }
    stamps, zoned = _run_times(file, table, roles["run"])
    notes = () if zoned else (f"{file.name}: the times state no zone; they are taken as UTC",)
    names = [row[roles["place"]].strip() for _, row in table.rows]
    return _gridded(file, stamps, names, numbers, notes)


def _roles(titles: Sequence[str]) -> dict[str, int]:
    """The columns by their role; a unit in a title (``u_kt``, ``u [m/s]``) does not count."""
    found: dict[str, int] = {}
    for column, title in enumerate(titles):
        for role, names in TITLES.items():
            if role not in found and (title in names or (role[-1] in "uv" and _plain(title) in names)):
                found[role] = column
    return found


def _plain(title: str) -> str:
    head = title.replace("[", " ").replace("(", " ").split()[0] if title.split() else ""
    stem, _, unit = head.rpartition("_")
    return stem if stem and speed_factor(unit) is not None else head


def _column_factor(file: Path, title: str, role: str) -> float:
    unit = title[len(_plain(title)) :].strip(" _[]()")
    if not unit:
        return 1.0
    factor = speed_factor(unit)
    if factor is None:
        raise DataError(
            f"{file}: the column {shown_text(title)} of {role} has no known unit; expected {EXPECTED}"
        )
    return factor


def _refuse_two_sources(file: Path, table: Table, column: int) -> None:
    names = sorted({row[column].strip() for _, row in table.rows if len(row) > column})
    if len(names) > 1:
        raise DataError(
            f"{file}: holds forecasts of {len(names)} sources ({shown_text(', '.join(names[:4]))}); a law is "
            "of one: make a table of each"
        )


def _column(file: Path, table: Table, column: int, name: str) -> FloatArray:
    values = np.empty(len(table.rows))
    for i, (line, row) in enumerate(table.rows):
        text = row[column].strip() if len(row) > column else ""
        try:
            values[i] = table.number(text) if text else math.nan
        except ValueError:
            raise DataError(f"{file}: line {line}: {name} is {shown_text(text)}; expected a number") from None
    if name == "lead" and not np.isfinite(values).all():
        raise DataError(
            f"{file}: line {table.rows[int(np.argmin(np.isfinite(values)))][0]}: the lead is missing"
        )
    return values


def _run_times(file: Path, table: Table, column: int) -> tuple[FloatArray, bool]:
    """Times of the runs [s since 1970], and whether all state their zone."""
    stamps, zoned = np.empty(len(table.rows)), True
    for i, (line, row) in enumerate(table.rows):
        try:
            stamps[i], stated = seconds_of(row[column])
        except (ValueError, IndexError):
            text = shown_text(row[column]) if len(row) > column else "missing"
            raise DataError(f"{file}: line {line}: run is {text}; expected a time, ISO 8601") from None
        zoned &= stated
    return stamps, zoned


def _gridded(
    file: Path,
    stamps: FloatArray,
    names: Sequence[str],
    numbers: Mapping[str, FloatArray],
    notes: Iterable[str],
) -> PointForecasts:
    runs, run = np.unique(stamps, return_inverse=True)
    leads, lead = np.unique(numbers["lead"] * HOUR, return_inverse=True)
    labels, place = np.unique(np.array(names), return_inverse=True)
    shape = (len(runs), len(labels), len(leads))
    if math.prod(shape) > MOST_VALUES:
        raise DataError(f"{file}: {shape[0]} runs, {shape[1]} places and {shape[2]} leads are too many")
    cell = np.ravel_multi_index((run, place, lead), shape)
    cells, counts = np.unique(cell, return_counts=True)
    if counts.max() > 1:
        first = int(np.flatnonzero(cell == cells[np.argmax(counts)])[1])
        raise DataError(
            f"{file}: two rows have the run, the place and the lead of row {first + 1} of the data; a table "
            "holds one source"
        )
    winds = np.full((*shape, 2), np.nan)
    winds.reshape(-1, 2)[cell] = np.stack([numbers["u"], numbers["v"]], axis=-1)
    places = None
    if "lat" in numbers and "lon" in numbers:
        places = np.full((len(labels), 2), np.nan)
        places[place] = np.stack([numbers["lon"], numbers["lat"]], axis=-1)
        places = places if np.isfinite(places).all() else None
    observed = None
    if "observed_u" in numbers and "observed_v" in numbers:
        observed = _observations(stamps + numbers["lead"] * HOUR, place, len(labels), numbers)
    return _table(file, runs, leads, winds, places=places, observed=observed, notes=notes)


def _observations(
    valid: FloatArray, place: IntArray, places: int, numbers: Mapping[str, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    times, at = np.unique(np.round(valid), return_inverse=True)
    seen = np.full((len(times), places, 2), np.nan)
    values = np.stack([numbers["observed_u"], numbers["observed_v"]], axis=-1)
    known = np.isfinite(values).all(axis=-1)
    seen[at[known], place[known]] = values[known]
    return times, seen


# --- NetCDF -----------------------------------------------------------------------------------


def _read_netcdf(file: Path) -> PointForecasts:
    try:
        with opened_netcdf(file) as content:
            return _from_netcdf(file, content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError) as error:
        raise DataError(f"{file}: not a NetCDF-4 file with u, v by run, place and lead ({error})") from None


def _from_netcdf(file: Path, content: Any) -> PointForecasts:
    lacking = [name for name in ("run", "lead", "u", "v") if name not in content.variables]
    if lacking:
        raise DataError(f"{file}: {NO_LEADS if 'lead' in lacking else 'lacks ' + ', '.join(lacking)}")
    winds = []
    for name in ("u", "v"):
        variable = content.variables[name]
        if sorted(variable.dimensions) != ["lead", "place", "run"]:
            raise DataError(
                f"{file}: {name} has the dimensions {', '.join(variable.dimensions)}; expected run, place, "
                "lead"
            )
        if math.prod(variable.shape) > MOST_VALUES:
            raise DataError(f"{file}: {name} has too many values")
        unit = str(variable.attrs.get("units", "m/s"))
        if (factor := speed_factor(unit)) is None:
            raise DataError(f"{file}: {name} has the unit {shown_text(unit)}; expected {EXPECTED}")
        order = [variable.dimensions.index(each) for each in ("run", "place", "lead")]
        winds.append(factor * _unpacked(variable).transpose(order))
    places = None
    if "lat" in content.variables and "lon" in content.variables:
        places = np.stack([_unpacked(content.variables[name]).ravel() for name in ("lon", "lat")], axis=-1)
    runs = _netcdf_times(file, content.variables["run"])
    lead = content.variables["lead"]
    hours = str(lead.attrs.get("units", "hours")).strip().lower()
    unit_of = {
        "hours": HOUR,
        "hour": HOUR,
        "h": HOUR,
        "seconds": 1.0,
        "s": 1.0,
        "minutes": 60.0,
        "days": 24 * HOUR,
    }
    if hours not in unit_of:
        raise DataError(f"{file}: lead has the unit {shown_text(hours)}; expected hours")
    leads = unit_of[hours] * _unpacked(lead).ravel()
    return _table(file, runs, leads, np.stack(winds, axis=-1), places=places)


def _unpacked(variable: Any) -> FloatArray:
    raw = np.asarray(variable[...])
    values = numbers_of(raw, variable.name)
    for name in ("_FillValue", "missing_value"):
        if name in variable.attrs:
            values = np.where(raw == np.ravel(variable.attrs[name])[0], np.nan, values)
    scale, offset = (
        float(np.ravel(variable.attrs.get(n, d))[0]) for n, d in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    return np.asarray(values * scale + offset, float)


def _netcdf_times(file: Path, variable: Any) -> FloatArray:
    units = str(variable.attrs.get("units", "")).split(" since ")
    unit_of = {"seconds": 1.0, "minutes": 60.0, "hours": HOUR, "days": 24 * HOUR}
    if len(units) != 2 or units[0].strip().lower() not in unit_of:
        raise DataError(f"{file}: run has no units such as 'hours since 1970-01-01'")
    try:
        zero, _ = seconds_of(units[1].strip())
    except ValueError:
        raise DataError(f"{file}: the units of run name no time: {shown_text(units[1])}") from None
    return zero + unit_of[units[0].strip().lower()] * _unpacked(variable).ravel()
