"""Winds of GFS, HRRR and GEFS from NOAA's public archives; only the required messages of a file are fetched.

The inventory (.idx) of each GRIB2 file lists the positions of the messages of the wind at ``wind.level``;
these bytes are fetched and cached in ``LABEL.SHA256.grib2``, the request in ``KEY.json``; a file whose
checksum differs from the one in its request is fetched again. The newest cycle that covers the flight is
used.

The addresses name the NOAA Open Data Dissemination buckets on S3,
https://registry.opendata.aws/noaa-gfs-bdp-pds/. A line of an inventory is
``588:428651621:d=2023110400:UGRD:10 m above ground:21 hour fcst:``. The number has two parts (``77.1``,
``77.2``) if a message contains several fields.
"""

from __future__ import annotations

import hashlib
import logging
import re
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

from pareto_ltl.settings import WindConfig
from pareto_ltl.support import cache
from pareto_ltl.support.download import ByteRange, NotThereError, fetch_bytes
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.files import write_bytes, write_json
from pareto_ltl.support.fingerprints import file_fingerprint
from pareto_ltl.support.levels import HEIGHT, PRESSURE, Level, level_list, parse_level
from pareto_ltl.support.messages import shown_text
from pareto_ltl.support.reading import read_json
from pareto_ltl.wind.area import GeoBox, Wanted
from pareto_ltl.wind.readings import HOUR, Readings, iso, seconds
from pareto_ltl.wind.snapshots import ensemble_readings, latest_readings
from pareto_ltl.wind.sources.grib_files import grib_snapshots_apart

LOG = logging.getLogger(__name__)
MOST_IDX, MOST_MESSAGE = 4 * 2**20, 64 * 2**20  # [bytes] of an inventory, and of a message
CONNECTIONS = 4  # simultaneous downloads
REQUEST_SCHEMA = "pareto_ltl.download/1"
SHOWN_DIGITS = 16  # digits of the checksum in a file name
OLDEST_CYCLE = 48  # [h] older cycles are not searched for
MOST_LINES = 20_000
LINE = re.compile(r"(\d+(?:\.\d+)?):(\d+):d=(\d{10})\d*:([^:]*):([^:]*):([^:]*):?.*")
HEIGHT_TEXT = re.compile(r"(\d+(?:\.\d+)?) m above ground")
PRESSURE_TEXT = re.compile(r"(\d+(?:\.\d+)?) mb")
INSTANT = re.compile(r"anl|analysis|\d+ (?:min|hour|day) fcst")
FARTHEST = 2**40  # [bytes] largest position of a message
Ladder = tuple[tuple[int, int], ...]
_FETCHED: dict[object, tuple[Path, ...]] = {}  # files are chosen once per process
_CACHES: list[DownloadCache] = []  # kept until the process ends, since their folders may be temporary


def read_noaa(cfg: WindConfig, wanted: Wanted) -> Readings:
    """The winds of one forecast, for ``wind.hours`` from departure; several members form an ensemble.

    Raises
    ------
    ConfigError
        If the model does not cover the scene, or ``wind.cycle`` is not the start of a forecast.
    DataError
        If no cycle covers the flight, or a file cannot be fetched or, with ``wind.offline``, is not cached.
    """
    files = noaa_files(cfg, wanted)
    snapshots, _, notes = grib_snapshots_apart(files, cfg.max_speed, cfg.level, wanted.area)
    cycle = iso(snapshots[0].cycle)
    note = f"{cfg.model} forecast of {cycle}; wind.cycle={cycle} reads the same one again"
    if len({snapshot.member for snapshot in snapshots}) > 1:
        return ensemble_readings(snapshots, files, cfg, (note, *notes))
    return latest_readings(snapshots, files, (note, *notes))


def noaa_files(cfg: WindConfig, wanted: Wanted) -> tuple[Path, ...]:
    """The files with these winds; those that are not cached are fetched."""
    key = (cfg.model, cfg.cycle, cfg.hours, cfg.level, cfg.base_url, cfg.gefs_members, wanted)
    if key not in _FETCHED or not all(file.is_file() for file in _FETCHED[key]):
        _FETCHED[key] = _fetch_forecast(cfg, wanted)
    return _FETCHED[key]


def _fetch_forecast(cfg: WindConfig, wanted: Wanted) -> tuple[Path, ...]:
    model = MODELS[cfg.model]
    here = wanted.area
    if model.area is not None and here is not None and not model.area.contains(here.middle).all():
        raise ConfigError(
            f"wind.model={model.name} covers {model.area.text}; the scene needs {here.text}: use "
            "wind.model=gfs"
        )
    now = _now()
    first = now if wanted.start is None else seconds(wanted.start)
    last = first + cfg.hours * HOUR
    store = DownloadCache()
    store.trim()  # before fetching, so that the new files are kept
    _CACHES.append(store)
    reasons: list[str] = []
    for cycle in _candidates(cfg, model, min(first, now)):
        steps = model.steps_between(cycle, first, last)
        if not steps:
            continue
        try:
            return _fetch_cycle(cfg, model, store, cycle, steps)
        except NotThereError as error:
            reasons.append(str(error))
            LOG.info("%s forecast of %s is not available (yet)", model.name, iso(cycle))
    raise DataError(_no_cycle(cfg, model, first, last, reasons))


def _now() -> float:
    return time.time()


