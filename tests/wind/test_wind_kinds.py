"""Files of many kinds, made here: what is read, against the field they were made from and a second reader."""

from __future__ import annotations

import json
import logging
import math
import re
from pathlib import Path

import numpy as np
import pyproj
import pytest
import xarray as xr

import pareto_ltl
from careful_io.times import seconds
from noaa import NOAA, needs_noaa
from pareto_ltl.support.errors import DataError

SHARED = Path(__file__).parents[3] / "shared" / "cases" / "cases.json"
LAT, LON = np.arange(34.0, 42.0), np.arange(-98.0, -85.0)
HOURS = np.array([0, 6, 12])
SINCE = "hours since 2018-10-09 18:00:00"
TIMES = [seconds("2018-10-09T18:00") + 3600.0 * hour for hour in HOURS]
KNOT = 1852.0 / 3600.0


def field(lon, lat):
    """The wind [m/s] that all files have, except those of 10 m/s towards the east."""
    return np.stack([4 + 0.2 * (lat - 37), -3 + 0.1 * (lon + 92)], axis=-1)


def check(found, expected=field, times=TIMES):
    np.testing.assert_allclose(found.times, times)
    for points, winds in zip(found.points, found.winds, strict=True):
        np.testing.assert_allclose(winds, expected(*points.T), atol=0.01)


def components(units="m s-1", names=("u10", "v10"), attributes=({}, {}), factor=1.0):
    grid = field(*np.meshgrid(LON, LAT)) / factor
    values = [np.broadcast_to(grid[..., k], (3, len(LAT), len(LON))).copy() for k in (0, 1)]
    return {
        name: (("time", "lat", "lon"), array, {"units": units} | more)
        for name, array, more in zip(names, values, attributes, strict=True)
    }


def dataset(arrays, time=None):
    clock = ("time", HOURS, {"units": SINCE, "standard_name": "time"}) if time is None else time
    coords = {
        "time": clock,
        "lat": ("lat", LAT, {"units": "degrees_north"}),
        "lon": ("lon", LON, {"units": "degrees_east"}),
    }
    return xr.Dataset(arrays, {name: value for name, value in coords.items() if value is not False})


def saved(data, path):
    data.to_netcdf(path, engine="h5netcdf")
    return path


# --- units and names -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("units", "factor"),
    [
        ("m s-1", 1.0), ("m/s", 1.0), ("meter/sec", 1.0), ("metres_per_second", 1.0), ("m s**-1", 1.0),
        ("metres/s", 1.0), ("Meter Second^-1", 1.0), ("knots", KNOT), ("kt", KNOT), ("km/h", 1 / 3.6),
        ("km hr-1", 1 / 3.6), ("cm/s", 0.01), ("cm s-1", 0.01), ("mph", 0.44704), ("ft/s", 0.3048),
        ("nautical_mile/hour", KNOT),
    ],
)  # fmt: skip
def test_spellings_of_units_are_read(tmp_path, units, factor):
    check(pareto_ltl.read_wind(saved(dataset(components(units, factor=factor)), tmp_path / "a.nc")))


def test_a_unit_that_is_no_speed_is_refused_with_those_that_are(tmp_path):
    with pytest.raises(DataError, match=r"u10 is in 'm s-2'; expected m s-1"):
        pareto_ltl.read_wind(saved(dataset(components("m s-2")), tmp_path / "a.nc"))


@pytest.mark.parametrize("standard", ["unknown", "undefined", ""])
def test_a_standard_name_that_states_nothing_does_not_hide_the_components(tmp_path, standard):
    attributes = [
        {"standard_name": standard, "long_name": f"10 metre {letter} wind component"} for letter in "UV"
    ]
    check(pareto_ltl.read_wind(saved(dataset(components(attributes=attributes)), tmp_path / "a.nc")))


def test_final_and_preliminary_values_of_era5_are_joined(tmp_path):
    arrays = {}
    for name, (dims, values, attributes) in components().items():
        both = np.stack([values, values], axis=1)
        both[2:, 0] = np.nan
        both[:2, 1] = np.nan
        arrays[name] = ((dims[0], "expver", *dims[1:]), both, attributes)
    check(pareto_ltl.read_wind(saved(dataset(arrays).assign_coords(expver=[1, 5]), tmp_path / "a.nc")))


