"""All winds of several cycles: of GRIB2 files, of a table of fields, or of a table of forecasts at places."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from pareto_ltl import Readings
from pareto_ltl.extend import GeoBox, Snapshot, WindConfig
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.grib_files import grib_snapshots_apart
from pareto_ltl_apps.formats.snapshots import latest_readings
from pareto_ltl_apps.wind_errors.field_tables import is_field_table, read_field_table
from pareto_ltl_apps.wind_errors.point_forecasts import NEWEST, PointForecasts
from pareto_ltl_apps.wind_errors.point_tables import KINDS, read_point_table

FEWEST_PLACES = 5  # of a table, for a fit of the wind


class FullWinds(NamedTuple):
    """All winds of several cycles.

    Attributes
    ----------
    winds : tuple of Snapshot
        The winds of all cycles.
    files : tuple of Path
        The files that hold them.
    places : (P, 2) float or None
        Longitude and latitude [deg] of a table of forecasts at places; None: fields.
    """

    winds: tuple[Snapshot, ...]
    files: tuple[Path, ...]
    places: FloatArray | None = None

    def truth(self) -> Readings:
        """The newest wind of each time; of forecasts at places, of runs at most ``NEWEST`` old."""
        newest = [snap for snap in self.winds if self.places is None or snap.lead <= NEWEST]
        return latest_readings(newest, self.files)


def is_table(path: Path) -> bool:
    """Whether a path names a table by its suffix."""
    return path.name.lower().endswith(KINDS)


def full_winds(files: tuple[Path, ...], cfg: WindConfig, area: GeoBox | None) -> FullWinds:
    """All winds in GRIB2 files (in ``area``; None: everywhere), or in one table.

    Raises
    ------
    DataError
        If a file is not valid, or a table has forecasts at too few places.
    """
    path = files[0]
    if not is_table(path):
        return FullWinds(grib_snapshots_apart(files, cfg.max_speed, cfg.level, area).winds, files)
    if is_field_table(path):
        return FullWinds(read_field_table(path, cfg.max_speed, cfg.level), files)
    table = read_point_table(path)
    if table.places is None or len(table.places) < FEWEST_PLACES:
        raise DataError(
            f"{path}: a test needs forecasts at {FEWEST_PLACES} places or more, with latitude and longitude"
        )
    return FullWinds(table_snapshots(table, table.places, path, cfg.level), files, table.places)


def table_snapshots(
    table: PointForecasts, places: FloatArray, file: Path, level: str
) -> tuple[Snapshot, ...]:
    """Each forecast of a table as a field at the ``places`` (P, 2) [deg] that have a value."""
    known: BoolArray = np.asarray(np.isfinite(table.winds).all(axis=-1), bool)
    found = []
    for run, lead in np.argwhere(known.any(axis=1)).tolist():
        here = np.asarray(known[run, :, lead], bool)
        points = places if here.all() else places[here]
        winds, ahead = table.winds[run, here, lead], float(table.leads[lead])
        found.append(Snapshot(float(table.runs[run]) + ahead, ahead, points, winds, level, (file,)))
    return tuple(found)
