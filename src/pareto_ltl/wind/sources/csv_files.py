"""Wind readings as CSV tables: ``time,lat,lon,u,v`` on Earth, ``time,x,y,u,v`` in a plane.

Speeds are in m/s, or in the unit that the title of their column names: ``u_kt``, ``v [km/h]``. A table may be
packed: ``winds.csv.gz``.
"""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from functools import lru_cache
from pathlib import Path
from typing import IO

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_text
from pareto_ltl.support.messages import shown_text, shown_value
from pareto_ltl.wind.readings import Readings, check_readings, iso, seconds, wrap_longitude

GEOGRAPHIC_COLUMNS = ("time", "lat", "lon", "u", "v")
MOST_UNPACKED = 2**28  # [bytes] of a packed table
KNOT = 1852.0 / 3600.0  # [m/s]
SPEED_UNITS = {  # [m/s], by what stands in the title of a column; without a unit it is m/s
    "": 1.0, "m/s": 1.0, "m s-1": 1.0, "ms": 1.0, "mps": 1.0,
    "kt": KNOT, "kts": KNOT, "kn": KNOT, "knot": KNOT, "knots": KNOT,
    "km/h": 1.0 / 3.6, "kmh": 1.0 / 3.6, "mph": 0.44704,
}  # fmt: skip
PLANAR_COLUMNS = ("time", "x", "y", "u", "v")


def read_csv_files(files: tuple[Path, ...], max_speed: float) -> Readings:
    """The readings of all tables in ``files``; rows may have any order.

    Raises
    ------
    DataError
        If a file or row cannot be read, the frames differ, or two rows have the same time and place.
    """
    parts = [_read_csv_file(file, max_speed) for file in files]
    if len({geographic for *_, geographic in parts}) > 1:
        raise DataError(f"{files[0].parent}: some tables have lat,lon and some x,y; expected one kind")
    stamps, points, winds = (np.concatenate([part[i] for part in parts]) for i in range(3))
    owners = [f"{file.name}, row {row}" for file, part in zip(files, parts, strict=True) for row in part[3]]
    _refuse_duplicates(stamps, points, owners)
    times = np.unique(stamps)
    rows = [np.flatnonzero(stamps == time) for time in times]
    return Readings(
        times=times,
        points=tuple(points[r] for r in rows),
        winds=tuple(winds[r] for r in rows),
        geographic=parts[0][4],
        files=files,
        remarks=("",) * len(times),
        origins=(files,) * len(times),
        leads=np.full(len(times), np.nan),
    )


def write_csv_table(
    path: Path, times: FloatArray, points: FloatArray, winds: FloatArray, decimals: int = 2
) -> None:
    """Write winds (K, N, 2) [m/s] at ``times`` (K,) [s since 1970] and ``points`` (N, 2), lon, lat [deg]."""
    lines = [",".join(GEOGRAPHIC_COLUMNS)]
    for time, rows in zip(times, winds, strict=True):
        stamp = iso(time)
        for (lon, lat), (u, v) in zip(points, rows, strict=True):
            lines.append(f"{stamp},{lat:.8g},{lon:.8g},{u + 0.0:.{decimals}f},{v + 0.0:.{decimals}f}")
    write_text(path, "\n".join(lines) + "\n")


def _read_csv_file(file: Path, max_speed: float) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, bool]:
    """Times (N,), points (N, 2), winds (N, 2), row numbers (N,), and whether the frame is geographic."""
    try:
        with _open_text(file) as stream:
            reader = csv.reader(stream)
            header = [name.strip().lower() for name in next(reader, [])]
            columns, speeds = _find_columns(file, header)
            cells = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except OSError as error:
        raise DataError(f"wind file {file} cannot be read: {error.strerror or error}") from None
    except (EOFError, zlib.error) as error:
        raise DataError(f"wind file {file} is damaged or cut off ({error}); fetch it again") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(
            f"wind file {file} is no CSV text ({error}); expected {','.join(GEOGRAPHIC_COLUMNS)}"
        ) from None
    if not cells:
        raise DataError(f"wind file {file} has a header but no rows; expected {','.join(GEOGRAPHIC_COLUMNS)}")
    table = np.array([_parse_row(f"wind file {file}, row {number}", row, columns) for number, row in cells])
    numbers = np.array([number for number, _ in cells], dtype=np.int64)
    geographic = columns[1][0] == "lat"
    points, winds = (table[:, [2, 1]] if geographic else table[:, 1:3]), table[:, 3:5] * speeds
    check_readings(points, winds, geographic, max_speed, lambda i: f"wind file {file}, row {numbers[i]}")
    if geographic:
        points[:, 0] = wrap_longitude(points[:, 0])
    return table[:, 0], points, winds, numbers, geographic


