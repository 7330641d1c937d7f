"""The law of forecast errors, estimated from histories whose law is known."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import forecast_history as history
from careful_io.files import write_json
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.named_laws import read_law
from pareto_ltl.wind.snapshots import Snapshot
from pareto_ltl_apps.wind_errors.error_estimate import (
    ASYMMETRY,
    DIRECT,
    MIXED,
    ErrorEstimate,
    error_document,
    estimate_errors,
    estimated_law,
    matern_lengths,
)
from pareto_ltl_apps.wind_errors.matched_fields import Interval, Resampling
from wind_laws.documents import first_law

HOUR = 3600.0
SEEDS = range(12)
FEWEST_HITS = 6  # of 12: intervals that hold 0.95 fail by chance less than once in a million


def estimated(snapshots: Sequence[Snapshot], max_lag: float = 12 * HOUR) -> ErrorEstimate:
    return estimate_errors(snapshots, None, Resampling(), max_lag)


@pytest.fixture(scope="module")
def direct() -> list[ErrorEstimate]:
    return [estimated(history.direct_history(seed)) for seed in SEEDS]


@pytest.fixture(scope="module")
def asymmetric() -> list[ErrorEstimate]:
    return [estimated(history.asymmetric_history(seed), 9 * HOUR) for seed in SEEDS]


def check_intervals(found: Sequence[Interval | None], truth: float, within: float) -> None:
    """The truth lies in most intervals, and the mean of the estimates is near it."""
    known = [interval for interval in found if interval is not None]
    assert len(known) == len(SEEDS)
    assert sum(interval.low <= truth <= interval.high for interval in known) >= FEWEST_HITS
    assert abs(np.mean([interval.value for interval in known]) - truth) < within * truth


@pytest.mark.statistical
@pytest.mark.parametrize(("entry", "truth"), [(0, history.E6), (1, history.E12)])
def test_the_error_of_each_lead_is_found_where_analyses_meet_forecasts(
    direct: list[ErrorEstimate], entry: int, truth: float
) -> None:
    tables = [found.forecast for found in direct if found.forecast is not None]
    assert all(table.at.tolist() == [6 * HOUR, 12 * HOUR] for table in tables)
    assert all(table.ways == (DIRECT, DIRECT) for table in tables)
    check_intervals([table.sd[entry] for table in tables], truth, 0.05)


@pytest.mark.statistical
@pytest.mark.parametrize("entry", [0, 1])
def test_the_change_of_the_wind_is_found(direct: list[ErrorEstimate], entry: int) -> None:
    truth = history.STEP_SD * np.sqrt(entry + 1)
    check_intervals([found.change.sd[entry] for found in direct], truth, 0.05)


@pytest.mark.statistical
def test_lengths_and_persistence_are_found(direct: list[ErrorEstimate]) -> None:
    check_intervals([found.change_length.length for found in direct], history.CHANGE_LENGTH, 0.1)
    check_intervals([found.forecast_length.length for found in direct], history.ERROR_LENGTH, 0.1)
    check_intervals([found.persistence.value for found in direct], history.PERSISTENCE, 0.05)
    assert {found.persistence.step for found in direct} == {6 * HOUR}


@pytest.mark.statistical
def test_the_error_is_found_by_asymmetry_where_no_analysis_meets_a_forecast(
    asymmetric: list[ErrorEstimate],
) -> None:
    tables = [found.forecast for found in asymmetric if found.forecast is not None]
    assert all(table.ways == (ASYMMETRY,) for table in tables)
    check_intervals([table.sd[0] for table in tables], history.E3, 0.1)
    assert all("no forecast has the valid time" in found.persistence.reason for found in asymmetric)
    lengths = [found.forecast_length.length for found in asymmetric]
    check_intervals(lengths, history.CHANGE_LENGTH, 0.2)  # both changes that the error is made of have it


@pytest.mark.statistical
def test_changes_between_analyses_come_from_forecasts_less_their_error(
    asymmetric: list[ErrorEstimate],
) -> None:
    for entry, steps, way in ((0, 1, MIXED), (1, 2, "two analyses"), (2, 3, MIXED)):
        assert {found.change.ways[entry] for found in asymmetric} == {way}
        truth = history.STEP_SD * np.sqrt(steps)
        check_intervals([found.change.sd[entry] for found in asymmetric], truth, 0.05)


def test_estimates_are_those_of_a_plain_loop() -> None:
    snapshots = history.direct_history(3, cycles=9)
    found = estimated(snapshots)
    weights = np.cos(np.deg2rad(history.NODES[:, 1]))
    squares: dict[tuple[str, float], list[float]] = {}
    for a in snapshots:
        for b in snapshots:
            if b.lead == 0 and (a.time > b.time or a.lead > 0):
                kind = ("change", a.time - b.time) if a.lead == 0 else ("error", a.lead)
                if a.lead > 0 and a.time != b.time:
                    continue
                mean = sum(w * ((x - y) ** 2).sum() / 2 for w, x, y in zip(weights, a.winds, b.winds))  # noqa: B905
                squares.setdefault(kind, []).append(float(mean / weights.sum()))
    assert found.forecast is not None
    for name, table in (("change", found.change), ("error", found.forecast)):
        for at, sd, pairs in zip(table.at, table.sd, table.pairs, strict=True):
            assert len(squares[name, at]) == pairs
            assert sd.value == pytest.approx(np.sqrt(np.mean(squares[name, at])), rel=1e-12)


@given(factor=st.floats(0.01, 100.0), order=st.randoms(use_true_random=False))
@settings(max_examples=5)
def test_estimates_scale_with_the_winds_and_do_not_depend_on_the_order_of_files(
    factor: float, order: object
) -> None:
    snapshots = list(history.direct_history(5, cycles=8))
    scaled = [dataclasses.replace(snap, winds=factor * snap.winds) for snap in snapshots]
    order.shuffle(scaled)  # type: ignore[attr-defined]
    one, two = estimated(snapshots), estimated(scaled)
    assert two.spread == pytest.approx(factor * one.spread)
    for a, b in zip(one.change.sd, two.change.sd, strict=True):
        assert (b.value, b.low, b.high) == pytest.approx(
            (factor * a.value, factor * a.low, factor * a.high), rel=1e-6
        )
    assert one.change_length.length is not None
    assert two.change_length.length is not None
    assert two.change_length.length.value == pytest.approx(one.change_length.length.value)


def test_the_length_of_a_matern_correlation_is_its_own() -> None:
    r = np.linspace(50e3, 1500e3, 15)
    for length in (80e3, 300e3, 900e3):
        s = np.sqrt(3.0) * r / length
        assert matern_lengths(r, ((1 + s) * np.exp(-s))[None])[0] == pytest.approx(length, rel=0.01)
    assert np.isnan(matern_lengths(r, np.ones((1, 15)))[0])  # longer than any that is tried


def test_a_perfect_forecast_is_reported_as_0_and_what_it_cannot_tell_is_kept() -> None:
    rng = np.random.default_rng(1)
    told = []
    for k, wind in enumerate(np.cumsum(rng.normal(size=(17, len(history.NODES), 2)), axis=0)):
        time = 3 * HOUR * k
        told.append(history.snapshot(time, 0.0 if k % 2 == 0 else 3 * HOUR, wind))
    shaken = [  # each forecast departs from its own analysis by more than the wind does
        dataclasses.replace(a, winds=a.winds + 0.1 * (a.winds - b.winds)) if a.lead else a
        for a, b in zip(told, [told[0], *told], strict=False)
    ]
    found = estimated(shaken, 12 * HOUR)
    assert found.forecast is not None
    assert found.forecast.sd[0].low == 0.0
    assert "not significantly above 0" in found.forecast_length.reason
    usual = first_law()
    law = estimated_law(found, "made", usual)
    assert law.forecast_length == usual.forecast_length
    assert law.persistence == usual.persistence


def test_the_file_reads_back_as_the_law(tmp_path: Path) -> None:
    found = estimated(history.direct_history(2, cycles=12))
    usual = first_law()
    law = estimated_law(found, "made", usual)
    made = tmp_path / "made.grib2"
    made.write_bytes(b"winds")
    write_json(tmp_path / "law.json", error_document(found, law, usual.name, [made], "none"))
    back = read_law(tmp_path / "law.json")
    assert back.document() == law.document()
    assert found.forecast is not None
    assert back.forecast_variance(np.array([0.0, 6 * HOUR]))[1] == pytest.approx(
        found.forecast.sd[0].value ** 2
    )


def test_without_forecasts_the_packaged_errors_are_kept_and_marked() -> None:
    found = estimated([snap for snap in history.direct_history(2, cycles=12) if snap.lead == 0])
    usual = first_law()
    assert found.forecast is None
    law = estimated_law(found, "made", usual)
    assert law.forecast_sd.tolist() == usual.forecast_sd.tolist()
    origin = error_document(found, law, usual.name, [], "none")["origin"]
    assert "error of forecasts taken from gfs, since no forecast can be compared with analyses" in origin


def test_a_coarser_blocking_gives_the_same_estimate_and_more_blocks_a_narrower_stretch() -> None:
    cycles, values = np.arange(64.0), np.random.default_rng(0).normal(size=(64, 1))
    ends = {}
    for block in (1, 32):
        draws = Resampling(block=block)
        assert draws.means(cycles, values).mean() == pytest.approx(values.mean(), abs=0.05)
        ends[block] = draws.estimate(cycles, values, ratio=False)
        assert ends[block].value == pytest.approx(values.mean())
    plain = 1.96 * values.std() / 8  # independent values, in blocks of one
    assert ends[1].high - ends[1].value == pytest.approx(plain, rel=0.2)
    assert ends[32].high - ends[32].value > 2 * (ends[1].high - ends[1].value)  # two blocks


BAD = {
    "none of 20 winds is an analysis": [
        snap for snap in history.direct_history(1, cycles=11) if snap.lead == 6 * HOUR
    ][:10]
    * 2,
    "several levels (10m, 80m)": [
        history.snapshot(0.0, 0.0, np.zeros_like(history.NODES)),
        history.snapshot(1.0, 0.0, np.zeros_like(history.NODES), "80m"),
    ],
    "occurs twice": [history.snapshot(0.0, 0.0, np.zeros_like(history.NODES))] * 2,
    "no lag up to 12 h has 5 pairs": history.direct_history(1, cycles=3),
}


@pytest.mark.parametrize("message", BAD)
def test_histories_that_tell_nothing_are_refused_in_one_line(message: str) -> None:
    with pytest.raises(DataError) as caught:
        estimated(BAD[message])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_area_without_nodes_is_refused() -> None:
    with pytest.raises(DataError, match="0 of 130 nodes that all times share lie in the area"):
        estimate_errors(
            history.direct_history(1, cycles=8), [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], Resampling()
        )


def test_winds_of_unknown_lead_are_counted_and_left_out() -> None:
    snapshots = list(history.direct_history(1, cycles=9))
    lost = [*snapshots, dataclasses.replace(snapshots[0], lead=float("nan"))]
    assert "1 winds whose lead is not known were left out" in estimated(lost).notes
