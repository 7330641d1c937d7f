"""GRIB files whose lengths contradict each other are refused before ecCodes, which they can bring down."""

from __future__ import annotations

from pathlib import Path

import pytest

from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.grib_files import grib_snapshots
from pareto_ltl_apps.formats.grib_frames import check_frames

SECTION_3, SECTION_5, SECTION_7 = 16 + 21, 16 + 21 + 72 + 34, 16 + 21 + 72 + 34 + 21 + 6


def section(number: int, length: int, content: bytes = b"") -> bytes:
    return length.to_bytes(4, "big") + bytes([number]) + content + bytes(length - 5 - len(content))


def message(bits: int = 8, values: int = 36) -> bytearray:
    """The frame of a field of ``values`` numbers in simple packing, without its content."""
    packing = section(5, 21, values.to_bytes(4, "big") + b"\0\0" + bytes(8) + bytes([bits]))
    grid = section(3, 72, b"\0" + values.to_bytes(4, "big"))
    data = section(7, 5 + -(-values * 8 // 8))
    parts = section(1, 21) + grid + section(4, 34) + packing + section(6, 6) + data
    return bytearray(b"GRIB\0\0\0\x02" + (16 + len(parts) + 4).to_bytes(8, "big") + parts + b"7777")


def checked(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    with path.open("rb", buffering=0) as stream:
        check_frames(path, stream)
        assert stream.tell() == 0


def test_whole_messages_pass_with_other_bytes_between_them(tmp_path: Path) -> None:
    whole = bytes(message())
    checked(tmp_path / "a", whole)
    checked(tmp_path / "a", b"bulletin \r\r\n" + whole + b"GRI" + whole + bytes(70_000) + whole)
    checked(tmp_path / "a", b"GRIB\0\0\x2c\x01" + section_1() + (12).to_bytes(3, "big") + bytes(9) + b"7777")


def section_1() -> bytes:
    return (20).to_bytes(3, "big") + bytes(17)


@pytest.mark.parametrize(
    ("place", "change", "words"),
    [
        (8, (0).to_bytes(8, "big"), "it claims to have 0 bytes"),
        (8, (2**63).to_bytes(8, "big"), "damaged or truncated"),
        (7, b"\x09", "edition 9; expected 1 or 2"),
        (SECTION_3, (2**31).to_bytes(4, "big"), "no section begins at byte 37"),
        (SECTION_3, b"\0\0\0\0", "no section begins at byte 37"),
        (SECTION_3 + 6, b"\xff" * 4, "it claims 4,294,967,295 values"),
        (SECTION_5 + 5, b"\xff" * 4, "it claims 4,294,967,295 values"),
        (SECTION_5 + 19, b"\xff", "255 bits a value"),
        (SECTION_5 + 19, b"\x10", "its values take 72 bytes, but there are 36"),
        (SECTION_7 + 4, b"\x08", "no section begins"),
    ],
)
def test_lengths_that_contradict_each_other_are_refused(
    place: int, change: bytes, words: str, tmp_path: Path
) -> None:
    data = message()
    data[place : place + len(change)] = change
    with pytest.raises(DataError) as caught:
        checked(tmp_path / "a", bytes(data))
    assert words in str(caught.value)
    assert str(caught.value).endswith("download it again")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kept", [10, 40, 150, -4, -1])
def test_a_file_that_ends_within_a_message_is_refused(kept: int, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="damaged or truncated"):
        checked(tmp_path / "a", bytes(message()[:kept]))


def test_what_the_library_prints_of_a_damaged_message_stays_off_the_terminal(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.grib"
    path.write_bytes(bytes(message()))
    with pytest.raises(DataError):
        grib_snapshots((path,), 150.0)
    assert capfd.readouterr().err == ""
