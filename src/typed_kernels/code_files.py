"""Files of machine code: written whole, read only if undamaged and out of reach for other users.

Reading a file executes what it contains (it is a pickle of machine code), so these checks come first. The
checksum covers the name of the kernel, so that the code of one kernel is never called as another one; it
detects damage and exchange, and is not a signature. Code is as trustworthy as the source that it was made
from: a file and its folder must belong to the user, to root or to the owner of the source, and others may
write them only where they may write the source and its folder.
"""

from __future__ import annotations

import hashlib
import logging
import os
import stat
from pathlib import Path

LOG = logging.getLogger(__name__)
SUFFIX = ".nbc"
SAID: set[tuple[Path, str]] = set()
HEADER = b"typed_kernels code 1\n"
START = len(HEADER) + hashlib.sha256().digest_size


def packed_code(kernel: str, content: bytes) -> bytes:
    """The bytes of a file with the code ``content`` of ``kernel``: header, checksum, name, code."""
    rest = kernel.encode() + b"\n" + content
    return HEADER + hashlib.sha256(rest).digest() + rest


def write_code(path: Path, source: Path, kernel: str, content: bytes) -> None:
    """Write the code ``content`` of ``kernel`` as the whole file ``path``.

    OSError if that is not possible, or if others can write the folder, so that it would not be read.
    """
    if reason := distrusted_folder(path.parent, source):
        raise PermissionError(reason)
    if path.exists() and not path.is_file():
        raise FileExistsError(f"{path.name} is a folder or a device")
    draft = path.with_name(f".{os.getpid()}.{path.name}")
    draft.unlink(missing_ok=True)
    try:
        with open(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644), "wb") as file:  # no link
            file.write(packed_code(kernel, content))
            file.flush()
            os.fsync(file.fileno())
        draft.chmod(0o644)
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def read_code(path: Path, source: Path, kernel: str, listed: str | None = None) -> bytes | None:
    """The code of ``kernel`` in the file ``path``; None if it is missing or must not be executed.

    That is so if it is damaged, the code of another kernel, or may have been written by another user.

    Parameters
    ----------
    source : Path
        The file with the Python source of the code.
    kernel : str
        The name of the kernel and of its types, as :func:`write_code` got it.
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
        reason = distrusted(os.fstat(descriptor), source) or distrusted_folder(path.parent, source)
        whole = b"" if reason else file.read()
    name, _, content = whole[START:].partition(b"\n") if not reason else (b"", b"", b"")
    if not reason and (
        whole[:START] != HEADER + hashlib.sha256(memoryview(whole)[START:]).digest()
        or (listed is not None and hashlib.sha256(whole).hexdigest() != listed)
    ):
        reason = "it is damaged"
    elif not reason and name != kernel.encode():
        reason = "it is the code of another kernel"
    if reason:
        _say_unused(path, reason)
        return None
    return content


def distrusted_folder(folder: Path, source: Path) -> str:
    """Why code in ``folder`` is not read: others may put files there, and may not where ``source`` is."""
    reason = _open_to_others(folder.stat(), source.parent.stat())
    return f"its folder: {reason}" if reason else ""


def distrusted(found: os.stat_result, source: Path) -> str:
    """Why a file of code made from ``source`` is not read; empty if it is."""
    if not stat.S_ISREG(found.st_mode):
        return "it is no file"
    return _open_to_others(found, source.stat())


def _open_to_others(found: os.stat_result, origin: os.stat_result) -> str:
    if os.name == "nt":  # which has no modes
        return ""
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
