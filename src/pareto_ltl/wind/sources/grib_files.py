"""Wind 10 m above ground from GRIB files (GFS, NAM, RAP, HRRR), read with ecCodes.

ecCodes decodes the messages one by one. cfgrib drops a component of a truncated file and reports this in its
log only.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import Readings, check_readings, iso, wrap_longitude
from pareto_ltl.wind.sources.grib_framing import check_frames
from pareto_ltl.world.projection import meridian_convergence, rotate_vectors

SPEED_UNITS = ("m s**-1", "m s-1", "m/s")
WIND_COMPONENTS = {"10u": "u", "u": "u", "10v": "v", "v": "v"}


@dataclass(frozen=True, slots=True)
class _GribField:
    """One wind component at one time."""

    component: str
    time: float  # validity [s since 1970]
    lead: float  # validity minus start of the forecast [s]
    file: Path
    lonlat: FloatArray  # (N, 2) [deg]
    values: FloatArray  # (N,) [m/s]
    twist: FloatArray | None  # (N,) from grid north to true north [rad]; None where winds are earth-relative


def read_grib_files(
    files: tuple[Path, ...], max_speed: float, tell: Callable[[Path], None] | None = None
) -> Readings:
    """The 10 m wind of every time in ``files``; of several forecasts for one time, the latest.

    ``tell`` is called with each file before it is opened.
    """
    pairs: dict[float, dict[float, dict[str, _GribField]]] = {}
    for field in _grib_fields(files, tell):
        pair = pairs.setdefault(field.time, {}).setdefault(field.lead, {})
        if field.component in pair:
            raise DataError(
                f"wind files {pair[field.component].file.name} and {field.file.name} both hold "
                f"{field.component} at {iso(field.time)} with the same lead; keep one member"
            )
        pair[field.component] = field
    times = sorted(pairs)
    best = [pairs[time][min(pairs[time])] for time in times]
    merged = [_join_components(pair, max_speed) for pair in best]
    return Readings(
        times=np.array(times),
        points=tuple(points for points, _ in merged),
        winds=tuple(winds for _, winds in merged),
        geographic=True,
        files=files,
        remarks=tuple(_lead_text(min(pairs[time])) for time in times),
        origins=tuple(tuple({field.file: None for field in pair.values()}) for pair in best),
        leads=np.array([min(pairs[time]) for time in times]),
    )


def _join_components(pair: dict[str, _GribField], max_speed: float) -> tuple[FloatArray, FloatArray]:
    """Points (N, 2) [deg] and earth-relative winds (N, 2) [m/s] of one time."""
    some = next(iter(pair.values()))
    missing = {"u", "v"} - set(pair)
    if missing:
        raise DataError(
            f"wind file {some.file}: {iso(some.time)} has no {missing.pop()} component 10 m above ground; "
            "expected u and v (is the file truncated?)"
        )
    u, v = pair["u"], pair["v"]
    if u.lonlat.shape != v.lonlat.shape or not np.array_equal(u.lonlat, v.lonlat):
        raise DataError(f"wind file {some.file}: u and v at {iso(some.time)} are on different grids")
    winds = np.stack([u.values, v.values], axis=1)
    here = np.isfinite(winds).all(axis=1)  # nodes outside the domain of the model are missing
    winds = winds if u.twist is None else rotate_vectors(winds, -u.twist)
    check_readings(
        u.lonlat[here], winds[here], True, max_speed, lambda _: f"wind file {u.file}, {iso(u.time)}"
    )
    return u.lonlat[here], winds[here]


def _grib_fields(files: tuple[Path, ...], tell: Callable[[Path], None] | None) -> Iterator[_GribField]:
    """The 10 m wind components in ``files``; a file without any is an error."""
    eccodes = _import_eccodes(files[0])
    grids: dict[str, tuple[FloatArray, FloatArray | None]] = {}  # each distinct grid is decoded once
    for file in files:
        if tell is not None:
            tell(file)
        found = False
        with _open_grib(file, eccodes) as stream:
            while (message := _next_message(eccodes, stream)) is not None:
                try:
                    with quiet_library():
                        field = _decode_message(eccodes, message, file, grids)
                finally:
                    eccodes.codes_release(message)
                if field is not None:
                    found = True
                    yield field
        if not found:
            raise DataError(
                f"wind file {file} holds no wind 10 m above ground; expected GRIB messages UGRD and VGRD"
            )


def _next_message(eccodes: Any, stream: Any) -> int | None:
    with quiet_library():
        message: int | None = eccodes.codes_grib_new_from_file(stream)
    return message


@contextmanager
def quiet_library() -> Iterator[None]:
    """Keep what ecCodes prints of a damaged message off the terminal: its error says the same in one line."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


