"""Wind readings as CSV tables: ``time,lat,lon,u,v`` on Earth, ``time,x,y,u,v`` in a plane.

Speeds are in m/s, or in the unit in the title of their column: ``u_kt``, ``v [km/h]``. A column
``lead_hours`` has the time from the start of the forecast to the time of the row; 0 is an analysis or
observation. A table may be compressed: ``winds.csv.gz``.
"""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_text
from pareto_ltl.support.messages import shown_text, shown_value
from pareto_ltl.wind.readings import HOUR, KNOT, Readings, check_readings, iso, seconds, wrap_longitude
from pareto_ltl.wind.snapshots import Snapshot, readings_of
from pareto_ltl.wind.sources.magic import format_of, refuse_other_format

GEOGRAPHIC_COLUMNS = ("time", "lat", "lon", "u", "v")
MOST_UNPACKED = 2**28  # [bytes] of a table; of a compressed one, when unpacked
MOST_ROWS = 1_000_000  # of a table; a row takes 1 kB of memory while it is read
SMALLER_TABLE = "keep the rows near the map and the hours of the flight"
SPEED_UNITS = {  # [m/s], by the unit in the title of a column; m/s without a unit
    "": 1.0, "m/s": 1.0, "m s-1": 1.0, "ms": 1.0, "mps": 1.0,
    "kt": KNOT, "kts": KNOT, "kn": KNOT, "knot": KNOT, "knots": KNOT,
    "km/h": 1.0 / 3.6, "kmh": 1.0 / 3.6, "mph": 0.44704,
}  # fmt: skip
COLUMN_NAME = re.compile(r"[A-Za-z][\w .°/^*()\[\]-]{0,40}")
PLANAR_COLUMNS = ("time", "x", "y", "u", "v")
LEAD_COLUMN = "lead_hours"
LONGEST_LEAD = 10_000.0  # [h]


def read_csv_files(files: tuple[Path, ...], max_speed: float) -> Readings:
    """The readings of all tables in ``files``; rows may be in any order.

    Raises
    ------
    DataError
        If a file or row is not valid, some tables are in degrees and others in a plane, or two rows have the
        same time and place.
    """
    tables, planes, owners = zip(*(read_csv_file(file, max_speed) for file in files), strict=True)
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
        fields.append(Snapshot(float(time), lead, table[rows, 2:4], table[rows, 4:], "10m", files))
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


def read_csv_file(file: Path, max_speed: float) -> tuple[FloatArray, bool, list[str]]:
    """The checked rows of ``file``, whether they are in a plane, and the description of each row.

    A row has its time [s since 1970] and lead [s], its place (longitude, latitude or x, y), and u and v
    [m/s].
    """
    with open_table(file, ",".join(GEOGRAPHIC_COLUMNS)) as stream:
        reader = csv.reader(stream)
        header = [name.strip().lower() for name in next(reader, [])]
        columns, speeds = _find_columns(file, header)
        cells = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    if not cells:
        raise DataError(f"wind file {file} has a header but no rows; expected {','.join(GEOGRAPHIC_COLUMNS)}")
    table = np.array([_parse_row(f"wind file {file}, row {number}", row, columns) for number, row in cells])
    planar = columns[1][0] == "x"
    points, winds = (table[:, 1:3] if planar else table[:, [2, 1]]), table[:, 3:5] * speeds
    numbers = [number for number, _ in cells]
    check_readings(points, winds, not planar, max_speed, f"wind file {file}", numbers)
    if not planar:
        points[:, 0] = wrap_longitude(points[:, 0])
    leads = table[:, 5] * HOUR if len(columns) > 5 else np.full(len(table), np.nan)
    rows = np.column_stack([table[:, 0], leads, points, winds])
    return rows, planar, [f"{file.name}, row {number}" for number in numbers]


@contextmanager
def open_table(file: Path, expected: str) -> Iterator[IO[str]]:
    """In the block, the text of ``file``, which may be gzip-compressed; read errors become a DataError."""
    try:
        with _open_text(file) as stream:
            yield stream
    except OSError as error:
        raise DataError(f"wind file {file} cannot be read: {error.strerror or error}") from None
    except (EOFError, zlib.error) as error:
        raise DataError(f"wind file {file} is damaged or cut off ({error}); fetch it again") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"wind file {file} is not CSV text ({error}); expected {expected}") from None


