"""Where wind readings come from: one module per file format, all with the result :class:`Readings`.

A new format is a module with a function ``(files, max_speed) -> Readings`` and an entry in
``SOURCE_FORMATS``.
"""

from __future__ import annotations

import glob
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import Readings, iso
from pareto_ltl.wind.sources.csv_files import read_csv_files
from pareto_ltl.wind.sources.grib_files import first_grib_time, read_grib_files

SAMPLE_FILE = Path(__file__).parents[2] / "support" / "data" / "gfs_conus_20181009.csv"


@dataclass(frozen=True, slots=True)
class SourceFormat:
    """A file format of wind readings.

    Attributes
    ----------
    read : (files, largest plausible wind speed [m/s]) -> Readings
    first_time : (files) -> float, or None
        First time [s since 1970] from the headers of the files; None if only ``read`` finds it.
    pattern : str
        Files that belong to the format in a folder.
    """

    read: Callable[[tuple[Path, ...], float], Readings]
    first_time: Callable[[tuple[Path, ...]], float] | None = None
    pattern: str = "*"


SOURCE_FORMATS = {
    "sample": SourceFormat(read_csv_files),
    "csv": SourceFormat(read_csv_files, pattern="*.csv"),
    "grib": SourceFormat(read_grib_files, first_grib_time),
}


def read_source(cfg: WindConfig) -> Readings:
    """The readings of ``wind.source``, which must not be ``calm``."""
    return SOURCE_FORMATS[cfg.source].read(source_files(cfg), cfg.max_speed)


def first_wind_time(cfg: WindConfig) -> str | None:
    """The first time of the source, ISO 8601 UTC, which is the default departure; None for calm wind."""
    if cfg.source == "calm":
        return None
    first_time = SOURCE_FORMATS[cfg.source].first_time
    return iso(read_source(cfg).times[0] if first_time is None else first_time(source_files(cfg)))


def source_files(cfg: WindConfig) -> tuple[Path, ...]:
    """The files of ``wind.path``, sorted: one file, all data files of a folder, or the matches of a pattern.

    Raises
    ------
    DataError
        If there is no such file.
    """
    if cfg.source == "sample":
        return (SAMPLE_FILE,)
    path = Path(str(cfg.path)).expanduser()
    if path.is_dir():
        matches = path.glob(SOURCE_FORMATS[cfg.source].pattern)
        found = [file for file in matches if file.is_file() and is_data_file(file)]
    elif path.is_file():
        found = [path]
    else:
        found = [Path(name) for name in glob.glob(str(path), recursive=True) if Path(name).is_file()]
    if not found:
        raise DataError(f"wind.path={cfg.path}: no {cfg.source} file, folder or pattern of that name")
    return tuple(sorted(found))


def is_data_file(file: Path) -> bool:
    """Whether ``file`` may hold readings: False for hidden files, indices, texts and JSON."""
    return not file.name.startswith(".") and file.suffix.lower() not in (".idx", ".md", ".txt", ".json")


__all__ = [
    "SAMPLE_FILE",
    "SOURCE_FORMATS",
    "SourceFormat",
    "first_wind_time",
    "is_data_file",
    "read_source",
    "source_files",
]
