"""Winds and currents from NetCDF files: how they are found, turned, cropped, and refused."""

from __future__ import annotations

import h5netcdf
import numpy as np
import pyproj
import pytest
from scipy.io import netcdf_file

from careful_io.times import seconds
from careful_io.yaml_files import read_yaml
from noaa import NOAA, needs_noaa
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.resources import CONF
from pareto_ltl.wind import sources
from pareto_ltl.wind.area import GeoBox
from pareto_ltl_apps.formats.netcdf_files import CURRENTS, WINDS, netcdf_snapshots
from pareto_ltl_apps.formats.snapshots import latest_readings

LAT, LON = np.arange(30.0, 45.0), np.arange(260.0, 277.0)
SINCE = "hours since 2018-10-09 00:00:00"
U = {"standard_name": "eastward_wind", "units": "m s-1"}
V = {"standard_name": "northward_wind", "units": "m s-1"}


def grid(hours=(0, 6)):
    """u is a tenth of the latitude plus the hour, v a tenth of the longitude."""
    u = np.array([np.broadcast_to(0.1 * LAT[:, None] + hour, (15, 17)) for hour in hours])
    v = np.array([np.broadcast_to(0.1 * (LON - 360), (15, 17)) for _ in hours])
    return u, v


def described(hours=(0, 6), u=None, v=None, **more):
    """Variables by name: dimensions, values, attributes."""
    plain_u, plain_v = grid(hours)
    found = {
        "time": (("time",), np.array(hours, float), {"units": SINCE, "standard_name": "time"}),
        "lat": (("lat",), LAT, {"units": "degrees_north"}),
        "lon": (("lon",), LON, {"units": "degrees_east"}),
        "u10": (("time", "lat", "lon"), plain_u, U),
        "v10": (("time", "lat", "lon"), plain_v, V),
    }
    if u is not None:
        found["u10"] = u
    if v is not None:
        found["v10"] = v
    return {name: entry for name, entry in (found | more).items() if entry is not None}


def write(path, variables, classic=False):
    sizes = {
        d: n for dims, values, _ in variables.values() for d, n in zip(dims, np.shape(values), strict=True)
    }
    if classic:
        with netcdf_file(path, "w") as file:
            for name, size in sizes.items():
                file.createDimension(name, size)
            for name, (dims, values, attributes) in variables.items():
                made = file.createVariable(name, np.asarray(values).dtype.newbyteorder("="), dims)
                made[...] = values
                for key, value in attributes.items():
                    setattr(made, key, value)
        return path
    with h5netcdf.File(path, "w") as file:
        file.dimensions = sizes
        for name, (dims, values, attributes) in variables.items():
            file.create_variable(name, dims, data=values).attrs.update(attributes)
    return path


def read(path, level="10m", quantity=WINDS, max_speed=75.0, area=None):
    return latest_readings(*netcdf_snapshots((path,), quantity, level, max_speed, area))


def check_plain(found):
    np.testing.assert_array_equal(found.times, [seconds("2018-10-09") + h * 3600 for h in (0, 6)])
    for winds, points, hour in zip(found.winds, found.points, (0, 6), strict=True):
        assert points[:, 0].min() >= -100
        np.testing.assert_allclose(winds[:, 0], 0.1 * points[:, 1] + hour, atol=1e-3)
        np.testing.assert_allclose(winds[:, 1], 0.1 * points[:, 0], atol=1e-3)


@pytest.mark.parametrize("classic", [False, True])
def test_a_field_is_read_from_both_formats_of_netcdf(tmp_path, classic):
    found = read(write(tmp_path / "a.nc", described(), classic))
    check_plain(found)
    assert len(found.points[0]) == 15 * 17
    assert np.isnan(found.leads).all()


@pytest.mark.parametrize("dims", [("lat", "time", "lon"), ("lon", "lat", "time")])
def test_dimensions_may_have_any_order(tmp_path, dims):
    usual = ("time", "lat", "lon")
    turned = [
        (dims, values.transpose([usual.index(d) for d in dims]), attributes)
        for values, attributes in zip(grid(), (U, V), strict=True)
    ]
    check_plain(read(write(tmp_path / "a.nc", described(u=turned[0], v=turned[1]))))


