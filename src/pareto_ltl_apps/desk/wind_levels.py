"""The wind at the levels of the files of a plan, at the places and times at which its map shows the wind."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, QhullError, cKDTree

from careful_io.times import seconds
from flight_quantities.levels import ALIKE, Level
from flight_quantities.medium import medium_of
from pareto_ltl import Readings, Scene, WindField
from pareto_ltl.extend import Frame, GeoBox, Wanted, WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.levels import wind_level
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.formats.wind_sources import SOURCES, levels_in_files
from pareto_ltl_apps.view.page.ground import rounded

MOST_LEVELS = 12  # that are read and shown, those nearest to the flight
AROUND = 150e3  # [m] around the places of the map, from which readings are taken
DIGITS = 2  # of speeds [m/s]


def wind_levels(
    folder: DeskFolder, cfg: WindConfig, scene: Scene, wind: WindField, shown: dict[str, Any]
) -> dict[str, Any]:
    """Levels of the files of ``cfg`` with the winds there, or why there is one level only.

    ``shown`` is the wind of the map (:func:`~pareto_ltl_apps.view.page.ground.shown_wind`); the winds of each
    level are linear between readings and between their times, at its places and times.

    Returns
    -------
    dict
        ``levels``: ``level``, ``height`` in the standard atmosphere, of a depth negative [m], whether it is
        the one that is ``flown``, and ``uv`` [time][place] to east and north [m/s]. ``said``: a sentence.

    Raises
    ------
    DataError, ConfigError
        If the files are not in the folder of the desk any more, or cannot be read.
    """
    flown = wind_level(wind.level)
    flow = medium_of(wind.level).flow
    one = f"The {flow} of this plan is known at one level, {flown.phrase}"
    if not cfg.path:
        return {"levels": [], "said": f"{one}: only that is read of this source."}
    own = replace(cfg, path=str(folder.root / folder.path_of("wind.path", cfg.path)))
    there = sorted(levels_in_files(own), key=lambda level: abs(level.standard_height - flown.standard_height))
    kept = sorted(there[:MOST_LEVELS], key=lambda level: level.standard_height)
    if len(kept) < 2:
        why = "the file has no other" if kept else "a table does not state levels; GRIB and NetCDF files do"
        return {"levels": [], "said": f"{one}: {why}."}
    places = np.array(shown["at"], float)
    wanted = Wanted(GeoBox.around(places).widened(AROUND))
    nearest = min(kept, key=lambda level: _apart(level, flown))
    rows = []
    for level in kept:
        readings = SOURCES[own.source].read(replace(own, level=level.text), wanted)
        uv = winds_at(readings, scene.frame, places, np.array(shown["t"], float))
        rows.append({
            "level": level.text,
            "height": round(level.standard_height, 1),
            "flown": level is nearest and _apart(level, flown) <= ALIKE,
            "uv": rounded(uv, DIGITS),
        })  # fmt: skip
    some = (
        f"{len(kept)} of its {len(there)} levels, those nearest to the flight"
        if len(there) > len(kept)
        else ""
    )
    return {"levels": rows, "said": f"The {flow} of the file, at {some}." if some else ""}


def _apart(one: Level, other: Level) -> float:
    """Relative difference of two levels; infinite between kinds that no common height joins."""
    if one.kind != other.kind:
        return np.inf
    return abs(one.value - other.value) / max(one.value, other.value, 1e-9)


def winds_at(readings: Readings, frame: Frame, places: FloatArray, times: FloatArray) -> FloatArray:
    """Winds (T, P, 2) [m/s] to east and north at ``places`` (P, 2) [deg] and ``times`` (T,) [s].

    Linear between the nodes of ``readings`` (in the plane of ``frame``) and between their times; outside of
    them, the nearest node, and the first or last time.
    """
    clock = readings.times - (readings.times[0] if frame.time_zero is None else seconds(frame.time_zero))
    at = np.asarray(frame.to_plane(*places.T), float).reshape(-1, 2)
    found = np.empty((len(clock), *places.shape))
    first, alike = (
        readings.points[0],
        [k for k, own in enumerate(readings.points) if _same(own, readings.points[0])],
    )
    found[alike] = _between(first, np.stack([readings.winds[k] for k in alike], axis=1), frame, at).swapaxes(
        0, 1
    )
    for k in sorted(set(range(len(clock))) - set(alike)):
        found[k] = _between(readings.points[k], readings.winds[k], frame, at)
    weights = np.array([np.interp(times, clock, slot) for slot in np.eye(len(clock))])  # (K, T)
    return np.asarray(np.tensordot(weights.T, found, 1), float)


def _same(one: FloatArray, other: FloatArray) -> bool:
    return one is other or np.array_equal(one, other)


def _between(points: FloatArray, winds: FloatArray, frame: Frame, at: FloatArray) -> FloatArray:
    """``winds`` (N, ..., 2) at ``points`` (N, 2) [deg], at ``at`` (P, 2) [m] of the plane: (P, ..., 2)."""
    nodes = np.asarray(frame.to_plane(*points.T), float).reshape(-1, 2)
    finite = np.isfinite(winds).reshape(len(winds), -1).all(axis=1)
    nodes, values = nodes[finite], winds[finite]
    near = values[cKDTree(nodes).query(at)[1]]
    try:
        inside = LinearNDInterpolator(Delaunay(nodes), values)(at)
    except (QhullError, ValueError):  # too few nodes, or all on a line
        return np.asarray(near, float)
    return np.where(np.isfinite(inside), inside, near)