def test_components_in_two_files_of_a_folder_are_joined_and_one_alone_names_the_folder(tmp_path):
    names = ("uwnd", "vwnd")
    for name, array in components(names=names).items():
        saved(dataset({name: array}), tmp_path / f"{name}.2018.nc")
    check(pareto_ltl.read_wind(tmp_path))
    with pytest.raises(DataError, match=re.escape(f"read both with wind.path={tmp_path}")):
        pareto_ltl.read_wind(tmp_path / "uwnd.2018.nc")


@pytest.mark.parametrize("meaning", ["from", "to"])
def test_speed_and_direction_are_read_by_their_standard_names(tmp_path, meaning):
    u, v = (array[1] for array in components().values())
    sign = -1.0 if meaning == "from" else 1.0
    direction = np.rad2deg(np.arctan2(sign * u, sign * v)) % 360.0
    dims = ("time", "lat", "lon")
    arrays = {
        "a": (dims, np.hypot(u, v), {"units": "m s-1", "standard_name": "wind_speed"}),
        "b": (dims, direction, {"units": "degree", "standard_name": f"wind_{meaning}_direction"}),
    }
    check(pareto_ltl.read_wind(saved(dataset(arrays), tmp_path / "a.nc")))


# --- clocks ----------------------------------------------------------------------------------


def clocks(**described):
    """Clocks by name: hours from 18:00, attributes; along the dimension ``step``."""
    arrays = {
        name: (("step", *dims[1:]), values, attributes)
        for name, (dims, values, attributes) in components().items()
    }
    found = {
        name: ("step", np.asarray(hours, float), {"units": SINCE} | more)
        for name, (hours, more) in described.items()
    }
    data = dataset(arrays, False).assign_coords(found)
    for name in data.variables:  # xarray leaves out the attribute for names that it does not write
        data[name].encoding["_FillValue"] = None
    return data


@pytest.mark.parametrize(
    ("described", "leads"),
    [
        ({"a_init_time": (HOURS - 6, {}), "valid_time": (HOURS, {})}, 6.0),
        ({"model_run": (HOURS - 12, {}), "time": (HOURS, {})}, 12.0),
        ({"a": (HOURS - 3, {"standard_name": "forecast_reference_time"}), "b": (HOURS, {})}, 3.0),
        ({"a": (HOURS - 3, {"long_name": "initial time of forecast"}), "b": (HOURS, {})}, 3.0),
        ({"a": (HOURS, {"long_name": "Valid Time"}), "b": (HOURS - 3, {"long_name": "Analysis time"})}, 3.0),
        ({"init": (HOURS - 6, {}), "lead_time": (HOURS * 0 + 6, {"units": "hours"})}, 6.0),
        (
            {"time": (HOURS, {"long_name": "Valid Time"}), "tau": (HOURS, {"units": "hours since analysis"})},
            None,
        ),
        ({"first": (HOURS, {}), "second": (HOURS, {})}, np.nan),
    ],
)
def test_the_valid_time_is_found_by_its_role(tmp_path, described, leads):
    if "a_init_time" in described:
        described = {"init_time": described["a_init_time"], "valid_time": described["valid_time"]}
    found = pareto_ltl.read_wind(saved(clocks(**described), tmp_path / "a.nc"))
    check(found)
    expected = HOURS * 1.0 if leads is None else np.full(3, leads)
    np.testing.assert_allclose(found.leads / 3600.0, expected)


def test_two_clocks_without_a_role_are_refused_with_a_way_out_that_works(tmp_path):
    data = clocks(first=(HOURS, {}), second=(HOURS - 6, {}))
    with pytest.raises(DataError, match=r"first, second are times of u10 that differ.*standard_name='time'"):
        pareto_ltl.read_wind(saved(data, tmp_path / "a.nc"))
    data["first"].attrs["standard_name"] = "time"
    data["second"].attrs["standard_name"] = "forecast_reference_time"
    check(pareto_ltl.read_wind(saved(data, tmp_path / "b.nc")))


