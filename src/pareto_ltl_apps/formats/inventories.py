"""Inventories of GRIB files on servers: which field is in which bytes.

NOAA publishes ``FILE.idx``, made by wgrib2. A line is
``588:428651621:d=2023110400:UGRD:10 m above ground:21 hour fcst:``; the number has two parts (``77.1``,
``77.2``) if a message contains several fields. The last column is empty for a value itself; ``ENS=+1`` is a
member of an ensemble, ``ens std dev``, ``prob >5`` and ``10% level`` are statistics, which are no wind.

ECMWF publishes ``FILE.index``, one JSON object a line with keys of MARS:
``{"type": "pf", "step": "24", "levtype": "sfc", "number": "1", "param": "10u", "_offset": 0, "_length": 9}``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from careful_io.messages import shown_text
from flight_quantities.levels import HEIGHT, PRESSURE, Level, level_list
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.download import ByteRange
from pareto_ltl_apps.formats.flow_components import FROM, SPEED, U, V
from pareto_ltl_apps.formats.quantities import SURFACE_PRESSURE

MAX_LINES = 20_000
FARTHEST = 2**40  # [bytes] largest position of a message
LINE = re.compile(r"(\d+(?:\.\d+)?):(\d+):d=(\d{10})\d*:([^:]*):([^:]*):([^:]*):?(.*)")
HEIGHT_TEXT = re.compile(r"(\d+(?:\.\d+)?) m above ground")
PRESSURE_TEXT = re.compile(r"(\d+(?:\.\d+)?) mb")
INSTANT = re.compile(r"anl|analysis|\d+ (?:min|hour|day) fcst")
MEMBER = re.compile(r"(?:ENS=.*)?")  # the last column of a value itself
VARIABLES = {"UGRD": U, "VGRD": V, "WIND": SPEED, "WDIR": FROM}
PAIRS = ((U, V), (SPEED, FROM))
ECMWF_WIND = re.compile(r"(\d*)([uv])")  # 10u, 100u; u on a pressure level
ECMWF_TYPES = ("an", "fc", "cf", "pf")  # not em and es, mean and spread of an ensemble
ECMWF_EXPECTED = 'expected {"param": "10u", "levtype": "sfc", ..., "_offset": 0, "_length": 9}'


@dataclass(frozen=True, slots=True)
class InventoryEntry:
    """One field.

    Attributes
    ----------
    component : str
        A component of a wind, or the surface pressure; empty for anything else.
    level : Level or None
        Height above ground or pressure; None if it is neither.
    part : ByteRange
        The bytes of its message.
    member : int or None
        Number of the ensemble member, in inventories of files with several members.
    """

    component: str
    level: Level | None
    part: ByteRange
    member: int | None = None


def parse_inventory(text: str, where: str) -> tuple[InventoryEntry, ...]:
    """The fields of an inventory of NOAA or, if its name ``where`` ends in ``.index``, of ECMWF.

    Raises
    ------
    DataError
        If it is empty or not an inventory, or if its offsets are not in order; ``where`` begins the message.
    """
    if text.lstrip()[:1] == "<":
        raise DataError(f"{where} is a web page, not an inventory; try again later, or another wind.base_url")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if not lines:
        raise DataError(f"{where} is empty; the file is not whole yet: try again later")
    if len(lines) > MAX_LINES:
        raise DataError(f"{where} has more than {MAX_LINES:,} lines; expected an inventory of a GRIB2 file")
    parse = _ecmwf_entries if where.endswith(".index") else _noaa_entries
    return tuple(parse(lines, where))


def _noaa_entries(lines: list[str], where: str) -> Iterator[InventoryEntry]:
    found = []
    for number, line in enumerate(lines, 1):
        match = LINE.fullmatch(line)
        if match is None or int(match[2]) > FARTHEST:
            raise DataError(
                f"{where}, line {number}: {shown_text(line, 60)!r} is not a line of an inventory; expected "
                "NUMBER:OFFSET:d=DATE:VARIABLE:LEVEL:FORECAST:"
            )
        found.append(match)
    offsets = [int(match[2]) for match in found]
    if any(later < earlier for earlier, later in pairwise(offsets)):
        raise DataError(f"{where}: offsets do not increase; try again later")
    starts = sorted(set(offsets))
    ends = dict(zip(starts, [start - 1 for start in starts[1:]], strict=False))
    for match, offset in zip(found, offsets, strict=True):
        variable, level, forecast, rest = match.groups()[3:]
        component = VARIABLES.get(variable, "")
        if not INSTANT.fullmatch(forecast) or not MEMBER.fullmatch(rest):
            component = ""
        if (variable, level) == ("PRES", "surface"):
            component = SURFACE_PRESSURE
        yield InventoryEntry(component, _noaa_level(level), ByteRange(offset, ends.get(offset)))


def _noaa_level(text: str) -> Level | None:
    if found := HEIGHT_TEXT.fullmatch(text):
        return Level(HEIGHT, float(found[1]))
    if found := PRESSURE_TEXT.fullmatch(text):
        return Level(PRESSURE, float(found[1]) * 100.0)
    return None


def _ecmwf_entries(lines: list[str], where: str) -> Iterator[InventoryEntry]:
    for number, line in enumerate(lines, 1):
        try:
            keys = json.loads(line)
            first, length = keys["_offset"], keys["_length"]
            if (
                type(first) is not int
                or type(length) is not int
                or not 0 <= first < first + length < FARTHEST
            ):
                raise ValueError
            yield _ecmwf_entry(keys, ByteRange(first, first + length - 1))
        except (ValueError, TypeError, KeyError, RecursionError):
            found = f"{where}, line {number}: {shown_text(line, 60)!r}"
            raise DataError(f"{found} is not a line of an index; {ECMWF_EXPECTED}") from None


def _ecmwf_entry(keys: dict[str, Any], part: ByteRange) -> InventoryEntry:
    param, kind = str(keys["param"]), str(keys["levtype"])
    member = int(keys["number"]) if "number" in keys else None
    wind = ECMWF_WIND.fullmatch(param)
    if str(keys.get("type", "fc")) not in ECMWF_TYPES:
        return InventoryEntry("", None, part, member)
    if wind and kind == "sfc" and wind[1]:
        return InventoryEntry(wind[2], Level(HEIGHT, float(wind[1])), part, member)
    if wind and kind == "pl" and not wind[1]:
        return InventoryEntry(wind[2], Level(PRESSURE, float(keys["levelist"]) * 100.0), part, member)
    return InventoryEntry(SURFACE_PRESSURE if (param, kind) == ("sp", "sfc") else "", None, part, member)


def wind_parts(
    entries: tuple[InventoryEntry, ...], level: Level, where: str, members: tuple[int, ...] = ()
) -> tuple[ByteRange, ...]:
    """Bytes of the wind at ``level``, of all ``members``; for a pressure also of the surface pressure.

    Neighbouring messages are one range.

    Raises
    ------
    DataError
        If a component is missing; the message lists the levels of the file.
    """
    parts: list[ByteRange] = []
    for member in members or (None,):
        these = [entry for entry in entries if member is None or entry.member == member]
        here: dict[str, ByteRange] = {}
        for entry in these:
            if entry.component and entry.level == level:
                here.setdefault(entry.component, entry.part)
        pair = next((pair for pair in PAIRS if here.keys() >= set(pair)), None)
        if pair is None:
            raise _lacks_wind(these, here, level, f"{where} lists", member)
        parts += [here[component] for component in pair]
        if level.kind == PRESSURE:
            parts += [entry.part for entry in these if entry.component == SURFACE_PRESSURE][:1]
    return _joined(parts)


def _lacks_wind(
    entries: list[InventoryEntry], here: dict[str, ByteRange], level: Level, lists: str, member: int | None
) -> DataError:
    levels = [entry.level for entry in entries if entry.component in (U, SPEED) and entry.level]
    whose = "" if member is None else f" of member {member}"
    if here:
        lacks = f"{lists} {' and '.join(sorted(here))} {level.phrase}{whose} without its counterpart"
        return DataError(f"{lacks}; the file is not whole yet: try again later")
    advice = "set wind.level to one of them, or take another model" if levels else "take another model"
    return DataError(
        f"{lists} no wind {level.phrase}{whose}; it has {level_list(levels) or 'no wind'}: {advice}"
    )


def _joined(parts: list[ByteRange]) -> tuple[ByteRange, ...]:
    """``parts`` in their order in the file, those that touch as one."""
    joined: list[ByteRange] = []
    for part in sorted(set(parts), key=lambda part: part.first):
        if joined and joined[-1].last is not None and joined[-1].last + 1 == part.first:
            joined[-1] = ByteRange(joined[-1].first, part.last)
        else:
            joined.append(part)
    return tuple(joined)
