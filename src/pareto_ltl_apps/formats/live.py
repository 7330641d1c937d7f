"""Forecasts of NOAA and ECMWF from their public archives; only the required messages of a file are fetched.

The inventory of each GRIB2 file lists the positions of the messages of the wind at ``wind.level``; these
bytes are fetched and cached. Of files without an inventory (RTOFS), the messages of the current are cached. A
cached file whose checksum differs from the one in its request is fetched again. The newest cycle that covers
the flight is used.
"""

from __future__ import annotations

import io
import logging
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from careful_io.times import HOUR, iso, seconds
from pareto_ltl import Readings
from pareto_ltl.extend import Wanted, WindConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.levels import wind_level
from pareto_ltl_apps.formats.download import ByteRange, NotThereError, fetch_bytes
from pareto_ltl_apps.formats.download_cache import DownloadCache
from pareto_ltl_apps.formats.grib_files import grib_snapshots_apart
from pareto_ltl_apps.formats.grib_frames import BrokenFrameError, messages_with
from pareto_ltl_apps.formats.inventories import parse_inventory, wind_parts
from pareto_ltl_apps.formats.live_models import MODELS, Download, LiveModel
from pareto_ltl_apps.formats.snapshots import ensemble_readings, latest_readings

LOG = logging.getLogger("pareto_ltl.formats.live")
MAX_INVENTORY, MAX_MESSAGES, MAX_FILE = 4 * 2**20, 128 * 2**20, 512 * 2**20  # [bytes]
CONNECTIONS = 4  # simultaneous downloads


class Forecast(NamedTuple):
    """Downloaded ``files``, whose fields from ``first`` to ``last`` [s since 1970] the flight needs."""

    files: tuple[Path, ...]
    first: float
    last: float


_FETCHED: dict[object, Forecast] = {}  # files are chosen once per process
_CACHES: list[DownloadCache] = []  # kept until the process ends, since their folders may be temporary


def read_live(cfg: WindConfig, wanted: Wanted) -> Readings:
    """The winds or currents of one forecast for ``wind.hours`` from departure; members form an ensemble.

    Raises
    ------
    ConfigError
        If the model does not cover the scene, or has fewer than ``wind.members`` members, or ``wind.cycle``
        is not the start of a forecast.
    DataError
        If no cycle covers the flight, or a file cannot be fetched or, with ``wind.offline``, is not cached.
    """
    model, found = _model(cfg), _forecast(cfg, wanted)
    read = grib_snapshots_apart(found.files, cfg.max_speed, cfg.level, wanted.area, model.quantity)
    snapshots = [snap for snap in read.winds if found.first <= snap.time <= found.last]
    cycle = iso(snapshots[0].cycle)
    note = f"{model.name} forecast of {cycle}; wind.cycle={cycle} reads the same one again"
    if len({snapshot.member for snapshot in snapshots}) > 1:
        return ensemble_readings(snapshots, found.files, cfg, (note, *read.notes), model.law)
    return latest_readings(snapshots, found.files, (note, *read.notes), model.law)


def live_files(cfg: WindConfig, wanted: Wanted) -> tuple[Path, ...]:
    """The files of these winds or currents; those that are not cached are fetched."""
    return _forecast(cfg, wanted).files


def _model(cfg: WindConfig) -> LiveModel:
    return MODELS[cfg.model if cfg.source == "noaa" else cfg.source]


def _members(cfg: WindConfig, model: LiveModel) -> int:
    count = cfg.members
    if cfg.gefs_members > 1 and model.name == "gefs":
        LOG.warning("wind.gefs_members is now wind.members; version 2 does not know the former name")
        count = max(count, cfg.gefs_members)
    if count > model.members:
        has = f"{model.members} members" if model.members > 1 else "no ensemble: set wind.members=1"
        raise ConfigError(f"wind.members={count}: {model.name} has {has}")
    return count


def _forecast(cfg: WindConfig, wanted: Wanted) -> Forecast:
    settings = (cfg.source, cfg.model, cfg.cycle, cfg.hours, cfg.level, cfg.base_url, cfg.members)
    key = (*settings, cfg.gefs_members, wanted)
    if key not in _FETCHED or not all(file.is_file() for file in _FETCHED[key].files):
        _FETCHED[key] = _fetch_forecast(cfg, wanted)
    return _FETCHED[key]


def _fetch_forecast(cfg: WindConfig, wanted: Wanted) -> Forecast:
    model = _model(cfg)
    fetch = _Fetch(cfg, model, model.region_of(wanted.area, cfg.level), _members(cfg, model))
    now = _now()
    first = now if wanted.start is None else seconds(wanted.start)
    last = first + cfg.hours * HOUR
    reasons: list[str] = []
    for cycle in _candidates(cfg, model, min(first, now)):
        steps = model.steps_between(cycle, first, last)
        if not steps:
            continue
        try:
            files = fetch.cycle(cycle, steps)
            return Forecast(files, cycle + steps[0] * HOUR, cycle + steps[-1] * HOUR)
        except NotThereError as error:
            reasons.append(f"of {iso(cycle)}, {error}")
            LOG.info("%s forecast of %s is not available (yet)", model.name, iso(cycle))
    raise DataError(_no_cycle(cfg, model, first, last, reasons))


