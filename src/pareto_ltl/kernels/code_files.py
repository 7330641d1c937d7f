"""Files of machine code: written whole, read only if undamaged and out of reach for other users.

Reading a file executes what it contains (it is a pickle of machine code), so these checks come first. The
checksum detects damage; it is not a signature. Code is as trustworthy as the source that it was made from: a
file must belong to the user, to root or to the owner of the source, and others may write it only where they
may write the source.
"""

from __future__ import annotations

import hashlib
import logging
import os
import stat
from pathlib import Path

from pareto_ltl.support.files import whole_file

LOG = logging.getLogger(__name__)
SUFFIX = ".nbc"
SAID: set[tuple[Path, str]] = set()
HEADER = b"pareto_ltl machine code 1\n"
START = len(HEADER) + hashlib.sha256().digest_size


def write_code(path: Path, content: bytes) -> None:
    """Write ``content`` with its checksum as the whole file ``path``; OSError if that is not possible."""
    whole = HEADER + hashlib.sha256(content).digest() + content
    with whole_file(path, len(whole)) as draft:
        draft.write_bytes(whole)
        draft.chmod(0o644)


def read_code(path: Path, source: Path, listed: str | None = None) -> bytes | None:
    """The content of ``path``; None if it is missing, damaged, or may have been written by another user.

    Parameters
    ----------
    source : Path
        The file with the Python source of the code.
    listed : str, optional
        The SHA-256 that the whole file must have, in hexadecimal digits.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        _say_unused(path, error.strerror or "it cannot be read")
        return None
    with open(descriptor, "rb") as file:
        reason = distrusted(os.fstat(descriptor), source)
        whole = b"" if reason else file.read()
    content = memoryview(whole)[START:]
    if not reason and (
        whole[:START] != HEADER + hashlib.sha256(content).digest()
        or (listed is not None and hashlib.sha256(whole).hexdigest() != listed)
    ):
        reason = "it is damaged"
    if reason:
        _say_unused(path, reason)
        return None
    return bytes(content)


def distrusted(found: os.stat_result, source: Path) -> str:
    """Why a file of code made from ``source`` is not read; empty if it is."""
    if not stat.S_ISREG(found.st_mode):
        return "it is no file"
    if os.name == "nt":  # which has no modes
        return ""
    origin = source.stat()
    if found.st_uid not in (os.geteuid(), 0, origin.st_uid):
        return "it belongs to another user"
    if found.st_mode & 0o022 & ~origin.st_mode:
        return f"others may write it (mode {found.st_mode & 0o777:o})"
    return ""


def _say_unused(path: Path, reason: str) -> None:
    """One line for each folder and reason, with the first file."""
    if (path.parent, reason) not in SAID:
        SAID.add((path.parent, reason))
        LOG.warning("the machine code %s is not used: %s; the kernel is compiled", path, reason)
