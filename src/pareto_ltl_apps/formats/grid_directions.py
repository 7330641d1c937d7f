"""The one rule for directions: the angle by which the components of a grid are turned to east and north.

It follows what the file states: that the components are towards east and north, the keys of GRIB, a
projection, a rotated pole, or the angle at each node. What is not stated is refused. A *twist* is the angle
from the direction of the second component (grid north) to true north, counter-clockwise [rad].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pareto_ltl.extend import Frame
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError

EARTH_AXES = ("regular_ll", "regular_gg", "reduced_ll", "reduced_gg", "mercator")  # of GRIB: east and north
ROTATED_AXES = ("rotated_ll", "rotated_gg", "reduced_rotated_gg")
PLANES = {  # of GRIB: projection of PROJ, with the keys of ecCodes; directions do not depend on the radius
    "lambert": "+proj=lcc +lat_1={Latin1InDegrees} +lat_2={Latin2InDegrees} +lat_0={LaDInDegrees} "
    "+lon_0={LoVInDegrees}",
    "polar_stereographic": "+proj=stere +lat_0={pole} +lat_ts={LaDInDegrees} "
    "+lon_0={orientationOfTheGridInDegrees}",
    "lambert_azimuthal_equal_area": "+proj=laea +lat_0={standardParallelInDegrees} "
    "+lon_0={centralLongitudeInDegrees}",
}
SPHERE = "+R=6371229 +units=m +no_defs"
WAY_OUT = (
    "turn the components to east and north and name them eastward and northward (the attribute standard_name "
    "of NetCDF, e.g. eastward_wind), or convert the file to a latitude-longitude grid"
)
Key = Callable[[str], Any]


def twist_of_plane(crs: str, lonlat: FloatArray) -> FloatArray:
    """Twist (N,) at ``lonlat`` (N, 2) [deg] of components along x and y of the projection ``crs``."""
    return Frame(crs).convergence(*lonlat.T)


def twist_of_pole(lat: float, lon: float, lonlat: FloatArray) -> FloatArray:
    """Twist (N,) at ``lonlat`` (N, 2) [deg] of a grid whose north pole is at ``lat``, ``lon`` [deg].

    The meridians of the grid are great circles through its pole: grid north is the azimuth of the pole.
    """
    import pyproj

    pole = np.broadcast_to([[lon], [lat]], (2, len(lonlat)))
    azimuth, _, _ = pyproj.Geod(ellps="sphere").inv(*lonlat.T, *pole)
    return np.asarray(np.deg2rad(azimuth), float)


def twist_of_grib(where: str, key: Key, lonlat: FloatArray) -> FloatArray | None:
    """Twist (N,) at ``lonlat`` (N, 2) [deg] by the keys of a GRIB message; None if there is none.

    ``key`` returns the value of a key of ecCodes, None if the message (or the NetCDF file that was made of
    it) does not have it.

    Raises
    ------
    DataError
        If the directions do not follow from the keys; ``where`` begins the message.
    """
    kind = str(key("gridType"))
    if not key("uvRelativeToGrid") or kind in EARTH_AXES:
        return None
    if kind in ROTATED_AXES:
        lat, lon = _numbers(
            where, kind, key, ("latitudeOfSouthernPoleInDegrees", "longitudeOfSouthernPoleInDegrees")
        )
        return twist_of_pole(-lat, lon - 180.0, lonlat)
    if kind not in PLANES:
        known = ", ".join((*PLANES, *ROTATED_AXES[:1]))
        raise DataError(
            f"{where}: winds follow a grid of type {kind}, which cannot be turned to the east; expected "
            f"{known} or a latitude-longitude grid: {WAY_OUT}"
        )
    names = [part.split("}")[0] for part in PLANES[kind].split("{")[1:]]
    stated = [name for name in names if name != "pole"]
    values = dict(zip(stated, _numbers(where, kind, key, stated), strict=True))
    values["pole"] = 90.0 if np.mean(lonlat[:, 1]) >= 0 else -90.0
    return twist_of_plane(f"{PLANES[kind].format(**values)} {SPHERE}", lonlat)


def _numbers(where: str, kind: str, key: Key, names: tuple[str, ...] | list[str]) -> list[float]:
    values = {name: key(name) for name in names}
    if missing := [name for name, value in values.items() if value is None]:
        raise DataError(
            f"{where}: winds follow a grid of type {kind}, and the file does not state {', '.join(missing)}; "
            f"{WAY_OUT}"
        )
    return [float(value) for value in values.values()]


def axes_are_east_and_north(lon: FloatArray, lat: FloatArray) -> bool:
    """Whether the rows of a grid are parallels and its columns meridians; ``lon``, ``lat`` (Y, X) [deg]."""
    with np.errstate(invalid="ignore"):
        level = np.nanmax(np.ptp(lat, axis=1), initial=0.0) < 1e-4
        turned = np.abs((lon - lon[:1] + 180.0) % 360.0 - 180.0)
    return bool(level and np.nanmax(turned, initial=0.0) < 1e-4)
