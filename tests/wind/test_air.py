"""The air that wind files have beside the wind, from each format to the mean over a map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pytest

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind import sources
from pareto_ltl.wind.air import MapAir, NodeAir, map_air
from pareto_ltl.wind.readings import Readings

DIMS = "time", "lat", "lon"
LAT, LON = np.arange(30.0, 45.0), np.arange(260.0, 277.0)
Variables = dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]
WARM = 280.0 + 0.1 * np.broadcast_to(LAT[:, None], (2, 15, 17))
AIR = {"standard_name": "air_temperature", "units": "K"}
GROUND = {"standard_name": "surface_air_pressure", "units": "Pa"}


def described(**more: tuple[tuple[str, ...], Any, dict[str, str]]) -> Variables:
    """A wind of 0 at two times on a grid of 1 degree, with ``more`` variables."""
    since = "hours since 2018-10-09 00:00:00"
    still = np.zeros((2, len(LAT), len(LON)))
    return {
        "time": (("time",), np.array([0.0, 6.0]), {"units": since, "standard_name": "time"}),
        "lat": (("lat",), LAT, {"units": "degrees_north"}),
        "lon": (("lon",), LON, {"units": "degrees_east"}),
        "u10": (DIMS, still, {"standard_name": "eastward_wind", "units": "m s-1"}),
        "v10": (DIMS, still, {"standard_name": "northward_wind", "units": "m s-1"}),
        **more,
    }


def write(path: Path, variables: Variables) -> Path:
    sizes = {
        name: size
        for dims, values, _ in variables.values()
        for name, size in zip(dims, np.shape(values), strict=True)
    }
    with h5netcdf.File(path, "w") as file:
        file.dimensions = sizes
        for name, (dims, values, attributes) in variables.items():
            file.create_variable(name, dims, data=values).attrs.update(attributes)
    return path


def read(path: Path, level: str = "10m") -> Readings:
    return sources.read_readings(WindConfig(source="netcdf", path=str(path), level=level))


def warmth(found: Readings) -> NodeAir:
    air = found.airs[0]
    assert air is not None
    return air


# --- NetCDF ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "attributes", "values"),
    [
        ("t2m", {"long_name": "2 metre temperature", "units": "K"}, WARM),
        ("tas", AIR | {"units": "degC"}, WARM - 273.15),
        ("T2", {"description": "TEMP at 2 M", "units": "K"}, WARM),
        ("air_temperature_2m", AIR | {"units": "celsius"}, WARM - 273.15),
        ("2t", {"units": "K"}, WARM),
    ],
)
def test_a_temperature_near_the_ground_is_found_by_its_names(
    tmp_path: Path, name: str, attributes: dict[str, str], values: FloatArray
) -> None:
    more: dict[str, Any] = {}
    if name == "tas":  # its height is a coordinate, as in files of climate models
        attributes = attributes | {"coordinates": "height"}
        more["height"] = (), 2.0, {"units": "m", "standard_name": "height", "positive": "up"}
    path = write(tmp_path / "a.nc", described(**{name: (DIMS, values, attributes)}, **more))
    air = warmth(read(path))
    np.testing.assert_allclose(air.temperature, 280.0 + 0.1 * air.points[:, 1], atol=1e-9)
    assert (air.level, air.pressure_level) == ("2m", "0m")
    assert np.isnan(air.pressure).all()


def test_the_pressure_at_the_ground_comes_with_the_temperature(tmp_path: Path) -> None:
    pressure = DIMS, np.full((2, 15, 17), 950.0), GROUND | {"units": "hPa"}
    path = write(tmp_path / "a.nc", described(t2m=(DIMS, WARM, AIR), sp=pressure))
    np.testing.assert_allclose(warmth(read(path)).pressure, 95_000.0)
    assert read(write(tmp_path / "b.nc", described(sp=pressure))).airs == ()


@pytest.mark.parametrize(
    ("name", "attributes"),
    [
        ("d2m", {"long_name": "2 metre dewpoint temperature", "units": "K"}),
        ("sst", {"standard_name": "sea_surface_temperature", "units": "K"}),
        ("skt", {"long_name": "Skin temperature", "units": "K"}),
        ("T", {"description": "perturbation potential temperature (theta-t0)", "units": "K"}),
        ("mx2t", {"long_name": "Maximum temperature at 2 metres", "units": "K"}),
        ("t2m", AIR | {"cell_methods": "time: mean"}),
        ("t2m", AIR | {"units": "furlong"}),
        ("t500m", AIR),
    ],
)
def test_other_temperatures_are_not_of_the_air_at_the_wind(
    tmp_path: Path, name: str, attributes: dict[str, str]
) -> None:
    found = read(write(tmp_path / "a.nc", described(**{name: (DIMS, WARM, attributes)})))
    assert found.airs == ()
    assert any("no known unit of temperature" in note for note in found.notes) == (
        "furlong" in str(attributes)
    )


def test_at_a_pressure_the_temperature_of_that_pressure_counts(tmp_path: Path) -> None:
    dims = "time", "level", "lat", "lon"
    level = ("level",), np.array([1000.0, 925.0, 850.0]), {"units": "hPa", "standard_name": "air_pressure"}
    wind, warm = np.zeros((2, 3, 15, 17)), np.stack([WARM + k for k in (10.0, 0.0, -5.0)], axis=1)
    content = described(
        u=(dims, wind, {"standard_name": "eastward_wind", "units": "m s-1"}),
        v=(dims, wind, {"standard_name": "northward_wind", "units": "m s-1"}),
        t=(dims, warm, AIR), level=level, sp=(DIMS, np.full((2, 15, 17), 100_000.0), GROUND),
    )  # fmt: skip
    content["u"], content["v"] = content.pop("u10"), content.pop("v10")
    air = warmth(read(write(tmp_path / "a.nc", content), "925hPa"))
    np.testing.assert_allclose(air.temperature, 280.0 + 0.1 * air.points[:, 1], atol=1e-9)
    assert air.level == "925hPa"


def test_a_temperature_that_no_air_has_is_refused_in_one_line(tmp_path: Path) -> None:
    path = write(tmp_path / "a.nc", described(t2m=(DIMS, WARM - 273.15, AIR)))
    with pytest.raises(
        DataError, match=r"^wind file .*a\.nc.*: temperature 9\.85 K is not plausible for air"
    ):
        read(path)


# --- GRIB --------------------------------------------------------------------------------------


def grib_message(short: str, value: float, kind: str, level: int, hour: int = 0) -> bytes:
    eccodes = pytest.importorskip("eccodes")
    handle = eccodes.codes_grib_new_from_samples(
        f"regular_ll_{'pl' if kind == 'isobaricInhPa' else 'sfc'}_grib2"
    )
    keys = {
        "dataDate": 20181009, "dataTime": 100 * hour, "Ni": 6, "Nj": 6, "iDirectionIncrementInDegrees": 1,
        "jDirectionIncrementInDegrees": 1, "latitudeOfFirstGridPointInDegrees": 40,
        "latitudeOfLastGridPointInDegrees": 35, "longitudeOfFirstGridPointInDegrees": 265,
        "longitudeOfLastGridPointInDegrees": 270, "shortName": short, "typeOfLevel": kind, "level": level,
    }  # fmt: skip
    for key, to in keys.items():
        eccodes.codes_set(handle, key, to)
    eccodes.codes_set_values(handle, np.linspace(value - 1.0, value + 1.0, 36))
    content: bytes = eccodes.codes_get_message(handle)
    eccodes.codes_release(handle)
    return content


def grib_readings(path: Path, level: str, messages: list[bytes]) -> Readings:
    path.write_bytes(b"".join(messages))
    return sources.read_readings(WindConfig(source="grib", path=str(path), level=level))


def test_messages_of_the_air_are_read_with_the_wind_at_their_level(tmp_path: Path) -> None:
    above = "heightAboveGround"
    near = [grib_message("10u", 5.0, above, 10), grib_message("10v", 2.0, above, 10)]
    air = [grib_message("2t", 285.0, above, 2), grib_message("sp", 96_000.0, "surface", 0)]
    high = [
        grib_message(name, value, "isobaricInhPa", 925)
        for name, value in (("u", 9.0), ("v", 1.0), ("t", 278.0))
    ]
    far = [grib_message("t", 250.0, "isobaricInhPa", 500)]
    low = warmth(grib_readings(tmp_path / "a.grib2", "10m", near + air + high))
    assert low.level == "2m"
    assert (low.temperature.mean(), low.pressure.mean()) == pytest.approx((285.0, 96_000.0), abs=0.1)
    there = warmth(grib_readings(tmp_path / "b.grib2", "925hPa", near + air + far + high))
    assert (there.level, there.temperature.mean()) == ("925hPa", pytest.approx(278.0, abs=0.1))
    assert grib_readings(tmp_path / "c.grib2", "10m", near).airs == ()
    assert grib_readings(tmp_path / "d.grib2", "925hPa", [*high[:2], *air, *far]).airs == ()


# --- tables ------------------------------------------------------------------------------------


def table(path: Path, titles: str, cells: str) -> Readings:
    places = [(lat, lon) for lat in (36, 37, 38) for lon in (-93, -92)]
    rows = [f"2018-10-09T{hour:02d}:00Z,{lat},{lon},5,2{cells}" for hour in (0, 6) for lat, lon in places]
    path.write_text("\n".join([f"time,lat,lon,u,v{titles}", *rows]) + "\n")
    return sources.read_readings(WindConfig(source="csv", path=str(path), level="80m"))


@pytest.mark.parametrize(
    ("titles", "cells", "kelvin", "pascal"),
    [
        (",temperature_c", ",11.85", 285.0, np.nan),
        (",temperature_k,pressure_hpa", ",285,950", 285.0, 95_000.0),
        (",Temperature [degC],Pressure (Pa)", ",11.85,95000", 285.0, 95_000.0),
        (",temp_f", ",53.33", 285.0, np.nan),
    ],
)
def test_a_column_of_temperatures_states_its_unit(
    tmp_path: Path, titles: str, cells: str, kelvin: float, pascal: float
) -> None:
    air = warmth(table(tmp_path / "a.csv", titles, cells))
    np.testing.assert_allclose(air.temperature, kelvin, atol=1e-9)
    np.testing.assert_allclose(air.pressure, pascal)
    assert (air.level, air.pressure_level) == ("80m", "80m")


def test_a_column_without_a_unit_is_not_used_and_missing_cells_are_none(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert table(tmp_path / "a.csv", ",temperature", ",12").airs == ()
    assert "column temperature states no unit that is known" in caplog.text
    assert table(tmp_path / "b.csv", ",temperature_c", ",").airs == ()
    assert table(tmp_path / "c.csv", ",pressure_hpa", ",950").airs == ()


@pytest.mark.parametrize(
    ("cells", "words"),
    [(",285", "temperature 558.15 K is not plausible"), (",warm", "temperature is 'warm'")],
)
def test_a_cell_that_is_no_temperature_is_refused(tmp_path: Path, cells: str, words: str) -> None:
    with pytest.raises(DataError, match=words):
        table(tmp_path / "a.csv", ",temperature_c", cells)


# --- means -------------------------------------------------------------------------------------


def air_at(points: list[tuple[float, float]], kelvin: list[float], level: str = "2m", **more: Any) -> NodeAir:
    there = np.array(points, float)
    return NodeAir(there, np.array(kelvin), level, more.get("pressure", np.full(len(there), np.nan)))


BOUNDS = np.array([[0.0, 0.0], [10.0, 10.0]])
INSIDE = [(1.0, 1.0), (9.0, 1.0), (1.0, 9.0), (9.0, 9.0)]


def test_the_mean_is_over_the_map_and_the_time_of_the_flight() -> None:
    airs = {
        0.0: air_at([*INSIDE, (50.0, 50.0)], [280.0, 282.0, 284.0, 286.0, 400.0]),
        100.0: air_at(INSIDE, [290.0] * 4),
    }
    found = map_air(airs, BOUNDS)
    assert found is not None
    np.testing.assert_allclose(found.temperature, [283.0, 290.0])
    assert found.during(np.array([0.0, 50.0, 100.0])).temperature == pytest.approx(286.5)
    assert found.during(np.array([100.0, 500.0])).temperature == pytest.approx(290.0)  # held
    assert found.during(np.zeros(1)).pressure is None


def test_a_map_between_nodes_has_the_air_of_those_around_it() -> None:
    around = [(-5.0, -5.0), (15.0, -5.0), (-5.0, 15.0), (15.0, 15.0), (99.0, 99.0)]
    found = map_air({0.0: air_at(around, [280.0, 281.0, 282.0, 283.0, 350.0])}, BOUNDS)
    assert found is not None
    assert found.temperature[0] == pytest.approx(281.5)


def test_nodes_below_the_ground_and_without_a_value_do_not_count() -> None:
    pressure = np.array([100_000.0, 90_000.0, 100_000.0, 100_000.0])
    found = map_air(
        {0.0: air_at(INSIDE, [280.0, 300.0, np.nan, 282.0], "925hPa", pressure=pressure), 60.0: None}, BOUNDS
    )
    assert found is not None
    assert (found.times.tolist(), found.temperature.tolist()) == ([0.0], [281.0])
    assert map_air({0.0: air_at(INSIDE, [np.nan] * 4)}, BOUNDS) is None


def test_members_are_averaged() -> None:
    one, two = air_at(INSIDE, [280.0] * 4), air_at(INSIDE, [284.0] * 4)
    found = NodeAir.mean_of([one, None, two])
    assert found is not None
    assert found.temperature.tolist() == [282.0] * 4
    assert NodeAir.mean_of([None]) is None


def test_pressures_that_no_air_has_are_refused() -> None:
    with pytest.raises(DataError, match=r"x: pressure 950 Pa is not plausible|x: pressure 200 Pa is not"):
        air_at(INSIDE, [280.0] * 4, pressure=np.full(4, 200.0)).check("x")


def test_a_map_has_one_temperature_a_time() -> None:
    with pytest.raises(ValueError, match="temperature"):
        MapAir(np.zeros(2), np.zeros(1), np.zeros(2), "2m")
