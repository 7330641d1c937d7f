"""Coordinates of a CF variable in space and time, identified by attributes and by name."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.levels import DEPTH, LENGTHS, PRESSURE, PRESSURES, Level
from pareto_ltl.support.messages import shown_text, shown_value
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.snapshots import Nodes, crop
from pareto_ltl.world.projection import meridian_convergence, to_geographic

if TYPE_CHECKING:
    import xarray as xr

TIMES = {"d": "days", "h": "hours", "hr": "hours", "min": "minutes", "s": "seconds", "sec": "seconds"}
TIMES |= {"hrs": "hours", "mins": "minutes", "secs": "seconds", "msec": "milliseconds"}
LEVEL_WORDS = re.compile(r"\b(\d+(?:\.\d+)?)[ -]?(met(?:er|re)s?|m|hpa|mb)(?=\b|above)")
MEMBER_NAMES = ("member", "ens", "ensemble", "number", "realization")
EARLIEST, LATEST = -6e9, 8e9  # [s since 1970] limits of valid times: 1779 and 2223


def text(array: xr.DataArray, attribute: str) -> str:
    """A text attribute; empty if there is none."""
    return str(array.attrs.get(attribute, ""))


# --- time ------------------------------------------------------------------------------------


def times_of(file: Path, array: xr.DataArray) -> tuple[str | None, FloatArray, FloatArray]:
    """Time dimension (None for a single time), times [s since 1970], and leads [s], NaN if not known."""
    flat = [other for other in array.coords.values() if other.ndim <= 1]
    clocks = [other for other in flat if _role(other) == "time"]
    clocks.sort(key=lambda other: (not other.dims, text(other, "standard_name") != "time", str(other.name)))
    if not clocks:
        raise DataError(
            f"wind file {file}: {array.name} has no time; expected a coordinate with units such as "
            "'hours since 2018-10-09 00:00'"
        )
    clock = clocks[0]
    times = _seconds(file, clock)
    if not (np.isfinite(times).all() and (times > EARLIEST).all() and (times < LATEST).all()):
        raise DataError(f"wind file {file}: {clock.name} has an invalid time; fetch the file again")
    leads = np.full(len(times), np.nan)
    for other in flat:
        if not set(other.dims) <= set(clock.dims):
            continue
        if _role(other) == "forecast_reference_time":
            leads = np.broadcast_to(times - _seconds(file, other), times.shape)
        elif _role(other) == "forecast_period":
            leads = np.broadcast_to(_seconds(file, other, " since 1970-01-01"), times.shape)
    return (str(clock.dims[0]) if clock.dims else None), times, leads


def _role(array: xr.DataArray) -> str:
    """The standard name of a coordinate of time; without one, it is recognised by name and units."""
    if array.name == "reftime":
        return "forecast_reference_time"
    stated = text(array, "standard_name")
    clock = " since " in text(array, "units").lower() and stated != "forecast_reference_time"
    return "time" if clock else stated


def _seconds(file: Path, array: xr.DataArray, zero: str = "") -> FloatArray:
    """Times [s since 1970] of a coordinate, shape (n,); ``zero`` is added to units of durations."""
    import xarray as xr

    units, calendar = text(array, "units"), text(array, "calendar") or "standard"
    unit, _, since = f"{units.strip().lower()}{zero}".partition(" ")
    plain = array.variable.copy()
    plain.attrs = {"units": f"{TIMES.get(unit, unit)} {since}", "calendar": calendar}
    try:
        coder = xr.coders.CFDatetimeCoder(use_cftime=False, time_unit="us")
        found = coder.decode(plain, array.name).values.reshape(-1)
        return np.where(np.isnat(found), np.nan, found.astype("M8[us]").astype(np.int64) / 1e6)
    except (ValueError, KeyError, OverflowError, TypeError):
        raise DataError(
            f"wind file {file}: {array.name}: its time units {shown_value(units)} in the calendar "
            f"{shown_value(calendar)} are not known; expected 'hours since 2018-10-09' in the standard "
            "calendar, from 1582 on"
        ) from None


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
    if (match := re.fullmatch(r"[uv]-?(\d+)m?|(\d+)m?[uv]", name)) is not None:  # u10, 10u
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
    file: Path, array: xr.DataArray, relative: bool, area: GeoBox | None
) -> tuple[tuple[str, ...], Nodes]:
    """Dimensions of the grid of ``array``, in its order, and the nodes in ``area``.

    ``relative``: the components are along the axes of the grid.
    """
    import xarray as xr

    lat, lon = (_coordinate(array, role) for role in ("latitude", "longitude"))
    projected = lat is None or lon is None
    y, x = _projected_axes(file, array) if lat is None or lon is None else (lat, lon)
    straight = y.dims != x.dims
    if straight and (y.ndim != 1 or x.ndim != 1):
        raise DataError(f"wind file {file}: {y.name} and {x.name} do not span one grid")
    spatial = tuple(str(name) for name in array.dims if name in {*y.dims, *x.dims})
    grids = xr.broadcast(y.reset_coords(drop=True), x.reset_coords(drop=True))
    ys, xs = (grid.transpose(*spatial).values.astype(float).reshape(-1) for grid in grids)
    crs = _grid_crs(file, array) if projected or (relative and not straight) else None
    if projected and crs is not None:
        xs, ys = to_geographic(crs, np.stack([xs, ys], axis=1))
    nodes = crop(file, xs, ys, area)
    if crs is not None and relative:
        nodes = nodes._replace(twist=meridian_convergence(crs, *nodes.lonlat.T))
    return spatial, nodes


def _coordinate(array: xr.DataArray, role: str) -> xr.DataArray | None:
    """The ``latitude`` or ``longitude`` of ``array``, by attributes, else by name; None if there is none.

    Coordinates that the attribute ``coordinates`` names are preferred.
    """
    named = text(array, "coordinates").split()
    for recognise in (lambda: array, array.cf.guess_coord_axis):  # the second one takes long
        names = recognise().cf.coordinates.get(role, ())
        found: list[xr.DataArray] = [array.coords[name] for name in names]
        found = [c for c in found if c.ndim in (1, 2) and text(c, "standard_name") in (role, "")]
        if found:
            return min(found, key=lambda c: (c.name not in named, c.name not in array.dims, str(c.name)))
    return None


def _projected_axes(file: Path, array: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray]:
    """Coordinates y and x [m] of a grid in the plane of a projection and without latitudes."""
    axes = []
    for letter in "yx":
        for name in array.cf.standard_names.get(f"projection_{letter}_coordinate", ()):
            axis = array.coords[name]
            if axis.ndim == 1:
                axes.append(axis * LENGTHS.get(text(axis, "units").lower(), 1.0))
                break
    if len(axes) < 2:
        raise DataError(
            f"wind file {file}: {array.name} has no latitudes and longitudes; expected coordinates "
            "in degrees_north and degrees_east, or x and y with a grid mapping"
        )
    return axes[0], axes[1]


def _grid_crs(file: Path, array: xr.DataArray) -> str:
    """PROJ string of the projection in the variable that ``grid_mapping`` names."""
    import pyproj

    advice = "turn them to east and north, or name the grid mapping"
    mapping = array.coords.get(text(array, "grid_mapping"))
    if mapping is None:
        raise DataError(
            f"wind file {file}: {array.name} follows the axes of a grid whose directions the "
            f"file does not state; {advice}"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the string has no name of the datum: directions need none
            crs = pyproj.CRS.from_cf(
                {key: np.asarray(value).tolist() for key, value in mapping.attrs.items()}
            )
            if not crs.is_projected:
                raise KeyError(text(mapping, "grid_mapping_name"))
            return str(crs.to_proj4())
    except (pyproj.exceptions.CRSError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise DataError(
            f"wind file {file}: the grid mapping {mapping.name} is not understood "
            f"({shown_text(' '.join(str(error).split()), 200)}); {advice}"
        ) from None
