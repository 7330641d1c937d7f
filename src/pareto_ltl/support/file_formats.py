"""Formats of wind files, recognised by their first bytes, and errors for files of another format."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from careful_io.messages import shown_text
from careful_io.reading import refuse_special
from pareto_ltl.support.errors import DataError

# Errors of h5netcdf and h5py for a damaged file or one of another format:
DAMAGE = (
    *(OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError, ArithmeticError),
    AssertionError,
)
HDF5 = b"\x89HDF\r\n\x1a\n"
STARTS = {
    b"GRIB": "GRIB",
    **dict.fromkeys((HDF5, b"CDF\x01", b"CDF\x02", b"CDF\x05"), "NetCDF"),
    b"\x1f\x8b": "packed with gzip",
    b"PK\x03\x04": "packed with zip",
    b"BZh": "packed with bzip2",
}  # formats by their first bytes
CURES = {
    "GRIB": "read it with wind.source=grib",
    "NetCDF": "read it with wind.source=netcdf",
    "a web page": "a failed download? fetch it again",
    "packed with gzip": "unpack it, or name a table .csv.gz",
    "packed with zip": "unpack it",
    "packed with bzip2": "unpack it",
}


def is_data_file(file: Path) -> bool:
    """Whether ``file`` may contain readings: False for hidden files, indices, texts and JSON."""
    return not file.name.startswith(".") and file.suffix.lower() not in (".idx", ".md", ".txt", ".json")


def format_of(head: bytes) -> str | None:
    """The format of a file that begins with ``head``: a key of ``CURES``; None if it is not known."""
    if head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"<":
        return "a web page"
    return next((name for start, name in STARTS.items() if head.startswith(start)), None)


def first_bytes(file: Path) -> bytes:
    """The first bytes of ``file``, which state its format; a DataError if it cannot be read."""
    refuse_special(file)
    try:
        with file.open("rb") as stream:
            return stream.read(64)
    except OSError as error:
        raise DataError(f"wind file {file} cannot be read: {error.strerror}") from None


@contextmanager
def wind_file(file: Path, expected: str, *damage: type[Exception]) -> Iterator[bytes]:
    """In the block, the first bytes of ``file``; errors of the libraries become a DataError in one line.

    ``damage`` lists the errors of a library that are not in :data:`DAMAGE`.

    Raises
    ------
    DataError
        If the file is empty, has another known format than ``expected``, or an error of a library is raised.
    """
    head = first_bytes(file)
    if not head.strip():
        raise DataError(f"wind file {file} is empty; fetch it again")
    refuse_other_format(f"wind file {file}", head, expected)
    errors: tuple[type[Exception], ...] = (*DAMAGE, MemoryError, *damage)
    try:
        yield head
    except errors as error:
        reason = shown_text(" ".join(str(error).split()), 200) or type(error).__name__
        raise DataError(f"wind file {file} is damaged or cannot be read ({reason}); fetch it again") from None


def refuse_other_format(where: str, head: bytes, expected: str) -> None:
    """Raise a DataError if the file that begins with ``head`` has a known format other than ``expected``."""
    found = format_of(head)
    if found is not None and found != expected:
        raise DataError(f"{where} is {found}, not {expected}; {CURES[found]}")
