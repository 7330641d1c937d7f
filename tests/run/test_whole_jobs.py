"""Whole jobs from files as their publishers write them: to a verified plan, with the right wind and zones.

Each test writes its files, plans from them on the command line, and verifies the result. Winds are compared
in ``plan.json``: what a step moves beyond the airspeed is the wind that the file was written from.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely
import xarray as xr

from careful_io.reading import read_json
from map_files import KML, archive, collection, feature, folder, kml_polygon, written
from map_samples import box
from pareto_ltl import Run
from pareto_ltl_apps.cli import hydra_app as app
from pareto_ltl_apps.cli.commands import run_command_line
from quick_wind import wind_words
from wind_laws.documents import LAWS_FOLDER

START = "2026-10-09T00:00:00"
HOURS = np.arange(0, 49, 6)
CLOSE = 0.4  # [m/s] by which the fit may differ from the field; components along a grid differ by 2 m/s
SMALL = (
    "planner.trees=2", "planner.n_max=800", "planner.threads=1", "smoothing.candidates=1",
    "smoothing.weights=[1.0]", "refine.flights=20", "refine.sweep_flights=10", "refine.classes=1",
    "refine.points=2", "selection.draws=20", "selection.runs=20", "deployment.runs=50", "report=none",
)  # fmt: skip
Field = Callable[[Any, Any], np.ndarray]


def wind_of(lon: Any, lat: Any) -> np.ndarray:
    """East and north [m/s]; it differs from place to place, and no two of its values are alike."""
    return np.stack([8 + 0.3 * (lat - 37), -5 + 0.2 * (lon + 92)], axis=-1)


def current_of(lon: Any, lat: Any) -> np.ndarray:
    """East and north [m/s]."""
    return np.stack([0.12 + 0.02 * (lat - 27), -0.08 + 0.01 * (lon + 86)], axis=-1)


def job(here: Path, *words: str, code: int = 0) -> Path:
    """The results directory of a plan with ``words``, which is verified."""
    place = here / "out"
    assert app.run_hydra([*SMALL, f"hydra.run.dir={place}", *words]) == code
    assert run_command_line(["verify", str(place)]) == 0
    return place


def drift(place: Path) -> tuple[np.ndarray, np.ndarray]:
    """Longitudes and latitudes (T, 2) at the middle of the steps of a plan, and the winds (T, 2) [m/s] there.

    The planes of these maps are turned by less than half a degree against true north.
    """
    plan = json.loads((place / "plan.json").read_text())
    x, u = np.array(plan["x"]), np.array(plan["u"])
    lonlat = Run.open(place).scene.frame.to_geographic((x[1:] + x[:-1]) / 2)
    return np.stack(lonlat, axis=-1), np.diff(x, axis=0) / plan["dt"] - u


def assert_drift(place: Path, expected: Field, tolerance: float = CLOSE) -> None:
    """The plan counts with the wind ``expected`` at each of its steps."""
    lonlat, winds = drift(place)
    np.testing.assert_allclose(winds, expected(*lonlat.T), atol=tolerance)


def map_file(path: Path, lon: float, lat: float, size: float, *more: Any) -> Path:
    """A map about a place [deg]: from its south-west to region a in its north-east, ``size`` apart."""
    start = feature("start", "Point", [lon - size / 2, lat - size / 2])
    east, north = lon + size / 2, lat + size / 2
    goal = box(east - size / 8, north - size / 8, east + size / 8, north + size / 8)
    return written(path, collection(start, feature("region", "Polygon", [goal], name="a"), *more))


def land(here: Path) -> list[str]:
    """The words of a mission on a map about 37 N, 92 W."""
    path = map_file(here / "map.geojson", -92.0, 37.0, 0.8)
    return [f"scene.file={path}", "mission.formula=F a", f"mission.start_time={START}Z", *wind_words()]


def sea(here: Path) -> list[str]:
    """The words of a mission of a slow robot on a map about 27 N, 86 W."""
    path = map_file(here / "map.geojson", -86.0, 27.0, 0.1)
    return [
        f"scene.file={path}", "mission.formula=F a", f"mission.start_time={START}Z", "robot.u_max=0.6",
        "robot.level=0m depth", *wind_words(),
    ]  # fmt: skip


# --- winds and currents in NetCDF ------------------------------------------------------------


def on_grid(field: Field, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    """The components (2, NLAT, NLON)."""
    return np.moveaxis(field(*np.meshgrid(lon, lat)), -1, 0)


def era5(path: Path) -> Path:
    """A download of the Climate Data Store (since 2024): no standard names, expver, north first."""
    lon, lat = np.arange(-96.0, -88.0, 0.25), np.arange(40.0, 34.0, -0.25)
    since = np.datetime64(START) + HOURS * np.timedelta64(1, "h")
    shape = (len(HOURS), len(lat), len(lon))
    arrays = {
        f"{letter.lower()}10": (
            ("valid_time", "latitude", "longitude"), np.broadcast_to(values, shape).astype("f4"),
            {
                "units": "m s**-1", "standard_name": "unknown", "GRIB_shortName": f"10{letter.lower()}",
                "long_name": f"10 metre {letter} wind component", "GRIB_gridType": "regular_ll",
                "GRIB_uvRelativeToGrid": np.int64(0),
            },
        )
        for letter, values in zip("UV", on_grid(wind_of, lon, lat), strict=True)
    }  # fmt: skip
    seconds = since.astype("datetime64[s]").astype("i8")
    clock = {"units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian", "standard_name": "time"}
    data = xr.Dataset(
        arrays,
        {
            "valid_time": ("valid_time", seconds, clock | {"long_name": "time"}),
            "latitude": ("latitude", lat, {"units": "degrees_north", "standard_name": "latitude"}),
            "longitude": ("longitude", lon, {"units": "degrees_east", "standard_name": "longitude"}),
            "number": ((), 0, {"units": "1", "standard_name": "realization"}),
            "expver": ("valid_time", np.array(["0001"] * 5 + ["0005"] * 4, object)),
        },
        {"Conventions": "CF-1.7", "institution": "European Centre for Medium-Range Weather Forecasts"},
    )
    data.to_netcdf(path, engine="h5netcdf")
    return path


def hycom(path: Path) -> Path:
    """A subset of HYCOM: packed, depths, longitudes to 360, tau beside the time, land without values."""
    lon, lat, depth = np.arange(272.0, 276.0, 0.08), np.arange(25.0, 29.0, 0.04), np.array([0.0, 2, 50])
    hours = (np.datetime64(START) - np.datetime64("2000-01-01")) / np.timedelta64(1, "h") + HOURS
    dims, shape = ("time", "depth", "lat", "lon"), (len(hours), 1, len(lat), len(lon))
    weaker = np.array([1.0, 0.9, 0.2])[None, :, None, None]
    arrays = {}
    for letter, values, way in zip(
        "uv", on_grid(current_of, lon - 360.0, lat), ("east", "north"), strict=True
    ):
        packed = np.round(np.broadcast_to(values, shape) * weaker / 0.001).astype("i2")
        packed[..., -5:, :5] = -30000  # an island
        arrays[f"water_{letter}"] = (
            dims, packed,
            {
                "units": "m/s", "standard_name": f"{way}ward_sea_water_velocity",
                "long_name": f"{way.title()}ward Water Velocity", "scale_factor": np.float32(0.001),
                "add_offset": np.float32(0.0), "_FillValue": np.int16(-30000),
                "missing_value": np.int16(-30000), "NAVO_code": 17,
            },
        )  # fmt: skip
    arrays["tau"] = ("time", HOURS.astype(float), {"units": "hours since analysis", "long_name": "Tau"})
    clock = {"units": "hours since 2000-01-01 00:00:00", "calendar": "gregorian", "long_name": "Valid Time"}
    data = xr.Dataset(
        arrays,
        {
            "time": ("time", hours, clock | {"time_origin": "2000-01-01 00:00:00"}),
            "depth": ("depth", depth, {"units": "m", "standard_name": "depth", "positive": "down"}),
            "lat": ("lat", lat, {"units": "degrees_north", "standard_name": "latitude"}),
            "lon": (
                "lon",
                lon,
                {"units": "degrees_east", "standard_name": "longitude", "modulo": "360 degrees"},
            ),
        },
        {"classification_level": "UNCLASSIFIED", "institution": "Fleet Numerical Meteorology"},
    )
    data.to_netcdf(path, engine="h5netcdf")
    return path


def turned(field: Field, lon: np.ndarray, lat: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Components (2, ...) along axes that are turned by ``angle`` [rad] to the left of east and north."""
    u, v = np.moveaxis(field(lon, lat), -1, 0)
    return np.stack([u * np.cos(angle) + v * np.sin(angle), -u * np.sin(angle) + v * np.cos(angle)])


