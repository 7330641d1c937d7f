"""Holes in the wind, what is told of them, and what reports say is covered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flight_quantities import frames
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind import field
from pareto_ltl.wind.coverage import OwnErrors, coverage_of, held_warning, level_gap
from pareto_ltl.wind.named_laws import law_named
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.readings import CALM, Readings
from pareto_ltl.world.scene import Scene
from wind_laws.tables import time_variances

START = 1539043200.0  # 2018-10-09T00:00:00Z
SCENE = Scene(
    np.array([[-2e5, -2e5], [2e5, 2e5]]), np.zeros(2), {}, (), frames.local_plane(37.0, -92.0),
    "2018-10-09T01:00:00Z",
)  # fmt: skip


def readings(hours, leads=0.0, level="10m"):
    rng = np.random.default_rng(0)
    lon, lat = np.meshgrid(np.arange(-98.0, -85.0, 2.0), np.arange(32.0, 43.0, 2.0))
    nodes = np.stack([lon.ravel(), lat.ravel()], axis=-1)
    return Readings(
        times=START + 3600.0 * np.array(hours, float),
        points=(nodes,) * len(hours),
        winds=tuple(rng.normal(0, 3, nodes.shape) for _ in hours),
        geographic=True,
        files=(Path("winds.grib2"),),
        remarks=("",) * len(hours),
        origins=((Path("winds.grib2"),),) * len(hours),
        leads=np.broadcast_to(3600.0 * np.asarray(leads, float), len(hours)).copy(),
        level=level,
    )


def cfg(**changes):
    return WindConfig(**{"source": "grib", "path": "x", "cache": False} | changes)


def test_the_wind_ends_before_a_gap_that_is_too_long(caplog):
    seen = place_readings(cfg(), readings([0, 3, 6, 99, 102]), SCENE)
    np.testing.assert_array_equal(seen.times, 3600.0 * np.array([-1, 2, 5]))
    assert seen.until == 5 * 3600.0
    assert (
        "gap of 93 h from 2018-10-09T06:00:00Z to 2018-10-13T03:00:00Z, longer than wind.max_gap (6 h)"
        in seen.ends
    )
    assert "gap of 93 h" in caplog.text


def test_a_gap_of_just_the_limit_is_bridged():
    assert len(place_readings(cfg(), readings([0, 6, 12]), SCENE).times) == 3
    assert len(place_readings(cfg(max_gap=5.0, hold_last=True), readings([0, 6, 12]), SCENE).times) == 1


def test_a_departure_within_a_gap_is_refused_with_its_times():
    late = replace(SCENE, time_zero="2018-10-10T00:00:00Z")
    with pytest.raises(DataError, match=r"gap of 93 h from 2018-10-09T06.* to 2018-10-13T03.*add wind files"):
        place_readings(cfg(), readings([0, 3, 6, 99, 102]), late)


def test_the_last_field_is_held_for_max_gap_and_reports_say_so():
    seen = place_readings(cfg(hold_last=True, max_gap=4.0), readings([0, 3]), SCENE)
    assert seen.until == (2 + 4) * 3600.0
    wind = field.fit_wind_field(cfg(), seen, SCENE)
    assert wind.known_until == seen.until
    said = coverage_of(wind, SCENE.time_zero).covered
    assert "the last field (2018-10-09T03:00:00Z) held for up to 4 h" in said


def test_a_horizon_before_the_end_leaves_later_slots_out():
    seen = place_readings(cfg(), readings(range(0, 30, 3)), SCENE)
    wind = field.fit_wind_field(cfg(), seen, SCENE, horizon=5 * 3600.0)
    np.testing.assert_array_equal(wind.times, 3600.0 * np.array([-1, 2, 5]))
    assert wind.ends == "planner.max_steps ends there"


def test_forecast_errors_and_interpolation_in_time_make_the_field_less_certain():
    leads = np.array([6.0, 9.0, 12.0])
    none = field.fit_wind_field(
        cfg(), place_readings(cfg(forecast_error="none"), readings([0, 3, 6], leads), SCENE), SCENE
    )
    gfs = field.fit_wind_field(cfg(), place_readings(cfg(), readings([0, 3, 6], leads), SCENE), SCENE)
    e2 = law_named("gfs").forecast_variance(leads * 3600.0)
    np.testing.assert_allclose(
        gfs.latent_var - none.latent_var,
        np.broadcast_to(e2[:, None, None, None], gfs.latent_var.shape),
        atol=1e-9,
    )
    assert (time_variances(place_readings(cfg(), readings([0, 3]), SCENE), None) > 0).all()


@pytest.mark.parametrize(
    ("made", "covered", "left"),
    [
        ({"leads": [6.0, 9.0]}, "forecast error by the law gfs for leads 6 to 9 h", "other heights than 10m"),
        ({"level": "80m"}, "wind at 80m", "other heights than 80m"),
    ],
)
def test_reports_name_the_law_the_lead_and_the_level_and_what_is_missing(made, covered, left):
    said = coverage_of(
        field.fit_wind_field(cfg(), place_readings(cfg(), readings([0, 3], **made), SCENE), SCENE)
    )
    assert covered in said.covered
    assert left in said.not_covered
    assert "\n" not in said.covered + said.not_covered


def test_a_forecast_without_leads_is_as_old_as_one_just_published_and_a_warning_says_so(caplog):
    times, late = [0, 3, 9], replace(SCENE, time_zero="2018-10-09T04:00:00Z")
    seen = place_readings(cfg(), readings(times, np.nan), late)
    np.testing.assert_array_equal(seen.leads, [7 * 3600.0, 13 * 3600.0])
    assert (
        "winds.grib2 does not state how old its forecast is: it is assumed to have begun 4 h" in caplog.text
    )
    assert "before its first time, 2018-10-09T00:00:00Z" in caplog.text
    assert "column lead_hours" in caplog.text
    assert "wind.forecast_error=none" in caplog.text


def test_leads_that_only_some_times_state_are_kept(caplog):
    seen = place_readings(cfg(), readings([0, 3, 6], [0.0, np.nan, 1.0]), SCENE)
    np.testing.assert_array_equal(seen.leads, [0.0, 3 * 3600.0, 3600.0])
    assert "at 1 of 3 times: it is assumed to have begun at 2018-10-09T00:00:00Z" in caplog.text


def test_a_single_time_without_a_lead_is_as_old_as_a_forecast_just_published():
    seen = place_readings(cfg(hold_last=True), readings([0], np.nan), SCENE)
    np.testing.assert_array_equal(seen.leads, [4 * 3600.0])


@pytest.mark.parametrize(
    ("settings", "made"),
    [
        ({"forecast_error": "none"}, {"hours": [0, 3]}),
        ({"source": "stations"}, {"hours": [0, 3]}),
        ({"source": "sample", "path": None, "forecast_error": "gfs"}, {"hours": [0, 3]}),
        ({"forecast_error": "none"}, {"hours": [0, 3], "level": "0m depth"}),
    ],
)
def test_analyses_observations_and_currents_without_a_law_imply_no_lead(settings, made, caplog):
    seen = place_readings(cfg(**settings), readings(leads=np.nan, **made), SCENE)
    assert np.isnan(seen.leads).all()
    assert "how old" not in caplog.text
    said = coverage_of(field.fit_wind_field(cfg(**settings), seen, SCENE)).not_covered
    assert ("do not say how old" in said) == bool(seen.error.parts)


def test_readings_taken_as_true_are_named_as_not_covered():
    seen = place_readings(cfg(forecast_error="none"), readings([0, 3], [0.0, 3.0]), SCENE)
    said = coverage_of(field.fit_wind_field(cfg(), seen, SCENE))
    assert "analyses and forecasts (leads 0 to 3 h) are taken as true" in said.not_covered


def test_a_departure_by_default_and_a_wind_of_another_level_are_named():
    seen = place_readings(cfg(), readings([0, 3]), SCENE)
    wind = field.fit_wind_field(cfg(), seen, SCENE)
    said = coverage_of(wind, SCENE.time_zero, "100m", by_default=True)
    assert f"a departure at {SCENE.time_zero}, the first time of the wind" in said.covered
    assert "the robot flies 100 m above ground, and the wind used is 10 m" in said.not_covered
    plain = coverage_of(wind, SCENE.time_zero, "10m")
    assert "departure" not in plain.covered
    assert "robot.level" not in plain.not_covered
    gap = "the robot flies 100 m above ground, and the wind used is 10 m above ground"
    assert (level_gap(said.not_covered), level_gap(plain.not_covered)) == (gap, "")


def test_the_errors_of_a_current_are_named_in_words_of_the_water():
    seen = place_readings(cfg(forecast_error="none"), readings([0, 3], level="30m depth"), SCENE)
    said = coverage_of(field.fit_wind_field(cfg(), seen, SCENE), SCENE.time_zero, "30m depth")
    assert said.covered.startswith("current at 30m depth of")
    assert "currents at other depths than 30m depth, and vertical motion of the water" in said.not_covered
    assert "errors of speed through the water" in said.not_covered
    told = said.covered.replace("winds.grib2", "") + said.not_covered
    assert not any(word in told for word in ("wind", "airspeed", "heights"))


def test_calm_air_covers_no_wind_at_all():
    still = field.fit_wind_field(WindConfig(), place_readings(WindConfig(source="calm"), CALM, SCENE), SCENE)
    said = coverage_of(still)
    assert said.covered == "calm air: no wind at all."
    assert said.not_covered.startswith("any wind")


HELD = {"hold_last": True, "max_gap": 12.0}


def test_a_flight_through_a_held_field_is_told_what_forecasts_would_give():
    seen = place_readings(cfg(**HELD), readings([0, 3], [3.0, 6.0]), SCENE)
    wind, law = field.fit_wind_field(cfg(**HELD), seen, SCENE), seen.error
    said = held_warning(wind, 8 * 3600.0, SCENE.time_zero)  # departure at 1 h, the last field at 3 h
    assert "no field covers the last 6 h of the flight: the last one (2018-10-09T03:00:00Z) is held" in said
    for hours in (3, 6):  # halfway through the held part, and at its end
        sd = np.sqrt(law.change_variance(hours * 3600.0) + law.forecast_variance(6 * 3600.0))
        assert f"{sd:.2g} m/s" in said
    fresh = [f"{np.sqrt(law.forecast_variance((6 + hours) * 3600.0)):.2g}" for hours in (3, 6)]
    assert f"would have {fresh[0]} and {fresh[1]} m/s (law gfs): add forecasts" in said


def test_exact_fields_are_compared_with_forecasts_of_the_packaged_law():
    told = cfg(forecast_error="none", **HELD)
    wind = field.fit_wind_field(told, place_readings(told, readings([0, 3]), SCENE), SCENE)
    assert "(law gfs)" in held_warning(wind, 8 * 3600.0)


@pytest.mark.parametrize("end", [2 * 3600.0, 2 * 3600.0 + 1.0])
def test_a_flight_that_the_fields_cover_is_told_nothing(end):
    """A second after the last field, the wind has changed by less than a forecast errs."""
    wind = field.fit_wind_field(cfg(**HELD), place_readings(cfg(**HELD), readings([0, 3], 6.0), SCENE), SCENE)
    assert held_warning(wind, end) is None


def test_calm_air_is_held_without_a_warning():
    still = place_readings(WindConfig(source="calm"), CALM, SCENE)
    assert held_warning(field.fit_wind_field(WindConfig(), still, SCENE), 1e6) is None


def test_the_errors_of_the_robot_are_covered_where_they_are_modelled():
    seen = place_readings(cfg(), readings([0, 3]), SCENE)
    wind = field.fit_wind_field(cfg(), seen, SCENE)
    said = coverage_of(wind, SCENE.time_zero, robot=OwnErrors(0.015, 1.0, 2.0))
    errors = "airspeed errors of 1.5 %, heading errors of 1 degree and clock errors of 2 s"
    assert f"{errors} (1 sd, constant over a flight)." in said.covered
    assert said.not_covered.endswith("; changes of the robot's own errors during a flight.")
    assert "own errors of" not in said.not_covered
    half = coverage_of(wind, SCENE.time_zero, robot=OwnErrors(heading=2.5))
    assert half.covered.endswith("; heading errors of 2.5 degrees (1 sd, constant over a flight).")
    assert "the robot's own errors of airspeed and timing; changes of" in half.not_covered
    none = coverage_of(wind, SCENE.time_zero)
    assert none.not_covered.endswith("; the robot's own errors of airspeed, heading and timing.")
