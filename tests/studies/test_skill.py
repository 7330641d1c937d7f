"""Parts and skill of scores: as ``scores`` of the Bureau of Meteorology computes them, and by simulation."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scores.continuous import isotonic_fit
from scores.probability import brier_score, murphy_score

from pareto_ltl_apps.studies import calibration
from pareto_ltl_apps.studies.calibration import scorecard, situations_text

PAIRS = st.lists(st.tuples(st.floats(0.0, 1.0), st.sampled_from([0.0, 1.0])), min_size=3, max_size=40)


@given(pairs=PAIRS)
def test_the_brier_score_is_that_of_scores_and_its_murphy_diagram(pairs: list[tuple[float, float]]) -> None:
    """The mean is the expectile of 1/2: the score is four times the integral of elementary scores."""
    p, y = np.array(pairs).T
    mine = calibration.brier_score(p, y)
    promised, seen = xr.DataArray(p, dims="mission"), xr.DataArray(y, dims="mission")
    assert float(brier_score(promised, seen)) == pytest.approx(mine, abs=1e-12)
    thetas = np.linspace(0.0, 1.0, 2001)
    curve = murphy_score(promised, seen, thetas=list(thetas), functional="expectile", alpha=0.5)
    assert 4 * np.trapezoid(curve["total"].values, thetas) == pytest.approx(mine, abs=4e-3)


@given(pairs=PAIRS)
def test_isotonic_rates_are_those_of_scores(pairs: list[tuple[float, float]]) -> None:
    p, y = np.array(pairs).T
    p = np.round(p, 3)
    fit = isotonic_fit(p, y)
    wanted = np.interp(p, fit["fcst_sorted"], fit["regression_values"])
    np.testing.assert_allclose(calibration.isotonic_rates(p, y), wanted, atol=1e-9)


@given(pairs=st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)), min_size=1, max_size=30))
def test_the_parts_add_up_to_the_score_and_none_is_negative(pairs: list[tuple[float, float]]) -> None:
    """Realised rates are shares of flights, between 0 and 1."""
    p, f = np.array(pairs).T
    parts = calibration.brier_parts(p, f)
    whole = parts["miscalibration"] - parts["discrimination"] + parts["uncertainty"]
    assert whole == pytest.approx(calibration.brier_score(p, f), abs=1e-12)
    assert min(parts.values()) >= -1e-12


def test_references_know_only_other_missions_and_earlier_departures() -> None:
    f, departures = np.array([0.0, 1.0, 0.5, 0.25]), ["T06", "T00", "T06", "T12"]
    np.testing.assert_allclose(calibration.climatology(f), [1.75 / 3, 0.75 / 3, 1.25 / 3, 1.5 / 3])
    np.testing.assert_allclose(calibration.persistence(f, departures), [1.0, 0.25, 1.0, 0.25])
    assert calibration.skill(f, np.round(f), np.full(4, 0.5)) < 1.0
    assert calibration.skill(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.full(2, 0.5)) == 1.0


@pytest.mark.statistical
def test_the_interval_by_situations_covers_where_that_by_missions_does_not() -> None:
    """Six situations with rates of their own, thirty missions each: 500 repetitions."""
    rng, inside, narrow = np.random.default_rng(7), 0, 0
    names = [f"s{k // 30}" for k in range(180)]
    for _ in range(500):
        rates = np.repeat(rng.beta(2.0, 2.0, 6), 30)
        failed = (rng.uniform(size=180) < rates).astype(float)
        found = calibration.situation_columns(failed, names)
        inside += found["by_situation_low"] <= 0.5 <= found["by_situation_high"]
        narrow += abs(failed.mean() - 0.5) <= 1.96 * np.sqrt(0.25 / 180)
    assert inside / 500 > 0.92
    assert narrow / 500 < 0.75


def test_a_card_states_the_situations_and_the_floor() -> None:
    rows = [
        {"mission": k, "fidelity": "full", "kind": "chosen", "simulated_coherent": 0.2, "failure": k % 2,
         "departure": f"T{k}", "situation": f"s{k // 3}"}
        for k in range(6)
    ]  # fmt: skip
    (card,) = scorecard(rows)
    assert (card["situations"], card["floor"]) == (2, pytest.approx(1 / 3))
    assert "1/(2 + 1) = 33.3 %" in situations_text(card)
    (one,) = scorecard(rows[:3])
    assert (one["by_situation_low"], one["by_situation_high"]) == (0.0, 1.0)
    assert situations_text({}) == ""
