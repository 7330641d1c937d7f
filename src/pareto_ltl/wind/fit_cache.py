"""The cache of fitted wind tables on disk: arrays in ``KEY.npz``, numbers and a checksum in ``KEY.json``.

KEY is the fingerprint of all inputs of a table. An entry holds only data; nothing in it is executed. An entry
that is damaged, or whose shapes do not fit its task, is made again.
"""

from __future__ import annotations

import hashlib
import logging
import math
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support import cache
from pareto_ltl.support.archives import read_npz
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_json, write_npz
from pareto_ltl.support.fingerprints import code_fingerprint, file_fingerprint
from pareto_ltl.support.reading import read_json
from pareto_ltl.wind.tabulate import WindTable, WindTask, tabulate_wind

LOG = logging.getLogger(__name__)
TABLE_CODE = ("wind.tabulate", "wind.gp", "wind.modes", "wind.scoring")  # the code that a table depends on
TABLE_PACKAGES = ("numpy", "scipy", "scikit-learn")  # other versions round differently
TABLE_SCHEMA = "pareto_ltl.wind_table/2"
ARRAYS = tuple(name for name in WindTable._fields if name not in ("rho", "rest_length", "score"))


def cache_folder() -> Path:
    """The folder of the cached tables."""
    return cache.cache_root() / "wind"


def cached_wind_table(task: WindTask) -> WindTable:
    """:func:`tabulate_wind` of ``task``, read from the cache if it has an entry.

    If the cache cannot be used, the table is computed and a warning logged.
    """
    folder, key = cache_folder(), task_key(task)
    try:
        cache.make_private(folder)
    except (OSError, DataError) as error:
        return _unkept(folder, error, tabulate_wind(task))
    if (table := _kept_table(folder, key, task)) is not None:
        return table
    with cache.lock_entry(key):  # jobs that start together fit once
        table = _kept_table(folder, key, task) or tabulate_wind(task)
        try:
            _keep_table(folder, key, table)
        except OSError as error:
            return _unkept(folder, error, table)
    return table


def _unkept(folder: Path, error: Exception, table: WindTable) -> WindTable:
    """Log once why the table cannot be stored; return ``table``."""
    _warn_once(f"wind fits are not remembered in {folder}: {error}")
    return table


def task_key(task: WindTask) -> str:
    """Fingerprint of the task, of the code and of the package versions, 64 hexadecimal digits."""
    editions = [code_fingerprint(*TABLE_CODE), *map(version, TABLE_PACKAGES)]
    digest = hashlib.sha256(" ".join(editions).encode())
    _add_content(digest, task)
    return digest.hexdigest()


def _add_content(digest: Any, content: Any) -> None:
    """Add numbers, texts, arrays and tuples of these to ``digest``, with their types and shapes."""
    if isinstance(content, tuple):
        digest.update(f"{len(content)} items\0".encode())
        for item in content:
            _add_content(digest, item)
    elif isinstance(content, np.ndarray):
        digest.update(f"{content.dtype.str} {content.shape}\0".encode())
        digest.update(np.ascontiguousarray(content).tobytes())
    else:
        digest.update(f"{type(content).__name__} {content!r}\0".encode())


def _kept_table(folder: Path, key: str, task: WindTask) -> WindTable | None:
    """The entry ``key``; None if there is none, or if it is damaged, which is logged."""
    arrays, numbers = folder / f"{key}.npz", folder / f"{key}.json"
    if not (arrays.is_file() and numbers.is_file()):
        return None
    try:
        table = _read_table(arrays, numbers)
        table.check_for(task)
    except (DataError, ValueError, TypeError, KeyError) as error:
        _warn_once(f"{arrays} is damaged and is made again: {error}")
        return None
    cache.mark_used(arrays)
    return table


def _read_table(arrays: Path, numbers: Path) -> WindTable:
    table = read_json(numbers)
    if table.get("schema") != TABLE_SCHEMA or table.get("sha256") != file_fingerprint(arrays):
        raise DataError(f"{numbers.name} does not belong to it")
    if not isinstance(table.get("score"), dict):
        raise DataError(f"{numbers.name} has no scores")
    score = {str(name): math.nan if value is None else float(value) for name, value in table["score"].items()}
    content = read_npz(arrays)
    return WindTable(
        rho=float(table["rho"]),
        rest_length=float(table["rest_length"]),
        score=score,
        **{name: content[name] for name in ARRAYS},
    )


def _keep_table(folder: Path, key: str, table: WindTable) -> None:
    arrays = folder / f"{key}.npz"
    write_npz(arrays, {name: getattr(table, name) for name in ARRAYS})
    write_json(
        folder / f"{key}.json",
        {
            "schema": TABLE_SCHEMA,
            "sha256": file_fingerprint(arrays),
            "rho": table.rho,
            "rest_length": table.rest_length,
            "score": table.score,
        },
    )
    cache.trim_folder(folder, cache.cache_limit())


@lru_cache(maxsize=8)
def _warn_once(reason: str) -> None:
    """Log a warning about the cache; each reason is logged once."""
    LOG.warning("%s; PARETO_LTL_CACHE names another folder", reason)
