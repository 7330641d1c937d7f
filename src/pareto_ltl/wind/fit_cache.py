"""Fitted wind tables, kept on disk between runs."""

from __future__ import annotations

import logging
import warnings
from functools import lru_cache
from pathlib import Path

from pareto_ltl.support import cache
from pareto_ltl.support.fingerprints import code_fingerprint
from pareto_ltl.wind.tabulate import WindTable, WindTask, tabulate_wind

LOG = logging.getLogger(__name__)
TABLE_CODE = ("wind.tabulate", "wind.gp", "wind.modes")  # the code that a table depends on


def cache_folder() -> Path:
    """The folder of the cached tables."""
    return cache.cache_root() / "wind"


def cached_wind_table(task: WindTask) -> WindTable:
    """:func:`tabulate_wind` of ``task``, read from the cache if it is there.

    If the cache cannot be read or written, the table is computed and a warning logged.
    """
    from joblib import Memory, hash

    folder, arguments = cache_folder(), (task, code_fingerprint(*TABLE_CODE))
    try:
        memory = Memory(folder, verbose=0)
        recall = memory.cache(tabulate_wind)
        recall.warn = lambda _: _warn_once(folder, "an entry is damaged and is made again")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            if recall.check_call_in_cache(*arguments):
                table: WindTable = recall(*arguments)
            else:
                with cache.lock_entry(hash(arguments)):  # jobs that start together fit once
                    table = recall(*arguments)
                    memory.reduce_size(bytes_limit=cache.cache_limit())
    except OSError as error:
        _warn_once(folder, str(error))
        return tabulate_wind(*arguments)
    for warning in caught:
        if warning.category.__module__.startswith("joblib"):
            _warn_once(folder, str(warning.message))
        else:  # a warning of the fit
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    return table


@lru_cache(maxsize=8)
def _warn_once(folder: Path, reason: str) -> None:
    """Log once that the cache does not work, and why."""
    reason = reason.splitlines()[0]
    LOG.warning(
        "wind fits are not remembered in %s: %s; set PARETO_LTL_CACHE to another folder", folder, reason
    )


__all__ = ["cache_folder", "cached_wind_table"]
