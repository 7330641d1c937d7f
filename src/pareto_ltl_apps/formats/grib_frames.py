"""Frames of GRIB files: lengths of messages and sections, numbers of values, and which quantities there are.

ecCodes does not check the lengths in a message: wrong ones end the process (``double free``) or make it
allocate all memory. So they are checked before ecCodes opens a file; a few bytes of each section are read.
Formats: WMO Manual on Codes, FM 92 GRIB edition 2 (sections 0 to 8) and edition 1.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from pareto_ltl.support.errors import DataError

MAX_NODES = 20_000_000  # nodes of a field; a global grid of 0.1 degrees has 6.5 million
MAX_BITS = 32  # bits of a packed value
START, END = b"GRIB", b"7777"
BLOCK = 2**16  # bytes searched at a time for the start of a message
COUNT_PLACE = {3: 6, 5: 5}  # section: position of its number of values, 4 bytes
MEMBER_TEMPLATES = (1, 11)  # of section 4: a member of an ensemble
MEMBER_PLACE = 35  # of its number, in section 4


class Parameter(NamedTuple):
    """The quantity of a field: of edition 2 ``number`` is (discipline, category, number), of 1 (number,)."""

    number: tuple[int, ...]
    member: int | None = None


def parameters(stream: BinaryIO) -> Iterator[Parameter]:
    """The quantity of every field of ``stream``, an open GRIB file whose frames are valid."""
    place = 0
    while (start := _next_start(stream, place)) is not None:
        head = _bytes_at(stream, start, 16)
        length = _message_length(stream, start)
        if head[7] == 1:
            yield Parameter((_bytes_at(stream, start + 8, 9)[8],))
        else:
            yield from _fields(stream, head[6], start + 16, start + length - len(END))
        place = start + length


def messages_with(stream: BinaryIO, numbers: Collection[tuple[int, ...]]) -> Iterator[bytes]:
    """The messages of ``stream``, an open GRIB file, with a field whose number is one of ``numbers``.

    BrokenFrameError if one is damaged.
    """
    place = 0
    while (start := _next_start(stream, place)) is not None:
        place = start + _message_length(stream, start)
        message = _bytes_at(stream, start, place - start)
        if any(parameter.number in numbers for parameter in parameters(io.BytesIO(message))):
            yield message


def _fields(stream: BinaryIO, discipline: int, place: int, end: int) -> Iterator[Parameter]:
    while place < end:
        head = _bytes_at(stream, place, 5)
        length = int.from_bytes(head[:4], "big")
        if head[4] == 4:
            section = _bytes_at(stream, place, length)
            template = int.from_bytes(section[7:9], "big")
            known = template in MEMBER_TEMPLATES and len(section) > MEMBER_PLACE
            member = section[MEMBER_PLACE] if known else None
            yield Parameter((discipline, *section[9:11]), member)
        place += length


class BrokenFrameError(ValueError):
    """A message with inconsistent lengths."""


def check_frames(file: Path, stream: BinaryIO) -> None:
    """Raise a DataError if a message of ``stream``, an open GRIB file, is damaged; rewind the stream."""
    place = 0
    while (start := _next_start(stream, place)) is not None:
        try:
            place = start + _message_length(stream, start)
        except BrokenFrameError as error:
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
            raise BrokenFrameError("edition 1 with more than 8 MiB; expected GRIB2")
        _check_old_sections(stream, start + 8, start + length - len(END))
    else:
        raise BrokenFrameError(f"edition {head[7]}; expected 1 or 2")
    if length < len(head) + len(END):
        raise BrokenFrameError(f"it claims to have {length} bytes")
    if _bytes_at(stream, start + length - len(END), len(END)) != END:
        raise BrokenFrameError("it does not end with 7777")
    return length


def _check_sections(stream: BinaryIO, place: int, end: int) -> None:
    """Check the sections of edition 2: 4 bytes of length, 1 byte of number."""
    packed = 0  # least size in bytes of the values of the next section 7
    while place < end:
        head = _bytes_at(stream, place, 5)
        length, number = int.from_bytes(head[:4], "big"), head[4]
        if length < 5 or not 1 <= number <= 7 or place + length > end:
            raise BrokenFrameError(f"no section begins at byte {place}")
        if number in COUNT_PLACE:
            count = int.from_bytes(_bytes_at(stream, place + COUNT_PLACE[number], 4), "big")
            if count > MAX_NODES:
                raise BrokenFrameError(f"it claims {count:,} values; {MAX_NODES:,} are the limit")
        if number == 5:
            packed = _packed_bytes(_bytes_at(stream, place, length))
        if number == 7 and length - 5 < packed:
            raise BrokenFrameError(f"its values take {packed:,} bytes, but there are {length - 5:,}")
        place += length


def _packed_bytes(section: bytes) -> int:
    """Size in bytes of values with simple packing (template 5.0); 0 for other packings (not known)."""
    if len(section) < 20:
        raise BrokenFrameError("section 5 is too short")
    count, template, bits = int.from_bytes(section[5:9], "big"), section[9:11], section[19]
    if bits > MAX_BITS:
        raise BrokenFrameError(f"{bits} bits a value; {MAX_BITS} are the limit")
    return -(-count * bits // 8) if template == b"\0\0" else 0


def _check_old_sections(stream: BinaryIO, place: int, end: int) -> None:
    """Check the sections of edition 1: 3 bytes of length; flags in the first one say which others exist."""
    first = _bytes_at(stream, place, 8)
    sections = 2 + bool(first[7] & 128) + bool(first[7] & 64)
    for _ in range(sections):
        length = int.from_bytes(_bytes_at(stream, place, 3), "big")
        if length < 3:
            raise BrokenFrameError(f"no section begins at byte {place}")
        place += length
    if place > end:
        raise BrokenFrameError("a section is longer than its message")


def _bytes_at(stream: BinaryIO, place: int, count: int) -> bytes:
    stream.seek(max(0, place))
    found = stream.read(count)
    if len(found) < count:
        raise BrokenFrameError("the file ends within it")
    return found