@contextmanager
def _open_grib(file: Path, eccodes: Any) -> Iterator[Any]:
    """The open file; errors of ecCodes become DataErrors."""
    try:
        with file.open("rb", buffering=0) as stream:  # ecCodes reads from the position of the file descriptor
            head = stream.read(64).lstrip()
            stream.seek(0)
            if not head:
                raise DataError(f"wind file {file} is empty; download it again")
            if head[:1] == b"<":
                raise DataError(
                    f"wind file {file} is a web page, not GRIB (a failed download?); fetch it again"
                )
            check_frames(file, stream)
            eccodes.codes_grib_multi_support_on()  # RAP and NAM nests pack u and v in one message
            yield stream
    except OSError as error:
        raise DataError(f"wind file {file} cannot be read: {error.strerror}") from None
    except eccodes.CodesInternalError as error:
        raise DataError(f"wind file {file} is damaged or truncated ({error}); download it again") from None
    except (ValueError, ArithmeticError, RuntimeError, TypeError) as error:  # a date, a grid that cannot be
        reason = " ".join(str(error).split())[:200]
        raise DataError(f"wind file {file} is damaged ({reason}); download it again") from error
    finally:
        eccodes.codes_grib_multi_support_off()


def _is_wind_at_10_m(eccodes: Any, message: int) -> bool:
    get = eccodes.codes_get
    return (
        get(message, "shortName") in WIND_COMPONENTS
        and get(message, "typeOfLevel") == "heightAboveGround"
        and get(message, "level") == 10
    )


def _decode_message(
    eccodes: Any, message: int, file: Path, grids: dict[str, tuple[FloatArray, FloatArray | None]]
) -> _GribField | None:
    """The wind component that ``message`` holds; None where it holds something else."""
    if not _is_wind_at_10_m(eccodes, message):
        return None
    get = eccodes.codes_get
    valid, start = (
        _message_time(get(message, f"{kind}Date"), get(message, f"{kind}Time"))
        for kind in ("validity", "data")
    )
    component = WIND_COMPONENTS[get(message, "shortName")]
    key = str(get(message, "md5GridSection"))
    if key not in grids:
        grids[key] = _grid_nodes(eccodes, message, file)
    lonlat, twist = grids[key]
    if (unit := get(message, "units")) not in SPEED_UNITS:
        raise DataError(f"wind file {file}: {component} is in {unit}; expected m s-1: convert the file")
    values = np.array(eccodes.codes_get_values(message), dtype=float)
    if get(message, "bitmapPresent"):
        values[values == get(message, "missingValue", float)] = np.nan
    return _GribField(component, valid, valid - start, file, lonlat, values, twist)


def _grid_nodes(eccodes: Any, message: int, file: Path) -> tuple[FloatArray, FloatArray | None]:
    """Nodes (N, 2) [deg], and the angle (N,) [rad] from grid north to true north for grid-relative winds."""
    lon = wrap_longitude(np.asarray(eccodes.codes_get_array(message, "longitudes"), float))
    lat = np.asarray(eccodes.codes_get_array(message, "latitudes"), float)
    lonlat = np.stack([lon, lat], axis=1)
    kind = eccodes.codes_get(message, "gridType")
    if not eccodes.codes_get(message, "uvRelativeToGrid") or kind in ("regular_ll", "regular_gg", "mercator"):
        return lonlat, None  # the axes of these grids are east and north
    crs = _grid_crs(lambda name: eccodes.codes_get(message, name, float), kind)
    if crs is None:
        raise DataError(
            f"wind file {file}: winds follow a grid of type {kind}, which cannot be turned to the east; "
            "expected lambert, polar_stereographic or a latitude-longitude grid"
        )
    return lonlat, meridian_convergence(crs, lon, lat)


def _grid_crs(number: Any, kind: str) -> str | None:
    """PROJ string of the plane of the model; directions do not depend on the radius of its sphere."""
    if kind == "lambert":
        return (
            f"+proj=lcc +lat_1={number('Latin1InDegrees')} +lat_2={number('Latin2InDegrees')} "
            f"+lat_0={number('LaDInDegrees')} +lon_0={number('LoVInDegrees')} +R=6371229 +no_defs"
        )
    if kind == "polar_stereographic":
        pole = -90 if number("southPoleOnProjectionPlane") else 90
        lon = number("orientationOfTheGridInDegrees")
        lat = number("LaDInDegrees")
        return f"+proj=stere +lat_0={pole} +lat_ts={lat} +lon_0={lon} +R=6371229 +no_defs"
    return None


def _message_time(date: int, clock: int) -> float:
    """Seconds since 1970 of YYYYMMDD and HHMM."""
    return datetime.strptime(f"{date:08d}{clock:04d}", "%Y%m%d%H%M").replace(tzinfo=UTC).timestamp()


def _lead_text(lead: float) -> str:
    return "analysis" if lead == 0 else f"{lead / 3600:g} h forecast"


def _import_eccodes(file: Path) -> Any:
    import pyproj  # noqa: F401 - before ecCodes: each brings its own PROJ, and the other order can crash

    try:
        import eccodes
    except (ImportError, RuntimeError):
        raise DataError(
            f"reading GRIB ({file}) needs ecCodes: pip install 'pareto-ltl[grib]', or use wind.source=csv"
        ) from None
    return eccodes


__all__ = ["read_grib_files"]
