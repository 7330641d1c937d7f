"""Wind readings as CSV tables: ``time,lat,lon,u,v`` on Earth, ``time,x,y,u,v`` in a plane.

Speeds are in m/s, or in the unit in the title of their column: ``u_kt``, ``v [km/h]``. A column
``lead_hours`` has the time from the start of the forecast to the time of the row; 0 is an analysis or
observation. Columns ``temperature_c`` and ``pressure_hpa``, also in other units, are of the air at the level
of the wind. A table may be compressed: ``winds.csv.gz``.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from careful_io.faults import Faults, FaultsError
from careful_io.files import write_text
from careful_io.messages import shown_text, shown_value
from careful_io.times import HOUR, iso
from flight_quantities.atmosphere import temperature_scale
from flight_quantities.levels import PRESSURES
from flight_quantities.sphere import wrap_longitude
from pareto_ltl import Readings
from pareto_ltl.extend import NodeAir, Snapshot, readings_of
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import check_readings
from pareto_ltl_apps.formats.flow_components import FROM, SPEED, TEMPERATURE, TOWARDS, polar_winds
from pareto_ltl_apps.formats.speed_units import EXPECTED, KNOT, speed_factor
from pareto_ltl_apps.formats.tables import Table, read_table, seconds_of

LOG = logging.getLogger("pareto_ltl.formats.csv_files")
AIR_PRESSURE = "pressure"
UNCLEAR = "direction"  # of a wind, that from which it blows; of a current it may be either
OTHER_UNITS = ("utc", "z", "gmt", "deg", "degrees", "degree", "degrees_north", "degrees_east", "degrees_true")
GEOGRAPHIC_COLUMNS = ("time", "lat", "lon", "u", "v")
TITLES = {  # of columns, without their units
    "time": ("valid_time", "time", "datetime", "date_time", "timestamp", "valid", "utc", "date"),
    "lat": ("lat", "latitude"),
    "lon": ("lon", "longitude", "long", "lng"),
    "x": ("x",),
    "y": ("y",),
    "u": ("u", "u_wind", "wind_u", "uwnd", "ugrd", "eastward_wind", "u_component_of_wind", "u_current"),
    "v": ("v", "v_wind", "wind_v", "vwnd", "vgrd", "northward_wind", "v_component_of_wind", "v_current"),
    SPEED: ("wind_speed", "windspeed", "speed", "wspd", "ws", "sknt", "current_speed", "drift"),
    FROM: (
        "wind_direction",
        "wind_dir",
        "winddirection",
        "wdir",
        "wd",
        "drct",
        "wind_from_direction",
        "from",
    ),
    TOWARDS: ("wind_to_direction", "direction_to", "direction_towards", "current_direction_to", "set"),
    UNCLEAR: ("direction", "dir", "current_direction"),
    TEMPERATURE: ("air_temperature", "temperature", "temp", "tmp"),
    AIR_PRESSURE: ("air_pressure", "pressure"),
}
LONGEST_TITLE = 60
MISSING = ("", "m", "nan", "null", "na", "-")  # cells of a column of the air without a value
LEAD_COLUMN = "lead_hours"
PLACES = (("time", "lat", "lon"), ("time", "x", "y"))
COLUMN_NAME = re.compile(r"[A-Za-z][\w .°/^*()\[\]-]{0,40}")
PLANAR_COLUMNS = ("time", "x", "y", "u", "v")
LONGEST_LEAD = 10_000.0  # [h]


def read_csv_files(files: tuple[Path, ...], max_speed: float, current: bool = False) -> Readings:
    """The readings of all tables in ``files``; rows may be in any order.

    Raises
    ------
    DataError
        If a file or row is not valid, some tables are in degrees and others in a plane, or two rows have the
        same time and place.
    """
    faults = Faults.of_files("wind file", files)
    found = faults.each(files, lambda file: read_csv_file(file, max_speed, current))
    faults.refuse()
    tables, planes, owners = zip(*(rows for _, rows in found), strict=True)
    if len(set(planes)) > 1:
        raise DataError(f"{files[0].parent}: some tables have lat,lon and some x,y; expected one kind")
    table = np.concatenate(tables)
    stamps, leads = table[:, 0], table[:, 1]
    _refuse_duplicates(table[:, [0, 2, 3]], [owner for each in owners for owner in each])
    fields, mixed = [], []
    for time in np.unique(stamps):
        rows = np.flatnonzero(stamps == time)
        own = leads[rows]
        if len(np.unique(own)) > 1:
            mixed.append(time)
        lead = np.nan if np.isnan(own).all() else float(np.nanmax(own))
        points, winds, warmth, pressure = np.split(table[rows, 2:], [2, 4, 5], axis=1)
        known = np.isfinite(warmth).any() and not current
        air = NodeAir(points, warmth[:, 0], "10m", pressure[:, 0], "10m") if known else None
        fields.append(Snapshot(float(time), lead, points, winds, "10m", files, air=air))
    notes: tuple[str, ...] = ()
    if mixed:
        more = f" and {len(mixed) - 1} more times" if len(mixed) > 1 else ""
        notes = (
            f"rows of {iso(mixed[0])}{more} differ in lead_hours: the largest is used for the whole time",
        )
    return readings_of(fields, files, geographic=not planes[0], notes=notes)


def write_csv_table(
    path: Path, times: FloatArray, points: FloatArray, winds: FloatArray, leads: FloatArray
) -> None:
    """Write ``winds`` (K, N, 2) [m/s] at ``times`` (K,) [s since 1970] and ``points`` (N, 2), lon, lat [deg].

    ``leads`` (K,) [s] are written to the column ``lead_hours``; if none is known, the column is left out.
    """
    known = bool(np.isfinite(leads).any())
    lines = [",".join((*GEOGRAPHIC_COLUMNS, LEAD_COLUMN) if known else GEOGRAPHIC_COLUMNS)]
    for time, lead, rows in zip(times, leads, winds, strict=True):
        stamp = iso(time)
        end = "" if not known else "," if np.isnan(lead) else f",{lead / HOUR:.6g}"
        for (lon, lat), (u, v) in zip(points, rows, strict=True):
            lines.append(f"{stamp},{lat:.8g},{lon:.8g},{u + 0.0:.2f},{v + 0.0:.2f}{end}")
    write_text(path, "\n".join(lines) + "\n")


def read_csv_file(file: Path, max_speed: float, current: bool = False) -> tuple[FloatArray, bool, list[str]]:
    """The checked rows of ``file``, whether they are in a plane, and the description of each row.

    A row has its time [s since 1970] and lead [s], its place (longitude, latitude or x, y), u and v [m/s],
    and temperature [K] and pressure [Pa], NaN where they are not known. ``current``: a column ``direction``
    is not taken as that from which a wind blows.
    """
    columns_text = ",".join(GEOGRAPHIC_COLUMNS)
    table = read_table(file, columns_text, lambda titles: not _missing(_roles(titles)))
    layout = _layout(file, table, current)
    rows = table.rows[layout.skipped :]
    if not rows:
        raise DataError(f"wind file {file} has a header but no rows; expected {columns_text}")
    zones: list[bool] = []
    faults = Faults(f"wind file {file}")
    parsed = faults.each(
        rows, lambda row: _parse_row(f"{faults.where}, row {row[0]}", row[1], table, layout, zones)
    )
    cells = np.array([values for _, values in parsed]).reshape(len(parsed), len(layout.columns))
    if not all(zones) and not layout.zoned:
        LOG.warning(
            "%s: %d of %d times state no zone and are taken as UTC; write 2018-10-09T18:00:00Z, or the "
            "offset of the zone: 2018-10-09T13:00:00-05:00", file.name, zones.count(False), len(zones),
        )  # fmt: skip
    planar = layout.columns[1][0] == "x"
    points = cells[:, 1:3] if planar else cells[:, [2, 1]]
    winds = cells[:, 3:5] * layout.factors
    if layout.direction:
        winds = polar_winds(winds[:, 0], winds[:, 1], layout.direction)
    numbers = [number for (number, _), _ in parsed]
    names = [name for name, _ in layout.columns]

    def column(name: str) -> FloatArray:
        return cells[:, names.index(name)] if name in names else np.full(len(cells), np.nan)

    leads, air = column(LEAD_COLUMN) * HOUR, (column(TEMPERATURE), column(AIR_PRESSURE))
    with faults.noted():
        check_readings(points, winds, not planar, max_speed, faults.where, numbers)
    with faults.noted():
        NodeAir(points, air[0], "", air[1]).check(faults.where, numbers)
    faults.refuse()
    if not planar:
        points[:, 0] = wrap_longitude(points[:, 0])
    found = np.column_stack([cells[:, 0], leads, points, winds, *air])
    return found, planar, [f"{file.name}, row {number}" for number in numbers]


class _Layout(NamedTuple):
    """Roles and positions of the columns: time, place, two of the wind, and perhaps the lead.

    ``factors`` (2,) turn the wind into m/s and degrees; ``direction`` is the meaning of the second
    one, empty for u and v; ``clock`` is the position of the time of day, if dates and times are apart.
    """

    columns: list[tuple[str, int]]
    factors: FloatArray
    direction: str
    zoned: bool
    clock: int | None
    skipped: int  # rows of units
    air: Mapping[str, tuple[float, float]] = MappingProxyType({})  # factor and offset to [K] and [Pa]


@lru_cache(maxsize=4096)  # every line that may be the header is tried
def _split_title(title: str) -> tuple[str, str] | None:
    """Role and unit of a column: (u, "kt") for ``u_kt`` and ``u [kt]``; None for other titles."""
    if len(title) > LONGEST_TITLE:  # the patterns take time that is quadratic in the length
        return None
    found = re.fullmatch(r"(.*?)[ _]*[\[(]([^\])]*)[\])]", title)
    name, unit = (found[1], found[2]) if found else (title, "")
    name = re.sub(r"_?\d+ ?m(?=_|$)|(?<=[uv])\d+$", "", re.sub(r"[ -]+", "_", name.strip()))
    for role, names in TITLES.items():
        for known in sorted(names, key=len, reverse=True):
            if name == known:
                return role, unit.strip()
            end = name[len(known) + 1 :]
            ended = not found and name.startswith(f"{known}_") and re.fullmatch(r"[a-z/_]+", end)
            if ended and (role in ("u", "v", SPEED, TEMPERATURE, AIR_PRESSURE) or end in OTHER_UNITS):
                return role, end
    return None


def _roles(titles: list[str]) -> dict[str, list[tuple[int, str]]]:
    """Positions and units of the columns of each role."""
    found: dict[str, list[tuple[int, str]]] = {}
    for at, title in enumerate(titles):
        if (split := _split_title(title)) is not None:
            found.setdefault(split[0], []).append((at, split[1]))
    return found


def _missing(roles: Mapping[str, object]) -> list[str]:
    """The columns that a table lacks."""
    places = PLACES[1] if {"x", "y"} <= set(roles) else PLACES[0]
    missing = [name for name in places if name not in roles]
    polar = SPEED in roles and {FROM, TOWARDS, UNCLEAR} & set(roles)
    return missing + ([] if polar else [name for name in "uv" if name not in roles])


def _layout(file: Path, table: Table, current: bool) -> _Layout:
    """The columns of a table; a DataError if one is missing, occurs twice or has an unknown unit."""
    if not table.titles:
        raise DataError(f"wind file {file} is empty; expected a table with {','.join(GEOGRAPHIC_COLUMNS)}")
    roles = _roles(table.titles)
    if missing := _missing(roles):
        named = len(table.titles) > 1 and all(
            map(COLUMN_NAME.fullmatch, table.titles)
        )  # else it is not quoted
        found = shown_value(",".join(table.titles), 60) if named else "no names of columns in its first line"
        raise DataError(
            f"wind file {file}: missing column {', '.join(missing)}; expected {','.join(GEOGRAPHIC_COLUMNS)} "
            f"(or {','.join(PLANAR_COLUMNS)} in a plane; or wind_speed_kt,wind_direction instead of u,v), "
            f"found {found}"
        )
    places = PLACES[1] if {"x", "y"} <= set(roles) else PLACES[0]
    directions = [role for role in (FROM, TOWARDS, UNCLEAR) if role in roles]
    polar = not {"u", "v"} <= set(roles)
    winds = (SPEED, directions[0]) if polar else ("u", "v")
    time, clock = _time_columns(table.titles, roles["time"])
    chosen = {"time": time} | {
        role: _only(file, table.titles, role, roles[role]) for role in (*places[1:], *winds)
    }
    skipped = int(_is_units(table, chosen[places[1]][0]))
    units = [cell.strip() for cell in table.rows[0][1]] if skipped else []
    factors = [_unit_factor(file, table.titles, role, chosen[role], units) for role in winds]
    columns = [(role, at) for role, (at, _) in chosen.items()]
    if LEAD_COLUMN in table.titles:
        columns.append((LEAD_COLUMN, table.titles.index(LEAD_COLUMN)))
    air = _air_columns(file, table.titles, roles, units)
    columns += [(role, at) for role, (at, _) in air.items()]
    direction = ""
    if polar:
        direction = FROM if winds[1] == UNCLEAR and not current else winds[1]
        if direction == UNCLEAR:
            raise DataError(
                f"wind file {file}: column {table.titles[chosen[UNCLEAR][0]]} of a current does not say "
                "whether it is the direction from or towards; name it direction_to or wind_from_direction"
            )
    stated = table.titles[time[0]] in ("utc",) or time[1] in ("utc", "z", "gmt") or "UTC" in units[:1]
    scales = {role: scale for role, (_, scale) in air.items()}
    return _Layout(columns, np.array(factors), direction, stated, clock, skipped, scales)


def _air_columns(
    file: Path, titles: list[str], roles: Mapping[str, list[tuple[int, str]]], units: list[str]
) -> dict[str, tuple[int, tuple[float, float]]]:
    """Position, factor and offset of the columns of the air whose unit is known; a warning for others."""
    found = {}
    for role, names in ((TEMPERATURE, "temperature_c or temperature_k"), (AIR_PRESSURE, "pressure_hpa")):
        for at, unit in roles.get(role, [])[:1]:
            stated = unit or (units[at] if at < len(units) else "")
            factor = PRESSURES.get(stated.lower())
            scale = None if factor is None else (factor, 0.0)
            if role == TEMPERATURE:
                scale = temperature_scale(stated)
            if scale is None:
                LOG.warning(
                    "%s: column %s states no unit that is known, and is not used; name it %s", file.name,
                    shown_text(titles[at]), names,
                )  # fmt: skip
            else:
                found[role] = at, scale
    return found if TEMPERATURE in found else {}


def _time_columns(titles: list[str], found: list[tuple[int, str]]) -> tuple[tuple[int, str], int | None]:
    """The column of times; if it has dates only, also the column of the times of day."""
    names = {titles[at]: (at, unit) for at, unit in found}
    if "date" in names and "time" in names:
        return names["date"], names["time"][0]
    valid = [column for column in found if titles[column[0]].startswith("valid")]
    return (valid or found)[0], None


def _only(file: Path, titles: list[str], role: str, found: list[tuple[int, str]]) -> tuple[int, str]:
    if len(found) > 1:
        there = shown_text(" and as ".join(titles[at] for at, _ in found))
        raise DataError(f"wind file {file}: column {role} occurs as {there}; keep one")
    return found[0]


def _is_units(table: Table, at: int) -> bool:
    """Whether the first row has the units of the columns, as tables of ERDDAP: ``UTC,degrees_north,...``."""
    cells = table.rows[0][1] if table.rows else []
    return at < len(cells) and cells[at].strip().lower().startswith("deg")


def _unit_factor(
    file: Path, titles: list[str], role: str, column: tuple[int, str], units: list[str]
) -> float:
    """Metres per second, or degrees, in one unit of a column of the wind."""
    at, unit = column
    unit = unit or (units[at] if at < len(units) else "")
    title = titles[at]
    if role not in ("u", "v", SPEED):
        return 1.0
    if not unit and title in ("sknt", "drift"):
        return KNOT
    if not unit and role == SPEED:
        LOG.warning(
            "%s: column %s states no unit and is taken as m/s; if it is in knots, name it %s_kt", file.name,
            shown_text(title), shown_text(title),
        )  # fmt: skip
    factor = speed_factor(unit) if unit else 1.0
    if factor is None:
        raise DataError(
            f"wind file {file}: column {shown_value(title)} has the unit {shown_value(unit)}; "
            f"expected {role} in m/s, or one of the units {EXPECTED}"
        )
    return factor


def _parse_row(
    where: str, row: list[str], table: Table, layout: _Layout, zones: list[bool]
) -> tuple[float, ...]:
    values, wrong = list[float](), list[str]()
    for name, at in layout.columns:
        text = row[at].strip() if at < len(row) else ""
        if name == "time" and layout.clock is not None and layout.clock < len(row):
            text = f"{text} {row[layout.clock].strip()}"
        try:
            if name == "time":
                time, zoned = seconds_of(text)
                zones.append(zoned)
                values.append(time)
            elif name == LEAD_COLUMN:
                values.append(_lead_hours(table, text))
            elif name in layout.air:
                factor, offset = layout.air[name]
                values.append(np.nan if text.lower() in MISSING else table.number(text) * factor + offset)
            else:
                values.append(table.number(text))
        except ValueError:
            wanted = CELLS.get(name, "a number")
            wrong.append(f"{where}: {name} is {shown_value(text)}; expected {wanted}")
    if wrong:
        raise FaultsError(wrong[0], tuple(wrong))
    return tuple(values)


def _refuse_duplicates(keys: FloatArray, owners: list[str]) -> None:
    order, faults = np.lexsort(keys.T[::-1]), Faults("the wind")
    for at in np.flatnonzero((np.diff(keys[order], axis=0) == 0).all(axis=1)).tolist():
        one, two = (owners[order[at + i]] for i in (0, 1))
        faults.add(f"wind readings of {one} and {two} are at the same time and place; keep one of them")
    faults.refuse()


def _lead_hours(table: Table, text: str) -> float:
    """Hours from 0 to :data:`LONGEST_LEAD`; NaN for an empty cell; ValueError for other values."""
    hours = table.number(text) if text else np.nan
    if text and not 0.0 <= hours <= LONGEST_LEAD:
        raise ValueError
    return hours


CELLS = {  # what is expected in a cell
    "time": "an ISO 8601 time such as 2018-10-09T18:00:00Z",
    LEAD_COLUMN: f"hours since the forecast began, 0 to {LONGEST_LEAD:g}, or nothing",
}
