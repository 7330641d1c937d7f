"""The packaged law of currents: where it is used by default, and what is said of its one situation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from careful_io.times import HOUR
from flight_quantities import frames
from pareto_ltl.extend import law_of_parts_named
from pareto_ltl.settings import WindConfig
from pareto_ltl.wind.observations import law_of_wind, place_readings
from pareto_ltl.wind.readings import Readings
from pareto_ltl.world.scene import Scene
from pareto_ltl_verify.wind_law import error_law
from wind_laws.documents import PARTS_FOLDER
from wind_laws.error_law import LOCAL, SLOW

LAW = law_of_parts_named("currents")
PLANE = frames.local_plane(40.0, -70.0)
SCENE = Scene(np.array([[-5e4, -5e4], [5e4, 5e4]]), np.zeros(2), {}, (), PLANE, "2018-10-09T00:00:00Z")


def currents(leads: float = np.nan, level: str = "0m depth", times: int = 3) -> Readings:
    lon, lat = np.meshgrid(np.linspace(-71.5, -68.5, 9), np.linspace(38.5, 41.5, 9))
    nodes = np.stack([lon.ravel(), lat.ravel()], axis=1)
    winds = np.random.default_rng(0).normal(0.0, 0.2, (times, len(nodes), 2))
    hours = [f"2018-10-09T{6 * k:02d}:00:00Z" for k in range(times)]
    ages = HOUR * (leads + 6.0 * np.arange(times))
    return Readings.of_arrays(hours, nodes, winds, level=level, leads=ages)


def test_the_law_of_currents_rests_on_one_situation_and_has_a_floor_of_one_half() -> None:
    assert (LAW.situations, LAW.floor, LAW.level) == (1, 0.5, "0m depth")
    assert [part.name for part in LAW.parts] == [SLOW, LOCAL]
    assert "one situation" in LAW.origin


def test_the_change_of_currents_has_a_tide_and_does_not_grow_after_two_days() -> None:
    lags = HOUR * np.array([6.0, 12.0, 48.0, 216.0])
    six, half_a_day, two_days, nine_days = np.sqrt(LAW.change_variance(lags))
    assert half_a_day < 0.8 * six  # the tide returns after 12.4 h
    np.testing.assert_allclose(nine_days, two_days)


def test_the_checker_reads_the_same_law() -> None:
    other = error_law(json.loads((PARTS_FOLDER / "currents.json").read_text()))
    leads = HOUR * np.linspace(0.0, 300.0, 121)
    np.testing.assert_allclose(other.forecast_variance(leads), LAW.forecast_variance(leads), rtol=1e-12)
    lags = HOUR * np.linspace(0.0, 300.0, 121)
    np.testing.assert_allclose([other.change_variance(t) for t in lags], LAW.change_variance(lags), rtol=1e-9)


@pytest.mark.parametrize(
    ("source", "level", "asked", "expected"),
    [
        ("currents", "0m depth", "auto", "currents"),
        ("rtofs", "0m depth", "auto", "currents"),
        ("csv", "30m depth", "auto", "currents"),
        ("csv", "10m", "auto", "gfs"),
        ("csv", "30m depth", "gfs", "gfs"),
    ],
)
def test_currents_have_their_law_by_default(source: str, level: str, asked: str, expected: str) -> None:
    path = None if source == "rtofs" else "x"
    cfg = WindConfig(source=source, path=path, level=level, forecast_error=asked)
    assert law_of_wind(cfg, currents(0.0, level)).name == expected


def test_currents_of_unknown_age_are_forecasts_and_one_situation_is_said(
    caplog: pytest.LogCaptureFixture,
) -> None:
    cfg = WindConfig(source="currents", path="x", level="0m depth")
    seen = place_readings(cfg, currents(), SCENE)
    np.testing.assert_allclose(seen.leads, HOUR * np.array([4.0, 10.0, 16.0]))
    assert "rests on 1 situation: no promise below 50.0 % can be claimed" in caplog.text


def test_the_tables_of_the_law_are_those_of_a_tide_that_repeats() -> None:
    """Second road: with only the tide, lines and a held difference leave no error at any lead."""
    import sys

    sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
    try:
        from packaged_currents import LINES, errors, lines_at, mean_square
    finally:
        sys.path.pop(0)
    weights = np.random.default_rng(1).normal(0.0, 0.3, (1 + 2 * len(LINES), 2 * 5))
    tide = (lines_at(np.arange(67.0)) @ weights).reshape(67, 5, 2)
    found = errors(tide)
    assert max(mean_square(found, lead) for lead in (1, 6, 12, 24)) < 1e-20
    walk = np.cumsum(np.random.default_rng(2).normal(0.0, 0.1, (67, 4000, 2)), axis=0)
    assert mean_square(errors(walk), 1) > 0.9 * 0.1**2  # what no line predicts is left
