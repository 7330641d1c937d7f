"""How variable the wind at hand is, and the law of its changes scaled to that."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from careful_io.times import HOUR
from flight_quantities import frames
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.change_law import ChangeLaw
from pareto_ltl.wind.named_laws import law_named, law_of
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.variability import spread_near, variability_of
from pareto_ltl.world.scene import Scene

GFS = law_named("gfs_one_part")  # its change depends on changes between analyses alone
HELD = law_named("gfs")
NODES = np.stack(np.meshgrid(np.arange(-96.0, -87.0, 1.0), np.arange(33.0, 42.0, 1.0)), axis=-1).reshape(
    -1, 2
)
SCENE = Scene(np.array([[-2e5, -2e5], [2e5, 2e5]]), np.zeros(2), {}, (), frames.local_plane(37.0, -92.0))


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
    cfg = WindConfig(
        **{"source": "grib", "path": "x", "cache": False, "hold_last": True, "forecast_error": "gfs_one_part"}
        | settings
    )
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


# --- laws that depend on the winds at hand ----------------------------------------------------------


def waves(points: FloatArray, draws: int) -> FloatArray:
    """Winds (draws, n, 2) of sd 1.7 m/s whose correlation falls to 0 within 300 km."""
    r = np.linalg.norm(points[:, None] - points, axis=2) / 100e3
    root = np.linalg.cholesky(np.exp(-(r**2)) + 1e-9 * np.eye(len(points)))
    return 1.7 * np.einsum("ij,djc->dic", root, np.random.default_rng(6).normal(size=(draws, len(points), 2)))


def test_the_spread_is_a_mean_over_pairs_and_hardly_depends_on_the_area() -> None:
    small, large = (np.random.default_rng(5).uniform(-half, half, (80, 2)) for half in (5e5, 1.5e6))
    found = [np.mean([spread_near(points, w) for w in waves(points, 300)]) for points in (small, large)]
    near = np.linalg.norm(small[:, None] - small, axis=2)
    kept = np.exp(-((near[(near > 0) & (near <= 1e6)] / 100e3) ** 2)).mean()
    assert found[0] == pytest.approx(1.7 * np.sqrt(1.0 - kept), rel=0.03)
    assert found[1] == pytest.approx(found[0], rel=0.05)


def test_few_places_and_places_far_apart_have_no_spread() -> None:
    assert spread_near(places(9), np.ones((9, 2))) is None
    far = 1.1e6 * np.stack([np.arange(12.0), np.zeros(12)], axis=1)
    assert spread_near(far, np.ones((12, 2))) is None
    assert spread_near(places(10), np.ones((10, 2))) == 0.0


RULE = ChangeLaw(3.0, 2.0, 40.0, 0.01, 3.0, 5.0, 10)


def test_the_change_grows_with_the_spread_and_the_latitude_within_limits() -> None:
    assert RULE.expected(None, None) == 1.0
    assert RULE.expected(6.0, 40.0) == pytest.approx(4.0)
    assert RULE.expected(6.0, -60.0) == pytest.approx(4.0 * np.exp(0.2))
    assert RULE.expected(0.0, None) == pytest.approx(0.25**2)
    assert RULE.expected(1e3, None) == pytest.approx(2.5**2)


def test_tails_are_those_of_an_inverse_gamma_variance() -> None:
    """s is the standard deviation of log √(n / χ²) with n = n_0 + 2 + w degrees of freedom."""
    for freedom, most in ((0.0, 3.0 + 2.0), (20.0, 3.0 + 2.0 + 4.0)):
        drawn = np.random.default_rng(8).chisquare(most, 400_000)
        assert RULE.tail(freedom) == pytest.approx(float(np.std(0.5 * np.log(drawn))), rel=0.01)


def test_the_winds_of_one_field_scale_the_change_and_earlier_analyses_weigh_in() -> None:
    points = places(60)
    calm, rough = waves(points, 1)[0], 3.0 * waves(points, 1)[0]
    alone = variability_of(HELD, np.zeros(1), points, calm[None], latitude=40.0)
    wild = variability_of(HELD, np.zeros(1), points, rough[None], latitude=40.0)
    assert alone is not None
    assert wild is not None
    assert HELD.winds is not None
    assert wild.factor / alone.factor == pytest.approx(3.0**HELD.winds.power)
    assert len(alone.starts) == 0
    assert alone.freedom == 0.0
    steady = variability_of(HELD, HOUR * np.array([0.0, 6.0]), points, np.stack([calm, calm]), latitude=40.0)
    assert steady is not None
    weight = HELD.winds.weight(steady.freedom)
    assert weight < HELD.winds.most_freedom < steady.freedom
    wanted = max(0.25, HELD.winds.freedom / (HELD.winds.freedom + weight))
    assert steady.factor == pytest.approx(alone.factor * wanted)
    assert HELD.winds.tail(steady.freedom) < HELD.winds.tail()


def test_a_held_field_of_a_modelled_source_depends_on_its_winds_and_the_document_says_so() -> None:
    law = placed(readings([0, 6, 12], 1.0), 12.0, forecast_error="auto")
    found = law.variability
    assert found is not None
    assert len(found.starts) == 0
    assert found.latitude == pytest.approx(37.0, abs=0.01)
    np.testing.assert_allclose(law.change_sd, np.sqrt(found.factor) * HELD.change_sd)
    assert law.change_tail == HELD.winds.tail() > 0.2
    again = law_of(law.document())
    assert again.winds == HELD.winds
    assert (again.variability.spread, again.variability.latitude) == (found.spread, found.latitude)
    assert again.change_tail == law.change_tail


def test_winds_in_a_plane_have_no_latitude() -> None:
    told = replace(readings([0, 0], 1.0), geographic=False, points=(places(60),) * 2)
    told = replace(told, winds=tuple(waves(places(60), 2)))
    law = placed(told, 7.0, source="csv", forecast_error="gfs")
    assert law.variability.latitude is None
    assert law.variability.spread is not None


def test_other_levels_follow_the_spread_of_the_winds_alone() -> None:
    other = HELD.for_winds("850hPa", 2.0 * HELD.spread)
    np.testing.assert_array_equal(other.change_sd, HELD.change_sd)
    np.testing.assert_allclose(other.parts[1].sd, 2.0 * HELD.parts[1].sd)
