"""Wind readings from files, turned into the plane and the clock of a scene.

``SOURCES`` is the table of sources; ``read_readings`` and ``place_readings`` are the stages that make
readings and observations; ``write_wind_table`` writes a small table from large files.
"""

from __future__ import annotations

import glob
import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pareto_ltl.settings import IngestConfig, WindConfig
from pareto_ltl.support import extensions
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.extensions import known_kind
from pareto_ltl.wind import csv_table, grib
from pareto_ltl.wind.readings import CALM, Readings, farthest_points, iso, on_sphere, seconds
from pareto_ltl.wind.records import WindObservations
from pareto_ltl.world.scene import Scene

SAMPLE = Path(__file__).parents[1] / "support" / "data" / "gfs_conus_20181009.csv"
ENOUGH = 5  # readings near the scene, at each time
NEARBY = 500e3  # [m]; about one correlation length of 10 m wind over land
HORIZON = np.deg2rad(45.0)  # readings farther round the Earth say nothing here, and planes distort


def data_files(cfg: WindConfig) -> tuple[Path, ...]:
    """The files that ``wind.path`` names: a file, all data files of a folder, or a pattern."""
    path = Path(str(cfg.path)).expanduser()
    if path.is_dir():
        wanted = "*.csv" if cfg.source == "csv" else "*"
        found = [file for file in path.glob(wanted) if file.is_file() and is_data_file(file)]
    elif path.is_file():
        found = [path]
    else:
        found = [Path(name) for name in glob.glob(str(path), recursive=True) if Path(name).is_file()]
    if not found:
        raise DataError(f"wind.path={cfg.path}: no {cfg.source} file, folder or pattern of that name")
    return tuple(sorted(found))


def is_data_file(file: Path) -> bool:
    return not file.name.startswith(".") and file.suffix.lower() not in (".idx", ".md", ".txt", ".json")


@dataclass(frozen=True, slots=True)
class WindSource:
    """One value of ``wind.source``.

    Attributes
    ----------
    read : callable
        From the settings of the wind to :class:`Readings`, every value checked; raises ``DataError``.
    files : callable
        The files that ``read`` opens, for the records of a run; raises ``DataError``.
    """

    read: Callable[[WindConfig], Readings]
    files: Callable[[WindConfig], tuple[Path, ...]]


def _sample_files(cfg: WindConfig) -> tuple[Path, ...]:
    return (SAMPLE,)


def _no_files(cfg: WindConfig) -> tuple[Path, ...]:
    return ()


def _read_sample(cfg: WindConfig) -> Readings:
    return csv_table.read(_sample_files(cfg), cfg.max_speed)


def _read_csv(cfg: WindConfig) -> Readings:
    return csv_table.read(data_files(cfg), cfg.max_speed)


def _read_grib(cfg: WindConfig) -> Readings:
    return grib.read(data_files(cfg), cfg.max_speed)


def _read_calm(cfg: WindConfig) -> Readings:
    return CALM


SOURCES = {
    "sample": WindSource(_read_sample, _sample_files),
    "csv": WindSource(_read_csv, data_files),
    "grib": WindSource(_read_grib, data_files),
    "calm": WindSource(_read_calm, _no_files),
}


def wind_source(cfg: WindConfig) -> WindSource:
    """The source that ``wind.source`` names: one of ``SOURCES``, or one of another package."""

    def expected(loaded: object) -> bool:
        return isinstance(loaded, WindSource)

    return known_kind(extensions.WIND_SOURCE_GROUP, SOURCES, cfg.source, expected)


def read_readings(cfg: WindConfig) -> Readings:
    """All readings of the source, each file read once; no times in calm wind."""
    return wind_source(cfg).read(cfg)


def place_readings(cfg: WindConfig, readings: Readings, scene: Scene) -> WindObservations:
    """Wind readings in the plane of ``scene``, from the last time at or before departure onwards.

    Earth-relative winds are turned by the meridian convergence; their length stays that on the ground.
    Calm wind is one time without readings.
    """
    if not len(readings.times):
        return WindObservations(np.zeros(1), (np.empty((0, 2)),), (np.empty((0, 2)),), cfg.source)
    _refuse_other_frame(readings, scene)
    zero = _departure_time(scene, readings)
    kept = _slots(cfg, readings, zero)
    placed = [_placed_slot(cfg, scene, readings, k) for k in kept]
    return WindObservations(
        times=readings.times[kept] - zero,
        points=tuple(points for points, _ in placed),
        winds=tuple(winds for _, winds in placed),
        source=f"{cfg.source}: {', '.join(file.name for file in readings.files[:8])}"
        + (f" and {len(readings.files) - 8} more" if len(readings.files) > 8 else ""),
    )