def _open_text(file: Path) -> IO[str]:
    with file.open("rb") as raw:
        head = raw.read(64)
    packed = file.suffix.lower() == ".gz"
    if format_of(head) != "packed with gzip" or not packed:
        refuse_other_format(f"wind file {file}", head, "a CSV table")
    with gzip.open(file) if packed else file.open("rb") as content:
        data = content.read(MOST_UNPACKED + 1)
    size = f"{MOST_UNPACKED / 2**20:g} MiB"
    if packed and len(data) > MOST_UNPACKED:
        raise DataError(f"wind file {file} unpacks to more than {size}; {SMALLER_TABLE}")
    if len(data) > MOST_UNPACKED or data.count(b"\n") > MOST_ROWS:
        raise DataError(f"wind file {file} has more than {MOST_ROWS:,} rows or {size}; {SMALLER_TABLE}")
    return io.StringIO(data.decode("utf-8-sig"), newline="")


def _find_columns(file: Path, header: list[str]) -> tuple[list[tuple[str, int]], FloatArray]:
    """Names and positions of the columns, ``lead_hours`` last, and the factors (2,) of u and v to m/s."""
    if not header:
        raise DataError(f"wind file {file} is empty; expected a table with {','.join(GEOGRAPHIC_COLUMNS)}")
    speeds = {name: [found for found in header if _speed_unit(name, found) is not None] for name in "uv"}
    wanted = PLANAR_COLUMNS if {"x", "y"} <= set(header) else GEOGRAPHIC_COLUMNS
    missing = [name for name in wanted if not speeds.get(name, name in header)]
    if missing:
        table = len(header) > 1 and all(map(COLUMN_NAME.fullmatch, header))  # else it is not quoted
        found = shown_value(",".join(header), 60) if table else "no names of columns in its first line"
        raise DataError(
            f"wind file {file}: missing column {', '.join(missing)}; expected {','.join(GEOGRAPHIC_COLUMNS)} "
            f"(or {','.join(PLANAR_COLUMNS)} in a plane), found {found}"
        )
    for name, titles in speeds.items():
        if len(titles) > 1:
            there = shown_text(" and as ".join(titles))
            raise DataError(f"wind file {file}: column {name} occurs as {there}; keep one")
    titles = [*wanted[:3], speeds["u"][0], speeds["v"][0]]
    factors = [_speed_factor(file, name, title) for name, title in zip("uv", titles[3:], strict=True)]
    columns = [(name, header.index(title)) for name, title in zip(wanted, titles, strict=True)]
    if LEAD_COLUMN in header:
        columns.append((LEAD_COLUMN, header.index(LEAD_COLUMN)))
    return columns, np.array(factors)


def _speed_unit(name: str, title: str) -> str | None:
    """The unit in the title of a speed column: "" for ``u``, "kt" for ``u_kt`` and ``u [kt]``; else None."""
    found = re.fullmatch(rf"{name}(?:[ _]*[\[(]([^\])]*)[\])]|_([a-z/]+))?", title)
    return None if found is None else (found[1] or found[2] or "").strip()


def _speed_factor(file: Path, name: str, title: str) -> float:
    """Metres per second in one unit of the speed column ``title``."""
    unit = _speed_unit(name, title) or ""
    if unit not in SPEED_UNITS:
        known = ", ".join(unit for unit in SPEED_UNITS if unit)
        raise DataError(
            f"wind file {file}: column {shown_value(title)} has the unit {shown_value(unit)}; "
            f"expected {name} in m/s, or one of the units {known}"
        )
    return SPEED_UNITS[unit]


def _parse_row(where: str, row: list[str], columns: list[tuple[str, int]]) -> tuple[float, ...]:
    values = []
    for name, at in columns:
        text = row[at].strip() if at < len(row) else ""
        read, wanted = CELLS.get(name, (float, "a number"))
        try:
            values.append(read(text))
        except ValueError:
            raise DataError(f"{where}: {name} is {shown_value(text)}; expected {wanted}") from None
    return tuple(values)


def _refuse_duplicates(keys: FloatArray, owners: list[str]) -> None:
    order = np.lexsort(keys.T[::-1])
    same = np.flatnonzero((np.diff(keys[order], axis=0) == 0).all(axis=1))
    if len(same):
        one, two = (owners[order[same[0] + i]] for i in (0, 1))
        raise DataError(f"wind readings of {one} and {two} are at the same time and place; keep one of them")


def _lead_hours(text: str) -> float:
    """Hours from 0 to :data:`LONGEST_LEAD`; NaN for an empty cell; ValueError for other values."""
    hours = float(text) if text else np.nan
    if text and not 0.0 <= hours <= LONGEST_LEAD:
        raise ValueError
    return hours


CELLS: dict[str, tuple[Callable[[str], float], str]] = {  # how a cell is read, and what is expected in it
    "time": (seconds, "an ISO 8601 time such as 2018-10-09T18:00:00Z"),
    LEAD_COLUMN: (_lead_hours, f"hours since the forecast began, 0 to {LONGEST_LEAD:g}, or nothing"),
}
