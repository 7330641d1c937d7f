"""A wind field as a CF NetCDF file.

The dimension ``mode`` stands right of the others, where CF recommends left: files of 1.0.0rc1 have it there.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from careful_io.files import write_bytes
from careful_io.reading import inside, read_json
from flight_quantities.levels import DEPTH, HEIGHT, PRESSURE
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.file_formats import DAMAGE
from pareto_ltl.support.levels import wind_level
from pareto_ltl.support.schemas import check_document
from pareto_ltl.wind.air import MapAir
from pareto_ltl.wind.named_laws import SCHEMAS
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.projection import Frame
from pareto_ltl.world.scene import Scene
from wind_laws.documents import law_of
from wind_laws.error_law import ErrorLaw
from wind_laws.records import PARTS, WindEvidence, WindModes

if TYPE_CHECKING:
    import h5netcdf


FREE_BYTES = 16 * 2**20  # size of a variable that is allowed for a file of any size
LARGEST = 1e18  # limit of all numbers of a field; its square is finite
MAX_RATIO = 20  # largest ratio of the bytes of a variable to the bytes of the file, beyond FREE_BYTES
TIME, GRID = ("time",), ("time", "y", "x")  # dimensions of variables
MODES = ("time", "mode_y", "mode_x", "mode")
LEVEL_VARIABLES = {  # name of the scalar coordinate, unit and positive direction, by the kind of the level
    HEIGHT: ("height", "m", "up"),
    PRESSURE: ("air_pressure", "Pa", "down"),
    DEPTH: ("depth", "m", "down"),
}
MODE_NUMBERS = (("rho", "rho"), ("rho_gap", "gap"), ("rest_length", "rest_length"))  # attributes
# Variables of each component u and v: end of the name, dimensions, meaning, unit.
ComponentRows = tuple[tuple[str, tuple[str, ...], str, str], ...]
FIELD_ROWS: ComponentRows = (
    ("", GRID, "expected {what} towards +{axis}", "m s-1"),
    ("_var", GRID, "variance of the smooth part of the error of {name}", "m2 s-2"),
    ("_gust_var", TIME, "variance of the part of {name} that is independent from step to step", "m2 s-2"),
)
MODE_ROWS: ComponentRows = (
    ("_modes", MODES, "Karhunen-Loeve modes of the error of {name}, U sqrt(Lambda)", "m s-1"),
    ("_length", TIME, "length scale of {name}", "m"),
    ("_energy", TIME, "share of the variance of the error in {name}_modes", "1"),
)
HYPER_ROWS: ComponentRows = (  # the columns of WindEvidence.hyper
    ("_prior_mean", TIME, "mean of {name} far from all readings", "m s-1"),
    ("_prior_sd", TIME, "standard deviation of the smooth part of {name} far from all readings", "m s-1"),
    ("_prior_length", TIME, "length scale of the smooth part of {name}", "m"),
    ("_noise_sd", TIME, "standard deviation of the white part of a reading of {name}", "m s-1"),
)
Attributes = dict[str, Any]
NetcdfVariable = tuple[str, tuple[str, ...], Any, Attributes]  # name, dimensions, values, attributes


def write_wind(directory: Path, wind: WindField) -> None:
    """Write ``wind.nc``; if ``scene.json`` is in ``directory``, with its time zero and projection."""
    from pareto_ltl.world.scene_files import scene_from_dict

    path = directory / "scene.json"  # written by this run: a check against its schema would take 0.2 s
    scene = scene_from_dict(read_json(path)) if path.is_file() else None
    write_netcdf(wind, directory / "wind.nc", scene)


def read_wind(place: Path | str) -> WindField:
    """The wind field of ``wind.nc``, a file or the directory that has it."""
    return read_netcdf(inside(place, "wind.nc"))


def write_netcdf(field: WindField, path: Path, scene: Scene | None = None) -> Path:
    """Write ``field`` as CF NetCDF; return ``path``. With ``scene``, the file has its time and grid mapping.

    The file is written with h5netcdf, since importing xarray takes a fifth of a run; xarray can open it.
    """
    import h5netcdf

    path.parent.mkdir(parents=True, exist_ok=True)
    variables = list(_field_variables(field, scene))
    content = io.BytesIO()  # on a full disk, the HDF5 library would end the process
    with h5netcdf.File(content, "w") as file:
        file.attrs.update(_file_attributes(field))
        sizes = (zip(names, np.shape(values), strict=True) for _, names, values, _ in variables)
        file.dimensions.update(dict(chain.from_iterable(sizes)))
        for name, dimensions, values, attributes in variables:
            file.create_variable(name, dimensions, data=values).attrs.update(attributes)
    write_bytes(path, content.getvalue())
    return path


def read_netcdf(path: Path) -> WindField:
    """The wind field in a file of :func:`write_netcdf`.

    Raises
    ------
    DataError
        If the file does not exist or is not valid.
    """
    from careful_io.netcdf4 import opened_netcdf

    if not path.is_file():
        raise DataError(f"wind field {path} does not exist; expected the wind.nc of a run")
    try:
        with opened_netcdf(path) as file:
            return _read_field(file)
    except DAMAGE as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise DataError(
            f"wind field {path} cannot be read ({reason}); expected the wind.nc of a run"
        ) from None


def _file_attributes(field: WindField) -> dict[str, Any]:
    return {
        "Conventions": "CF-1.11",
        "title": "Posterior wind of a pareto_ltl run",
        "history": "written by pareto_ltl from the readings that the attribute source names",
        "source": field.source,
        "origin": field.origin,
        "spacing": field.spacing,
        "known_until": field.known_until,
        "known_until_because": field.ends,
        "level": field.level,
        "gust_time": field.gust_time,
        **({} if (modes := field.modes) is None else {name: getattr(modes, of) for name, of in MODE_NUMBERS}),
        **({} if field.held is None else {"held_since": field.held}),
        **({} if field.error is None else {"forecast_error": json.dumps(field.error.document())}),
        **({} if field.evidence is None else {"kernel": field.evidence.kernel}),
        "score": json.dumps(dict(field.score), sort_keys=True),
    }


def _field_variables(field: WindField, scene: Scene | None) -> Iterator[NetcdfVariable]:
    """Coordinates, then the arrays of the field, of its modes and of its evidence."""
    x, y = _axes(field.origin, field.spacing, field.mean)
    yield "time", TIME, field.times, _time_attributes(scene)
    yield "y", ("y",), y, {"standard_name": "projection_y_coordinate", "units": "m", "axis": "Y"}
    yield "x", ("x",), x, {"standard_name": "projection_x_coordinate", "units": "m", "axis": "X"}
    lead = "valid time minus start of the forecast; NaN where it is not known"
    yield "lead", TIME, field.leads, _attributes(lead, "s") | {"standard_name": "forecast_period"}
    level = wind_level(field.level)
    height, unit, positive = LEVEL_VARIABLES[level.kind]
    described = {"standard_name": height, "units": unit, "positive": positive, "axis": "Z"}
    yield height, (), level.value, described
    placed: Attributes = {"coordinates": height}
    if scene is not None and scene.crs is not None:
        yield "crs", (), 0, _grid_mapping(scene.crs)
        yield from _degrees(scene.crs, x, y)
        placed = {"coordinates": f"{height} lat lon", "grid_mapping": "crs"}
    what = "current" if level.kind == DEPTH else "wind"
    for c, axis in enumerate("xy"):
        standard = f"sea_water_{axis}_velocity" if level.kind == DEPTH else f"{axis}_wind"
        named = {"standard_name": standard} | placed | {"ancillary_variables": f"{'uv'[c]}_var"}
        arrays, more = (field.mean, field.latent_var, field.gust_var), {"": named, "_var": placed}
        yield from _component_variables(FIELD_ROWS, arrays, c, more, what)
    if field.modes is not None:
        yield from _mode_variables(field.modes)
    if field.evidence is not None:
        yield from _evidence_variables(field.evidence)
    if field.air is not None:
        yield from _air_variables(field.air)


def _axes(origin: FloatArray, spacing: float, table: NDArray[Any]) -> Iterator[FloatArray]:
    """x and y of the nodes of a lattice with the values ``table`` (K, NX, NY, ...)."""
    return (origin[i] + spacing * np.arange(table.shape[i + 1]) for i in (0, 1))


def _component_variables(
    rows: ComponentRows,
    arrays: Iterable[NDArray[Any]],
    c: int,
    more: Mapping[str, Attributes] = MappingProxyType({}),
    what: str = "",
) -> Iterator[NetcdfVariable]:
    """Component ``c`` of ``arrays``, lattices (time, x, y) transposed to CF order (time, y, x)."""
    name = "uv"[c]
    for (end, dimensions, meaning, unit), array in zip(rows, arrays, strict=True):
        values = array.take(c, axis=_component_axis(dimensions))
        described = _attributes(meaning.format(name=name, axis="xy"[c], what=what), unit)
        yield (
            f"{name}{end}",
            dimensions,
            values.swapaxes(1, 2) if len(dimensions) > 1 else values,
            described | more.get(end, {}),
        )


def _component_arrays(file: h5netcdf.File, rows: ComponentRows) -> Iterator[NDArray[Any]]:
    """The arrays of :func:`_component_variables`, with both components."""
    for end, dimensions, _, _ in rows:
        kind = np.float32 if dimensions == MODES else float
        both = [_values(file, f"{name}{end}", kind) for name in "uv"]
        array = np.stack(both, axis=_component_axis(dimensions))
        yield np.ascontiguousarray(array.swapaxes(1, 2)) if len(dimensions) > 1 else array


def _component_axis(dimensions: tuple[str, ...]) -> int:
    return -2 if dimensions == MODES else -1


def _degrees(crs: str, x: FloatArray, y: FloatArray) -> Iterator[NetcdfVariable]:
    """Latitude and longitude (NY, NX) of the nodes, for readers that do not know grid mappings."""
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    lon, lat = Frame(crs).to_geographic(nodes.reshape(-1, 2))
    for name, long, unit, values in (("lat", "latitude", "north", lat), ("lon", "longitude", "east", lon)):
        described = _attributes(f"{long} of a node", f"degrees_{unit}") | {"standard_name": long}
        yield name, ("y", "x"), values.reshape(nodes.shape[:2]), described


def _mode_variables(found: WindModes) -> Iterator[NetcdfVariable]:
    """ψ with the coordinates of its lattice; length scale and carried variance of each slot."""
    x, y = _axes(found.origin, found.spacing, found.psi)
    yield "mode_y", ("mode_y",), y, {"units": "m", "long_name": "y of the modes' lattice"}
    yield "mode_x", ("mode_x",), x, {"units": "m", "long_name": "x of the modes' lattice"}
    meanings = " ".join(["unused", *(name.replace(" ", "_") for name in PARTS)])
    values = np.arange(-1, len(PARTS), dtype=found.part.dtype)
    described = {"long_name": "part of the error", "flag_values": values, "flag_meanings": meanings}
    yield "mode_part", ("mode",), found.part, described
    for c in (0, 1):
        yield from _component_variables(MODE_ROWS, (found.psi, found.length, found.energy), c)


def _evidence_variables(found: WindEvidence) -> Iterator[NetcdfVariable]:
    """Readings as a CF contiguous ragged array, slot after slot; hyperparameters of each slot.

    The places have no standard name: only one variable may be the projected x of a grid mapping.
    """
    counts = np.array([len(points) for points in found.points])
    described = {"long_name": "number of readings", "sample_dimension": "reading"}
    yield "reading_count", TIME, counts, described
    points, winds = np.concatenate(found.points), np.concatenate(found.winds)
    for c, (axis, name) in enumerate(zip("xy", "uv", strict=True)):
        yield f"reading_{axis}", ("reading",), points[:, c], _attributes(f"{axis} of a reading", "m")
        value = _attributes(f"component of a reading towards +{axis}", "m s-1")
        yield f"reading_{name}", ("reading",), winds[:, c], value | {"coordinates": "reading_x reading_y"}
        yield from _component_variables(HYPER_ROWS, np.moveaxis(found.hyper, -1, 0), c)


def _air_variables(found: MapAir) -> Iterator[NetcdfVariable]:
    """Means over the map, at the times of the files; ``level`` is the height of each."""
    yield "air_time", ("air_time",), found.times, _attributes("time since the departure", "s")
    for name, standard, level, values, unit in (
        ("air_temperature", "air_temperature", found.level, found.temperature, "K"),
        ("air_pressure_measured", "air_pressure", found.pressure_level, found.pressure, "Pa"),
    ):
        described = _attributes(f"mean of the wind file over the map at {level}", unit)
        yield name, ("air_time",), values, described | {"standard_name": standard, "level": level}


def _read_air(file: h5netcdf.File) -> MapAir:
    warmth, pressure = file["air_temperature"], file["air_pressure_measured"]
    return MapAir(
        times=_values(file, "air_time"),
        temperature=_values(file, "air_temperature"),
        pressure=_values(file, "air_pressure_measured"),
        level=str(warmth.attrs["level"]),
        pressure_level=str(pressure.attrs["level"]),
    )


def _time_attributes(scene: Scene | None) -> dict[str, Any]:
    """Seconds since the departure, or seconds without a date: for CF, these are no time coordinate."""
    if scene is None or scene.time_zero is None:
        return {"units": "s", "long_name": "time since the departure"}
    clock = {"calendar": "standard", "units_metadata": "leap_seconds: none"}
    return {"standard_name": "time", "axis": "T", "units": f"seconds since {scene.time_zero}", **clock}


def _attributes(long_name: str, units: str) -> Attributes:
    return {"long_name": long_name, "units": units}


def _grid_mapping(crs: str) -> dict[str, Any]:
    """CF grid mapping of ``crs``, without empty attributes."""
    import pyproj

    described = pyproj.CRS.from_user_input(crs).to_cf()
    return {key: value for key, value in described.items() if value is not None}


def _read_field(file: h5netcdf.File) -> WindField:
    mean, latent_var, gust_var = _component_arrays(file, FIELD_ROWS)
    field = WindField(
        origin=np.asarray(file.attrs["origin"], float),
        spacing=float(file.attrs["spacing"]),
        times=_values(file, "time"),
        mean=mean,
        latent_var=latent_var,
        gust_var=gust_var,
        until=float(file.attrs["known_until"]),
        score=_read_score(str(file.attrs["score"])),
        source=str(file.attrs["source"]),
        modes=_read_modes(file) if "u_modes" in file else None,
        gust_time=float(file.attrs["gust_time"]),
        evidence=_read_evidence(file) if "reading_count" in file else None,
        leads=_values(file, "lead"),
        level=str(file.attrs["level"]),
        ends=str(file.attrs["known_until_because"]),
        error=_read_error(str(file.attrs["forecast_error"])) if "forecast_error" in file.attrs else None,
        held=float(file.attrs["held_since"]) if "held_since" in file.attrs else None,
        air=_read_air(file) if "air_temperature" in file else None,
    )
    _check_field(field)
    return field


def _read_modes(file: h5netcdf.File) -> WindModes:
    x, y = _values(file, "mode_x"), _values(file, "mode_y")
    psi, length, energy = _component_arrays(file, MODE_ROWS)
    return WindModes(
        origin=np.array([x[0], y[0]]),
        spacing=float(x[1] - x[0]),
        psi=psi,
        part=_values(file, "mode_part", int),
        length=length,
        energy=energy,
        **{of: float(file.attrs[name]) for name, of in MODE_NUMBERS},
    )


def _read_evidence(file: h5netcdf.File) -> WindEvidence:
    ends = np.cumsum(_values(file, "reading_count", int))[:-1]
    points, winds = (
        np.split(np.stack([_values(file, f"reading_{name}") for name in pair], axis=-1), ends)
        for pair in ("xy", "uv")
    )
    hyper = np.stack(list(_component_arrays(file, HYPER_ROWS)), axis=-1)
    return WindEvidence(tuple(points), tuple(winds), str(file.attrs["kernel"]), hyper)


def _values(file: h5netcdf.File, name: str, kind: type = float) -> NDArray[Any]:
    """All values of a numeric variable; ValueError if its shape needs far more bytes than the file has."""
    variable = file[name]
    claimed = math.prod(variable.shape) * max(np.dtype(variable.dtype).itemsize, 8)
    if claimed > FREE_BYTES + MAX_RATIO * Path(file.filename).stat().st_size:
        raise ValueError(f"{name} claims {claimed:,} bytes, far more than the file has")
    if np.dtype(variable.dtype).kind not in "biuf":
        raise ValueError(f"{name} holds {variable.dtype}; expected numbers")
    return np.asarray(variable[...], kind)


def _read_error(text: str) -> ErrorLaw:
    document = json.loads(text)
    schema = str(document.get("schema")) if isinstance(document, dict) else ""
    check_document(document, SCHEMAS.get(schema, "forecast_error"), "forecast_error")
    return law_of(document)


def _read_score(text: str) -> dict[str, float]:
    score = json.loads(text)  # NaN is allowed here: a score that could not be computed
    if not isinstance(score, dict):
        raise ValueError("the attribute score is not a JSON object")
    return {name: float(value) for name, value in score.items()}


def _check_field(field: WindField) -> None:
    """Raise a ValueError for numbers that are not finite, negative variances and times out of order."""
    arrays = {"origin": field.origin, "spacing": np.array(field.spacing), "time": field.times}
    arrays |= {"u, v": field.mean, "u_var, v_var": field.latent_var, "u_gust_var, v_gust_var": field.gust_var}
    for name, array in arrays.items():
        if not (np.isfinite(array).all() and (np.abs(array) < LARGEST).all()):
            raise ValueError(f"{name} holds a number that is not finite, or above {LARGEST:g}")
    if field.origin.shape != (2,) or field.spacing <= 0 or min(field.mean.shape[:3]) < 1:
        raise ValueError("the lattice has no nodes, or no spacing")
    if (field.latent_var < 0).any() or (field.gust_var < 0).any():
        raise ValueError("a variance is negative")
    if (np.diff(field.times) <= 0).any():
        raise ValueError("the times do not increase")
    if field.held is not None and not -LARGEST < field.held <= field.known_until:
        raise ValueError("held_since lies after the end of the wind")
    if not field.known_until >= field.times[0]:
        raise ValueError("known_until lies before the first time")