def _now() -> float:
    return time.time()


def _candidates(cfg: WindConfig, model: LiveModel, newest: float) -> list[float]:
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


def _no_cycle(cfg: WindConfig, model: LiveModel, first: float, last: float, reasons: list[str]) -> str:
    period = f"{iso(first)} .. {iso(last)}"
    fewer = f"fewer wind.hours or another {'wind.model' if cfg.source == 'noaa' else 'source'}"
    which = f"{'no cycle' if cfg.cycle == 'newest' else f'the cycle {cfg.cycle}'} of {model.name}"
    if cfg.offline:
        return (
            f"wind.offline=true, and {which} that covers {period} was fetched before; fetch it once with "
            "wind.offline=false"
        )
    if not reasons:
        return f"{which} does not cover {period}; choose an earlier mission.start_time, {fewer}"
    tried = "" if len(reasons) == 1 else f"{len(reasons)} were asked for; "
    return (
        f"{which} that covers {period} is available ({tried}{reasons[0]}); choose another "
        f"mission.start_time, {fewer}{f' ({model.hint})' if model.hint else ''}"
    )


class _Fetch:
    """Fetches the files of a cycle into the cache of downloads."""

    def __init__(self, cfg: WindConfig, model: LiveModel, region: str, members: int) -> None:
        self.cfg, self.model, self.region, self.members = cfg, model, region, members
        self.level = wind_level(cfg.level)
        self.store = DownloadCache()
        self.store.trim()  # before fetching, so that the new files are kept
        _CACHES.append(self.store)
        self._turn, self._next = threading.Lock(), 0.0

    def cycle(self, cycle: float, steps: tuple[int, ...]) -> tuple[Path, ...]:
        """Fetch the files of all steps and members; the last step first, since it is published last."""
        base, name = self.cfg.base_url, self.model.name
        jobs: dict[Download, None] = {}
        for step in reversed(steps):
            jobs |= dict.fromkeys(
                self.model.downloads(base, cycle, step, self.level, self.members, self.region)
            )
        LOG.info("%s forecast of %s: %d files, the %s at %s", name, iso(cycle), len(jobs),
                 self.model.quantity.name, self.cfg.level)  # fmt: skip
        first, *rest = jobs
        found = [self.file(first)]
        with ThreadPoolExecutor(CONNECTIONS) as pool:
            for path in pool.map(self.file, rest):
                found.append(path)
                if len(found) % 10 == 0 or len(found) == len(jobs):
                    LOG.info("%d of %d files are there", len(found), len(jobs))
        return tuple(reversed(found))

    def file(self, job: Download) -> Path:
        """The required messages of one file, from the cache or from the server."""
        wanted = " ".join([self.level.text, *map(str, job.members)])
        if (stored := self.store.find(job.url, wanted)) is not None:
            return stored
        if self.cfg.offline:
            raise NotThereError(f"{job.url} was not fetched before")
        return self.store.keep(
            job.url, wanted, self._messages(job) if self.model.inventory else self._all(job)
        )

    def _messages(self, job: Download) -> bytes:
        where = self.model.inventory_of(job.url)
        entries = parse_inventory(self._bytes(where, MAX_INVENTORY).decode("utf-8", "replace"), where)
        messages = []
        for part in wind_parts(entries, self.level, where, job.members):
            data = self._bytes(job.url, MAX_MESSAGES, part)
            if data[:4] != b"GRIB" or data[-4:] != b"7777":
                raise DataError(
                    f"{job.url}: the {len(data)} bytes from {part.first} on are no whole GRIB message; the "
                    "inventory is of another file: try again later"
                )
            messages.append(data)
        return b"".join(messages)

    def _all(self, job: Download) -> bytes:
        """The messages of the wind or current in a file without an inventory."""
        data = self._bytes(job.url, MAX_FILE, ByteRange(0, None))
        quantity = self.model.quantity
        try:
            found = b"".join(messages_with(io.BytesIO(data), quantity.numbers))
        except BrokenFrameError as error:
            raise DataError(f"{job.url} is damaged or truncated ({error}); try again later") from None
        if not found:
            raise DataError(f"{job.url} holds no {quantity.name}; try again later, or another wind.base_url")
        return found

    def _bytes(self, url: str, limit: int, part: ByteRange | None = None) -> bytes:
        if self.model.pause and self.cfg.base_url is None:
            with self._turn:
                time.sleep(max(0.0, self._next - time.monotonic()))
                self._next = time.monotonic() + self.model.pause
        return fetch_bytes(url, limit, part, self.cfg.retries)