def wrfout(path: Path) -> Path:
    """As WRF writes it: characters as times, places at each time, components along a Lambert grid."""
    plane = pyproj.Proj("+proj=lcc +lat_1=30 +lat_2=60 +lat_0=37 +lon_0=-110 +R=6370000 +units=m")
    x0, y0 = plane(-92.0, 37.0)
    x, y = np.meshgrid(x0 + np.arange(-3e5, 3.1e5, 3e4), y0 + np.arange(-3e5, 3.1e5, 3e4))
    lon, lat = plane(x, y, inverse=True)
    north_lon, north_lat = plane(x, y + 10.0, inverse=True)
    angle = np.arctan2(-(north_lon - lon) * np.cos(np.deg2rad(lat)), north_lat - lat)
    u, v = turned(wind_of, lon, lat, angle)
    dims = ("Time", "south_north", "west_east")

    def at_all(values: np.ndarray, **described: str) -> Any:
        return dims, np.stack([values] * len(HOURS)).astype("f4"), described

    times = np.datetime64(START) + HOURS * np.timedelta64(1, "h")
    names = np.array([str(time).replace("T", "_") for time in times], "S19")
    data = xr.Dataset(
        {
            "Times": ("Time", names),
            "U10": at_all(u, units="m s-1", description="U at 10 M", coordinates="XLONG XLAT XTIME"),
            "V10": at_all(v, units="m s-1", description="V at 10 M", coordinates="XLONG XLAT XTIME"),
            "COSALPHA": at_all(np.cos(angle), description="Local cosine of map rotation"),
            "SINALPHA": at_all(np.sin(angle), description="Local sine of map rotation"),
            "XLAT": at_all(lat, units="degree_north", description="LATITUDE, SOUTH IS NEGATIVE"),
            "XLONG": at_all(lon, units="degree_east", description="LONGITUDE, WEST IS NEGATIVE"),
        },
        attrs={
            "TITLE": " OUTPUT FROM WRF V4.5 MODEL", "SIMULATION_START_DATE": START.replace("T", "_"),
            "MAP_PROJ": 1, "TRUELAT1": 30.0, "TRUELAT2": 60.0, "STAND_LON": -110.0, "CEN_LAT": 37.0,
        },
    )  # fmt: skip
    data.to_netcdf(path, engine="h5netcdf")
    return path


