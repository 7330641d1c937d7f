"""Temperature and surface pressure of the air in NetCDF files, on the grid and at the times of the wind.

They are identified by standard name, else by long name, else by variable name, as the wind is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from flight_quantities.atmosphere import temperature_scale
from flight_quantities.levels import HEIGHT, PRESSURES, Level, nearest_level
from pareto_ltl_apps.formats.cf_grid import levels_of, text

if TYPE_CHECKING:
    import xarray as xr

OTHER_TEMPERATURES = (
    "dew|potential|sea|soil|surface|skin|ground|snow|ice|virtual|bulb|brightness|apparent|theta"
    "|max|min|mean|average|anomaly|gradient|variance|error|std|spread|perturb|percentile|probab"
)
TEMPERATURE_WORDS = r"(\d+ ?m(etre|eter)?s? )?(air )?temp(erature)?( .*)?"
TEMPERATURE_NAMES = r"t|t_?\d+m?|\d+m?_?t|(air_?)?temp(erature)?([-_].*)?|tmp.*|tas|tair"
PRESSURE_NAMES = ("sp", "psfc")
NAMED_LEVEL = re.compile(r"t_?(\d+)m?|(\d+)m?_?t|.*?(\d+) ?m.*")


class AirArray(NamedTuple):
    """A temperature, or a surface pressure, as a file has it.

    ``dimension`` is the one of its levels, None for a single one, and ``place`` the index of ``level`` there;
    ``factor`` and ``offset`` turn its values into [K] or [Pa].
    """

    array: xr.DataArray
    level: str
    dimension: str | None = None
    place: int = 0
    factor: float = 1.0
    offset: float = 0.0


def temperature_of(
    data: xr.Dataset, wind: Level, spatial: tuple[str, ...], others: set[str | None], notes: dict[str, None]
) -> AirArray | None:
    """The temperature in ``data`` that belongs to a wind at level ``wind``; None if there is none.

    ``spatial`` are the dimensions of the wind's grid, ``others`` of its times and members. ``notes`` are
    completed by temperatures whose unit is not known.
    """
    found: list[tuple[float, AirArray]] = []
    for array in _named(data):
        if (scale := temperature_scale(text(array, "units"))) is None:
            notes[f"{array.name} has no known unit of temperature (K, degC) and is not used"] = None
            continue
        placed = data.set_coords([name for name in data if name != array.name])[array.name]
        dimension, heights = levels_of(placed, HEIGHT)
        heights = heights or _level_in_name(array)
        level = nearest_level(heights, wind)
        fitting = {*array.dims} - {*spatial, *others, dimension}
        if level is None or not {*spatial} <= {*array.dims} or any(array.sizes[name] > 1 for name in fitting):
            continue
        place, here = heights.index(level), array.transpose(..., *spatial)
        found.append((abs(level.value - wind.value), AirArray(here, level.text, dimension, place, *scale)))
    return min(found, key=lambda pair: pair[0], default=(0.0, None))[1]


def surface_pressure_of(data: xr.Dataset, dims: tuple[str, ...]) -> AirArray | None:
    """The pressure at the ground with the dimensions ``dims``; None if there is none."""
    for array in map(data.__getitem__, map(str, data.variables)):
        standard = text(array, "standard_name").strip()
        if standard != "surface_air_pressure" and (standard or str(array.name).lower() not in PRESSURE_NAMES):
            continue
        factor = PRESSURES.get(text(array, "units").strip().lower())
        if array.dims == dims and factor is not None:
            return AirArray(array, Level(HEIGHT, 0.0).text, factor=factor)
    return None


def _named(data: xr.Dataset) -> Iterator[xr.DataArray]:
    """Temperatures of the air in ``data``."""
    for name in map(str, data.variables):
        array = data[name]
        standard = text(array, "standard_name").strip().lower()
        words = f"{text(array, 'long_name') or text(array, 'description')}".lower().replace("_", " ")
        means = bool(re.search(r"time\s*:\s*(mean|max|min)", text(array, "cell_methods")))
        if not array.shape or array.dtype.kind not in "iuf" or means:
            continue
        if standard in ("", "unknown", "undefined", "none", "null", "-", "~"):
            named = re.fullmatch(TEMPERATURE_WORDS, words) or re.fullmatch(TEMPERATURE_NAMES, name.lower())
            if named and not re.search(OTHER_TEMPERATURES, f"{words} {name.lower()}"):
                yield array
        elif standard == "air_temperature":
            yield array


def _level_in_name(array: xr.DataArray) -> list[Level]:
    """The height in metres that the name or the long name states, e.g. ``t2m`` and ``TEMP at 2 M``."""
    words = (str(array.name), text(array, "long_name"), text(array, "description"))
    for word in words:
        if found := NAMED_LEVEL.fullmatch(word.lower().replace("_", " ") if " " in word else word.lower()):
            return [Level(HEIGHT, float(next(filter(None, found.groups()))))]
    return []
