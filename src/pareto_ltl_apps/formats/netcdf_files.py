"""Winds and currents from NetCDF files with CF conventions, e.g. of THREDDS, reanalyses, ocean models.

The components are identified by standard name, else by long name, else by variable name.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from careful_io.faults import Faults
from careful_io.messages import shown_value
from careful_io.times import iso
from flight_quantities.levels import DEPTH, PRESSURE, Level, level_list
from pareto_ltl.extend import GeoBox
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.extras import EXTRAS
from pareto_ltl.support.file_formats import HDF5, format_of, wind_file
from pareto_ltl_apps.formats.cf_air import AirArray, surface_pressure_of, temperature_of
from pareto_ltl_apps.formats.cf_directions import with_projection
from pareto_ltl_apps.formats.cf_grid import levels_of, member_dimension, nodes_of, text
from pareto_ltl_apps.formats.clocks import clock_of, with_text_clocks
from pareto_ltl_apps.formats.flow_components import FROM, SPEED, TEMPERATURE, TOWARDS, U, V
from pareto_ltl_apps.formats.quantities import (
    COUNTERPARTS,
    CURRENTS,
    EARTH,
    SURFACE_PRESSURE,
    UNSTATED,
    WINDS,
    Component,
    Fields,
    Quantity,
    level_gap,
    other_quantity,
    wanted_level,
    winds_of,
)
from pareto_ltl_apps.formats.snapshots import GridWind, Snapshots, earth_relative, same_values
from pareto_ltl_apps.formats.speed_units import speed_factor

if TYPE_CHECKING:
    import xarray as xr


UNKNOWN_NAMES = ("", "unknown", "undefined", "none", "null", "-", "~")  # cfgrib writes the first of them
FREE_VALUES = 2**24  # number of values that a variable may have in a file of any size
MAX_VALUES_A_BYTE = 8  # further values per byte of the file; a compressed field of zeros has a thousand
MEAN = 10  # added to the rank of means over time, so that values of an instant are preferred
POLAR_PARTS = ("speed", "direction")
POLAR = 5  # added to the rank of speed and direction, so that u and v are preferred
OTHER_WORDS = "gust|stress|variance|error|storm|average|mean of|deviation|std_?dev|spread|percentile|probab"
EXPVER = "expver"  # dimension of ERA5 files with final and preliminary data
DEGREES = dict.fromkeys(
    ("degree", "degrees", "deg", "degree_true", "degrees_true", "degreet", "degt", "degree_(true)", "°"), 1.0
) | dict.fromkeys(("radian", "radians", "rad"), 180.0 / np.pi)


class _Kind(NamedTuple):
    """How a variable matches: its component, rank (0 is best), and the axes that the component follows."""

    component: str
    rank: int
    axes: str


class _Part(NamedTuple):
    """One component at one level: dimension of the levels, index of the level there, and the level."""

    array: xr.DataArray
    kind: _Kind
    dimension: str | None
    place: int
    level: Level
    stated: bool = True  # by the file


def netcdf_snapshots(
    files: tuple[Path, ...],
    quantity: Quantity,
    level: str,
    max_speed: float,
    area: GeoBox | None = None,
) -> Snapshots:
    """Every field at ``level`` in ``files``, with notes of quality control.

    The components may be in two files: ``uwnd.2018.nc`` and ``vwnd.2018.nc``.

    Raises
    ------
    DataError
        If a file is damaged, lacks a component or the level, or has unknown units or an unknown calendar.
    """
    wanted = wanted_level(quantity, level)
    notes: dict[str, None] = {}

    def found() -> Iterator[GridWind]:
        apart: Fields = {}  # of files that have one component
        faults = Faults.of_files("wind file", files)
        for path in files:
            with faults.noted(), _open_dataset(path) as data:
                parts = _parts_at(path, _components(path, data, quantity), quantity, wanted)
                notes.update(dict.fromkeys(_part_notes(parts[0], wanted)))
                if len(parts) == 1:
                    _refuse_alone(files, path, parts[0])
                for fields in _fields(path, data, parts, area, notes):
                    if len(parts) == 2:
                        yield from winds_of(fields, parts[0].level)
                    else:
                        _keep_apart(apart, fields)
        faults.refuse()
        yield from winds_of(apart, wanted)

    return earth_relative(_with_values(found(), notes), files, wanted, max_speed, notes)


def _refuse_alone(files: tuple[Path, ...], path: Path, part: _Part) -> None:
    """A DataError if the counterpart of ``part`` cannot be in another file."""
    if len(files) == 1:
        there, expected = (
            part.array.name,
            " and ".join((U, V) if part.kind.component in (U, V) else POLAR_PARTS),
        )
        raise DataError(
            f"wind file {path} has {there} but no other component; expected {expected}: if the other "
            f"one is in a file beside it, read both with wind.path={path.parent}"
        )


def _keep_apart(apart: Fields, fields: Fields) -> None:
    for key, components in fields.items():
        there = apart.setdefault(key, {})
        for name, component in components.items():
            if name in there and not same_values(there[name].values, component.values):
                raise DataError(
                    f"wind files {there[name].file.name} and {component.file.name} both hold {name} at "
                    f"{iso(key[0])} with the same lead; keep one of them"
                )
            there.setdefault(name, component)


def _with_values(found: Iterator[GridWind], notes: dict[str, None]) -> list[GridWind]:
    """The fields that have values, all if none has; missing steps of a run are left out."""
    winds = list(found)
    kept = [wind for wind in winds if np.isfinite(wind.snap.winds).all(axis=1).any()] or winds
    if len(kept) < len(winds):
        notes[f"{len(winds) - len(kept)} of {len(winds)} fields have no values and are left out"] = None
    return kept


@contextmanager
def _open_dataset(path: Path) -> Iterator[xr.Dataset]:
    """In the block, the open file; errors of the libraries become a DataError in one line."""
    EXTRAS.require("netcdf", f"reading NetCDF ({path})")
    import cf_xarray  # noqa: F401 - the accessor ``cf`` of coordinates
    import xarray as xr

    from careful_io.netcdf4 import refuse_other_files

    options: dict[str, Any] = {"decode_times": False, "decode_coords": False, "concat_characters": False}
    with (
        wind_file(path, "NetCDF") as head,
        warnings.catch_warnings(action="ignore"),  # of damaged attributes
    ):
        if format_of(head) is None:
            raise DataError(f"wind file {path} is not NetCDF; expected NetCDF-4 or the classic format")
        if head[:8] == HDF5:
            refuse_other_files(path)
            options |= {"engine": "h5netcdf", "phony_dims": "access"}
        else:
            options |= {"engine": "scipy"}
        with xr.open_dataset(path, create_default_indexes=False, cache=False, **options) as data:
            yield with_projection(with_text_clocks(data))


# --- which variables -------------------------------------------------------------------------


def _kind(array: xr.DataArray, quantity: Quantity) -> _Kind | None:
    """The component that ``array`` is, by standard name, else by long name, else by name."""
    mean = MEAN * bool(re.search(r"time\s*:\s*mean", text(array, "cell_methods")))
    standard = text(array, "standard_name").strip()
    if standard.lower() not in UNKNOWN_NAMES:
        component, axes = quantity.standard.get(standard, (None, UNSTATED))
        return None if component is None else _Kind(component, mean + POLAR * (component not in (U, V)), axes)
    words = text(array, "long_name") or text(array, "description")
    words = re.sub(r"[@(].*", "", words.lower().replace("_", " ")).strip()
    name = str(array.name).lower()
    if re.search(OTHER_WORDS, f"{words} {name}"):
        return None
    for rank, (reported, patterns) in enumerate(((words, quantity.described), (name, quantity.named)), 1):
        for component, pattern in patterns.items():
            if re.fullmatch(pattern, reported):
                stated = re.search("eastward|northward|zonal|meridional|earth[ -]rotated", f"{words} {name}")
                polar = component not in (U, V)
                return _Kind(component, rank + mean + POLAR * polar, EARTH if stated or polar else UNSTATED)
    return None


def quantities_in(path: Path) -> dict[str, bool]:
    """Whether a NetCDF file has several members of each quantity in it, ``wind`` or ``current``."""
    with _open_dataset(path) as data:
        there = {}
        for quantity in (WINDS, CURRENTS):
            arrays = [array for array in data.values() if array.shape and _kind(array, quantity)]
            if arrays:
                crews = [array.sizes[crew] for array in arrays if (crew := member_dimension(array))]
                there[quantity.name] = any(size > 1 for size in crews)
        return there


def netcdf_levels(files: tuple[Path, ...], quantity: Quantity) -> set[Level]:
    """The levels at which NetCDF ``files`` have ``quantity``; DataError as :func:`netcdf_snapshots`."""
    there: set[Level] = set()
    for path in files:
        with _open_dataset(path) as data:
            for _, array in _components(path, data, quantity):
                there.update(levels_of(array, quantity.length)[1])
    return there


def _advice(data: xr.Dataset, quantity: Quantity) -> str:
    """Advice for a file of currents that is read as winds, or of winds that is read as currents."""
    other = other_quantity(quantity)
    there = any(array.shape and _kind(array, other) for array in data.values())
    return f"; it holds a {other.name}: set wind={other.source}" if there else ""


def _components(path: Path, data: xr.Dataset, quantity: Quantity) -> list[tuple[_Kind, xr.DataArray]]:
    """The components in the file, the best matches first; all other variables are their coordinates."""
    known = {
        name: kind
        for name, array in data.items()
        if array.shape and (kind := _kind(array, quantity)) is not None
    }
    if not known:
        there = ", ".join(sorted(map(str, data.variables))[:12]) or "nothing"
        names = list(quantity.standard)
        raise DataError(
            f"wind file {path} holds no {quantity.name}; expected variables with the standard names "
            f"{names[0]} and {names[1]}, found {shown_value(there, 200)}{_advice(data, quantity)}"
        )
    budget = FREE_VALUES + MAX_VALUES_A_BYTE * path.stat().st_size
    data = data.set_coords([name for name in data if name not in known])
    found = []
    for name, kind in sorted(known.items(), key=lambda item: (item[1].rank, str(item[0]))):
        array = data[name]
        if array.dtype.kind not in "iuf":
            raise ValueError(f"{name} holds {array.dtype}; expected numbers")
        if array.size > budget:  # no coordinate of the array is larger
            raise ValueError(f"{name} claims far more values than a file of its size can hold")
        found.append((kind, array))
    return found


def _parts_at(
    path: Path, found: list[tuple[_Kind, xr.DataArray]], quantity: Quantity, wanted: Level
) -> tuple[_Part, ...]:
    """The components at the wanted level, two or, where the file has no counterpart, one.

    DataError with the levels of the file if there is none at this level.
    """
    pairs: list[tuple[float, tuple[_Part, ...]]] = []
    levels: list[Level] = []
    for kind, array in found:
        partner = _partner(path, kind, array, found)
        dimension, heights = levels_of(array, quantity.length)
        choices = [(np.inf, _Part(array, kind, None, 0, wanted, stated=False))] if not heights else []
        levels += heights
        for place, height in enumerate(heights):
            if (gap := level_gap(height, wanted, quantity.nearest)) is not None:
                choices.append((gap, _Part(array, kind, dimension, place, height)))
        for gap, part in choices:
            other = () if partner is None else (part._replace(kind=partner[0], array=partner[1]),)
            pairs.append((gap, (part, *other)))
    if not pairs:
        raise DataError(
            f"wind file {path} holds no {quantity.name} {wanted.phrase}; it has {level_list(levels)}: "
            "set wind.level to one of them"
        )
    order = (U, SPEED, V, FROM, TOWARDS)  # u and speed have levels of both components
    return min(
        pairs,
        key=lambda entry: (
            -len(entry[1]), entry[0], entry[1][0].kind.rank, order.index(entry[1][0].kind.component)
        ),
    )[1]  # fmt: skip


def _part_notes(part: _Part, wanted: Level) -> Iterator[str]:
    """Remarks on the choice of a variable for the ``wanted`` level."""
    if not part.stated:
        yield f"{part.array.name} states no level and is taken to be {wanted.phrase}"
    elif part.level.text != wanted.text:
        yield f"the level {part.level.text} is used for {wanted.text}"
    if part.kind.rank >= MEAN:
        yield f"{part.array.name} holds means over time and not values of an instant (cell_methods)"


def _partner(
    path: Path, kind: _Kind, array: xr.DataArray, found: list[tuple[_Kind, xr.DataArray]]
) -> tuple[_Kind, xr.DataArray] | None:
    """The counterpart on the grid of ``array`` whose name differs least; None if there is none."""
    wanted = COUNTERPARTS[kind.component]
    means = kind.rank >= MEAN
    others = [pair for pair in found if pair[0].component in wanted and (pair[0].rank >= MEAN) == means]
    fitting = [pair for pair in others if pair[1].dims == array.dims and pair[1].shape == array.shape]
    if others and not fitting:
        raise DataError(
            f"wind file {path} has {array.name} but no other component; its counterpart is on another grid; "
            "expected u and v on one grid"
        )

    def unlike(pair: tuple[_Kind, xr.DataArray]) -> tuple[bool, int, int]:
        letters = zip(str(array.name), str(pair[1].name), strict=False)
        rank = abs(pair[0].rank - kind.rank)
        return pair[0].axes != kind.axes, rank, sum(a != b for a, b in letters)

    return min(fitting, key=unlike, default=None)


# --- values ----------------------------------------------------------------------------------


def _fields(
    path: Path, data: xr.Dataset, parts: tuple[_Part, ...], area: GeoBox | None, notes: dict[str, None]
) -> Iterator[Fields]:
    """The components of every time and member, one time and member each."""
    first = parts[0].array
    faults = Faults(f"wind file {path}")
    clock = faults.tried(lambda: clock_of(path, first))
    grid = faults.tried(lambda: nodes_of(path, first, parts[0].kind.axes, area))
    factors = [factor for _, factor in faults.each(parts, lambda part: _factor(path, part))]
    faults.refuse()
    assert clock is not None
    assert grid is not None
    notes.update(dict.fromkeys(clock.notes))
    crew = member_dimension(first)
    spatial, nodes = grid
    for name, size in first.sizes.items():
        if name not in (*spatial, *clock.dims, crew, parts[0].dimension, EXPVER) and size != 1:
            raise DataError(
                f"wind file {path}: {first.name} has {size} values along {name}, which is not a time, level, "
                "member or place; pick one and write the file again"
            )
    warmth = None
    if parts[0].level.kind != DEPTH:
        warmth = temperature_of(data, parts[0].level, spatial, {*clock.dims, crew, EXPVER}, notes)
    pressure = _surface_pressure(data, parts[0], {*spatial, *clock.dims}, wanted=warmth is not None)
    rows = np.unravel_index(nodes.kept, [first.sizes[name] for name in spatial])
    box = {name: slice(int(r.min()), int(r.max()) + 1) for name, r in zip(spatial, rows, strict=True)}
    kept = np.ravel_multi_index([r - r.min() for r in rows], [int(np.ptp(r)) + 1 for r in rows])
    for place in np.ndindex(clock.times.shape):
        moment: dict[str | None, int] = dict(zip(clock.dims, place, strict=True))
        ground = None if pressure is None else _air_values(pressure, box, moment)[kept]
        lead = float(clock.leads[place])
        for member in range(first.sizes[crew] if crew else 1):
            at = moment | {crew: member, parts[0].dimension: parts[0].place}
            found = {
                part.kind.component: Component(_values(part.array, box, at)[kept] * factor, nodes, path)
                for part, factor in zip(parts, factors, strict=True)
            }
            if ground is not None:
                found[SURFACE_PRESSURE] = Component(ground, nodes, path)
            if warmth is not None:
                there = moment | {crew: member, warmth.dimension: warmth.place}
                values = _air_values(warmth, box, there)[kept]
                found[TEMPERATURE] = Component(values, nodes, path, warmth.level)
            name = f"{member:02d}" if crew else ""
            yield {(float(clock.times[place]), None if np.isnan(lead) else lead, name): found}


def _values(array: xr.DataArray, box: dict[str, slice], at: dict[str | None, int]) -> FloatArray:
    """The values in ``box`` at the indices ``at``, flattened; NaN for missing values and those not valid.

    Along ``expver`` of ERA5 the first one that has a value counts: final data before preliminary ones.
    """
    part = array.isel(box | {name: k for name, k in at.items() if name}, missing_dims="ignore")
    if EXPVER in part.dims:
        part = part.transpose(EXPVER, ...)
    versions = part.values.astype(float).reshape(part.sizes.get(EXPVER, 1), -1)
    found: FloatArray = versions[0]
    for later in versions[1:]:
        found = np.where(np.isfinite(found), found, later)
    limits = (array.attrs.get("valid_min", -np.inf), array.attrs.get("valid_max", np.inf))
    low, high = np.sort(np.ravel(array.attrs.get("valid_range", limits)).astype(float))  # of packed values
    if np.isfinite([low, high]).any():
        scale, offset = (array.encoding.get(name, n) for name, n in (("scale_factor", 1), ("add_offset", 0)))
        slack = 0.0 if (scale, offset) == (1, 0) else 0.5  # packed values are whole numbers
        packed = (found - offset) / scale
        found[(packed < low - slack) | (packed > high + slack)] = np.nan
    return found


def _air_values(air: AirArray, box: dict[str, slice], at: dict[str | None, int]) -> FloatArray:
    """Like :func:`_values`, in [K] or [Pa]."""
    return _values(air.array, box, at) * air.factor + air.offset


def _factor(path: Path, part: _Part) -> float:
    """Metres per second, or degrees, in one unit of a component."""
    units = text(part.array, "units").strip()
    angle = part.kind.component in (FROM, TOWARDS)
    factor = DEGREES.get(units.lower().replace(" ", "_")) if angle else speed_factor(units)
    if factor is None:
        given = f"is in {shown_value(units)}" if units else "has no units"
        expected = "degrees" if angle else "m s-1, cm s-1, km h-1 or knots"
        raise DataError(
            f"wind file {path}: {part.array.name} {given}; expected {expected} in its attribute units"
        )
    return factor


def _surface_pressure(
    data: xr.Dataset, part: _Part, dimensions: set[str | None], *, wanted: bool
) -> AirArray | None:
    """Surface pressure on the same grid and times, for a pressure level, or if it is ``wanted``."""
    dims = tuple(str(name) for name in part.array.dims if name in dimensions)
    if part.level.kind != PRESSURE:
        return surface_pressure_of(data, dims) if wanted else None
    for name in part.array.cf.standard_names.get("surface_air_pressure", ()):
        array: xr.DataArray = part.array.coords[name]
        if array.dims == dims and text(array, "units").lower() in ("pa", "pascal"):
            return AirArray(array, "0m")
    return None
