"""Directions of the components in a NetCDF file: what its attributes and variables state, for one rule.

In this order: keys of GRIB that cfgrib wrote (``GRIB_uvRelativeToGrid``), standard and long names that
state east and north, the angle at each node (``COSALPHA`` and ``SINALPHA`` of WRF, the standard name
``angle_of_rotation_from_east_to_x``), the grid mapping, the projection of WRF, and axes that are parallels
and meridians.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from careful_io.messages import shown_text
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.grid_directions import WAY_OUT, twist_of_grib, twist_of_plane, twist_of_pole
from pareto_ltl_apps.formats.quantities import EARTH, GRID
from pareto_ltl_apps.formats.snapshots import Nodes

if TYPE_CHECKING:
    import pyproj
    import xarray as xr

ANGLE = "angle_of_rotation_from_east_to_x"
WRF_PLANES = {
    1: "+proj=lcc +lat_1={TRUELAT1} +lat_2={TRUELAT2} +lat_0={TRUELAT1} +lon_0={STAND_LON} +R=6370000",
    2: "+proj=stere +lat_0={pole} +lat_ts={TRUELAT1} +lon_0={STAND_LON} +R=6370000",
    3: "",  # Mercator: the axes are east and north
}  # by MAP_PROJ; 6, a rotated globe, needs COSALPHA and SINALPHA
WRF = "WRF"  # coordinate that holds the attributes of a file of WRF, see :func:`with_projection`


class GridMapping(NamedTuple):
    """A grid mapping: its coordinate system; latitude and longitude [deg] of a rotated north pole."""

    crs: pyproj.CRS
    pole: tuple[float, float] | None


def with_projection(data: xr.Dataset) -> xr.Dataset:
    """``data`` with the projection in the attributes of a file of WRF as a coordinate."""
    keys = ("MAP_PROJ", "TRUELAT1", "TRUELAT2", "STAND_LON", "CEN_LAT")
    known = {key: data.attrs[key] for key in keys if key in data.attrs}
    return data.assign_coords({WRF: ((), 0, known)}) if len(known) == len(keys) else data


def grid_mapping(file: Path, array: xr.DataArray) -> GridMapping | None:
    """The grid mapping of ``array``; None if it names none. DataError if it is not understood."""
    import pyproj

    name = text_of(array, "grid_mapping").split(":")[0].strip()
    mapping = array.coords.get(name)
    if mapping is None:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the string has no name of the datum: directions need none
            attributes = {key: np.asarray(value).tolist() for key, value in mapping.attrs.items()}
            crs = pyproj.CRS.from_cf(attributes)
            pole = None
            if attributes.get("grid_mapping_name") == "rotated_latitude_longitude":
                pole = (
                    float(attributes["grid_north_pole_latitude"]),
                    float(attributes["grid_north_pole_longitude"]),
                )
            if crs.is_projected:
                crs = pyproj.CRS.from_proj4(crs.to_proj4())
            return GridMapping(crs, pole)
    except (pyproj.exceptions.CRSError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise DataError(
            f"wind file {file}: the grid mapping {mapping.name} is not understood "
            f"({shown_text(' '.join(str(error).split()), 200)}); expected the attributes of CF: {WAY_OUT}"
        ) from None


def twist_of_array(
    file: Path,
    array: xr.DataArray,
    axes: str,
    mapping: GridMapping | None,
    nodes: Nodes,
    spatial: tuple[str, ...],
    aligned: bool,
) -> FloatArray | None:
    """Twist (N,) at ``nodes`` of the components; None if they are towards east and north.

    ``axes`` are those that names of the components state, ``aligned`` says that the rows and columns of the
    grid are parallels and meridians.

    Raises
    ------
    DataError
        If the file does not state the directions.
    """
    where = f"wind file {file}"
    relative = array.attrs.get("GRIB_uvRelativeToGrid")
    if relative is not None:
        return (
            twist_of_grib(where, lambda key: _grib_key(array, key), nodes.lonlat) if int(relative) else None
        )
    if axes == EARTH:
        return None
    if (angle := _angle(array, nodes, spatial)) is not None:
        return -angle
    if mapping is not None and mapping.pole is not None:
        return twist_of_pole(*mapping.pole, nodes.lonlat)
    if mapping is not None and mapping.crs.is_projected and not aligned:
        return twist_of_plane(mapping.crs.to_proj4(), nodes.lonlat)
    if (plane := _wrf_plane(array)) is not None:
        return twist_of_plane(plane, nodes.lonlat) if plane else None
    if aligned or (mapping is not None and mapping.crs.is_geographic):
        return None
    follows = "follows the axes of a grid" if axes == GRID else "is on a curvilinear grid"
    raise DataError(
        f"{where}: {array.name} {follows} whose directions the file does not state; expected a grid mapping, "
        f"the angle at each node, or names that state east and north: {WAY_OUT}"
    )


def text_of(array: xr.DataArray, attribute: str) -> str:
    """A text attribute; empty if there is none."""
    return str(array.attrs.get(attribute, ""))


def _grib_key(array: xr.DataArray, key: str) -> Any:
    return array.attrs.get(f"GRIB_{key}")


def _angle(array: xr.DataArray, nodes: Nodes, spatial: tuple[str, ...]) -> FloatArray | None:
    """Angle (N,) [rad] from east to the first axis of the grid, counter-clockwise; None if not stated."""
    coords = array.coords
    if "COSALPHA" in coords and "SINALPHA" in coords:
        cos, sin = (_at_nodes(coords[name], nodes, spatial) for name in ("COSALPHA", "SINALPHA"))
        return None if cos is None or sin is None else np.arctan2(sin, cos)
    for angle in coords.values():
        if angle.attrs.get("standard_name") == ANGLE:
            values = _at_nodes(angle, nodes, spatial)
            degrees = text_of(angle, "units").lower().startswith("deg")
            return np.deg2rad(values) if values is not None and degrees else values
    return None


def _at_nodes(array: xr.DataArray, nodes: Nodes, spatial: tuple[str, ...]) -> FloatArray | None:
    """Values of a coordinate of the grid at ``nodes``; of several times, the first. None on another grid."""
    if not set(spatial) <= set(array.dims):
        return None
    first = array.isel({name: 0 for name in array.dims if name not in spatial})
    found: FloatArray = first.transpose(*spatial).values.astype(float).reshape(-1)[nodes.kept]
    return found


def _wrf_plane(array: xr.DataArray) -> str | None:
    """PROJ string of the projection of WRF; "" for Mercator, None if there is none."""
    if WRF not in array.coords:
        return None
    attributes = {key: float(np.ravel(value)[0]) for key, value in array.coords[WRF].attrs.items()}
    plane = WRF_PLANES.get(int(attributes["MAP_PROJ"]))
    pole = 90.0 if attributes["CEN_LAT"] >= 0 else -90.0
    return None if plane is None else plane.format(pole=pole, **attributes)
