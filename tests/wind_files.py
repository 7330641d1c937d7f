"""Small wind files of many kinds, as programs and services write them, shared by the suites.

All have the same wind, :func:`wind_at`, from 18:00 on, around 37 N, 92 W; ``KINDS`` writes each kind into a
folder and returns the path that is read.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LON, LAT = np.arange(-95.0, -88.0), np.arange(34.0, 41.0)
HOURS = np.array([0.0, 3.0])
SINCE = "hours since 2018-10-09 18:00:00"
KNOT = 1852.0 / 3600.0
NORTH, EAST = {"units": "degrees_north"}, {"units": "degrees_east"}
CLOCK: dict[str, Any] = {"time": ("time", HOURS, {"units": SINCE, "standard_name": "time"})}
GRID: dict[str, Any] = CLOCK | {"lat": ("lat", LAT, NORTH), "lon": ("lon", LON, EAST)}
LAMBERT = "+proj=lcc +lat_1=38.5 +lat_2=38.5 +lat_0=38.5 +lon_0=-110 +R=6371229 +units=m"
POLE = (53.0, 88.0)  # of a rotated grid around 37 N, 92 W


def wind_at(lon: Array, lat: Array, hour: float) -> Array:
    """The wind (..., 2) [m/s] towards east and north."""
    u = 5.0 + 0.4 * (lat - 37.0) + 1.5 * hour
    return np.stack([u, -3.0 + 0.3 * (lon + 92.0) - 0.8 * hour], axis=-1)


def _on_grid() -> Array:
    """The winds (time, lat, lon, 2)."""
    return np.stack([wind_at(*np.meshgrid(LON, LAT), hour) for hour in HOURS])


def _along(lon: Array, lat: Array, ahead: tuple[Array, Array]) -> Array:
    """The winds (time, y, x, 2) along the axes of a grid whose y leads to the places ``ahead``."""
    angle = np.arctan2(
        (ahead[0] - lon) * np.cos(np.deg2rad(lat)), ahead[1] - lat
    )  # of grid north, from north
    cos, sin = np.cos(angle), np.sin(angle)
    winds = np.stack([wind_at(lon, lat, hour) for hour in HOURS])
    u, v = winds[..., 0], winds[..., 1]
    return np.stack([u * cos - v * sin, u * sin + v * cos], axis=-1)


def _lambert() -> tuple[Array, Array, Array, Array, Array]:
    """x, y [m], longitudes, latitudes (Y, X) [deg] and winds along the axes."""
    import pyproj

    plane = pyproj.Proj(LAMBERT)
    x, y = 1.3e6 + 1e5 * np.arange(7), -1e5 + 1e5 * np.arange(6)
    xs, ys = np.meshgrid(x, y)
    lon, lat = plane(xs, ys, inverse=True)
    return x, y, lon, lat, _along(lon, lat, plane(xs, ys + 10.0, inverse=True))


def _rotated() -> tuple[Array, Array, Array, Array, Array]:
    """Rotated longitudes and latitudes, from north to south, then as :func:`_lambert`."""
    import pyproj

    mapping = {
        "grid_mapping_name": "rotated_latitude_longitude",
        "grid_north_pole_latitude": POLE[0], "grid_north_pole_longitude": POLE[1],
    }  # fmt: skip
    change = pyproj.Transformer.from_crs(pyproj.CRS.from_cf(mapping), 4326, always_xy=True)
    x, y = np.arange(-3.0, 4.0), np.arange(3.0, -3.0, -1.0)
    xs, ys = np.meshgrid(x, y)
    lon, lat = change.transform(xs, ys)
    return x, y, lon, lat, _along(lon, lat, change.transform(xs, ys + 1e-4))


# --- tables ------------------------------------------------------------------------------------


def _rows(*, planar: bool = False) -> Iterator[tuple[int, float, float, float, float]]:
    """Hour, latitude or y, longitude or x, and components of each node."""
    for hour in HOURS:
        for lat in LAT:
            for lon in LON:
                u, v = wind_at(lon, lat, hour)
                yield (int(hour) + 18, (lat - 37) * 1e5, (lon + 92) * 1e5, u, v) if planar else (
                    int(hour) + 18, lat, lon, u, v
                )  # fmt: skip


def _csv(place: Path) -> Path:
    rows = [
        f"2018-10-09T{h}:00:00Z,{lat:g},{lon:g},{u:.4f},{v:.4f},{h - 18}" for h, lat, lon, u, v in _rows()
    ]
    return _text(place, "winds.csv", "\n".join(["time,lat,lon,u,v,lead_hours", *rows]))


def _spreadsheet(place: Path) -> Path:
    rows = [
        f"09.10.2018 {h}:00;{lat:g};{lon:g};{u / KNOT:.4f};{v / KNOT:.4f}" for h, lat, lon, u, v in _rows()
    ]
    lines = ["time;lat;lon;u (knots);v_kt", *(row[:10] + row[10:].replace(".", ",") for row in rows)]
    return _text(place, "winds.csv", "\n".join(lines))


def _polar_table(place: Path) -> Path:
    rows = [
        f"2018-10-09,{h}:00,{lat:g},{lon:g},{s:.5f},{d:.5f}"
        for h, lat, lon, u, v in _rows()
        for s, d in [_polar(u, v)]
    ]
    return _text(place, "winds.csv", "\n".join(["date,time,lat,lon,wind_speed_kt,wind_dir_degrees", *rows]))


def _planar_table(place: Path) -> Path:
    rows = [f"2018-10-09T{h}:00Z,{x:g},{y:g},{u:.4f},{v:.4f}" for h, y, x, u, v in _rows(planar=True)]
    return _text(place, "winds.csv", "\n".join(["time,x,y,u,v", *rows]))


def _polar(u: float, v: float) -> tuple[float, float]:
    """Speed [kt] and direction [deg] from which it blows."""
    return float(np.hypot(u, v) / KNOT), float(np.rad2deg(np.arctan2(-u, -v)) % 360)


def _reports() -> Iterator[tuple[str, int, float, float, float, float]]:
    """Name, hour of a report at 53 minutes past the hour before it, place, direction [deg] and speed [kt]."""
    for n, (hour, lat, lon, u, v) in enumerate(_rows()):
        speed, direction = _polar(u, v)
        yield f"K{n % (len(LAT) * len(LON)):03d}", hour - 1, lat, lon, direction, speed


def _metars(place: Path) -> Path:
    head = (
        "raw_text,station_id,observation_time,latitude,longitude,wind_dir_degrees,wind_speed_kt,wind_gust_kt"
    )
    rows = [
        f"METAR,{k},2018-10-09T{h}:53:00Z,{lat:g},{lon:g},{d:.4f},{s:.4f},"
        for k, h, lat, lon, d, s in _reports()
    ]
    return _text(
        place,
        "metars.csv",
        "\n".join(["No errors", head, *rows, "METAR,KVRB,2018-10-09T17:53:00Z,37,-92,VRB,3,"]),
    )


def _awc(place: Path) -> Path:
    found = [
        {"icaoId": k, "obsTime": 1539043200 + 3600 * h + 3180, "wdir": d, "wspd": s, "lat": lat, "lon": lon}
        for k, h, lat, lon, d, s in _reports()
    ]
    return _text(place, "metar.json", json.dumps(found))


def _isd(place: Path) -> Path:
    rows = [
        f'7{k[1:]},2018-10-09T{h}:53:00,{lat:g},{lon:g},"{d:03.0f},1,N,{10 * s * KNOT:04.0f},1"'
        for k, h, lat, lon, d, s in _reports()
    ]
    return _text(place, "isd.csv", "\n".join(["STATION,DATE,LATITUDE,LONGITUDE,WND", *rows]))


def _lcd(place: Path) -> Path:
    rows = [
        f"7{k[1:]},2018-10-09T{h}:53:00,{lat:g},{lon:g},{d:03.0f},{s:.0f}"
        for k, h, lat, lon, d, s in _reports()
    ]
    head = "STATION,DATE,LATITUDE,LONGITUDE,HourlyWindDirection,HourlyWindSpeed"
    return _text(place, "lcd.csv", "\n".join([head, *rows]))


def _ndbc(place: Path) -> Path:
    rows = [
        f"4{k[1:]} {lat:g} {lon:g} 2018 10 09 {h} 53 {d:.0f} {s * KNOT:.1f} MM"
        for k, h, lat, lon, d, s in _reports()
    ]
    head = "#STN LAT LON YYYY MM DD hh mm WDIR WSPD GST\n#text deg deg yr mo day hr mn degT m/s m/s"
    return _text(place, "latest_obs.txt", "\n".join([head, *rows]))


def _text(place: Path, name: str, text: str) -> Path:
    place.mkdir(parents=True, exist_ok=True)
    (place / name).write_text(text + "\n")
    return place / name


# --- NetCDF ------------------------------------------------------------------------------------


def _saved(
    place: Path, arrays: dict[str, Any], coords: dict[str, Any], name: str = "wind.nc", **attributes: Any
) -> Path:
    import xarray as xr

    place.mkdir(parents=True, exist_ok=True)
    data = xr.Dataset(arrays, coords, attributes)
    for variable in data.variables:
        data[variable].encoding.setdefault("_FillValue", None)
    data.to_netcdf(place / name, engine="h5netcdf")
    return place / name


def _pair(
    winds: Array,
    dims: tuple[str, ...],
    names: tuple[str, str],
    u: dict[str, Any],
    v: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """The two components of ``winds`` (..., 2) as variables, with attributes."""
    told = (u, u if v is None else v)
    return {names[k]: (dims, winds[..., k], {"units": "m s-1", **told[k]}) for k in (0, 1)}


def _regular(place: Path) -> Path:
    standard = ({"standard_name": "eastward_wind"}, {"standard_name": "northward_wind"})
    return _saved(place, _pair(_on_grid(), ("time", "lat", "lon"), ("u10", "v10"), *standard), GRID)


def _classic(place: Path) -> Path:
    """Packed values and 2-d latitudes in the classic format."""
    import xarray as xr

    place.mkdir(parents=True, exist_ok=True)
    lon, lat = np.meshgrid(LON, LAT)
    standard = ({"standard_name": "eastward_wind"}, {"standard_name": "northward_wind"})
    arrays = _pair(_on_grid(), ("time", "y", "x"), ("u10", "v10"), *standard)
    data = xr.Dataset(arrays, CLOCK | {"lat": (("y", "x"), lat, NORTH), "lon": (("y", "x"), lon, EAST)})
    packing = {"dtype": "int16", "scale_factor": 0.001, "_FillValue": np.int16(-32768)}
    data.to_netcdf(place / "old.nc", engine="scipy", encoding={"u10": packing, "v10": packing})
    return place / "old.nc"


def _era5(place: Path) -> Path:
    """ERA5 of the Climate Data Store: final and preliminary values, and no standard names of the wind."""
    winds = np.stack([_on_grid(), _on_grid()], axis=1)
    winds[1, 0], winds[0, 1] = np.nan, np.nan
    told = [
        {"standard_name": "unknown", "long_name": f"10 metre {letter} wind component", "units": "m s**-1"}
        for letter in "UV"
    ]
    arrays = _pair(winds, ("valid_time", "expver", "latitude", "longitude"), ("u10", "v10"), *told)
    coords = {
        "valid_time": ("valid_time", 1539108000 + 3600 * HOURS.astype(int),
                       {"units": "seconds since 1970-01-01", "standard_name": "time"}),
        "expver": ("expver", [1, 5]), "number": ((), 0, {"long_name": "ensemble member"}),
        "latitude": ("latitude", LAT, NORTH), "longitude": ("longitude", LON, EAST),
    }  # fmt: skip
    return _saved(place, arrays, coords)


def _paired(place: Path) -> Path:
    """Components in two files of a folder."""
    for name, array in _pair(_on_grid(), ("time", "lat", "lon"), ("uwnd", "vwnd"), {}).items():
        _saved(place, {name: array}, GRID, f"{name}.2018.nc")
    return place


def _polar_netcdf(place: Path) -> Path:
    winds = _on_grid()
    dims, sides = ("time", "lat", "lon"), np.rad2deg(np.arctan2(-winds[..., 0], -winds[..., 1])) % 360
    speed = (dims, np.hypot(winds[..., 0], winds[..., 1]), {"units": "m s-1", "standard_name": "wind_speed"})
    side = (dims, sides, {"units": "degree", "standard_name": "wind_from_direction"})
    return _saved(place, {"speed": speed, "direction": side}, GRID)


def _hycom(place: Path) -> Path:
    winds = np.repeat(_on_grid()[:, None] / 10, 2, axis=1)
    standard = [
        {"standard_name": f"{axis}ward_sea_water_velocity", "units": "m/s"} for axis in ("east", "north")
    ]
    arrays = _pair(winds, ("time", "depth", "lat", "lon"), ("water_u", "water_v"), *standard)
    since = {"units": "hours since 2000-01-01 00:00:00", "long_name": "Valid Time"}
    coords = GRID | {
        "time": ("time", 164_538.0 + HOURS, since),
        "tau": ("time", HOURS, {"units": "hours since analysis", "long_name": "Tau"}),
        "depth": ("depth", [0.0, 2.0], {"units": "m", "positive": "down", "standard_name": "depth"}),
    }  # fmt: skip
    return _saved(place, arrays, coords)


def ensemble(place: Path) -> Path:
    """Three members whose mean is the wind."""
    winds = np.stack([_on_grid() + shift for shift in (-1.0, 0.0, 1.0)], axis=1)
    standard = ({"standard_name": "eastward_wind"}, {"standard_name": "northward_wind"})
    dims = ("time", "number", "lat", "lon")
    return _saved(
        place, _pair(winds, dims, ("u10", "v10"), *standard), GRID | {"number": ("number", [0, 1, 2])}
    )


def _lambert_netcdf(place: Path) -> Path:
    x, y, _, _, winds = _lambert()
    mapping = {
        "grid_mapping_name": "lambert_conformal_conic", "standard_parallel": 38.5, "earth_radius": 6371229.0,
        "latitude_of_projection_origin": 38.5, "longitude_of_central_meridian": -110.0,
    }  # fmt: skip
    names = tuple(f"{letter}-component_of_wind_height_above_ground" for letter in "uv")
    arrays = _pair(winds, ("time", "y", "x"), names, {"grid_mapping": "plane"})
    coords = CLOCK | {
        "x": ("x", x / 1e3, {"units": "km", "standard_name": "projection_x_coordinate"}),
        "y": ("y", y / 1e3, {"units": "km", "standard_name": "projection_y_coordinate"}),
    }
    return _saved(place, arrays | {"plane": ((), 0, mapping)}, coords)


def _rotated_netcdf(place: Path) -> Path:
    x, y, _, _, winds = _rotated()
    mapping = {
        "grid_mapping_name": "rotated_latitude_longitude",
        "grid_north_pole_latitude": POLE[0], "grid_north_pole_longitude": POLE[1],
    }  # fmt: skip
    told = [{"standard_name": f"grid_{axis}ward_wind", "grid_mapping": "pole"} for axis in ("east", "north")]
    arrays = _pair(winds, ("time", "rlat", "rlon"), ("u10", "v10"), *told)
    coords = CLOCK | {
        "rlon": ("rlon", x, {"units": "degrees", "standard_name": "grid_longitude"}),
        "rlat": ("rlat", y, {"units": "degrees", "standard_name": "grid_latitude"}),
    }
    return _saved(place, arrays | {"pole": ((), 0, mapping)}, coords)


def _of_cfgrib(place: Path) -> Path:
    """A Lambert file of GRIB as cfgrib writes it: standard names of east and north, and the flag of GRIB."""
    _, _, lon, lat, winds = _lambert()
    keys = {
        "GRIB_gridType": "lambert", "GRIB_uvRelativeToGrid": 1, "GRIB_LaDInDegrees": 38.5,
        "GRIB_LoVInDegrees": -110.0, "GRIB_Latin1InDegrees": 38.5, "GRIB_Latin2InDegrees": 38.5,
    }  # fmt: skip
    told = [{"standard_name": f"{axis}ward_wind"} | keys for axis in ("east", "north")]
    arrays = _pair(winds, ("step", "y", "x"), ("u10", "v10"), *told)
    coords = {
        "time": ((), 0.0, {"units": SINCE, "standard_name": "forecast_reference_time"}),
        "step": ("step", HOURS, {"units": "hours", "standard_name": "forecast_period"}),
        "valid_time": ("step", HOURS, {"units": SINCE, "standard_name": "time"}),
        "heightAboveGround": ((), 10.0, {"units": "m", "standard_name": "height", "positive": "up"}),
        "latitude": (("y", "x"), lat, NORTH), "longitude": (("y", "x"), lon, EAST),
    }  # fmt: skip
    return _saved(place, arrays, coords)


def _wrfout(place: Path) -> Path:
    _, _, lon, lat, winds = _lambert()
    dims = ("Time", "south_north", "west_east")
    arrays = _pair(winds, dims, ("U10", "V10"), {"coordinates": "XLONG XLAT XTIME"})
    hours = [f"2018-10-09_{18 + int(hour)}:00:00" for hour in HOURS]
    arrays |= {
        "Times": ("Time", np.array(hours, "S19")),
        "XLAT": (dims, np.stack([lat] * 2), {"units": "degree_north"}),
        "XLONG": (dims, np.stack([lon] * 2), {"units": "degree_east"}),
    }
    keys = {"MAP_PROJ": 1, "TRUELAT1": 38.5, "TRUELAT2": 38.5, "STAND_LON": -110.0, "CEN_LAT": 37.0}
    return _saved(place, arrays, {}, "wrfout_d01", SIMULATION_START_DATE="2018-10-09_12:00:00", **keys)


# --- levels ------------------------------------------------------------------------------------

LEVELS = (1000.0, 925.0, 850.0)  # [hPa]


def stronger(level: float) -> float:
    """How much stronger the wind is at a level [hPa] than at 1000 hPa."""
    return 1.0 + (1000.0 - level) / 100.0


def level_file(place: Path, levels: tuple[float, ...] = LEVELS) -> Path:
    """A NetCDF file of the wind at pressure ``levels`` [hPa], times :func:`stronger`."""
    import xarray as xr

    field = _on_grid()
    scale = np.array([stronger(level) for level in levels])[None, :, None, None]
    dims = ("time", "level", "lat", "lon")
    units = {"units": "m s-1"}
    data = xr.Dataset(
        {
            "u": (dims, field[..., 0][:, None] * scale, units | {"standard_name": "eastward_wind"}),
            "v": (dims, field[..., 1][:, None] * scale, units | {"standard_name": "northward_wind"}),
        },
        coords={
            "time": ("time", HOURS, {"units": "hours since 2018-10-09 18:00:00", "standard_name": "time"}),
            "level": ("level", list(levels), {"units": "hPa", "standard_name": "air_pressure"}),
            "lat": ("lat", LAT, {"units": "degrees_north"}),
            "lon": ("lon", LON, {"units": "degrees_east"}),
        },
    )
    data.to_netcdf(place, engine="h5netcdf")
    return place


# --- GRIB --------------------------------------------------------------------------------------

REGULAR = {
    "Ni": 7, "Nj": 7, "latitudeOfFirstGridPointInDegrees": 40.0, "latitudeOfLastGridPointInDegrees": 34.0,
    "longitudeOfFirstGridPointInDegrees": 265.0, "longitudeOfLastGridPointInDegrees": 271.0,
    "iDirectionIncrementInDegrees": 1.0, "jDirectionIncrementInDegrees": 1.0,
}  # fmt: skip
U10, V10, SPEED10, FROM10 = ((0, 2, number, 103, 10) for number in (2, 3, 1, 0))
SURFACE_U, SURFACE_V = ((10, 1, number, 160, 0) for number in (2, 3))


def grib_message(
    values: Array, what: tuple[int, ...], hour: float, sample: str = "regular_ll_sfc_grib2", **keys: Any
) -> bytes:
    """One message: ``what`` is discipline, category, number, type and value of the level."""
    import pyproj  # noqa: F401 - before ecCodes: each contains a PROJ, and the other order can crash
    import eccodes  # isort: skip

    handle = eccodes.codes_grib_new_from_samples(sample)
    names = (
        "discipline", "parameterCategory", "parameterNumber", "typeOfFirstFixedSurface",
        "scaledValueOfFirstFixedSurface",
    )  # fmt: skip
    named = dict(zip(names, what, strict=True)) | {"scaleFactorOfFirstFixedSurface": 0}
    for key, value in {"dataDate": 20181009, "dataTime": 1800, **keys, **named, "step": int(hour)}.items():
        eccodes.codes_set(handle, key, value)
    eccodes.codes_set(handle, "bitsPerValue", 24)
    eccodes.codes_set_values(handle, np.ravel(values).astype(float))
    raw: bytes = eccodes.codes_get_message(handle)
    eccodes.codes_release(handle)
    return raw


def _grib(
    place: Path,
    winds: Array,
    keys: dict[str, Any],
    whats: tuple[tuple[int, ...], ...] = (U10, V10),
    **more: Any,
) -> Path:
    """A file of ``winds`` (time, y, x, 2) in the order of the grid of ``keys``."""
    raw = [
        grib_message(winds[n, ..., k], what, hour, **keys, **more)
        for n, hour in enumerate(HOURS)
        for k, what in enumerate(whats)
    ]
    place.mkdir(parents=True, exist_ok=True)
    (place / "wind.grib2").write_bytes(b"".join(raw))
    return place / "wind.grib2"


def _regular_grib(place: Path) -> Path:
    return _grib(place, _on_grid()[:, ::-1], REGULAR)


def _grib_edition_1(place: Path) -> Path:
    import pyproj  # noqa: F401
    import eccodes  # isort: skip

    raw = []
    for n, hour in enumerate(HOURS):
        for k, number in enumerate((33, 34)):
            handle = eccodes.codes_grib_new_from_samples("regular_ll_sfc_grib1")
            named = {
                "table2Version": 2,
                "indicatorOfParameter": number,
                "indicatorOfTypeOfLevel": 105,
                "level": 10,
            }
            for key, value in {
                **REGULAR,
                "dataDate": 20181009,
                "dataTime": 1800,
                **named,
                "step": int(hour),
            }.items():
                eccodes.codes_set(handle, key, value)
            eccodes.codes_set(handle, "bitsPerValue", 24)
            eccodes.codes_set_values(handle, np.ravel(_on_grid()[n, ::-1, :, k]))
            raw.append(eccodes.codes_get_message(handle))
            eccodes.codes_release(handle)
    place.mkdir(parents=True, exist_ok=True)
    (place / "wind.grb").write_bytes(b"".join(raw))
    return place / "wind.grb"


def _polar_grib(place: Path) -> Path:
    winds = _on_grid()[:, ::-1]
    sides = np.rad2deg(np.arctan2(-winds[..., 0], -winds[..., 1])) % 360
    speeds = np.hypot(winds[..., 0], winds[..., 1])
    return _grib(place, np.stack([speeds, sides], axis=-1), REGULAR, (SPEED10, FROM10))


def _current_grib(place: Path) -> Path:
    return _grib(place, _on_grid()[:, ::-1] / 10, REGULAR, (SURFACE_U, SURFACE_V))


def _lambert_grib(place: Path) -> Path:
    _, _, lon, lat, winds = _lambert()
    keys = {
        "gridType": "lambert", "Nx": 7, "Ny": 6, "latitudeOfFirstGridPointInDegrees": lat[0, 0],
        "longitudeOfFirstGridPointInDegrees": lon[0, 0] % 360, "LaDInDegrees": 38.5, "LoVInDegrees": 250.0,
        "DxInMetres": 100_000, "DyInMetres": 100_000, "Latin1InDegrees": 38.5, "Latin2InDegrees": 38.5,
        "uvRelativeToGrid": 1, "jScansPositively": 1, "shapeOfTheEarth": 6,
    }  # fmt: skip
    return _grib(place, winds, keys)


def _rotated_grib(place: Path) -> Path:
    keys = REGULAR | {
        "gridType": "rotated_ll", "Nj": 6, "uvRelativeToGrid": 1,
        "latitudeOfFirstGridPointInDegrees": 3.0, "latitudeOfLastGridPointInDegrees": -2.0,
        "longitudeOfFirstGridPointInDegrees": 357.0, "longitudeOfLastGridPointInDegrees": 3.0,
        "latitudeOfSouthernPoleInDegrees": -POLE[0], "longitudeOfSouthernPoleInDegrees": POLE[1] + 180.0,
    }  # fmt: skip
    keys = {"gridType": keys.pop("gridType"), **keys}
    return _grib(place, _rotated()[4], keys)


Writer = Callable[[Path], Path]
TABLES: dict[str, Writer] = {
    "table": _csv, "spreadsheet": _spreadsheet, "speed and direction": _polar_table, "plane": _planar_table,
}  # fmt: skip
REPORTS: dict[str, Writer] = {"metars": _metars, "awc json": _awc, "isd": _isd, "lcd": _lcd, "ndbc": _ndbc}
NETCDF: dict[str, Writer] = {
    "netcdf": _regular, "classic netcdf": _classic, "era5": _era5, "two files": _paired,
    "netcdf speed and direction": _polar_netcdf, "hycom": _hycom, "lambert netcdf": _lambert_netcdf,
    "rotated netcdf": _rotated_netcdf, "netcdf of cfgrib": _of_cfgrib, "wrfout": _wrfout,
}  # fmt: skip
GRIB: dict[str, Writer] = {
    "grib": _regular_grib, "grib edition 1": _grib_edition_1, "grib speed and direction": _polar_grib,
    "grib currents": _current_grib, "lambert grib": _lambert_grib, "rotated grib": _rotated_grib,
}  # fmt: skip
if find_spec("eccodes") is None:
    GRIB = {}
KINDS = TABLES | REPORTS | NETCDF | GRIB
