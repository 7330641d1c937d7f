"""What is remembered between runs: fits of the wind and downloaded winds, by their content, up to a size.

The folder is ``PARETO_LTL_CACHE``, or the user's cache; the limit ``PARETO_LTL_CACHE_MIB``. ``pareto-ltl
cache`` shows and clears it. Jobs at work together share it: who needs an entry first makes it, others wait.
A folder that other users may write is not used: they could put another wind into a plan.
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
FITS_FOLDER, DOWNLOADS_FOLDER, FORMS_FOLDER = "wind", "noaa", "programmes"


def cache_root() -> Path:
    """The folder of all that is kept between runs."""
    named = os.environ.get("PARETO_LTL_CACHE")
    if named:
        return Path(named)
    import platformdirs

    with suppress(RuntimeError):  # there is no home, as in many containers
        place = Path(platformdirs.user_cache_dir("pareto_ltl"))
        if place.is_absolute():
            return place
    owner = os.geteuid() if hasattr(os, "geteuid") else "user"
    return Path(tempfile.gettempdir()) / f"pareto_ltl-{owner}"


def cache_limit() -> int:
    """How large the cache may grow [bytes]; ConfigError where the variable is no whole number."""
    text = os.environ.get("PARETO_LTL_CACHE_MIB", str(DEFAULT_LIMIT))
    if not text.isdecimal():
        raise ConfigError(f"PARETO_LTL_CACHE_MIB must be a whole number of MiB, got {text!r}")
    return int(text) * 2**20


def make_private(folder: Path) -> None:
    """Make ``folder`` where it is missing, for its owner alone.

    Raises
    ------
    DataError
        If it, or the folder that it is in, belongs to another user or may be written by one.
    """
    for place in (folder.parent, folder):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        if reason := _open_to_others(place):
            raise DataError(f"{place} {reason}; give it to you alone (chmod 700)")


def _open_to_others(folder: Path) -> str | None:
    """Why others could change what is in ``folder``; None if they cannot. Windows has no such mode."""
    if os.name == "nt":
        return None
    stat = folder.stat()
    if stat.st_uid not in (os.geteuid(), 0):
        return "belongs to another user"
    return f"may be written by others (mode {stat.st_mode & 0o777:o})" if stat.st_mode & 0o022 else None


def mark_used(path: Path) -> None:
    """Set the date of an entry, so that the least recently used ones are removed first."""
    with suppress(OSError):
        os.utime(path)


def trim_folder(folder: Path, limit: int, suffix: str = ".npz") -> None:
    """Remove the entries of ``folder`` that were not used for longest until ``limit`` [bytes] is kept.

    An entry is all files with one stem; its date and size are those of the largest of them.
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
    for name in (FITS_FOLDER, DOWNLOADS_FOLDER, FORMS_FOLDER, LOCKS_FOLDER):
        if (folder / name).exists():
            shutil.rmtree(folder / name)
