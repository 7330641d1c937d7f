"""Time windows: reading them, and when they hold."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from careful_io.times import duration_seconds
from ltlf.spans import read_span, shown_span
from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.departure import seconds_after
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.scene_files import scene_from_dict, scene_to_dict
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl.world.windows import TimedPlace, Window, missed_windows, span_text

DEPARTURE = "2018-10-09T06:00:00Z"
SQUARE = [[1, 1], [2, 1], [2, 2], [1, 2]]


def scene_of(windows: dict[str, object]) -> SceneConfig:
    return SceneConfig(bounds=[[0, 0], [4, 4]], start=[0.5, 0.5], regions={"a": SQUARE}, windows=windows)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("6h", 21_600.0),
        ("90 min", 5_400.0),
        ("1.5d", 129_600.0),
        ("30s", 30.0),
        ("0", 0.0),
        ("-1h", -3_600.0),
    ],
)
def test_durations_are_read(text: str, seconds: float) -> None:
    assert duration_seconds(text) == seconds


@pytest.mark.parametrize("text", ["6", "h", "6 hours", "", "six h", "6h30"])
def test_what_is_no_duration(text: str) -> None:
    assert duration_seconds(text) is None


def test_times_of_day_count_from_departure() -> None:
    assert seconds_after("x", "2018-10-09T12:30:00Z", DEPARTURE) == 6.5 * 3600
    assert seconds_after("x", "2018-10-09T12:30:00", DEPARTURE) == 6.5 * 3600  # UTC where nothing is said
    assert seconds_after("x", "2018-10-09T12:30:00+02:00", DEPARTURE) == 4.5 * 3600
    assert seconds_after("x", 90.0, None) == 90.0


@pytest.mark.parametrize(
    ("value", "departure", "said"),
    [
        ("noon", DEPARTURE, "expected an ISO 8601 time"),
        ("2018-10-09T12:00:00Z", None, "set mission.start_time"),
        (True, DEPARTURE, "expected an ISO 8601 time"),
    ],
)
def test_bad_times_are_named(value: object, departure: str | None, said: str) -> None:
    with pytest.raises(DataError, match=said):
        seconds_after("window 'a': from", value, departure)


@given(
    begin=st.floats(-1e6, 1e6), length=st.floats(1.0, 1e6), at=st.floats(-2e6, 2e6), step=st.floats(1.0, 1e5)
)
def test_a_window_that_holds_at_a_moment_meets_every_step_around_it(
    begin: float, length: float, at: float, step: float
) -> None:
    window = Window("a", begin, begin + length)
    assert window.holds_at(at) == window.meets(at, at)
    if window.holds_at(at):
        assert window.meets(at - step, at)
        assert window.meets(at, at + step)
    if at < begin - 1.0 or at > begin + length + 1.0:
        assert not window.holds_at(at)


def test_windows_of_settings_are_in_seconds_after_departure_and_survive_the_file() -> None:
    cfg = scene_of(
        {"a": {"until": "2018-10-09T18:00:00Z"}, "late": {"region": "a", "from": "2h", "forbidden": True}}
    )
    scene = scene_from_settings(cfg, DEPARTURE)
    assert scene.windows == {"a": Window("a", -math.inf, 43_200.0), "late": Window("a", 7_200.0, math.inf)}
    assert scene.forbidden == ("late",)
    again = scene_from_dict(scene_to_dict(scene))
    assert (again.windows, again.forbidden) == (scene.windows, scene.forbidden)


def test_times_without_a_zone_are_warned_of_once_with_their_places(caplog: pytest.LogCaptureFixture) -> None:
    plain, zoned = "2018-10-09T18:00", "2018-10-09T18:00:00+02:00"
    windows = {"a": {"until": plain}, "b": {"region": "a", "from": zoned}, "c": {"region": "a", "from": "2h"}}
    scene = scene_from_settings(scene_of(windows), DEPARTURE)
    assert scene.windows["a"].end - scene.windows["b"].begin == 7200.0
    (warning,) = [record.message for record in caplog.records if "no zone" in record.message]
    assert "times of a state no zone and are taken as UTC" in warning
    caplog.clear()
    scene_from_settings(scene_of({key: windows[key] for key in ("b", "c")}), DEPARTURE)
    assert "no zone" not in caplog.text


@pytest.mark.parametrize(
    ("windows", "said"),
    [
        ({"a": {"from": "6h", "until": "6h"}}, "is empty; expected from < until"),
        ({"b": {"region": "z", "until": "6h"}}, "is of region 'z'; the map has a"),
        ({"b": {"region": "a"}}, "expected {from: TIME"),
        ({"b": {"region": "a", "till": "6h"}}, "expected {from: TIME"),
        ({"b": 6}, "expected {from: TIME"),
        ({'a"b': {"region": "a", "until": "6h"}}, "cannot stand in a formula"),
        ({"a": {"until": "tea time"}}, "until is 'tea time'; expected an ISO 8601 time"),
    ],
)
def test_bad_windows_are_named(windows: dict[str, object], said: str) -> None:
    with pytest.raises(DataError, match=said):
        scene_from_settings(scene_of(windows), DEPARTURE)


def test_windows_are_said_in_words() -> None:
    assert span_text(7200.0, 21_600.0) == "from 2 h until 6 h after departure"
    assert span_text(-math.inf, 5400.0) == "until 1.5 h after departure"
    assert span_text(1800.0, math.inf) == "from 30 min on after departure"
    assert str(TimedPlace("a", "a", None, "6h").window("map", None)) == "in a until 6 h after departure"


def test_windows_that_no_plan_meets_are_named():
    windows = {
        "gone": Window("a", -7200.0, -3600.0),
        "late": Window("a", 90_000.0, math.inf),
        "met": Window("a", -3600.0, 0.0),  # it ends at departure
        "last": Window("a", 86_400.0, math.inf),  # it begins when the longest plan ends
        "open": Window("a"),
    }
    assert missed_windows(windows, 86_400.0) == [
        "the time window of 'gone' ended 1 h before the departure: it never holds",
        "the time window of 'late' begins 25 h after departure, and a plan ends after 24 h: it never holds",
    ]


@pytest.mark.parametrize(
    ("span", "text"),
    [
        ((0.0, 21_600.0), "[0,6h]"), ((21_600.0, 86_400.0), "[6,24h]"), ((0.0, 43_200.0), "[0,0.5d]"),
        ((60.0, 3600.0), "[1,60min]"), ((1.0, 60.0), "[1,60s]"),
    ],
)  # fmt: skip
def test_a_span_is_told_in_the_largest_unit_that_fits_both_ends_and_is_read_again(span, text) -> None:
    assert shown_span(span) == text
    assert read_span(text) == span


@given(
    st.floats(-1e5, 1e5), st.floats(0.0, 1e5), st.floats(0.0, 1e5), st.floats(-1e5, 1e5), st.floats(0.0, 1e5)
)
def test_a_later_window_holds_at_the_same_moments(
    begin: float, length: float, moment: float, first: float, stay: float
) -> None:
    window = Window("a", begin, begin + length)
    later = window.later(moment)
    assert later == Window("a", begin - moment, begin + length - moment)
    assert Window("a").later(moment) == Window("a")
    last = first + stay
    assert window.meets(first, last) == (max(begin, first) - 1e-6 <= min(begin + length, last))
    assert window.holds_at(first) == window.meets(first, first)
    for inside in (begin, begin + length):
        assert window.holds_at(inside)
        assert window.meets(inside, inside + 1.0)
        assert window.meets(inside - 1.0, inside)
