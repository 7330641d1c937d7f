"""Winds and currents of the missions: the packaged sample, files made from it, and invented currents.

Tables are the packaged winds. For maps outside of the United States they are moved by whole degrees, so that
the middle of the sample lies on the middle of the map: every map of the Earth has real winds. An ensemble is
the sample on a grid, plus for each member four plane waves whose standard deviation grows with the lead. A
current is a jet, a ring and a slow rotation.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

from corpus.drawing import Place
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.resources import SAMPLE_WINDS

NOAA = (
    Path(__file__).parents[3] / "shared" / "data" / "noaa"
)  # only where these files are beside the checkout
FIRST = datetime(2018, 10, 9)  # of the sample, which has fields every 3 h for SAMPLE_HOURS
SAMPLE_HOURS, EVERY = 39, 3  # [h]
STATIONS_FIRST = datetime(1993, 3, 12, 6)
MIDDLE = (37, -96)  # of the sample: latitude and longitude [deg]
SEA_HOURS = 240  # [h] of a current, every 6 h
SEA_NOISE = "wind.noise_min=0.05"  # [m/s]; the default is as fast as a glider
KM_A_DEGREE = 111.2
SINCE = {"units": f"hours since {FIRST:%Y-%m-%d %H:%M}", "standard_name": "time"}


@dataclass(frozen=True, slots=True)
class Wind:
    """One kind of wind.

    Attributes
    ----------
    write : callable
        Writes the files into a folder and returns the words of the command line, without the departure.
    hours : float
        Hours of wind after ``first``.
    at_end : bool
        Whether the mission departs 3 h before the last field, which is held.
    needs : Path or None
        Folder without which there are no such missions.
    """

    write: Callable[[np.random.Generator, Place, float, Path], list[str]]
    hours: float = SAMPLE_HOURS
    first: datetime = FIRST
    at_end: bool = False
    needs: Path | None = None

    def departure(self, rng: np.random.Generator, needed: float) -> str | None:
        """A departure, ISO 8601, with wind for ``needed`` hours; None if there is none."""
        last = self.hours - (EVERY if self.at_end else needed)
        if last < 0 or (self.at_end and needed > 48):
            return None
        lead = last if self.at_end else EVERY * int(rng.integers(0, int(last / EVERY) + 1))
        return f"{self.first + timedelta(hours=lead):%Y-%m-%dT%H:%M:%SZ}"


@lru_cache(maxsize=1)
def sample_table() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hours after ``FIRST`` (T,), places (N, 2) [deg: latitude, longitude] and winds (T, N, 2) [m/s]."""
    with SAMPLE_WINDS.open(newline="") as file:
        rows = list(csv.DictReader(file))
    stamps = sorted({row["time"] for row in rows})
    hours = np.array(
        [(datetime.fromisoformat(t).replace(tzinfo=None) - FIRST) / timedelta(hours=1) for t in stamps]
    )
    places = sorted({(float(row["lat"]), float(row["lon"])) for row in rows})
    winds = np.zeros((len(stamps), len(places), 2))
    for row in rows:
        at = stamps.index(row["time"]), places.index((float(row["lat"]), float(row["lon"])))
        winds[at] = float(row["u"]), float(row["v"])
    return hours, np.array(places), winds


def moved(place: Place) -> FloatArray:
    """The places (N, 2) of the sample [deg], moved to a map outside of it; within it, unchanged."""
    _, places, _ = sample_table()
    inside = 29 <= place.lat <= 46.5 and -119 <= place.lon <= -77
    shift = (0.0, 0.0) if inside else (round(place.lat) - MIDDLE[0], round(place.lon) - MIDDLE[1])
    return np.asarray(places + np.array(shift))


def _stamp(hour: float) -> str:
    return f"{FIRST + timedelta(hours=float(hour)):%Y-%m-%dT%H:%MZ}"


def _write_rows(path: Path, head: str, rows: list[str]) -> None:
    path.write_text("\n".join([head, *rows, ""]))


def _table(rng: np.random.Generator, place: Place, folder: Path, leads: bool) -> list[str]:
    """The moved sample as a table, with ``leads`` of a forecast that began 0 to 12 h before."""
    hours, _, winds = sample_table()
    begun = int(rng.integers(0, 13))
    rows = [
        f"{_stamp(hour)},{lat:g},{(lon + 180) % 360 - 180:g},{u:g},{v:g}"
        + (f",{hour + begun:g}" if leads else "")
        for hour, field in zip(hours, winds, strict=True)
        for (lat, lon), (u, v) in zip(moved(place), field, strict=True)
    ]
    _write_rows(folder / "wind.csv", "time,lat,lon,u,v" + (",lead_hours" if leads else ""), rows)
    return ["wind=csv", f"wind.path={folder / 'wind.csv'}", "wind.level=10m"]


