"""Wind at one level from GRIB files (GFS, GEFS, NAM, RAP, HRRR), read with cfgrib in a separate process.

The messages of cfgrib are used one by one. Its datasets are not: a dataset fills a component that is missing
in a truncated file with NaN, and of two messages for one time it keeps one.

Since ecCodes can end its process on a damaged message, files are decoded in another process:
``python -m pareto_ltl.wind.sources.grib_files TASK ANSWER`` gets the arguments of :func:`grib_snapshots` as
JSON. It prints each file before it is opened, and writes one archive of arrays, which holds no code. If the
process ends without it, the caller raises a DataError on the file that was open.

ecCodes does not check the lengths in a message: wrong ones end the process (``double free``) or make it
allocate all memory. So they are checked before ecCodes opens a file; a few bytes of each section are read.
Formats: WMO Manual on Codes, FM 92 GRIB edition 2 (sections 0 to 8) and edition 1.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.extras import missing_extra
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.levels import HEIGHT, PRESSURE, Level, level_list, parse_level
from pareto_ltl.wind.readings import iso
from pareto_ltl.wind.snapshots import GridWind, Nodes, Snapshot, Snapshots, crop, earth_relative
from pareto_ltl.wind.sources.magic import wind_file
from pareto_ltl.world.projection import meridian_convergence

SPEED_UNITS = ("m s**-1", "m s-1", "m/s")
SURFACE_PRESSURE = "sp"
NUMBERED = {(0, 2, 2): "u", (0, 2, 3): "v", (0, 3, 0): SURFACE_PRESSURE}  # discipline, category, number
NAMED = re.compile(r"(?:\d+)?([uv])|(sp)")  # short names of edition 1: u, 10u, 100v
MEANS = (0, 1, 6)  # code table 4.7: means of the members; other statistics of an ensemble are not a wind
LEVELS = {
    "heightAboveGround": (HEIGHT, 1.0),
    "isobaricInhPa": (PRESSURE, 100.0),
    "isobaricInPa": (PRESSURE, 1.0),
}
STEP_TYPES = {"avg": "average", "max": "maximum", "min": "minimum"}
EARTH_AXES = ("regular_ll", "regular_gg", "mercator")  # grids whose axes are east and north
PROJECTED = ("lambert", "polar_stereographic")  # grids in the plane of a projection
MAX_NODES = 20_000_000  # nodes of a field; a global grid of 0.1 degrees has 6.5 million
MAX_BITS = 32  # bits of a packed value
START, END = b"GRIB", b"7777"
BLOCK = 2**16  # bytes searched at a time for the start of a message
COUNT_PLACE = {3: 6, 5: 5}  # section: position of its number of values, 4 bytes
Message = Any  # of cfgrib: a mapping of keys of ecCodes


class _Component(NamedTuple):
    """A component of the wind, or the surface pressure: values [m/s] or [Pa], NaN where there are none."""

    values: FloatArray
    nodes: Nodes
    file: Path


@dataclass(slots=True)
class _Scan:
    """The wanted fields, and a record of what else the files contain.

    Attributes
    ----------
    level : Level
    area : GeoBox or None
    fields : dict
        Components by time, lead [s] and member.
    grids : dict
        Grids that are decoded already, by their fingerprint.
    left_out : Counter
        Numbers of winds at the level that are not values of an instant, by kind, e.g. ``average``.
    """

    level: Level
    area: GeoBox | None
    fields: dict[tuple[float, float, str], dict[str, _Component]] = field(default_factory=dict)
    grids: dict[str, Nodes] = field(default_factory=dict)
    left_out: Counter[str] = field(default_factory=Counter)


def grib_snapshots_apart(
    files: tuple[Path, ...], max_speed: float, level: str = "10m", area: GeoBox | None = None
) -> Snapshots:
    """:func:`grib_snapshots` in another process.

    Raises
    ------
    DataError
        As :func:`grib_snapshots`, and if the process ends without an answer.
    """
    parse_level(level)
    task = [[str(file) for file in files], max_speed, level, None if area is None else astuple(area)]
    with tempfile.TemporaryDirectory(prefix="pareto_ltl_grib_") as folder:
        answer = Path(folder) / "answer.npz"
        command = [sys.executable, "-m", __name__, json.dumps(task), str(answer)]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        if not answer.is_file():
            at = done.stdout.splitlines()[-1:] or [str(files[0])]
            raise DataError(
                f"wind file {at[0]} is damaged: ecCodes, its decoder, ended with code {done.returncode}; "
                "download it again"
            )
        with np.load(answer, allow_pickle=False) as archive:
            arrays = dict(archive)
    told = json.loads(arrays["told"].item())
    if "error" in told:
        raise DataError(told["error"])
    winds = tuple(
        Snapshot(time, lead, arrays[points], arrays[winds], wind_level, tuple(map(Path, names)), member)
        for time, lead, points, winds, wind_level, names, member in told["winds"]
    )
    return Snapshots(winds, files, tuple(told["notes"]))


def _answer(task: str, answer: Path) -> None:
    """In the separate process: carry out ``task``; arrays that snapshots share are written once."""
    names, max_speed, level, box = json.loads(task)
    files, area = tuple(map(Path, names)), None if box is None else GeoBox(*box)
    arrays: dict[str, FloatArray] = {}

    def name_of(array: FloatArray) -> str:
        arrays[name := f"array_{id(array)}"] = array
        return name

    try:
        found = grib_snapshots(files, max_speed, level, area, lambda file: print(file, flush=True))
        winds = [
            (w.time, w.lead, name_of(w.points), name_of(w.winds), w.level, list(map(str, w.files)), w.member)
            for w in found.winds
        ]
        told: dict[str, Any] = {"winds": winds, "notes": found.notes}
    except (DataError, ConfigError) as error:
        told = {"error": str(error)}
    part = answer.with_suffix(".part")
    with part.open("wb") as stream:
        np.savez(stream, told=np.array(json.dumps(told)), **arrays)  # type: ignore[arg-type]
    part.rename(answer)


def grib_snapshots(
    files: tuple[Path, ...],
    max_speed: float,
    level: str = "10m",
    area: GeoBox | None = None,
    tell: Callable[[Path], None] = lambda _: None,
) -> Snapshots:
    """Every wind at ``level`` in ``files``, with notes of quality control.

    ``tell`` is called with each file before it is opened.

    Raises
    ------
    DataError
        If a file is damaged, has no wind at the level or lacks a component, or if two messages have the same
        component, time, lead and member.
    """
    scan = _Scan(parse_level(level), area)
    for file in files:
        tell(file)
        _scan_file(file, scan)
    notes = [
        f"{count} GRIB messages hold the {kind} of the wind, not its value at an instant: left out"
        for kind, count in sorted(scan.left_out.items())
    ]
    keys = sorted(key for key, pair in scan.fields.items() if pair.keys() - {SURFACE_PRESSURE})
    found = (_wind_of(*key, scan.fields[key], scan.level) for key in keys)
    return earth_relative(found, files, scan.level, max_speed, notes)


def _wind_of(time: float, lead: float, member: str, pair: dict[str, _Component], level: Level) -> GridWind:
    some = pair.get("u") or pair["v"]
    missing = {"u", "v"} - set(pair)
    if missing:
        raise DataError(
            f"wind file {some.file}: {iso(time)} has no {missing.pop()} component {level.phrase}; "
            "expected u and v (is the file truncated?)"
        )
    u, v, pressure = pair["u"], pair["v"], pair.get(SURFACE_PRESSURE)
    if u.nodes is not v.nodes and not np.array_equal(u.nodes.lonlat, v.nodes.lonlat):
        raise DataError(f"wind file {some.file}: u and v at {iso(time)} are on different grids")
    winds = np.stack([u.values, v.values], axis=1)  # nodes outside the domain of the model are missing
    files = tuple(dict.fromkeys((u.file, v.file)))
    snap = Snapshot(time, lead, u.nodes.lonlat, winds, level.text, files, member)
    return GridWind(snap, u.nodes.twist, None if pressure is None else pressure.values)


def _scan_file(file: Path, scan: _Scan) -> None:
    """Add the wanted fields in ``file``; a DataError if there are none."""
    levels: list[Level] = []
    found = False
    with _grib_messages(file) as messages:
        for message in messages:
            component = _component(message)
            if component is None or not _is_wanted(message, component, scan, levels):
                continue
            if component != SURFACE_PRESSURE and (unit := message["units"]) not in SPEED_UNITS:
                raise DataError(
                    f"wind file {file}: {component} is in {unit}; expected m s-1: convert the file"
                )
            found = found or component != SURFACE_PRESSURE
            key = (
                float(message["valid_time"]),
                float(message["valid_time"] - message["time"]),
                _member(message),
            )
            pair = scan.fields.setdefault(key, {})
            if component in pair and component != SURFACE_PRESSURE:
                raise DataError(
                    f"wind files {pair[component].file.name} and {file.name} both hold "
                    f"{component} at {iso(key[0])} with the same lead; keep one member"
                )
            nodes = _nodes_of(message, file, scan)
            pair[component] = _Component(_values(message)[nodes.kept], nodes, file)
    if found:
        return
    level, there = scan.level, "expected GRIB messages UGRD and VGRD"
    if level in levels:
        kinds = " and ".join(sorted(scan.left_out))
        raise DataError(
            f"wind file {file} holds the wind {level.phrase} as {kinds} only; expected values of an instant"
        )
    if levels:
        there = f"it has {level_list(levels)}: set wind.level to one of them"
    raise DataError(f"wind file {file} holds no wind {level.phrase}; {there}")


def _component(message: Message) -> str | None:
    if message["edition"] == 2:
        keys = ("discipline", "parameterCategory", "parameterNumber")
        return NUMBERED.get(tuple(message[key] for key in keys))
    found = NAMED.fullmatch(str(message["shortName"]))
    return None if found is None else found[1] or found[2]


def _is_wanted(message: Message, component: str, scan: _Scan, levels: list[Level]) -> bool:
    """Whether the message has the wanted level and values of an instant; others are recorded."""
    kind, other = message["typeOfLevel"], _other_kind(message)
    if component == SURFACE_PRESSURE:
        return scan.level.kind == PRESSURE and kind == "surface" and other is None
    if kind not in LEVELS:
        return False
    level = Level(LEVELS[kind][0], message["level:float"] * LEVELS[kind][1])
    levels.append(level)
    if level == scan.level and other is not None:
        scan.left_out[other] += 1
    return level == scan.level and other is None


def _other_kind(message: Message) -> str | None:
    """Kind of a value that is not of an instant, e.g. ``average`` or ``spread of members``; else None."""
    step = str(message["stepType"])
    if step != "instant":
        return STEP_TYPES.get(step, step)
    return None if message.get("derivedForecast", MEANS[0]) in MEANS else "spread of members"


def _member(message: Message) -> str:
    if "derivedForecast" in message:
        return "mean"
    number = message.get("perturbationNumber")
    return "" if number is None else f"{number:02d}"


def _values(message: Message) -> FloatArray:
    values = np.array(message["values"], dtype=float)
    if message["bitmapPresent"]:
        values[values == message["missingValue:float"]] = np.nan
    return values


def _nodes_of(message: Message, file: Path, scan: _Scan) -> Nodes:
    """The nodes of the grid of ``message`` that are in the area."""
    grid = str(message["md5GridSection"])
    if grid not in scan.grids:
        lon, lat = (np.asarray(message[name], float) for name in ("longitudes", "latitudes"))
        nodes = crop(file, lon, lat, scan.area)
        if message["uvRelativeToGrid"] and message["gridType"] not in EARTH_AXES:
            twist = meridian_convergence(_grid_crs(message, file), *nodes.lonlat.T)
            nodes = nodes._replace(twist=twist)
        scan.grids[grid] = nodes
    return scan.grids[grid]


def _grid_crs(message: Message, file: Path) -> str:
    """PROJ string of the projection of the model; directions do not depend on the radius of the sphere."""
    if (kind := message["gridType"]) in PROJECTED:
        return re.sub(r"\+[abR]=\S+", "", message["projString"]) + " +R=6371229 +no_defs"
    raise DataError(
        f"wind file {file}: winds follow a grid of type {kind}, which cannot be turned to the east; "
        f"expected {', '.join(PROJECTED)} or a latitude-longitude grid"
    )


@contextmanager
def _grib_messages(file: Path) -> Iterator[Iterator[Message]]:
    """In the block, the messages of a file, with their times in seconds since 1970."""
    import pyproj  # noqa: F401 - before ecCodes: each contains a PROJ, and the other order can crash

    try:
        import cfgrib
        import eccodes
    except (ImportError, RuntimeError):
        raise DataError(missing_extra("grib", f"reading GRIB ({file})")) from None
    with wind_file(file, "GRIB", eccodes.CodesInternalError), suppress(EOFError):  # EOFError: no message
        with file.open("rb") as stream:
            check_frames(file, stream)
        stream = cfgrib.FileStream(str(file), errors="raise")  # NAM nests pack u and v in one message
        computed = cfgrib.COMPUTED_KEYS
        yield (cfgrib.messages.ComputedKeysAdapter(message, computed) for _, message in stream.items())


# --- lengths of messages, of their sections, and numbers of values -----------------------------


class _BrokenFrameError(ValueError):
    """A message with inconsistent lengths."""


def check_frames(file: Path, stream: BinaryIO) -> None:
    """Raise a DataError if a message of ``stream``, an open GRIB file, is damaged; rewind the stream."""
    place = 0
    while (start := _next_start(stream, place)) is not None:
        try:
            place = start + _message_length(stream, start)
        except _BrokenFrameError as error:
            raise DataError(
                f"wind file {file} is damaged or truncated (message at byte {start}: {error}); "
                "download it again"
            ) from None
    stream.seek(0)


def _next_start(stream: BinaryIO, place: int) -> int | None:
    """Position of the next message, None if there is none; there may be other bytes between messages."""
    while True:
        stream.seek(place)
        block = stream.read(BLOCK)
        if (found := block.find(START)) >= 0:
            return place + found
        if len(block) < BLOCK:
            return None
        place += BLOCK - len(START) + 1


def _message_length(stream: BinaryIO, start: int) -> int:
    head = _bytes_at(stream, start, 16)
    if head[7] == 2:
        length = int.from_bytes(head[8:16], "big")
        _check_sections(stream, start + 16, start + length - len(END))
    elif head[7] == 1:
        length = int.from_bytes(head[4:7], "big")
        if length & 0x800000:
            raise _BrokenFrameError("edition 1 with more than 8 MiB; expected GRIB2")
        _check_old_sections(stream, start + 8, start + length - len(END))
    else:
        raise _BrokenFrameError(f"edition {head[7]}; expected 1 or 2")
    if length < len(head) + len(END):
        raise _BrokenFrameError(f"it claims to have {length} bytes")
    if _bytes_at(stream, start + length - len(END), len(END)) != END:
        raise _BrokenFrameError("it does not end with 7777")
    return length


def _check_sections(stream: BinaryIO, place: int, end: int) -> None:
    """Check the sections of edition 2: 4 bytes of length, 1 byte of number."""
    packed = 0  # least size in bytes of the values of the next section 7
    while place < end:
        head = _bytes_at(stream, place, 5)
        length, number = int.from_bytes(head[:4], "big"), head[4]
        if length < 5 or not 1 <= number <= 7 or place + length > end:
            raise _BrokenFrameError(f"no section begins at byte {place}")
        if number in COUNT_PLACE:
            count = int.from_bytes(_bytes_at(stream, place + COUNT_PLACE[number], 4), "big")
            if count > MAX_NODES:
                raise _BrokenFrameError(f"it claims {count:,} values; {MAX_NODES:,} are the limit")
        if number == 5:
            packed = _packed_bytes(_bytes_at(stream, place, length))
        if number == 7 and length - 5 < packed:
            raise _BrokenFrameError(f"its values take {packed:,} bytes, but there are {length - 5:,}")
        place += length


def _packed_bytes(section: bytes) -> int:
    """Size in bytes of values with simple packing (template 5.0); 0 for other packings (not known)."""
    if len(section) < 20:
        raise _BrokenFrameError("section 5 is too short")
    count, template, bits = int.from_bytes(section[5:9], "big"), section[9:11], section[19]
    if bits > MAX_BITS:
        raise _BrokenFrameError(f"{bits} bits a value; {MAX_BITS} are the limit")
    return -(-count * bits // 8) if template == b"\0\0" else 0


def _check_old_sections(stream: BinaryIO, place: int, end: int) -> None:
    """Check the sections of edition 1: 3 bytes of length; flags in the first one say which others exist."""
    first = _bytes_at(stream, place, 8)
    sections = 2 + bool(first[7] & 128) + bool(first[7] & 64)
    for _ in range(sections):
        length = int.from_bytes(_bytes_at(stream, place, 3), "big")
        if length < 3:
            raise _BrokenFrameError(f"no section begins at byte {place}")
        place += length
    if place > end:
        raise _BrokenFrameError("a section is longer than its message")


def _bytes_at(stream: BinaryIO, place: int, count: int) -> bytes:
    stream.seek(max(0, place))
    found = stream.read(count)
    if len(found) < count:
        raise _BrokenFrameError("the file ends within it")
    return found


if __name__ == "__main__":
    _answer(sys.argv[1], Path(sys.argv[2]))
