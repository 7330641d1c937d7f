"""File locks that the operating system releases when their holder dies, on one machine or a shared disk.

``filelock`` locks an open file: with ``flock`` on Linux and macOS, which needs no clean-up after SIGKILL
and works over NFS, and with ``LockFileEx`` on Windows. On a file system without locks, the work continues
without one and the log says so. The holder writes a note into the file, from the second byte on, since on
Windows no other process can read the locked first byte.
"""

from __future__ import annotations

import errno
import logging
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from careful_io.errors import ConfigError
from careful_io.links import NO_LINK, open_unlinked

LOCK_LOG = logging.getLogger(__name__)

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # errors of a file system without locks
NOTE_START = 1  # byte 0 is the one that is locked
NOTE_LENGTH = 200
ATTEMPTS, PAUSE = 5, 0.02  # number and [s]; repeated, since is_held in another process takes the lock briefly


class TakenError(Exception):
    """Another process holds the lock; the text is the note that it wrote into the file."""


@contextmanager
def hold_lock(path: Path, *, wait: bool = True, note: str = "") -> Iterator[str]:
    """Hold the lock ``path`` in the block; its file is removed at the end.

    What is yielded is the note of a previous holder that was killed, or an empty text.

    Parameters
    ----------
    path : Path
        The file of the lock, which is made if it is missing; its folder must exist.
    wait : bool
        Whether to wait while another process holds the lock.
    note : str
        Text written into the file, for a process that finds the lock taken.

    Raises
    ------
    TakenError
        If another process holds the lock and ``wait`` is false.
    DataError
        If ``path`` is a link or no plain file.
    OSError
        If the file cannot be made or opened.
    """
    handle = _locked_handle(path, wait)
    try:
        left = _read_note(handle)
        if note:
            _write_note(handle, note)
        try:
            yield left
        finally:
            os.ftruncate(handle, 0)  # no note is left if the file cannot be removed
            with suppress(PermissionError, FileNotFoundError):
                path.unlink()
    finally:
        os.close(handle)
    if os.name == "nt":  # Windows cannot remove an open file
        with suppress(OSError):
            path.unlink()


@contextmanager
def claim_folder(lock: Path, what: str, instead: str) -> Iterator[None]:
    """In the block, reserve the folder of ``lock`` for this process; the file is removed at the end.

    Raises
    ------
    ConfigError
        If another process has the folder. In the message, ``what`` names the work, for example "a sweep", and
        ``instead`` an alternative to waiting.
    """
    lock.parent.mkdir(parents=True, exist_ok=True)
    try:
        with hold_lock(lock, wait=False, note=process_note()):
            yield
    except TakenError as other:
        raise ConfigError(
            f"{what} is at work in {lock.parent} already ({other}): wait for it, or {instead}"
        ) from None


def process_note() -> str:
    """The note of this process for a lock: process id, machine and time."""
    return f"process {os.getpid()} on {platform.node()}, since {datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC"


def has_note(path: Path) -> bool:
    """Whether ``path`` contains a note: its holder is running or was killed."""
    try:
        return path.stat().st_size > NOTE_START
    except OSError:
        return False


def is_held(path: Path) -> bool:
    """Whether a living process holds the lock ``path``."""
    try:
        handle = os.open(path, os.O_RDONLY | NO_LINK)
    except OSError:
        return False
    try:
        return not _try_lock(handle, wait=False)
    except OSError:
        return False
    finally:
        os.close(handle)


def _locked_handle(path: Path, wait: bool) -> int:
    """Open ``path`` and lock it; repeat if the file was removed or replaced during the wait."""
    while True:
        handle = open_unlinked(path, os.O_RDWR)
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
        if not _try_lock(handle, wait):
            raise TakenError(_read_note(handle))
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        LOCK_LOG.warning("%s: no locks on this file system; do not start the same work twice", path.parent)


def _try_lock(handle: int, wait: bool) -> bool:
    from filelock import lock_descriptor

    if wait:
        return lock_descriptor(handle, poll_interval=PAUSE)
    for _ in range(ATTEMPTS):
        if lock_descriptor(handle, blocking=False):
            return True
        time.sleep(PAUSE)
    return False


def _read_note(handle: int) -> str:
    os.lseek(handle, NOTE_START, os.SEEK_SET)
    return os.read(handle, NOTE_LENGTH).decode(errors="replace").strip()


def _write_note(handle: int, note: str) -> None:
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    os.write(handle, b" " * NOTE_START + note.encode()[:NOTE_LENGTH])


def _is_still(handle: int, path: Path) -> bool:
    """Whether ``path`` is the file that ``handle`` has open."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path, follow_symlinks=False))
    except FileNotFoundError:
        return False