@pytest.mark.parametrize(
    ("names", "attributes"),
    [
        (("u10", "v10"), ({}, {})),
        (("UGRD_10maboveground", "VGRD_10maboveground"), ({}, {})),
        (
            ("a", "b"),
            ({"long_name": "10 metre U wind component"}, {"long_name": "10 metre V wind component"}),
        ),
        (("uwnd", "vwnd"), ({"long_name": "zonal wind"}, {"long_name": "meridional wind"})),
    ],
)
def test_components_are_found_by_long_name_and_by_name(tmp_path, names, attributes):
    plain = described()
    for old, new, words in zip(("u10", "v10"), names, attributes, strict=True):
        dims, values, _ = plain.pop(old)
        plain[new] = (dims, values, {"units": "m/s", **words})
    plain["gust"] = (("time", "lat", "lon"), grid()[0] + 50, {"long_name": "u wind gust", "units": "m/s"})
    check_plain(read(write(tmp_path / "a.nc", plain)))


@pytest.mark.parametrize(("units", "factor"), [("knots", 3600 / 1852), ("cm/s", 100.0), ("km h-1", 3.6)])
def test_speeds_become_metres_a_second(tmp_path, units, factor):
    u, v = ((("time", "lat", "lon"), a * factor, told | {"units": units})
            for a, told in zip(grid(), (U, V), strict=True))  # fmt: skip
    check_plain(read(write(tmp_path / "a.nc", described(u=u, v=v))))


@pytest.mark.parametrize("classic", [False, True])
def test_packed_values_are_unpacked_and_missing_ones_left_out(tmp_path, classic):
    packed = {"scale_factor": 0.001, "add_offset": 5.0, "_FillValue": np.int16(-30000)}
    made = []
    for values, told in zip(grid(), (U, V), strict=True):
        numbers = np.round((values - 5.0) / 0.001).astype(np.int16)
        numbers[:, 3, 4] = -30000
        made.append((("time", "lat", "lon"), numbers, told | packed))
    found = read(write(tmp_path / "a.nc", described(u=made[0], v=made[1]), classic))
    check_plain(found)
    assert len(found.points[0]) == 15 * 17 - 1
    assert "2 of 510 values at 10m are missing in the file and left out" in found.notes


@pytest.mark.parametrize(
    "limits",
    [
        {"valid_range": np.array([-6000, 20_000], np.int16)},
        {"valid_min": np.int16(-6000), "valid_max": np.int16(20_000)},
    ],
)
def test_packed_values_outside_the_valid_range_are_left_out(tmp_path, limits):
    u = np.round(grid()[0] / 0.001).astype(np.int16)
    u[:, 0, :3], u[:, 1, 0], u[:, 1, 1] = 20_001, -6001, 20_000
    v = (("time", "lat", "lon"), grid()[1], V)
    packed = (("time", "lat", "lon"), u, U | limits | {"scale_factor": 0.001, "add_offset": 0.0})
    found = read(write(tmp_path / "a.nc", described(u=packed, v=v)))
    assert len(found.points[0]) == 15 * 17 - 4
    assert found.winds[0][:, 0].max() == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("units", "values"),
    [
        ("h since 2018-10-09", (0, 6)),
        ("Hour since 2018-10-09T00:00:00Z", (0, 6)),
        ("min since 2018-10-09 0:0:0.0", (0, 360)),
        ("seconds since 2018-10-09 02:00:00 +02:00", (0, 21_600)),
        ("days since 1-1-1", (736_975, 736_975.25)),
    ],
)
def test_times_are_read_in_all_usual_units(tmp_path, units, values):
    clock = {"units": units, "calendar": "proleptic_gregorian"}
    check_plain(read(write(tmp_path / "a.nc", described(time=(("time",), np.array(values, float), clock)))))


@pytest.mark.parametrize(
    "extra",
    [
        {"reftime": ((), np.array(-3.0), {"units": SINCE, "standard_name": "forecast_reference_time"})},
        {"reftime": (("time",), np.array([-3.0, 3.0]), {"units": SINCE})},
        {
            "step": (
                ("time",),
                np.array([180.0, 180.0]),
                {"units": "minutes", "standard_name": "forecast_period"},
            )
        },
    ],
)
def test_a_reference_time_gives_the_lead(tmp_path, extra):
    found = read(write(tmp_path / "a.nc", described(**extra)))
    assert found.leads[0] == 3 * 3600
    assert found.remarks[0] == "3 h forecast"
    assert found.notes == ()


