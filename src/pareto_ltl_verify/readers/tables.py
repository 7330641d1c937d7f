"""Winds of CSV tables and reports of stations in such tables, read with :mod:`csv`."""

from __future__ import annotations

import csv
import gzip
import io
import re
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path

import numpy as np

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.readers.fields import FROM, KNOT, SPEED, TOWARDS, Field, UnreadError

MOST_BYTES = 2**28  # of an unpacked table
HEADER_LINES = 30
ROLES = {
    "time": "time valid_time datetime date_time timestamp valid utc date observation_time obstime",
    "lat": "lat latitude",
    "lon": "lon longitude long lng",
    "x": "x",
    "y": "y",
    "u": "u u_wind wind_u uwnd ugrd eastward_wind u_component_of_wind u_current",
    "v": "v v_wind wind_v vwnd vgrd northward_wind v_component_of_wind v_current",
    SPEED: "wind_speed windspeed speed wspd ws sknt current_speed drift",
    FROM: "wind_direction wind_dir winddirection wdir wd drct wind_from_direction from direction dir",
    TOWARDS: "wind_to_direction direction_to direction_towards current_direction_to set",
    "lead": "lead_hours",
}
ROLE_OF = {title: role for role, titles in ROLES.items() for title in titles.split()}
UNITS = {  # [m/s], without signs
    **dict.fromkeys(("", "ms", "ms1", "mps", "metrespersecond", "meterspersecond"), 1.0),
    **dict.fromkeys(("kt", "kts", "kn", "knot", "knots"), KNOT),
    **dict.fromkeys(("kmh", "kmh1", "kph"), 1.0 / 3.6), "mph": 0.44704, "cms": 0.01, "cms1": 0.01,
}  # fmt: skip
IN_KNOTS = ("sknt", "drift")  # titles whose unit is knots; of reports of stations without a unit, too
CLOCKS = ("%d.%m.%Y %H:%M:%S", "%d.%m.%Y %H:%M", "%d.%m.%Y", "%Y/%m/%d %H:%M:%S", "%Y/%m/%d %H:%M",
          "%Y/%m/%d", "%Y%m%d%H", "%Y%m%d%H%M", "%Y%m%d%H%M%S")  # fmt: skip


class Column:
    """A column of a table: its position, role and unit."""

    def __init__(self, at: int, title: str) -> None:
        plain = title.strip().strip('"').lower().lstrip("#/%! ")
        named = re.fullmatch(r"(.*?)[ _]*[\[(](.*)[\])]", plain)
        name, self.unit = (named[1], named[2]) if named else (plain, "")
        name = re.sub(r"_?\d+ ?m(?=_|$)|(?<=[uv])\d+$", "", re.sub(r"[ -]+", "_", name.strip()))
        self.at, self.role, self.title = at, ROLE_OF.get(name, ""), name
        if not self.role:
            first = max((t for t in ROLE_OF if name.startswith(f"{t}_")), key=len, default="")
            self.role, self.unit, self.title = ROLE_OF.get(first, ""), name[len(first) + 1 :], first

    def factor(self, stated: str) -> float:
        """Metres per second in one unit of a speed; ``stated`` comes from a line of units."""
        unit = re.sub(r"[^a-z0-9]", "", (self.unit or stated).lower())
        if not unit and self.title in IN_KNOTS:
            return KNOT
        if unit not in UNITS:
            raise UnreadError(f"the unit {unit[:20]} of a column is not known to the second reader")
        return UNITS[unit]


