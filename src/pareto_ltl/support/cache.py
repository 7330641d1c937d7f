"""What is remembered between runs: fits of the wind, by their content, up to a size.

The folder is ``PARETO_LTL_CACHE``, or the user's cache; the limit ``PARETO_LTL_CACHE_MIB``. ``pareto-ltl
cache`` shows and clears it. Jobs at work together share it: who needs an entry first makes it, others wait.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.locks import hold_lock

DEFAULT_LIMIT = 1024  # [MiB]
LOCKS_FOLDER = "locks"


def cache_root() -> Path:
    """The folder of all that is kept between runs."""
    named = os.environ.get("PARETO_LTL_CACHE")
    if named:
        return Path(named)
    import platformdirs

    return Path(platformdirs.user_cache_dir("pareto_ltl"))


def cache_limit() -> int:
    """How large the cache may grow [bytes]; ConfigError where the variable is no whole number."""
    text = os.environ.get("PARETO_LTL_CACHE_MIB", str(DEFAULT_LIMIT))
    if not text.isdecimal():
        raise ConfigError(f"PARETO_LTL_CACHE_MIB must be a whole number of MiB, got {text!r}")
    return int(text) * 2**20


@contextmanager
def lock_entry(key: str) -> Iterator[None]:
    """Let one process at a time make the entry ``key``; where no lock can be had, all go on without one."""
    folder = cache_root() / LOCKS_FOLDER
    with ExitStack() as held:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            held.enter_context(hold_lock(folder / key))
        yield


def folder_size(folder: Path) -> tuple[int, int]:
    """Number of files below ``folder`` and their bytes; files removed meanwhile do not count."""
    files = total = 0
    for path in folder.rglob("*"):
        with suppress(OSError):
            if path.is_file():
                files, total = files + 1, total + path.stat().st_size
    return files, total


def clear_cache(folder: Path) -> None:
    """Remove all entries; a job that reads one meanwhile makes it again."""
    for name in ("wind", LOCKS_FOLDER):
        if (folder / name).exists():
            shutil.rmtree(folder / name)
