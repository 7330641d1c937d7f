"""Times, names of folders, pairs and matrices: what is none is refused in one short line."""

from __future__ import annotations

import math
from typing import Any

import pytest

from careful_io.errors import ConfigError
from declared_settings import are_pairs, check_folder_name, check_matrix, check_time


def test_a_time_is_taken_with_an_offset_or_without() -> None:
    for text in ("2018-10-09T18:00:00Z", "2018-10-09 18:00", "20181009T180000+02:00", None):
        check_time("key", text)


@pytest.mark.parametrize(
    "name", ["CON", "aux", "nul.txt", "Com1", "lpt9.tar.gz", "a.", "", "a/b", "..", "x" * 101, "é"]
)
def test_a_name_that_some_system_cannot_use_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="name must") as caught:
        check_folder_name("name", name)
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize("name", ["plan", "console", "a.b", "x" * 100, "7", "A-b_c"])
def test_a_name_that_every_system_can_use_is_taken(name: str) -> None:
    check_folder_name("name", name)


@pytest.mark.parametrize("value", [[], [[1.0, 2]], [[0, 0], [1, 1], [2, 2]]])
def test_lists_of_two_finite_numbers_are_pairs(value: Any) -> None:
    assert are_pairs(value)


@pytest.mark.parametrize("value", [None, 3, ((1, 2),), [[1]], [[1, True]], [[1, math.nan]], [["1", "2"]]])
def test_other_values_are_no_pairs(value: Any) -> None:
    assert not are_pairs(value)


def test_a_matrix_has_two_rows() -> None:
    check_matrix("a", [[1, 0], [0, 1]])
    with pytest.raises(ConfigError, match=r"^a must be a 2 x 2 matrix of numbers, got \[\[1, 0\]\]$"):
        check_matrix("a", [[1, 0]])
