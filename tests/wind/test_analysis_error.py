"""The error of analyses from station reports whose noise is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import forecast_history as history
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.snapshots import Snapshot
from pareto_ltl_apps.wind_errors.matched_fields import Resampling, analysis_error

ERROR, NOISE = 0.9, 1.7
TIMES = 30


def reports(rng: np.random.Generator, times: int, shift: float = 0.0) -> tuple[list[Snapshot], Readings]:
    """Analyses that are wrong by a smooth field, and four stations about each inner node."""
    inner = history.NODES[np.all((history.NODES > [-102, 34]) & (history.NODES < [-90, 42]), axis=1)]
    places = np.concatenate([inner + step for step in ([0.1, 0.1], [-0.1, 0.1], [0.1, -0.1], [-0.1, -0.1])])
    told, winds = [], []
    for k in range(times):
        error = ERROR * history.random_field(rng, 900e3)
        told.append(history.snapshot(6 * history.HOUR * k, 0.0, error))
        winds.append(NOISE * rng.standard_normal((len(places), 2)))
    when = 6 * history.HOUR * np.arange(times) + shift
    count = len(when)
    return told, Readings(
        when, (places,) * count, tuple(winds), True, (Path("m"),), ("",) * count, ((Path("m"),),) * count,
        np.zeros(count),
    )  # fmt: skip


@pytest.mark.statistical
def test_the_error_is_what_near_stations_share_and_the_rest_is_their_noise() -> None:
    hits, values = 0, []
    for seed in range(8):
        found = analysis_error(*reports(np.random.default_rng(seed), TIMES), Resampling())
        assert isinstance(found, dict)
        hits += found["sd_low"] <= ERROR <= found["sd_high"]
        values.append((found["sd"], found["station_noise"]))
        assert found["times"] == TIMES
    assert hits >= 4  # of 8 intervals that hold 0.95: fewer by chance once in 10^5 seeds, and these are fixed
    np.testing.assert_allclose(np.mean(values, axis=0), [ERROR, NOISE], rtol=0.05)


def test_times_that_never_meet_and_too_few_of_them_are_told() -> None:
    rng = np.random.default_rng(0)
    told, stations = reports(rng, 6, shift=600.0)
    assert "have no time in common" in str(analysis_error(told, stations, Resampling()))
    told, stations = reports(rng, 3)
    assert "3 times have 20 pairs" in str(analysis_error(told, stations, Resampling()))
