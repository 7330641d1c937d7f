"""Levels, members and places of a CF variable, identified by attributes and by name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flight_quantities.levels import DEPTH, LENGTHS, PRESSURE, PRESSURES, Level
from pareto_ltl.extend import GeoBox
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.cf_directions import GridMapping, grid_mapping, twist_of_array
from pareto_ltl_apps.formats.grid_directions import axes_are_east_and_north
from pareto_ltl_apps.formats.snapshots import Nodes, crop

if TYPE_CHECKING:
    import xarray as xr

LEVEL_WORDS = re.compile(r"\b(\d+(?:\.\d+)?)[ -]?(met(?:er|re)s?|m|hpa|mb)(?=\b|above)")
LEVEL_NAMES = re.compile(
    r"(?:[uv]-?|si|ws_?|wspd_?|wd_?|wdir_?)(\d+)m?|(\d+)m?(?:[uv]|si|wdir)"
)  # u10, 10u, si10
MEMBER_NAMES = ("member", "ens", "ensemble", "number", "realization")


def text(array: xr.DataArray, attribute: str) -> str:
    """A text attribute; empty if there is none."""
    return str(array.attrs.get(attribute, ""))


# --- members ---------------------------------------------------------------------------------


def member_dimension(array: xr.DataArray) -> str | None:
    """The dimension of the members of an ensemble; None if there is none."""
    for name in map(str, array.dims):
        axis = array.coords.get(name)
        named = axis is not None and text(axis, "standard_name") == "realization"
        if named or name.lower() in MEMBER_NAMES:
            return name
    return None


# --- level -----------------------------------------------------------------------------------


def levels_of(array: xr.DataArray, kind: str) -> tuple[str | None, list[Level]]:
    """Dimension of the levels (None for a single level) and the levels; no levels if the file has none.

    ``kind`` is the meaning of lengths: ``height`` for winds, ``depth`` for currents.
    """
    named = (*array.dims, *text(array, "coordinates").split())
    axes = {name: array.coords[name] for name in named if name in array.coords}
    known = array.reset_coords(drop=True).assign_coords(axes).cf.guess_coord_axis()
    vertical = {*known.cf.axes.get("Z", ()), *known.cf.coordinates.get("vertical", ())}
    for name, axis in axes.items():
        if name in vertical and (axis.shape in ((), (1,)) or axis.dims == (name,)):
            names = f"{name} {text(axis, 'standard_name')} {text(axis, 'long_name')}".lower()
            unit = text(axis, "units").strip().lower()
            if unit in LENGTHS | PRESSURES and not re.search("projection|altitude|sea level", names):
                levels = [_level(kind, unit, float(value)) for value in np.ravel(axis.values)]
                return (str(name) if name in array.dims else None), levels
    name = str(array.name).lower()
    if (match := LEVEL_NAMES.fullmatch(name)) is not None:
        return None, [_level(kind, "m", float(match[1] or match[2]))]
    words = LEVEL_WORDS.search(f"{name.replace('_', ' ')} {text(array, 'long_name').lower()}")
    return None, [] if words is None else [_level(kind, words[2], float(words[1]))]


def _level(kind: str, unit: str, value: float) -> Level:
    value = round(value * (PRESSURES | LENGTHS)[unit], 6)
    if unit in PRESSURES:
        return Level(PRESSURE, value)
    return Level(kind, abs(value) if kind == DEPTH else value)


# --- place -----------------------------------------------------------------------------------


def nodes_of(
    file: Path, array: xr.DataArray, axes: str, area: GeoBox | None
) -> tuple[tuple[str, ...], Nodes]:
    """Dimensions of the grid of ``array``, in its order, and the nodes in ``area`` with their twist.

    ``axes`` are those that the components follow: ``EARTH``, ``GRID`` or ``UNSTATED``.
    """
    import xarray as xr

    lat, lon = (_coordinate(file, array, role) for role in ("latitude", "longitude"))
    projected = lat is None or lon is None
    y, x = _grid_axes(file, array) if lat is None or lon is None else (lat, lon)
    straight = y.dims != x.dims
    if straight and (y.ndim != 1 or x.ndim != 1):
        raise DataError(f"wind file {file}: {y.name} and {x.name} do not span one grid")
    spatial = tuple(str(name) for name in array.dims if name in {*y.dims, *x.dims})
    grids = xr.broadcast(y.reset_coords(drop=True), x.reset_coords(drop=True))
    ys, xs = (grid.transpose(*spatial).values.astype(float) for grid in grids)
    mapping = grid_mapping(file, array)
    if projected:
        xs, ys = _degrees(file, mapping, xs, ys)
    nodes = crop(file, xs, ys, area)
    aligned = not projected and (straight or (ys.ndim == 2 and axes_are_east_and_north(xs, ys)))
    twist = twist_of_array(file, array, axes, mapping, nodes, spatial, aligned)
    return spatial, nodes._replace(twist=twist)


def _coordinate(file: Path, array: xr.DataArray, role: str) -> xr.DataArray | None:
    """The ``latitude`` or ``longitude`` of ``array``, by attributes, else by name; None if there is none.

    Coordinates that the attribute ``coordinates`` names are preferred. One that is stated anew at each time
    (WRF) must be the same at all times.
    """
    named = text(array, "coordinates").split()
    for recognise in (lambda: array, array.cf.guess_coord_axis):  # the second one takes long
        names = recognise().cf.coordinates.get(role, ())
        found: list[xr.DataArray] = [array.coords[name] for name in names]
        found = [c for c in found if c.ndim in (1, 2, 3) and text(c, "standard_name") in (role, "")]
        if found:
            best = min(found, key=lambda c: (c.name not in named, c.name not in array.dims, str(c.name)))
            return best if best.ndim < 3 else _of_one_time(file, best)
    return None


def _of_one_time(file: Path, axis: xr.DataArray) -> xr.DataArray:
    """The first of the grids of ``axis``; a DataError if they differ."""
    values = axis.values
    if not np.array_equal(values, np.broadcast_to(values[:1], values.shape), equal_nan=True):
        raise DataError(
            f"wind file {file}: the grid moves with time ({axis.name} has other values at later times); "
            "expected one grid: split the file at its times, or use a nest that does not move"
        )
    return axis.isel({axis.dims[0]: 0}, drop=True)


def _grid_axes(file: Path, array: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray]:
    """Coordinates y and x [m], or rotated latitude and longitude, of a grid without latitudes."""
    for pattern in ("projection_{}_coordinate", "grid_{}"):
        axes = []
        for letter, degree in (("y", "latitude"), ("x", "longitude")):
            for name in array.cf.standard_names.get(
                pattern.format(degree if "grid" in pattern else letter), ()
            ):
                axis = array.coords[name]
                if axis.ndim == 1:
                    axes.append(axis * LENGTHS.get(text(axis, "units").lower(), 1.0))
                    break
        if len(axes) == 2:
            return axes[0], axes[1]
    raise DataError(
        f"wind file {file}: {array.name} has no latitudes and longitudes; expected coordinates "
        "in degrees_north and degrees_east, or x and y with a grid mapping"
    )


def _degrees(
    file: Path, mapping: GridMapping | None, xs: FloatArray, ys: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Longitudes and latitudes [deg] of coordinates in the plane or on the rotated globe of ``mapping``."""
    import pyproj

    if mapping is None:
        raise DataError(
            f"wind file {file} has x and y and no grid mapping, which states where they lie; name the "
            "variable of the projection in the attribute grid_mapping, or add latitude and longitude"
        )
    if mapping.crs.is_projected:
        lon, lat = pyproj.Proj(mapping.crs)(xs, ys, inverse=True)
    else:
        lon, lat = pyproj.Transformer.from_crs(mapping.crs, 4326, always_xy=True).transform(xs, ys)
    return np.asarray(lon, float), np.asarray(lat, float)
