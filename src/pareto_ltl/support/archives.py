"""Archives of arrays (``.npz``) from outside: what a header claims is compared with the size of the file."""

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

from pareto_ltl.support.errors import DataError
from pareto_ltl.support.reading import RESULTS, Advice

FREE_BYTES = 256 * 2**20  # of arrays, however small the file
MAX_RATIO = 20  # of the bytes of arrays to those of the file, beyond FREE_BYTES; a zip bomb has up to 1032
MAGIC = b"\x93NUMPY\x01\x00"
HEADER = re.compile(  # truth values, numbers and text; sides and sizes of at most 18 digits, at most 8 sides
    r"{'descr': '(?P<type>[<>|=]?[biufU]\d{1,9})', 'fortran_order': (?P<fortran>True|False), "
    r"'shape': \((?P<shape>(\d{1,18}, ?){0,8}(\d{1,18})?)\), } *\n"
)
DAMAGE = (
    *(ValueError, TypeError, EOFError, KeyError, RuntimeError, OverflowError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)


class _ForeignError(ValueError):
    """An archive that is none of ours; the text says why."""


def read_npz(path: Path, advice: Advice = RESULTS) -> dict[str, NDArray[Any]]:
    """The arrays in the archive ``path`` by name, no pickled objects; a DataError where it is no archive."""
    with _described_damage(path, advice), path.open("rb") as file, zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
        _check_size(entries, file.seek(0, 2))
        names = [entry.filename.removesuffix(".npy") for entry in entries]
        if len(set(names)) < len(names):
            raise _ForeignError("two arrays have one name")
        return {name: _read_entry(archive, entry) for name, entry in zip(names, entries, strict=True)}


@contextmanager
def _described_damage(path: Path, advice: Advice) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise DataError(f"{path}: cannot be read ({reason}); {advice.missing}") from error
    except DAMAGE as error:
        reason = " ".join(str(error).split())[:200]
        raise DataError(f"{path}: not an archive of arrays ({reason}); {advice.damaged}") from error


def _check_size(entries: list[zipfile.ZipInfo], size: int) -> None:
    """Refuse an archive that unpacks to far more than it holds."""
    total = sum(entry.file_size for entry in entries)
    if total > FREE_BYTES + MAX_RATIO * size:
        raise _ForeignError(f"its {size:,} bytes unpack to {total:,}, more than arrays of numbers do")


def _read_entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """One array; its header must tell the size that the entry has."""
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
    """Shape, order of axes and type of an array, as NumPy writes them."""
    start = stream.read(len(MAGIC) + 2)
    if not start.startswith(MAGIC) or len(start) < len(MAGIC) + 2:
        raise _ForeignError(f"{name} is no array of NumPy's format 1.0")
    (length,) = struct.unpack("<H", start[len(MAGIC) :])
    told = HEADER.fullmatch(stream.read(length).decode("latin1"))
    if told is None:
        raise _ForeignError(f"{name} has a header that is not understood; expected numbers or text")
    shape = tuple(int(side) for side in re.findall(r"\d+", told["shape"]))
    return shape, told["fortran"] == "True", np.dtype(told["type"])
