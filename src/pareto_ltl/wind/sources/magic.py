"""Formats of wind files, recognised by their first bytes, and errors for files of another format."""

from __future__ import annotations

from pareto_ltl.support.errors import DataError

HDF5, CLASSIC = b"\x89HDF\r\n\x1a\n", (b"CDF\x01", b"CDF\x02", b"CDF\x05")
CURES = {
    "GRIB": "read it with wind.source=grib",
    "NetCDF": "read it with wind.source=netcdf",
    "a web page": "a failed download? fetch it again",
    "packed with gzip": "unpack it, or name a table .csv.gz",
    "packed with zip": "unpack it",
    "packed with bzip2": "unpack it",
}


def format_of(head: bytes) -> str | None:
    """The format of a file that begins with ``head``: a key of ``CURES``; None if it is not known."""
    if head[:4] == b"GRIB":
        return "GRIB"
    if head[:8] == HDF5 or head[:4] in CLASSIC:
        return "NetCDF"
    if head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"<":
        return "a web page"
    if head[:2] == b"\x1f\x8b":
        return "packed with gzip"
    if head[:4] == b"PK\x03\x04":
        return "packed with zip"
    return "packed with bzip2" if head[:3] == b"BZh" else None


def refuse_other_format(where: str, head: bytes, expected: str) -> None:
    """Raise a DataError if the file that begins with ``head`` has a known format other than ``expected``."""
    found = format_of(head)
    if found is not None and found != expected:
        raise DataError(f"{where} is {found}, not {expected}; {CURES[found]}")