@pytest.mark.parametrize(("name", "make"), [("era5.nc", era5), ("wrfout_d01", wrfout)])
def test_a_wind_in_netcdf_is_flown(tmp_path: Path, name: str, make: Callable[[Path], Path]) -> None:
    place = job(tmp_path, *land(tmp_path), f"wind={make(tmp_path / name)}")
    assert_drift(place, wind_of)


def test_the_current_of_hycom_is_sailed(tmp_path: Path) -> None:
    exact = "wind.forecast_error=none"  # errors move the mean, too
    place = job(tmp_path, *sea(tmp_path), f"wind={hycom(tmp_path / 'hycom.nc')}", exact)
    assert_drift(place, current_of, 0.02)


def test_the_box_without_a_border_holds_the_flights_of_an_uncertain_wind(tmp_path: Path) -> None:
    """Errors four times as large: flights fail, and none because it left a map without a border."""
    law = read_json(LAWS_FOLDER / "gfs.json")
    law["forecast"]["sd"] = [4 * sd for sd in law["forecast"]["sd"]]
    wide = written(tmp_path / "wide.json", law)
    words = [*land(tmp_path), f"wind={era5(tmp_path / 'era5.nc')}", "robot.u_max=40", "deployment.runs=200"]
    place = job(tmp_path, *words, f"wind.forecast_error={wide}", "planner.epsilon=0.9")
    usual = tmp_path / "usual"
    app.run_hydra([*words, f"hydra.run.dir={usual}", "pipelines.stages=[readings,scene]"])
    low, high = (np.ptp(Run.open(where).scene.bounds, axis=0) for where in (usual, place))
    assert (high > low + 10e3).all()
    results = Run.open(place)
    assert not results.scene.walled
    flown = results.deployments["coherent"]
    assert flown.failed.any()
    assert not flown.off_map.any()
    assert (place / "run.log").read_text().count("the sky is open") == 1