def test_times_may_be_unsorted_and_two_of_the_same_lead_are_refused(tmp_path):
    u, v = grid()
    dims = ("time", "lat", "lon")
    clock = {"units": SINCE}
    turned = {"u": (dims, u[::-1], U), "v": (dims, v[::-1], V)}
    check_plain(
        read(write(tmp_path / "a.nc", described(**turned, time=(("time",), np.array([6.0, 0.0]), clock))))
    )
    doubled = described(**turned, time=(("time",), np.array([6.0, 6.0]), clock))
    with pytest.raises(DataError, match=r"b.nc both? hold.*2018-10-09T06:00:00Z with the same lead"):
        read(write(tmp_path / "b.nc", doubled))


@pytest.mark.parametrize(
    ("units", "calendar", "words"),
    [
        (
            "furlongs since 2018-10-09",
            "standard",
            "time units 'furlongs since 2018-10-09' in the calendar 'standard' are not",
        ),
        (SINCE, "360_day", "in the calendar '360_day' are not known; expected .* in the standard calendar"),
        (
            "days since 0001-01-01",
            "standard",
            "'days since 0001-01-01' .* are not known; expected .* from 1582 on",
        ),
        ("days since 9999-01-01", "standard", "has an invalid time"),
    ],
)
def test_a_clock_that_cannot_be_read_is_refused(tmp_path, units, calendar, words):
    clock = (("time",), np.array([0.0, 6.0]), {"units": units, "calendar": calendar})
    with pytest.raises(DataError, match=words):
        read(write(tmp_path / "a.nc", described(time=clock)))


def layered(units, values, positive="up", **more):
    """Wind on several levels: u is the number of the level."""
    u = np.broadcast_to(np.arange(len(values))[None, :, None, None], (2, len(values), 15, 17)).astype(float)
    dims = ("time", "z", "lat", "lon")
    z = (("z",), np.array(values, float), {"units": units, "positive": positive})
    return described(u=(dims, u, U), v=(dims, 0 * u, V), z=z, **more)


def test_the_level_is_picked_and_those_there_are_are_listed(tmp_path):
    path = write(tmp_path / "a.nc", layered("m", [10, 80, 100]))
    for number, level in enumerate(("10m", "80m", "100 m")):
        found = read(path, level)
        np.testing.assert_array_equal(found.winds[0][:, 0], number)
        assert found.level == level.replace(" ", "")
    with pytest.raises(DataError, match=r"no wind 50 m above ground; it has 10m, 80m, 100m: set wind.level"):
        read(path, "50m")
    with pytest.raises(DataError, match=r"no wind at 925 hPa; it has 10m, 80m, 100m"):
        read(path, "925hPa")
    with pytest.raises(ConfigError, match="is not a level"):
        read(path, "high")


def test_pressures_may_be_in_any_unit_and_nodes_below_ground_are_left_out(tmp_path):
    surface = np.full((2, 15, 17), 101_000.0)
    surface[:, :4] = 90_000.0
    pressure = (("time", "lat", "lon"), surface, {"standard_name": "surface_air_pressure", "units": "Pa"})
    for units, values in (("Pa", [85_000, 92_500]), ("hPa", [850, 925]), ("millibar", [850, 925])):
        path = write(tmp_path / f"{units}.nc", layered(units, values, "down", sp=pressure))
        found = read(path, "925hPa")
        np.testing.assert_array_equal(found.winds[0][:, 0], 1.0)
        assert found.points[0][:, 1].min() == 34.0
        assert any(note.startswith("136 of 510 values at 925hPa lie below ground") for note in found.notes)


def test_members_are_snapshots_and_other_dimensions_are_refused(tmp_path):
    u = np.stack(grid(), axis=1)
    dims = ("time", "ens", "lat", "lon")
    path = write(tmp_path / "a.nc", described(u=(dims, u, U), v=(dims, u, V)))
    snapshots = netcdf_snapshots((path,), WINDS, "10m", 75.0).winds
    assert [(snap.member, snap.time) for snap in snapshots[:2]] == [
        ("00", snapshots[0].time),
        ("01", snapshots[0].time),
    ]
    np.testing.assert_allclose(snapshots[1].winds[:, 0], 0.1 * snapshots[1].points[:, 0])
    dims = ("time", "colour", "lat", "lon")
    path = write(tmp_path / "b.nc", described(u=(dims, u, U), v=(dims, u, V)))
    with pytest.raises(DataError, match="has 2 values along colour, which is not a time, level, member"):
        read(path)


