"""Files from outside are read within limits, and what is wrong is said in one line with its place."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from careful_io import reading
from careful_io.reading import Advice, read_json, read_text
from pareto_ltl.support.errors import DataError


def refusal(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    with pytest.raises(DataError) as caught:
        read_json(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    return message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["not JSON", "line 1 column 1"]),
        (b"[1]", ["expected a JSON object, found an array"]),
        (b'{"a":\n 1,}', ["not JSON", "line 2"]),
        (b'{"a": [0, {"b": NaN}]}', ["/a/1/b: expected a finite number, got nan"]),
        (b'{"a": [0, -Infinity]}', ["/a/1: expected a finite number, got -inf"]),
        (b'{"a": 1e999}', ["/a: expected a finite number, got inf"]),
        (b'{"a": 1' + 400 * b"0" + b"}", ["/a: expected a finite number", "beyond 1e308"]),
        (b'{"a":\n 1' + 5000 * b"0" + b"}", ["line 2: a number has more than 1000 digits"]),
        (b'{"a": 1, "b": {"c": 1, "c": 2}}', ['the name "c" occurs twice']),
        (b'{"a": "\\ud800"}', ["/a: a text holds half of a character"]),
        (b'{"a\\ud800\\n": 1}', ["/a?\\n: a text holds half"]),
        (b'{"a":\n "\xff"}', ["line 2: byte 0xff is not UTF-8", "save the file as UTF-8"]),
        (100_000 * b"[" + 100_000 * b"]", ["nested deeper than 64 levels"]),
        (b'{"a":' + 70 * b"[" + 70 * b"]" + b"}", ["nested deeper than 64 levels"]),
    ],
)
def test_json_that_no_program_of_ours_writes_is_refused(
    content: bytes, words: list[str], tmp_path: Path
) -> None:
    message = refusal(tmp_path / "a.json", content)
    for word in (*words, "run the plan again"):
        assert word in message


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert read_json(tmp_path / "a.json") == {"a": 1}


def test_a_file_above_the_limits_is_refused_before_it_fills_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "MAX_ELEMENTS", 10)
    assert "more than 10 values" in refusal(tmp_path / "a.json", b"[" + 20 * b"[]," + b"1]")
    os.truncate(tmp_path / "a.json", 2**40)  # a sparse file of a terabyte
    with pytest.raises(DataError, match=r"a\.json: has more than 0\.5 MiB, which is the limit; shorten it"):
        read_text(tmp_path / "a.json", Advice("", "shorten it"), 2**19)


@pytest.mark.parametrize("name", ["missing.json", "", "a\0b"])
def test_a_file_that_cannot_be_opened_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"cannot be read .*; is it there\?"):
        read_json(tmp_path / name, Advice("is it there?"))