def table_fields(path: Path, reports: bool, current: bool) -> list[Field]:
    """The winds of a table, one field for each time; of ``reports`` at the times of the reports.

    UnreadError if its columns are not known. ``current``: a direction is that towards which it flows.
    """
    columns, rows, delimiter = _table(path)
    units, lat = [""] * 99, columns.get("lat") or columns["y"]
    if rows and len(rows[0]) > lat.at and rows[0][lat.at].strip().lower().startswith("deg"):
        units = [cell.strip() for cell in rows.pop(0)] + units
    places = ("x", "y") if {"x", "y"} <= set(columns) else ("lon", "lat")
    polar = not {"u", "v"} <= set(columns)
    way = TOWARDS if TOWARDS in columns and FROM not in columns else FROM
    names = [*places, *((SPEED, way) if polar else ("u", "v"))]
    if current and polar and way == FROM and not columns[FROM].title.endswith("from_direction"):
        raise UnreadError("the direction of a current may be from or towards")
    found: list[list[float]] = []
    for row in rows:
        cells = [row[columns[name].at].strip() if columns[name].at < len(row) else "" for name in names]
        try:
            numbers = [_number(cell, delimiter) for cell in cells]
            lead = columns.get("lead")
            ahead = row[lead.at].strip() if lead and lead.at < len(row) else ""
            hours = _number(ahead, delimiter) if ahead else float("nan")
            found.append([_seconds(_clock_text(row, columns)), 3600.0 * hours, *numbers])
        except ValueError:
            if not reports:  # reports have empty cells and variable winds
                raise UnreadError("a row has a cell that is no number or time") from None
    table = np.array(found, float).reshape(-1, 6)
    one, two = table[:, 4], table[:, 5]
    if polar:
        sign, angle = (1.0 if way == TOWARDS else -1.0), np.deg2rad(two)
        default = "kt" if reports and columns[SPEED].title == "wspd" else units[columns[SPEED].at]
        speed = one * columns[SPEED].factor(default)
        winds = sign * speed[:, None] * np.column_stack([np.sin(angle), np.cos(angle)])
    else:
        winds = np.column_stack([values * columns[name].factor(units[columns[name].at])
                                 for name, values in (("u", one), ("v", two))])  # fmt: skip
    return [_field(table[:, 0] == time, table, winds, "x" in names) for time in np.unique(table[:, 0])]


def _field(rows: FloatArray, table: FloatArray, winds: FloatArray, plane: bool) -> Field:
    leads = table[rows, 1]
    lead = float("nan") if np.isnan(leads).all() else float(np.nanmax(leads))
    return Field(float(table[rows, 0][0]), lead, "", table[rows, 2:4], winds[rows], plane=plane)


def _table(path: Path) -> tuple[dict[str, Column], list[list[str]], str]:
    """Columns by their role, the rows below the header, and the delimiter."""
    text = _text(path)
    for delimiter in ",;\t|":
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
        for n, row in enumerate(rows[:HEADER_LINES]):
            columns: dict[str, Column] = {}
            for at, title in enumerate(row):
                column = Column(at, title)
                columns.setdefault(column.role, column)
            if _complete(set(columns)):
                body = [r for r in rows[n + 1 :] if any(map(str.strip, r))]
                kept = [r for r in body if not r[0].lstrip().startswith(("#", "//", "%", "!"))]
                return _with_day(columns, row), kept, delimiter
    raise UnreadError("the columns of the table are not known to the second reader")


def _complete(roles: set[str]) -> bool:
    """Whether there are a time, a place and a wind."""
    placed = {"time", "lat", "lon"} <= roles or {"time", "x", "y"} <= roles
    return placed and ({"u", "v"} <= roles or (SPEED in roles and bool({FROM, TOWARDS} & roles)))


def _with_day(columns: dict[str, Column], titles: list[str]) -> dict[str, Column]:
    """``columns`` with the column of dates, if dates and times of day are apart, else of valid times."""
    times = [column for at, title in enumerate(titles) if (column := Column(at, title)).role == "time"]
    names = {column.title: column for column in times}
    if {"date", "time"} <= set(names):
        return columns | {"time": names["time"], "day": names["date"]}
    valid = [column for column in times if column.title.startswith("valid")]
    return columns | {"time": (valid or times)[0]}


def _clock_text(row: list[str], columns: dict[str, Column]) -> str:
    cells = [columns[name].at for name in ("day", "time") if name in columns]
    return " ".join(row[at].strip() for at in cells if at < len(row))


def _text(path: Path) -> str:
    with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as stream:
        data = stream.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise UnreadError("the table is larger than 256 MiB")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _number(text: str, delimiter: str) -> float:
    return float(text.replace(",", ".") if delimiter != "," else text)


@lru_cache(maxsize=10_000)  # many rows have one time
def _seconds(text: str) -> float:
    """Seconds since 1970 of a time, UTC if it has no offset; ValueError if it is not known."""
    text = re.sub(r"\s*(UTC|GMT)$", "", text, flags=re.I)
    if re.fullmatch(r"1\d{9}(\.\d+)?", text):
        return float(text)
    if re.fullmatch(r"1\d{12}", text):
        return float(text) / 1000.0
    for clock in CLOCKS:
        try:
            return datetime.strptime(text, clock).replace(tzinfo=UTC).timestamp()
        except ValueError:
            continue
    stamp = datetime.fromisoformat(text)
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()
