"""Reading of ``.npz`` archives that may be damaged or hostile: sizes in headers are checked before use."""

from __future__ import annotations

import math
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from careful_io.errors import DataError
from careful_io.reading import RESULTS, refuse_special

FREE_BYTES = 256 * 2**20  # unpacked bytes that are allowed for a file of any size
MAX_RATIO = 20  # largest ratio of unpacked bytes to file size beyond FREE_BYTES; a zip bomb has up to 1032
MAGIC = b"\x93NUMPY\x01\x00"
HEADER = re.compile(  # booleans, numbers and text; at most 8 axes, lengths of at most 18 digits
    r"{'descr': '(?P<type>[<>|=]?[biufU]\d{1,9})', 'fortran_order': (?P<fortran>True|False), "
    r"'shape': \((?P<shape>(\d{1,18}, ?){0,8}(\d{1,18})?)\), } *\n"
)
DAMAGE = (
    *(ValueError, TypeError, EOFError, KeyError, RuntimeError, OverflowError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)


class _ForeignError(ValueError):
    """An archive that this package cannot have written; the text gives the reason."""


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of the archive ``path``, by name; pickled objects are refused.

    DataError if the file cannot be read, is damaged, or unpacks to far more than its size.
    """
    refuse_special(path)
    with _described_damage(path), path.open("rb") as file, zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
        _check_size(entries, file.seek(0, 2))
        names = [entry.filename.removesuffix(".npy") for entry in entries]
        if len(set(names)) < len(names):
            raise _ForeignError("two arrays have one name")
        return {name: _read_entry(archive, entry) for name, entry in zip(names, entries, strict=True)}


@contextmanager
def _described_damage(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise DataError(f"{path}: cannot be read ({reason}); {RESULTS.missing}") from error
    except DAMAGE as error:
        reason = " ".join(str(error).split())[:200]
        raise DataError(f"{path}: not an archive of arrays ({reason}); {RESULTS.damaged}") from error


def _check_size(entries: list[zipfile.ZipInfo], size: int) -> None:
    """Raise if the entries unpack to far more than ``size``, the bytes of the file."""
    total = sum(entry.file_size for entry in entries)
    if total > FREE_BYTES + MAX_RATIO * size:
        raise _ForeignError(f"its {size:,} bytes unpack to {total:,}, more than arrays of numbers do")


def _read_entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """Read one array; raise if the size in its header differs from the size of the entry."""
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise _ForeignError(f"{entry.filename} is packed in an unknown way")
    with archive.open(entry) as stream:
        shape, fortran, dtype = _read_header(entry.filename, stream)
        count = math.prod(shape)
        if count * dtype.itemsize != entry.file_size - stream.tell():
            raise _ForeignError(
                f"{entry.filename} claims {dtype} of shape {shape}, which is not the size of its data"
            )
        flat = np.frombuffer(bytearray(stream.read()), dtype, count) if count else np.empty(0, dtype)
    return flat.reshape(shape, order="F" if fortran else "C")


def _read_header(name: str, stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether in Fortran order, and type of an array, from a header of NumPy's format 1.0."""
    start = stream.read(len(MAGIC) + 2)
    if not start.startswith(MAGIC) or len(start) < len(MAGIC) + 2:
        raise _ForeignError(f"{name} is not an array of NumPy's format 1.0")
    (length,) = struct.unpack("<H", start[len(MAGIC) :])
    match = HEADER.fullmatch(stream.read(length).decode("latin1"))
    if match is None:
        raise _ForeignError(f"{name} has a header that is not understood; expected numbers or text")
    shape = tuple(int(side) for side in re.findall(r"\d+", match["shape"]))
    return shape, match["fortran"] == "True", np.dtype(match["type"])
