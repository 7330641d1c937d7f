"""Winds of GFS, HRRR and GEFS from NOAA's public archives; only the required messages of a file are fetched.

The inventory (.idx) of each GRIB2 file lists the positions of the messages of the wind at ``wind.level``;
these bytes are fetched and cached (:mod:`noaa_cache`). The newest cycle that covers the flight is used.
"""

from __future__ import annotations

import logging
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.download import NotThereError, fetch_bytes
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.area import Wanted
from pareto_ltl.wind.ensemble import ensemble_readings
from pareto_ltl.wind.levels import parse_level
from pareto_ltl.wind.readings import HOUR, Readings, iso, seconds
from pareto_ltl.wind.snapshots import latest_readings
from pareto_ltl.wind.sources.grib_apart import grib_snapshots_apart
from pareto_ltl.wind.sources.idx_files import parse_idx, wind_parts
from pareto_ltl.wind.sources.noaa_cache import DownloadCache
from pareto_ltl.wind.sources.noaa_models import MODELS, NoaaModel

LOG = logging.getLogger(__name__)
MOST_IDX, MOST_MESSAGE = 4 * 2**20, 64 * 2**20  # [bytes] of an inventory, and of a message
CONNECTIONS = 4  # simultaneous downloads
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
    prior = 0.0 if cfg.forecast_error == "none" else cfg.ensemble_prior
    if len({snapshot.member for snapshot in snapshots}) > 1:
        return ensemble_readings(snapshots, files, prior, (note, *notes))
    return latest_readings(snapshots, files, (note, *notes))


def noaa_files(cfg: WindConfig, wanted: Wanted) -> tuple[Path, ...]:
    """The files with these winds; those that are not cached are fetched."""
    key = (cfg.model, cfg.cycle, cfg.hours, cfg.level, cfg.base_url, cfg.gefs_members, wanted)
    if key not in _FETCHED or not all(file.is_file() for file in _FETCHED[key]):
        _FETCHED[key] = _fetch_forecast(cfg, wanted)
    return _FETCHED[key]


def _fetch_forecast(cfg: WindConfig, wanted: Wanted) -> tuple[Path, ...]:
    model = MODELS[cfg.model]
    _refuse_elsewhere(model, wanted)
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
            files = _fetch_cycle(cfg, model, store, cycle, steps)
        except NotThereError as error:
            reasons.append(str(error))
            LOG.info("%s forecast of %s is not available (yet)", model.name, iso(cycle))
            continue
        return files
    raise DataError(_no_cycle(cfg, model, first, last, reasons))


def _now() -> float:
    return time.time()


def _refuse_elsewhere(model: NoaaModel, wanted: Wanted) -> None:
    if model.area is None or wanted.area is None:
        return
    if not model.area.contains(wanted.area.middle).all():
        raise ConfigError(
            f"wind.model={model.name} covers {model.area.text}; the scene needs {wanted.area.text}: use "
            "wind.model=gfs"
        )


def _candidates(cfg: WindConfig, model: NoaaModel, newest: float) -> list[float]:
    """Starts of the forecasts that may be used [s since 1970], best first."""
    if cfg.cycle == "newest":
        return list(model.cycles_before(newest))
    cycle = seconds(cfg.cycle)
    if not model.is_cycle(cycle):
        raise ConfigError(
            f"wind.cycle={cfg.cycle} is not a start of a {model.name} forecast; they begin every "
            f"{model.every} h from 00 UTC on"
        )
    return [cycle]


def _no_cycle(cfg: WindConfig, model: NoaaModel, first: float, last: float, reasons: list[str]) -> str:
    period = f"{iso(first)} .. {iso(last)}"
    which = "no cycle" if cfg.cycle == "newest" else f"the cycle {cfg.cycle}"
    if cfg.offline:
        return (
            f"wind.offline=true, and {which} of {model.name} that covers {period} was fetched before; fetch "
            "it once with wind.offline=false"
        )
    if not reasons:
        return (
            f"{which} of {model.name} does not cover {period}; choose an earlier mission.start_time, fewer "
            "wind.hours or another wind.model"
        )
    return (
        f"{which} of {model.name} that covers {period} is available ({reasons[-1]}); choose another "
        "mission.start_time, fewer wind.hours or another wind.model"
    )


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
