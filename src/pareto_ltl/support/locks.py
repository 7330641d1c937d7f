"""File locks that the operating system takes back when their holder dies, on one machine or a shared disk.

``flock`` needs no clean-up after SIGKILL, and Linux carries it over NFS. Where a file system has no locks,
the work is done without one, and the log says so.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LOCK_LOG = logging.getLogger(__name__)

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # what a file system without locks answers


class TakenError(Exception):
    """Another process holds the lock; the text is the note that it wrote into it."""


@contextmanager
def hold_lock(path: Path, *, wait: bool = True, note: str = "") -> Iterator[str]:
    """Hold the lock ``path`` while the block runs, and yield the note of its last holder; the file stays.

    Parameters
    ----------
    path : Path
        The file of the lock, which is made where it is missing; its folder must exist.
    wait : bool
        Whether to wait while another process holds it.
    note : str
        Written into the file, for whoever finds it taken.

    Raises
    ------
    TakenError
        If another process holds it and ``wait`` is false.
    OSError
        If the file cannot be made or opened.
    """
    handle = _locked_handle(path, wait)
    try:
        left = _read_note(handle)
        if note:
            os.ftruncate(handle, 0)
            os.pwrite(handle, note.encode(), 0)
        yield left
    finally:
        os.close(handle)


@contextmanager
def hold_passing_lock(path: Path, *, wait: bool = True, note: str = "") -> Iterator[str]:
    """As :func:`hold_lock`, but the file is removed when the block ends.

    A note that is found in it then says that its last holder was killed.
    """
    with hold_lock(path, wait=wait, note=note) as left:
        try:
            yield left
        finally:
            path.unlink(missing_ok=True)


def is_held(path: Path) -> bool:
    """Whether a living process holds the lock ``path``."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(handle)
    return False


def _locked_handle(path: Path, wait: bool) -> int:
    """Open ``path`` and lock it; once more where the file was removed or replaced while this one waited."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            _lock_handle(handle, path, wait)
            if _is_still(handle, path):
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _lock_handle(handle: int, path: Path, wait: bool) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        raise TakenError(_read_note(handle)) from None
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        LOCK_LOG.warning("%s: no locks on this file system; do not start the same work twice", path.parent)


def _read_note(handle: int) -> str:
    return os.pread(handle, 200, 0).decode(errors="replace").strip()


def _is_still(handle: int, path: Path) -> bool:
    """Whether ``path`` is the file that ``handle`` has open."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False