def test_of_runs_and_steps_the_newest_run_counts(tmp_path):
    u, v = (array[1] for array in components().values())
    step, run = np.array([0.0, 6.0, 12.0]), np.array([0.0, 6.0])
    dims = ("time", "step", "lat", "lon")
    more = np.array([0.0, 1.0])[:, None, None, None]  # by which the second run is stronger
    arrays = {
        name: (dims, np.broadcast_to(values, (2, *values.shape)) + more, {"units": "m/s"})
        for name, values in (("u10", u), ("v10", v))
    }
    clock = ("time", run, {"units": SINCE, "standard_name": "forecast_reference_time"})
    data = dataset(arrays, clock).assign_coords(
        step=("step", step, {"units": "hours", "standard_name": "forecast_period"}),
        valid_time=(("time", "step"), run[:, None] + step, {"units": SINCE, "standard_name": "time"}),
    )
    found = pareto_ltl.read_wind(saved(data, tmp_path / "a.nc"))
    np.testing.assert_allclose(found.times, [TIMES[0] + 3600.0 * hour for hour in (0, 6, 12, 18)])
    np.testing.assert_allclose(found.leads / 3600.0, [0, 0, 6, 12])
    plain = field(*found.points[0].T)
    for winds, extra in zip(found.winds, (0, 1, 1, 1), strict=True):
        np.testing.assert_allclose(winds, plain + extra)


# --- directions ------------------------------------------------------------------------------


LAMBERT = "+proj=lcc +lat_1=30 +lat_2=60 +lat_0=37 +lon_0=-110 +R=6370000 +units=m"


def eastward(lon, lat):
    """10 m/s towards the east."""
    return np.broadcast_to([10.0, 0.0], (*np.shape(lon), 2))


def along_axes(to_degrees, x, y, size):
    """Components along the axes of a grid of a wind of 10 m/s to the east, and the places.

    By differences: the directions of the axes on the ground, from places ``size`` apart.
    """
    lon, lat = to_degrees(x, y)
    ahead, abeam = to_degrees(x, y + size)
    angle = np.arctan2((ahead - lon) * np.cos(np.deg2rad(lat)), abeam - lat)  # of grid north, from north
    return 10 * np.cos(angle), 10 * np.sin(angle), lon, lat


def lambert_grid():
    plane = pyproj.Proj(LAMBERT)
    x, y = np.arange(9e5, 2.0e6, 1e5), np.arange(-3e5, 4e5, 1e5)
    xs, ys = np.meshgrid(x, y)
    return x, y, *along_axes(lambda a, b: plane(a, b, inverse=True), xs, ys, 10.0)


def test_components_of_a_projection_are_turned_by_the_grid_mapping(tmp_path):
    x, y, u, v, _, _ = lambert_grid()
    attributes = {"grid_mapping_name": "lambert_conformal_conic", "latitude_of_projection_origin": 37.0}
    attributes |= {"longitude_of_central_meridian": -110.0, "standard_parallel": [30.0, 60.0]}
    attributes["earth_radius"] = 6370000.0
    named = {"units": "m/s", "grid_mapping": "plane"}
    data = xr.Dataset(
        {
            "u-component_of_wind_height_above_ground": (("y", "x"), u, named),
            "v-component_of_wind_height_above_ground": (("y", "x"), v, named),
            "plane": ((), 0, attributes),
        },
        {
            "y": ("y", y / 1e3, {"units": "km", "standard_name": "projection_y_coordinate"}),
            "x": ("x", x / 1e3, {"units": "km", "standard_name": "projection_x_coordinate"}),
            "time": ((), 0, {"units": SINCE, "standard_name": "time"}),
        },
    )
    check(pareto_ltl.read_wind(saved(data, tmp_path / "a.nc")), eastward, TIMES[:1])


