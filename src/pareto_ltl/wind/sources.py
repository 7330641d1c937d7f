"""The readings of the source that ``wind.source`` names, and of files and datasets from Python."""

from __future__ import annotations

import glob
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from careful_io.messages import shown_text
from careful_io.reading import refuse_special
from pareto_ltl.settings import WindConfig
from pareto_ltl.settings.wind import WindSource, usual_level, wind_formats, wind_sources
from pareto_ltl.support import extensions
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.file_formats import is_data_file
from pareto_ltl.wind.area import ALL_WIND, Wanted
from pareto_ltl.wind.readings import Readings


def data_files(cfg: WindConfig, _wanted: Wanted = ALL_WIND) -> tuple[Path, ...]:
    """The files of ``wind.path``, sorted: a file, all data files of a folder, or the matches of a pattern.

    Raises
    ------
    ConfigError
        If ``wind.path`` is not set.
    DataError
        If there is no such file, or a pipe, a socket or a device in its place.
    """
    if cfg.path is None:
        raise ConfigError(f"wind.path is missing: wind.source={cfg.source} needs a file, folder or pattern")
    path = Path(cfg.path).expanduser()
    refuse_special(path)
    if path.is_dir():
        ends = (".csv", ".csv.gz") if cfg.source in ("csv", "stations") else ("",)
        files = [file for file in path.iterdir() if file.name.lower().endswith(ends)]
        found = [file for file in files if file.is_file() and is_data_file(file)]
    elif path.is_file():
        found = [path]
    else:
        found = [Path(name) for name in glob.glob(str(path), recursive=True) if Path(name).is_file()]
    if not found:
        none = "no {} file in this folder" if path.is_dir() else "no {} file, folder or pattern of that name"
        raise DataError(f"wind.path={cfg.path}: {none.format(cfg.source)}")
    return tuple(sorted(found))


def source_of_path(path: str | Path) -> str:
    """The value of ``wind.source`` for a file, all files of a folder, or the matches of a pattern.

    Raises
    ------
    DataError
        If there is no such file, or the files need several sources.
    """
    return wind_formats().source_of_path(path)


def wind_source(cfg: WindConfig) -> WindSource:
    """The source ``wind.source``: one of this package, or of another package; KeyError if unknown."""
    return extensions.WIND_SOURCES.kind(
        wind_sources(), cfg.source, lambda loaded: isinstance(loaded, WindSource)
    )


def read_readings(cfg: WindConfig, wanted: Wanted = ALL_WIND) -> Readings:
    """The readings of the source, of large files only those that are ``wanted``; calm wind has no times."""
    return wind_source(cfg).read(cfg, wanted)


def is_dataset(wind: Any) -> bool:
    """Whether ``wind`` is a dataset of xarray; nothing is imported to know it.

    Raises ConfigError for an array of xarray, which is one component of a wind.
    """
    if hasattr(wind, "to_netcdf") and hasattr(wind, "to_dataset"):
        raise ConfigError(
            "the wind is one array of xarray; give a dataset with both components, e.g. "
            'xarray.Dataset({"u10": u, "v10": v}), or the file that has them'
        )
    return hasattr(wind, "to_netcdf") and hasattr(wind, "data_vars")


def read_dataset(data: Any, source: str | None = None, level: str | None = None) -> Readings:
    """:func:`read_wind` of a dataset of xarray, whose variables say what they are as CF files do."""
    with TemporaryDirectory(prefix="pareto_ltl_") as folder:
        file = Path(folder) / "dataset.nc"
        try:
            data.to_netcdf(file, engine="h5netcdf")
        except (ValueError, TypeError, NotImplementedError) as error:
            reason = shown_text(" ".join(str(error).split()), 200)
            raise DataError(f"the given dataset cannot be written as NetCDF ({reason}); check it") from None
        try:
            found = read_wind(file, source, level)
        except DataError as error:
            text = str(error).replace(f"wind file {file}", "the given dataset")
            raise DataError(text.replace(str(file), "the given dataset")) from None
    return replace(found, files=(), origins=((),) * len(found.times))


def read_wind(path: Any, source: str | None = None, level: str | None = None) -> Readings:
    """The winds, or currents, of a file, a folder, a pattern or a dataset, everywhere and at all times.

    Parameters
    ----------
    path : str, Path or xarray.Dataset
        GRIB, NetCDF, a table (CSV), reports of stations (CSV, JSON); or what xarray has opened.
    source : str, optional
        The value of ``wind.source``; without it, it follows from the content.
    level : str, optional
        The value of ``wind.level``; without it, 10 m above ground, for currents 0 m.

    Raises
    ------
    DataError
        If there is no such file, or it cannot be read; the message says what to do.
    ConfigError
        If ``source`` or ``level`` is not known.
    """
    from pareto_ltl.settings import Settings

    if is_dataset(path):
        return read_dataset(path, source, level)
    chosen = source or source_of_path(path)
    stated = usual_level(chosen, None) if level in (None, "auto") else level
    cfg = Settings.of_section("wind", {"source": chosen, "path": str(path), "level": stated})
    assert isinstance(cfg, WindConfig)
    return read_readings(cfg)
