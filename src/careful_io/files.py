"""Atomic writes of files whose bytes depend only on their content.

A file is written to a draft in the same folder, flushed to the disk and renamed, and its new name is
flushed: a reader never sees an incomplete file, and a failed write leaves the previous one. Archives
carry a fixed date; JSON keeps the order of its keys and has the fewest digits that read back as the same
number.
"""

from __future__ import annotations

import csv
import errno
import io
import json
import math
import os
import shutil
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

from careful_io.errors import DataError

FULL_DISK = (errno.ENOSPC, errno.EDQUOT)
NO_FLUSH = (errno.EINVAL, errno.ENOTSUP)  # of file systems without names that can be flushed
ARCHIVE_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest date that a zip archive can carry


@contextmanager
def whole_file(path: Path, size: int = 0) -> Iterator[Path]:
    """Yield the path of a draft, which replaces ``path`` when the block ends.

    If the block raises, the draft is removed and ``path`` is unchanged. DataError if ``path`` exists and is
    not a regular file. The OSError of a full disk names ``path``, the bytes that it needs (``size``, 0 if
    unknown) and the free ones.
    """
    if path.exists() and not path.is_file():
        raise DataError(f"{path} is a folder or a device, which no file may replace; name another place")
    draft = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        draft.unlink(missing_ok=True)
        os.close(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))  # does not follow a link
        yield draft
        with draft.open("r+b") as file:
            os.fsync(file.fileno())
        os.replace(draft, path)
        _flush_folder(path.parent)
    except OSError as error:
        if error.errno in FULL_DISK:
            raise OSError(error.errno, _full_disk_text(error, draft, size), str(path)) from error
        if str(error.filename) == str(draft):  # name the file that the user knows
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        draft.unlink(missing_ok=True)


def _flush_folder(folder: Path) -> None:
    """Flush the names in ``folder`` to the disk, so that a replaced file survives a loss of power."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows has no such call
        return
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno not in NO_FLUSH:
            raise
    finally:
        os.close(number)


def _full_disk_text(error: OSError, draft: Path, size: int) -> str:
    written = draft.stat().st_size if draft.exists() else 0
    need = f"it needs {size / 1e6:.3g} MB" if size else f"it needs more than {written / 1e6:.3g} MB"
    free = (shutil.disk_usage(draft.parent).free + written) / 1e6
    return f"{error.strerror}; {need}, {free:.3g} MB are free"


def remove_dead_drafts(folder: Path) -> None:
    """Remove the drafts of :func:`whole_file` in ``folder`` whose process no longer runs on this machine."""
    for draft in folder.glob(".*.*"):
        owner = draft.name.split(".")[1]
        if owner.isdigit() and not process_lives(int(owner)):
            draft.unlink(missing_ok=True)


def process_lives(number: int) -> bool:
    """Whether a process with this id runs on this machine, of any user."""
    import psutil

    return bool(psutil.pid_exists(number))


# --- writing ---------------------------------------------------------------------------------


def write_bytes(path: Path, data: bytes) -> None:
    """Write ``data`` as the whole file ``path``; its folder must exist."""
    with whole_file(path, len(data)) as draft:
        draft.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Write ``text`` in UTF-8, with its line ends unchanged."""
    write_bytes(path, text.encode())


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON object with one line per key, in the given order; NaN and infinity become null."""
    lines = [
        f" {json.dumps(key)}: {json.dumps(plain_data(value), allow_nan=False)}"
        for key, value in content.items()
    ]
    write_text(path, "{\n" + ",\n".join(lines) + "\n}\n")


def plain_data(value: Any) -> Any:
    """``value`` in the types of JSON: arrays as lists, sets as sorted lists, NaN and infinity as None."""
    if hasattr(value, "tolist"):  # an array or a number of NumPy, which is not imported here
        return plain_data(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain_data(item) for key, item in value.items()}
    if isinstance(value, frozenset | set):
        return sorted(plain_data(item) for item in value)
    if isinstance(value, list | tuple):
        return [plain_data(item) for item in value]
    return value


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write an ``.npz`` archive whose bytes depend only on the arrays: names sorted, one fixed date."""
    import numpy as np

    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zipped:
        for name in sorted(arrays):
            content = io.BytesIO()
            np.lib.format.write_array(content, np.ascontiguousarray(arrays[name]), allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", ARCHIVE_DATE)
            entry.external_attr = 0o644 << 16
            zipped.writestr(entry, content.getvalue(), zipfile.ZIP_DEFLATED, compresslevel=1)
    write_bytes(path, archive.getvalue())


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write the table :func:`csv_text`."""
    write_text(path, csv_text(header, rows))


def csv_text(header: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """A table with one header line; NaN, infinity and None become empty cells."""
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(header)
    table.writerows([plain_data(cell) for cell in row] for row in rows)
    return text.getvalue()
