"""``wind.nc`` in readers of the CF conventions: cf_xarray, and the checker of IOOS, if it is installed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cf_xarray  # noqa: F401 - the accessor .cf
import numpy as np
import pyproj
import pytest
import xarray

from flight_quantities import frames
from pareto_ltl.settings import WindConfig
from pareto_ltl.wind.field import fit_wind_field
from pareto_ltl.wind.netcdf import write_netcdf
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.scene import Scene
from wind_laws.records import PARTS

CENTRE = (37.0, -92.0)
SCENE = Scene(
    np.array([[-1e5, -1e5], [1e5, 1e5]]),
    np.zeros(2),
    {},
    (),
    frames.local_plane(*CENTRE),
    "2018-10-09T00:00:00Z",
)
ORDER = "further dimensions are not located left of T, Z, Y, X"  # a recommendation: see wind/netcdf.py


@pytest.fixture(scope="module")
def wind() -> WindField:
    """A field with modes and readings, as every run with a wind writes it."""
    lon, lat = np.meshgrid(np.linspace(-95, -89, 5), np.linspace(35, 39, 5))
    points = np.stack([lon, lat], axis=-1).reshape(-1, 2)
    winds = np.random.default_rng(0).normal(3.0, 2.0, (2, len(points), 2))
    readings = Readings.of_arrays(["2018-10-09T00:00Z", "2018-10-09T06:00Z"], points, winds, geographic=True)
    cfg = WindConfig(modes_max=4, spacing=5e4, modes_spacing=1e5, padding=5e4, forecast_error="none")
    return fit_wind_field(cfg, place_readings(cfg, readings, SCENE), SCENE)


@pytest.mark.parametrize(
    ("level", "standard", "vertical", "value"),
    [
        ("100m", "{}_wind", "height", 100.0),
        ("925hPa", "{}_wind", "air_pressure", 92500.0),
        ("30m depth", "sea_water_{}_velocity", "depth", 30.0),
    ],
)
def test_the_wind_has_the_names_places_and_levels_of_the_conventions(
    wind: WindField, tmp_path: Path, level: str, standard: str, vertical: str, value: float
) -> None:
    """A current is not named a wind, and no second variable is the projected x of the grid."""
    path = write_netcdf(replace(wind, level=level), tmp_path / "wind.nc", SCENE)
    with xarray.open_dataset(path, engine="h5netcdf") as found:
        names = found.cf.standard_names
        assert [names[standard.format(axis)] for axis in "xy"] == [["u"], ["v"]]
        assert names["projection_x_coordinate"] == ["x"]
        assert names["projection_y_coordinate"] == ["y"]
        east = found["u"]
        assert {key: east.cf.axes[key] for key in "XYT"} == {"X": ["x"], "Y": ["y"], "T": ["time"]}
        assert east.cf.coordinates["latitude"] == ["lat"]
        assert east.cf.coordinates["vertical"] == [vertical]
        assert float(east.cf["vertical"]) == value
        plane = pyproj.Proj(pyproj.CRS.from_cf(found["crs"].attrs))
        x, y = plane(east.cf["longitude"].values, east.cf["latitude"].values)
        np.testing.assert_allclose(x, np.broadcast_to(found["x"], x.shape), atol=0.01)
        np.testing.assert_allclose(y, np.broadcast_to(found["y"].values[:, None], y.shape), atol=0.01)
        assert east.attrs["ancillary_variables"] in found.variables
        parts = found["mode_part"]
        assert list(parts.attrs["flag_values"]) == list(range(-1, len(PARTS)))
        assert len(parts.attrs["flag_meanings"].split()) == len(PARTS) + 1
        assert set(np.unique(parts)) <= set(parts.attrs["flag_values"])
        assert all("units" in one.attrs or name in UNITLESS for name, one in found.variables.items())


UNITLESS = {"crs", "mode_part", "reading_count", "time"}  # xarray keeps the units of time elsewhere


@pytest.mark.parametrize("level", ["100m", "925hPa", "30m depth"])
def test_the_checker_of_the_conventions_has_no_remark_but_one_recommendation(
    wind: WindField, tmp_path: Path, level: str
) -> None:
    pytest.importorskip(
        "compliance_checker", reason="compliance-checker is not installed: it needs netCDF4 and cf-units"
    )
    from compliance_checker.runner import CheckSuite, ComplianceChecker

    CheckSuite.load_all_available_checkers()
    path = write_netcdf(replace(wind, level=level), tmp_path / "wind.nc", SCENE)
    report = tmp_path / "report.json"
    ComplianceChecker.run_checker(
        str(path), ["cf:1.11"], 0, "normal", output_filename=str(report), output_format="json"
    )
    told = json.loads(report.read_text())["cf:1.11"]
    levels = ("high_priorities", "medium_priorities", "low_priorities")
    remarks = [remark for each in levels for part in told[each] for remark in part["msgs"]]
    assert [remark for remark in remarks if ORDER not in remark] == []
