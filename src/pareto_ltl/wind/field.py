"""The wind field that planning uses: the posterior of wind readings on a lattice over a map, and its cache.

The cache has one archive ``KEY.npz`` for each table of the posterior. KEY is the fingerprint of all inputs of
the table. An entry holds only arrays, each with a checksum; nothing in it is executed. An entry that is
damaged, or whose shapes do not fit its task, is made again.
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from careful_io import folders
from careful_io.fingerprints import code_fingerprint
from careful_io.texts import probability_text
from careful_io.times import HOUR
from pareto_ltl.settings import WindConfig
from pareto_ltl.support import cache
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.records import WindField, WindObservations
from pareto_ltl.world.scene import Scene
from wind_laws.gp import FitOptions
from wind_laws.lattice import mode_lattice, wind_lattice
from wind_laws.records import readings_until
from wind_laws.tables import NOISE, WindTable, WindTask, tabulate_wind

LEAST_COVERAGE, MAX_COVERAGE = 0.8, 0.97  # of 90 % intervals; outside this range a warning is logged
LOG = logging.getLogger(__name__)
REMEDY = " (set wind.rho to change that)"
# The code that a table depends on.
TABLE_CODE = ("wind_laws.gp", "wind_laws.modes", "wind_laws.places", "wind_laws.tables")
TABLE_PACKAGES = ("numpy", "scipy", "scikit-learn")  # other versions round differently


def fit_wind_field(
    cfg: WindConfig, observations: WindObservations, scene: Scene, horizon: float | None = None
) -> WindField:
    """Tabulate the posterior wind on a lattice that covers ``scene`` and ``cfg.padding`` around it.

    Without readings the wind is calm: zero mean and variance in one slot that holds for all times.

    Parameters
    ----------
    horizon : float, optional
        End of the longest flight [s since time_zero]; slots after the first one from there on are not used.
    """
    lattice = wind_lattice(scene.bounds, cfg.spacing, cfg.padding)
    if not any(len(points) for points in observations.points):
        still, time = np.zeros((1, *lattice.shape, 2)), np.zeros(1)
        return WindField(
            lattice.origin, lattice.spacing, time, still, still.copy(), np.zeros((1, 2)),
            until=math.inf, source=observations.source,
        )  # fmt: skip
    seen = readings_until(observations, horizon, "planner.max_steps ends there")
    if cfg.hold_last:  # the last field is valid for longer
        seen = replace(seen, until=float(seen.times[-1]) + HOUR * cfg.max_gap)
    options = FitOptions(*(getattr(cfg, name) for name in FitOptions._fields))
    coarse = mode_lattice(scene.bounds, cfg.modes_spacing)
    task = WindTask.of(options, seen, scene.bounds, lattice, coarse, horizon)
    table = cached_wind_table(task) if cfg.cache else tabulate_wind(task, REMEDY)
    _warn_about_score(table, cfg)
    return WindField.of(table.wind(task, seen, cfg.rho, cfg.gust_time), seen.air)


def _warn_about_score(table: WindTable, cfg: WindConfig) -> None:
    """Log a warning if the predictions of held-out readings show that the intervals of the fit are wrong."""
    covered = table.score.get("gp_coverage_90", math.nan)
    least = covered > MAX_COVERAGE and bool((table.hyper[..., NOISE] <= cfg.noise_min).all())
    if covered < LEAST_COVERAGE or covered > MAX_COVERAGE:
        LOG.warning(
            "of the wind readings on the map that the fit did not see, %s lie within its 90 %% intervals "
            "(expected %s to %s): promised probabilities are %s; try %swind.kernel, or more readings",
            probability_text(covered), probability_text(LEAST_COVERAGE), probability_text(MAX_COVERAGE),
            "too low" if covered < LEAST_COVERAGE else "higher than necessary",
            f"wind.noise_min below {cfg.noise_min:g} m/s, " if least else "",
        )  # fmt: skip


# --- tables and their cache ------------------------------------------------------------------


def cached_wind_table(task: WindTask) -> WindTable:
    """:func:`tabulate_wind` of ``task``, read from the cache if it has an entry.

    If the cache cannot be used, the table is computed and a warning logged.
    """
    folder, key = cache.cache_root() / cache.FITS_FOLDER, task_key(task)
    try:
        folders.make_private(folder)
    except (OSError, DataError) as error:
        return _unkept(folder, error, tabulate_wind(task, REMEDY))
    if (table := _kept_table(folder, key, task)) is not None:
        return table
    with cache.lock_entry(key):  # jobs that start together fit once
        table = _kept_table(folder, key, task) or tabulate_wind(task, REMEDY)
        try:
            table.write(folder / f"{key}.npz")
            folders.trim_folder(folder, cache.cache_limit())
        except OSError as error:
            return _unkept(folder, error, table)
    return table


def _unkept(folder: Path, error: Exception, table: WindTable) -> WindTable:
    """Log once why the table cannot be stored; return ``table``."""
    _warn_once(f"wind fits are not remembered in {folder}: {error}")
    return table


def task_key(task: WindTask) -> str:
    """Fingerprint of the task, of the code and of the package versions, 64 hexadecimal digits."""
    return task.fingerprint(code_fingerprint(*TABLE_CODE), *map(version, TABLE_PACKAGES))


def _kept_table(folder: Path, key: str, task: WindTask) -> WindTable | None:
    """The entry ``key``; None if there is none, or if it is damaged, which is logged."""
    path = folder / f"{key}.npz"
    if not path.is_file():
        return None
    try:
        table = WindTable.read(path, task)
    except (DataError, ValueError) as error:
        _warn_once(f"{path} is damaged and is made again: {error}")
        return None
    folders.mark_used(path)
    return table


@lru_cache(maxsize=8)
def _warn_once(reason: str) -> None:
    """Log a warning about the cache; each reason is logged once."""
    LOG.warning("%s; PARETO_LTL_CACHE names another folder", reason)