# --- grids


def lambert():
    """A Lambert grid of 20 km over Kansas: its plane, x and y."""
    crs = pyproj.CRS("+proj=lcc +lat_1=25 +lat_2=25 +lat_0=25 +lon_0=-95 +R=6371229 +units=m +no_defs")
    return crs, np.arange(-1e6, -4e5, 2e4), np.arange(1.2e6, 1.6e6, 2e4)


def along_the_grid(latitudes):
    """Wind of 10 m/s along x of the grid, as a CF file, with 2-d latitudes or with x and y alone."""
    crs, x, y = lambert()
    lon, lat = pyproj.Proj(crs)(*np.meshgrid(x, y), inverse=True)
    u = np.full((1, len(y), len(x)), 10.0)
    told = {"units": "m s-1", "grid_mapping": "plane"}
    mapping = {k: v for k, v in crs.to_cf().items() if k != "crs_wkt" and v is not None}
    found = {
        "time": (("time",), np.zeros(1), {"units": SINCE}),
        "u": (("time", "y", "x"), u, told | {"standard_name": "x_wind"}),
        "v": (("time", "y", "x"), 0 * u, told | {"standard_name": "y_wind"}),
        "plane": ((), np.array(0), mapping),
    }
    if latitudes:
        found["xlat"] = (("y", "x"), lat, {"units": "degrees_north"})
        found["xlon"] = (("y", "x"), lon, {"units": "degrees_east"})
        for name in "uv":
            found[name][2]["coordinates"] = "xlat xlon"
    else:
        found["x"] = (("x",), x / 1000, {"units": "km", "standard_name": "projection_x_coordinate"})
        found["y"] = (("y",), y, {"units": "m", "standard_name": "projection_y_coordinate"})
    return found, lon, lat


def test_all_faults_of_a_file_and_of_its_neighbours_stand_in_one_message(tmp_path):
    u, v = grid()
    dims = ("time", "lat", "lon")
    wrong = described(u=(dims, u, U | {"units": "K"}), v=(dims, v, V | {"units": "Pa"}))
    time = wrong["time"]
    wrong["time"] = (*time[:2], {"units": "hours since yesterday"})
    one, two = write(tmp_path / "a.nc", wrong), write(tmp_path / "b.nc", described(u10=None, v10=None))
    with pytest.raises(DataError) as caught:
        netcdf_snapshots((one, two), WINDS, "10m", 75.0)
    text = str(caught.value)
    assert "the set of 2 wind files has 4 faults: (1)" in text
    for words in ("time", "u10 is in 'K'", "v10 is in 'Pa'", "b.nc holds no wind"):
        assert words in text


@pytest.mark.parametrize("latitudes", [True, False])
def test_winds_along_a_grid_are_turned_to_east_and_north(tmp_path, latitudes):
    """The rows of the grid themselves show where its x axis points."""
    variables, lon, lat = along_the_grid(latitudes)
    found = read(write(tmp_path / "a.nc", variables))
    np.testing.assert_allclose(found.points[0], np.stack([lon, lat], -1).reshape(-1, 2), atol=1e-6)
    east = np.diff(lon, axis=1) * np.cos(np.deg2rad(lat[:, 1:] + lat[:, :-1]) / 2)
    angle = np.arctan2(np.diff(lat, axis=1), east)
    ours = found.winds[0].reshape(*lat.shape, 2)[:, :-1]
    np.testing.assert_allclose(np.arctan2(ours[..., 1], ours[..., 0]), angle, atol=2e-3)
    np.testing.assert_allclose(np.hypot(*found.winds[0].T), 10.0)
    assert np.abs(angle).max() > 0.03


def test_winds_along_a_grid_of_unknown_direction_are_refused(tmp_path):
    variables, _, _ = along_the_grid(True)
    del variables["plane"]
    with pytest.raises(DataError, match=r"u follows the axes of a grid whose directions the file does"):
        read(write(tmp_path / "a.nc", variables))


