"""Locks that the operating system takes back when their holder dies, on one machine or a shared disk.

``flock`` needs no clean-up after SIGKILL, and Linux carries it over NFS. Where a file system knows no locks
the work is done without, and the log says so.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

log = logging.getLogger(__name__)

UNKNOWN = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


class TakenError(Exception):
    """Somebody else holds the lock; the text is what they wrote into it."""


@contextmanager
def held(path: Path, *, wait: bool = True, note: str = "") -> Iterator[None]:
    """Hold the lock ``path`` for the duration of the block.

    Raises
    ------
    TakenError
        Where another process has it and ``wait`` is false.
    """
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            raise TakenError(os.pread(handle, 200, 0).decode(errors="replace").strip()) from None
        except OSError as error:
            if error.errno not in UNKNOWN:
                raise
            log.warning("%s: no locks on this file system; do not start a sweep twice", path.parent)
        if note:
            os.ftruncate(handle, 0)
            os.pwrite(handle, note.encode(), 0)
        yield
    finally:
        os.close(handle)


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
