"""Forecast models in NOAA's public archives: addresses and times of their files, and their inventories.

The addresses name the NOAA Open Data Dissemination buckets on S3,
https://registry.opendata.aws/noaa-gfs-bdp-pds/.

An inventory (.idx) lists the position of each message of a GRIB2 file. A line is
``588:428651621:d=2023110400:UGRD:10 m above ground:21 hour fcst:``. The number has two parts (``77.1``,
``77.2``) if a message contains several fields.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise

from pareto_ltl.support.download import ByteRange
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.levels import HEIGHT, PRESSURE, Level, level_list
from pareto_ltl.wind.readings import HOUR

OLDEST_CYCLE = 48  # [h] older cycles are not searched for
MOST_LINES = 20_000
LINE = re.compile(r"(\d+(?:\.\d+)?):(\d+):d=(\d{10})\d*:([^:]*):([^:]*):([^:]*):?.*")
HEIGHT_TEXT = re.compile(r"(\d+(?:\.\d+)?) m above ground")
PRESSURE_TEXT = re.compile(r"(\d+(?:\.\d+)?) mb")
INSTANT = re.compile(r"anl|analysis|\d+ (?:min|hour|day) fcst")
FARTHEST = 2**40  # [bytes] largest position of a message
Ladder = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class NoaaModel:
    """A forecast model.

    Attributes
    ----------
    name : str
        The value of ``wind.model``.
    base : str
        Address of the archive.
    path : str
        Path of a file in it, with the fields ``{cycle}``, ``{step}`` [h] and ``{member}``.
    every : int
        Hours from one cycle to the next.
    steps : tuple of (last step [h], hours from one step to the next)
    long_cycles, long_steps : tuple
        Hours of the day of the cycles with longer forecasts, and their steps.
    area : GeoBox or None
        Area of a regional model; None for a global one.
    """

    name: str
    base: str
    path: str
    every: int
    steps: Ladder
    long_cycles: tuple[int, ...] = ()
    long_steps: Ladder = ()
    area: GeoBox | None = None

    def address(self, base: str | None, cycle: float, step: int, member: int = 0) -> str:
        """URL of the file of ``step`` [h] of the forecast that began at ``cycle`` [s since 1970]."""
        began = datetime.fromtimestamp(cycle, UTC)
        name = "c00" if member == 0 else f"p{member:02d}"
        return f"{(base or self.base).rstrip('/')}/{self.path.format(cycle=began, step=step, member=name)}"

    def cycles_before(self, moment: float) -> Iterator[float]:
        """Starts of forecasts at or before ``moment`` [s since 1970], the newest first."""
        newest = moment // (self.every * HOUR) * self.every * HOUR
        for back in range(0, OLDEST_CYCLE + 1, self.every):
            yield newest - back * HOUR

    def steps_between(self, cycle: float, first: float, last: float) -> tuple[int, ...]:
        """Steps [h] from the last at or before ``first`` to the first at or after ``last`` [s since 1970].

        Empty if the forecast that began at ``cycle`` does not cover both times.
        """
        hour_of_day = int(cycle % (24 * HOUR) / HOUR)
        ladder = self.long_steps if hour_of_day in self.long_cycles else self.steps
        steps = [0]
        for end, gap in ladder:
            steps += range(steps[-1] + gap, end + 1, gap)
        times = [cycle + step * HOUR for step in steps]
        if first < times[0] or last > times[-1]:
            return ()
        begin = max(k for k, time in enumerate(times) if time <= first)
        end = min(k for k, time in enumerate(times) if time >= last)
        return tuple(steps[begin : end + 1])


MODELS = {
    model.name: model
    for model in (
        NoaaModel(
            "gfs",
            "https://noaa-gfs-bdp-pds.s3.amazonaws.com",
            "gfs.{cycle:%Y%m%d}/{cycle:%H}/atmos/gfs.t{cycle:%H}z.pgrb2.0p25.f{step:03d}",
            every=6,
            steps=((120, 1), (384, 3)),
        ),
        NoaaModel(
            "hrrr",
            "https://noaa-hrrr-bdp-pds.s3.amazonaws.com",
            "hrrr.{cycle:%Y%m%d}/conus/hrrr.t{cycle:%H}z.wrfsfcf{step:02d}.grib2",
            every=1,
            steps=((18, 1),),
            long_cycles=(0, 6, 12, 18),
            long_steps=((48, 1),),
            area=GeoBox(-134.1, 21.1, 73.2, 52.7),
        ),
        NoaaModel(
            "gefs",
            "https://noaa-gefs-pds.s3.amazonaws.com",
            "gefs.{cycle:%Y%m%d}/{cycle:%H}/atmos/pgrb2sp25/ge{member}.t{cycle:%H}z.pgrb2s.0p25.f{step:03d}",
            every=6,
            steps=((240, 3),),
        ),
    )
}


# --- inventories -----------------------------------------------------------------------------


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
    here = [e for e in entries if entry_level(e.level) == level and INSTANT.fullmatch(e.forecast)]
    parts: list[ByteRange] = []
    for variable in ("UGRD", "VGRD"):
        fitting = [entry.part for entry in here if entry.variable == variable]
        if not fitting:
            levels = [known for e in entries if e.variable == "UGRD" and (known := entry_level(e.level))]
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
