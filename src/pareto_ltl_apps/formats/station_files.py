"""Winds of weather stations: METAR caches and archives of surface observations.

Stations report the direction d from which the wind blows [deg clockwise from north] and its speed s::

    u = -s sin(d),   v = -s cos(d)

Reports are assigned to hours; of each station and hour, the report nearest to the full hour is used. A
direction of 0 or VRB with a speed above 0 is a variable wind, which has no components.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from careful_io.faults import Faults
from careful_io.messages import shown_value
from careful_io.times import HOUR
from flight_quantities.sphere import wrap_longitude
from pareto_ltl import Readings
from pareto_ltl.extend import GeoBox, Snapshot, readings_of
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.flow_components import FROM, polar_winds
from pareto_ltl_apps.formats.station_tables import LOCAL, UTC, RawReports, read_reports
from pareto_ltl_apps.formats.tables import seconds_of

LOG = logging.getLogger("pareto_ltl.formats.station_files")
DROPPED = {
    "incomplete": "have no direction, speed or place",
    "variable": "have a variable direction",
    "impossible": "have an impossible direction, speed or place",
    "fast": "are faster than wind.max_speed",
}


class _Reports(NamedTuple):
    """Usable reports: stations (N,), and time [s since 1970], lon, lat [deg], u, v [m/s] in ``table`` (N, 5).

    ``dropped`` counts the other reports by flaw, ``gusts`` those with a gust.
    """

    stations: list[str]
    table: FloatArray
    dropped: Counter[str]
    gusts: int


def read_station_files(files: tuple[Path, ...], max_speed: float, area: GeoBox | None = None) -> Readings:
    """The winds that stations report, usually 10 m above ground, one field for each hour.

    Raises
    ------
    DataError
        If a file is not a table of reports, a time in it is not valid, or there is no usable report.
    """
    faults = Faults.of_files("wind file", files)
    found = [reports for _, reports in faults.each(files, lambda file: _reports_of(file, max_speed))]
    faults.refuse()
    dropped: Counter[str] = sum((reports.dropped for reports in found), Counter())
    gusts = sum(reports.gusts for reports in found)
    stations = [name for reports in found for name in reports.stations]
    table = np.concatenate([reports.table for reports in found])
    times, places, winds = table[:, 0], table[:, 1:3], table[:, 3:]
    total = len(times) + dropped.total()
    lost = ", ".join(f"{dropped[name]} {text}" for name, text in DROPPED.items() if dropped[name]) or "none"
    if not len(times):
        raise DataError(f"wind file {files[0]} holds no usable report; of {total} reports, {lost}: left out")
    inside = np.arange(len(times))
    if area is not None:
        inside = np.flatnonzero(area.contains(places))
        if not len(inside):
            area.refuse_empty_crop(f"wind file {files[0]}", places)
    hours = _by_hour(stations, times, places, inside)
    used = sum(map(len, hours.values()))
    notes = [f"of {total} reports, {lost}: left out"] if dropped else []
    if used < len(inside):
        notes.append(
            f"{len(inside) - used} reports are not the nearest of their station to the hour: left out"
        )
    if gusts:
        notes.append(f"{gusts} reports have gusts, which are not used: only the mean wind is")
    fields = [
        Snapshot(hour, 0.0, places[rows], winds[rows], "10m", files) for hour, rows in sorted(hours.items())
    ]
    return readings_of(fields, files, remarks=("observations",) * len(fields), notes=tuple(notes))


def _by_hour(
    stations: list[str], times: FloatArray, places: FloatArray, inside: IntArray
) -> dict[float, list[int]]:
    """Rows by hour: of each station the report nearest to the hour, of two the later; one for each place."""
    hours = HOUR * np.floor(times / HOUR + 0.5)
    best: dict[tuple[float, str], int] = {}
    for row in sorted(inside.tolist(), key=lambda i: (abs(times[i] - hours[i]), -times[i])):
        best.setdefault((float(hours[row]), stations[row]), row)
    found: dict[float, dict[tuple[float, ...], int]] = {}
    for (hour, _), row in sorted(best.items()):
        found.setdefault(hour, {})[tuple(places[row].tolist())] = row
    return {hour: list(rows.values()) for hour, rows in found.items()}


# --- one file --------------------------------------------------------------------------------


def _reports_of(file: Path, max_speed: float) -> _Reports:
    """The reports of ``file`` that pass quality control."""
    found = read_reports(file)
    cells = found.cells
    lon, lat, direction, speed = (
        np.array([_number(cell) for cell in cells[name]]) for name in ("lon", "lat", "direction", "speed")
    )
    speed = speed * found.factor
    if found.zero_is_north:
        direction[direction == 0] = 360.0
    named = np.array([cell.upper() in ("VRB", "V") for cell in cells["direction"]], bool)
    blows = speed > 0
    variable = blows & (named | (direction == 0))
    incomplete = np.isnan(lon + lat + speed) | (np.isnan(direction) & blows & ~variable)
    nowhere = (lon < -180) | (lon > 360) | (np.abs(lat) > 90)
    impossible = nowhere | (speed < 0) | (blows & ~((direction > 0) & (direction <= 360)))
    flaws = (incomplete, variable, impossible, speed > max_speed)
    flaw = np.select(flaws, list(DROPPED), "")
    used = np.flatnonzero(flaw == "")
    times = _times(file, found, used)
    winds = polar_winds(speed[used], np.where(blows, direction, 0.0)[used], FROM)
    gusts = sum(not math.isnan(_number(cell)) for cell in cells.get("gust", ()))
    return _Reports(
        [cells["station"][i] for i in used],
        np.column_stack([times, wrap_longitude(lon[used]), lat[used], winds]),
        Counter(flaw[flaw != ""].tolist()),
        gusts,
    )


def _times(file: Path, found: RawReports, used: IntArray) -> FloatArray:
    """The times of the reports ``used`` [s since 1970]; a warning if they state no zone."""
    times, unzoned, faults = [], 0, Faults(f"wind file {file}")
    for i in used:
        text = found.cells["time"][i]
        try:
            time, zoned = seconds_of(text)
        except ValueError:
            faults.add(
                f"wind file {file}, row {found.numbers[i]}: the time is {shown_value(text)}; expected an "
                "ISO 8601 time: 2022-10-22T02:53:00Z"
            )
            continue
        times.append(time)
        unzoned += not zoned
    faults.refuse()
    if unzoned and found.clock != UTC:
        local = "local standard time, by its documentation" if found.clock == LOCAL else "of an unknown zone"
        LOG.warning(
            "%s: %d times state no zone and are taken as UTC (%s); write the offset, "
            "2018-10-09T11:53:00-06:00, if they are not", file.name, unzoned, local,
        )  # fmt: skip
    return np.array(times)


def _number(text: str) -> float:
    """The number in a cell; NaN if there is none. LCD marks suspect values by an s, which are used."""
    try:
        value = float(text.removesuffix("s"))
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
