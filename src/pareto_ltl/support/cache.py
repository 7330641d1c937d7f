"""What is remembered between runs: fits of the wind, by their content, up to a size.

The folder is ``PARETO_LTL_CACHE``, or the user's cache; the limit ``PARETO_LTL_CACHE_MIB``. ``pareto-ltl
cache`` shows and clears it. Jobs at work together share it: who needs an entry first makes it, others wait.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pareto_ltl.support.errors import ConfigError

LIMIT = 1024  # [MiB]
LOCKS = "locks"


def root() -> Path:
    """The folder of everything that is remembered."""
    named = os.environ.get("PARETO_LTL_CACHE")
    if named:
        return Path(named)
    import platformdirs

    return Path(platformdirs.user_cache_dir("pareto_ltl"))


def limit() -> int:
    """How large it may grow [bytes]."""
    text = os.environ.get("PARETO_LTL_CACHE_MIB", str(LIMIT))
    if not text.isdecimal():
        raise ConfigError(f"PARETO_LTL_CACHE_MIB must be a whole number of MiB, got {text!r}")
    return int(text) * 2**20


@contextmanager
def alone(key: str) -> Iterator[None]:
    """One process at a time for ``key``; where locks cannot be had, all go on without waiting."""
    folder = root() / LOCKS
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / key, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError:
        yield
        return
    try:
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def size(folder: Path) -> tuple[int, int]:
    """Files and bytes below ``folder``; what vanishes meanwhile does not count."""
    files = total = 0
    for path in folder.rglob("*"):
        with suppress(OSError):
            if path.is_file():
                files, total = files + 1, total + path.stat().st_size
    return files, total


def clear(folder: Path) -> None:
    """Remove what is remembered; a job that reads it meanwhile makes its entry again."""
    for name in ("wind", LOCKS):
        if (folder / name).exists():
            shutil.rmtree(folder / name)
