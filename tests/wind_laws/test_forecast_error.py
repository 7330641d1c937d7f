"""The law of forecast errors: its tables, the error of interpolation in time that follows, its file."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wind_laws.documents import first_law
from wind_laws.forecast_error import HOUR, ForecastError, forecast_error_of

GFS = first_law()
hours = st.floats(0.01, 200.0)


def test_the_packaged_law_is_that_of_the_field_notes():
    np.testing.assert_allclose(np.sqrt(GFS.forecast_variance(6 * HOUR * np.ones(1))), 0.62)
    lags = np.array([3, 6, 24, 30]) * HOUR
    np.testing.assert_allclose(np.sqrt(GFS.change_variance(lags)), [1.46, 2.29, 3.83, 4.13])
    assert (GFS.forecast_length, GFS.persistence, GFS.persistence_time) == (400e3, 0.9, 3 * HOUR)


@given(hours, hours)
def test_errors_grow_with_lead_and_with_time(a, b):
    low, high = HOUR * min(a, b), HOUR * max(a, b)
    for law in (GFS.forecast_variance, GFS.change_variance):
        first, second = law(np.array([low, high]))
        assert first <= second * (1 + 1e-9)
        assert first >= 0


def test_the_variance_of_forecasts_grows_with_the_lead_as_a_sum_of_independent_errors_does():
    leads = np.array([0.0, 12.0, 48.0, 192.0]) * HOUR
    np.testing.assert_allclose(GFS.forecast_variance(leads), 0.62**2 * leads / (6 * HOUR), rtol=0.01)
    assert GFS.forecast_variance(np.array(np.nan)) == 0.0


@given(st.floats(0, 1), hours)
def test_interpolation_in_time_is_exact_at_fields_and_symmetric_between_them(share, gap):
    between = GFS.between_variance(np.array([0.0, 1.0, share, 1 - share]), gap * HOUR * np.ones(4))
    np.testing.assert_allclose(between[:2], 0.0, atol=1e-9)
    assert between[2] == pytest.approx(between[3], rel=1e-9, abs=1e-9)
    middle = GFS.between_variance(np.array(0.5), np.array(gap * HOUR))
    assert 0 <= between[2] <= middle * 1.05 + 1e-9


@pytest.mark.statistical
def test_the_error_of_interpolation_is_that_of_a_process_with_these_changes():
    """A Gaussian process whose increments have the variance D, drawn at three instants."""
    rng, n, gap = np.random.default_rng(0), 400_000, 6 * HOUR
    for share in (0.25, 0.5, 0.9):
        t = np.array([gap, share * gap])  # the first field is the origin: w(0) = 0
        D = GFS.change_variance
        C = 0.5 * (D(t)[:, None] + D(t)[None, :] - D(np.abs(t[:, None] - t[None, :])))
        later, now = np.linalg.cholesky(C) @ rng.standard_normal((2, n))
        found = np.var(now - share * later)
        expected = float(GFS.between_variance(np.array(share), np.array(gap)))
        assert found == pytest.approx(expected, rel=5.5 * np.sqrt(2 / n))


def test_changes_after_one_field_are_correlated_as_their_variances_say():
    s, t = 6 * HOUR, 9 * HOUR
    D = GFS.change_variance(np.array([s, t, t - s]))
    expected = (D[0] + D[1] - D[2]) / (2 * np.sqrt(D[0] * D[1]))
    assert GFS.change_correlation(s, t) == pytest.approx(expected)
    assert GFS.change_correlation(s, s) == pytest.approx(1.0)
    assert GFS.change_correlation(0.0, t) == 0.0


def test_winds_of_another_level_have_errors_in_proportion_to_their_spread():
    aloft = GFS.for_winds("900hPa", 1.8 * GFS.spread)
    np.testing.assert_allclose(aloft.forecast_sd, 1.8 * GFS.forecast_sd)
    np.testing.assert_allclose(aloft.change_sd, 1.8 * GFS.change_sd)
    assert GFS.for_winds("10m", 99.0) is GFS


def test_without_forecast_errors_the_wind_still_changes_between_fields():
    none = GFS.without_forecasts()
    assert not none.forecast_sd.any()
    np.testing.assert_array_equal(none.change_sd, GFS.change_sd)
    assert first_law().name == "gfs"


def test_a_law_with_tables_that_cannot_be_is_refused():
    told = GFS.document()
    with pytest.raises(ValueError, match="persistence"):
        forecast_error_of(told | {"forecast": told["forecast"] | {"persistence": 1.5}})
    assert isinstance(forecast_error_of(told), ForecastError)
