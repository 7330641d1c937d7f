"""Lengths and heights of maps: every unit, datum and limit, against a table of factors."""

from __future__ import annotations

import math
from typing import Any

import pytest

from flight_quantities.lengths import MAX_METRES, Height, height, length_in_metres
from pareto_ltl.support.errors import DataError

FACTORS = {
    1.0: "m metre metres meter meters mtr",
    1000.0: "km kilometre kilometres kilometer kilometers",
    0.3048: "ft feet foot '",
    1852.0: "nm nmi nautical_mile nautical_miles",
    1609.344: "mi sm mile miles statute_mile statute_miles",
    0.9144: "yd yard yards",
}
UNITS = {unit.replace("_", " "): factor for factor, units in FACTORS.items() for unit in units.split()}
DATUMS = {
    "AMSL": ("amsl", "msl", "asl", "alt", "qnh", "wgs84"),
    "AGL": ("agl", "gnd", "sfc", "asfc", "agnd", "above ground"),
    "FL": ("std", "qne"),
}


@pytest.mark.parametrize(("unit", "factor"), UNITS.items())
def test_a_length_or_height_is_its_number_times_its_unit(unit: str, factor: float) -> None:
    for number, text in ((0.5, f"0.5{unit}"), (-3.0, f"-3 {unit.upper()}"), (1250.0, f"1.25e3  {unit}")):
        assert length_in_metres("x", text) == pytest.approx(number * factor)
        assert height("x", text) == (pytest.approx(number * factor), "")


@pytest.mark.parametrize(
    ("datum", "word"), [(datum, word) for datum, words in DATUMS.items() for word in words]
)
def test_a_height_has_the_datum_that_it_states(datum: str, word: str) -> None:
    assert height("x", f"500 ft {word}") == (pytest.approx(152.4), datum)
    assert height("x", f"12 {word.upper()}", "ft") == (pytest.approx(3.6576), datum)


@pytest.mark.parametrize(
    ("value", "found"),
    [
        (None, None), ("", None), (7, (7.0, "")), ("7", (7.0, "")), (0.0, (0.0, "")),
        ("GND", (0.0, "AGL")), ("surface", (0.0, "AGL")), ("msl", (0.0, "AMSL")), ("UNL", (math.inf, "")),
        ("FL95", (2895.6, "FL")), ("flight level 10 std", (304.8, "FL")), ("above 10 m", (10.0 + 1e-14, "")),
        (MAX_METRES, (MAX_METRES, "")), (-MAX_METRES, (-MAX_METRES, "")),
    ],
)  # fmt: skip
def test_heights_without_a_unit_are_metres_and_words_are_limits(value: Any, found: Any) -> None:
    told = height("x", value)
    assert told == found if found is None else told == (pytest.approx(found[0]), found[1])


def test_what_is_above_a_height_is_not_at_it() -> None:
    above = height("x", "above 400 ft")
    assert above is not None
    assert above.metres > 121.92
    assert above == Height(math.nextafter(400 * 0.3048, math.inf))


@pytest.mark.parametrize("value", [True, "x", "5 parsec", [5], 1.01e7, -1.01e7, math.nan, math.inf, "1e999"])
def test_what_is_no_length_is_refused(value: Any) -> None:
    with pytest.raises(DataError, match=r"^the radius is .*; expected a number of metres"):
        length_in_metres("the radius", value)


@pytest.mark.parametrize(
    "value", [True, "x", "5 parsec", [5], 1.01e7, -1.01e7, math.nan, math.inf, "5 m std x"]
)
def test_what_is_no_height_is_refused(value: Any) -> None:
    with pytest.raises(DataError, match=r"^its top is .*; expected a number of metres"):
        height("its top", value)


def test_the_longest_length_is_one() -> None:
    assert length_in_metres("x", MAX_METRES) == MAX_METRES
    assert length_in_metres("x", "10000 km") == MAX_METRES
    assert length_in_metres("x", -MAX_METRES) == -MAX_METRES
    assert length_in_metres("x", None) is None
    assert length_in_metres("x", "") is None