def curvilinear(u, v, lon, lat, attributes=None, **more):
    described = {"units": "m s-1", "standard_name": "eastward_wind"} | (attributes or {})
    data = xr.Dataset(
        {
            "u10": (("y", "x"), u, described),
            "v10": (("y", "x"), v, described | {"standard_name": "northward_wind"}),
        },
        {
            "latitude": (("y", "x"), lat, {"units": "degrees_north"}),
            "longitude": (("y", "x"), lon, {"units": "degrees_east"}),
            "time": ((), 0, {"units": SINCE, "standard_name": "time"}),
        },
    )
    return data.assign_coords(more)


def test_the_flag_of_grib_in_a_file_of_cfgrib_counts_before_the_standard_name(tmp_path):
    _, _, u, v, lon, lat = lambert_grid()
    keys = {"GRIB_gridType": "lambert", "GRIB_LaDInDegrees": 37.0, "GRIB_LoVInDegrees": -110.0}
    keys |= {"GRIB_Latin1InDegrees": 30.0, "GRIB_Latin2InDegrees": 60.0}
    relative = curvilinear(u, v, lon, lat, keys | {"GRIB_uvRelativeToGrid": 1})
    check(pareto_ltl.read_wind(saved(relative, tmp_path / "a.nc")), eastward, TIMES[:1])
    turned = curvilinear(u * 0 + 10, v * 0, lon, lat, keys | {"GRIB_uvRelativeToGrid": 0})
    check(pareto_ltl.read_wind(saved(turned, tmp_path / "b.nc")), eastward, TIMES[:1])
    lacking = curvilinear(u, v, lon, lat, {"GRIB_gridType": "lambert", "GRIB_uvRelativeToGrid": 1})
    with pytest.raises(DataError, match=r"does not state Latin1InDegrees.*eastward_wind"):
        pareto_ltl.read_wind(saved(lacking, tmp_path / "c.nc"))


def test_a_curvilinear_grid_without_directions_is_refused_with_a_way_out_that_works(tmp_path):
    _, _, u, v, lon, lat = lambert_grid()
    data = curvilinear(u * 0 + 10, v * 0, lon, lat)
    for name in ("u10", "v10"):
        del data[name].attrs["standard_name"]
    with pytest.raises(DataError, match=r"whose directions the file does not state.*standard_name"):
        pareto_ltl.read_wind(saved(data, tmp_path / "a.nc"))
    data.u10.attrs["standard_name"], data.v10.attrs["standard_name"] = "eastward_wind", "northward_wind"
    check(pareto_ltl.read_wind(saved(data, tmp_path / "b.nc")), eastward, TIMES[:1])


@pytest.mark.parametrize("stated", ["angles", "projection"])
def test_winds_of_wrf_are_turned_by_the_angles_or_by_the_projection(tmp_path, stated):
    _, _, u, v, lon, lat = lambert_grid()

    def thrice(values):
        return ("Time", "south_north", "west_east"), np.stack([values] * 3)

    letters = np.array([f"2018-10-{day}_00:00:00" for day in (10, 11, 12)], "S19")
    described = {"units": "m s-1", "coordinates": "XLONG XLAT"}
    arrays = {
        "U10": (*thrice(u), described),
        "V10": (*thrice(v), described),
        "Times": ("Time", letters),
    }
    arrays["XLAT"] = (*thrice(lat), {"units": "degree_north"})
    arrays["XLONG"] = (*thrice(lon), {"units": "degree_east"})
    data = xr.Dataset(arrays, attrs={"SIMULATION_START_DATE": "2018-10-09_18:00:00"})
    if stated == "angles":  # cos(u) is that of the angle from east to the axis
        data = data.assign(COSALPHA=thrice(u / 10), SINALPHA=thrice(-v / 10))
    else:
        keys = {"MAP_PROJ": 1, "TRUELAT1": 30.0, "TRUELAT2": 60.0, "STAND_LON": -110.0, "CEN_LAT": 37.0}
        data = data.assign_attrs(keys)
    found = pareto_ltl.read_wind(saved(data, tmp_path / "wrfout"))
    check(found, eastward, [seconds(f"2018-10-{day}") for day in (10, 11, 12)])
    np.testing.assert_allclose(found.leads / 3600.0, [6, 30, 54])


