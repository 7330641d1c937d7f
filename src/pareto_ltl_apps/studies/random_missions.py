"""Random missions at real places, and the full fields of the winds in which they are flown.

A mission has a place, a departure, three regions, a few obstacles and a formula. Each has a separate random
generator, so that mission 17 does not depend on the number of missions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import numpy as np
from numpy.random import Generator, SeedSequence

from careful_io.times import iso, seconds
from flight_quantities.sphere import wrap_longitude
from pareto_ltl import Readings, Scene, WindField
from pareto_ltl.extend import Frame, WindConfig
from pareto_ltl.support.arrays import FloatArray, rotate_vectors
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.file_formats import is_data_file
from pareto_ltl.support.resources import checkout
from pareto_ltl_apps.studies.settings import ForecastTestConfig
from wind_laws.lattice import wind_lattice

REGIONS = ("a", "b", "c")
TABLES = (".npz", ".nc", ".csv")
SPAN = 48 * 3600.0  # [s] errors of days further apart hardly correlate
SAME_MAP, DELAY_DRAW = 2**31, 1  # of the generators of the one map, and of a mission's delay
# A box of latitude and longitude [deg] whose held fields have errors that hardly correlate with the next one:
# 0.31 within 1,500 km, 0.06 to 2,500 km (GFS and ERA5).
BOX = (12.0, 24.0)
REGION, OBSTACLE = (0.06, 0.11), (0.05, 0.13)  # radii in sides of the map
APART, ASIDE = 0.05, 0.02  # free space around regions and the start, and between obstacles, in sides
TRIES = 2000  # places tried for a polygon before a new map is begun
BESIDE_CHECKOUT = Path("shared", "data", "noaa", "gfs_1p00_10m")
NEAR = 20.0  # nodes farther from the centre of the scene are not used if they form no grid [deg]

# --- the full fields -------------------------------------------------------------------------


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
    """The GRIB2 files of the full fields, of the folder in the settings or beside the checkout; or the table.

    Raises
    ------
    ConfigError
        If there is no such folder.
    DataError
        If it holds no GRIB2 file.
    """
    root = checkout()
    beside = None if root is None else root.parent / BESIDE_CHECKOUT
    folder = beside if cfg.truth is None else Path(cfg.truth).expanduser()
    if folder is not None and folder.is_file() and folder.suffix in TABLES:
        return (folder,)
    if folder is None or not folder.is_dir():
        raise ConfigError(
            f"{cfg.section}.truth is missing: name a folder of GRIB2 files with 10 m winds every few hours, "
            f"e.g. GFS 1-degree analyses ({cfg.section}.truth=DIR)"
            if cfg.truth is None
            else f"{cfg.section}.truth={cfg.truth}: there is no such folder; name one with GRIB2 files, or a "
            f"table ({', '.join(TABLES)})"
        )
    files = tuple(sorted(f for f in folder.iterdir() if f.is_file() and is_data_file(f)))
    if not files:
        raise DataError(f"{cfg.section}.truth={cfg.truth or folder}: the folder holds no GRIB2 file")
    return files


def spells(readings: Readings, cfg: ForecastTestConfig) -> list[Spell]:
    """Runs of fields at most ``max_gap`` apart that are long enough for a mission."""
    times = readings.times
    breaks = np.flatnonzero(np.diff(times) > cfg.max_gap * 3600 + 1)
    pieces = np.split(np.arange(len(times)), breaks + 1)
    found = [Spell(int(i[0]), int(i[-1]), float(times[i[0]]), float(times[i[-1]])) for i in pieces]
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
    lattice = wind_lattice(scene.bounds, cfg.spacing, wind_cfg.padding)
    times = flight_times(cfg, readings, scene)
    table = at_times(readings, scene, times, lattice.nodes()).reshape(len(times), *lattice.shape, 2)
    slots = np.abs(believed.times[None] - times[:, None]).argmin(axis=1)
    gusts = cfg.gusts**2 * believed.gust_var[slots]
    return WindField(
        origin=lattice.origin, spacing=lattice.spacing, times=times, mean=table,
        latent_var=np.zeros_like(table), gust_var=gusts, source="full fields",
    )  # fmt: skip


def flight_times(cfg: ForecastTestConfig, readings: Readings, scene: Scene) -> FloatArray:
    """Times of the fields that a flight can meet, from the last one at or before departure [s since then]."""
    times = readings.times - seconds(str(scene.time_zero))
    first = max(int(np.searchsorted(times, 0.0, side="right")) - 1, 0)
    last = int(np.searchsorted(times, 3600 * cfg.hours))
    return np.asarray(times[first : last + 1], float)


def at_times(readings: Readings, scene: Scene, times: FloatArray, points: FloatArray) -> FloatArray:
    """Winds (K, N, 2) in the plane at ``points`` (N, 2) [m] and ``times`` (K,) [s since departure]."""
    crs, zero = str(scene.crs), seconds(str(scene.time_zero))
    lon, lat = Frame(crs).to_geographic(points)
    angle = Frame(crs).convergence(lon, lat)
    middle = float(Frame(crs).to_geographic(scene.bounds.mean(axis=0))[0][0])
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
        fields.append(rotate_vectors(earth, angle))
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


# --- missions --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Mission:
    """A random map with its formula, in a period of consecutive wind fields."""

    number: int
    scene: Scene
    formula: str
    spell: Spell
    latitude: float
    longitude: float
    situation: str = ""  # the weather that it shares with others
    delay: float = 0.0  # age at departure of the newest forecast that planning may use [h]


def mission(
    cfg: ForecastTestConfig, seed: int, number: int, spells: Sequence[Spell], border: str = "open"
) -> Mission:
    """Mission ``number`` of seed ``seed`` on a map with the given ``border``."""
    rng = generator_of(cfg, seed, number)
    spell, departure = departure_of(cfg, rng, spells)
    lon, lat = _place(cfg, rng)
    if cfg.same_map:
        rng = generator_of(cfg, seed, SAME_MAP)
    formula = formula_of(cfg, rng)
    side = float(rng.uniform(cfg.side[0], cfg.side[1]))
    scene = None
    while scene is None:
        scene = random_scene(cfg, rng, side, str(Frame.at(lat, lon).crs), iso(departure))
    situation = situation_of(cfg, spell, departure, lon, lat)
    delay = delay_of(cfg, seed, number)
    return Mission(number, replace(scene, border=border), formula, spell, lat, lon, situation, delay)


def generator_of(cfg: ForecastTestConfig, seed: int, *numbers: int) -> Generator:
    """The random generator of a mission, or of one of its draws."""
    return np.random.default_rng(SeedSequence(seed, spawn_key=(crc32(cfg.section.encode()), *numbers)))


def formula_of(cfg: ForecastTestConfig, rng: Generator) -> str:
    """A random one of the formulas."""
    return str(cfg.formulas[int(rng.integers(len(cfg.formulas)))])


def delay_of(cfg: ForecastTestConfig, seed: int, number: int) -> float:
    """Age of the newest known forecast at the departure of mission ``number`` [h]."""
    if cfg.delay_most is None:
        return cfg.delay
    return float(generator_of(cfg, seed, number, DELAY_DRAW).uniform(cfg.delay, cfg.delay_most))


def situation_of(cfg: ForecastTestConfig, spell: Spell, departure: float, lon: float, lat: float) -> str:
    """The name of the weather that a mission shares with others, by ``cfg.situations``."""
    if cfg.situations in ("auto", "period"):
        return spell.name
    span = iso(departure // SPAN * SPAN)[:10]
    if cfg.situations == "days":
        return span
    south, west = BOX[0] * np.floor(lat / BOX[0]), BOX[1] * np.floor(lon / BOX[1])
    return f"{span} {south:+.0f} {west:+.0f}"


def departure_of(cfg: ForecastTestConfig, rng: Generator, spells: Sequence[Spell]) -> tuple[Spell, float]:
    """A random full hour after ``wait`` with wind for ``hours`` from then on; all are equally likely."""
    counts = np.array([int((s.end - s.start) / 3600 - cfg.wait - cfg.hours) + 1 for s in spells])
    pick = int(rng.integers(counts.sum()))
    k = int(np.searchsorted(np.cumsum(counts), pick, side="right"))
    hour = pick - int(counts[:k].sum())
    return spells[k], spells[k].start + 3600.0 * (cfg.wait + hour)


def _place(cfg: ForecastTestConfig, rng: Generator) -> tuple[float, float]:
    """A random point of the area (longitude, latitude) [deg], uniform on its surface."""
    import shapely

    area = shapely.Polygon(cfg.area)
    west, south, east, north = area.bounds
    low, high = np.sin(np.deg2rad([south, north]))
    while True:
        lon, lat = float(rng.uniform(west, east)), float(np.rad2deg(np.arcsin(rng.uniform(low, high))))
        if shapely.contains_xy(area, lon, lat):
            return lon, lat


def random_scene(
    cfg: ForecastTestConfig, rng: Generator, side: float, crs: str, time_zero: str,
    places: FloatArray | None = None,
) -> Scene | None:  # fmt: skip
    """Regions, start and obstacles at a distance from one another; None if there is not enough space.

    The start and the first regions are at ``places`` (n, 2) [m]; without these, they are random.
    """
    import shapely

    bounds = side / 2 * np.array([[-1.0, -1.0], [1.0, 1.0]])
    room = shapely.box(*(bounds * (1 - 2 * ASIDE)).ravel())
    taken: list[shapely.Geometry] = []

    def put(radius: tuple[float, float], middle: FloatArray | None = None) -> FloatArray | None:
        for _ in range(TRIES if middle is None else TRIES // 100):
            outline = polygon(rng, side * rng.uniform(*radius))
            corners: FloatArray = outline + (rng.uniform(bounds[0], bounds[1]) if middle is None else middle)
            shape = shapely.Polygon(corners)
            if room.contains(shape) and all(shape.distance(other) >= APART * side for other in taken):
                taken.append(shape)
                return corners
        return None

    start = rng.uniform(0.9 * bounds[0], 0.9 * bounds[1]) if places is None else places[0]
    taken.append(shapely.Point(start))
    middles = [None] * len(REGIONS) if places is None else [*places[1:], *[None] * (4 - len(places))]
    shapes = [put(REGION, middle) for middle in middles]
    shapes += [put(OBSTACLE) for _ in range(int(rng.integers(cfg.obstacles[0], cfg.obstacles[1] + 1)))]
    placed = [shape for shape in shapes if shape is not None]
    if len(placed) < len(shapes):
        return None
    regions = {name: (shape,) for name, shape in zip(REGIONS, placed, strict=False)}
    return Scene(bounds, start, regions, tuple(placed[len(REGIONS) :]), crs, time_zero)


def polygon(rng: Generator, radius: float) -> FloatArray:
    """Convex, counter-clockwise, 4 to 7 corners on a circle about the origin, (n, 2)."""
    n = int(rng.integers(4, 8))
    angle = (np.arange(n) + rng.uniform(-0.3, 0.3, n)) * 2 * np.pi / n + rng.uniform(0, 2 * np.pi)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
