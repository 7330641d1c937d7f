"""A law of parts is recovered from made errors, and the packaged laws cover the shared tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from careful_io.times import HOUR
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.named_laws import law_of_parts_named
from pareto_ltl_apps.wind_errors.error_moments import error_moments
from pareto_ltl_apps.wind_errors.law_check import LEVELS, check_document, check_law, displacement_sd
from pareto_ltl_apps.wind_errors.law_estimate import estimate_law, law_numbers
from pareto_ltl_apps.wind_errors.law_fit import fit_parts
from pareto_ltl_apps.wind_errors.point_forecasts import displacements, first_window, verified, window
from pareto_ltl_apps.wind_errors.point_tables import read_point_table
from point_forecasts_made import (
    WINDS,
    made_forecasts,
    made_law,
    martingale_forecasts,
    needs_winds,
    without_observations,
)
from wind_laws.error_law import LASTING

SOURCES = {
    "icon_eu": "icon_eu_22_points.npz",
    "ecmwf_class": "gefcom2012_7_sites.npz",
    "hourly_fine": "openmeteo_nyc.npz",
}
WANTED = ((0.45, 0.57), (0.87, 0.94), (0.98, 0.997), (0.996, 1.0))  # at 50, 90, 99 and 99.9 %


@pytest.mark.parametrize("spread", [0.0, 0.45])
def test_errors_that_follow_a_law_are_covered_as_it_says(spread: float) -> None:
    law = made_law(spread)
    _, rows = check_law(made_forecasts(law, seed=1), law)
    kinds = {(row.kind, row.hours) for row in rows}
    assert {("error", 24), ("error", 48), ("displacement", 24), ("displacement", 48)} <= kinds
    for row in rows:
        n = len(row.z) / 2  # both components of an error share its scale
        for share, level in zip(row.covered, LEVELS, strict=True):
            assert abs(share - level) < 5 * np.sqrt(level * (1 - level) / n) + 0.002, (row.kind, row.hours)


def test_a_wide_law_covers_too_much_and_a_normal_one_too_little_in_the_tail() -> None:
    law, table = made_law(0.5), made_forecasts(made_law(0.5), seed=2)
    wide = replace(law, parts=tuple(replace(part, sd=2 * part.sd) for part in law.parts))
    _, rows = check_law(table, wide)
    assert all(row.covered[0] > 0.7 for row in rows)
    assert all(np.sqrt(np.mean(row.z**2)) < 0.6 for row in rows)
    _, rows = check_law(table, replace(law, scale=replace(law.scale, flight=0.0)))
    assert np.mean([row.covered[2] for row in rows]) < 0.985


def test_a_fit_recovers_the_level_the_displacement_and_the_tails() -> None:
    law = made_law(0.4)
    table = made_forecasts(law, seed=3, runs=600)
    made = estimate_law(table, "again", leave_out=False)
    assert made.law.truth == "observed"
    assert made.law.part(LASTING) is None
    at = HOUR * np.array([6.0, 24.0, 48.0])
    np.testing.assert_allclose(np.sqrt(made.law.variance(at)), np.sqrt(law.variance(at)), rtol=0.12)
    span = window(made.found.leads, 0.0, 24 * HOUR)
    assert span is not None
    expected, fitted = (displacement_sd(made.found, each, span)[0, 0] for each in (law, made.law))
    assert fitted == pytest.approx(expected, rel=0.12)
    assert made.law.scale.spread(24 * HOUR, 24 * HOUR) == pytest.approx(0.4, abs=0.08)
    for name, value in law_numbers(made.law).items():
        low, high = made.law.intervals[name]
        assert low < value < high


def test_newer_runs_show_the_growth_since_their_own_start() -> None:
    c = 0.6
    table = martingale_forecasts(c, seed=4)
    found = verified(table)
    assert found.truth == "own"
    j = int(np.flatnonzero(table.leads == 24 * HOUR)[0])
    assert np.nanmean(found.errors[:, :, j] ** 2) == pytest.approx(c**2 * 4, rel=0.15)
    assert (found.newer[:-10, 0, j] == 0).all()
    older = without_observations(replace(table, leads=table.leads[2:], winds=table.winds[:, :, 2:]))
    seen = verified(older)  # the newest run is 12 h old
    rms = np.nanmean(np.where(seen.compared[..., None], seen.errors, np.nan)[:, :, j - 2] ** 2)
    assert rms == pytest.approx(c**2 * (4 - 2), rel=0.2)


def test_a_displacement_is_the_integral_of_the_errors() -> None:
    table = made_forecasts(made_law(), seed=5, runs=10)
    found = verified(table)
    span = window(found.leads, 0.0, 24 * HOUR)
    assert span is not None
    expected = np.trapezoid(found.errors[:, :, :9], found.leads[:9], axis=2)
    np.testing.assert_allclose(displacements(found, span), expected)
    assert window(found.leads, HOUR, 24 * HOUR) is None
    first = first_window(found, 48 * HOUR)
    assert first is not None
    assert first.start == 0.0


def test_one_step_is_a_fit_without_a_situation() -> None:
    table = made_forecasts(made_law(), seed=6, runs=200)
    found = verified(table)
    moments = error_moments(table, found, 120 * HOUR)
    whole, weights = fit_parts(moments), np.ones(moments.situations)
    weights[:5] = 0.0
    step, full = whole.with_weights(weights), fit_parts(moments, weights).parts
    at = HOUR * np.array([6.0, 24.0, 48.0])
    one, other = (np.sqrt(sum(part.variance(at) for part in parts)) for parts in (step, full))
    np.testing.assert_allclose(one, other, rtol=0.02)


def test_too_few_situations_are_refused_and_few_are_warned_of() -> None:
    table = made_forecasts(made_law(), seed=7, runs=10)
    assert any(note.startswith("WARNING: ") for note in estimate_law(table, "few", leave_out=False).notes)
    with pytest.raises(DataError, match="situations"):
        estimate_law(made_forecasts(made_law(), seed=8, runs=3), "fewer")
    alone = without_observations(replace(table, runs=table.runs[:1], winds=table.winds[:1]))
    with pytest.raises(DataError, match="holds one run only"):
        estimate_law(alone, "one")


@needs_winds
@pytest.mark.parametrize("name", SOURCES)
def test_the_packaged_laws_cover_their_tables_as_they_say(name: str) -> None:
    table, law = read_point_table(WINDS / SOURCES[name]), law_of_parts_named(name)
    found, rows = check_law(table, law)
    answer = check_document(table, law, found, rows)
    assert answer["truth"] == "own"
    assert answer["n"] == law.situations
    assert {row["hours"] for row in answer["rows"] if row["kind"] == "displacement"} == {6, 12, 24, 48}
    assert {24, 36, 48} <= {row["hours"] for row in answer["rows"] if row["kind"] == "error"}
    for row in rows:
        for share, (low, high) in zip(row.covered, WANTED, strict=True):
            assert low <= share <= high, (row.kind, row.hours)


@needs_winds
def test_situations_left_out_are_covered_too() -> None:
    estimate = estimate_law(read_point_table(WINDS / SOURCES["hourly_fine"]), "again")
    assert len(estimate.left_out) == 12
    for left in estimate.left_out:
        for share, low, high, (least, most) in zip(left.covered, left.low, left.high, WANTED, strict=True):
            assert low <= share <= high
            assert least <= share <= most, (left.row.kind, left.row.hours)


@needs_winds
def test_the_first_law_promises_twice_the_displacement_that_newer_runs_show() -> None:
    table = read_point_table(WINDS / SOURCES["icon_eu"])
    law = law_of_parts_named("icon_eu")
    _, rows = check_law(table, law)
    row = next(row for row in rows if row.kind == "displacement" and row.hours == 24)
    first = 0.9 ** (np.abs(np.subtract.outer(np.arange(25.0), np.arange(25.0))) / 3)
    sd = 0.62 * np.sqrt(np.arange(25.0) / 6)
    moved = HOUR * np.sqrt(sd @ first @ sd)
    assert moved > 2 * row.rms
