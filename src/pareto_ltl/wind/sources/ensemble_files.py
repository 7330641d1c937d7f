"""Reading of an ensemble from the files of its members: GRIB, NetCDF, or both."""

from __future__ import annotations

from pathlib import Path

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.ensemble import ensemble_readings
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.snapshots import Snapshot
from pareto_ltl.wind.sources.grib_apart import read_grib_snapshots
from pareto_ltl.wind.sources.magic import format_of
from pareto_ltl.wind.sources.netcdf_files import WINDS, netcdf_snapshots


def read_ensemble_files(files: tuple[Path, ...], cfg: WindConfig, area: GeoBox | None) -> Readings:
    """Mean and deviations of the members in ``files``; errors are those of the two readers.

    With ``wind.forecast_error=none``, only the members determine the error of the forecast.
    """
    by_format: dict[str, list[Path]] = {"GRIB": [], "NetCDF": []}
    for file in files:
        kind = format_of(_head(file)) or "of an unknown format"
        if kind not in by_format:
            raise DataError(f"wind file {file} is {kind}; expected GRIB or NetCDF files of the members")
        by_format[kind].append(file)
    snapshots: list[Snapshot] = []
    notes: tuple[str, ...] = ()
    for folder in dict.fromkeys(file.parent for file in by_format["GRIB"]):  # each folder may be a member
        grib = tuple(file for file in by_format["GRIB"] if file.parent == folder)
        snapshots += read_grib_snapshots(grib, cfg.max_speed, cfg.level, area)
    if netcdf := tuple(by_format["NetCDF"]):
        found, _, notes = netcdf_snapshots(netcdf, WINDS, cfg.level, cfg.max_speed, area)
        snapshots += found
    prior = 0.0 if cfg.forecast_error == "none" else cfg.ensemble_prior
    return ensemble_readings(snapshots, files, prior, notes)


def _head(file: Path) -> bytes:
    try:
        with file.open("rb") as stream:
            return stream.read(64)
    except OSError as error:
        raise DataError(f"wind file {file} cannot be read: {error.strerror}") from None
