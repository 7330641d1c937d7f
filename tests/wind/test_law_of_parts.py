"""Laws of parts: covariances, tails, files, and errors that newer runs can show."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kurtosis, norm

from careful_io.files import write_json
from careful_io.times import HOUR
from pareto_ltl.settings.wind import LAW_WORDS
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.named_laws import law_named, law_of_parts_named, read_law
from pareto_ltl_apps.wind_errors.scale_mixture import coverage, log_density, quantiles
from point_forecasts_made import made_law
from wind_laws.documents import packaged_laws
from wind_laws.error_law import GROWING, LASTING, LawPart, TailScale
from wind_laws.law_of_parts import LawOfParts, law_of_parts_of

LAWS = packaged_laws()


def test_the_packaged_laws_state_their_data_and_their_floor() -> None:
    assert LAWS == ("currents", "ecmwf_class", "gfs", "hourly_fine", "icon_eu")
    for name in LAWS[1:]:
        law = law_of_parts_named(name)
        assert law.name == name
        assert law.floor == pytest.approx(1 / (law.situations + 1))
        assert law.truth == "own"
        assert "one situation" in law.origin  # what the lasting part rests on
        part = law.part(LASTING)
        assert part is not None
        assert 0.3 <= part.sd[0] <= 0.4


@pytest.mark.parametrize("name", LAWS)
def test_a_covariance_is_positive_definite_and_has_the_variances_of_the_law(name: str) -> None:
    law, leads = law_of_parts_named(name), HOUR * np.linspace(1.0, 110.0, 40)
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


@pytest.mark.parametrize("spread", [0.0, 0.3, 0.55, 0.8])
def test_the_scale_mixture_agrees_with_draws(spread: float) -> None:
    rng = np.random.default_rng(5)
    n = 400_000
    x = np.exp(spread * rng.standard_normal(n) - spread**2) * rng.standard_normal(n)
    shares = np.array([0.5, 0.9, 0.99, 0.999])
    inside = [np.mean(np.abs(x) <= limit) for limit in quantiles(shares, spread)]
    assert np.all(np.abs(inside - shares) < 5 * np.sqrt(shares * (1 - shares) / n) + 1e-5)
    if spread <= 0.3:
        assert kurtosis(x, fisher=False) == pytest.approx(3 * np.exp(4 * spread**2), rel=0.1)


def test_without_spread_the_mixture_is_the_normal_distribution() -> None:
    z = np.linspace(0.0, 5.0, 11)
    np.testing.assert_allclose(coverage(z, 0.0), 2 * norm.cdf(z) - 1, atol=1e-12)
    np.testing.assert_allclose(log_density(z, np.array(0.0)), norm.logpdf(z), atol=1e-12)


def test_a_density_is_the_slope_of_the_coverage() -> None:
    z = np.linspace(0.1, 5.0, 50)
    slope = (coverage(z + 1e-5, 0.5) - coverage(z - 1e-5, 0.5)) / 2e-5
    np.testing.assert_allclose(2 * np.exp(log_density(z, np.array(0.5))), slope, rtol=1e-5)


@pytest.mark.parametrize("name", LAWS)
def test_a_law_comes_back_from_its_file(name: str, tmp_path: Path) -> None:
    law = law_of_parts_named(name)
    write_json(tmp_path / "law.json", law.document())
    again = law_of_parts_named(str(tmp_path / "law.json"))
    assert json.dumps(again.document()) == json.dumps(law.document())


def test_the_first_version_is_still_read_and_has_one_part(tmp_path: Path) -> None:
    first = law_named("gfs_one_part")
    assert first.document()["schema"] == "pareto_ltl.forecast_error/1"
    (part,) = first.parts
    assert part.persistence(np.array(6 * HOUR), np.array(3 * HOUR)) == pytest.approx(0.9)
    assert first.tail is None
    assert first.floor == 0.0
    write_json(tmp_path / "law.json", first.document())
    with pytest.raises(DataError, match="is a law of version 1") as caught:
        law_of_parts_named(str(tmp_path / "law.json"))
    assert "\n" not in str(caught.value)


def test_the_words_of_the_setting_are_the_packaged_laws() -> None:
    assert set(LAW_WORDS) == {"auto", "none", "gfs_one_part", *packaged_laws()}
    assert all(isinstance(law_named(name), LawOfParts) for name in packaged_laws())
    assert not law_named("none").parts


def test_a_law_that_is_neither_known_nor_a_file_is_refused_in_one_line() -> None:
    with pytest.raises(ConfigError, match=r"wind\.forecast_error=icon is neither a law nor a file; laws: "):
        law_named("icon")


def test_a_law_follows_the_spread_and_leaves_a_share_to_an_ensemble() -> None:
    law = made_law()
    leads = HOUR * np.array([0.0, 12.0, 48.0])
    wider = law.for_winds("925hPa", 2.0 * law.spread)
    np.testing.assert_allclose(wider.forecast_variance(leads), 4.0 * law.forecast_variance(leads))
    np.testing.assert_allclose(wider.change_sd, 2.0 * law.change_sd)
    np.testing.assert_allclose(law.shared(0.25).forecast_variance(leads), law.forecast_variance(leads) / 4)
    assert not law.shared(0.0).parts
    assert law.for_winds(law.level, 99.0) is law


BAD = {
    "negative": ({"parts": [{"sd": [-0.1]}]}, r"/parts/0/sd/0: expected a number, 0 to 1e6"),
    "zero": ({"parts": [{"sd": [0.0]}]}, "must not be negative, and not 0 at every lead"),
    "lengths": ({"parts": [{"sd": [0.3, 0.4]}]}, r"sd of the part lasting must have shape"),
    "no part": ({"parts": []}, "a law has one to four parts, got none"),
    "floor": ({"floor": 0.5}, r"floor is 1 / \(n \+ 1\)"),
    "truth": ({"truth": "guessed"}, "own.*observed"),
    "version": ({"schema": "pareto_ltl.forecast_error/9"}, "expected schema .*'pareto_ltl.forecast_error/2'"),
    "twice": ({"parts": "twice"}, "the parts of a law have different names, got lasting, lasting"),
    "tails": ({"scale": {"flight": 1.1, "moment": [1.1]}}, "the scale spreads by more than"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_law_that_cannot_be_is_refused_with_the_place(case: str, tmp_path: Path) -> None:
    change, message = BAD[case]
    document = made_law().document()
    for key, value in change.items():
        if key == "parts" and value == "twice":
            document["parts"] = [document["parts"][0]] * 2
        elif key == "parts" and isinstance(value, list) and value:
            document["parts"][0] |= value[0]
        elif isinstance(value, dict):
            document[key] |= value
        else:
            document[key] = value
    write_json(tmp_path / "law.json", document)
    with pytest.raises(DataError, match=message) as caught:
        read_law(tmp_path / "law.json")
    assert str(caught.value).count("\n") == 0


def test_equal_names_and_wrong_shapes_are_refused_from_python() -> None:
    law = made_law()
    with pytest.raises(ValueError, match="different names"):
        replace(law, parts=(law.parts[0], law.parts[0]))
    with pytest.raises(ValueError, match="a part is one of"):
        replace(law.parts[0], name="wide")
    assert law_of_parts_of(law.document()).situations == 200