def _open_text(file: Path) -> IO[str]:
    """The text of ``file``, which gzip may have packed."""
    if file.suffix.lower() != ".gz":
        return file.open(encoding="utf-8-sig", newline="")
    with gzip.open(file) as packed:
        data = packed.read(MOST_UNPACKED + 1)
    if len(data) > MOST_UNPACKED:
        raise DataError(
            f"wind file {file} unpacks to more than {MOST_UNPACKED / 2**20:g} MiB; split it into several"
        )
    return io.StringIO(data.decode("utf-8-sig"), newline="")


def _find_columns(file: Path, header: list[str]) -> tuple[list[tuple[str, int]], FloatArray]:
    """Name and position of the five columns, and the factors (2,) from the units of u and v to m/s."""
    if not header:
        raise DataError(f"wind file {file} is empty; expected a table with {','.join(GEOGRAPHIC_COLUMNS)}")
    speeds = {name: [found for found in header if _speed_unit(name, found) is not None] for name in "uv"}
    wanted = PLANAR_COLUMNS if {"x", "y"} <= set(header) else GEOGRAPHIC_COLUMNS
    missing = [name for name in wanted if not speeds.get(name, name in header)]
    if missing:
        found = shown_value(",".join(header), 60)
        raise DataError(
            f"wind file {file}: missing column {', '.join(missing)}; expected {','.join(GEOGRAPHIC_COLUMNS)} "
            f"(or {','.join(PLANAR_COLUMNS)} in a plane), found {found}"
        )
    titles = [_only_one(file, name, speeds.get(name, [name])) for name in wanted]
    factors = [_speed_factor(file, name, title) for name, title in zip("uv", titles[3:], strict=True)]
    columns = [(name, header.index(title)) for name, title in zip(wanted, titles, strict=True)]
    return columns, np.array(factors)


def _speed_unit(name: str, title: str) -> str | None:
    """The unit in the title of a speed column: "" for ``u``, "kt" for ``u_kt`` and ``u [kt]``; else None."""
    found = re.fullmatch(rf"{name}(?:[ _]*[\[(]([^\])]*)[\])]|_([a-z/]+))?", title)
    return None if found is None else (found[1] or found[2] or "").strip()


def _only_one(file: Path, name: str, titles: list[str]) -> str:
    if len(titles) > 1:
        there = shown_text(" and as ".join(titles))
        raise DataError(f"wind file {file}: column {name} is there as {there}; keep one")
    return titles[0]


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
        try:
            values.append(_cached_seconds(text) if name == "time" else float(text))
        except ValueError:
            wanted = "an ISO 8601 time such as 2018-10-09T18:00:00Z" if name == "time" else "a number"
            raise DataError(f"{where}: {name} is {shown_value(text)}; expected {wanted}") from None
    return tuple(values)


def _refuse_duplicates(stamps: FloatArray, points: FloatArray, owners: list[str]) -> None:
    keys = np.column_stack([stamps, points])
    order = np.lexsort(keys.T[::-1])
    same = np.flatnonzero((np.diff(keys[order], axis=0) == 0).all(axis=1))
    if len(same):
        one, two = (owners[order[same[0] + i]] for i in (0, 1))
        raise DataError(f"wind readings of {one} and {two} are at the same time and place; keep one of them")


_cached_seconds = lru_cache(maxsize=4096)(seconds)  # many rows share few times


__all__ = ["read_csv_files", "write_csv_table"]
