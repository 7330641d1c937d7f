"""The header of a table of text: which line it is, and which one is shown if none fits."""

from __future__ import annotations

from typing import Any

import pytest

from pareto_ltl_apps.formats import tables

WIDEST = ["time", "u", *["x"] * (tables.MAX_COLUMNS - 2)]


def fits(titles: list[str]) -> bool:
    return {"time", "u"} <= set(titles)


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        ([["time", "u"], ["1", "2"]], (["time", "u"], True)),
        ([[], [" "], ["sep=;"], ["#comment"], ['"Time"', " U "]], (["time", "u"], True)),
        ([["# time", "u"]], (["time", "u"], True)),
        ([["sep=;"], ["%comment"], ["a", "b"], ["c"]], (["a", "b"], False)),
        ([["sep=;"], ["#comment"], ["", ""]], None),
        ([["sepia"], ["a"]], (["sepia"], False)),
        ([], None),
        ([["a"]] * tables.MAX_HEADER_LINES + [["time", "u"]], (["a"], False)),
        ([["a"]] * (tables.MAX_HEADER_LINES - 1) + [["time", "u"]], (["time", "u"], True)),
        ([WIDEST], (WIDEST, True)),
        ([[*WIDEST, "x"]], ([*WIDEST, "x"], False)),
    ],
)  # fmt: skip
def test_the_header_is_the_first_line_that_fits(rows: list[list[str]], found: Any) -> None:
    assert tables._header(iter(rows), fits) == found  # noqa: SLF001


@pytest.mark.parametrize(
    ("text", "seconds", "zoned"),
    [
        ("1539064800", 1_539_064_800.0, True),
        ("1539064800000", 1_539_064_800.0, True),  # milliseconds
        ("2018-10-09T06:00:00Z", 1_539_064_800.0, True),
        ("2018-10-09T08:00:00+02:00", 1_539_064_800.0, True),
        ("2018-10-09 06:00 UTC", 1_539_064_800.0, True),
        ("2018-10-09 06:00", 1_539_064_800.0, False),
        ("09.10.2018 06:00", 1_539_064_800.0, False),
        ("2018/10/09 06:00 gmt", 1_539_064_800.0, True),
    ],
)
def test_a_time_of_a_table_is_read_with_its_zone(text: str, seconds: float, zoned: bool) -> None:
    assert tables.seconds_of(f" {text} ") == (seconds, zoned)
