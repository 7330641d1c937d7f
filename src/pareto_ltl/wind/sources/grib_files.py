"""Wind at one level from GRIB files (GFS, GEFS, NAM, RAP, HRRR), read with ecCodes.

Messages are decoded one by one with ecCodes. cfgrib is not used, since it drops a component of a truncated
file and reports this only in its log.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.levels import Level, level_list, parse_level
from pareto_ltl.wind.readings import Readings, check_readings, iso
from pareto_ltl.wind.snapshots import Snapshot, latest_readings
from pareto_ltl.wind.sources.grib_framing import check_frames
from pareto_ltl.wind.sources.grib_messages import SURFACE_PRESSURE, GribField, GribScan, decode_message
from pareto_ltl.wind.sources.ground import LeftOut, left_out_notes, nodes_in_the_air
from pareto_ltl.wind.sources.magic import refuse_other_format
from pareto_ltl.world.projection import rotate_vectors

FieldKey = tuple[float, float, str]  # time, lead, member
Tell = Callable[[Path], None]


def read_grib_files(
    files: tuple[Path, ...],
    max_speed: float,
    level: str = "10m",
    area: GeoBox | None = None,
    tell: Tell | None = None,
) -> Readings:
    """The wind at every time in ``files``; of several forecasts for one time, the latest."""
    return latest_readings(*grib_snapshots(files, max_speed, level, area, tell))


def grib_snapshots(
    files: tuple[Path, ...],
    max_speed: float,
    level: str = "10m",
    area: GeoBox | None = None,
    tell: Tell | None = None,
) -> tuple[tuple[Snapshot, ...], tuple[Path, ...], tuple[str, ...]]:
    """Every wind at ``level`` in ``files``, the files, and notes of quality control.

    ``tell`` is called with each file before it is opened.

    Raises
    ------
    DataError
        If a file is damaged, has no wind at the level or lacks a component, or if two messages have the same
        component, time, lead and member.
    """
    pairs: dict[FieldKey, dict[str, GribField]] = {}
    scan = GribScan(parse_level(level), area)
    for field in _grib_fields(files, scan, tell):
        pair = pairs.setdefault((field.time, field.lead, field.member), {})
        if field.component in pair and field.component != SURFACE_PRESSURE:
            raise DataError(
                f"wind files {pair[field.component].file.name} and {field.file.name} both hold "
                f"{field.component} at {iso(field.time)} with the same lead; keep one member"
            )
        pair[field.component] = field
    notes = [
        f"{count} GRIB messages hold the {kind} of the wind, not its value at an instant: left out"
        for kind, count in sorted(scan.left_out.items())
    ]
    kept = [pairs[key] for key in sorted(pairs) if pairs[key].keys() - {SURFACE_PRESSURE}]
    found = [_snapshot(pair, scan.level, max_speed) for pair in kept]
    snapshots = tuple(snapshot for snapshot, _ in found)
    return snapshots, files, (*notes, *left_out_notes(scan.level, [count for _, count in found]))


def _snapshot(pair: dict[str, GribField], level: Level, max_speed: float) -> tuple[Snapshot, LeftOut]:
    """The Earth-relative winds of one time, and the numbers of nodes that are left out."""
    some = pair.get("u") or pair["v"]
    missing = {"u", "v"} - set(pair)
    if missing:
        raise DataError(
            f"wind file {some.file}: {iso(some.time)} has no {missing.pop()} component {level.phrase}; "
            "expected u and v (is the file truncated?)"
        )
    u, v = pair["u"], pair["v"]
    lonlat = u.grid.lonlat
    if u.grid is not v.grid and not np.array_equal(lonlat, v.grid.lonlat):
        raise DataError(f"wind file {some.file}: u and v at {iso(some.time)} are on different grids")
    pressure = pair.get(SURFACE_PRESSURE)
    winds = np.stack([u.values, v.values], axis=1)  # nodes outside the domain of the model are missing
    here, count = nodes_in_the_air(level, winds, None if pressure is None else pressure.values)
    winds = winds if u.grid.twist is None else rotate_vectors(winds, -u.grid.twist)
    points, winds = (lonlat, winds) if here.all() else (lonlat[here], winds[here])
    check_readings(points, winds, True, max_speed, lambda _: f"wind file {u.file}, {iso(u.time)}")
    owners = tuple(dict.fromkeys(field.file for field in (u, v)))
    return Snapshot(u.time, u.lead, points, winds, level.text, owners, u.member), count


def _grib_fields(files: tuple[Path, ...], scan: GribScan, tell: Tell | None) -> Iterator[GribField]:
    """The fields in ``files`` that ``scan`` describes; DataError for a file without any."""
    eccodes = _import_eccodes(files[0])
    for file in files:
        if tell is not None:
            tell(file)
        found = False
        scan.levels.clear()
        with _open_grib(file, eccodes) as stream:
            while (message := _next_message(eccodes, stream)) is not None:
                try:
                    with quiet_library():
                        field = decode_message(eccodes, message, file, scan)
                finally:
                    eccodes.codes_release(message)
                if field is not None:
                    found = found or field.component != SURFACE_PRESSURE
                    yield field
        if not found:
            raise DataError(_nothing_found(file, scan))


def _nothing_found(file: Path, scan: GribScan) -> str:
    level = scan.level
    if level in scan.levels:
        kinds = " and ".join(sorted(scan.left_out))
        return (
            f"wind file {file} holds the wind {level.phrase} as {kinds} only; expected values of an instant"
        )
    if scan.levels:
        there = f"it has {level_list(scan.levels)}: set wind.level to one of them"
    else:
        there = "expected GRIB messages UGRD and VGRD"
    return f"wind file {file} holds no wind {level.phrase}; {there}"


def _next_message(eccodes: Any, stream: Any) -> int | None:
    with quiet_library():
        message: int | None = eccodes.codes_grib_new_from_file(stream)
    return message


@contextmanager
def quiet_library() -> Iterator[None]:
    """In the block, hide what ecCodes prints to the terminal; its exceptions contain the same information."""
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
    """In the block, the open file; errors of ecCodes become DataErrors."""
    try:
        with file.open("rb", buffering=0) as stream:  # ecCodes reads from the position of the file descriptor
            head = stream.read(64)
            stream.seek(0)
            if not head.strip():
                raise DataError(f"wind file {file} is empty; download it again")
            refuse_other_format(f"wind file {file}", head, "GRIB")
            check_frames(file, stream)
            eccodes.codes_grib_multi_support_on()  # RAP and NAM nests pack u and v in one message
            yield stream
    except OSError as error:
        raise DataError(f"wind file {file} cannot be read: {error.strerror}") from None
    except eccodes.CodesInternalError as error:
        raise DataError(f"wind file {file} is damaged or truncated ({error}); download it again") from None
    except (ValueError, ArithmeticError, RuntimeError, TypeError) as error:  # an impossible date or grid
        reason = " ".join(str(error).split())[:200]
        raise DataError(f"wind file {file} is damaged ({reason}); download it again") from error
    finally:
        eccodes.codes_grib_multi_support_off()


def _import_eccodes(file: Path) -> Any:
    import pyproj  # noqa: F401 - before ecCodes: each brings its own PROJ, and the other order can crash

    try:
        import eccodes
    except (ImportError, RuntimeError):
        raise DataError(
            f"reading GRIB ({file}) needs ecCodes: pip install 'pareto-ltl[grib]', or use wind.source=csv"
        ) from None
    return eccodes
