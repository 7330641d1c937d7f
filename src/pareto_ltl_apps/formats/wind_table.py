"""Extraction of a small table of readings from large wind files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from careful_io.files import write_text
from careful_io.fingerprints import file_fingerprint
from careful_io.times import iso, seconds
from flight_quantities.sphere import on_sphere
from pareto_ltl import Readings
from pareto_ltl.extend import WindConfig
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.levels import wind_level
from pareto_ltl.wind.observations import FEWEST_READINGS
from pareto_ltl_apps.formats.csv_files import write_csv_table
from pareto_ltl_apps.formats.settings import IngestConfig
from wind_laws.places import farthest_points, shared_nodes

NOAA = (
    "US National Oceanic and Atmospheric Administration (NOAA), public domain (17 U.S.C. 105); a selection, "
    "not an official NOAA product"
)
ECMWF = (
    "European Centre for Medium-Range Weather Forecasts (ECMWF), open data, CC BY 4.0 "
    "(https://creativecommons.org/licenses/by/4.0/); a selection"
)


def write_wind_table(cfg: WindConfig, readings: Readings, ingest: IngestConfig, out: Path) -> Path:
    """Write ``ingest.points`` nodes of a geographic source as a CSV table to ``out``; return ``out``.

    The nodes are the same at all times: nodes inside ``ingest.area`` that all times have, thinned by
    farthest-point sampling from the middle of the area. The origin of the data, with the SHA-256 of each
    source file, is written to ``out`` with the suffix .json.

    Raises
    ------
    ConfigError
        If ``out`` would replace a file that is read, or its folder does not exist.
    DataError
        If the source is planar, has no time in the interval, or has too few common nodes in the area.
    """
    _check_place(out, readings)
    if not len(readings.times):
        raise DataError(f"wind.source={cfg.source} holds no readings; ingest needs wind files (wind=grib)")
    if not readings.geographic:
        raise DataError(f"{readings.name} has x,y columns; ingest expects latitude and longitude")
    selected = _times_between(readings, ingest)
    nodes = common_nodes(readings, selected, ingest)
    winds = np.stack([readings.at_nodes(k, nodes) for k in selected])
    write_csv_table(out, readings.times[selected], nodes, winds, readings.leads[selected])
    text = json.dumps(_table_provenance(cfg, ingest, readings, selected, nodes), indent=1, ensure_ascii=False)
    write_text(out.with_suffix(".json"), text + "\n")
    return out


def _check_place(out: Path, readings: Readings) -> None:
    sources = {file.resolve() for file in readings.files}
    for path in (out, out.with_suffix(".json")):
        if path.resolve() in sources:
            raise ConfigError(f"ingest.out={out} would overwrite {path}, which is read; name another file")
    if not out.parent.is_dir():
        raise ConfigError(f"ingest.out={out}: there is no folder {out.parent}; make it, or name another file")


def _times_between(readings: Readings, ingest: IngestConfig) -> IntArray:
    """Indices of the times from ``ingest.first`` to ``ingest.last``."""
    first = -np.inf if ingest.first is None else seconds(ingest.first)
    last = np.inf if ingest.last is None else seconds(ingest.last)
    selected = np.flatnonzero((readings.times >= first) & (readings.times <= last))
    if not len(selected):
        period = f"{iso(readings.times[0])} .. {iso(readings.times[-1])}"
        raise DataError(f"no wind time between ingest.first and ingest.last; the source has {period}")
    return selected


def common_nodes(readings: Readings, kept: IntArray, ingest: IngestConfig) -> FloatArray:
    """Nodes (N, 2) [deg] in the area that all times ``kept`` have, thinned, sorted from north to south.

    DataError if there are too few.
    """
    import shapely

    nodes = np.unique(shared_nodes([readings.points[k] for k in kept]), axis=0)
    if ingest.area:
        nodes = nodes[shapely.contains_xy(shapely.Polygon(ingest.area), nodes)]
    if len(nodes) < FEWEST_READINGS:
        raise DataError(
            f"{len(nodes)} wind nodes lie in ingest.area at every time, expected at least {FEWEST_READINGS}; "
            "check the outline ([longitude, latitude], west negative) and that all files share one grid"
        )
    sphere = on_sphere(nodes)
    first = int(np.argmax(sphere @ sphere.mean(axis=0)))
    chosen = nodes[farthest_points(sphere, ingest.points, first)]
    return chosen[np.lexsort((chosen[:, 0], -chosen[:, 1]))]


def _table_provenance(
    cfg: WindConfig, ingest: IngestConfig, readings: Readings, kept: IntArray, nodes: FloatArray
) -> dict[str, object]:
    level = wind_level(readings.level).phrase
    files = {file: None for k in kept for file in readings.origins[k]}
    return {
        "columns": {
            "time": "valid time, ISO 8601 UTC",
            "lat, lon": "degrees, west negative",
            "u, v": f"wind towards east and north, earth-relative, {level}, m/s, rounded to 0.01",
        },
        "source": ECMWF if cfg.source in ("ifs", "aifs") else NOAA,
        "kind": cfg.source,
        "times": {iso(readings.times[k]): readings.remarks[k] for k in kept},
        "points": len(nodes),
        "selection": "the same nodes at all times: farthest-point sampling (great circle) of the nodes inside"
        " the area, from the one nearest to their middle; no interpolation",
        "area": ", ".join(f"{lon:g} {lat:g}" for lon, lat in ingest.area),
        "files": {file.name: file_fingerprint(file) for file in files},
    }
