"""Winds and currents from NetCDF files with CF conventions, e.g. of THREDDS, reanalyses, ocean models.

The components are identified by standard name, else by long name, else by variable name.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.extras import require_extra
from pareto_ltl.support.messages import shown_value
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.levels import DEPTH, HEIGHT, PRESSURE, Level, level_list, parse_level
from pareto_ltl.wind.readings import KNOT
from pareto_ltl.wind.snapshots import GridWind, Snapshot, Snapshots, earth_relative
from pareto_ltl.wind.sources.cf_grid import levels_of, member_dimension, nodes_of, text, times_of
from pareto_ltl.wind.sources.magic import HDF5, format_of, wind_file

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, slots=True)
class Quantity:
    """Names by which the components of winds or of currents are identified.

    Attributes
    ----------
    name : str
        Name of the quantity in messages.
    length : str
        Meaning of levels in metres: ``height`` or ``depth``.
    standard : tuple
        Standard names of both components, and whether they are along the axes of the grid and not towards
        east and north.
    described, named : str
        Patterns of long names and of variable names; ``{0}`` is u or v, ``{1}`` a word for its direction.
    nearest : bool
        Whether a level near the wanted one may be used instead.
    """

    name: str
    length: str
    standard: tuple[tuple[str, str, bool], ...]
    described: str
    named: str
    nearest: bool


WINDS = Quantity(
    "wind",
    HEIGHT,
    (
        ("eastward_wind", "northward_wind", False),
        ("x_wind", "y_wind", True),
        ("grid_eastward_wind", "grid_northward_wind", True),
    ),
    r"(\d+ ?m(etre|eter)?s? )?({0}[- ]?(component of )?(the )?wind|({1}) wind).*",
    r"{0}|{0}-?\d+m?|\d+m?{0}|{0}grd.*|{0}wnd.*|{0}-component_of_wind.*|{0}as",
    nearest=False,
)
CURRENTS = Quantity(
    "current",
    DEPTH,
    (
        ("eastward_sea_water_velocity", "northward_sea_water_velocity", False),
        ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity", False),
        ("sea_water_x_velocity", "sea_water_y_velocity", True),
    ),
    r"({1}) .*(velocity|current).*",
    r"water_{0}|{0}o|{0}cur.*|{0}_current|{0}|{0}_velocity",
    nearest=True,
)
DIRECTIONS = {"u": "eastward|zonal", "v": "northward|meridional"}
SPEEDS = {
    **dict.fromkeys(("ms-1", "m/s", "m/sec", "meters/second", "meter/second", "metersecond-1", "mps"), 1.0),
    **dict.fromkeys(("meterspersecond", "meters-1", "metres-1", "msec-1"), 1.0),
    **dict.fromkeys(("knot", "knots", "kt", "kts", "kn"), KNOT),
    **dict.fromkeys(("cms-1", "cm/s", "cm/sec", "centimeter/second"), 0.01),
    **dict.fromkeys(("km/h", "kmh-1", "km/hr", "kmhr-1"), 1 / 3.6),
}  # [m/s], by units without spaces, dots and signs of powers
FREE_VALUES = 2**24  # number of values that a variable may have in a file of any size
MAX_VALUES_A_BYTE = 8  # further values per byte of the file; a compressed field of zeros has a thousand
MEAN = 10  # added to the rank of means over time, so that values of an instant are preferred
DEPTH_TOLERANCE = (1.0, 0.1)  # [m], and as a share of the depth


class _Kind(NamedTuple):
    """How a variable matches: rank (0 is best), and whether it is along the axes of the grid."""

    component: str  # u or v
    rank: int
    relative: bool


class _Pair(NamedTuple):
    """Both components at one level: dimension of the levels, index of the level there, and the level."""

    u: xr.DataArray
    v: xr.DataArray
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
    notes: dict[str, None] = {}

    def found() -> Iterator[GridWind]:
        for path in files:
            with _open_dataset(path) as data:
                pair = _pair_at(path, _components(path, data, quantity), quantity, wanted)
                notes.update(dict.fromkeys(_pair_notes(pair, wanted)))
                yield from _winds(path, pair, area)

    return earth_relative(found(), files, wanted, max_speed, notes)


@contextmanager
def _open_dataset(path: Path) -> Iterator[xr.Dataset]:
    """In the block, the open file; errors of the libraries become a DataError in one line."""
    require_extra("netcdf", f"reading NetCDF ({path})")
    import cf_xarray  # noqa: F401 - the accessor ``cf`` of coordinates
    import xarray as xr

    import pareto_ltl.support.netcdf4  # noqa: F401 - damaged files print nothing

    options: dict[str, Any] = {"decode_times": False, "decode_coords": False, "concat_characters": False}
    with (
        wind_file(path, "NetCDF") as head,
        warnings.catch_warnings(action="ignore"),  # of damaged attributes
    ):
        if format_of(head) is None:
            raise DataError(f"wind file {path} is not NetCDF; expected NetCDF-4 or the classic format")
        options |= {"engine": "h5netcdf", "phony_dims": "access"} if head[:8] == HDF5 else {"engine": "scipy"}
        with xr.open_dataset(path, create_default_indexes=False, cache=False, **options) as data:
            yield data


# --- which variables -------------------------------------------------------------------------


def _kind(array: xr.DataArray, quantity: Quantity) -> _Kind | None:
    """The component that ``array`` is, by standard name, else by long name, else by name."""
    mean = MEAN * bool(re.search(r"time\s*:\s*mean", text(array, "cell_methods")))
    if standard := text(array, "standard_name"):
        for *names, relative in quantity.standard:
            if standard in names:
                return _Kind("uv"[names.index(standard)], mean, relative)
        return None
    words = re.sub(r"[@(].*", "", text(array, "long_name").lower().replace("_", " ")).strip()
    if re.search(r"gust|stress|variance|error|storm|average|mean of", words):
        return None
    ways = ((words, quantity.described), (str(array.name).lower(), quantity.named))
    for rank, (name, pattern) in enumerate(ways, 1):
        for component, direction in DIRECTIONS.items():
            if re.fullmatch(pattern.format(component, direction), name):
                return _Kind(component, rank + mean, False)
    return None


def _other_quantity(data: xr.Dataset, quantity: Quantity) -> str:
    """Advice for a file of currents that is read as winds, or of winds that is read as currents."""
    other, setting = (CURRENTS, "wind=currents") if quantity is WINDS else (WINDS, "wind=netcdf")
    there = any(array.shape and _kind(array, other) for array in data.values())
    return f"; it holds a {other.name}: set {setting}" if there else ""


def _components(path: Path, data: xr.Dataset, quantity: Quantity) -> list[tuple[_Kind, xr.DataArray]]:
    """The u and v in the file, the best matches first; all other variables are their coordinates."""
    known = {
        name: kind
        for name, array in data.items()
        if array.shape and (kind := _kind(array, quantity)) is not None
    }
    if not known:
        there = ", ".join(sorted(map(str, data.variables))[:12]) or "nothing"
        raise DataError(
            f"wind file {path} holds no {quantity.name}; expected variables with the standard names "
            f"{' and '.join(quantity.standard[0][:2])}, found {shown_value(there, 200)}"
            f"{_other_quantity(data, quantity)}"
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


def _pair_at(path: Path, found: list[tuple[_Kind, xr.DataArray]], quantity: Quantity, wanted: Level) -> _Pair:
    """The components at the wanted level; if there is none, a DataError lists the levels of the file."""
    if all(kind.component == "v" for kind, _ in found):
        raise _unpaired(path, found[0][1])
    pairs: list[tuple[float, _Pair]] = []
    levels: list[Level] = []
    for kind, u in found:
        if kind.component == "v":
            continue
        v = _partner(path, u, [other for same, other in found if same == kind._replace(component="v")])
        dimension, heights = levels_of(u, quantity.length)
        if not heights:
            pairs.append((np.inf, _Pair(u, v, kind, None, 0, wanted, stated=False)))
        levels += heights
        for place, height in enumerate(heights):
            if (gap := _level_gap(height, wanted, quantity.nearest)) is not None:
                pairs.append((gap, _Pair(u, v, kind, dimension, place, height)))
    if not pairs:
        raise DataError(
            f"wind file {path} holds no {quantity.name} {wanted.phrase}; it has {level_list(levels)}: "
            "set wind.level to one of them"
        )
    return min(pairs, key=lambda entry: (entry[0], entry[1].kind.rank))[1]


def _pair_notes(pair: _Pair, wanted: Level) -> Iterator[str]:
    """Remarks on the choice of a pair for the ``wanted`` level."""
    if not pair.stated:
        yield f"{pair.u.name} states no level and is taken to be {wanted.phrase}"
    elif pair.level.text != wanted.text:
        yield f"the level {pair.level.text} is used for {wanted.text}"
    if pair.kind.rank >= MEAN:
        yield f"{pair.u.name} holds means over time and not values of an instant (cell_methods)"


def _level_gap(found: Level, wanted: Level, nearest: bool) -> float | None:
    """Difference of two levels [m] or [Pa]; None if one cannot be used instead of the other."""
    if found.kind != wanted.kind:
        return None
    gap = abs(found.value - wanted.value)
    limit = max(DEPTH_TOLERANCE[0], DEPTH_TOLERANCE[1] * wanted.value) if nearest else 1e-3 * wanted.value
    return gap if gap <= limit else None


def _partner(path: Path, u: xr.DataArray, others: list[xr.DataArray]) -> xr.DataArray:
    """The one of ``others`` on the grid of ``u`` whose name differs least; DataError if there is none."""
    fitting = [other for other in others if other.dims == u.dims and other.shape == u.shape]
    if not fitting:
        raise _unpaired(path, u, "; its counterpart is on another grid" if others else "")
    return min(fitting, key=lambda v: sum(a != b for a, b in zip(str(u.name), str(v.name), strict=False)))


def _unpaired(path: Path, array: xr.DataArray, reason: str = "") -> DataError:
    return DataError(f"wind file {path} has {array.name} but no other component{reason}; expected u and v")


# --- values ----------------------------------------------------------------------------------


def _winds(path: Path, pair: _Pair, area: GeoBox | None) -> Iterator[GridWind]:
    u = pair.u
    clock, times, leads = times_of(path, u)
    crew = member_dimension(u)
    spatial, nodes = nodes_of(path, u, pair.kind.relative, area)
    factors = [_speed_factor(path, array) for array in (u, pair.v)]
    for name, size in u.sizes.items():
        if name not in (*spatial, clock, crew, pair.dimension) and size != 1:
            raise DataError(
                f"wind file {path}: {u.name} has {size} values along {name}, which is not a time, level, "
                "member or place; pick one and write the file again"
            )
    pressure = _surface_pressure(pair, {*spatial, clock})
    rows = np.unravel_index(nodes.kept, [u.sizes[name] for name in spatial])
    box = {name: slice(int(r.min()), int(r.max()) + 1) for name, r in zip(spatial, rows, strict=True)}
    kept = np.ravel_multi_index([r - r.min() for r in rows], [int(np.ptp(r)) + 1 for r in rows])
    for k, (time, lead) in enumerate(zip(times, leads, strict=True)):
        ground = None if pressure is None else _values(pressure, box, {clock: k})[kept]
        for member in range(u.sizes[crew] if crew else 1):
            at = {clock: k, crew: member, pair.dimension: pair.place}
            winds = [_values(array, box, at)[kept] * f for array, f in zip((u, pair.v), factors, strict=True)]
            name, both = f"{member:02d}" if crew else "", np.stack(winds, axis=1)
            snap = Snapshot(float(time), float(lead), nodes.lonlat, both, pair.level.text, (path,), name)
            yield GridWind(snap, nodes.twist, ground)


def _values(array: xr.DataArray, box: dict[str, slice], at: dict[str | None, int]) -> FloatArray:
    """The values in ``box`` at the indices ``at``, flattened; NaN for missing values and those not valid."""
    part = array.isel(box | {name: k for name, k in at.items() if name}, missing_dims="ignore")
    found: FloatArray = part.values.astype(float).reshape(-1)
    limits = (array.attrs.get("valid_min", -np.inf), array.attrs.get("valid_max", np.inf))
    low, high = np.sort(np.ravel(array.attrs.get("valid_range", limits)).astype(float))  # of packed values
    if np.isfinite([low, high]).any():
        scale, offset = (array.encoding.get(name, n) for name, n in (("scale_factor", 1), ("add_offset", 0)))
        slack = 0.0 if (scale, offset) == (1, 0) else 0.5  # packed values are whole numbers
        packed = (found - offset) / scale
        found[(packed < low - slack) | (packed > high + slack)] = np.nan
    return found


def _speed_factor(path: Path, array: xr.DataArray) -> float:
    units = text(array, "units")
    factor = SPEEDS.get(re.sub(r"[\s.*^]+", "", units.lower()))
    if factor is None:
        given = f"is in {shown_value(units)}" if units.strip() else "has no units"
        raise DataError(f"wind file {path}: {array.name} {given}; expected m s-1, cm s-1, km h-1 or knots")
    return factor


def _surface_pressure(pair: _Pair, dimensions: set[str | None]) -> xr.DataArray | None:
    """Surface pressure [Pa] on the same grid and times, for a pressure level; None if there is none."""
    if pair.level.kind != PRESSURE:
        return None
    dims = tuple(name for name in pair.u.dims if name in dimensions)
    for name in pair.u.cf.standard_names.get("surface_air_pressure", ()):
        array: xr.DataArray = pair.u.coords[name]
        if array.dims == dims and text(array, "units").lower() in ("pa", "pascal"):
            return array
    return None