def write_wind_table(cfg: WindConfig, readings: Readings, ingest: IngestConfig, out: Path) -> Path:
    """Write ``ingest.points`` nodes of geographic readings as a table, and beside it where it came from.

    The nodes are the same at all times: those inside ``ingest.area`` that every time has, thinned by
    farthest-point sampling from the middle of the area. ``out.json`` names the source files by SHA-256.
    Returns ``out``.
    """
    if not len(readings.times):
        raise DataError(f"wind.source={cfg.source} holds no readings; ingest needs wind files (wind=grib)")
    if not readings.geographic:
        raise DataError(f"{readings.name} has x,y columns; ingest expects latitude and longitude")
    kept = _between(readings, ingest)
    nodes = common_nodes(readings, kept, ingest)
    winds = np.stack([winds_at(readings, k, nodes) for k in kept])
    csv_table.write(out, readings.times[kept], nodes, winds)
    text = json.dumps(_provenance(cfg, ingest, readings, kept, nodes), indent=1, ensure_ascii=False)
    csv_table.replace_text(out.with_suffix(".json"), text + "\n")
    return out


def _refuse_other_frame(readings: Readings, scene: Scene) -> None:
    if readings.geographic and scene.crs is None:
        raise DataError(
            f"{readings.name} is in degrees but the scene lies nowhere on Earth; set scene.centre "
            "(latitude, longitude), or use wind.source=csv with columns time,x,y,u,v or wind.source=calm"
        )


def _departure_time(scene: Scene, readings: Readings) -> float:
    """Departure [s since 1970]."""
    if scene.time_zero is None:
        return float(readings.times[0])
    try:
        return seconds(scene.time_zero)
    except ValueError:
        raise ConfigError(
            f"mission.start_time {scene.time_zero!r} is no ISO 8601 time; expected e.g. 2018-10-09T18:00:00Z"
        ) from None


def _slots(cfg: WindConfig, readings: Readings, zero: float) -> IntArray:
    """Indices of the times that matter from departure onwards."""
    times = readings.times
    spell = f"{iso(times[0])} .. {iso(times[-1])}"
    name = readings.name
    if len(times) == 1 and not cfg.hold_last:
        raise DataError(
            f"{name} holds one wind time only ({iso(times[0])}), which covers no flight; "
            "add later times, or let it stand for all with wind.hold_last=true"
        )
    if zero < times[0] or (zero >= times[-1] and not cfg.hold_last):
        raise DataError(
            f"departure {iso(zero)} is not covered by the wind of {name} ({spell}); "
            "choose mission.start_time inside, or add wind files"
        )
    start = int(np.searchsorted(times, zero, side="right")) - 1
    return np.arange(start, len(times))


def _placed_slot(cfg: WindConfig, scene: Scene, readings: Readings, k: int) -> tuple[FloatArray, FloatArray]:
    """Positions [m] and winds [m/s] in the plane, at most ``wind.max_points`` of time k."""
    points, winds = readings.points[k], readings.winds[k]
    reach = max(cfg.padding, float(np.max(scene.bounds[1] - scene.bounds[0])))
    if readings.geographic:
        points, winds = _project(str(scene.crs), scene.bounds.mean(axis=0), points, winds)
        reach = max(cfg.padding, NEARBY)
    gap = _distance_to(scene.bounds, points)
    near = int(np.sum(gap <= reach))
    if near < ENOUGH:
        raise DataError(
            f"{readings.name}: {near} wind readings within {reach / 1e3:g} km of the scene at "
            f"{iso(readings.times[k])}, expected at least {ENOUGH}; is the scene where the wind data is?"
        )
    chosen = _thinned_rows(cfg, scene.bounds.mean(axis=0), points, gap)
    return points[chosen], winds[chosen]


