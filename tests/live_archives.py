"""Archives of forecasts as their providers have them: names, fields and inventories, with fields of our own.

The names of variables, levels and keys are those of inventories of 2026: NBM core, AIGFS and AIGEFS on
NOMADS, ``.index`` files of ECMWF's open data. RTOFS has no inventories, and 24 hours in a file.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pyproj

from pareto_ltl.support.arrays import FloatArray

LON, LAT = np.arange(-106.0, -77.0), np.arange(48.0, 26.0, -1.0)
LATLON = {
    "Ni": len(LON), "Nj": len(LAT), "latitudeOfFirstGridPointInDegrees": LAT[0],
    "latitudeOfLastGridPointInDegrees": LAT[-1], "longitudeOfFirstGridPointInDegrees": LON[0] + 360.0,
    "longitudeOfLastGridPointInDegrees": LON[-1] + 360.0, "iDirectionIncrementInDegrees": 1.0,
    "jDirectionIncrementInDegrees": 1.0,
}  # fmt: skip
GRID = np.stack(np.meshgrid(LON, LAT), axis=-1).reshape(-1, 2)
BLEND = {
    "gridType": "lambert", "Nx": 55, "Ny": 38, "LaDInDegrees": 25.0, "LoVInDegrees": 265.0,
    "Latin1InDegrees": 25.0, "Latin2InDegrees": 25.0, "latitudeOfFirstGridPointInDegrees": 19.229,
    "longitudeOfFirstGridPointInDegrees": 233.723, "DxInMetres": 100_000.0, "DyInMetres": 100_000.0,
    "jScansPositively": 1, "uvRelativeToGrid": 1, "shapeOfTheEarth": 1,
    "scaleFactorOfRadiusOfSphericalEarth": 0, "scaledValueOfRadiusOfSphericalEarth": 6_371_200,
}  # fmt: skip
HEIGHT, PRESSURE, SURFACE, SEA = 103, 100, 1, 160
NUMBERS = {
    "UGRD": (0, 2, 2), "VGRD": (0, 2, 3), "WIND": (0, 2, 1), "WDIR": (0, 2, 0), "TMP": (0, 0, 0),
    "PRES": (0, 3, 0), "UOGRD": (10, 1, 2), "VOGRD": (10, 1, 3), "WTMP": (10, 3, 0), "UBARO": (10, 1, 194),
}  # fmt: skip


def wind(points: FloatArray, hour: float, member: int = 0, height: float = 10.0) -> FloatArray:
    """The wind (N, 2) [m/s] at ``points`` (N, 2) [deg], ``hour`` after the start of the forecast."""
    lon, lat = points.T
    return np.stack(
        [4 + 0.2 * (lat - 37) + 0.1 * hour + member, -3 + 0.1 * (lon + 92) - 0.05 * hour + height / 50],
        axis=1,
    )


def current(points: FloatArray, hour: float) -> FloatArray:
    return 0.02 * wind(points, hour)


def blend_nodes() -> FloatArray:
    """Longitude and latitude (N, 2) [deg] of the nodes of the blend, by PROJ."""
    plane = pyproj.Proj("+proj=lcc +lat_0=25 +lat_1=25 +lat_2=25 +lon_0=-95 +R=6371200")
    x0, y0 = plane(233.723 - 360.0, 19.229)
    x, y = np.meshgrid(x0 + 1e5 * np.arange(BLEND["Nx"]), y0 + 1e5 * np.arange(BLEND["Ny"]))
    return np.stack(plane(x.ravel(), y.ravel(), inverse=True), axis=1)


def message(
    name: str, values: FloatArray, cycle: str, hour: int, surface: int, level: float,
    grid: dict[str, Any] = LATLON, **keys: Any,
) -> bytes:  # fmt: skip
    """A GRIB2 message of ``name``, whose ``surface`` is of WMO table 4.5; ``cycle`` is YYYYMMDDHH."""
    import eccodes

    handle = eccodes.codes_grib_new_from_samples("regular_ll_sfc_grib2")
    discipline, category, number = NUMBERS[name]
    settings = grid | keys | {
        "discipline": discipline, "parameterCategory": category, "parameterNumber": number,
        "typeOfFirstFixedSurface": surface, "scaleFactorOfFirstFixedSurface": 0,
        "scaledValueOfFirstFixedSurface": round(level), "dataDate": int(cycle[:8]),
        "dataTime": 100 * int(cycle[8:]), "indicatorOfUnitOfTimeRange": 1, "forecastTime": hour,
        "bitsPerValue": 20,
    }  # fmt: skip
    for key, value in settings.items():
        eccodes.codes_set(handle, key, value)
    gaps = np.isnan(values)
    eccodes.codes_set(handle, "bitmapPresent", int(gaps.any()))
    missing = float(eccodes.codes_get(handle, "missingValue"))
    eccodes.codes_set_values(handle, np.where(gaps, missing, values).astype(float))
    raw: bytes = eccodes.codes_get_message(handle)
    eccodes.codes_release(handle)
    return raw


def idx_file(cycle: str, fields: Iterable[tuple[str, bytes]]) -> tuple[bytes, bytes]:
    """A file and its inventory by wgrib2; each field is ``VARIABLE:LEVEL:FORECAST:REST`` and its message."""
    lines, data = [], b""
    for number, (text, raw) in enumerate(fields, 1):
        lines.append(f"{number}:{len(data)}:d={cycle}:{text}")
        data += raw
    return data, ("\n".join(lines) + "\n").encode()


def index_file(cycle: str, fields: Iterable[tuple[dict[str, str], bytes]]) -> tuple[bytes, bytes]:
    """A file and its index by ECMWF; each field has keys and its message."""
    lines, data = [], b""
    for keys, raw in fields:
        usual = {"domain": "g", "date": cycle[:8], "time": f"{cycle[8:]}00", "expver": "0001"}
        lines.append(json.dumps(usual | keys | {"_offset": len(data), "_length": len(raw)}))
        data += raw
    return data, ("\n".join(lines) + "\n").encode()


def nbm(cycle: str, hours: Iterable[int], heights: Iterable[int] = (10, 80)) -> dict[str, bytes]:
    """The blend: speed and direction, each followed by statistics that are no wind."""
    files, nodes = {}, blend_nodes()

    def fields(hour: int) -> Iterator[tuple[str, bytes]]:
        def put(name: str, values: FloatArray, height: int) -> bytes:
            return message(name, values, cycle, hour, HEIGHT, height, BLEND)

        yield f"TMP:2 m above ground:{hour} hour fcst:", put("TMP", nodes[:, 1] + 250, 2)
        yield f"TMP:2 m above ground:{hour} hour fcst:ens std dev", put("TMP", 0 * nodes[:, 1] + 2, 2)
        for height in heights:
            u, v = wind(nodes, hour, height=height).T
            at = f"{height} m above ground:{hour} hour fcst"
            yield f"WIND:{at}:ens std dev", put("WIND", 0 * u + 1.5, height)
            yield f"WIND:{at}:prob >17.5:prob fcst 255/255", put("WIND", 0 * u + 3, height)
            yield f"WDIR:{at}:", put("WDIR", np.rad2deg(np.arctan2(-u, -v)) % 360, height)
            yield f"WIND:{at}:", put("WIND", np.hypot(u, v), height)

    for hour in hours:
        path = f"blend.{cycle[:8]}/{cycle[8:]}/core/blend.t{cycle[8:]}z.core.f{hour:03d}.co.grib2"
        files[path], files[f"{path}.idx"] = idx_file(cycle, fields(hour))
    return files


def aigfs(cycle: str, hours: Iterable[int], members: Iterable[int] | None = None) -> dict[str, bytes]:
    """AIGFS, or these members of AIGEFS."""
    name, files = "aigfs" if members is None else "aigefs", {}

    def fields(hour: int, member: int, product: str) -> Iterator[tuple[str, bytes]]:
        keys = {"productDefinitionTemplateNumber": 1, "perturbationNumber": member} if members else {}
        rest = f"ENS=+{member}" if members else ""
        forecast = "anl" if hour == 0 else f"{hour} hour fcst"
        levels = [("10 m above ground", HEIGHT, 10)] if product == "sfc" else [
            ("850 mb", PRESSURE, 85_000), ("925 mb", PRESSURE, 92_500)
        ]  # fmt: skip
        for text, surface, level in levels:
            for part, component in enumerate(("UGRD", "VGRD")):
                values = wind(GRID, hour, member)[:, part]
                raw = message(component, values, cycle, hour, surface, level, **keys)
                yield f"{component}:{text}:{forecast}:{rest}", raw
        yield (
            f"TMP:2 m above ground:{forecast}:{rest}",
            message("TMP", GRID[:, 1], cycle, hour, HEIGHT, 2, **keys),
        )

    for hour in hours:
        for member in members or (0,):
            for product in ("sfc", "pres"):
                inside = f"mem{member:03d}/" if members else ""
                path = (
                    f"{name}.{cycle[:8]}/{cycle[8:]}/{inside}model/atmos/grib2/"
                    f"{name}.t{cycle[8:]}z.{product}.f{hour:03d}.grib2"
                )
                files[path], files[f"{path}.idx"] = idx_file(cycle, fields(hour, member, product))
    return files


def ecmwf(
    cycle: str, hours: Iterable[int], model: str, stream: str, kind: str, members: Iterable[int] = (0,)
):
    """Files of ``model`` (ifs, aifs-single, aifs-ens), e.g. stream ``oper`` and kind ``fc``."""
    files = {}

    def fields(hour: int) -> Iterator[tuple[dict[str, str], bytes]]:
        for member in reversed(tuple(members)):
            numbered = kind in ("ef", "pf")
            keys: dict[str, Any] = {"packingType": "grid_ccsds"}
            told = {"type": "pf" if numbered else kind, "stream": stream, "step": str(hour), "model": model}
            if stream == "enfo":
                keys |= {"productDefinitionTemplateNumber": 1, "perturbationNumber": member}
            own = {"number": str(member)} if numbered else {}
            pressure = np.where(GRID[:, 1] > 40.0, 90_000.0, 100_000.0)
            yield (
                told | {"levtype": "sfc"} | own | {"param": "sp"},
                message("PRES", pressure, cycle, hour, SURFACE, 0, **keys),
            )
            for param, surface, level, height in (
                ("100v", HEIGHT, 100, 100.0), ("10v", HEIGHT, 10, 10.0), ("100u", HEIGHT, 100, 100.0),
                ("10u", HEIGHT, 10, 10.0), ("u", PRESSURE, 92_500, 500.0), ("v", PRESSURE, 92_500, 500.0),
            ):  # fmt: skip
                part = "uv".index(param[-1])
                name = ("UGRD", "VGRD")[part]
                where = {"levelist": "925", "levtype": "pl"} if surface == PRESSURE else {"levtype": "sfc"}
                values = wind(GRID, hour, member, height)[:, part]
                raw = message(name, values, cycle, hour, surface, level, **keys)
                yield told | where | own | {"param": param}, raw

    for hour in hours:
        folder = f"{cycle[:8]}/{cycle[8:]}z/{model}/0p25/{stream}"
        path = f"{folder}/{cycle}0000-{hour}h-{stream}-{kind}"
        files[f"{path}.grib2"], files[f"{path}.index"] = index_file(cycle, fields(hour))
    return files


def rtofs(cycle: str, last: Iterable[int] = (24, 48), region: str = "west_atl") -> dict[str, bytes]:
    """Hourly surface currents of the 24 hours up to each of ``last``, beside temperature and mean flow."""
    lon, lat = np.arange(-76.0, -66.0, 0.25), np.arange(44.5, 36.0, -0.25)
    grid = {
        "Ni": len(lon), "Nj": len(lat), "latitudeOfFirstGridPointInDegrees": lat[0],
        "latitudeOfLastGridPointInDegrees": lat[-1], "longitudeOfFirstGridPointInDegrees": lon[0] + 360.0,
        "longitudeOfLastGridPointInDegrees": lon[-1] + 360.0, "iDirectionIncrementInDegrees": 0.25,
        "jDirectionIncrementInDegrees": 0.25,
    }  # fmt: skip
    nodes = np.stack(np.meshgrid(lon, lat), axis=-1).reshape(-1, 2)
    land = nodes[:, 1] > 42.0
    files = {}
    for end in last:
        data = b""
        for hour in range(end - 23, end + 1):
            u, v = np.where(land[:, None], np.nan, current(nodes, hour)).T
            for name, values in (("WTMP", 0 * u + 290), ("UOGRD", u), ("VOGRD", v), ("UBARO", 0 * u + 0.3)):
                data += message(name, values, cycle, hour, SEA, 0, grid)
        files[f"rtofs.{cycle[:8]}/rtofs_glo.t00z.f{end:03d}_{region}_std.grb2"] = data
    return files
