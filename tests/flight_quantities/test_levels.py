"""Levels as text, and which of them belong together."""

from __future__ import annotations

import doctest

import pytest

from careful_io.errors import ConfigError
from flight_quantities import levels
from flight_quantities.levels import Level, level_list, nearest_level, parse_level, same_wind


def test_the_examples_in_docstrings_are_true():
    failed, tried = doctest.testmod(levels)
    assert failed == 0
    assert tried > 0


@pytest.mark.parametrize(
    ("text", "shown"),
    [("10m", "10m"), ("80 m", "80m"), ("0.5 KM", "500m"), ("925hPa", "925hPa"), ("925mb", "925hPa"),
     ("92500 Pa", "925hPa"), ("0m depth", "0m depth"), ("10m depth", "10m depth")],
)  # fmt: skip
def test_levels_are_read_in_the_units_that_people_use(text, shown):
    assert parse_level(text).text == shown
    assert parse_level(parse_level(text).text) == parse_level(text)


@pytest.mark.parametrize("text", ["", "surface", "10", "-5m", "925hPa depth", "0hPa", "9" * 400 + "m"])
def test_what_is_no_level_is_refused_with_examples(text):
    with pytest.raises(ConfigError, match=r"^chart\.level .*is not a level; expected a height .*10m"):
        parse_level(text, "chart.level")


def test_many_levels_are_listed_shortly():
    texts = level_list([Level("pressure", 1000.0 * k) for k in range(1, 20)])
    assert texts.endswith("and 7 more")
    assert texts.startswith("10hPa, 20hPa")


def test_the_level_of_a_temperature_is_near_that_of_the_wind():
    found = [parse_level(text) for text in ("2m", "80m", "500m", "925hPa")]
    assert nearest_level(found, Level("height", 100.0)) == found[1]
    assert nearest_level(found[2:], Level("height", 100.0)) is None
    assert nearest_level(found, parse_level("925hPa")) == found[3]
    assert nearest_level(found, parse_level("850hPa")) is None


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [("100m", "80m", True), ("100m", "79m", False), ("925hPa", "762m amsl", True),
     ("300m amsl", "300m", False),
     ("10m", "10m depth", False)],
)  # fmt: skip
def test_winds_within_a_fifth_of_the_height_are_the_same(one, other, same):
    assert same_wind(parse_level(one), parse_level(other)) is same
    assert same_wind(parse_level(other), parse_level(one)) is same