def _project(
    crs: str, centre: FloatArray, lonlat: FloatArray, winds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Readings within ``HORIZON`` of the scene's centre, in its plane."""
    from pareto_ltl.world import projection

    middle = on_sphere(np.stack(projection.to_geographic(crs, centre), axis=1))
    close = (on_sphere(lonlat) @ middle.T).ravel() >= np.cos(HORIZON)
    lon, lat = lonlat[close].T
    if not len(lon):
        return np.empty((0, 2)), np.empty((0, 2))
    turned = projection.turn(winds[close], projection.convergence(crs, lon, lat))
    return projection.to_plane(crs, lon, lat), turned


def _distance_to(bounds: FloatArray, points: FloatArray) -> FloatArray:
    """Distance (N,) from ``points`` to the rectangle ``bounds``, 0 inside [m]."""
    outside = np.maximum(0.0, np.maximum(bounds[0] - points, points - bounds[1]))
    distance: FloatArray = np.hypot(outside[:, 0], outside[:, 1])
    return distance


def _thinned_rows(cfg: WindConfig, centre: FloatArray, points: FloatArray, gap: FloatArray) -> IntArray:
    """Which readings the fit uses: all, or an even spread inside the lattice, or the nearest."""
    if len(points) <= cfg.max_points:
        return np.arange(len(points))
    inside = np.flatnonzero(gap <= cfg.padding)
    if len(inside) < cfg.max_points:
        return np.sort(np.argsort(gap, kind="stable")[: cfg.max_points])
    first = int(np.argmin(np.sum((points[inside] - centre) ** 2, axis=1)))
    return np.sort(inside[farthest_points(points[inside], cfg.max_points, first)])


def _between(readings: Readings, ingest: IngestConfig) -> IntArray:
    limits = []
    for key, text, default in (("first", ingest.first, -np.inf), ("last", ingest.last, np.inf)):
        try:
            limits.append(default if text is None else seconds(text))
        except ValueError:
            raise ConfigError(
                f"ingest.{key} {text!r} is no ISO 8601 time; expected e.g. 2018-10-09T00:00:00Z"
            ) from None
    kept = np.flatnonzero((readings.times >= limits[0]) & (readings.times <= limits[1]))
    if not len(kept):
        spell = f"{iso(readings.times[0])} .. {iso(readings.times[-1])}"
        raise DataError(f"no wind time between ingest.first and ingest.last; the source has {spell}")
    return kept


def common_nodes(readings: Readings, kept: IntArray, ingest: IngestConfig) -> FloatArray:
    """Nodes (N, 2) [deg] inside the area that every kept time has, thinned, from north-west to south-east."""
    common = set(map(tuple, readings.points[kept[0]].tolist()))
    for k in kept[1:]:
        common &= set(map(tuple, readings.points[k].tolist()))
    nodes = np.array(sorted(common), dtype=float).reshape(-1, 2)
    if ingest.area:
        import shapely

        nodes = nodes[shapely.contains_xy(shapely.Polygon(ingest.area), nodes)]
    if len(nodes) < ENOUGH:
        raise DataError(
            f"{len(nodes)} wind nodes lie in ingest.area at every time, expected at least {ENOUGH}; "
            "check the outline ([longitude, latitude], west negative) and that all files share one grid"
        )
    sphere = on_sphere(nodes)
    first = int(np.argmax(sphere @ sphere.mean(axis=0)))
    chosen = nodes[farthest_points(sphere, ingest.points, first)]
    return chosen[np.lexsort((chosen[:, 0], -chosen[:, 1]))]


def winds_at(readings: Readings, k: int, nodes: FloatArray) -> FloatArray:
    """Winds (N, 2) of time k at ``nodes``, which it has."""
    rows = {(lon, lat): i for i, (lon, lat) in enumerate(readings.points[k].tolist())}
    return readings.winds[k][[rows[lon, lat] for lon, lat in nodes.tolist()]]


def _provenance(
    cfg: WindConfig, ingest: IngestConfig, readings: Readings, kept: IntArray, nodes: FloatArray
) -> dict[str, object]:
    files = {file: None for k in kept for file in readings.origins[k]}
    return {
        "columns": {
            "time": "valid time, ISO 8601 UTC",
            "lat, lon": "degrees, west negative",
            "u, v": "wind towards east and north, earth-relative, 10 m above ground, m/s, rounded to 0.01",
        },
        "source": "US National Oceanic and Atmospheric Administration (NOAA), public domain (17 U.S.C. 105); "
        "a selection, not an official NOAA product",
        "kind": cfg.source,
        "times": {iso(readings.times[k]): readings.remarks[k] for k in kept},
        "points": len(nodes),
        "selection": "the same nodes at all times: farthest-point sampling (great circle) of the nodes inside"
        " the area, from the one nearest to their middle; no interpolation",
        "area": ", ".join(f"{lon:g} {lat:g}" for lon, lat in ingest.area),
        "files": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
    }