@pytest.mark.parametrize("latitudes", [True, False])
@pytest.mark.parametrize("plain", [True, False])
def test_only_the_nodes_of_an_area_are_read(tmp_path, plain, latitudes):
    path = write(tmp_path / "a.nc", described() if plain else along_the_grid(latitudes)[0])
    area = GeoBox(-98.0, 36.5, 3.0, 38.5) if plain else GeoBox(-103.5, 36.5, 2.0, 37.5)
    whole, part = read(path), read(path, area=area)
    inside = area.contains(whole.points[0])
    assert 4 < inside.sum() < len(inside) / 2
    np.testing.assert_array_equal(part.points[0], whole.points[0][inside])
    np.testing.assert_array_equal(part.winds[0], whole.winds[0][inside])
    with pytest.raises(DataError, match=r"a.nc covers latitude .*; the scene needs latitude 0..1, long"):
        read(path, area=GeoBox(0.0, 0.0, 1.0, 1.0))


def test_an_area_across_the_seam_of_the_grid_is_read(tmp_path):
    lon = np.arange(0.0, 360.0, 5.0)
    u = np.broadcast_to(lon, (1, 15, 72)) / 10
    dims = ("time", "lat", "lon")
    seam = described((0,), u=(dims, u, U), v=(dims, u, V), lon=(("lon",), lon, {"units": "degrees_east"}))
    found = read(write(tmp_path / "a.nc", seam), area=GeoBox(-10.0, 33.0, 20.0, 35.0))
    assert sorted(set(found.points[0][:, 0])) == [-10.0, -5.0, 0.0, 5.0, 10.0]
    np.testing.assert_allclose(found.winds[0][:, 0], found.points[0][:, 0] % 360 / 10)


# --- currents


def ocean(units="m/s", depths=(0.494, 47.37, 200.0)):
    values = np.broadcast_to(
        np.arange(len(depths))[None, :, None, None] * 0.5, (2, len(depths), 15, 17)
    ).copy()
    values[:, :, :5] = np.nan
    dims = ("time", "depth", "lat", "lon")
    told = {"units": units}
    depth = (("depth",), np.array(depths), {"units": "m", "positive": "down", "standard_name": "depth"})
    return described(u10=None, v10=None, uo=(dims, values, told), vo=(dims, -values, told), depth=depth)


def test_currents_are_read_at_the_nearest_depth(tmp_path):
    path = write(tmp_path / "sea.nc", ocean())
    surface = read(path, "0m", CURRENTS, 5.0)
    np.testing.assert_array_equal(surface.winds[0], 0.0)
    assert len(surface.points[0]) == 10 * 17
    assert surface.level == "0.494m depth"
    assert surface.notes[0] == "the level 0.494m depth is used for 0m depth"
    np.testing.assert_array_equal(read(path, "50m depth", CURRENTS, 5.0).winds[0], [[0.5, -0.5]] * 170)
    with pytest.raises(DataError, match=r"no current 100 m below the surface; it has 0.494m depth, 47"):
        read(path, "100m", CURRENTS, 5.0)
    with pytest.raises(DataError, match=r"is a pressure; currents are at depths such as wind.level=0m"):
        read(path, "925hPa", CURRENTS, 5.0)


def test_currents_read_as_winds_and_winds_as_currents_name_the_choice(tmp_path):
    with pytest.raises(DataError, match=r"holds no wind; .*; it holds a current: set wind=currents"):
        read(write(tmp_path / "sea.nc", ocean()))
    with pytest.raises(DataError, match=r"holds no current; .*; it holds a wind: set wind=netcdf"):
        read(write(tmp_path / "air.nc", described()), "0m", CURRENTS)


def test_the_white_part_of_a_current_may_be_smaller_than_that_of_a_wind():
    choice = read_yaml(CONF.file("wind", "currents"))
    assert WindConfig(path="sea.nc", **choice).noise_min == 0.05 < WindConfig().noise_min


def test_currents_of_the_choice_in_conf_are_checked_against_5_m_a_second(tmp_path):
    path = write(tmp_path / "sea.nc", ocean(units="km/h"))
    cfg = WindConfig(source="currents", path=str(path), level="200m", max_speed=5.0)
    assert sources.read_readings(cfg).winds[0].max() == pytest.approx(1.0 / 3.6)
    assert sources.wind_source(cfg).forecast_error == "currents"
    strong = WindConfig(source="currents", path=str(path), level="200m", max_speed=0.1)
    with pytest.raises(DataError, match=r"is not plausible"):
        sources.read_readings(strong)


