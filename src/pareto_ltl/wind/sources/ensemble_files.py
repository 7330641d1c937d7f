"""Reading of an ensemble from the files of its members: GRIB, NetCDF, or both."""

from __future__ import annotations

from pathlib import Path

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.ensemble import ensemble_readings
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.snapshots import Snapshots
from pareto_ltl.wind.sources.grib_apart import grib_snapshots_apart
from pareto_ltl.wind.sources.magic import first_bytes, format_of
from pareto_ltl.wind.sources.netcdf_files import WINDS, netcdf_snapshots


def read_ensemble_files(files: tuple[Path, ...], cfg: WindConfig, area: GeoBox | None) -> Readings:
    """Mean and deviations of the members in ``files``; errors as in the two readers.

    With ``wind.forecast_error=none``, only the members determine the error of the forecast.
    """
    by_format: dict[str, list[Path]] = {"GRIB": [], "NetCDF": []}
    for file in files:
        kind = format_of(first_bytes(file)) or "of an unknown format"
        if kind not in by_format:
            raise DataError(f"wind file {file} is {kind}; expected GRIB or NetCDF files of the members")
        by_format[kind].append(file)
    found: dict[str, Snapshots] = {}
    for folder in dict.fromkeys(file.parent for file in by_format["GRIB"]):  # each folder may be a member
        grib = tuple(file for file in by_format["GRIB"] if file.parent == folder)
        found[f"{folder.name}: "] = grib_snapshots_apart(grib, cfg.max_speed, cfg.level, area)
    if netcdf := tuple(by_format["NetCDF"]):
        found["NetCDF: "] = netcdf_snapshots(netcdf, WINDS, cfg.level, cfg.max_speed, area)
    prior = 0.0 if cfg.forecast_error == "none" else cfg.ensemble_prior
    snapshots = [snap for one in found.values() for snap in one.winds]
    notes = [(name if len(found) > 1 else "") + note for name, one in found.items() for note in one.notes]
    return ensemble_readings(snapshots, files, prior, tuple(notes))
