"""Winds and currents from NetCDF files with CF conventions, e.g. of THREDDS, reanalyses, ocean models.

The components are found by standard name, else by long name, else by variable name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_value
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.levels import DEPTH, HEIGHT, PRESSURE, Level, level_list, parse_level
from pareto_ltl.wind.readings import Readings, check_readings, iso
from pareto_ltl.wind.snapshots import Snapshot, latest_readings
from pareto_ltl.wind.sources.cf_file import CfFile, CfVariable, open_cf
from pareto_ltl.wind.sources.cf_grid import CfNodes, levels_of, member_dimension, nodes_of, times_of
from pareto_ltl.wind.sources.cf_units import speed_factor
from pareto_ltl.wind.sources.ground import LeftOut, left_out_notes, nodes_in_the_air
from pareto_ltl.world.projection import rotate_vectors


@dataclass(frozen=True, slots=True)
class Quantity:
    """Names by which the components of winds or of currents are found.

    Attributes
    ----------
    name : str
        Name of the quantity in messages.
    length : str
        Meaning of levels in metres: ``height`` or ``depth``.
    standard : dict
        Standard name: (component, whether it is along an axis of the grid and not towards east or north).
    described, named : tuple of str
        Patterns of long names and of variable names, for u and v.
    nearest : bool
        Whether a level near the wanted one may be used instead.
    """

    name: str
    length: str
    standard: dict[str, tuple[str, bool]]
    described: tuple[str, str]
    named: tuple[str, str]
    nearest: bool


WINDS = Quantity(
    "wind",
    HEIGHT,
    {
        **{"eastward_wind": ("u", False), "northward_wind": ("v", False)},
        **{"x_wind": ("u", True), "y_wind": ("v", True)},
        **{"grid_eastward_wind": ("u", True), "grid_northward_wind": ("v", True)},
    },
    (
        r"(\d+ ?m(etre|eter)?s? )?(u[- ]?(component of )?(the )?wind|(eastward|zonal) wind).*",
        r"(\d+ ?m(etre|eter)?s? )?(v[- ]?(component of )?(the )?wind|(northward|meridional) wind).*",
    ),
    (
        r"u|u-?\d+m?|\d+m?u|ugrd.*|uwnd.*|u-component_of_wind.*|uas",
        r"v|v-?\d+m?|\d+m?v|vgrd.*|vwnd.*|v-component_of_wind.*|vas",
    ),
    nearest=False,
)  # fmt: skip
CURRENTS = Quantity(
    "current",
    DEPTH,
    {
        **{"eastward_sea_water_velocity": ("u", False), "northward_sea_water_velocity": ("v", False)},
        "surface_eastward_sea_water_velocity": ("u", False),
        "surface_northward_sea_water_velocity": ("v", False),
        **{"sea_water_x_velocity": ("u", True), "sea_water_y_velocity": ("v", True)},
    },
    (r"(eastward|zonal) .*(velocity|current).*", r"(northward|meridional) .*(velocity|current).*"),
    (r"water_u|uo|ucur.*|u_current|u|u_velocity", r"water_v|vo|vcur.*|v_current|v|v_velocity"),
    nearest=True,
)
MEAN = 10  # added to the rank of means over time, so that values of an instant are preferred
DEPTH_TOLERANCE = (1.0, 0.1)  # [m], and as a share of the depth


@dataclass(frozen=True, slots=True)
class _Pair:
    """Both components at one level: variables, dimension and index of the level, and the level."""

    u: CfVariable
    v: CfVariable
    relative: bool
    dimension: str | None
    place: int
    level: Level


def read_netcdf_files(
    files: tuple[Path, ...],
    quantity: Quantity,
    level: str,
    max_speed: float,
    area: GeoBox | None = None,
) -> Readings:
    """The field at every time in ``files``; of several forecasts for one time, the latest."""
    return latest_readings(*netcdf_snapshots(files, quantity, level, max_speed, area))


def netcdf_snapshots(
    files: tuple[Path, ...],
    quantity: Quantity,
    level: str,
    max_speed: float,
    area: GeoBox | None = None,
) -> tuple[tuple[Snapshot, ...], tuple[Path, ...], tuple[str, ...]]:
    """Every field at ``level`` in ``files``, the files, and notes of quality control.

    Raises
    ------
    DataError
        If a file is damaged, lacks a component or the level, or has unknown units or an unknown calendar.
    """
    wanted = parse_level(level)
    if quantity.length == DEPTH:
        if wanted.kind == PRESSURE:
            raise DataError(f"wind.level={level} is a pressure; currents are at depths such as wind.level=0m")
        wanted = Level(DEPTH, wanted.value)
    snapshots: list[Snapshot] = []
    counts: list[LeftOut] = []
    notes: dict[str, None] = {}
    for path in files:
        with open_cf(path) as file:
            pair = _pair_at(file, quantity, wanted, notes)
            for snapshot, count in _fields(file, pair, max_speed, area):
                snapshots.append(snapshot)
                counts.append(count)
    return tuple(snapshots), files, (*notes, *left_out_notes(wanted, counts))


# --- which variables -------------------------------------------------------------------------


def _component(variable: CfVariable, quantity: Quantity) -> tuple[str, bool, int] | None:
    """Component, whether it is along the grid, and a rank of the match (0 is best); None for no match."""
    standard = variable.text("standard_name")
    if standard in quantity.standard:
        return *quantity.standard[standard], 0
    if standard:
        return None  # something else
    words = re.sub(r"[@(].*", "", variable.text("long_name").lower().replace("_", " ")).strip()
    if re.search(r"gust|stress|variance|error|storm|average|mean of", words):
        return None
    for rank, text, patterns in ((1, words, quantity.described), (2, variable.name.lower(), quantity.named)):
        for component, pattern in zip("uv", patterns, strict=True):
            if re.fullmatch(pattern, text):
                return component, False, rank
    return None


def _pair_at(file: CfFile, quantity: Quantity, wanted: Level, notes: dict[str, None]) -> _Pair:
    """The components at the wanted level; if there is none, a DataError lists the levels of the file."""
    found: dict[str, list[tuple[int, bool, CfVariable]]] = {"u": [], "v": []}
    for variable in file.variables.values():
        known = _component(variable, quantity) if variable.shape else None
        if known is not None:
            mean = MEAN * bool(re.search(r"time\s*:\s*mean", variable.text("cell_methods")))
            found[known[0]].append((known[2] + mean, known[1], variable))
    if not found["u"] and not found["v"]:
        there = ", ".join(sorted(file.variables)[:12]) or "nothing"
        raise DataError(
            f"wind file {file.path} holds no {quantity.name}; expected variables with the standard names "
            f"{' and '.join(list(quantity.standard)[:2])}, found {shown_value(there, 200)}"
        )
    pairs: list[tuple[float, int, _Pair]] = []
    levels: list[Level] = []
    for rank, relative, u in sorted(found["u"], key=lambda entry: (entry[0], entry[2].name)):
        v = _partner(file, u, [other for r, g, other in found["v"] if (r, g) == (rank, relative)])
        dimension, heights = levels_of(file, u, quantity.length)
        if not heights:
            pairs.append((np.inf, rank, _Pair(u, v, relative, None, 0, wanted)))
        for place, height in enumerate(heights):
            levels.append(height)
            if (gap := _level_gap(height, wanted, quantity.nearest)) is not None:
                pairs.append((gap, rank, _Pair(u, v, relative, dimension, place, height)))
    if not found["u"]:
        _partner(file, found["v"][0][2], [])
    if not pairs:
        raise DataError(
            f"wind file {file.path} holds no {quantity.name} {wanted.phrase}; it has {level_list(levels)}: "
            "set wind.level to one of them"
        )
    gap, rank, chosen = min(pairs, key=lambda entry: entry[:2])
    if np.isinf(gap):
        notes[f"{chosen.u.name} states no level and is taken to be {wanted.phrase}"] = None
    elif gap > 0 and quantity.nearest:
        notes[f"the level {chosen.level.text} is used for {wanted.text}"] = None
    if rank >= MEAN:
        notes[f"{chosen.u.name} holds means over time and not values of an instant (cell_methods)"] = None
    return chosen


def _level_gap(found: Level, wanted: Level, nearest: bool) -> float | None:
    """Difference of two levels [m] or [Pa]; None if one cannot be used instead of the other."""
    if found.kind != wanted.kind:
        return None
    gap = abs(found.value - wanted.value)
    most = max(DEPTH_TOLERANCE[0], DEPTH_TOLERANCE[1] * wanted.value) if nearest else 1e-3 * wanted.value
    return gap if gap <= most else None


def _partner(file: CfFile, u: CfVariable, others: list[CfVariable]) -> CfVariable:
    """The one of ``others`` on the grid of ``u`` whose name differs least; DataError if there is none."""
    fitting = [other for other in others if other.dimensions == u.dimensions and other.shape == u.shape]
    if not fitting:
        elsewhere = "; its counterpart is on another grid" if others else ""
        raise DataError(
            f"wind file {file.path} has {u.name} but no other component{elsewhere}; expected u and v"
        )
    return min(
        fitting, key=lambda other: (sum(a != b for a, b in zip(u.name, other.name, strict=False)), other.name)
    )


# --- values ----------------------------------------------------------------------------------


def _fields(
    file: CfFile, pair: _Pair, max_speed: float, area: GeoBox | None
) -> Iterator[tuple[Snapshot, LeftOut]]:
    u = pair.u
    clock, times, leads = times_of(file, u)
    crew = member_dimension(file, u)
    nodes = nodes_of(file, u, pair.relative, area)
    factors = [_speed_factor(file, variable) for variable in (u, pair.v)]
    for name, size in zip(u.dimensions, u.shape, strict=True):
        if name not in (*nodes.part, clock, crew, pair.dimension) and size != 1:
            raise DataError(
                f"wind file {file.path}: {u.name} has {size} values along {name}, which is no time, level, "
                "member or place; pick one and write the file again"
            )
    pressure = _surface_pressure(file, u, pair.level, (*nodes.part, *([clock] if clock else [])))
    members = range(u.shape[u.dimensions.index(crew)]) if crew else range(1)
    for k, (time, lead) in enumerate(zip(times, leads, strict=True)):
        below = None if pressure is None else _slab(file, pressure, nodes, {clock: k})
        for member in members:
            at = {clock: k, crew: member, pair.dimension: pair.place}
            parts = [_slab(file, v, nodes, at) * f for v, f in zip((u, pair.v), factors, strict=True)]
            winds = np.stack(parts, axis=1)
            here, count = nodes_in_the_air(pair.level, winds, below)
            winds = winds if nodes.twist is None else rotate_vectors(winds, -nodes.twist)
            points, winds = (nodes.lonlat, winds) if here.all() else (nodes.lonlat[here], winds[here])
            where = f"wind file {file.path}, {iso(float(time))}"
            check_readings(points, winds, True, max_speed, lambda _, where=where: where)  # type: ignore[misc]
            name = f"{member:02d}" if crew else ""
            yield (
                Snapshot(float(time), float(lead), points, winds, pair.level.text, (file.path,), name),
                count,
            )


def _slab(file: CfFile, variable: CfVariable, nodes: CfNodes, at: dict[str | None, int]) -> FloatArray:
    """Values (N,) of ``variable`` at the nodes, at the indices ``at`` of the other dimensions."""
    part = tuple(nodes.part.get(name, at.get(name, 0)) for name in variable.dimensions)
    found: FloatArray = file.read(variable, part).reshape(-1)[nodes.kept]
    return found


def _speed_factor(file: CfFile, variable: CfVariable) -> float:
    units = variable.text("units")
    factor = speed_factor(units)
    if factor is None:
        told = f"is in {shown_value(units)}" if units.strip() else "has no units"
        raise DataError(
            f"wind file {file.path}: {variable.name} {told}; expected m s-1, cm s-1, km h-1 or knots"
        )
    return factor


def _surface_pressure(
    file: CfFile, u: CfVariable, level: Level, dimensions: tuple[str, ...]
) -> CfVariable | None:
    """Surface pressure [Pa] on the same grid and times, for a pressure level; None if there is none."""
    if level.kind != PRESSURE:
        return None
    for variable in file.variables.values():
        named = variable.text("standard_name") == "surface_air_pressure"
        same = variable.dimensions == tuple(name for name in u.dimensions if name in dimensions)
        if named and same and variable.text("units").lower() in ("pa", "pascal"):
            return variable
    return None
