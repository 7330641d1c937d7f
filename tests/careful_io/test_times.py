"""Times as text: one reader for all, also at the ends of the calendar."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from careful_io.times import hours_text, seconds, utc_moment
from pareto_ltl.support.departure import seconds_after
from pareto_ltl.support.errors import DataError

TEXTS = ("2018-10-09T06:00", " 2018-10-09T08:00+02:00 ", "2018-10-09T06:00:00Z", "2018-10-09 06:00:00.000")


@pytest.mark.parametrize("text", TEXTS)
def test_a_time_without_a_zone_is_utc(text: str) -> None:
    assert utc_moment(text) == datetime(2018, 10, 9, 6, tzinfo=UTC)
    assert seconds(text) == 1_539_064_800.0


@pytest.mark.parametrize("text", ["0001-01-01T00:30+01:00", "9999-12-31T23:30-01:00"])
def test_a_moment_beyond_the_calendar_in_utc_is_no_time_for_any_reader(text: str) -> None:
    for read in (seconds, utc_moment):
        with pytest.raises(ValueError, match="outside of the calendar"):
            read(text)
    with pytest.raises(DataError, match="fix: time is"):
        seconds_after("fix: time", text, "2018-10-09T06:00:00Z")


@pytest.mark.parametrize("text", ["0001-01-01T00:00:00Z", "9999-12-31T23:59:59Z"])
def test_the_ends_of_the_calendar_are_times(text: str) -> None:
    assert seconds(text) == (utc_moment(text) - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0 s"), (30.0, "30 s"), (59.0, "59 s"), (60.0, "1 min"), (90.0, "1.5 min"), (61.0, "61 s"),
        (3600.0, "1 h"), (-3600.0, "-1 h"), (5400.0, "1.5 h"), (5460.0, "91 min"), (1800.0, "30 min"),
    ],
)  # fmt: skip
def test_a_duration_is_told_in_its_largest_unit_of_whole_or_half_numbers(seconds: float, text: str) -> None:
    assert hours_text(seconds) == text