# --- what users get wrong

DIMS = ("time", "lat", "lon")
NAMELESS = {"standard_name": "eastward_wind"}
WRONG = {
    "missing v": (described(v10=None), "has u10 but no other component; expected u and v"),
    "missing u": (described(u10=None), "has v10 but no other component; expected u and v"),
    "no wind": (described(u10=None, v10=None), "holds no wind; expected variables with the standard names"),
    "no units": (described(u=(DIMS, grid()[0], NAMELESS)), "u10 has no units; expected"),
    "units": (described(u=(DIMS, grid()[0], U | {"units": "ell"})), "u10 is in 'ell'; expected m s-1"),
    "speed": (described(u=(DIMS, grid()[0] * 40, U)), "wind speed .* m/s is not plausible"),
    "no time": (described((0,), time=None), "u10 has no time; expected a coordinate with units such as"),
    "no place": (described(lat=None), "u10 has no latitudes and longitudes"),
    "latitude": (described(lat=(("lat",), LAT * 3, {"units": "degrees_north"})), "latitude is beyond 90"),
    "texts": (described(u=(DIMS, np.full((2, 15, 17), b"x"), U)), r"cannot be read \(u10 holds"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_refused_in_one_line_that_names_it(case, tmp_path):
    variables, words = WRONG[case]
    with pytest.raises(DataError, match=words) as caught:
        read(write(tmp_path / "a.nc", variables))
    assert "a.nc" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("classic", [False, True])
@pytest.mark.parametrize("kept", [0, 3, 40, 1000, -200])
def test_a_file_that_is_cut_off_is_refused(tmp_path, kept, classic):
    path = write(tmp_path / "a.nc", described(), classic)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(
        DataError, match=r"a.nc (is damaged or cannot be read|is empty|is not NetCDF|holds no wind|has )"
    ):
        read(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"GRIB" + bytes(99), "is GRIB, not NetCDF; read it with wind.source=grib"),
        (b"<html>404", "is a web page, not NetCDF; a failed download"),
        (b"time,lat,lon,u,v\n", "is not NetCDF; expected NetCDF-4 or the classic format"),
    ],
)
def test_another_format_given_as_netcdf_is_named_with_the_cure(tmp_path, content, words):
    (tmp_path / "a.nc").write_bytes(content)
    with pytest.raises(DataError, match=words):
        read(tmp_path / "a.nc")


def test_a_file_that_claims_more_than_it_holds_is_not_read(tmp_path):
    path = tmp_path / "a.nc"
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"time": 1, "lat": 9000, "lon": 9000}
        file.create_variable("time", ("time",), data=np.zeros(1)).attrs.update(units=SINCE)
        for name, unit in (("lat", "degrees_north"), ("lon", "degrees_east")):
            file.create_variable(name, (name,), data=np.linspace(0, 80, 9000)).attrs.update(units=unit)
        for name, told in (("u10", U), ("v10", V)):
            made = file.create_variable(name, DIMS, "f4", chunks=(1, 900, 900), compression="gzip")
            made.attrs.update(told)
    with pytest.raises(DataError, match="claims far more values than a file of its size can hold"):
        read(path)


@needs_noaa
def test_a_file_of_a_thredds_server_is_read_at_its_levels():
    path = NOAA / "gfs_netcdf" / "GFS_test.nc"
    found = read(path)
    assert found.first_time == "2010-10-26T12:00:00Z"
    assert len(found.points[0]) == 46 * 101
    with h5netcdf.File(path) as file:
        u = file["u-component_of_wind_height_above_ground"][0, 0].reshape(-1)
        high = file["v-component_of_wind_isobaric"][0, list(file["isobaric3"][:]).index(85_000)].reshape(-1)
    np.testing.assert_allclose(found.winds[0][:, 0], u)
    np.testing.assert_allclose(read(path, "850hPa").winds[0][:, 1], high)
    with pytest.raises(DataError, match=r"holds no wind 80 m above ground; it has 10m, 10hPa"):
        read(path, "80m")
