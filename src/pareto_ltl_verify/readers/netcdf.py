"""Winds and currents of NetCDF files, opened with xarray; which variable is what follows its attributes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.readers.clocks import Clock, clock_of
from pareto_ltl_verify.readers.fields import FROM, SPEED, TOWARDS, Component, U, UnreadError, V, axis_angle
from pareto_ltl_verify.readers.tables import UNITS

if TYPE_CHECKING:
    import xarray as xr

STANDARD = {  # component, and whether it is along the axes of a grid
    "eastward_wind": (U, False), "northward_wind": (V, False), "x_wind": (U, True), "y_wind": (V, True),
    "grid_eastward_wind": (U, True), "grid_northward_wind": (V, True), "wind_speed": (SPEED, False),
    "wind_from_direction": (FROM, False), "wind_to_direction": (TOWARDS, False),
}  # fmt: skip
CURRENTS = {
    "sea_water_x_velocity": (U, True), "sea_water_y_velocity": (V, True), "sea_water_speed": (SPEED, False),
    "sea_water_velocity_to_direction": (TOWARDS, False), "direction_of_sea_water_velocity": (TOWARDS, False),
    "sea_water_velocity_from_direction": (FROM, False),
    **{f"{form}{axis}_sea_water_velocity": (part, False) for axis, part in (("eastward", U), ("northward", V))
       for form in ("", "surface_", "surface_geostrophic_")},
}  # fmt: skip
UNSTATED = ("", "unknown", "undefined", "none")
NAMED = re.compile(
    r"(?:wind|water|current|cur)?([uv])(?:m|o|as|_?wnd|wind|grd.*|ogrd.*|cur.*|velocity|component.*"
    r"|maboveground.*|windmaboveground)?"
)
POLAR_NAMED = {SPEED: r"windspeed|wspd|ws|si|windspd|sfcwind", FROM: r"winddir(ection)?|wdir|wd"}
NOT_A_WIND = r"gust|stress|max|min|std|spread|error|anomaly|shear|storm|stokes|flux"
MEMBERS = ("number", "member", "ensemble", "realization", "ens")
LENGTHS = {**dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0), "km": 1000.0}
PRESSURES = {"pa": 1.0, **dict.fromkeys(("hpa", "mb", "mbar", "millibar", "millibars"), 100.0)}
DEGREES = ("degree", "degrees", "degrees_true", "degree_true", "degree true", "deg")


def netcdf_components(path: Path, level: tuple[str, float], span: tuple[float, float]) -> Iterator[Component]:
    """The components at ``level`` (kind, value) at times within ``span`` [s since 1970]; UnreadError."""
    import xarray as xr

    from careful_io.netcdf4 import refuse_other_files

    with path.open("rb") as stream:
        hdf5 = stream.read(4) == b"\x89HDF"
    if hdf5:
        refuse_other_files(path)
    options: dict[str, Any] = {"engine": "h5netcdf", "phony_dims": "access"} if hdf5 else {"engine": "scipy"}
    with xr.open_dataset(path, decode_times=False, decode_coords=False, cache=False, **options) as data:
        for part, grid, array, places in _parts(data, level):
            yield from _components(data, part, grid, array.isel(places), span)


def _parts(
    data: xr.Dataset, level: tuple[str, float]
) -> list[tuple[str, bool, xr.DataArray, dict[str, int]]]:
    """Component, whether it follows a grid, its array, and the index of the level in it."""
    best: dict[str, list[tuple[int, Any]]] = {}
    for name, array in data.variables.items():
        role = _role(str(name), array.attrs, level[0] == "depth") if array.ndim else None
        if role is None:
            continue
        part, grid, rank = role
        stated = _level_index(data, str(name), level)
        if stated is not None:
            place, known = stated
            best.setdefault(part, []).append((rank - 10 * known, (part, grid, data[name], place)))
    pairs = {U, V} if best.keys() & {U, V} else set(best)
    chosen = []
    for part in sorted(pairs & best.keys()):
        found = sorted(best[part], key=lambda entry: entry[0])
        if len(found) > 1 and found[0][0] == found[1][0]:
            raise UnreadError(f"several variables can be the component {part}")
        chosen.append(found[0][1])
    if not chosen:
        raise UnreadError("no variable is a component of the wind at the level")
    return chosen


def _role(name: str, attributes: Any, current: bool) -> tuple[str, bool, int] | None:
    """Component, whether it is along the axes of a grid, and a rank: 0 by standard name, 1 by name."""
    standard = str(attributes.get("standard_name", "")).strip()
    if standard.lower() not in UNSTATED:
        found = (CURRENTS if current else STANDARD).get(standard)
        return None if found is None else (*found, 0)
    words = f"{name} {attributes.get('long_name', '')} {attributes.get('description', '')}".lower()
    if re.search(NOT_A_WIND, words.replace("_", " ")):
        return None
    plain = re.sub(r"[\W_\d]", "", name.lower())
    earth = re.search("eastward|northward|zonal|meridional|earth[ -]rotated", words) is not None
    if (match := NAMED.fullmatch(plain)) is not None:
        return match[1], not earth, 1
    for part, pattern in POLAR_NAMED.items():
        if re.fullmatch(pattern, plain) and not current:
            return part, False, 1
    return None


def _level_index(data: xr.Dataset, name: str, level: tuple[str, float]) -> tuple[dict[str, int], bool] | None:
    """The index of the level in a variable, and whether its level is stated; None if it has another one."""
    array = data[name]
    named = str(array.attrs.get("coordinates", "")).split()
    for other, axis in data.variables.items():
        scalar = axis.size == 1 and (other in named or str(other).startswith(("height", "level", "depth")))
        if not (axis.dims == (other,) and other in array.dims) and not (scalar and axis.ndim < 2):
            continue
        unit = str(axis.attrs.get("units", "")).strip().lower()
        about = f"{other} {axis.attrs.get('standard_name', '')} {axis.attrs.get('axis', '')}".lower()
        if unit not in LENGTHS | PRESSURES or re.search(r"projection| [xyt]$|^[xy] ", about):
            continue
        kind = "pressure" if unit in PRESSURES else "depth" if level[0] == "depth" else "height"
        values = np.abs(np.ravel(axis.values).astype(float)) * (LENGTHS | PRESSURES)[unit]
        near = np.flatnonzero(np.abs(values - level[1]) <= 1e-3 * max(level[1], 1.0))
        if kind != level[0] or not len(near):
            return None
        return ({axis.dims[0]: int(near[0])} if axis.dims else {}), True  # type: ignore[dict-item]
    number = re.search(r"(?<!\d)(\d{1,4})[ _]?m(?:et(?:er|re)s?)?(?![a-z])|(?:^[uv]|^)_?(\d{2,3})(?:[uv])?$",
                       name.lower())  # fmt: skip
    if number is None or level[0] != "height":
        return {}, False
    return ({}, True) if abs(float(number[1] or number[2]) - level[1]) < 0.5 else None


def _components(
    data: xr.Dataset, part: str, grid: bool, array: xr.DataArray, span: tuple[float, float]
) -> Iterator[Component]:
    clock = clock_of(data, array)
    spatial, places, turn = _grid(data, array, grid and part in (U, V))
    factor = _factor(part, str(array.attrs.get("units", "")))
    crew = next((str(d) for d in array.dims if str(d).lower() in MEMBERS and d not in clock.dims), None)
    rest = [d for d in array.dims if d not in (*spatial, *clock.dims, crew, "expver")]
    if any(array.sizes[d] > 1 for d in rest):
        raise UnreadError(f"{array.name} has a dimension that is not a time, level, member or place")
    array = array.isel(dict.fromkeys(rest, 0))
    for place, time, lead in _moments(clock):
        if not span[0] - 1.0 <= time <= span[1] + 1.0:
            continue
        for member in range(array.sizes[crew] if crew else 1):
            values = array.isel(place | ({crew: member} if crew else {}))
            if "expver" in values.dims:  # final and preliminary data of ERA5
                values = values.bfill("expver").isel(expver=0) if values.sizes["expver"] > 1 else values[0]
            plain = np.asarray(values.transpose(*spatial).values, float).ravel() * factor
            yield Component(part, time, lead, f"{member:02d}" if crew else "", places, plain, turn)


def _moments(clock: Clock) -> Iterator[tuple[dict[Any, int], float, float]]:
    for index in np.ndindex(clock.times.shape):
        place = dict(zip(clock.dims, index, strict=True))
        yield place, float(clock.times[index]), float(clock.leads[index])


def _factor(part: str, units: str) -> float:
    if part in (FROM, TOWARDS):
        if units.lower().replace(" ", "_") not in DEGREES:
            raise UnreadError(f"the unit {units[:20]!r} of a direction is not known")
        return 1.0
    plain = re.sub(r"[^a-z0-9]", "", units.lower().replace("meter/sec", "m/s").replace("metres", "m"))
    if not plain or plain not in UNITS:
        raise UnreadError(f"the unit {units[:20]!r} is not known to the second reader")
    return UNITS[plain]


# --- places ------------------------------------------------------------------------------------


def _grid(
    data: xr.Dataset, array: xr.DataArray, follows: bool
) -> tuple[list[Any], FloatArray, FloatArray | None]:
    """Dimensions y and x of a grid, places (N, 2) [deg], and the angle of its rows if components follow them.

    They do if the variable is named so (``follows``), unless the grid is of parallels and meridians or the
    keys of GRIB state east and north.
    """
    lat, lon = (_coordinate(data, array, unit) for unit in ("north", "east"))
    if lat is not None and lon is not None:
        if lat.dims != lon.dims:  # parallels and meridians
            spatial = [lat.dims[0], lon.dims[0]]
            both = np.meshgrid(np.asarray(lon.values, float), np.asarray(lat.values, float))
            return spatial, np.stack([both[0].ravel(), both[1].ravel()], axis=1), None
        lat, lon = (c.isel(dict.fromkeys(c.dims[:-2], 0)) for c in (lat, lon))
        spatial, reverse = list(lat.dims), False
        xs, ys = np.asarray(lon.values, float), np.asarray(lat.values, float)
    else:
        spatial, xs, ys, reverse = _projected(data, array)
    if len(spatial) != 2:
        raise UnreadError("the places are no grid of rows and columns")
    relative = array.attrs.get("GRIB_uvRelativeToGrid")
    turn = None
    if (follows and relative is None) or (relative is not None and int(relative)):
        turn = axis_angle(xs, ys).ravel() + np.pi * reverse
    return spatial, np.stack([xs.ravel(), ys.ravel()], axis=1), turn


def _coordinate(data: xr.Dataset, array: xr.DataArray, unit: str) -> xr.Variable | None:
    """The latitude (``unit`` north) or longitude (east) of ``array``; None if it has none."""
    standard = {"north": "latitude", "east": "longitude"}[unit]
    named = str(array.attrs.get("coordinates", "")).split()
    found = []
    for name, axis in data.variables.items():
        units = str(axis.attrs.get("units", "")).lower()
        fits = units.startswith((f"degrees_{unit}", f"degree_{unit}")) or (
            axis.attrs.get("standard_name") == standard or str(name).lower() in (standard, standard[:3])
        )
        stated = axis.attrs.get("standard_name") in (None, standard)
        if fits and stated and axis.ndim and set(axis.dims) <= set(array.dims):
            found.append((name not in named, axis.ndim == 1 and axis.dims != (name,), str(name), axis))
    return min(found, key=lambda entry: entry[:3])[3] if found else None


def _projected(data: xr.Dataset, array: xr.DataArray) -> tuple[list[Any], FloatArray, FloatArray, bool]:
    """Dimensions, longitudes and latitudes (Y, X) [deg] of a grid with a projection, and if x decreases."""
    import pyproj

    mapping = data.variables.get(str(array.attrs.get("grid_mapping", "")).split(":")[0].strip())
    axes = {}
    for letter, names in (("y", ("projection_y_coordinate", "grid_latitude")),
                          ("x", ("projection_x_coordinate", "grid_longitude"))):  # fmt: skip
        for name in array.dims:
            if name in data.variables and data.variables[name].attrs.get("standard_name") in names:
                axes[letter] = data.variables[name]
    if mapping is None or len(axes) < 2:
        raise UnreadError("the places of the grid are stated in a way that the second reader does not know")
    crs = pyproj.CRS.from_cf({key: np.asarray(value).tolist() for key, value in mapping.attrs.items()})
    scale = [LENGTHS.get(str(axes[c].attrs.get("units", "")).lower(), 1.0) for c in "xy"]
    x, y = (np.asarray(axes[c].values, float) * s for c, s in zip("xy", scale, strict=True))
    change = pyproj.Transformer.from_crs(crs, crs.geodetic_crs if crs.is_projected else 4326, always_xy=True)
    xs, ys = change.transform(*np.meshgrid(x, y))
    return [axes["y"].dims[0], axes["x"].dims[0]], np.asarray(xs), np.asarray(ys), bool(x[-1] < x[0])
