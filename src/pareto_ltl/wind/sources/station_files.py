"""Winds of weather stations: METAR caches and archives of surface observations, as tables.

Stations report the direction d from which the wind blows [deg clockwise from north] and its speed s [knots]::

    u = -s sin(d),   v = -s cos(d)

Reports are assigned to hours; of each station and hour, the report nearest to the full hour is used. A
direction of 0 or VRB with a speed above 0 is a variable wind, which has no components.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_value
from pareto_ltl.wind.area import GeoBox, refuse_empty_crop
from pareto_ltl.wind.readings import HOUR, KNOT, Readings, check_readings, iso, seconds
from pareto_ltl.wind.sources.csv_files import open_table

NAMES = {  # possible titles of each column
    "station": ("station_id", "station", "icao", "icaoid", "usaf"),
    "time": ("observation_time", "valid", "time", "date"),
    "lat": ("latitude", "lat"),
    "lon": ("longitude", "lon"),
    "direction": ("wind_dir_degrees", "drct", "wdir"),
    "speed": ("wind_speed_kt", "sknt", "wspd"),
}
OPTIONAL = {"gust": ("wind_gust_kt", "gust", "wgst")}
NOTHING = ("", "M", "NA", "null", "None")
MOST_HEADER_LINES = 20  # lines before the table: METAR caches begin with a few lines about the request
DROPPED = {
    "incomplete": "have no direction, speed or place",
    "variable": "have a variable direction",
    "impossible": "have an impossible direction, speed or place",
    "fast": "are faster than wind.max_speed",
}


@dataclass(frozen=True, slots=True)
class _Report:
    """One report: station, time [s since 1970], longitude and latitude [deg], wind [m/s]."""

    station: str
    time: float
    lon: float
    lat: float
    u: float
    v: float


def read_station_files(files: tuple[Path, ...], max_speed: float, area: GeoBox | None = None) -> Readings:
    """The winds that stations report, usually 10 m above ground, one field for each hour.

    Raises
    ------
    DataError
        If a file is not a table of reports, a time in it is not valid, or there is no usable report.
    """
    dropped = dict.fromkeys(DROPPED, 0)
    gusts = 0
    reports: list[_Report] = []
    for file in files:
        for report, gusty in _reports_of(file, max_speed, dropped):
            gusts += gusty
            if report is not None:
                reports.append(report)
    total = len(reports) + sum(dropped.values())
    if not reports:
        raise DataError(f"wind file {files[0]} holds no usable report; {_reasons(dropped, total)}")
    if area is not None:
        reports = _reports_in(files, reports, area)
    hours = _by_hour(reports)
    used = sum(len(bin_) for bin_ in hours.values())
    notes = [_reasons(dropped, total)] if any(dropped.values()) else []
    if used < len(reports):
        notes.append(
            f"{len(reports) - used} reports are not the nearest of their station to the hour: left out"
        )
    if gusts:
        notes.append(f"{gusts} reports have gusts, which are not used: only the mean wind is")
    times = sorted(hours)
    tables = [np.array([(r.lon, r.lat, r.u, r.v) for r in hours[time]]) for time in times]
    for time, table in zip(times, tables, strict=True):
        place = f"wind file {files[0]}, {iso(time)}"
        check_readings(table[:, :2], table[:, 2:], True, max_speed, lambda _, place=place: place)  # type: ignore[misc]
    return Readings(
        times=np.array(times),
        points=tuple(table[:, :2] for table in tables),
        winds=tuple(table[:, 2:] for table in tables),
        geographic=True,
        files=files,
        remarks=("observations",) * len(times),
        origins=(files,) * len(times),
        leads=np.zeros(len(times)),
        level="10m",
        notes=tuple(notes),
    )


def _reasons(dropped: dict[str, int], total: int) -> str:
    parts = [f"{count} {DROPPED[name]}" for name, count in dropped.items() if count]
    return f"of {total} reports, {', '.join(parts) or 'none'}: left out"


def _reports_in(files: tuple[Path, ...], reports: list[_Report], area: GeoBox) -> list[_Report]:
    places: FloatArray = np.array([(report.lon, report.lat) for report in reports])
    inside = area.contains(places)
    if not inside.any():
        refuse_empty_crop(f"wind file {files[0]}", places, area)
    return [report for report, near in zip(reports, inside, strict=True) if near]


def _by_hour(reports: Sequence[_Report]) -> dict[float, list[_Report]]:
    """Reports by hour: of each station the one nearest to the hour, of two the later; one for each place."""
    best: dict[tuple[float, str], _Report] = {}
    for report in reports:
        hour = HOUR * math.floor(report.time / HOUR + 0.5)
        rival = best.get((hour, report.station))
        if rival is None or _rank(report, hour) < _rank(rival, hour):
            best[hour, report.station] = report
    hours: dict[float, dict[tuple[float, float], _Report]] = {}
    for (hour, _), report in sorted(best.items()):
        hours.setdefault(hour, {})[report.lon, report.lat] = report
    return {hour: list(places.values()) for hour, places in hours.items()}


def _rank(report: _Report, hour: float) -> tuple[float, float]:
    return abs(report.time - hour), -report.time


# --- one file --------------------------------------------------------------------------------


def _reports_of(
    file: Path, max_speed: float, dropped: dict[str, int]
) -> Iterator[tuple[_Report | None, bool]]:
    """Each report, or None if it is dropped, and whether it contains a gust."""
    with open_table(file, "a table of METAR reports") as stream:
        reader = csv.reader(io.StringIO(stream.read(), newline=""))
        columns = _columns(file, reader)
        for row in reader:
            if any(cell.strip() for cell in row):
                cells = {name: row[at].strip() if at < len(row) else "" for name, at in columns.items()}
                where = f"wind file {file}, row {reader.line_num}"
                yield _report(where, cells, max_speed, dropped), _is_number(cells.get("gust", ""))


def _columns(file: Path, reader: Iterator[list[str]]) -> dict[str, int]:
    """Positions of the columns; lines before the header are skipped."""
    seen: list[str] = []
    for _, row in zip(range(MOST_HEADER_LINES), reader, strict=False):
        titles = [cell.strip().lower() for cell in row]
        found = {
            name: min(titles.index(title) for title in names if title in titles)
            for name, names in (NAMES | OPTIONAL).items()
            if set(names) & set(titles)
        }
        if set(NAMES) <= set(found):
            return found
        seen = max(seen, list(found), key=len)
    missing = ", ".join(NAMES[name][0] for name in NAMES if name not in seen)
    raise DataError(
        f"wind file {file}: no header with {missing}; expected a METAR cache with station_id, "
        "observation_time, latitude, longitude, wind_dir_degrees, wind_speed_kt, or an archive with station, "
        "valid, lat, lon, drct, sknt"
    )


def _report(where: str, cells: dict[str, str], max_speed: float, dropped: dict[str, int]) -> _Report | None:
    """The report in ``cells``; None if quality control drops it, which is counted in ``dropped``."""
    lon, lat, direction, speed = (_number(cells[name]) for name in ("lon", "lat", "direction", "speed"))
    variable = speed > 0 and (cells["direction"].upper() == "VRB" or direction == 0)
    if math.isnan(lon + lat + speed) or (math.isnan(direction) and speed > 0 and not variable):
        flaw = "incomplete"
    elif variable:
        flaw = "variable"
    elif not -180 <= lon <= 360 or abs(lat) > 90 or speed < 0 or (speed > 0 and not 0 < direction <= 360):
        flaw = "impossible"
    elif speed * KNOT > max_speed:
        flaw = "fast"
    else:
        angle = math.radians(direction) if speed > 0 else 0.0
        u, v = -speed * KNOT * math.sin(angle), -speed * KNOT * math.cos(angle)
        time = _time(where, cells["time"])
        return _Report(cells["station"], time, (lon + 180.0) % 360.0 - 180.0, lat, u + 0.0, v + 0.0)
    dropped[flaw] += 1
    return None


def _is_number(text: str) -> bool:
    return text not in NOTHING and not math.isnan(_number(text))


def _number(text: str) -> float:
    """The number in a cell; NaN if there is none."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _time(where: str, text: str) -> float:
    try:
        return _cached_seconds(text)
    except ValueError:
        raise DataError(
            f"{where}: the time is {shown_value(text)}; expected an ISO 8601 time: 2022-10-22T02:53:00Z"
        ) from None


_cached_seconds = lru_cache(maxsize=4096)(seconds)  # many reports share few times
