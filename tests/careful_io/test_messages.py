"""What a user typed, as messages repeat it: printable and short."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from careful_io.messages import LONGEST_LINE, shown_line, shown_text, shown_value


@given(st.text(max_size=300), st.integers(10, 100))
def test_a_text_is_printable_and_short(text: str, width: int) -> None:
    shown = shown_text(text, width)
    assert len(shown) <= width
    assert shown.isprintable()


@given(st.text(st.characters(categories=["L", "N"]), max_size=80))
def test_a_short_printable_text_is_repeated_as_it_is(text: str) -> None:
    assert shown_text(text) == text


def test_a_long_text_keeps_its_ends() -> None:
    assert shown_text("a" * 500 + "z" * 500, 11) == "aaaa...zzzz"


def test_a_value_that_python_cannot_write_is_described() -> None:
    nested: list[object] = []
    for _ in range(100_000):
        nested = [nested]
    assert shown_value(10**5000) == "a number with thousands of digits"
    assert shown_value(nested) == "a value that is nested too deeply to be shown"


def test_a_line_is_one_line_without_control_characters_and_long_words() -> None:
    line = shown_line("a\x1b[31m b\nc " + "x" * 5000)
    assert line.startswith("a\\x1b[31m b c xxx")
    assert len(line) < 120
    assert len(shown_line("word " * 5000)) <= LONGEST_LINE


def test_a_path_with_spaces_and_other_letters_is_repeated_as_it_is() -> None:
    line = "/home/Größe und Höhe/風.csv: cannot be read"
    assert shown_line(line) == line