def test_a_pilot_is_warned_of_all_that_a_table_leaves_open(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table without zones and leads, of nearly equal winds, that ends inside the map; a flight above it."""
    lon, lat = np.meshgrid(np.arange(-94.0, -91.9, 0.3), np.arange(35.5, 38.6, 0.3))
    rows = ["time,lat,lon,u_kt,v_kt"]
    for hours in (0, 6, 12):
        places = zip(lon.ravel(), lat.ravel(), strict=True)
        rows += [f"2026-10-09T{hours:02}:00:00,{y:.2f},{x:.2f},{10 + 0.1 * x:.3f},2" for x, y in places]
    table = written(tmp_path / "w.csv", "\n".join(rows) + "\n")
    words = [word for word in land(tmp_path) if not word.startswith("mission.start_time")]
    place = job(
        tmp_path, *words, f"wind={table}", "wind.level=10m", "robot.level=100m",
        f"mission.start_time={START}",
    )  # fmt: skip
    log = (place / "run.log").read_text()
    gap = "the robot flies 100 m above ground, and the wind used is 10 m above ground"
    for warning in (
        f"mission.start_time={START} states no zone and is taken as UTC; write {START}Z",
        "w.csv: 231 of 231 times state no zone and are taken as UTC",
        "w.csv: the readings end inside the map, which reaches up to ",
        "w.csv does not state how old its forecast is: it is assumed to have begun 4 h before its first time",
        "the law of forecast errors gfs was estimated from winds that vary by 3.2 m/s",
        f"{gap}: winds at other heights differ",
    ):
        assert sum(warning in line and " WARNING " in line for line in log.splitlines()) == 1, warning
    told = " ".join(capsys.readouterr().out.split())
    assert f"No promise: {gap}; the rates count flights in the wind used." in told
    assert "in winds of another level than the robot's (no promise)" in told
    assert f"The failure rates are no promise: {gap}." in (place / "plan.gpx").read_text()


# --- GRIB --------------------------------------------------------------------------------------


@pytest.fixture
def eccodes() -> Any:
    return pytest.importorskip("eccodes", reason="the extra `grib` is not installed")


def message(eccodes: Any, values: np.ndarray, **keys: Any) -> bytes:
    """One field of GRIB2 from :data:`START`; values without a number are missing."""
    handle = eccodes.codes_grib_new_from_samples("regular_ll_sfc_grib2")
    for key, value in ({"dataDate": 20261009, "dataTime": 0} | keys).items():
        eccodes.codes_set(handle, key, value)
    eccodes.codes_set(handle, "bitsPerValue", 24)
    if np.isnan(values).any():
        eccodes.codes_set(handle, "bitmapPresent", 1)
        eccodes.codes_set(handle, "missingValue", 9999.0)
    eccodes.codes_set_values(handle, np.nan_to_num(np.ravel(values), nan=9999.0).astype(float))
    raw: bytes = eccodes.codes_get_message(handle)
    eccodes.codes_release(handle)
    return raw


def parameter(discipline: int, category: int, number: int, surface: int, value: int) -> dict[str, Any]:
    return {
        "discipline": discipline, "parameterCategory": category, "parameterNumber": number,
        "typeOfFirstFixedSurface": surface, "scaleFactorOfFirstFixedSurface": 0,
        "scaledValueOfFirstFixedSurface": value,
    }  # fmt: skip


def lambert(eccodes: Any) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """The keys of a Lambert grid as of the NBM, and its longitudes and latitudes."""
    keys = {
        "gridType": "lambert", "shapeOfTheEarth": 1, "scaleFactorOfRadiusOfSphericalEarth": 0,
        "scaledValueOfRadiusOfSphericalEarth": 6371200, "Nx": 30, "Ny": 24, "DxInMetres": 20000,
        "DyInMetres": 20000, "LaDInDegrees": 25.0, "LoVInDegrees": 265.0, "Latin1InDegrees": 25.0,
        "Latin2InDegrees": 25.0, "latitudeOfFirstGridPointInDegrees": 35.0,
        "longitudeOfFirstGridPointInDegrees": 265.0, "jScansPositively": 1, "uvRelativeToGrid": 0,
    }  # fmt: skip
    plane = pyproj.Proj("+proj=lcc +lat_1=25 +lat_2=25 +lat_0=25 +lon_0=265 +R=6371200 +units=m")
    x0, y0 = plane(265.0, 35.0)
    lon, lat = plane(*np.meshgrid(x0 + 2e4 * np.arange(30), y0 + 2e4 * np.arange(24)), inverse=True)
    return keys, lon, lat


def nbm(path: Path, eccodes: Any) -> Path:
    """The National Blend of Models: speed and direction, with their spread, gusts and other heights."""
    keys, lon, lat = lambert(eccodes)
    u, v = np.moveaxis(wind_of(lon, lat), -1, 0)
    speed, source = np.hypot(u, v), np.rad2deg(np.arctan2(-u, -v)) % 360.0
    content = b""
    for hours in HOURS[1:6].tolist():
        when = keys | {"forecastTime": hours}
        content += message(eccodes, source, **when, **parameter(0, 2, 0, 103, 10))
        content += message(eccodes, speed, **when, **parameter(0, 2, 1, 103, 10))
        spread = {
            "productDefinitionTemplateNumber": 2,
            "derivedForecast": 2,
            "numberOfForecastsInEnsemble": 30,
        }
        content += message(eccodes, 0.2 * speed, **spread, **when, **parameter(0, 2, 1, 103, 10))
        content += message(eccodes, 1.5 * speed, **when, **parameter(0, 2, 22, 103, 10))
        content += message(eccodes, 1.4 * speed, **when, **parameter(0, 2, 1, 103, 80))
        content += message(eccodes, source + 15.0, **when, **parameter(0, 2, 0, 103, 80))
        content += message(eccodes, 0 * speed + 290.0, **when, **parameter(0, 0, 0, 103, 2))
    path.write_bytes(content)
    return path


def rtofs(path: Path, eccodes: Any) -> Path:
    """RTOFS for a region: a Mercator grid, land without values, temperature and height of the sea beside."""
    plane = pyproj.Proj("+proj=merc +lat_ts=27 +R=6371200 +units=m")
    x0, y0 = plane(-88.0, 25.0)
    x1, y1 = x0 + 8e3 * 50, y0 + 8e3 * 50
    lon, lat = plane(*np.meshgrid(x0 + 8e3 * np.arange(51), y0 + 8e3 * np.arange(51)), inverse=True)
    first, last = plane(x0, y0, inverse=True), plane(x1, y1, inverse=True)
    keys = {
        "gridType": "mercator", "shapeOfTheEarth": 1, "scaleFactorOfRadiusOfSphericalEarth": 0,
        "scaledValueOfRadiusOfSphericalEarth": 6371200, "Ni": 51, "Nj": 51, "LaDInDegrees": 27.0,
        "DiInMetres": 8000.0, "DjInMetres": 8000.0, "jScansPositively": 1,
        "latitudeOfFirstGridPointInDegrees": first[1], "longitudeOfFirstGridPointInDegrees": first[0] + 360,
        "latitudeOfLastGridPointInDegrees": last[1], "longitudeOfLastGridPointInDegrees": last[0] + 360,
        "uvRelativeToGrid": 0,
    }  # fmt: skip
    u, v = np.moveaxis(current_of(lon, lat), -1, 0)
    u[-8:, :8] = v[-8:, :8] = np.nan
    content = b""
    for hours in HOURS.tolist():
        when = keys | {"forecastTime": hours}
        content += message(eccodes, u, **when, **parameter(10, 1, 2, 160, 0))
        content += message(eccodes, v, **when, **parameter(10, 1, 3, 160, 0))
        content += message(eccodes, 0 * u + 300.0, **when, **parameter(10, 3, 0, 160, 0))
        content += message(eccodes, 0.4 * u, **when, **parameter(10, 1, 2, 160, 100))
        content += message(eccodes, 0.4 * v, **when, **parameter(10, 1, 3, 160, 100))
    path.write_bytes(content)
    return path


def test_speed_and_direction_of_the_nbm_are_flown(tmp_path: Path, eccodes: Any) -> None:
    words = [word for word in land(tmp_path) if not word.startswith("mission.start_time")]
    place = job(
        tmp_path,
        *words,
        f"wind={nbm(tmp_path / 'blend.grib2', eccodes)}",
        "mission.start_time=2026-10-09T06:00:00Z",
    )
    assert_drift(place, wind_of)


def test_the_current_of_rtofs_is_sailed(tmp_path: Path, eccodes: Any) -> None:
    exact = "wind.forecast_error=none"
    place = job(tmp_path, *sea(tmp_path), f"wind={rtofs(tmp_path / 'rtofs.grb2', eccodes)}", exact)
    assert_drift(place, current_of, 0.02)


# --- maps --------------------------------------------------------------------------------------

CALM = ("wind=calm", "mission.formula=F a")
WEST, EAST = box(10.2, 59.9, 10.25, 60.2), box(10.4, 60.0, 10.45, 60.4)
LINKED_KML = (
    "<Placemark><name>Start</name><Point><coordinates>10,60,0</coordinates></Point></Placemark>"
    + folder("Regions", ("a", kml_polygon(10.6, 60.1, 10.8, 60.2)))
    + "<Folder><name>No-fly zones</name>"
    "<NetworkLink><name>in</name><Link><href>zones/west.kml</href></Link></NetworkLink>"
    "<NetworkLink><name>out</name><Link><href>../east.kml</href></Link></NetworkLink></Folder>"
)


def flown_line(place: Path) -> shapely.LineString:
    """The path of the plan in longitudes and latitudes."""
    x = np.array(json.loads((place / "plan.json").read_text())["x"])
    return shapely.LineString(np.stack(Run.open(place).scene.frame.to_geographic(x), axis=-1))


def assert_detour(place: Path, *zones: list[list[float]]) -> None:
    """The path touches none of ``zones`` [deg], each of which lies on the straight line."""
    line = flown_line(place)
    direct = shapely.LineString([line.coords[0], line.coords[-1]])
    for zone in map(shapely.Polygon, zones):
        assert direct.intersects(zone)
        assert not line.intersects(zone)


def linked_map(folder_of_map: Path) -> Path:
    """A KMZ that links to a no-fly zone in the archive, and to one beside it."""
    sides = {"west": (10.2, 59.9, 10.25, 60.2), "east": (10.4, 60.0, 10.45, 60.4)}
    places = {
        name: f"<Placemark><name>{name}</name>{kml_polygon(*four)}</Placemark>"
        for name, four in sides.items()
    }
    kml = {name: KML.format(place) for name, place in places.items()}
    folder_of_map.mkdir()
    (folder_of_map / "east.kml").write_text(kml["east"])
    inside = {"doc.kml": KML.format(LINKED_KML), "zones__west.kml": kml["west"]}
    return archive(folder_of_map / "map.kmz", **inside)


def test_zones_to_which_a_kmz_links_are_avoided_and_a_change_of_them_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = linked_map(Path("maps"))
    place = job(tmp_path, f"scene.file={path}", *CALM)
    assert_detour(place, WEST, EAST)
    beside = Path("maps/east.kml")
    inputs = json.loads((place / "run.json").read_text())["inputs"]
    assert list(inputs) == [str(path), str(beside)]
    assert run_command_line(["rerun", str(place)]) == 0

    beside.write_text(beside.read_text().replace("10.4,", "10.41,"))
    capsys.readouterr()
    assert run_command_line(["verify", str(place)]) == 3
    assert "run: fingerprints of the inputs" in capsys.readouterr().out
    assert run_command_line(["rerun", str(place)]) == 2
    refusal = capsys.readouterr().err
    assert "maps/east.kml, to which a map links, and which is not what the run read" in refusal
    assert run_command_line(["rerun", str(place), *refusal.partition("add ")[2].split(",")[0].split()]) == 1
    told = capsys.readouterr().out
    assert "note: maps/east.kml is not what the run read" in told
    assert "scene.json differs" in told


def test_airspace_of_openair_is_avoided_at_the_height_of_the_flight(tmp_path: Path) -> None:
    def zone(name: str, low: str, high: str, ring: list[list[float]]) -> str:
        points = [f"DP {lat:.5f} N {lon:.5f} E" for lon, lat in ring[:-1]]
        return "\n".join(["AC R", f"AN {name}", f"AL {low}", f"AH {high}", *points, ""])

    above = box(10.5, 60.3, 10.8, 60.5)  # over the region
    zones = [
        zone("TOWN", "GND", "1500ft MSL", WEST),
        zone("RANGE", "SFC", "FL65", EAST),
        zone("ROUTE", "FL45", "FL95", above),
    ]
    (tmp_path / "zones.txt").write_text("".join(zones))
    path = map_file(tmp_path / "map.geojson", 10.35, 60.125, 0.6)
    words = (f"scene.file={path}", f"scene.zones=[{tmp_path / 'zones.txt'}]", "robot.level=300m amsl", *CALM)
    place = job(tmp_path, *words)
    assert_detour(place, WEST, EAST)
    scene = Run.open(place).scene
    assert scene.obstacle_names == ("TOWN", "RANGE")
    assert ["ROUTE" in absent.what for absent in scene.absent] == [True]


def test_a_flight_passes_a_facility_map_where_its_height_is_permitted(tmp_path: Path) -> None:
    cells = []
    for row in range(18):
        ring = box(10.4, 59.7 + 0.05 * row, 10.45, 59.75 + 0.05 * row)
        feet = 400 if row == 13 else (0, 50, 100, 200, 300)[row % 5]  # the flight is at 328 ft
        cell = feature("", "Polygon", [ring], CEILING=feet, UNIT="Feet", APT1_NAME="A FIELD", ARPT_COUNT=1)
        cells.append(cell)
    grid = written(tmp_path / "FAA_UAS_FacilityMap_Data.geojson", collection(*cells))
    frame = feature("border", "Polygon", [box(9.9, 59.7, 10.9, 60.6)])
    path = map_file(tmp_path / "map.geojson", 10.35, 60.125, 0.6, frame)
    place = job(tmp_path, f"scene.file={path}", f"scene.zones=[{grid}]", "robot.level=100m", *CALM)
    crossing = flown_line(place).intersection(shapely.LineString([(10.425, 59.0), (10.425, 61.0)]))
    assert 60.35 < crossing.y < 60.4  # the straight line crosses 10 km further south
