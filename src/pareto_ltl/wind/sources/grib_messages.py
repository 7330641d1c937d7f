"""Decoding of one GRIB message: a component of the wind or the surface pressure, on the nodes of its grid."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.area import GeoBox, refuse_empty_crop
from pareto_ltl.wind.levels import HEIGHT, PRESSURE, Level
from pareto_ltl.wind.readings import wrap_longitude
from pareto_ltl.world.projection import meridian_convergence

SPEED_UNITS = ("m s**-1", "m s-1", "m/s")
SURFACE_PRESSURE = "sp"
NUMBERED = {(0, 2, 2): "u", (0, 2, 3): "v", (0, 3, 0): SURFACE_PRESSURE}  # discipline, category, number
NAMED = re.compile(r"(?:\d+)?([uv])")  # short names of edition 1: u, 10u, 100v
MEANS = (0, 1, 6)  # code table 4.7: means of the members; other statistics of an ensemble are not a wind


@dataclass(frozen=True, slots=True)
class GribGrid:
    """Nodes of a grid, cropped.

    Attributes
    ----------
    lonlat : (N, 2) float
        Longitude (-180..180) and latitude [deg].
    kept : (N,) int or None
        Indices of the nodes among those of the message; None if all are kept.
    twist : (N,) float or None
        Angle from grid north to true north [rad]; None if winds are Earth-relative.
    """

    lonlat: FloatArray
    kept: IntArray | None
    twist: FloatArray | None


@dataclass(frozen=True, slots=True)
class GribField:
    """One component of the wind, or the surface pressure (``sp``), at one time."""

    component: str
    time: float  # validity [s since 1970]
    lead: float  # validity minus start of the forecast [s]
    member: str  # of an ensemble
    file: Path
    grid: GribGrid
    values: FloatArray  # (N,) [m/s] or [Pa]; NaN where the bitmap has none


@dataclass(slots=True)
class GribScan:
    """The wanted fields of a file, and a record of what else it contains.

    Attributes
    ----------
    level : Level
        Level of the wind.
    area : GeoBox or None
        Nodes outside are left out.
    grids : dict
        Grids that are decoded already, by their fingerprint.
    levels : list of Level
        Levels of the winds in the file.
    left_out : dict
        Numbers of winds at the level that are not values of an instant, by kind, e.g. ``average``.
    """

    level: Level
    area: GeoBox | None
    grids: dict[str, GribGrid] = field(default_factory=dict)
    levels: list[Level] = field(default_factory=list)
    left_out: dict[str, int] = field(default_factory=dict)


def decode_message(eccodes: Any, message: int, file: Path, scan: GribScan) -> GribField | None:
    """The field in ``message``; None if it is not a wanted one. Values are decoded last."""
    component = _component(eccodes, message)
    if component is None or not _is_wanted(eccodes, message, component, scan):
        return None
    get = eccodes.codes_get
    if component != SURFACE_PRESSURE and (unit := get(message, "units")) not in SPEED_UNITS:
        raise DataError(f"wind file {file}: {component} is in {unit}; expected m s-1: convert the file")
    valid, start = (
        _message_time(get(message, f"{kind}Date"), get(message, f"{kind}Time"))
        for kind in ("validity", "data")
    )
    grid = _grid_of(eccodes, message, file, scan)
    values = np.asarray(eccodes.codes_get_values(message), dtype=float)
    values = values.copy() if grid.kept is None else values[grid.kept]
    if get(message, "bitmapPresent"):
        values[values == get(message, "missingValue", float)] = np.nan
    return GribField(component, valid, valid - start, _member(eccodes, message), file, grid, values)


def _component(eccodes: Any, message: int) -> str | None:
    get = eccodes.codes_get
    if get(message, "edition") == 2:
        keys = ("discipline", "parameterCategory", "parameterNumber")
        return NUMBERED.get(tuple(get(message, key) for key in keys))
    name = str(get(message, "shortName"))
    found = NAMED.fullmatch(name)
    return found[1] if found else SURFACE_PRESSURE if name == SURFACE_PRESSURE else None


def _is_wanted(eccodes: Any, message: int, component: str, scan: GribScan) -> bool:
    """Whether the message has the wanted level and values of an instant; others are recorded in ``scan``."""
    if component == SURFACE_PRESSURE:
        kind = eccodes.codes_get(message, "typeOfLevel")
        return scan.level.kind == PRESSURE and kind == "surface" and _other_kind(eccodes, message) is None
    level = _message_level(eccodes, message)
    if level is not None:
        scan.levels.append(level)
    if level != scan.level:
        return False
    if (other := _other_kind(eccodes, message)) is not None:
        scan.left_out[other] = scan.left_out.get(other, 0) + 1
        return False
    return True


def _message_level(eccodes: Any, message: int) -> Level | None:
    kind, value = eccodes.codes_get(message, "typeOfLevel"), eccodes.codes_get(message, "level", float)
    if kind == "heightAboveGround":
        return Level(HEIGHT, value)
    if kind in ("isobaricInhPa", "isobaricInPa"):
        return Level(PRESSURE, value * (100.0 if kind == "isobaricInhPa" else 1.0))
    return None


def _other_kind(eccodes: Any, message: int) -> str | None:
    """Kind of a value that is not of an instant, e.g. ``average`` or ``spread of members``; else None."""
    step = str(eccodes.codes_get(message, "stepType"))
    if step != "instant":
        return {"avg": "average", "max": "maximum", "min": "minimum"}.get(step, step)
    derived = eccodes.codes_is_defined(message, "derivedForecast")
    if derived and eccodes.codes_get(message, "derivedForecast") not in MEANS:
        return "spread of members"
    return None


def _member(eccodes: Any, message: int) -> str:
    if eccodes.codes_is_defined(message, "derivedForecast"):
        return "mean"
    if eccodes.codes_is_defined(message, "perturbationNumber"):
        return f"{eccodes.codes_get(message, 'perturbationNumber'):02d}"
    return ""


def _grid_of(eccodes: Any, message: int, file: Path, scan: GribScan) -> GribGrid:
    key = str(eccodes.codes_get(message, "md5GridSection"))
    if key not in scan.grids:
        scan.grids[key] = _decode_grid(eccodes, message, file, scan.area)
    return scan.grids[key]


def _decode_grid(eccodes: Any, message: int, file: Path, area: GeoBox | None) -> GribGrid:
    """The nodes of the grid of ``message`` that are in ``area``."""
    lon = wrap_longitude(np.asarray(eccodes.codes_get_array(message, "longitudes"), float))
    lat = np.asarray(eccodes.codes_get_array(message, "latitudes"), float)
    lonlat, kept = np.stack([lon, lat], axis=1), None
    if area is not None:
        inside = area.pick(lonlat)
        if not len(inside):
            refuse_empty_crop(f"wind file {file}", lonlat, area)
        if len(inside) < len(lonlat):
            lonlat, kept = lonlat[inside], inside
    kind = eccodes.codes_get(message, "gridType")
    if not eccodes.codes_get(message, "uvRelativeToGrid") or kind in ("regular_ll", "regular_gg", "mercator"):
        return GribGrid(lonlat, kept, None)  # the axes of these grids are east and north
    crs = _grid_crs(lambda name: eccodes.codes_get(message, name, float), kind)
    if crs is None:
        raise DataError(
            f"wind file {file}: winds follow a grid of type {kind}, which cannot be turned to the east; "
            "expected lambert, polar_stereographic or a latitude-longitude grid"
        )
    return GribGrid(lonlat, kept, meridian_convergence(crs, *lonlat.T))


def _grid_crs(number: Any, kind: str) -> str | None:
    """PROJ string of the projection of the model; None for an unknown kind of grid.

    Directions do not depend on the radius of the sphere.
    """
    if kind == "lambert":
        return (
            f"+proj=lcc +lat_1={number('Latin1InDegrees')} +lat_2={number('Latin2InDegrees')} "
            f"+lat_0={number('LaDInDegrees')} +lon_0={number('LoVInDegrees')} +R=6371229 +no_defs"
        )
    if kind == "polar_stereographic":
        pole = -90 if number("southPoleOnProjectionPlane") else 90
        lon = number("orientationOfTheGridInDegrees")
        lat = number("LaDInDegrees")
        return f"+proj=stere +lat_0={pole} +lat_ts={lat} +lon_0={lon} +R=6371229 +no_defs"
    return None


def _message_time(date: int, clock: int) -> float:
    """Seconds since 1970 of the integers YYYYMMDD and HHMM."""
    return datetime.strptime(f"{date:08d}{clock:04d}", "%Y%m%d%H%M").replace(tzinfo=UTC).timestamp()
