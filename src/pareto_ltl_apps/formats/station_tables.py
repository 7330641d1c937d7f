"""Reports of weather stations in the tables and JSON files of NOAA and of archives, as cells of one kind.

METAR caches and the API of the Aviation Weather Center (CSV, JSON, GeoJSON), observations of api.weather.gov,
ISD ("global hourly"), LCD, GHCNh, tables of the Iowa Environmental Mesonet, and the latest reports of buoys
(NDBC). They differ in names, units and clocks, which :class:`Layout` lists.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.speed_units import KNOT, speed_factor
from pareto_ltl_apps.formats.tables import open_table, read_table

MPH = 0.44704  # [m/s]
UTC, LOCAL, UNKNOWN = "UTC", "local standard time", "unknown"  # clocks of times without a zone
NAMES = {  # possible titles of each column, the best first
    "station": ("station_id", "station", "icao", "icaoid", "usaf", "stn", "id"),
    "time": ("observation_time", "obstime", "valid", "time", "date", "timestamp", "reporttime"),
    "lat": ("latitude", "lat"),
    "lon": ("longitude", "lon"),
    "direction": ("wind_dir_degrees", "drct", "wdir", "hourlywinddirection", "wind_direction", "wnd"),
    "speed": ("wind_speed_kt", "sknt", "wspd", "hourlywindspeed", "wind_speed", "wnd"),
}
OPTIONAL = {"gust": ("wind_gust_kt", "gust", "wgst", "gst", "hourlywindgustspeed")}
DATE_PARTS = ("year", "month", "day", "hour", "minute")  # of GHCNh, which has no column of times
BUOYS = ("#stn", "#yy")  # first words of tables of NDBC
BAD_QUALITY = ("2", "3", "6", "7")  # of ISD: suspect and erroneous values
EXPECTED = (
    "expected a METAR cache with station_id, observation_time, latitude, longitude, wind_dir_degrees, "
    "wind_speed_kt, or an archive with station, valid, lat, lon, drct, sknt"
)


class RawReports(NamedTuple):
    """Reports as a file has them.

    Attributes
    ----------
    cells : dict
        Texts of each report by column: station, time, lat, lon, direction, speed, perhaps gust.
    numbers : list of int
        Number of the line, or of the entry, of each report.
    factor : float
        Metres per second in one unit of the speed.
    clock : str
        What a time without a zone is: ``UTC``, ``LOCAL`` or ``UNKNOWN``.
    zero_is_north : bool
        Whether the direction 0 is north, and not a variable wind.
    """

    cells: dict[str, list[str]]
    numbers: list[int]
    factor: float
    clock: str
    zero_is_north: bool = False


def read_reports(file: Path) -> RawReports:
    """The reports in ``file``; a DataError if it has no table of reports."""
    with open_table(file, "a table of METAR reports") as stream:
        start = stream.read(200).lstrip()
        stream.seek(0)
        if start[:1] in ("[", "{"):
            return _json_reports(file, stream.read())
        if start.lower().startswith(BUOYS):
            return _buoy_reports(file, stream.read().splitlines())
    table = read_table(file, "a table of METAR reports", holds_reports)
    columns, missing = _columns(table.titles)
    if missing:
        raise DataError(f"wind file {file}: no header with {', '.join(missing)}; {EXPECTED}")

    def column(at: int) -> list[str]:
        return [row[at].strip() if at < len(row) else "" for _, row in table.rows]

    cells = {name: column(at) for name, at in columns.items() if name != "time"}
    if "time" in columns:
        cells["time"] = column(columns["time"])
    else:
        parts = zip(*(column(table.titles.index(part)) for part in DATE_PARTS), strict=True)
        cells["time"] = [_stamp(*moment) for moment in parts]
    numbers = [number for number, _ in table.rows]
    title = table.titles[columns["speed"]]
    if title == "wnd":
        return RawReports(cells | _isd_winds(cells["direction"]), numbers, 0.1, UTC)
    if title == "hourlywindspeed":  # version 2 of LCD is metric; its stations have the names of GHCN
        metric = any(name[:1].isalpha() for name in cells["station"])
        return RawReports(cells, numbers, 1.0 if metric else MPH, LOCAL)
    if title == "wind_speed":
        return RawReports(cells, numbers, 1.0, UTC)
    return RawReports(cells, numbers, KNOT, UNKNOWN)


def holds_reports(titles: list[str]) -> bool:
    """Whether ``titles``, in lower case, belong to a table of reports."""
    return not _columns(titles)[1]


def _columns(titles: Sequence[str]) -> tuple[dict[str, int], list[str]]:
    """Positions of the columns, and the names of those that are missing."""
    found = {}
    for name, names in (NAMES | OPTIONAL).items():
        for title in names:
            if title in titles:
                found[name] = titles.index(title)
                break
    dated = set(DATE_PARTS) <= set(titles)
    if dated and "time" not in found:
        return found, [NAMES[name][0] for name in NAMES if name not in found and name != "time"]
    return found, [NAMES[name][0] for name in NAMES if name not in found]


def _stamp(year: str, month: str, day: str, hour: str, minute: str) -> str:
    return f"{year}-{month:0>2}-{day:0>2}T{hour:0>2}:{minute:0>2}Z"


def _isd_winds(texts: Iterable[str]) -> dict[str, list[str]]:
    """Directions and speeds [0.1 m/s] of ``WND`` of ISD: direction, quality, type, speed, quality."""
    directions, speeds = [], []
    for text in texts:
        parts = [*text.split(","), "", "", "", "", ""][:5]
        direction, direction_quality, kind, speed, speed_quality = (part.strip() for part in parts)
        known = speed not in ("9999", "") and speed_quality not in BAD_QUALITY
        speeds.append(speed if known else "")
        sure = direction != "999" and direction_quality not in BAD_QUALITY
        directions.append("VRB" if kind == "V" else direction if sure else "")
    return {"direction": directions, "speed": speeds}


def _buoy_reports(file: Path, lines: list[str]) -> RawReports:
    """Reports of NDBC: columns divided by spaces, a second line with units, MM for missing values; in m/s."""
    titles = lines[0].lstrip("#").split()
    names = {
        "station": "STN",
        "lat": "LAT",
        "lon": "LON",
        "direction": "WDIR",
        "speed": "WSPD",
        "gust": "GST",
    }
    if missing := [title for title in names.values() if title not in titles]:
        raise DataError(
            f"wind file {file}: a table of NDBC without {', '.join(missing)}; a file of one buoy does not "
            "state where it lies: fetch latest_obs.txt, which does, or make a table with the columns "
            "station, time, lat, lon, drct, sknt"
        )
    rows = [(n, line.split()) for n, line in enumerate(lines, 1) if line.strip() and line[:1] != "#"]
    rows = [(n, row) for n, row in rows if len(row) == len(titles)]
    cells = {name: [row[titles.index(title)] for _, row in rows] for name, title in names.items()}
    year = titles.index("YYYY") if "YYYY" in titles else titles.index("STN") + 3
    cells["time"] = [_stamp(*row[year : year + 5]) for _, row in rows]
    return RawReports(cells, [n for n, _ in rows], 1.0, UTC, zero_is_north=True)


# --- JSON ------------------------------------------------------------------------------------


def _json_reports(file: Path, text: str) -> RawReports:
    """Reports of the APIs of the Aviation Weather Center and of the National Weather Service."""
    try:
        content = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        reason = str(error).split(":")[0]
        raise DataError(f"wind file {file} is damaged JSON ({reason}); fetch it again") from None
    entries = content.get("features", [content]) if isinstance(content, dict) else content
    reports = [_json_report(entry) for entry in entries if isinstance(entry, dict)]
    known = [(n, report) for n, report in enumerate(reports, 1) if report]
    if not known:
        raise DataError(
            f"wind file {file} is JSON without reports of stations; expected the API of aviationweather.gov "
            "(icaoId, obsTime, lat, lon, wdir, wspd) or observations of api.weather.gov (windDirection, "
            "windSpeed)"
        )
    cells = {name: [report.get(name, "") for _, report in known] for name in (*NAMES, *OPTIONAL)}
    return RawReports(cells, [n for n, _ in known], 1.0, UNKNOWN)


def _json_report(entry: Mapping[str, Any]) -> dict[str, str]:
    """One report, its speed in m/s; empty if the entry is no report of wind."""
    inside = entry.get("properties")
    values = {
        str(key).lower(): value for key, value in (inside if isinstance(inside, dict) else entry).items()
    }
    geometry = entry.get("geometry")
    place = geometry.get("coordinates") if isinstance(geometry, dict) else None
    if isinstance(place, list) and len(place) >= 2:
        values |= {"lon": place[0], "lat": place[1]}
    if isinstance(values.get("windspeed"), dict):  # api.weather.gov
        speed, direction = values["windspeed"], values.get("winddirection") or {}
        unit = str(speed.get("unitCode", "")).rpartition(":")[2]
        factor = speed_factor(unit)
        report = {
            "station": str(values.get("station", "")).rpartition("/")[2],
            "time": _text(values.get("timestamp")),
            "direction": _text(direction.get("value") if isinstance(direction, dict) else None),
            "speed": _in_metres(speed.get("value"), factor),
        }
    else:
        columns = {
            name: next((values[title] for title in titles if title in values), None)
            for name, titles in NAMES.items()
        }
        if columns["speed"] is None and columns["direction"] is None:
            return {}
        report = {name: _text(value) for name, value in columns.items()}
        report["speed"] = _in_metres(columns["speed"], KNOT)
    return report | {"lat": _text(values.get("lat")), "lon": _text(values.get("lon"))}


def _text(value: Any) -> str:
    return "" if value is None else str(value)


def _in_metres(value: Any, factor: float | None) -> str:
    usable = isinstance(value, int | float) and not isinstance(value, bool) and factor is not None
    return repr(value * factor) if usable else ""
