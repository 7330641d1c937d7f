"""The sources of winds: what each implies, and how its files are read a second time. One function is one row.

The form of a file follows from its content, whatever the source says (:mod:`pareto_ltl_verify.readers`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pareto_ltl_verify.readers.fields import Field, UnreadError, fields_of
from pareto_ltl_verify.readers.grib import grib_components
from pareto_ltl_verify.readers.netcdf import netcdf_components
from pareto_ltl_verify.readers.tables import table_fields


@dataclass(frozen=True, slots=True)
class WindFiles:
    """The wind files of a run, and what to read: a level (kind, value), and times [s since 1970].

    ``find`` raises UnreadError if a file is gone or was changed.
    """

    find: Callable[[], Sequence[Path]]
    level: tuple[str, float]
    span: tuple[float, float]


class Fields(NamedTuple):
    """The fields of files; ``models``: originating centres and generating processes of GRIB files."""

    fields: list[Field]
    models: frozenset[str] = frozenset()


Read = Callable[[WindFiles], Fields]


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """What a value of ``wind.source`` implies.

    Attributes
    ----------
    read : callable
        The fields of its files; UnreadError if they are not read a second time.
    law : str or None
        The law of wind.forecast_error=auto; None if it is not known.
    ensemble : bool
        Whether members of an ensemble can be part of the wind's error.
    level : bool
        Whether the level is set in the settings.
    modelled : bool or None
        Whether its fields are of a weather model, whose analyses count; None if it is not known.
    reads_path, live : bool
        Whether it reads wind.path; whether its files are downloaded, and no inputs of the run.
    names_model : bool
        Whether its files may state their model, which has a law.
    planar : bool
        Whether its readings may be in a plane, without latitudes.
    current : bool
        Whether it is a current.
    reports : bool
        Whether its readings are reports of stations, of the nearest full hour.
    """

    read: Read
    law: str | None = None
    ensemble: bool = False
    level: bool = True
    modelled: bool | None = True
    reads_path: bool = False
    live: bool = False
    names_model: bool = False
    planar: bool = False
    current: bool = False
    reports: bool = False


SOURCES: dict[str, Source] = {}


def source(*names: str, **implied: Any) -> Callable[[Read], Read]:
    """Make the decorated function the second reader of the sources ``names``; ``implied``: see Source."""

    def add(read: Read) -> Read:
        SOURCES.update(dict.fromkeys(names, Source(read=read, **implied)))
        return read

    return add


def source_of(name: str) -> Source:
    """The row of a wind source; of another package's, little is known."""
    return SOURCES.get(name, Source(read=by_content, ensemble=True, level=False, modelled=None))


# --- the rows ----------------------------------------------------------------------------------


@source("sample", law="none", level=False, modelled=False)
@source("csv", law="gfs", reads_path=True, planar=True)
@source("grib", law="gfs", ensemble=True, reads_path=True, names_model=True)
@source("netcdf", law="gfs", ensemble=True, reads_path=True)
@source("noaa", "aigfs", "aigefs", law="gfs", ensemble=True, live=True)
@source("ifs", "aifs", law="ecmwf_class", ensemble=True, live=True)
@source("nbm", law="hourly_fine", ensemble=True, live=True)
@source("rtofs", law="currents", level=False, live=True, current=True)
def by_content(files: WindFiles) -> Fields:
    """GRIB, NetCDF or tables; several members at one time are one field, their mean."""
    found = _read(files, reports=False)
    several = len({field.member for field in found.fields}) > 1
    return found._replace(fields=list(map(_mean, _by_time(found.fields)))) if several else found


@source("currents", law="currents", level=False, reads_path=True, current=True)
def currents(files: WindFiles) -> Fields:
    """Of the level, which is a depth."""
    return by_content(replace(files, level=("depth", files.level[1])))


@source("ensemble", law="gfs", ensemble=True, reads_path=True, names_model=True)
def ensemble(files: WindFiles) -> Fields:
    """All fields at one time are one, their mean: each file may be a member."""
    found = _read(files, reports=False)
    return found._replace(fields=list(map(_mean, _by_time(found.fields))))


@source("stations", law="none", modelled=False, reads_path=True, reports=True)
def stations(files: WindFiles) -> Fields:
    """Tables of reports, which have gaps and are not joined."""
    return _read(files, reports=True)


@source("given", law=None, ensemble=True, planar=True)
def given(_files: WindFiles) -> Fields:
    """An object in Python, of which there is no file."""
    raise UnreadError("the wind was given in Python")


@source("calm", law=None, level=False)
def calm(files: WindFiles) -> Fields:
    """No wind, and no file, unless a result is false."""
    return by_content(files)


# --- fields of files ---------------------------------------------------------------------------


def _read(files: WindFiles, *, reports: bool) -> Fields:
    """The fields of files of one format; tables are of ``reports`` of stations or not."""
    paths = files.find()
    kinds = {_format(path) for path in paths}
    if len(kinds) > 1:
        raise UnreadError("the wind files are of several formats")
    if kinds == {"GRIB"}:
        components, models = grib_components(paths, files.level, files.span)
        return Fields(fields_of(components), models)
    if kinds == {"NetCDF"}:
        parts = (one for path in paths for one in netcdf_components(path, files.level, files.span))
        return Fields(fields_of(parts))
    rows = [one for path in paths for one in table_fields(path, reports, files.level[0] == "depth")]
    return Fields(rows if reports else list(map(_together, _by_time(rows))))


def _by_time(fields: Iterable[Field]) -> list[list[Field]]:
    groups: dict[float, list[Field]] = {}
    for field in fields:
        groups.setdefault(field.time, []).append(field)
    return list(groups.values())


def _together(fields: Sequence[Field]) -> Field:
    """The rows of several tables at one time; the largest lead counts."""
    places, winds = (np.concatenate([getattr(f, name) for f in fields]) for name in ("places", "winds"))
    lead = float(np.fmax.reduce([field.lead for field in fields]))
    return replace(fields[0], lead=lead, places=places, winds=winds)


def _mean(fields: Sequence[Field]) -> Field:
    """The mean of the members at one time; UnreadError if they have different nodes."""
    first = fields[0]
    for other in fields:
        if other.places.shape != first.places.shape or np.abs(other.places - first.places).max() > 1e-3:
            raise UnreadError("the members of the ensemble are on different nodes, which the second reader "
                              "does not join")  # fmt: skip
    winds = np.mean([field.winds for field in fields], axis=0)
    return replace(first, lead=min(field.lead for field in fields), winds=winds)


def _format(path: Path) -> str:
    with path.open("rb") as stream:
        head = stream.read(2**16)
    if b"GRIB" in head[:4096] and not head.startswith(b"\x89HDF"):
        return "GRIB"
    return "NetCDF" if head.startswith((b"\x89HDF", b"CDF")) else "table"