# --- GRIB ------------------------------------------------------------------------------------


@pytest.fixture
def eccodes():
    return pytest.importorskip("eccodes", reason="the extra `grib` is not installed")


def message(eccodes, values, sample="regular_ll_sfc_grib2", **keys):
    handle = eccodes.codes_grib_new_from_samples(sample)
    grid = {
        "dataDate": 20181009, "dataTime": 1800, "Ni": 13, "Nj": 8,
        "latitudeOfFirstGridPointInDegrees": 41.0, "latitudeOfLastGridPointInDegrees": 34.0,
        "longitudeOfFirstGridPointInDegrees": 262.0, "longitudeOfLastGridPointInDegrees": 274.0,
        "iDirectionIncrementInDegrees": 1.0, "jDirectionIncrementInDegrees": 1.0,
    }  # fmt: skip
    for key, value in (grid | keys).items():
        eccodes.codes_set(handle, key, value)
    eccodes.codes_set(handle, "bitsPerValue", 24)
    eccodes.codes_set_values(handle, np.ravel(values).astype(float))
    raw = eccodes.codes_get_message(handle)
    eccodes.codes_release(handle)
    return raw


def quantity(discipline, category, number, surface, value):
    return {
        "discipline": discipline, "parameterCategory": category, "parameterNumber": number,
        "typeOfFirstFixedSurface": surface, "scaleFactorOfFirstFixedSurface": 0,
        "scaledValueOfFirstFixedSurface": value,
    }  # fmt: skip


def north_first():
    return np.moveaxis(field(*np.meshgrid(LON, LAT[::-1])), -1, 0)


def second_reader(eccodes, path):
    """Values by parameter number, with plain ecCodes."""
    found = {}
    with path.open("rb") as stream:
        while (handle := eccodes.codes_grib_new_from_file(stream)) is not None:
            found[eccodes.codes_get(handle, "parameterNumber")] = eccodes.codes_get_values(handle)
            eccodes.codes_release(handle)
    return found


def test_speed_and_direction_in_grib_are_winds(eccodes, tmp_path):
    u, v = north_first()
    path = tmp_path / "nbm.grib2"
    speed = message(eccodes, np.hypot(u, v), **quantity(0, 2, 1, 103, 10))
    direction = message(eccodes, np.rad2deg(np.arctan2(-u, -v)) % 360, **quantity(0, 2, 0, 103, 10))
    path.write_bytes(speed + direction)
    found = pareto_ltl.read_wind(path)
    check(found, times=TIMES[:1])
    plain = second_reader(eccodes, path)
    angle = np.deg2rad(plain[0])
    np.testing.assert_allclose(found.winds[0][:, 0], -plain[1] * np.sin(angle), atol=1e-9)
    path.write_bytes(speed)
    with pytest.raises(
        DataError, match=r"has the speed 10 m above ground alone; expected speed and direction"
    ):
        pareto_ltl.read_wind(path)


@pytest.mark.parametrize("surface", [160, 1])
def test_currents_in_grib_are_currents(eccodes, tmp_path, surface):
    u, v = north_first() / 10
    path = tmp_path / "rtofs.grib2"
    path.write_bytes(
        message(eccodes, u, **quantity(10, 1, 2, surface, 0))
        + message(eccodes, v, **quantity(10, 1, 3, surface, 0))
    )
    found = pareto_ltl.read_wind(path)
    assert found.level == "0m depth"
    check(found, lambda lon, lat: field(lon, lat) / 10, TIMES[:1])
    with pytest.raises(DataError, match=r"holds no wind.*it holds a current: set wind=currents"):
        pareto_ltl.read_wind(path, source="grib")


def test_a_wind_read_as_current_names_the_source_that_reads_it(eccodes, tmp_path):
    u, v = north_first()
    path = tmp_path / "gfs"
    path.write_bytes(
        message(eccodes, u, **quantity(0, 2, 2, 103, 10)) + message(eccodes, v, **quantity(0, 2, 3, 103, 10))
    )
    with pytest.raises(DataError, match=r"holds no current.*it holds a wind: set wind=grib"):
        pareto_ltl.read_wind(path, source="currents")


