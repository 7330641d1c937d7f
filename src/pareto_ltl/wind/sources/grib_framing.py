"""Checks of the lengths of GRIB messages and their sections, and of their numbers of values.

ecCodes does not check the lengths in a message: wrong ones end the process (``double free``) or make it
allocate all memory. So they are checked before ecCodes opens a file; a few bytes of each section are read.

Formats: WMO Manual on Codes, FM 92 GRIB edition 2 (sections 0 to 8) and edition 1.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from pareto_ltl.support.errors import DataError

MAX_NODES = 20_000_000  # nodes of a field; a global grid of 0.1 degrees has 6.5 million
MAX_BITS = 32  # bits of a packed value
START, END = b"GRIB", b"7777"
BLOCK = 2**16  # bytes searched at a time for the start of a message
COUNT_PLACE = {3: 6, 5: 5}  # section: position of its number of values, 4 bytes


class _BrokenFrameError(ValueError):
    """A message with inconsistent lengths."""


def check_frames(file: Path, stream: BinaryIO) -> None:
    """Raise a DataError if a message of ``stream``, an open GRIB file, is damaged; rewind the stream."""
    place = 0
    while (start := _next_start(stream, place)) is not None:
        try:
            place = start + _message_length(stream, start)
        except _BrokenFrameError as error:
            raise DataError(
                f"wind file {file} is damaged or truncated (message at byte {start}: {error}); "
                "download it again"
            ) from None
    stream.seek(0)


def _next_start(stream: BinaryIO, place: int) -> int | None:
    """Position of the next message, None if there is none; there may be other bytes between messages."""
    while True:
        stream.seek(place)
        block = stream.read(BLOCK)
        if (found := block.find(START)) >= 0:
            return place + found
        if len(block) < BLOCK:
            return None
        place += BLOCK - len(START) + 1


def _message_length(stream: BinaryIO, start: int) -> int:
    head = _bytes_at(stream, start, 16)
    if head[7] == 2:
        length = int.from_bytes(head[8:16], "big")
        _check_sections(stream, start + 16, start + length - len(END))
    elif head[7] == 1:
        length = int.from_bytes(head[4:7], "big")
        if length & 0x800000:
            raise _BrokenFrameError("edition 1 with more than 8 MiB; expected GRIB2")
        _check_old_sections(stream, start + 8, start + length - len(END))
    else:
        raise _BrokenFrameError(f"edition {head[7]}; expected 1 or 2")
    if length < len(head) + len(END):
        raise _BrokenFrameError(f"it claims to have {length} bytes")
    if _bytes_at(stream, start + length - len(END), len(END)) != END:
        raise _BrokenFrameError("it does not end with 7777")
    return length


def _check_sections(stream: BinaryIO, place: int, end: int) -> None:
    """Check the sections of edition 2: 4 bytes of length, 1 byte of number."""
    packed = 0  # least size in bytes of the values of the next section 7
    while place < end:
        head = _bytes_at(stream, place, 5)
        length, number = int.from_bytes(head[:4], "big"), head[4]
        if length < 5 or not 1 <= number <= 7 or place + length > end:
            raise _BrokenFrameError(f"no section begins at byte {place}")
        if number in COUNT_PLACE:
            _check_count(_bytes_at(stream, place + COUNT_PLACE[number], 4))
        if number == 5:
            packed = _packed_bytes(_bytes_at(stream, place, length))
        if number == 7 and length - 5 < packed:
            raise _BrokenFrameError(f"its values take {packed:,} bytes, but there are {length - 5:,}")
        place += length


def _check_count(field: bytes) -> None:
    count = int.from_bytes(field, "big")
    if count > MAX_NODES:
        raise _BrokenFrameError(f"it claims {count:,} values; {MAX_NODES:,} are the limit")


def _packed_bytes(section: bytes) -> int:
    """Size in bytes of values with simple packing (template 5.0); 0 for other packings (not known)."""
    if len(section) < 20:
        raise _BrokenFrameError("section 5 is too short")
    count, template, bits = int.from_bytes(section[5:9], "big"), section[9:11], section[19]
    if bits > MAX_BITS:
        raise _BrokenFrameError(f"{bits} bits a value; {MAX_BITS} are the limit")
    return -(-count * bits // 8) if template == b"\0\0" else 0


def _check_old_sections(stream: BinaryIO, place: int, end: int) -> None:
    """Check the sections of edition 1: 3 bytes of length; flags in the first one say which others exist."""
    first = _bytes_at(stream, place, 8)
    sections = 2 + bool(first[7] & 128) + bool(first[7] & 64)
    for _ in range(sections):
        length = int.from_bytes(_bytes_at(stream, place, 3), "big")
        if length < 3:
            raise _BrokenFrameError(f"no section begins at byte {place}")
        place += length
    if place > end:
        raise _BrokenFrameError("a section is longer than its message")


def _bytes_at(stream: BinaryIO, place: int, count: int) -> bytes:
    stream.seek(max(0, place))
    found = stream.read(count)
    if len(found) < count:
        raise _BrokenFrameError("the file ends within it")
    return found
