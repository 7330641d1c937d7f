"""Winds and currents: the names of their components in files, and pairs of components as vectors.

Files have u and v, or speed and direction (``pareto_ltl_apps.formats.flow_components``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from careful_io.faults import Faults
from careful_io.times import iso
from flight_quantities.levels import DEPTH, HEIGHT, PRESSURE, Level
from pareto_ltl.extend import NodeAir, Snapshot
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.levels import wind_level
from pareto_ltl_apps.formats.flow_components import FROM, SPEED, TEMPERATURE, TOWARDS, U, V, polar_winds
from pareto_ltl_apps.formats.snapshots import GridWind, Nodes

SURFACE_PRESSURE = "sp"
OF_AIR = {SURFACE_PRESSURE, TEMPERATURE}
COUNTERPARTS = {U: (V,), V: (U,), SPEED: (FROM, TOWARDS), FROM: (SPEED,), TOWARDS: (SPEED,)}
EARTH, GRID, UNSTATED = "earth", "grid", "unstated"  # what the components follow: east and north, or the axes
DEPTH_TOLERANCE = (1.0, 0.1)  # [m], and as a share of the depth


@dataclass(frozen=True, slots=True)
class Quantity:
    """Names by which the components of winds or of currents are identified.

    Attributes
    ----------
    name : str
        Name of the quantity in messages.
    source, grib_source : str
        The value of ``wind.source`` that reads it from NetCDF, and from GRIB.
    length : str
        Meaning of levels in metres: ``height`` or ``depth``.
    nearest : bool
        Whether a level near the wanted one may be used instead.
    standard : dict
        Component and axes by standard name.
    described, named : dict
        Patterns of long names and of variable names by component.
    numbers : dict
        Component by the number of GRIB: (discipline, category, number) of edition 2, (number,) of edition 1.
    """

    name: str
    source: str
    grib_source: str
    length: str
    nearest: bool
    standard: dict[str, tuple[str, str]]
    described: dict[str, str]
    named: dict[str, str]
    numbers: dict[tuple[int, ...], str]


def _pairs(*names: tuple[str, str, str]) -> dict[str, tuple[str, str]]:
    return {name: (part, axes) for u, v, axes in names for name, part in zip((u, v), (U, V), strict=True)}


AXES = {U: "(eastward|zonal)", V: "(northward|meridional)"}
WINDS = Quantity(
    "wind",
    "netcdf",
    "grib",
    HEIGHT,
    nearest=False,
    standard=_pairs(
        ("eastward_wind", "northward_wind", EARTH),
        ("x_wind", "y_wind", GRID),
        ("grid_eastward_wind", "grid_northward_wind", GRID),
    )
    | {
        "wind_speed": (SPEED, EARTH),
        "wind_from_direction": (FROM, EARTH),
        "wind_to_direction": (TOWARDS, EARTH),
    },
    described={
        **{
            c: rf"(\d+ ?m(etre|eter)?s? )?({c}[- ]?(component of )?(the )?wind|{axis} wind).*"
            rf"|.* (of )?{c}-wind.*|{c} at .*"
            for c, axis in AXES.items()
        },
        SPEED: r"(\d+ ?m(etre|eter)?s? )?wind speed.*",
        FROM: r"(\d+ ?m(etre|eter)?s? )?wind (from )?direction.*",
    },
    named={
        **{
            c: rf"{c}|{c}-?\d+m?|\d+m?{c}|{c}grd.*|{c}_?wnd.*|{c}[-_]component_of_wind.*|{c}as|wind_{c}.*"
            rf"|{c}_wind.*|{c}_\d+m"
            for c in (U, V)
        },
        SPEED: r"wind_?speed.*|w(ind_?)?spd_?(\d+m?)?|ws_?(\d+m?)?|\d*si|si\d*|sfcwind",
        FROM: r"wind_?(from_?)?dir(ection)?.*|w(ind_?)?dir_?(\d+m?)?|wd_?(\d+m?)?|\d+wdir",
    },
    numbers={
        (0, 2, 2): U, (0, 2, 3): V, (0, 2, 1): SPEED, (0, 2, 0): FROM,
        (33,): U, (34,): V, (32,): SPEED, (31,): FROM,
    },
)  # fmt: skip
CURRENTS = Quantity(
    "current",
    "currents",
    "currents",
    DEPTH,
    nearest=True,
    standard=_pairs(
        ("eastward_sea_water_velocity", "northward_sea_water_velocity", EARTH),
        ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity", EARTH),
        (
            "surface_geostrophic_eastward_sea_water_velocity",
            "surface_geostrophic_northward_sea_water_velocity",
            EARTH,
        ),
        ("sea_water_x_velocity", "sea_water_y_velocity", GRID),
    )
    | {
        "sea_water_speed": (SPEED, EARTH),
        "sea_water_velocity_to_direction": (TOWARDS, EARTH),
        "direction_of_sea_water_velocity": (TOWARDS, EARTH),  # its name until CF 1.6
        "sea_water_velocity_from_direction": (FROM, EARTH),
    },
    described={
        **{
            c: rf"(.* )?{axis} .*(velocity|current).*|{c}[- ]component of (ocean |sea )?current.*"
            for c, axis in AXES.items()
        },
        SPEED: r"(sea |ocean |surface )*current speed.*",
        TOWARDS: r"(sea |ocean |surface )*current direction.*(to|towards?).*",
    },
    named={
        **{
            c: rf"water_{c}|{c}o|{c}cur.*|{c}_current|{c}|{c}_velocity|{c}ogrd.*"
            rf"|{c}-component_of_current.*"
            for c in (U, V)
        },
        SPEED: r"spc.*|current_speed",
        TOWARDS: r"dirc.*|current_(to|towards)_direction",
    },
    numbers={
        (10, 1, 2): U, (10, 1, 3): V, (10, 1, 1): SPEED, (10, 1, 0): TOWARDS,
        (49,): U, (50,): V, (48,): SPEED, (47,): TOWARDS,
    },
)  # fmt: skip


def other_quantity(quantity: Quantity) -> Quantity:
    """Currents for winds, winds for currents."""
    return CURRENTS if quantity is WINDS else WINDS


def wanted_level(quantity: Quantity, level: str) -> Level:
    """The level of ``wind.level``: of currents, a length is a depth. DataError for a pressure of currents."""
    wanted = wind_level(level)
    if quantity.length != DEPTH:
        return wanted
    if wanted.kind == PRESSURE:
        raise DataError(f"wind.level={level} is a pressure; currents are at depths such as wind.level=0m")
    return Level(DEPTH, wanted.value)


def level_gap(found: Level, wanted: Level, nearest: bool) -> float | None:
    """Difference of two levels [m] or [Pa]; None if one cannot be used instead of the other."""
    if found.kind != wanted.kind:
        return None
    gap = abs(found.value - wanted.value)
    limit = max(DEPTH_TOLERANCE[0], DEPTH_TOLERANCE[1] * wanted.value) if nearest else 1e-3 * wanted.value
    return gap if gap <= limit else None


# --- pairs of components -----------------------------------------------------------------------


class Component(NamedTuple):
    """One component [m/s] or [deg], or of the air [Pa], [K], (N,); NaN where there is none.

    ``level`` is the level of a temperature.
    """

    values: FloatArray
    nodes: Nodes
    file: Path
    level: str = ""


Key = tuple[float, float | None, str]  # valid time [s since 1970], lead [s] or None, member
Fields = dict[Key, dict[str, Component]]


def winds_of(fields: Fields, level: Level) -> Iterator[GridWind]:
    """The vector field of every time, lead and member, in their order.

    Raises
    ------
    DataError
        If one lacks its counterpart, or both are on different grids.
    """
    keys = sorted(fields, key=lambda k: (k[0], -1.0 if k[1] is None else k[1], k[2]))
    faults = Faults("the wind")
    for key in keys:
        parts = fields[key].keys() - OF_AIR
        if parts and (wind := faults.tried(partial(_wind_of, key, fields[key], parts, level))) is not None:
            yield wind
    faults.refuse()


def _wind_of(key: Key, parts: dict[str, Component], there: set[str], level: Level) -> GridWind:
    time, lead, member = key
    direction = next((name for name in (FROM, TOWARDS) if name in there), "")
    if {U, V} <= there:
        one, two = parts[U], parts[V]
    elif SPEED in there and direction:
        one, two = parts[SPEED], parts[direction]
    else:
        raise _lacks_counterpart(time, parts, there, level)
    if one.nodes is not two.nodes and not np.array_equal(one.nodes.lonlat, two.nodes.lonlat):
        both = (
            f"wind files {one.file} and {two.file.name}" if one.file != two.file else f"wind file {one.file}"
        )
        raise DataError(f"{both}: u and v at {iso(time)} are on different grids; expected one grid")
    twist = one.nodes.twist if {U, V} <= there else None
    if {U, V} <= there:  # nodes outside the domain of the model are missing
        values = np.stack([one.values, two.values], axis=1)
    else:
        values = polar_winds(one.values, two.values, direction)
    files = tuple(dict.fromkeys((one.file, two.file)))
    pressure = parts.get(SURFACE_PRESSURE)
    ahead = np.nan if lead is None else lead
    snap = Snapshot(time, ahead, one.nodes.lonlat, values, level.text, files, member, air_of(parts))
    return GridWind(snap, twist, None if pressure is None else pressure.values)


def air_of(parts: dict[str, Component]) -> NodeAir | None:
    """The temperature in ``parts``, with the surface pressure if it is on the same nodes."""
    warmth, pressure = parts.get(TEMPERATURE), parts.get(SURFACE_PRESSURE)
    if warmth is None:
        return None
    points = warmth.nodes.lonlat
    known = pressure is not None and np.array_equal(pressure.nodes.lonlat, points)
    there = pressure.values if pressure is not None and known else np.full(len(points), np.nan)
    return NodeAir(points, warmth.values, warmth.level, there)


def _lacks_counterpart(time: float, parts: dict[str, Component], there: set[str], level: Level) -> DataError:
    name = min(there)
    if name in (U, V):
        lacks = f"has no {COUNTERPARTS[name][0]} component {level.phrase}; expected u and v"
    else:
        lacks = f"has the {name} {level.phrase} alone; expected speed and direction, or u and v"
    return DataError(
        f"wind file {parts[name].file}: {iso(time)} {lacks} (is the file truncated, or the other component "
        "in another file? then let wind.path name the folder of both)"
    )