def _candidates(cfg: WindConfig, model: NoaaModel, newest: float) -> list[float]:
    """Starts of the forecasts that may be used [s since 1970], best first."""
    if cfg.cycle == "newest":
        return list(model.cycles_before(newest))
    cycle = seconds(cfg.cycle)
    if cycle % (model.every * HOUR):
        raise ConfigError(
            f"wind.cycle={cfg.cycle} is not a start of a {model.name} forecast; they begin every "
            f"{model.every} h from 00 UTC on"
        )
    return [cycle]


def _no_cycle(cfg: WindConfig, model: NoaaModel, first: float, last: float, reasons: list[str]) -> str:
    period, fewer = f"{iso(first)} .. {iso(last)}", "fewer wind.hours or another wind.model"
    which = f"{'no cycle' if cfg.cycle == 'newest' else f'the cycle {cfg.cycle}'} of {model.name}"
    if cfg.offline:
        return (
            f"wind.offline=true, and {which} that covers {period} was fetched before; fetch it once with "
            "wind.offline=false"
        )
    if not reasons:
        return f"{which} does not cover {period}; choose an earlier mission.start_time, {fewer}"
    reason = reasons[-1]
    return f"{which} that covers {period} is available ({reason}); choose another mission.start_time, {fewer}"


def _fetch_cycle(
    cfg: WindConfig, model: NoaaModel, store: DownloadCache, cycle: float, steps: tuple[int, ...]
) -> tuple[Path, ...]:
    """Fetch the files of all steps and members; the last step first, since it is published last."""
    members = range(cfg.gefs_members if model.name == "gefs" else 1)
    jobs = [(step, member) for step in reversed(steps) for member in members]
    LOG.info("%s forecast of %s: %d files, the wind at %s", model.name, iso(cycle), len(jobs), cfg.level)

    def fetch(job: tuple[int, int]) -> Path:
        return _fetch_file(cfg, store, model.address(cfg.base_url, cycle, *job))

    found = [fetch(jobs[0])]
    with ThreadPoolExecutor(CONNECTIONS) as pool:
        for path in pool.map(fetch, jobs[1:]):
            found.append(path)
            if len(found) % 10 == 0 or len(found) == len(jobs):
                LOG.info("%d of %d files are there", len(found), len(jobs))
    return tuple(reversed(found))


def _fetch_file(cfg: WindConfig, store: DownloadCache, url: str) -> Path:
    """The wind messages of one file, from the cache or from the server."""
    level = parse_level(cfg.level)
    if (stored := store.find(url, level.text)) is not None:
        return stored
    if cfg.offline:
        raise NotThereError(f"{url} was not fetched before")
    idx = fetch_bytes(f"{url}.idx", MOST_IDX, retries=cfg.retries)
    entries = parse_idx(idx.decode("utf-8", "replace"), f"{url}.idx")
    messages = []
    for part in wind_parts(entries, level, f"{url}.idx"):
        data = fetch_bytes(url, MOST_MESSAGE, part, cfg.retries)
        if data[:4] != b"GRIB" or data[-4:] != b"7777":
            raise DataError(
                f"{url}: the {len(data)} bytes from {part.first} on are no whole GRIB message; the inventory "
                "is of another file: try again later"
            )
        messages.append(data)
    label = url.rsplit("/", 1)[-1].replace("/", "_")
    return store.keep(url, level.text, label, b"".join(messages))


# --- the cache of downloads ------------------------------------------------------------------


class DownloadCache:
    """A folder of downloads; if it cannot be used, a temporary folder is used instead."""

    def __init__(self) -> None:
        self.folder = cache.cache_root() / cache.DOWNLOADS_FOLDER
        self._own: tempfile.TemporaryDirectory[str] | None = None
        try:
            cache.make_private(self.folder)
        except (OSError, DataError) as error:
            self._leave(error)

    def find(self, url: str, level: str) -> Path | None:
        """The cached file with the wind at ``level`` of ``url``; None if there is none or it is damaged."""
        request = self._request(url, level)
        if not request.is_file():
            return None
        try:
            stored = read_json(request)
            path = self.folder / Path(str(stored["file"])).name
            if stored.get("schema") != REQUEST_SCHEMA or not path.is_file():
                return None
            if file_fingerprint(path) == stored.get("sha256"):
                cache.mark_used(path)
                return path
        except (DataError, OSError, KeyError):
            pass
        LOG.warning("%s is damaged and is fetched again", request.with_suffix(".grib2").name)
        return None

    def keep(self, url: str, level: str, label: str, data: bytes) -> Path:
        """Store ``data`` and return its file; DataError if it cannot be written."""
        digest = hashlib.sha256(data).hexdigest()
        path = self.folder / f"{label}.{digest[:SHOWN_DIGITS]}.grib2"
        note = {"schema": REQUEST_SCHEMA, "url": url, "level": level, "file": path.name, "sha256": digest}
        try:
            write_bytes(path, data)
            write_json(self._request(url, level), note)
        except OSError as error:
            if self._own is not None:
                raise DataError(f"{path} cannot be written ({error.strerror}); free some space") from None
            self._leave(error)
            return self.keep(url, level, label, data)
        return path

    def trim(self) -> None:
        """Remove the least recently used files beyond the size limit of the cache."""
        cache.trim_folder(self.folder, cache.cache_limit(), ".grib2")

    def _request(self, url: str, level: str) -> Path:
        return self.folder / f"{hashlib.sha256(f'{url} {level}'.encode()).hexdigest()}.json"

    def _leave(self, error: Exception) -> None:
        LOG.warning("downloads are not stored in %s: %s", self.folder, error)
        self._own = tempfile.TemporaryDirectory(prefix="pareto_ltl_noaa_", ignore_cleanup_errors=True)
        self.folder = Path(self._own.name)


# --- models ----------------------------------------------------------------------------------


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