def _forecast(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    return _table(rng, place, folder, True)


def _no_leads(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    return _table(rng, place, folder, False)


def _sample(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    return ["wind=sample", "wind.level=10m"]


def _held(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    return [*_forecast(rng, place, half, folder), "wind.hold_last=true", "wind.max_gap=48"]


def _calm(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    return ["wind=calm"]


def _grib(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    return ["wind=grib", f"wind.path='{NOAA / 'gfs_1p00_10m' / '*20181009*'}'", "wind.level=10m"]


def _stations(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    return ["wind=stations", f"wind.path={NOAA / 'metar' / 'SFC_obs.csv.gz'}", "wind.level=10m"]


def grid(place: Place, half: float, spacing: float, margin: float) -> tuple[FloatArray, FloatArray]:
    """Latitudes and longitudes [deg], ``spacing`` apart, to ``margin`` [deg] outside of a map."""
    tall = half / 1000.0 / KM_A_DEGREE
    wide = tall / np.cos(np.deg2rad(place.lat))
    lat = np.arange(np.floor(place.lat - tall - margin), place.lat + tall + margin, spacing)
    lon = np.arange(np.floor(place.lon - wide - margin), place.lon + wide + margin, spacing)
    return lat, lon


def _write_grid(
    path: Path, axes: dict[str, tuple[Any, dict[str, str]]], fields: dict[str, FloatArray]
) -> None:
    """A NetCDF file with one dimension for each axis; ``fields`` by their standard name [m/s]."""
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {name: len(values) for name, (values, _) in axes.items()}
        for name, (values, said) in axes.items():
            file.create_variable(name, (name,), data=values).attrs.update(said)
        start = file.create_variable("reftime", (), data=np.array(0.0))
        start.attrs.update(SINCE | {"standard_name": "forecast_reference_time"})
        for name, values in fields.items():
            made = file.create_variable(name, tuple(axes), data=values)
            made.attrs.update({"units": "m s-1", "standard_name": name})


def _plane_waves(rng: np.random.Generator, at: FloatArray, hours: FloatArray, members: int) -> FloatArray:
    """Sums of four slow waves of 6 to 20 degrees, (T, members, Y, X), with standard deviation 1."""
    angle, start = rng.uniform(0.0, 2.0 * np.pi, (2, members, 4))
    number = 2.0 * np.pi / rng.uniform(6.0, 20.0, (members, 4))
    along = at[:, :, None, None, 0] * np.cos(angle) + at[:, :, None, None, 1] * np.sin(angle)
    drift = rng.uniform(-0.1, 0.1, (members, 4)) * hours[:, None, None, None, None]
    waves = np.cos(number * along + drift + start).sum(axis=-1) / np.sqrt(2.0)
    return np.moveaxis(waves, -1, 1)


def _ensemble(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    """Five to ten members on a grid of one degree; their spread is 0.4 m/s, plus 0.05 m/s an hour."""
    hours, _, winds = sample_table()
    lat, lon = grid(place, half, 1.0, 4.0)
    at = np.stack(np.meshgrid(lat, lon, indexing="ij"), axis=-1)
    near = (((at[:, :, None] - moved(place)) ** 2).sum(axis=-1) + 0.5) ** -2  # inverse distance
    mean = np.einsum("yxn,tnc->ctyx", near / near.sum(axis=-1, keepdims=True), winds)
    members, spread = int(rng.integers(5, 11)), (0.4 + 0.05 * hours)[:, None, None, None]
    u, v = (part[:, None] + spread * _plane_waves(rng, at, hours, members) for part in mean)
    axes = {
        "time": (hours, SINCE),
        "member": (np.arange(members), {"standard_name": "realization"}),
        "lat": (lat, {"units": "degrees_north"}),
        "lon": (lon, {"units": "degrees_east"}),
    }
    _write_grid(
        folder / "members.nc", axes, {"eastward_wind": u.astype("f4"), "northward_wind": v.astype("f4")}
    )
    return ["wind=ensemble", f"wind.path={folder / 'members.nc'}", "wind.level=10m"]


def sea(rng: np.random.Generator, place: Place, half: float, at: FloatArray, hours: FloatArray) -> FloatArray:
    """A current (T, P, 2) [m/s] at places ``at`` (P, 2) [deg: latitude, longitude].

    A jet of at most 0.2 m/s across the map, a ring of at most 0.15 m/s that drifts, and a flow of 0.05 m/s
    that turns once in four days.
    """
    scale = half / 1000.0  # [km]
    north = KM_A_DEGREE * (at[:, 0] - place.lat)[None] / scale
    east = KM_A_DEGREE * np.cos(np.deg2rad(place.lat)) * (at[:, 1] - place.lon)[None] / scale
    days, angle = hours[:, None] / 24.0, rng.uniform(0, 2 * np.pi)
    across = -np.sin(angle) * east + np.cos(angle) * north + rng.uniform(-0.5, 0.5)
    jet = rng.uniform(0.1, 0.2) * np.exp(-((across / 0.5) ** 2))
    x, y = east - rng.uniform(-0.6, 0.6) + 0.1 * days, north - rng.uniform(-0.6, 0.6)
    spin = rng.uniform(0.05, 0.15) * np.exp(0.5 - (x**2 + y**2) / 0.5) / 0.5
    turn = 2.0 * np.pi * days / 4.0 + rng.uniform(0, 2 * np.pi)
    u = jet * np.cos(angle) + spin * y + 0.05 * np.cos(turn)
    v = jet * np.sin(angle) - spin * x - 0.05 * np.sin(turn)
    return np.stack(np.broadcast_arrays(u, v), axis=-1)


def _sea_nodes(place: Place, half: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    lat, lon = grid(place, half, max(0.05, half / 1000.0 / KM_A_DEGREE / 4.0), 0.3)
    return lat, lon, np.stack(np.meshgrid(lat, lon, indexing="ij"), axis=-1).reshape(-1, 2)


def _current_table(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    hours, (_, _, nodes) = np.arange(0.0, SEA_HOURS + 1, 6.0), _sea_nodes(place, half)
    rows = [
        f"{_stamp(hour)},{lat:.4f},{lon:.4f},{u:.3f},{v:.3f}"
        for hour, field in zip(hours, sea(rng, place, half, nodes, hours), strict=True)
        for (lat, lon), (u, v) in zip(nodes, field, strict=True)
    ]
    _write_rows(folder / "current.csv", "time,lat,lon,u,v", rows)
    words = [
        "wind=csv",
        f"wind.path={folder / 'current.csv'}",
        "wind.forecast_error=none",
        "wind.max_speed=3",
    ]
    return [*words, SEA_NOISE]


def _current_file(rng: np.random.Generator, place: Place, half: float, folder: Path) -> list[str]:
    """The current as a file of an ocean model, at three depths, slower below."""
    hours, (lat, lon, nodes) = np.arange(0.0, SEA_HOURS + 1, 6.0), _sea_nodes(place, half)
    depths = np.array([0.5, 100.0, 200.0])
    flow = sea(rng, place, half, nodes, hours).reshape(len(hours), 1, len(lat), len(lon), 2)
    slower = np.array([1.2, 1.0, 0.6])[None, :, None, None, None]
    axes = {
        "time": (hours, SINCE),
        "depth": (depths, {"units": "m", "positive": "down", "standard_name": "depth"}),
        "lat": (lat, {"units": "degrees_north"}),
        "lon": (lon, {"units": "degrees_east"}),
    }
    u, v = np.moveaxis((slower * flow).astype("f4"), -1, 0)
    names = "eastward_sea_water_velocity", "northward_sea_water_velocity"
    _write_grid(folder / "current.nc", axes, dict(zip(names, (u, v), strict=True)))
    return ["wind=currents", f"wind.path={folder / 'current.nc'}", SEA_NOISE]


WINDS = {
    "sample": Wind(_sample),
    "forecast": Wind(_forecast),
    "no leads": Wind(_no_leads),
    "held": Wind(_held, at_end=True),
    "calm": Wind(_calm),
    "ensemble": Wind(_ensemble),
    "current table": Wind(_current_table, SEA_HOURS),
    "current file": Wind(_current_file, SEA_HOURS),
    "grib": Wind(_grib, hours=21, needs=NOAA),
    "stations": Wind(_stations, hours=10, first=STATIONS_FIRST, needs=NOAA),
}