def test_winds_of_a_rotated_grid_are_turned_as_proj_turns_them(eccodes, tmp_path):
    pole_lat, pole_lon = 53.0, 88.0  # of grid north; the grid is centred at 37 N, 92 W
    crs = pyproj.CRS.from_cf(
        {
            "grid_mapping_name": "rotated_latitude_longitude",
            "grid_north_pole_latitude": pole_lat,
            "grid_north_pole_longitude": pole_lon,
        }
    )
    change = pyproj.Transformer.from_crs(crs, 4326, always_xy=True)
    rlon, rlat = np.meshgrid(np.arange(-6.0, 7.0), np.arange(4.0, -4.0, -1.0))
    u, v, lon, lat = along_axes(change.transform, rlon, rlat, 1e-4)
    keys = {
        "gridType": "rotated_ll", "Ni": 13, "Nj": 8, "uvRelativeToGrid": 1,
        "latitudeOfFirstGridPointInDegrees": 4.0, "latitudeOfLastGridPointInDegrees": -3.0,
        "longitudeOfFirstGridPointInDegrees": 354.0, "longitudeOfLastGridPointInDegrees": 6.0,
        "latitudeOfSouthernPoleInDegrees": -pole_lat, "longitudeOfSouthernPoleInDegrees": pole_lon + 180.0,
    }  # fmt: skip
    path = tmp_path / "rotated"
    path.write_bytes(
        message(eccodes, u, **keys, **quantity(0, 2, 2, 103, 10))
        + message(eccodes, v, **keys, **quantity(0, 2, 3, 103, 10))
    )
    found = pareto_ltl.read_wind(path)
    check(found, eastward, TIMES[:1])
    np.testing.assert_allclose(found.points[0], np.column_stack([lon.ravel(), lat.ravel()]), atol=1e-3)


@needs_noaa
def test_a_file_of_noaa_is_the_same_wind_as_grib_and_as_cfgrib_writes_it(eccodes, tmp_path):
    cfgrib = pytest.importorskip("cfgrib")
    file = next((NOAA / "nam_awip21").glob("*.grib2"))
    keys = {"indexpath": "", "filter_by_keys": {"typeOfLevel": "heightAboveGround", "level": 10}}
    data = cfgrib.open_dataset(file, backend_kwargs=keys, decode_timedelta=True)[["u10", "v10"]]
    grib, netcdf = pareto_ltl.read_wind(file), pareto_ltl.read_wind(saved(data, tmp_path / "nam.nc"))
    np.testing.assert_array_equal(netcdf.times, grib.times)
    np.testing.assert_array_equal(netcdf.leads, grib.leads)
    np.testing.assert_allclose(netcdf.points[0], grib.points[0], atol=1e-9)
    np.testing.assert_allclose(netcdf.winds[0], grib.winds[0], atol=1e-5)
    assert np.abs(netcdf.winds[0][:, 0] - data.u10.values.ravel()).max() > 1.0  # turned


# --- tables ----------------------------------------------------------------------------------


def lines(delimiter=",", number="{:.3f}", clock="2018-10-09T{:02d}:00:00Z", speeds=field):
    rows = []
    for hour in (0, 6):
        for lat in (35, 36, 37):
            for lon in (-94, -93, -92):
                u, v = speeds(np.float64(lon), np.float64(lat))
                cells = [clock.format(hour), str(lat), str(lon), number.format(u), number.format(v)]
                rows.append(delimiter.join(cells))
    return rows


def polar(lon, lat):
    u, v = field(lon, lat)
    return np.hypot(u, v) / KNOT, np.rad2deg(np.arctan2(-u, -v)) % 360


def commas(rows):
    return [row.replace(".", ",") for row in rows]


