"""Folders of a cache: private to their owner, and limited in size."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from careful_io.errors import DataError


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


def folder_size(folder: Path) -> tuple[int, int]:
    """Number of files below ``folder`` and the sum of their sizes [bytes]."""
    files = total = 0
    for path in folder.rglob("*"):
        with suppress(OSError):
            if path.is_file():
                files, total = files + 1, total + path.stat().st_size
    return files, total
