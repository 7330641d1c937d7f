"""Symbolic links in a folder that may come from another person: none may lead out of the folder.

A link in a received folder names a path of its reader's machine. Reading through it shows a file that its
reader did not name; writing through it changes one.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from careful_io.errors import DataError

NO_LINK = getattr(os, "O_NOFOLLOW", 0)  # Windows has none; there, making a link needs a privilege

UNBLOCKED = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)  # a pipe without a reader is no wait


def refuse_links_out(folder: Path) -> None:
    """DataError if a file or folder below ``folder`` is a link that leads out of ``folder``.

    ``folder`` itself may be a link: the user has named it.
    """
    root = os.path.realpath(folder)
    for place, folders, files in os.walk(root):
        for name in (*folders, *files):
            path = os.path.join(place, name)
            if os.path.islink(path) and not is_below(os.path.realpath(path), root):
                raise DataError(
                    f"{folder / os.path.relpath(path, root)} is a link that leads out of {folder}, through "
                    "which nothing is read or written; remove it, or put a copy of the file in its place"
                )


def is_below(path: str, root: str) -> bool:
    """Whether the real path ``path`` is ``root`` or lies in it."""
    return path == root or path.startswith(root.rstrip(os.sep) + os.sep)


def open_unlinked(path: Path, flags: int) -> int:
    """``os.open`` of a regular file, made if it is missing, that has no other name; returns the descriptor.

    Raises
    ------
    DataError
        If ``path`` is a link of either kind, or no regular file: writing would change a file elsewhere.
    OSError
        If it cannot be opened.
    """
    if not NO_LINK and path.is_symlink():
        raise DataError(f"{path} is a symbolic link; remove the link")
    try:
        handle = os.open(path, flags | os.O_CREAT | NO_LINK | UNBLOCKED, 0o644)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise DataError(f"{path} is a symbolic link; remove the link") from None
        raise
    found = os.fstat(handle)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        os.close(handle)
        raise DataError(f"{path} is no plain file, or has a second name (a hard link); remove it")
    return handle