CSV_TIMES = [seconds("2018-10-09T00:00"), seconds("2018-10-09T06:00")]
HEADER = "time,lat,lon,u,v"
TABLES = {
    "semicolons": ["time;lat;lon;u;v", *commas(lines(";"))],
    "sep": ["sep=;", "time;lat;lon;u;v", *commas(lines(";"))],
    "tabs": ["time\tlat\tlon\tu\tv", *lines("\t")],
    "comments": ["# model GFS", "// made by hand", HEADER, "# first", *lines()],
    "commented header": ["#time,lat,lon,u,v", *lines()],
    "names": ["valid_time,latitude,longitude,u10 (m/s),v10 (m/s)", *lines()],
    "mark": ["\ufeff" + HEADER, *lines()],
    "units below": [
        HEADER,
        "UTC,degrees_north,degrees_east,m s-1,m s-1",
        *lines(clock="2018-10-09T{:02d}:00"),
    ],
    "knots": ["time,lat,lon,u (knots),v_kt", *lines(speeds=lambda a, b: field(a, b) / KNOT)],
    "speed and direction": ["time,lat,lon,wind_speed_kt,wind_dir_degrees", *lines(speeds=polar)],
    "european dates": ["time;lat;lon;u;v", *lines(";", clock="09.10.2018 {:02d}:00")],
    "dates apart": ["date,time,lat,lon,u,v", *lines(clock="2018-10-09,{:02d}:00")],
}


@pytest.mark.parametrize("kind", TABLES)
def test_tables_of_spreadsheets_and_programs_are_read(tmp_path, kind):
    (tmp_path / "w.csv").write_text("\n".join(TABLES[kind]) + "\n", encoding="utf-8")
    check(pareto_ltl.read_wind(tmp_path / "w.csv"), times=CSV_TIMES)


def test_unicode_text_of_a_spreadsheet_is_read(tmp_path):
    (tmp_path / "w.csv").write_text("\n".join(TABLES["tabs"]), encoding="utf-16")
    check(pareto_ltl.read_wind(tmp_path / "w.csv"), times=CSV_TIMES)


def test_times_without_a_zone_and_speeds_without_a_unit_are_warned_of(tmp_path, caplog):
    rows = lines(clock="2018-10-09 {:02d}:00", speeds=lambda a, b: np.array(polar(a, b)) * [KNOT, 1.0])
    (tmp_path / "w.csv").write_text("\n".join(["time,lat,lon,wind_speed,wind_direction", *rows]))
    with caplog.at_level(logging.WARNING):
        check(pareto_ltl.read_wind(tmp_path / "w.csv"), times=CSV_TIMES)
    assert "18 of 18 times state no zone and are taken as UTC" in caplog.text
    assert "wind_speed states no unit and is taken as m/s" in caplog.text


def test_a_date_with_slashes_that_has_two_meanings_is_refused(tmp_path):
    (tmp_path / "w.csv").write_text("\n".join([HEADER, *lines(clock="10/09/2018 {:02d}:00")]))
    with pytest.raises(DataError, match=r"row 2: time is '10/09/2018 00:00'; expected an ISO 8601 time"):
        pareto_ltl.read_wind(tmp_path / "w.csv")


# --- stations --------------------------------------------------------------------------------

