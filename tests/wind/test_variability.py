"""How variable the wind at hand is, and the law of its changes scaled to that."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.times import HOUR
from pareto_ltl.wind.named_laws import law_named, law_of
from pareto_ltl.wind.observations import place_readings, variability_of
from pareto_ltl.wind.readings import Readings
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene

GFS = law_named("gfs")
NODES = np.stack(np.meshgrid(np.arange(-96.0, -87.0, 1.0), np.arange(33.0, 42.0, 1.0)), axis=-1).reshape(
    -1, 2
)
SCENE = Scene(np.array([[-2e5, -2e5], [2e5, 2e5]]), np.zeros(2), {}, (), projection.local_plane(37.0, -92.0))


def places(count: int) -> FloatArray:
    return np.random.default_rng(1).uniform(-4e5, 4e5, (count, 2))


def changing(times: FloatArray, points: FloatArray, draws: int) -> FloatArray:
    """Winds (draws, A, n, 2) whose changes are Gaussian and have the law's covariance in time and space."""
    since, late = times[1:] - times[0], GFS.change_variance
    both = 0.5 * (late(since)[:, None] + late(since) - late(np.abs(since[:, None] - since)))
    r = np.sqrt(3.0) * np.linalg.norm(points[:, None] - points, axis=2) / GFS.change_length
    roots = np.linalg.cholesky(both), np.linalg.cholesky((1 + r) * np.exp(-r) + 1e-9 * np.eye(len(points)))
    drawn = np.random.default_rng(2).normal(size=(draws, len(since), len(points), 2))
    walks = np.einsum("ab,nm,dbmc->danc", *roots, drawn)
    return np.concatenate([np.zeros_like(walks[:, :1]), walks], axis=1)


def test_the_freedom_is_that_of_the_mean_square_change_of_simulated_fields() -> None:
    """Of a mean of squares with ν degrees of freedom, the variance is 2/ν times its squared mean."""
    times, points = HOUR * np.array([0.0, 6.0, 12.0, 24.0]), places(30)
    ratios, freedom = [], 0.0
    for winds in changing(times, points, 3000):
        found = variability_of(GFS, times, points, winds)
        assert found is not None
        freedom = found.freedom
        ratios.append(np.mean(found.squares / GFS.change_variance(found.ends - found.starts)))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.03)
    assert 2.0 / np.var(ratios) == pytest.approx(freedom, rel=0.1)


def test_few_changes_are_weighed_against_the_law_and_the_factor_is_limited() -> None:
    times, points = HOUR * np.array([0.0, 6.0]), np.zeros((1, 2))
    winds = np.zeros((2, 1, 2))
    winds[1] = np.sqrt(3.0 * GFS.change_variance(6 * HOUR))  # thrice the law's mean square
    found = variability_of(GFS, times, points, winds)
    assert found is not None
    assert found.freedom == pytest.approx(2.0)  # two components at one place, once
    assert found.factor == pytest.approx((10.0 + 2.0 * 3.0) / 12.0)
    for speed, limit in ((0.0, 0.25), (30.0, 4.0)):
        winds = np.stack([np.zeros((500, 2)), np.full((500, 2), speed)])
        far = np.random.default_rng(4).uniform(-2e7, 2e7, (500, 2))
        found = variability_of(GFS, times, far, winds)
        assert found is not None
        assert found.factor == limit


def test_times_beyond_the_table_of_the_law_say_nothing() -> None:
    for hours in (1.0, 31.0):
        assert variability_of(GFS, HOUR * np.array([0.0, hours]), places(5), np.ones((2, 5, 2))) is None


def readings(leads: list[float], scale: float, every: float = 6.0) -> Readings:
    """Fields ``every`` hours apart, of which those with lead 0 change by ``scale`` [m/s] rms a component."""
    count = len(leads)
    rng = np.random.default_rng(3)
    return Readings(
        times=HOUR * every * np.arange(count),
        points=(NODES,) * count,
        winds=tuple(np.cumsum(rng.normal(0, scale, (count, *NODES.shape)), axis=0)),
        geographic=True,
        files=(Path("winds.grib2"),),
        remarks=("",) * count,
        origins=((Path("winds.grib2"),),) * count,
        leads=HOUR * np.array(leads, float),
    )


def placed(told, hours, **settings):
    cfg = WindConfig(**{"source": "grib", "path": "x", "cache": False, "hold_last": True} | settings)
    stamp = np.datetime64(0, "s") + np.timedelta64(int(hours * HOUR), "s")
    return place_readings(cfg, told, replace(SCENE, time_zero=str(stamp) + "Z")).error


def test_earlier_analyses_scale_the_error_of_a_held_field() -> None:
    law = placed(readings([0, 0, 0], 1.0), 13.0)
    assert law.variability.starts.tolist() == [-13 * HOUR, -7 * HOUR]
    assert law.variability.factor < 0.7  # 1 m/s in 6 h; the law has 2.29
    np.testing.assert_allclose(law.change_sd, np.sqrt(law.variability.factor) * GFS.change_sd)
    assert [part.name for part in law.parts] == [part.name for part in GFS.parts]
    again = law_of(law.document())
    np.testing.assert_array_equal(again.change_sd, law.change_sd)
    np.testing.assert_array_equal(again.variability.squares, law.variability.squares)


def test_analyses_of_more_than_two_days_ago_are_forgotten() -> None:
    law = placed(readings([0] * 12, 1.0), 66.0)
    assert law.variability.starts[0] == -48 * HOUR


@pytest.mark.parametrize(
    ("leads", "settings"),
    [([0, 6, 12], {}), ([0, 0, 0], {"source": "stations"}), ([0, 0, 0], {"source": "sample", "path": None})],
)
def test_one_analysis_stations_and_the_sample_leave_the_law_as_it_is(leads, settings):
    law = placed(readings(leads, 1.0), 12.0, **settings)
    assert law.variability is None
    np.testing.assert_array_equal(law.change_sd, GFS.change_sd)


def test_analyses_on_another_grid_are_not_compared() -> None:
    told = readings([0, 0, 0], 1.0)
    other = replace(told, points=(NODES[1:], NODES, NODES), winds=(told.winds[0][1:], *told.winds[1:]))
    assert placed(other, 12.0).variability.starts.tolist() == [-6 * HOUR]
