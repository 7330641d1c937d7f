"""Real winds for flights: full fields from GRIB files, in the plane of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pareto_ltl.settings import ForecastTestConfig, WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.resources import checkout
from pareto_ltl.wind import field as lattices
from pareto_ltl.wind import sources
from pareto_ltl.wind.readings import Readings, iso, seconds, wrap_longitude
from pareto_ltl.wind.records import WindField
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene

BESIDE_CHECKOUT = Path("shared", "data", "noaa", "gfs_1p00_10m")
NEAR = 20.0  # nodes farther from the centre of the scene are not used if they form no grid [deg]


@dataclass(frozen=True, slots=True)
class Spell:
    """Consecutive fields without a gap: indices ``first`` to ``last`` of the readings."""

    first: int
    last: int
    start: float  # [s since 1970]
    end: float

    @property
    def name(self) -> str:
        """Date and hour of its start."""
        return iso(self.start).replace(":", "").replace("-", "")[:11]


def full_fields(cfg: ForecastTestConfig) -> tuple[Path, ...]:
    """The GRIB2 files of the full fields: of the folder in the settings, or beside the checkout.

    Raises
    ------
    ConfigError
        If there is no such folder.
    DataError
        If it holds no GRIB2 file.
    """
    folder = _folder(cfg)
    files = tuple(sorted(f for f in folder.iterdir() if f.is_file() and sources.is_data_file(f)))
    if not files:
        raise DataError(f"{cfg.section}.truth={cfg.truth or folder}: the folder holds no GRIB2 file")
    return files


def _folder(cfg: ForecastTestConfig) -> Path:
    if cfg.truth is not None:
        place = Path(cfg.truth).expanduser()
        if not place.is_dir():
            raise ConfigError(
                f"{cfg.section}.truth={cfg.truth}: there is no such folder; name one with GRIB2 files"
            )
        return place
    root = checkout()
    if root is not None and (root.parent / BESIDE_CHECKOUT).is_dir():
        return root.parent / BESIDE_CHECKOUT
    raise ConfigError(
        f"{cfg.section}.truth is missing: name a folder of GRIB2 files with 10 m winds every few hours, e.g. "
        f"GFS 1-degree analyses ({cfg.section}.truth=DIR)"
    )


def spells(readings: Readings, cfg: ForecastTestConfig) -> list[Spell]:
    """Runs of fields at most ``max_gap`` apart that are long enough for a mission."""
    times = readings.times
    breaks = np.flatnonzero(np.diff(times) > cfg.max_gap * 3600 + 1)
    firsts, lasts = np.concatenate([[0], breaks + 1]), np.concatenate([breaks, [len(times) - 1]])
    found = [
        Spell(int(i), int(j), float(times[i]), float(times[j])) for i, j in zip(firsts, lasts, strict=True)
    ]
    needed = cfg.wait + cfg.hours
    long = [spell for spell in found if spell.end - spell.start >= needed * 3600]
    if not long:
        longest = max(spell.end - spell.start for spell in found) / 3600
        raise DataError(
            f"{cfg.section}.truth holds no period of {needed:g} h without a gap of more than "
            f"{cfg.max_gap:g} h (the longest has {longest:g} h): lower {cfg.section}.hours, raise "
            f"{cfg.section}.max_gap, or add fields"
        )
    return long


def real_wind(
    cfg: ForecastTestConfig, wind_cfg: WindConfig, readings: Readings, scene: Scene, believed: WindField
) -> WindField:
    """The full fields over ``scene`` from departure on, with the white part of ``believed`` as gusts.

    There is no other uncertainty. Fields are interpolated bilinearly between the nodes of their grid and
    rotated by the meridian convergence. Gusts at a field's time are taken from the nearest slot of
    ``believed``.
    """
    import dataclasses

    fine = dataclasses.replace(wind_cfg, spacing=cfg.spacing)
    origin, spacing, shape = lattices.wind_lattice(fine, scene)
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2)
    times = flight_times(cfg, readings, scene)
    table = at_times(readings, scene, times, origin + spacing * nodes).reshape(len(times), *shape, 2)
    slots = np.abs(believed.times[None] - times[:, None]).argmin(axis=1)
    return WindField(
        origin=origin,
        spacing=spacing,
        times=times,
        mean=table,
        latent_var=np.zeros_like(table),
        gust_var=cfg.gusts**2 * believed.gust_var[slots],
        source="full fields",
    )


def flight_times(cfg: ForecastTestConfig, readings: Readings, scene: Scene) -> FloatArray:
    """Times of the fields that a flight can meet, from the last one at or before departure [s since then]."""
    times = readings.times - seconds(str(scene.time_zero))
    first = max(int(np.searchsorted(times, 0.0, side="right")) - 1, 0)
    last = int(np.searchsorted(times, 3600 * cfg.hours))
    return np.asarray(times[first : last + 1], float)


def at_times(readings: Readings, scene: Scene, times: FloatArray, points: FloatArray) -> FloatArray:
    """Winds (K, N, 2) in the plane at ``points`` (N, 2) [m] and ``times`` (K,) [s since departure]."""
    crs, zero = str(scene.crs), seconds(str(scene.time_zero))
    lon, lat = projection.to_geographic(crs, points)
    angle = projection.meridian_convergence(crs, lon, lat)
    middle = float(projection.to_geographic(crs, scene.bounds.mean(axis=0))[0][0])
    fields = []
    for t in times:
        k = int(np.argmin(np.abs(readings.times - (zero + t))))
        if abs(readings.times[k] - (zero + t)) > 1.0:
            raise DataError(f"the full fields have no value at {iso(zero + float(t))}")
        earth = interpolated(readings.points[k], readings.winds[k], lon, lat, middle)
        if not np.isfinite(earth).all():
            raise DataError(
                f"the full fields at {iso(readings.times[k])} do not cover the scene around longitude "
                f"{middle:.1f}; move the area of the missions inside them"
            )
        fields.append(projection.rotate_vectors(earth, angle))
    return np.stack(fields)


def interpolated(
    nodes: FloatArray, winds: FloatArray, lon: FloatArray, lat: FloatArray, middle: float
) -> FloatArray:
    """``winds`` (M, 2) at ``nodes`` (M, 2) [deg] read at places (N,).

    Bilinear on a latitude-longitude grid, linear on triangles otherwise. Longitudes count from ``middle``, so
    that grids may wrap anywhere.
    """
    from scipy.interpolate import LinearNDInterpolator, RegularGridInterpolator

    east, there = wrap_longitude(nodes[:, 0] - middle), np.stack([wrap_longitude(lon - middle), lat], axis=-1)
    columns, i = np.unique(np.round(east, 6), return_inverse=True)
    rows, j = np.unique(np.round(nodes[:, 1], 6), return_inverse=True)
    if len(columns) * len(rows) == len(nodes):
        table = np.full((len(columns), len(rows), 2), np.nan)
        table[i, j] = winds
        grid = RegularGridInterpolator((columns, rows), table, bounds_error=False)
        return np.asarray(grid(there), float)
    near = np.hypot(east, nodes[:, 1] - lat.mean()) < NEAR
    if near.sum() < 3:
        return np.full((len(lon), 2), np.nan)
    corners = np.stack([east[near], nodes[near, 1]], axis=-1)
    return np.asarray(LinearNDInterpolator(corners, winds[near])(there), float)
