"""Wind readings from files, turned into the plane and the clock of a scene.

``observations`` is the stage; ``ingest`` writes a small table from large files; ``first_time`` is the
default departure.
"""

from __future__ import annotations

import glob
import json
from pathlib import Path

import numpy as np

from pareto_ltl.settings import IngestConfig, WindConfig
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.files import write_text
from pareto_ltl.support.fingerprints import file_fingerprint
from pareto_ltl.wind import csv_table as table
from pareto_ltl.wind import grib
from pareto_ltl.wind.readings import Readings, farthest_points, iso, on_sphere, seconds
from pareto_ltl.wind.records import WindObservations
from pareto_ltl.world.scene import Scene

SAMPLE = Path(__file__).parents[1] / "support" / "data" / "gfs_conus_20181009.csv"
ENOUGH = 5  # readings near the scene, at each time
NEAR = 500e3  # [m]; about one correlation length of 10 m wind over land
HORIZON = np.deg2rad(45.0)  # readings farther round the Earth say nothing here, and planes distort


def observations(cfg: WindConfig, scene: Scene) -> WindObservations:
    """Wind readings in the plane of ``scene``, from the last time at or before departure onwards.

    Earth-relative winds are turned by the meridian convergence; their length stays that on the ground.
    Calm wind is one time without readings.
    """
    if cfg.source == "calm":
        return WindObservations(np.zeros(1), (np.empty((0, 2)),), (np.empty((0, 2)),), "calm")
    readings = _read(cfg)
    _refuse_other_frame(readings, scene)
    zero = _departure(scene, readings)
    kept = _slots(cfg, readings, zero)
    placed = [_place(cfg, scene, readings, k) for k in kept]
    return WindObservations(
        times=readings.times[kept] - zero,
        points=tuple(points for points, _ in placed),
        winds=tuple(winds for _, winds in placed),
        source=f"{cfg.source}: {', '.join(file.name for file in readings.files[:8])}"
        + (f" and {len(readings.files) - 8} more" if len(readings.files) > 8 else ""),
    )


def first_time(cfg: WindConfig) -> str | None:
    """The first time a source holds, ISO 8601 UTC; None where time does not matter (calm)."""
    if cfg.source == "calm":
        return None
    if cfg.source == "grib":
        return iso(grib.first_time(_files(cfg)))
    return iso(_read(cfg).times[0])


def ingest(cfg: WindConfig, ingest: IngestConfig, out: Path) -> Path:
    """Write ``ingest.points`` nodes of a geographic source as a table, and beside it where it came from.

    The nodes are the same at all times: those inside ``ingest.area`` that every time has, thinned by
    farthest-point sampling from the middle of the area. ``out.json`` names the source files by SHA-256.
    """
    readings = _read(cfg)
    if not readings.geographic:
        raise DataError(f"{readings.files[0]} has x,y columns; ingest expects latitude and longitude")
    kept = _between(readings, ingest)
    nodes = _common_nodes(readings, kept, ingest)
    winds = np.stack([_winds_at(readings, k, nodes) for k in kept])
    table.write(out, readings.times[kept], nodes, winds)
    text = json.dumps(_provenance(cfg, ingest, readings, kept, nodes), indent=1, ensure_ascii=False)
    write_text(out.with_suffix(".json"), text + "\n")
    return out


def _read(cfg: WindConfig) -> Readings:
    read = grib.read if cfg.source == "grib" else table.read
    return read(_files(cfg), cfg.max_speed)


def _files(cfg: WindConfig) -> tuple[Path, ...]:
    """The files that ``wind.path`` names: a file, all data files of a folder, or a pattern."""
    if cfg.source == "sample":
        return (SAMPLE,)
    path = Path(str(cfg.path)).expanduser()
    if path.is_dir():
        wanted = "*.csv" if cfg.source == "csv" else "*"
        found = [file for file in path.glob(wanted) if file.is_file() and _is_data(file)]
    elif path.is_file():
        found = [path]
    else:
        found = [Path(name) for name in glob.glob(str(path), recursive=True) if Path(name).is_file()]
    if not found:
        raise DataError(f"wind.path={cfg.path}: no {cfg.source} file, folder or pattern of that name")
    return tuple(sorted(found))


def _is_data(file: Path) -> bool:
    return not file.name.startswith(".") and file.suffix.lower() not in (".idx", ".md", ".txt", ".json")


def _refuse_other_frame(readings: Readings, scene: Scene) -> None:
    if readings.geographic and scene.crs is None:
        raise DataError(
            f"{readings.files[0].name} is in degrees but the scene lies nowhere on Earth; set scene.centre "
            "(latitude, longitude), or use wind.source=csv with columns time,x,y,u,v or wind.source=calm"
        )


def _departure(scene: Scene, readings: Readings) -> float:
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
    name = readings.files[0].name
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


def _place(cfg: WindConfig, scene: Scene, readings: Readings, k: int) -> tuple[FloatArray, FloatArray]:
    """Positions [m] and winds [m/s] in the plane, at most ``wind.max_points`` of time k."""
    points, winds = readings.points[k], readings.winds[k]
    reach = max(cfg.padding, float(np.max(scene.bounds[1] - scene.bounds[0])))
    if readings.geographic:
        points, winds = _project(str(scene.crs), scene.bounds.mean(axis=0), points, winds)
        reach = max(cfg.padding, NEAR)
    gap = _distance_to(scene.bounds, points)
    near = int(np.sum(gap <= reach))
    if near < ENOUGH:
        raise DataError(
            f"{readings.files[0].name}: {near} wind readings within {reach / 1e3:g} km of the scene at "
            f"{iso(readings.times[k])}, expected at least {ENOUGH}; is the scene where the wind data is?"
        )
    chosen = _thin(cfg, scene.bounds.mean(axis=0), points, gap)
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


def _thin(cfg: WindConfig, centre: FloatArray, points: FloatArray, gap: FloatArray) -> IntArray:
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


def _common_nodes(readings: Readings, kept: IntArray, ingest: IngestConfig) -> FloatArray:
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


def _winds_at(readings: Readings, k: int, nodes: FloatArray) -> FloatArray:
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
        "files": {file.name: file_fingerprint(file) for file in files},
    }


__all__ = ["first_time", "ingest", "observations"]
