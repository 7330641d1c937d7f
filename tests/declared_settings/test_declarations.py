"""Declared ranges: what is outside is refused in one line with key, range and value."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from careful_io.errors import ConfigError
from declared_settings import Declaration
from declared_settings.declarations import check_value
from declared_settings.kinds import kind_problem


@pytest.mark.parametrize(
    ("limits", "value", "line"),
    [
        ({"within": "(0, 9]", "unit": "s"}, 0.0, "key must be positive and at most 9 [s], got 0.0"),
        ({"within": "(0, 9]", "unit": "s"}, 10.0, "key must be positive and at most 9 [s], got 10.0"),
        ({"within": "[0, 9]", "unit": "s"}, 10.0, "key must lie in [0, 9] [s], got 10.0"),
        ({"within": "(0, 1)"}, 1.0, "key must lie between 0 and 1, both excluded, got 1.0"),
        ({"within": "[0, 1]"}, 1.5, "key must lie in [0, 1], got 1.5"),
        ({"within": "[0, 1]", "remark": "0: no"}, 2.0, "key must lie in [0, 1] (0: no), got 2.0"),
        ({"choices": ("a", "b")}, "c", "key must be one of a, b; got 'c'"),
        ({"distinct": True}, [], "key is empty: list at least one value, e.g. key=[1,2,3]"),
        ({"distinct": True, "choices": ("a", "b")}, [], "key is empty: list at least one of a, b"),
        ({"distinct": True}, [1, 2, 1], "key lists a value twice, got [1, 2, 1]"),
        ({"within": "[1, 9]"}, [3, 0], "key must lie in [1, 9], got 0"),
    ],
)
def test_a_refusal_is_one_line_with_key_range_and_value(
    limits: dict[str, Any], value: Any, line: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        check_value("key", value, Declaration("meaning", **limits))
    assert str(caught.value) == line


@given(st.floats(), st.floats(-5, 5), st.floats(0, 5))
def test_a_number_is_allowed_exactly_inside_its_limits(value: float, low: float, width: float) -> None:
    closed = Declaration("m", f"[{low!r}, {low + width!r}]")
    opened = Declaration("m", f"({low!r}, {low + width!r})")
    assert closed.allows(value) == (low <= value <= low + width)
    assert opened.allows(value) == (low < value < low + width)


def test_a_whole_number_that_was_written_as_a_float_is_named_in_digits() -> None:
    assert (
        kind_problem("n", 1e7, int)
        == "n must be a whole number, got 10000000.0; write it in digits, 10000000"
    )
    assert kind_problem("n", 2.5, int) == "n must be a whole number, got 2.5"
