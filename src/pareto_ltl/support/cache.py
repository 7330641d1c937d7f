"""The cache of wind fits, downloaded winds and compiled problems that runs share, limited in size.

Its folder is ``PARETO_LTL_CACHE``, or the user's cache folder; its limit ``PARETO_LTL_CACHE_MIB``.
``pareto-ltl cache`` shows and clears it. Of several jobs that need a missing entry, one makes it and the
others wait. A folder that other users can write to is refused, as they could change the wind of a plan.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from careful_io.locks import hold_lock
from pareto_ltl.support.errors import ConfigError

DEFAULT_LIMIT = 1024  # [MiB]
LOCKS_FOLDER = "locks"
FITS_FOLDER, DOWNLOADS_FOLDER = "wind", "noaa"
FORMER_FOLDER = "programmes"  # of earlier versions


def cache_root() -> Path:
    """The folder of the cache; it may not exist yet."""
    named = os.environ.get("PARETO_LTL_CACHE")
    if named:
        return Path(named)
    import platformdirs

    with suppress(RuntimeError):  # the user has no home folder, as in many containers
        place = Path(platformdirs.user_cache_dir("pareto_ltl"))
        if place.is_absolute():
            return place
    owner = os.geteuid() if hasattr(os, "geteuid") else "user"
    return Path(tempfile.gettempdir()) / f"pareto_ltl-{owner}"


def cache_limit() -> int:
    """Size limit of the cache [bytes]; ConfigError if ``PARETO_LTL_CACHE_MIB`` is not a whole number."""
    text = os.environ.get("PARETO_LTL_CACHE_MIB", str(DEFAULT_LIMIT))
    if not text.isdecimal():
        raise ConfigError(f"PARETO_LTL_CACHE_MIB must be a whole number of MiB, got {text!r}")
    return int(text) * 2**20


@contextmanager
def lock_entry(key: str) -> Iterator[None]:
    """In the block, hold the lock of the entry ``key``; without a lock if the file system has none."""
    folder = cache_root() / LOCKS_FOLDER
    with ExitStack() as held:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            held.enter_context(hold_lock(folder / key))
        yield


def clear_cache(folder: Path) -> None:
    """Remove all entries; a job that needs one afterwards makes it again."""
    for name in (FITS_FOLDER, DOWNLOADS_FOLDER, FORMER_FOLDER, LOCKS_FOLDER):
        if (folder / name).exists():
            shutil.rmtree(folder / name)
