"""Readings of GRIB, NetCDF, station and ensemble files, and of downloads: values of ``wind.source``."""

from __future__ import annotations

from pathlib import Path

from pareto_ltl import DataError, Readings
from pareto_ltl.extend import Wanted, WindConfig, WindFormats, data_files
from pareto_ltl.settings.wind import WIND_SOURCES
from pareto_ltl.support.file_formats import first_bytes, format_of, is_data_file
from pareto_ltl.support.levels import HEIGHT, Level, table_level
from pareto_ltl_apps.formats.content import source_of_path
from pareto_ltl_apps.formats.grib_files import grib_levels_apart, grib_snapshots_apart
from pareto_ltl_apps.formats.live import live_files, read_live
from pareto_ltl_apps.formats.netcdf_files import netcdf_levels, netcdf_snapshots
from pareto_ltl_apps.formats.quantities import CURRENTS, WINDS
from pareto_ltl_apps.formats.snapshots import ensemble_readings, latest_readings
from pareto_ltl_apps.formats.station_files import read_station_files


def _read_stations(cfg: WindConfig, wanted: Wanted) -> Readings:
    level = table_level(cfg.level, (HEIGHT,), "stations report winds near the ground")
    return read_station_files(data_files(cfg), cfg.max_speed, wanted.area).at_stated_level(level)


def _read_grib(cfg: WindConfig, wanted: Wanted) -> Readings:
    return latest_readings(*grib_snapshots_apart(data_files(cfg), cfg.max_speed, cfg.level, wanted.area))


def _read_netcdf(cfg: WindConfig, wanted: Wanted) -> Readings:
    return latest_readings(*netcdf_snapshots(data_files(cfg), WINDS, cfg.level, cfg.max_speed, wanted.area))


def _read_currents(cfg: WindConfig, wanted: Wanted) -> Readings:
    """Currents of GRIB or NetCDF files, all of one format."""
    files = data_files(cfg)
    if all(format_of(first_bytes(file)) == "GRIB" for file in files):
        read = grib_snapshots_apart(files, cfg.max_speed, cfg.level, wanted.area, CURRENTS)
        return latest_readings(*read._replace(law=""))
    return latest_readings(*netcdf_snapshots(files, CURRENTS, cfg.level, cfg.max_speed, wanted.area))


def _ensemble_files(cfg: WindConfig, _wanted: Wanted) -> tuple[Path, ...]:
    """Like :func:`data_files`, including the files in subfolders, one for each member."""
    path = Path(str(cfg.path)).expanduser()
    below = [file for file in path.glob("*/*") if file.is_file() and is_data_file(file)]
    if not below:
        return data_files(cfg)
    own = [file for file in path.iterdir() if file.is_file() and is_data_file(file)]
    return tuple(sorted([*own, *below]))


def _read_ensemble(cfg: WindConfig, wanted: Wanted) -> Readings:
    """Mean and deviations of the members in GRIB files, of which each folder may be one, and NetCDF files."""
    files = _ensemble_files(cfg, wanted)
    grib: dict[Path, tuple[Path, ...]] = {}
    netcdf: tuple[Path, ...] = ()
    for file in files:
        kind = format_of(first_bytes(file)) or "of an unknown format"
        if kind == "GRIB":
            grib[file.parent] = (*grib.get(file.parent, ()), file)
        elif kind == "NetCDF":
            netcdf = (*netcdf, file)
        else:
            raise DataError(f"wind file {file} is {kind}; expected GRIB or NetCDF files of the members")
    found = [
        (folder.name, grib_snapshots_apart(together, cfg.max_speed, cfg.level, wanted.area))
        for folder, together in grib.items()
    ]
    if netcdf:
        found.append(("NetCDF", netcdf_snapshots(netcdf, WINDS, cfg.level, cfg.max_speed, wanted.area)))
    snapshots = [snap for _, one in found for snap in one.winds]
    several = len(found) > 1
    notes = [f"{name}: {note}" if several else note for name, one in found for note in one.notes]
    laws = {one.law for _, one in found}
    return ensemble_readings(snapshots, files, cfg, tuple(notes), laws.pop() if len(laws) == 1 else "")


def levels_in_files(cfg: WindConfig) -> set[Level]:
    """The levels at which the files of ``wind.path`` have winds, or currents; none for what states no level.

    DataError if a file cannot be read.
    """
    if cfg.source not in ("grib", "netcdf", "currents", "ensemble"):
        return set()
    quantity = CURRENTS if cfg.source == "currents" else WINDS
    found: set[Level] = set()
    files = _ensemble_files(cfg, Wanted()) if cfg.source == "ensemble" else data_files(cfg)
    for kind, read in (("GRIB", grib_levels_apart), ("NetCDF", netcdf_levels)):
        if some := tuple(file for file in files if format_of(first_bytes(file)) == kind):
            found |= read(some, quantity)
    return found


READERS = {
    "grib": (_read_grib, data_files),
    "netcdf": (_read_netcdf, data_files),
    "stations": (_read_stations, data_files),
    "currents": (_read_currents, data_files),
    "ensemble": (_read_ensemble, _ensemble_files),
} | {name: (read_live, live_files) for name, kind in WIND_SOURCES.items() if kind.live}
FORMATS = WindFormats(READERS, source_of_path)
