"""Hindcasts: full fields in the plane of a scene, random missions, promises held against what happened."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

import small_study
from careful_io.times import iso
from flight_quantities import frames
from noaa import NOAA, needs_noaa
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.observations import project_readings
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.scene import Scene
from pareto_ltl_apps.cli import hydra_app as app
from pareto_ltl_apps.studies import forecast_test
from pareto_ltl_apps.studies import random_missions as missions
from pareto_ltl_apps.studies.settings import HindcastConfig

START = 1.5e9
LON, LAT = (a.ravel() for a in np.meshgrid(np.arange(0.0, 360.0), np.arange(90.0, -91.0, -1.0)))


def readings(hours=(0, 3, 6, 9), lonlat=None, winds=None) -> Readings:
    """Global one-degree fields by default, a plane wave of wind that drifts with time."""
    nodes = np.stack([LON, LAT], -1) if lonlat is None else lonlat
    east = np.deg2rad(nodes[:, 0])
    table = winds or [
        np.stack([3 * np.cos(east + h), np.sin(np.deg2rad(nodes[:, 1])) + h], -1) for h in hours
    ]
    count = len(hours)
    return Readings(
        START + 3600.0 * np.array(hours),
        (nodes,) * count,
        tuple(table),
        True,
        (Path("made"),),
        ("",) * count,
        ((Path("made"),),) * count,
        np.zeros(count),
    )


def scene(lat=40.0, lon=-100.0, side=600e3) -> Scene:
    bounds = side / 2 * np.array([[-1.0, -1.0], [1.0, 1.0]])
    return Scene(bounds, np.zeros(2), {}, (), frames.local_plane(lat, lon), iso(START))


# --- full fields -----------------------------------------------------------------------------


@pytest.mark.parametrize("middle", [-179.9, -100.0, 0.1, 90.0, 180.0])
def test_a_bilinear_field_is_read_exactly_wherever_the_grid_wraps(middle: float) -> None:
    lon0, lat0 = round(middle), 40
    nodes = np.stack([LON, LAT], -1)
    east = (nodes[:, 0] - lon0 + 180) % 360 - 180
    winds = np.stack([2 + 0.1 * east + 0.01 * east * (nodes[:, 1] - lat0), nodes[:, 1]], -1)
    rng = np.random.default_rng(1)
    lon, lat = lon0 + rng.uniform(-5, 5, 50), lat0 + rng.uniform(-5, 5, 50)
    found = missions.interpolated(nodes, winds, (lon + 180) % 360 - 180, lat, middle)
    expected = np.stack([2 + 0.1 * (lon - lon0) + 0.01 * (lon - lon0) * (lat - lat0), lat], -1)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_linear_field_on_scattered_nodes_is_read_exactly() -> None:
    rng = np.random.default_rng(2)
    nodes = rng.uniform([-110, 30], [-90, 50], (200, 2))
    winds = nodes @ np.array([[0.3, -0.2], [0.1, 0.4]])
    lon, lat = rng.uniform(-105, -95, 30), rng.uniform(36, 44, 30)
    found = missions.interpolated(nodes, winds, lon, lat, -100.0)
    np.testing.assert_allclose(
        found, np.stack([lon, lat], -1) @ np.array([[0.3, -0.2], [0.1, 0.4]]), atol=1e-9
    )


def test_fields_are_turned_into_the_plane_as_readings_are() -> None:
    full, here = readings(), scene()
    near = np.abs(full.points[0][:, 0] - 260) + np.abs(full.points[0][:, 1] - 40) < 5
    nodes, winds = full.points[1][near], full.winds[1][near]
    points, turned = project_readings(str(here.crs), np.zeros(2), nodes, winds)
    found = missions.at_times(full, here, np.array([10800.0]), points)[0]
    np.testing.assert_allclose(found, turned, atol=1e-6)
    assert np.abs(found - winds).max() > 0.01  # the turn is visible


def test_the_real_wind_has_gusts_and_no_other_doubt() -> None:
    full, here = readings(), scene()
    times = np.array([0.0, 10800.0])
    shape = (2, 3, 3, 2)
    believed = WindField(
        np.full(2, -4e5), 4e5, times, np.zeros(shape), np.ones(shape), np.array([[1.0, 4.0], [2.0, 3.0]])
    )
    real = missions.real_wind(HindcastConfig(gusts=0.5), WindConfig(), full, here, believed)
    assert not real.latent_var.any()
    assert real.times.tolist() == [0.0, 10800.0, 21600.0, 32400.0]  # all that a flight can meet
    np.testing.assert_allclose(real.gust_var, 0.25 * believed.gust_var[[0, 1, 1, 1]])
    i, j = 4, 7
    node = real.origin + real.spacing * np.array([[i, j]])
    np.testing.assert_allclose(real.mean[:, i, j], missions.at_times(full, here, real.times, node)[:, 0])


def test_fields_that_do_not_reach_the_scene_are_refused() -> None:
    nodes = np.stack(np.meshgrid(np.arange(-80.0, -69.0), np.arange(30.0, 41.0)), -1).reshape(-1, 2)
    part = readings(hours=(0,), lonlat=nodes, winds=[np.ones((len(nodes), 2))])
    with pytest.raises(DataError, match="do not cover the scene around longitude -100"):
        missions.at_times(part, scene(), np.zeros(1), np.zeros((1, 2)))


def test_spells_end_where_fields_are_missing() -> None:
    full = readings(hours=(0, 3, 6, 24, 27, 30, 33))
    cfg = HindcastConfig(hours=6.0, max_gap=6.0)
    assert [(spell.first, spell.last) for spell in missions.spells(full, cfg)] == [(0, 2), (3, 6)]
    assert [(s.first, s.last) for s in missions.spells(full, replace(cfg, hours=9.0))] == [(3, 6)]
    with pytest.raises(DataError, match=r"no period of 12 h .* longest has 9 h"):
        missions.spells(full, replace(cfg, hours=12.0))


def test_folders_of_full_fields_are_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="no such folder"):
        missions.full_fields(HindcastConfig(truth=str(tmp_path / "none")))
    with pytest.raises(DataError, match="holds no GRIB2 file"):
        missions.full_fields(HindcastConfig(truth=str(tmp_path)))
    monkeypatch.setattr(missions, "checkout", lambda: None)
    with pytest.raises(ConfigError, match=r"hindcast\.truth is missing"):
        missions.full_fields(HindcastConfig())


# --- missions --------------------------------------------------------------------------------

SPELLS = tuple(missions.spells(readings(hours=tuple(range(0, 40, 3))), HindcastConfig()))


@pytest.mark.parametrize("number", range(12))
def test_a_mission_keeps_its_shapes_apart_and_its_flight_within_the_wind(number: int) -> None:
    cfg = HindcastConfig()
    task = missions.mission(cfg, 0, number, SPELLS)
    (west, south), (east, north) = task.scene.bounds
    side = east - west
    frame = shapely.box(west, south, east, north)
    shapes = [shapely.Polygon(p) for p in (*task.scene.region_outlines, *task.scene.obstacles)]
    shapes.append(shapely.Point(task.scene.start))
    assert set(task.scene.regions) == {"a", "b", "c"}
    assert cfg.obstacles[0] <= len(task.scene.obstacles) <= cfg.obstacles[1]
    assert cfg.side[0] <= side <= cfg.side[1]
    for k, shape in enumerate(shapes):
        assert frame.contains(shape)
        assert all(shape.distance(other) >= 0.049 * side for other in shapes[:k])
    for polygon in shapes[:-1]:
        assert polygon.exterior.is_ccw
        assert polygon.convex_hull.area == pytest.approx(polygon.area)
    assert shapely.contains_xy(shapely.Polygon(cfg.area), task.longitude, task.latitude)
    assert task.formula in cfg.formulas
    leaves = missions.seconds(str(task.scene.time_zero))
    assert task.spell.start <= leaves <= task.spell.end - 3600 * cfg.hours


def test_a_mission_does_not_depend_on_how_many_there_are() -> None:
    one, again = (missions.mission(HindcastConfig(missions=n), 4, 7, SPELLS) for n in (8, 80))
    np.testing.assert_array_equal(one.scene.start, again.scene.start)
    assert one.formula == again.formula
    other = missions.mission(HindcastConfig(), 5, 7, SPELLS)
    assert not np.array_equal(one.scene.start, other.scene.start)


# --- plans -----------------------------------------------------------------------------------


def test_a_front_is_flown_from_its_safest_to_its_shortest() -> None:

    cfg = small_study.settings()
    front = small_study.world(cfg).front
    chosen = forecast_test.picked(front, 3)
    assert chosen[0] is front.paths[0]
    assert chosen[-1] is front.paths[-1]
    assert len(forecast_test.picked(front, 10_000)) == len(front.paths)


@needs_noaa
def test_a_hindcast_of_real_fields_from_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command = [
        "pipelines=hindcast",
        "hindcast.missions=2",
        "hindcast.side=[300000.0,400000.0]",
        "planner.trees=2",
        "planner.n_max=1000",
        "fidelity.refine=none",
        "selection.runs=200",
        "selection.draws=100",
        "deployment.runs=50",
        "evaluation.jobs=1",
        "report.dpi=40",
        f"hindcast.truth={NOAA / 'gfs_1p00_10m'}",
        "hydra.run.dir=out",
    ]
    assert app.run_hydra(command) == 0
    metrics = json.loads(Path("out/metrics.json").read_text())
    assert metrics["missions"] == 2.0
    assert metrics["plans"] >= 1
    assert 0.4 < metrics["z_sd"] < 2.0
    assert 0.6 < metrics["coverage_90"] <= 1.0
    tables = sorted(Path("out").glob("readings_*.csv"))
    assert len(tables) == 2  # two spells of weather
    lines = tables[0].read_text().splitlines()
    assert len(lines) == 1 + 14 * HindcastConfig().points
    rows = list(csv.DictReader(Path("out/hindcast.csv").read_text().splitlines()))
    assert {row["kind"] for row in rows} == {"front", "chosen"}
    assert "test of interpolation" in Path("out/tables.md").read_text()
    for name in ("hindcast.csv", "reliability.csv", "scorecard.csv", "figures/reliability_paper.png"):
        assert (Path("out") / name).stat().st_size > 0
