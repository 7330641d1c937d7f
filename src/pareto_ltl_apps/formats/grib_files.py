"""Wind at one level from GRIB files (GFS, GEFS, NAM, RAP, HRRR), read with cfgrib in a separate process.

The messages of cfgrib are used one by one. Its datasets are not: a dataset fills a component that is missing
in a truncated file with NaN, and of two messages for one time it keeps one.

Since ecCodes can end its process on a damaged message, files are decoded in another process:
``python -m pareto_ltl_apps.formats.grib_files TASK ANSWER`` gets the arguments of :func:`grib_snapshots` as
JSON. It prints each file before it is opened, and writes one archive of arrays, which holds no code. If the
process ends without it, the caller raises a DataError on the file that was open.

The frames of a file are checked before ecCodes opens it (:mod:`.grib_frames`).
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.faults import Faults
from careful_io.times import iso
from flight_quantities.atmosphere import temperature_scale
from flight_quantities.levels import DEPTH, HEIGHT, PRESSURE, Level, level_list, nearest_level
from pareto_ltl.extend import GeoBox, NodeAir, Snapshot
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.extras import EXTRAS
from pareto_ltl.support.file_formats import wind_file
from pareto_ltl.support.levels import wind_level
from pareto_ltl_apps.formats.flow_components import SPEED, TEMPERATURE, U
from pareto_ltl_apps.formats.grib_frames import check_frames
from pareto_ltl_apps.formats.grid_directions import twist_of_grib
from pareto_ltl_apps.formats.quantities import (
    CURRENTS,
    OF_AIR,
    SURFACE_PRESSURE,
    WINDS,
    Component,
    Fields,
    Key,
    Quantity,
    level_gap,
    other_quantity,
    wanted_level,
    winds_of,
)
from pareto_ltl_apps.formats.snapshots import Nodes, Snapshots, crop, earth_relative, same_values

UNITS = ("m s**-1", "m s-1", "m/s", "Degree true", "degrees", "unknown")  # of the parameters of the WMO
AIR_NUMBERS = {(0, 3, 0): SURFACE_PRESSURE, (0, 0, 0): TEMPERATURE, (11,): TEMPERATURE}  # as in Quantity
NAMED = re.compile(r"(?:\d+)?([uv])|(sp)|(?:2)?(t)")  # short names of edition 1: u, 10u, 100v, 2t
LAST_WMO_TABLE = 3  # of edition 1, whose numbers of winds and currents the WMO defines
MEANS = (0, 1, 6)  # code table 4.7: means of the members; other statistics of an ensemble are not a wind
LEVELS = {
    HEIGHT: {
        "heightAboveGround": (HEIGHT, 1.0),
        "isobaricInhPa": (PRESSURE, 100.0),
        "isobaricInPa": (PRESSURE, 1.0),
    },
    DEPTH: {
        "depthBelowSea": (DEPTH, 1.0),
        **dict.fromkeys(("oceanSurface", "surface", "meanSea"), (DEPTH, 0.0)),
    },
}  # by the meaning of lengths
STEP_TYPES = {"avg": "average", "max": "maximum", "min": "minimum"}
LAWS = {"edzw": "icon_eu", "ecmf": "ecmwf_class"}  # packaged law of forecast errors, by originating centre
HOURLY = ("kwbc", 83)  # HRRR: centre, and number of the generating process
Message = Any  # of cfgrib: a mapping of keys of ecCodes


@dataclass(slots=True)
class _Scan:
    """The wanted fields, and a record of what else the files contain.

    Attributes
    ----------
    quantity : Quantity
    level : Level
    area : GeoBox or None
    fields : dict
        Components by level, then by time, lead [s] and member.
    temperatures : dict
        The same of temperatures.
    grids : dict
        Grids that are decoded already, by their fingerprint.
    left_out : Counter
        Numbers of winds at the level that are not values of an instant, by kind, e.g. ``average``.
    twice : int
        Number of messages that are in the files once more.
    laws : set of str
        Packaged laws of forecast errors of the models of the winds; an empty text if there is none.
    """

    quantity: Quantity
    level: Level
    area: GeoBox | None
    fields: dict[Level, Fields] = field(default_factory=dict)
    temperatures: dict[Level, Fields] = field(default_factory=dict)
    grids: dict[str, Nodes] = field(default_factory=dict)
    left_out: Counter[str] = field(default_factory=Counter)
    twice: int = 0
    laws: set[str] = field(default_factory=set)


def grib_snapshots_apart(
    files: tuple[Path, ...],
    max_speed: float,
    level: str = "10m",
    area: GeoBox | None = None,
    quantity: Quantity = WINDS,
) -> Snapshots:
    """:func:`grib_snapshots` in another process.

    Raises
    ------
    DataError
        As :func:`grib_snapshots`, and if the process ends without an answer.
    """
    wind_level(level)
    box = None if area is None else astuple(area)
    reported, arrays = _apart(files, max_speed, level, box, quantity.name)
    winds = tuple(
        Snapshot(
            *(time, lead, arrays[points], arrays[winds], wind_level, tuple(map(Path, names)), member),
            None if air is None else NodeAir(*(arrays.get(x, x) for x in air)),
        )
        for time, lead, points, winds, wind_level, names, member, air in reported["winds"]
    )
    return Snapshots(winds, files, tuple(reported["notes"]), reported["law"])


def grib_levels_apart(files: tuple[Path, ...], quantity: Quantity) -> set[Level]:
    """The levels at which GRIB ``files`` have ``quantity`` at instants; errors as of the readings."""
    reported, _ = _apart(files, 0.0, None, None, quantity.name)
    return {Level(kind, value) for kind, value in reported["levels"]}


def _apart(files: tuple[Path, ...], *task: Any) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """What :func:`_answer` says of ``task`` in another process, and its arrays."""
    with tempfile.TemporaryDirectory(prefix="pareto_ltl_grib_") as folder:
        answer = Path(folder) / "answer.npz"
        words = json.dumps([[str(file) for file in files], *task])
        command = [sys.executable, "-m", __name__, words, str(answer)]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        if not answer.is_file():
            at = done.stdout.splitlines()[-1:] or [str(files[0])]
            raise DataError(
                f"wind file {at[0]} is damaged: ecCodes, its decoder, ended with code {done.returncode}; "
                "download it again"
            )
        with np.load(answer, allow_pickle=False) as archive:
            arrays = dict(archive)
    reported = json.loads(arrays["told"].item())
    if "error" in reported:
        raise DataError(reported["error"])
    return reported, arrays


def _answer(task: str, answer: Path) -> None:
    """In the separate process: carry out ``task``; arrays that snapshots share are written once."""
    names, max_speed, level, box, name = json.loads(task)
    quantity = WINDS if name == WINDS.name else CURRENTS
    files, area = tuple(map(Path, names)), None if box is None else GeoBox(*box)
    arrays: dict[str, FloatArray] = {}

    def name_of(array: FloatArray) -> str:
        arrays[name := f"array_{id(array)}"] = array
        return name

    def named(values: Iterable[Any]) -> list[Any]:
        return [name_of(value) if isinstance(value, np.ndarray) else value for value in values]

    def tell(file: Path) -> None:
        print(file, flush=True)

    try:
        found = (
            Snapshots((), files, ())
            if level is None
            else grib_snapshots(files, max_speed, level, area, tell, quantity)
        )
        there = grib_levels(files, quantity, tell) if level is None else set()
        winds = [
            (
                *named((w.time, w.lead, w.points, w.winds, w.level)), list(map(str, w.files)), w.member,
                None if w.air is None else named(w.air),
            )
            for w in found.winds
        ]  # fmt: skip
        reported: dict[str, Any] = {"winds": winds, "notes": found.notes, "law": found.law}
        reported["levels"] = sorted(map(astuple, there))
    except (DataError, ConfigError) as error:
        reported = {"error": str(error)}
    part = answer.with_suffix(".part")
    with part.open("wb") as stream:
        np.savez(stream, told=np.array(json.dumps(reported)), **arrays)  # type: ignore[arg-type]
    part.rename(answer)


def grib_snapshots(
    files: tuple[Path, ...],
    max_speed: float,
    level: str = "10m",
    area: GeoBox | None = None,
    tell: Callable[[Path], None] = lambda _: None,
    quantity: Quantity = WINDS,
) -> Snapshots:
    """Every wind at ``level`` in ``files``, with notes of quality control.

    ``tell`` is called with each file before it is opened.

    Raises
    ------
    DataError
        If a file is damaged, has no wind at the level or lacks a component, or if two messages have the same
        component, time, lead and member.
    """
    scan = _Scan(quantity, wanted_level(quantity, level), area)
    faults = Faults.of_files("wind file", files)
    for file in files:
        tell(file)
        with faults.noted():
            _scan_file(file, scan)
    faults.refuse()
    notes = [
        f"{count} GRIB messages hold the {kind} of the wind, not its value at an instant: left out"
        for kind, count in sorted(scan.left_out.items())
    ]
    if scan.twice:
        notes.append(f"{scan.twice} GRIB messages occur twice with the same values: read once")
    there = [level for level, fields in scan.fields.items() if any(map(_has_wind, fields.values()))]
    at = min(there, key=lambda found: abs(found.value - scan.level.value))
    _add_temperatures(scan, at)
    if at.text != scan.level.text:
        notes.append(f"the level {at.text} is used for {scan.level.text}")
    found = earth_relative(winds_of(scan.fields[at], at), files, at, max_speed, notes)
    return found._replace(law=next(iter(scan.laws)) if len(scan.laws) == 1 else "")


def grib_levels(files: tuple[Path, ...], quantity: Quantity, tell: Callable[[Path], None]) -> set[Level]:
    """The levels at which ``files`` have ``quantity``, not its means; ``tell`` as of the fields."""
    there: set[Level] = set()
    for file in files:
        tell(file)
        with _grib_messages(file) as messages:
            for message in messages:
                if _component(message, quantity) in (None, *OF_AIR) or _other_kind(message) is not None:
                    continue
                if (level := _level_of(message, quantity.length)) is not None:
                    there.add(level)
    return there


def _has_wind(parts: dict[str, Component]) -> bool:
    return bool(parts.keys() - OF_AIR)


def _add_temperatures(scan: _Scan, at: Level) -> None:
    """Add the temperatures that belong to the winds at the level ``at``."""
    level = nearest_level(list(scan.temperatures), at)
    for key, pair in {} if level is None else scan.temperatures[level].items():
        if key in scan.fields[at]:
            scan.fields[at][key] |= pair


def _scan_file(file: Path, scan: _Scan) -> None:
    """Add the wanted fields in ``file``; a DataError if there are none."""
    levels: list[Level] = []
    found = False
    others: set[str] = set()
    faults = Faults(f"wind file {file}")
    with _grib_messages(file) as messages:
        for message in messages:
            component = _component(message, scan.quantity)
            if component == TEMPERATURE:
                _add_temperature(message, file, scan)
                continue
            if component is None:
                others |= {
                    other.name for other in (WINDS, CURRENTS) if _component(message, other) in (U, SPEED)
                }
                continue
            level = _wanted_level_of(message, component, scan, levels)
            if level is None:
                continue
            found = found or component != SURFACE_PRESSURE
            with faults.noted():
                _add(message, component, level, file, scan)
    faults.refuse()
    if not found:
        raise _nothing_found(file, scan, levels, others)


def _add_temperature(message: Message, file: Path, scan: _Scan) -> None:
    """Add a temperature of an instant near the level of the wind; the first one of each time counts."""
    level = _level_of(message, HEIGHT)
    if level is None or nearest_level([level], scan.level) is None or _other_kind(message) is not None:
        return
    if (scale := temperature_scale(message["units"])) is None:
        raise DataError(
            f"wind file {file}: the temperature is in {message['units']}; expected K: convert the file"
        )
    nodes = _nodes_of(message, file, scan)
    values = _values(message)[nodes.kept] * scale[0] + scale[1]
    pair = scan.temperatures.setdefault(level, {}).setdefault(_key(message), {})
    pair.setdefault(TEMPERATURE, Component(values, nodes, file, level.text))


def _law_of(message: Message) -> str:
    """The packaged law that fits the model of a message; empty if there is none."""
    centre, process = (message.get(key) for key in ("centre", "generatingProcessIdentifier"))
    return "hourly_fine" if (centre, process) == HOURLY else LAWS.get(str(centre), "")


def _key(message: Message) -> Key:
    """Time, lead and member of a field."""
    time, begin = float(message["valid_time"]), float(message["time"])
    return time, time - begin, _member(message)


def _add(message: Message, component: str, level: Level, file: Path, scan: _Scan) -> None:
    """Add one field; of two with the same values, one."""
    if component != SURFACE_PRESSURE and (unit := message["units"]) not in UNITS:
        raise DataError(f"wind file {file}: {component} is in {unit}; expected m s-1: convert the file")
    if component != SURFACE_PRESSURE:
        scan.laws.add(_law_of(message))
    key = _key(message)
    pair = scan.fields.setdefault(level, {}).setdefault(key, {})
    nodes = _nodes_of(message, file, scan)
    values = _values(message)[nodes.kept]
    if component in pair and component != SURFACE_PRESSURE:
        if pair[component].nodes is not nodes or not same_values(pair[component].values, values):
            raise DataError(
                f"wind files {pair[component].file.name} and {file.name} both hold "
                f"{component} at {iso(key[0])} with the same lead and other values; keep one member"
            )
        scan.twice += 1
        return
    pair[component] = Component(values, nodes, file)


def _nothing_found(file: Path, scan: _Scan, levels: list[Level], others: set[str]) -> DataError:
    """The error for a file without a wanted field, with what it has instead."""
    level, name = scan.level, scan.quantity.name
    there = "expected GRIB messages UGRD and VGRD, or WIND and WDIR"
    if scan.quantity is CURRENTS:
        there = "expected GRIB messages UOGRD and VOGRD, or SPC and DIRC"
    if level in levels:
        kinds = " and ".join(sorted(scan.left_out))
        return DataError(
            f"wind file {file} holds the {name} {level.phrase} as {kinds} only; expected values of an instant"
        )
    if levels:
        there = f"it has {level_list(levels)}: set wind.level to one of them"
    elif other_quantity(scan.quantity).name in others:
        other = other_quantity(scan.quantity)
        there = f"it holds a {other.name}: set wind={other.grib_source}"
    return DataError(f"wind file {file} holds no {name} {level.phrase}; {there}")


def _component(message: Message, quantity: Quantity) -> str | None:
    if message["edition"] == 2:
        keys = ("discipline", "parameterCategory", "parameterNumber")
        return _numbers(quantity).get(tuple(message[key] for key in keys))
    number = (message["indicatorOfParameter"],)
    if message["table2Version"] <= LAST_WMO_TABLE and number in _numbers(quantity):
        return _numbers(quantity)[number]
    found = NAMED.fullmatch(str(message["shortName"])) if quantity is WINDS else None
    return None if found is None else found[1] or (SURFACE_PRESSURE if found[2] else TEMPERATURE)


def _numbers(quantity: Quantity) -> dict[tuple[int, ...], str]:
    return quantity.numbers | AIR_NUMBERS if quantity is WINDS else quantity.numbers


def _wanted_level_of(message: Message, component: str, scan: _Scan, levels: list[Level]) -> Level | None:
    """The level if the message has a wanted one and values of an instant; else None, and it is recorded."""
    kind, other = message["typeOfLevel"], _other_kind(message)
    if component == SURFACE_PRESSURE:
        return scan.level if kind == "surface" and other is None else None
    level = _level_of(message, scan.quantity.length)
    if level is None:
        return None
    levels.append(level)
    gap = level_gap(level, scan.level, scan.quantity.nearest)
    if gap is None or (gap and not scan.quantity.nearest):
        return None
    if other is not None:
        scan.left_out[other] += 1
        return None
    return level


def _level_of(message: Message, length: str) -> Level | None:
    """The level of a message, whose lengths mean ``length``; None for other kinds of levels."""
    kind = LEVELS[length].get(message["typeOfLevel"])
    return None if kind is None else Level(kind[0], float(message["level:float"]) * kind[1])


def _other_kind(message: Message) -> str | None:
    """Kind of a value that is not of an instant, e.g. ``average`` or ``spread of members``; else None."""
    step = str(message["stepType"])
    if step != "instant":
        return STEP_TYPES.get(step, step)
    for key, kind in (("percentileValue", "percentile"), ("probabilityType", "probability")):
        if message.get(key) is not None:
            return kind
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
        if message.get("angleOfRotation"):
            raise DataError(
                f"wind file {file}: the rotated grid is turned about its own pole by "
                f"{message['angleOfRotation']:g} degrees, which ecCodes does not apply; convert the file to "
                "a latitude-longitude grid"
            )
        scan.grids[grid] = nodes._replace(twist=twist_of_grib(f"wind file {file}", message.get, nodes.lonlat))
    return scan.grids[grid]


@contextmanager
def _grib_messages(file: Path) -> Iterator[Iterator[Message]]:
    """In the block, the messages of a file, with their times in seconds since 1970."""
    import pyproj  # noqa: F401 - before ecCodes: each contains a PROJ, and the other order can crash

    try:
        import cfgrib
        import eccodes
    except (ImportError, RuntimeError):
        raise DataError(EXTRAS.missing("grib", f"reading GRIB ({file})")) from None
    with wind_file(file, "GRIB", eccodes.CodesInternalError), suppress(EOFError):  # EOFError: no message
        with file.open("rb") as stream:
            check_frames(file, stream)
        stream = cfgrib.FileStream(str(file), errors="raise")  # NAM nests pack u and v in one message
        computed = cfgrib.COMPUTED_KEYS
        yield (cfgrib.messages.ComputedKeysAdapter(message, computed) for _, message in stream.items())


if __name__ == "__main__":
    _answer(sys.argv[1], Path(sys.argv[2]))