EPOCH = round(seconds("2018-10-09T17:53"))
AWC = [
    {"icaoId": f"K{k}", "obsTime": EPOCH, "reportTime": "2018-10-09T18:00:00Z", "wdir": 270, "wspd": 10,
     "lat": 35.0 + k, "lon": -93.0}
    for k in range(3)
]  # fmt: skip
NWS = {
    "type": "FeatureCollection",
    "features": [
        {"geometry": {"type": "Point", "coordinates": [-93.0, 35.0 + k]},
         "properties": {"station": f"https://api.weather.gov/stations/K{k}",
                        "timestamp": "2018-10-09T17:53:00+00:00",
                        "windDirection": {"unitCode": "wmoUnit:degree_(angle)", "value": 270},
                        "windSpeed": {"unitCode": "wmoUnit:km_h-1", "value": 18.52}}}
        for k in range(3)
    ],
}  # fmt: skip
STATIONS = {
    "awc.csv": (
        "icaoId,receiptTime,obsTime,reportTime,wdir,wspd,wgst,lat,lon\n"
        + "".join(f"K{k},x,{EPOCH},2018-10-09T18:00:00Z,270,10,,{35 + k},-93\n" for k in range(3)),
        10 * KNOT,
    ),
    "awc.json": (json.dumps(AWC), 10 * KNOT),
    "nws.geojson": (json.dumps(NWS), 18.52 / 3.6),
    "isd.csv": (
        "STATION,DATE,LATITUDE,LONGITUDE,WND\n"
        + "".join(f'7{k},2018-10-09T17:53:00,{35 + k},-93,"270,1,N,0046,1"\n' for k in range(3))
        + '79,2018-10-09T17:53:00,39,-93,"999,9,9,9999,9"\n',
        4.6,
    ),
    "lcd.csv": (
        "STATION,DATE,LATITUDE,LONGITUDE,HourlyWindDirection,HourlyWindSpeed\n"
        + "".join(f"7{k},2018-10-09T17:53:00,{35 + k},-93,270,10\n" for k in range(3)),
        4.4704,
    ),
    "latest_obs.txt": (
        "#STN LAT LON YYYY MM DD hh mm WDIR WSPD GST\n#text deg deg yr mo day hr mn degT m/s m/s\n"
        + "".join(f"4{k} {35 + k} -93 2018 10 09 17 53 270 5.0 MM\n" for k in range(3))
        + "49 39 -93 2018 10 09 17 53 MM MM MM\n",
        5.0,
    ),
    "ghcnh.psv": (
        "Station_ID|Year|Month|Day|Hour|Minute|Latitude|Longitude|wind_direction|wind_speed\n"
        + "".join(f"USW{k}|2018|10|9|17|53|{35 + k}|-93|270|5.0\n" for k in range(3)),
        5.0,
    ),
}


@pytest.mark.parametrize("name", STATIONS)
def test_reports_of_noaa_are_read(tmp_path, name):
    text, speed = STATIONS[name]
    (tmp_path / name).write_text(text)
    found = pareto_ltl.read_wind(tmp_path / name)
    np.testing.assert_allclose(found.times, [seconds("2018-10-09T18:00")])
    assert len(found.points[0]) == 3
    np.testing.assert_allclose(found.winds[0], np.broadcast_to([speed, 0.0], (3, 2)), atol=1e-9)


def test_times_of_lcd_are_warned_of_since_they_are_local(tmp_path, caplog):
    (tmp_path / "lcd.csv").write_text(STATIONS["lcd.csv"][0])
    with caplog.at_level(logging.WARNING):
        pareto_ltl.read_wind(tmp_path / "lcd.csv")
    assert "state no zone and are taken as UTC (local standard time" in caplog.text


def test_a_table_of_one_buoy_says_that_it_does_not_state_a_place(tmp_path):
    (tmp_path / "41001.txt").write_text("#YY MM DD hh mm WDIR WSPD GST\n#yr mo dy hr mn degT m/s m/s\n")
    with pytest.raises(DataError, match=r"does not state where it lies: fetch latest_obs.txt"):
        pareto_ltl.read_wind(tmp_path / "41001.txt")


# --- the shared cases ------------------------------------------------------------------------

CASES = [c for c in json.loads(SHARED.read_text()) if c["type"] == "wind"] if SHARED.is_file() else []


@pytest.mark.skipif(not CASES, reason="the cases are not beside this checkout")
@pytest.mark.parametrize("case", CASES, ids=[case["file"] for case in CASES])
def test_a_shared_case_is_read_right(case):
    found = pareto_ltl.read_wind(SHARED.parent / case["file"], source=case["source"], level=case["level"])
    np.testing.assert_allclose(found.times, [seconds(f"{time}:00") for time in case["times"]])
    gap = np.hypot(*(found.points[0] - case["at"]).T)
    nearest = int(np.argmin(gap))
    assert gap[nearest] < 0.05
    np.testing.assert_allclose(found.winds[0][nearest], case["uv"], atol=0.05)
    assert not math.isnan(found.times[0])
