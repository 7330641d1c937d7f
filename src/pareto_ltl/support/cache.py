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

from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.locks import hold_lock

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


def make_private(folder: Path) -> None:
    """Make ``folder`` if it is missing, with permissions for its owner only.

    Raises
    ------
    DataError
        If it, or its parent folder, belongs to another user or can be written by others.
    """
    for place in (folder.parent, folder):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        if reason := _open_to_others(place):
            raise DataError(f"{place} {reason}; give it to you alone (chmod 700)")


def _open_to_others(folder: Path) -> str | None:
    """Why other users can write to ``folder``; None if they cannot, and on Windows, which has no modes."""
    if os.name == "nt":
        return None
    stat = folder.stat()
    if stat.st_uid not in (os.geteuid(), 0):
        return "belongs to another user"
    return f"may be written by others (mode {stat.st_mode & 0o777:o})" if stat.st_mode & 0o022 else None


def mark_used(path: Path) -> None:
    """Set the date of an entry to now, as the least recently used entries are removed first."""
    with suppress(OSError):
        os.utime(path)


def trim_folder(folder: Path, limit: int, suffix: str = ".npz") -> None:
    """Remove the least recently used entries of ``folder`` until those left have at most ``limit`` bytes.

    An entry is a file that ends in ``suffix``, which gives its date and size; earlier versions wrote a
    ``.json`` file beside it.
    """
    dated: list[tuple[float, int, Path]] = []
    for path in folder.glob(f"*{suffix}"):
        with suppress(OSError):
            stat = path.stat()
            dated.append((stat.st_mtime, stat.st_size, path))
    total = sum(size for _, size, _ in dated)
    for _, size, path in sorted(dated):
        if total <= limit:
            return
        for part in (path, path.with_suffix(".json")):
            with suppress(OSError):
                part.unlink(missing_ok=True)
        total -= size


@contextmanager
def lock_entry(key: str) -> Iterator[None]:
    """In the block, hold the lock of the entry ``key``; without a lock if the file system has none."""
    folder = cache_root() / LOCKS_FOLDER
    with ExitStack() as held:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            held.enter_context(hold_lock(folder / key))
        yield


def folder_size(folder: Path) -> tuple[int, int]:
    """Number of files below ``folder`` and the sum of their sizes [bytes]."""
    files = total = 0
    for path in folder.rglob("*"):
        with suppress(OSError):
            if path.is_file():
                files, total = files + 1, total + path.stat().st_size
    return files, total


def clear_cache(folder: Path) -> None:
    """Remove all entries; a job that needs one afterwards makes it again."""
    for name in (FITS_FOLDER, DOWNLOADS_FOLDER, FORMER_FOLDER, LOCKS_FOLDER):
        if (folder / name).exists():
            shutil.rmtree(folder / name)
