"""The value of ``wind.source`` that reads a file, a folder or a pattern, by its content."""

from __future__ import annotations

import glob
from itertools import islice
from pathlib import Path

from careful_io.messages import shown_value
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.file_formats import first_bytes, format_of, is_data_file
from pareto_ltl_apps.formats.grib_frames import check_frames, parameters
from pareto_ltl_apps.formats.netcdf_files import quantities_in
from pareto_ltl_apps.formats.quantities import CURRENTS, WINDS
from pareto_ltl_apps.formats.station_tables import BUOYS, holds_reports
from pareto_ltl_apps.formats.tables import open_table, read_table

MAX_FIELDS = 20_000  # of a GRIB file, that are looked at


def source_of_path(path: str | Path) -> str:
    """The value of ``wind.source`` for a file, all files of a folder, or the matches of a pattern.

    Raises
    ------
    DataError
        If there is no such file, or the files need several sources.
    """
    place = Path(path).expanduser()
    if place.is_dir():
        found = [file for file in place.iterdir() if file.is_file() and is_data_file(file)]
        if not found and any(file.is_file() and is_data_file(file) for file in place.glob("*/*")):
            return "ensemble"  # one folder for each member
    elif place.is_file():
        found = [place]
    else:
        found = [Path(name) for name in glob.glob(str(place), recursive=True) if Path(name).is_file()]
    if not found:
        raise DataError(
            f"wind.path={path}: no file, folder or pattern of that name with winds; expected GRIB, NetCDF or "
            "a table (CSV, or JSON of stations)"
        )
    sources = {source_of_file(file): file for file in sorted(found, reverse=True)}
    if set(sources) == {"grib", "ensemble"}:  # the control run of an ensemble has no number
        return "ensemble"
    if len(sources) > 1:
        each = ", ".join(f"{file.name} ({source})" for source, file in sorted(sources.items()))
        raise DataError(
            f"wind.path={path} has files of several kinds: {each}; name files of one kind, by a pattern such "
            f"as {shown_value(str(Path(path) / '*.nc'))}, or set wind.source"
        )
    return next(iter(sources))


def source_of_file(path: Path) -> str:
    """The value of ``wind.source`` that reads the file ``path``."""
    kind = format_of(first_bytes(path))
    if kind == "GRIB":
        return _grib_source(path)
    if kind == "NetCDF":
        several = quantities_in(path)
        if WINDS.name not in several and CURRENTS.name in several:
            return CURRENTS.source
        return "ensemble" if several.get(WINDS.name) else WINDS.source
    with open_table(path, "a table of winds") as stream:
        start = stream.read(200).lstrip()
    if start[:1] in ("[", "{") or start.lower().startswith(BUOYS):
        return "stations"
    titles = read_table(path, "a table of winds", holds_reports).titles
    return "stations" if holds_reports(titles) else "csv"


def _grib_source(path: Path) -> str:
    with path.open("rb") as stream:
        check_frames(path, stream)
        there = list(islice(parameters(stream), MAX_FIELDS))
    if any(one.number in CURRENTS.numbers for one in there) and not any(
        one.number in WINDS.numbers for one in there
    ):
        return CURRENTS.grib_source
    members = {one.member for one in there if one.number in WINDS.numbers and one.member is not None}
    return "ensemble" if len(members) > 1 else WINDS.grib_source
