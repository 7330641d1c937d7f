"""Readings scale the changes of the law: their spread, and earlier analyses among them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from careful_io.times import HOUR
from flight_quantities import frames
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.named_laws import law_named
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.readings import Readings
from pareto_ltl.world.scene import Scene
from wind_laws.documents import law_of

GFS = law_named("gfs_one_part")  # its change depends on changes between analyses alone
HELD = law_named("gfs")
NODES = np.stack(np.meshgrid(np.arange(-96.0, -87.0, 1.0), np.arange(33.0, 42.0, 1.0)), axis=-1).reshape(
    -1, 2
)
SCENE = Scene(np.array([[-2e5, -2e5], [2e5, 2e5]]), np.zeros(2), {}, (), frames.local_plane(37.0, -92.0))


def places(count: int) -> FloatArray:
    return np.random.default_rng(1).uniform(-4e5, 4e5, (count, 2))


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


def waves(points: FloatArray, draws: int) -> FloatArray:
    """Winds (draws, n, 2) of sd 1.7 m/s whose correlation falls to 0 within 300 km."""
    r = np.linalg.norm(points[:, None] - points, axis=2) / 100e3
    root = np.linalg.cholesky(np.exp(-(r**2)) + 1e-9 * np.eye(len(points)))
    return 1.7 * np.einsum("ij,djc->dic", root, np.random.default_rng(6).normal(size=(draws, len(points), 2)))


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
