"""What goes in and comes out as objects of other packages: datasets, tables, features."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import pytest
import shapely
import xarray as xr

import pareto_ltl
from pareto_ltl.extend import Frame
from pareto_ltl.planning.plan_files import write_front
from quick_plan import QUICK_PLAN

OZARKS = Path(__file__).parents[2] / "examples" / "ozarks.geojson"
LAT, LON = np.arange(30.0, 46.1, 2.0), np.arange(-102.0, -81.9, 2.0)
DATES = pd.date_range("2026-03-01", periods=7, freq="6h")


def dataset(**about: str) -> xr.Dataset:
    """A wind from the west that rises towards the north, as models and reanalyses name it."""
    shape = (len(DATES), len(LAT), len(LON))
    east = np.broadcast_to(2.0 + 0.2 * (LAT - 30.0)[:, None], shape)
    units = {"units": "m s-1"} | about
    return xr.Dataset(
        {
            "u10": (("time", "lat", "lon"), east, {"standard_name": "eastward_wind"} | units),
            "v10": (("time", "lat", "lon"), np.full(shape, 0.5), {"standard_name": "northward_wind"} | units),
        },
        {
            "time": DATES,
            "lat": ("lat", LAT, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", LON, {"standard_name": "longitude", "units": "degrees_east"}),
        },
    )


@pytest.fixture(scope="module")
def planned() -> pareto_ltl.Run:
    wind: dict[str, Any] = {"source": dataset(), "forecast_error": "none", "hold_last": True}
    return pareto_ltl.plan("phi1", "F a", wind=wind, **QUICK_PLAN)


def test_a_dataset_is_the_wind_of_a_plan(planned: pareto_ltl.Run) -> None:
    assert planned.scene.time_zero == "2026-03-01T00:00:00Z"
    lon, lat = planned.scene.frame.to_geographic(planned.plan.path.x)
    met = planned.wind.at(planned.plan.path.x, 3600.0)
    true = np.column_stack([2.0 + 0.2 * (lat - 30.0), np.full(len(lat), 0.5)])
    np.testing.assert_allclose(np.linalg.norm(met, axis=1), np.linalg.norm(true, axis=1), atol=0.3)
    assert len(lon) > 2


def test_a_dataset_is_read_as_its_file(tmp_path: Path) -> None:
    dataset().to_netcdf(tmp_path / "wind.nc", engine="h5netcdf")
    ours, theirs = pareto_ltl.read_wind(dataset()), pareto_ltl.read_wind(tmp_path / "wind.nc")
    for one, other in ((ours.times, theirs.times), (ours.points, theirs.points), (ours.winds, theirs.winds)):
        np.testing.assert_array_equal(one, other)
    assert ours.files == ()


def test_what_is_wrong_in_a_dataset_is_said_without_a_file() -> None:
    with pytest.raises(
        pareto_ltl.DataError, match=r"^the given dataset has 2 faults: \(1\) u10 is in 'furlong'"
    ) as caught:
        pareto_ltl.plan("phi1", "F a", wind=dataset(units="furlong"))
    assert "tmp" not in str(caught.value)


def test_a_front_is_a_table_of_pandas(planned: pareto_ltl.Run, tmp_path: Path) -> None:
    write_front(tmp_path, planned.front)
    table = planned.front.to_pandas()
    with (tmp_path / "front.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [table.index.name, *table.columns] == list(rows[0])
    np.testing.assert_allclose(table["failure"], [float(row["failure"]) for row in rows], rtol=1e-12)
    assert table["length_m"].tolist() == [path.objectives.length for path in planned.front.paths]


def test_a_front_is_a_dataset_with_units_and_all_its_paths(planned: pareto_ltl.Run) -> None:
    data, paths = planned.front.to_xarray(), planned.front.paths
    assert data.length_m.units == "m"
    assert data.duration_s.units == "s"
    assert data.failure.values.tolist() == [rate.failure for rate in planned.front.rates]
    assert data.sizes == {"path": len(paths), "step": max(len(path.t) for path in paths)}
    for number, path in enumerate(paths):
        line = data.sel(path=number).dropna("step")
        np.testing.assert_array_equal(np.column_stack([line.x, line.y]), path.x)
        np.testing.assert_array_equal(line.t, path.t)


def test_a_figure_names_the_options_that_it_has(planned: pareto_ltl.Run) -> None:
    with pytest.raises(TypeError, match=r"figure of a Front has no option 'title', but scene, ax, plan$"):
        planned.front.plot(title="mine")
    with pytest.raises(
        TypeError, match=r"figure of a Run has no option 'title', but scene, ax, deployments$"
    ):
        planned.plot(title="mine")


@pytest.mark.parametrize(
    "use", [pareto_ltl.read_wind, lambda wind: pareto_ltl.plan("phi1", "F a", wind=wind)]
)
def test_one_component_is_no_wind(use: Callable[[Any], Any]) -> None:
    with pytest.raises(pareto_ltl.ConfigError, match=r"is one array of xarray; give a dataset with both"):
        use(dataset().u10)


def test_a_wind_in_memory_has_no_files_to_name(planned: pareto_ltl.Run) -> None:
    assert planned.wind.source == planned.to_xarray().source == "given"


def test_a_ready_map_is_read_by_its_name() -> None:
    assert sorted(pareto_ltl.read_map("phi1").regions) == ["a", "b", "c"]
    with pytest.raises(pareto_ltl.DataError, match=r"^phi9: cannot be read"):
        pareto_ltl.read_map("phi9")


def test_a_run_is_a_dataset_with_its_wind_and_its_path(planned: pareto_ltl.Run) -> None:
    data, path = planned.to_xarray(), planned.plan.path
    assert data.time.values[0] == np.datetime64("2026-03-01")
    place = data.isel(time=1, x=3, y=2)
    node = np.array([float(place.x), float(place.y)])
    found = [float(place.wind_x), float(place.wind_y)]
    np.testing.assert_allclose(found, planned.wind.at(node, planned.wind.times[1])[0], rtol=1e-12)
    np.testing.assert_array_equal(np.column_stack([data.path_x, data.path_y]), path.x)
    lon, lat = planned.scene.frame.to_geographic(path.x)
    np.testing.assert_allclose(np.column_stack([data.path_lon, data.path_lat]), np.column_stack([lon, lat]))
    assert data.path_time.values[-1] - data.path_time.values[0] == np.timedelta64(round(path.t[-1]), "s")


def test_a_plan_is_a_line_where_it_flies(planned: pareto_ltl.Run) -> None:
    line = shapely.geometry.shape(planned.plan.__geo_interface__["geometry"])
    drawn = planned.scene.frame.to_plane(*np.array(line.coords).T)
    assert shapely.LineString(drawn).hausdorff_distance(shapely.LineString(planned.plan.path.x)) < 1.0
    (row,) = gpd.GeoDataFrame.from_features([planned.plan.__geo_interface__]).itertuples()
    assert row.formula == "F a"
    assert row.failure == planned.plan.promise.rate.failure


@pytest.mark.parametrize("crs", [None, "EPSG:3857"])
def test_a_geodataframe_is_a_map(crs: str | None) -> None:
    frame = gpd.read_file(OZARKS)
    ours, theirs = (
        pareto_ltl.read_map(frame if crs is None else frame.to_crs(crs)),
        pareto_ltl.read_map(OZARKS),
    )
    assert list(ours.regions) == list(theirs.regions)
    np.testing.assert_allclose(ours.start, theirs.start, atol=1e-3)
    for one, other in zip(
        (*ours.region_outlines, *ours.obstacles), (*theirs.region_outlines, *theirs.obstacles), strict=True
    ):
        assert shapely.Polygon(one).symmetric_difference(shapely.Polygon(other)).area < 1.0


def test_a_map_is_features_that_are_read_as_the_same_map() -> None:
    scene = pareto_ltl.read_map(OZARKS)
    frame = gpd.GeoDataFrame.from_features(scene.__geo_interface__["features"], crs="EPSG:4326")
    again = pareto_ltl.read_map(frame)
    assert list(again.regions) == list(scene.regions)
    assert again.obstacle_names == scene.obstacle_names
    for one, other in zip(again.region_outlines, scene.region_outlines, strict=True):
        lonlat = scene.frame.to_plane(*again.frame.lonlat(one).T)
        assert shapely.Polygon(lonlat).hausdorff_distance(shapely.Polygon(other)) < 5.0


def test_a_map_without_a_place_on_earth_is_drawn_in_metres() -> None:
    square = np.array([[1.0, 1], [2, 1], [2, 2], [1, 2]])
    scene = pareto_ltl.Scene(np.array([[0.0, 0], [9, 9]]), np.ones(2), {"a": square})
    region = scene.__geo_interface__["features"][-1]
    assert shapely.geometry.shape(region["geometry"]).equals(shapely.Polygon(square))
    assert region["properties"] == {"role": "region", "name": "a"}
    with pytest.raises(pareto_ltl.DataError, match="the map has no place on Earth"):
        scene.frame.to_geographic(square)


@pytest.mark.parametrize(
    ("mission", "begins"), [(None, "00"), ({"start_time": "2026-03-01T02:00:00Z"}, "02")]
)
def test_a_map_in_memory_departs_as_the_mission_says_or_with_the_wind(mission: Any, begins: str) -> None:
    square = 30e3 + 4e3 * np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    plane = Frame.at(37.0, -92.0).crs
    scene = pareto_ltl.Scene(np.array([[0.0, 0], [5e4, 5e4]]), np.full(2, 1e4), {"a": square}, crs=plane)
    wind: dict[str, Any] = {"source": dataset(), "forecast_error": "none"}
    options = QUICK_PLAN | {"robot": {"dt": 300.0}} | ({} if mission is None else {"mission": mission})
    result = pareto_ltl.plan(scene, "F a", wind=wind, **options)
    assert result.plan.navigation.time_utc[0] == f"2026-03-01T{begins}:00:00Z"
