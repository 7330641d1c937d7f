"""Laws of parts: covariances, tails, files, and errors that newer runs can show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from careful_io.times import HOUR
from point_forecasts_made import made_law
from wind_laws.documents import packaged_law, packaged_laws
from wind_laws.error_law import GROWING, LASTING, LawPart, TailScale
from wind_laws.law_of_parts import law_of_parts_of

LAWS = packaged_laws()


def test_the_packaged_laws_state_their_data_and_their_floor() -> None:
    assert LAWS == ("currents", "ecmwf_class", "gfs", "hourly_fine", "icon_eu")
    for name in LAWS[1:]:
        law = packaged_law(name)
        assert law.name == name
        assert law.floor == pytest.approx(1 / (law.situations + 1))
        assert law.truth == "own"
        assert "one situation" in law.origin  # what the lasting part rests on
        part = law.part(LASTING)
        assert part is not None
        assert 0.3 <= part.sd[0] <= 0.4


@pytest.mark.parametrize("name", LAWS)
def test_a_covariance_is_positive_definite_and_has_the_variances_of_the_law(name: str) -> None:
    law, leads = packaged_law(name), HOUR * np.linspace(1.0, 110.0, 40)
    C = law.covariance(leads)
    np.testing.assert_allclose(np.diag(C), law.variance(leads))
    assert np.linalg.eigvalsh(C).min() > -1e-9
    own = law.covariance(leads, leads - HOUR)
    if law.part(LASTING) is not None:
        assert (np.diag(own) < np.diag(C)).all()  # newer runs do not show the lasting part


def test_the_memory_of_the_clock_is_the_fall_of_the_correlation() -> None:
    part = LawPart(GROWING, HOUR * np.array([0.0, 24.0]), np.ones(2), HOUR * np.array([3.0, 9.0]), 1e5)
    early, late = part.clock(HOUR * np.array([2.0, 5.0])), part.clock(HOUR * np.array([20.0, 29.0]))
    np.testing.assert_allclose([np.diff(early)[0], np.diff(late)[0]], [1.0, 1.0])
    slow = part.clock(HOUR * np.array([11.0, 13.0]))  # memory changes halfway between its leads
    np.testing.assert_allclose(np.diff(slow)[0], 1 / 3 + 1 / 9)


def test_a_difference_of_runs_has_no_variance_where_a_run_verifies_itself() -> None:
    law = made_law()
    leads = HOUR * np.array([6.0, 12.0, 24.0])
    newer = HOUR * np.array([6.0, 3.0, 0.0])
    own = np.diag(law.covariance(leads, newer))
    assert own[0] == 0.0
    seen = law.seen_by("own")
    at = [sum(float(p.variance(np.array(h * HOUR))) for p in seen) for h in (0.0, 3.0, 12.0, 24.0)]
    np.testing.assert_allclose(own[1:], [at[2] - at[1] + at[0], at[3]])


def test_tails_average_out_over_the_time_of_a_flight() -> None:
    scale = TailScale(0.3, np.zeros(1), np.array([0.4]), 6 * HOUR)
    assert scale.spread(0.0) == pytest.approx(0.5)
    assert scale.spread(0.0, 1000 * HOUR) == pytest.approx(0.3, abs=0.01)
    x = 24 / 6
    expected = np.sqrt(0.09 + 2 * (x - 1 + np.exp(-x)) / x**2 * 0.16)
    assert scale.spread(0.0, 24 * HOUR) == pytest.approx(expected)


def test_a_law_follows_the_spread_and_leaves_a_share_to_an_ensemble() -> None:
    law = made_law()
    leads = HOUR * np.array([0.0, 12.0, 48.0])
    wider = law.for_winds("925hPa", 2.0 * law.spread)
    np.testing.assert_allclose(wider.forecast_variance(leads), 4.0 * law.forecast_variance(leads))
    np.testing.assert_allclose(wider.change_sd, 2.0 * law.change_sd)
    np.testing.assert_allclose(law.shared(0.25).forecast_variance(leads), law.forecast_variance(leads) / 4)
    assert not law.shared(0.0).parts
    assert law.for_winds(law.level, 99.0) is law


def test_equal_names_and_wrong_shapes_are_refused_from_python() -> None:
    law = made_law()
    with pytest.raises(ValueError, match="different names"):
        replace(law, parts=(law.parts[0], law.parts[0]))
    with pytest.raises(ValueError, match="a part is one of"):
        replace(law.parts[0], name="wide")
    assert law_of_parts_of(law.document()).situations == 200
