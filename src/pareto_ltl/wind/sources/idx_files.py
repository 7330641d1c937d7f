"""Inventories (.idx) of GRIB2 files on NOAA's servers, which list the position of each message.

A line is ``588:428651621:d=2023110400:UGRD:10 m above ground:21 hour fcst:``. The number has two parts
(``77.1``, ``77.2``) if a message contains several fields.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise

from pareto_ltl.support.download import ByteRange
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.wind.levels import HEIGHT, PRESSURE, Level, level_list

MOST_LINES = 20_000
LINE = re.compile(r"(\d+(?:\.\d+)?):(\d+):d=(\d{10})\d*:([^:]*):([^:]*):([^:]*):?.*")
HEIGHT_TEXT = re.compile(r"(\d+(?:\.\d+)?) m above ground")
PRESSURE_TEXT = re.compile(r"(\d+(?:\.\d+)?) mb")
INSTANT = re.compile(r"anl|analysis|\d+ (?:min|hour|day) fcst")
FARTHEST = 2**40  # [bytes] largest position of a message


@dataclass(frozen=True, slots=True)
class IdxEntry:
    """One field: its variable (``UGRD``), level and time as texts, and the bytes of its message."""

    variable: str
    level: str
    forecast: str
    part: ByteRange


def parse_idx(text: str, where: str) -> tuple[IdxEntry, ...]:
    """The entries of an inventory; ``where`` begins every error message.

    Raises
    ------
    DataError
        If it is empty or not an inventory, or if its offsets are not in order.
    """
    if text.lstrip()[:1] == "<":
        raise DataError(f"{where} is a web page, not an inventory; try again later, or another wind.base_url")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if not lines:
        raise DataError(f"{where} is empty; the file is not whole yet: try again later")
    if len(lines) > MOST_LINES:
        raise DataError(f"{where} has more than {MOST_LINES:,} lines; expected an inventory of a GRIB2 file")
    found = []
    for number, line in enumerate(lines, 1):
        match = LINE.fullmatch(line)
        if match is None or int(match[2]) > FARTHEST:
            raise DataError(
                f"{where}, line {number}: {shown_text(line, 60)!r} is not a line of an inventory; expected "
                "NUMBER:OFFSET:d=DATE:VARIABLE:LEVEL:FORECAST:"
            )
        found.append((int(match[2]), match[4], match[5], match[6]))
    offsets = [offset for offset, *_ in found]
    if any(later < earlier for earlier, later in pairwise(offsets)):
        raise DataError(f"{where}: offsets do not increase; try again later")
    starts = sorted(set(offsets))
    ends = dict(zip(starts, [start - 1 for start in starts[1:]], strict=False))
    return tuple(IdxEntry(v, lv, fc, ByteRange(offset, ends.get(offset))) for offset, v, lv, fc in found)


def wind_parts(entries: tuple[IdxEntry, ...], level: Level, where: str) -> tuple[ByteRange, ...]:
    """Bytes of the messages with both components at ``level``; for a pressure also the surface pressure.

    Raises
    ------
    DataError
        If a component is missing; the message lists the levels of the file.
    """
    parts: list[ByteRange] = []
    levels = [told for entry in entries if entry.variable == "UGRD" and (told := entry_level(entry.level))]
    for variable in ("UGRD", "VGRD"):
        fitting = [
            entry.part
            for entry in entries
            if entry.variable == variable
            and entry_level(entry.level) == level
            and INSTANT.fullmatch(entry.forecast)
        ]
        if not fitting:
            raise DataError(
                f"{where} lists no {variable} {level.phrase}; it has {level_list(levels) or 'no wind'}: set "
                "wind.level to one of them, or take another wind.model"
            )
        parts.append(fitting[0])
    if level.kind == PRESSURE:
        surface = [entry.part for entry in entries if (entry.variable, entry.level) == ("PRES", "surface")]
        parts += surface[:1]
    return tuple(dict.fromkeys(parts))


def entry_level(text: str) -> Level | None:
    """The level of an entry; None if it is neither a height above ground nor a pressure."""
    if found := HEIGHT_TEXT.fullmatch(text):
        return Level(HEIGHT, float(found[1]))
    if found := PRESSURE_TEXT.fullmatch(text):
        return Level(PRESSURE, float(found[1]) * 100.0)
    return None
