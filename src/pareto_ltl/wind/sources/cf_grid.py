"""Coordinates of a CF variable in space and time, found by attributes and by name."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.area import GeoBox, refuse_empty_crop
from pareto_ltl.wind.levels import DEPTH, HEIGHT, PRESSURE, Level
from pareto_ltl.wind.readings import wrap_longitude
from pareto_ltl.wind.sources.cf_file import CfFile, CfVariable
from pareto_ltl.wind.sources.cf_units import duration_factor, level_unit, time_scale
from pareto_ltl.world.projection import meridian_convergence

LATITUDES = re.compile(r"degrees?_?n(orth)?")
LONGITUDES = re.compile(r"degrees?_?e(ast)?")
LATITUDE_NAMES = ("lat", "latitude", "nav_lat", "xlat", "y_lat")
LONGITUDE_NAMES = ("lon", "longitude", "nav_lon", "xlong", "x_lon")
LEVEL_WORDS = re.compile(r"\b(\d+(?:\.\d+)?)[ -]?(met(?:er|re)s?|m|hpa|mb)(?=\b|above)")
MEMBER_NAMES = ("member", "ens", "ensemble", "number", "realization")
EARLIEST, LATEST = -6e9, 8e9  # [s since 1970] limits of valid times: 1779 and 2223


@dataclass(frozen=True, slots=True)
class CfNodes:
    """Nodes of a grid, cropped.

    Attributes
    ----------
    part : dict
        The slice to read of each spatial dimension.
    kept : (N,) int
        Indices of the nodes among the flattened values of that part.
    lonlat : (N, 2) float
        Longitude (-180..180) and latitude [deg].
    twist : (N,) float or None
        Angle from grid north to true north [rad]; None if the axes of the grid are east and north.
    """

    part: dict[str, slice]
    kept: IntArray
    lonlat: FloatArray
    twist: FloatArray | None


# --- time ------------------------------------------------------------------------------------


def times_of(file: CfFile, variable: CfVariable) -> tuple[str | None, FloatArray, FloatArray]:
    """Time dimension (None for a single time), times [s since 1970], and leads [s], NaN if not known."""
    axis = _time_axis(file, variable)
    times = _absolute_times(file, axis)
    if not (np.isfinite(times).all() and (times > EARLIEST).all() and (times < LATEST).all()):
        raise DataError(f"wind file {file.path}: {axis.name} has an invalid time; fetch the file again")
    leads = np.full(len(times), np.nan)
    for other in file.variables.values():
        if not set(other.dimensions) <= set(axis.dimensions) or other.name == axis.name:
            continue
        if other.text("standard_name") == "forecast_reference_time" or other.name == "reftime":
            leads = np.broadcast_to(times - _absolute_times(file, other), times.shape)
        elif other.text("standard_name") == "forecast_period":
            factor = duration_factor(other.text("units"))
            if factor is not None:
                leads = np.broadcast_to(file.read(other).reshape(-1) * factor, times.shape)
    return (axis.dimensions[0] if axis.dimensions else None), times, leads


def _time_axis(file: CfFile, variable: CfVariable) -> CfVariable:
    found = [
        other
        for other in file.variables.values()
        if len(other.dimensions) <= 1
        and set(other.dimensions) <= set(variable.dimensions)
        and (other.text("standard_name") == "time" or _is_clock(other))
    ]
    found.sort(key=lambda other: (not other.dimensions, other.text("standard_name") != "time", other.name))
    if not found:
        raise DataError(
            f"wind file {file.path}: {variable.name} has no time; expected a coordinate with units such as "
            "'hours since 2018-10-09 00:00'"
        )
    return found[0]


def _is_clock(variable: CfVariable) -> bool:
    reference = variable.text("standard_name") == "forecast_reference_time" or variable.name == "reftime"
    return " since " in variable.text("units").lower() and not reference


def _absolute_times(file: CfFile, variable: CfVariable) -> FloatArray:
    try:
        factor, zero = time_scale(variable.text("units"), variable.text("calendar"))
    except ValueError as error:
        raise DataError(f"wind file {file.path}: {variable.name}: {error}") from None
    return file.read(variable).reshape(-1) * factor + zero


def member_dimension(file: CfFile, variable: CfVariable) -> str | None:
    """The dimension of the members of an ensemble; None if there is none."""
    for name in variable.dimensions:
        axis = file.variables.get(name)
        if name.lower() in MEMBER_NAMES or (axis and axis.text("standard_name") == "realization"):
            return name
    return None


# --- level -----------------------------------------------------------------------------------


def levels_of(file: CfFile, variable: CfVariable, kind: str) -> tuple[str | None, list[Level]]:
    """Dimension of the levels (None for a single level) and the levels; no levels if the file has none.

    ``kind`` is the meaning of lengths: ``height`` for winds, ``depth`` for currents.
    """
    for name in variable.dimensions:
        axis = file.variables.get(name)
        if axis is not None and (found := _levels_on(file, axis, kind)):
            return name, found
    for name in variable.text("coordinates").split():
        axis = file.variables.get(name)
        if axis is not None and axis.shape in ((), (1,)) and (found := _levels_on(file, axis, kind)):
            return None, found
    name = variable.name.lower()
    if (told := re.fullmatch(r"[uv]-?(\d+)m?|(\d+)m?[uv]", name)) is not None:  # u10, 10u
        return None, [_level(kind, HEIGHT, float(told[1] or told[2]))]
    told = LEVEL_WORDS.search(f"{name.replace('_', ' ')} {variable.text('long_name').lower()}")
    unit = None if told is None else level_unit(told[2])
    return None, [] if told is None or unit is None else [_level(kind, unit[0], float(told[1]) * unit[1])]


def _levels_on(file: CfFile, axis: CfVariable, kind: str) -> list[Level]:
    unit = level_unit(axis.text("units"))
    names = f"{axis.name} {axis.text('standard_name')} {axis.text('long_name')}".lower()
    vertical = (
        axis.text("axis") == "Z" or axis.text("positive") or re.search(r"height|depth|lev|press", names)
    )
    if unit is None or not vertical or re.search("projection|altitude|sea level", names):
        return []
    return [_level(kind, unit[0], value) for value in file.read(axis).reshape(-1) * unit[1]]


def _level(kind: str, unit: str, value: float) -> Level:
    value = round(value, 6)
    return Level(PRESSURE, value) if unit == PRESSURE else Level(kind, abs(value) if kind == DEPTH else value)


# --- place -----------------------------------------------------------------------------------


def nodes_of(file: CfFile, variable: CfVariable, relative: bool, area: GeoBox | None) -> CfNodes:
    """The nodes of ``variable`` in ``area``; ``relative``: its components are along the axes of the grid."""
    lat = _coordinate(file, variable, "latitude", LATITUDES, LATITUDE_NAMES)
    lon = _coordinate(file, variable, "longitude", LONGITUDES, LONGITUDE_NAMES)
    if lat is None or lon is None:
        return _projected_nodes(file, variable, relative, area)
    lats, lons = file.read(lat), file.read(lon)
    straight = lat.dimensions != lon.dimensions
    if straight and (len(lat.dimensions) != 1 or len(lon.dimensions) != 1):
        raise DataError(f"wind file {file.path}: {lat.name} and {lon.name} do not span one grid")
    spatial = _in_order(variable, (*lat.dimensions, *lon.dimensions) if straight else lat.dimensions)
    if straight:
        lats, lons = np.meshgrid(lats, lons, indexing="ij")
        if spatial != (*lat.dimensions, *lon.dimensions):
            lats, lons = lats.T, lons.T
    twist = None
    crs = None if straight or not relative else _grid_crs(file, variable)
    part, kept, lonlat = _cropped(file, spatial, lons, lats, area)
    if crs is not None:
        twist = meridian_convergence(crs, *lonlat.T)
    return CfNodes(part, kept, lonlat, twist)


def _coordinate(
    file: CfFile, variable: CfVariable, standard: str, unit: re.Pattern[str], names: tuple[str, ...]
) -> CfVariable | None:
    """The coordinate of ``variable`` with that standard name, unit or name; None if there is none.

    Coordinates that the attribute ``coordinates`` names are preferred.
    """
    named = variable.text("coordinates").split()
    found = [
        other
        for other in file.variables.values()
        if 1 <= len(other.dimensions) <= 2
        and set(other.dimensions) <= set(variable.dimensions)
        and (other.text("standard_name") == standard or unit.fullmatch(other.text("units").lower())
             or other.name.lower() in names)
        and other.text("standard_name") in (standard, "")
    ]  # fmt: skip
    found.sort(key=lambda other: (other.name not in named, other.name not in variable.dimensions, other.name))
    return found[0] if found else None


def _in_order(variable: CfVariable, dimensions: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in variable.dimensions if name in dimensions)


def _cropped(
    file: CfFile, spatial: tuple[str, ...], lons: FloatArray, lats: FloatArray, area: GeoBox | None
) -> tuple[dict[str, slice], IntArray, FloatArray]:
    """The part to read, indices of the values to keep, and their longitudes and latitudes (N, 2) [deg]."""
    lonlat = np.stack([wrap_longitude(lons), lats], axis=-1)
    inside = np.asarray(np.isfinite(lonlat).all(axis=-1))
    if (np.abs(lats[inside]) > 90.0).any():
        raise DataError(f"wind file {file.path}: a latitude is beyond 90 degrees; expected degrees north")
    if area is not None:
        flat = lonlat.reshape(-1, 2)
        chosen = np.zeros(len(flat), bool)
        chosen[area.pick(flat)] = True
        inside &= chosen.reshape(inside.shape)
        if not inside.any():
            refuse_empty_crop(f"wind file {file.path}", flat, area)
    if not inside.any():
        raise DataError(f"wind file {file.path} has no node with a latitude and longitude")
    box = tuple(slice(int(rows.min()), int(rows.max()) + 1) for rows in np.nonzero(inside))
    kept = np.flatnonzero(inside[box].reshape(-1))
    return dict(zip(spatial, box, strict=True)), kept, lonlat[box].reshape(-1, 2)[kept]


def _projected_nodes(file: CfFile, variable: CfVariable, relative: bool, area: GeoBox | None) -> CfNodes:
    """Nodes of a grid with coordinates x and y of a projection and without latitudes."""
    from pareto_ltl.world.projection import to_geographic

    axes = {}
    for other in file.variables.values():
        name = other.text("standard_name")
        if name in ("projection_x_coordinate", "projection_y_coordinate") and len(other.dimensions) == 1:
            axes[name[11]] = other
    if len(axes) < 2 or not {axis.dimensions[0] for axis in axes.values()} <= set(variable.dimensions):
        raise DataError(
            f"wind file {file.path}: {variable.name} has no latitudes and longitudes; expected coordinates "
            "in degrees_north and degrees_east, or x and y with a grid mapping"
        )
    crs = _grid_crs(file, variable)
    x, y = (
        file.read(axes[name]) * (1000.0 if axes[name].text("units").lower() == "km" else 1.0) for name in "xy"
    )
    spatial = _in_order(variable, (axes["y"].dimensions[0], axes["x"].dimensions[0]))
    grid = np.stack(np.meshgrid(x, y), axis=-1)  # rows along y
    if spatial[0] == axes["x"].dimensions[0]:
        grid = grid.transpose(1, 0, 2)
    lon, lat = to_geographic(crs, grid.reshape(-1, 2))
    part, kept, lonlat = _cropped(
        file, spatial, lon.reshape(grid.shape[:2]), lat.reshape(grid.shape[:2]), area
    )
    return CfNodes(part, kept, lonlat, meridian_convergence(crs, *lonlat.T) if relative else None)


def _grid_crs(file: CfFile, variable: CfVariable) -> str:
    """PROJ string of the projection in the variable that ``grid_mapping`` names."""
    import pyproj

    mapping = file.variables.get(variable.text("grid_mapping"))
    advice = "turn them to east and north, or name the grid mapping"
    if mapping is None:
        raise DataError(
            f"wind file {file.path}: {variable.name} follows the axes of a grid whose directions the "
            f"file does not state; {advice}"
        )
    plain = {name: _plain(mapping, name) for name in mapping.attributes}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the string has no name of the datum: directions need none
            crs = pyproj.CRS.from_cf(plain)
            if not crs.is_projected:
                raise KeyError(mapping.text("grid_mapping_name"))
            return str(crs.to_proj4())
    except (pyproj.exceptions.CRSError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise DataError(
            f"wind file {file.path}: the grid mapping {mapping.name} is not understood ({error}); {advice}"
        ) from None


def _plain(variable: CfVariable, name: str) -> object:
    value = variable.attributes[name]
    if isinstance(value, bytes | str):
        return variable.text(name)
    numbers = np.ravel(value).tolist()
    return numbers[0] if len(numbers) == 1 else numbers
