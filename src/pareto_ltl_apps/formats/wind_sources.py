"""Values of ``wind.source``: one decorated function each, which imports its reader when it is called."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl import ConfigError, DataError
from pareto_ltl.extend import WindFormats, WindSource

if TYPE_CHECKING:
    from flight_quantities.levels import Level
    from pareto_ltl import Readings
    from pareto_ltl.extend import Wanted, WindConfig

Read = Callable[["WindConfig", "Wanted"], "Readings"]
SOURCES: dict[str, WindSource] = {}


def source(
    *names: str, files: Callable[[WindConfig, Wanted], tuple[Path, ...]], **facts: Any
) -> Callable[[Read], Read]:
    """Add a function that reads winds as the values ``names`` of ``wind.source``, by default its own name.

    ``files`` and ``facts`` are attributes of :class:`WindSource`.
    """

    def add(read: Read) -> Read:
        for name in names or (read.__name__,):
            SOURCES[name] = WindSource(read, files, **facts)
        return read

    return add


def _of_path(cfg: WindConfig, wanted: Wanted) -> tuple[Path, ...]:
    from pareto_ltl.extend import data_files

    return data_files(cfg, wanted)


def _no_files(_cfg: WindConfig, _wanted: Wanted) -> tuple[Path, ...]:
    return ()


# --- tables ---------------------------------------------------------------------------------------


def _sample_file(_cfg: WindConfig, _wanted: Wanted) -> tuple[Path, ...]:
    from pareto_ltl.support.resources import SAMPLE_WINDS

    return (SAMPLE_WINDS,)


@source(files=_sample_file, forecast_error="none", modelled=False)
def sample(cfg: WindConfig, wanted: Wanted) -> Readings:
    """The packaged sample: analyses of one day."""
    from pareto_ltl_apps.formats.csv_files import read_csv_files

    return read_csv_files(_sample_file(cfg, wanted), cfg.max_speed)


@source(files=_of_path, reads_path=True, level="stated")
def csv(cfg: WindConfig, wanted: Wanted) -> Readings:
    """CSV tables at ``wind.level``, which they do not state; at a depth, they are currents."""
    from flight_quantities.levels import DEPTH, HEIGHT, PRESSURE
    from pareto_ltl.support.levels import table_level
    from pareto_ltl_apps.formats.csv_files import read_csv_files

    level = table_level(cfg.level, (HEIGHT, PRESSURE, DEPTH), "a table of winds or currents")
    current = level.kind == DEPTH
    return read_csv_files(_of_path(cfg, wanted), cfg.max_speed, current).at_stated_level(level)


# --- fields ---------------------------------------------------------------------------------------


@source(files=_of_path, reads_path=True)
def grib(cfg: WindConfig, wanted: Wanted) -> Readings:
    """GRIB files."""
    from pareto_ltl_apps.formats.grib_files import grib_snapshots_apart
    from pareto_ltl_apps.formats.snapshots import latest_readings

    files = _of_path(cfg, wanted)
    return latest_readings(*grib_snapshots_apart(files, cfg.max_speed, cfg.level, wanted.area))


@source(files=_of_path, reads_path=True)
def netcdf(cfg: WindConfig, wanted: Wanted) -> Readings:
    """NetCDF files with the names of CF."""
    from pareto_ltl_apps.formats.netcdf_files import netcdf_snapshots
    from pareto_ltl_apps.formats.quantities import WINDS
    from pareto_ltl_apps.formats.snapshots import latest_readings

    files = _of_path(cfg, wanted)
    return latest_readings(*netcdf_snapshots(files, WINDS, cfg.level, cfg.max_speed, wanted.area))


@source(files=_of_path, reads_path=True, forecast_error="none", level="stated", modelled=False)
def stations(cfg: WindConfig, wanted: Wanted) -> Readings:
    """Reports of stations."""
    from flight_quantities.levels import HEIGHT
    from pareto_ltl.support.levels import table_level
    from pareto_ltl_apps.formats.station_files import read_station_files

    level = table_level(cfg.level, (HEIGHT,), "stations report winds near the ground")
    return read_station_files(_of_path(cfg, wanted), cfg.max_speed, wanted.area).at_stated_level(level)


def _live_files(cfg: WindConfig, wanted: Wanted) -> tuple[Path, ...]:
    from pareto_ltl_apps.formats.live import live_files

    return live_files(cfg, wanted)


@source("rtofs", files=_live_files, forecast_error="currents", current=True, live=True)
@source("noaa", "nbm", "aigfs", "aigefs", "ifs", "aifs", files=_live_files, live=True)
def live(cfg: WindConfig, wanted: Wanted) -> Readings:
    """The newest forecast, downloaded."""
    from pareto_ltl_apps.formats.live import read_live

    return read_live(cfg, wanted)


@source(files=_of_path, reads_path=True, forecast_error="currents", current=True)
def currents(cfg: WindConfig, wanted: Wanted) -> Readings:
    """Currents of GRIB or NetCDF files, all of one format."""
    from pareto_ltl.support.file_formats import first_bytes, format_of
    from pareto_ltl_apps.formats.grib_files import grib_snapshots_apart
    from pareto_ltl_apps.formats.netcdf_files import netcdf_snapshots
    from pareto_ltl_apps.formats.quantities import CURRENTS
    from pareto_ltl_apps.formats.snapshots import latest_readings

    files = _of_path(cfg, wanted)
    if all(format_of(first_bytes(file)) == "GRIB" for file in files):
        read = grib_snapshots_apart(files, cfg.max_speed, cfg.level, wanted.area, CURRENTS)
        return latest_readings(*read._replace(law=""))
    return latest_readings(*netcdf_snapshots(files, CURRENTS, cfg.level, cfg.max_speed, wanted.area))


def _ensemble_files(cfg: WindConfig, wanted: Wanted) -> tuple[Path, ...]:
    """All files of ``wind.path``, including those in subfolders, one for each member."""
    from pareto_ltl.support.file_formats import is_data_file

    path = Path(str(cfg.path)).expanduser()
    below = [file for file in path.glob("*/*") if file.is_file() and is_data_file(file)]
    if not below:
        return _of_path(cfg, wanted)
    own = [file for file in path.iterdir() if file.is_file() and is_data_file(file)]
    return tuple(sorted([*own, *below]))


@source(files=_ensemble_files, reads_path=True)
def ensemble(cfg: WindConfig, wanted: Wanted) -> Readings:
    """Mean and deviations of the members in GRIB files, of which each folder may be one, and NetCDF files."""
    from pareto_ltl.support.file_formats import first_bytes, format_of
    from pareto_ltl_apps.formats.grib_files import grib_snapshots_apart
    from pareto_ltl_apps.formats.netcdf_files import netcdf_snapshots
    from pareto_ltl_apps.formats.quantities import WINDS
    from pareto_ltl_apps.formats.snapshots import ensemble_readings

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
    from pareto_ltl.extend import Wanted
    from pareto_ltl.support.file_formats import first_bytes, format_of
    from pareto_ltl_apps.formats.grib_files import grib_levels_apart
    from pareto_ltl_apps.formats.netcdf_files import netcdf_levels
    from pareto_ltl_apps.formats.quantities import CURRENTS, WINDS

    quantity = CURRENTS if cfg.source == "currents" else WINDS
    found: set[Level] = set()
    files = SOURCES[cfg.source].files(cfg, Wanted())
    for kind, read in (("GRIB", grib_levels_apart), ("NetCDF", netcdf_levels)):
        if some := tuple(file for file in files if format_of(first_bytes(file)) == kind):
            found |= read(some, quantity)
    return found


# --- no files -------------------------------------------------------------------------------------


@source(files=_no_files)
def given(_cfg: WindConfig, _wanted: Wanted) -> Readings:
    """An object in Python, which a run has instead."""
    raise ConfigError(
        "wind.source=given: the wind is an object in Python, pareto_ltl.plan(..., wind=readings); expected "
        "a source that reads files"
    )


@source(files=_no_files, forecast_error="none")
def calm(_cfg: WindConfig, _wanted: Wanted) -> Readings:
    """No wind."""
    from pareto_ltl.extend import CALM

    return CALM


def _source_of_path(path: str | Path) -> str:
    from pareto_ltl_apps.formats.content import source_of_path

    return source_of_path(path)


FORMATS = WindFormats(SOURCES, _source_of_path)
