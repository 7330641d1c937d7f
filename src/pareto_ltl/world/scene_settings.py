"""Turns the settings of section ``scene`` into a checked scene in metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_checks import checked_scene
from pareto_ltl.world.scene_faults import MapFaults
from pareto_ltl.world.scene_files import sketch_file
from pareto_ltl.world.scene_sketch import (
    DrawingRules,
    MissionUse,
    SceneSketch,
    numbered_outlines,
    read_bounds,
    read_landmarks,
    read_places,
    read_start,
    read_timed,
    unknown_use,
)
from pareto_ltl.world.windows import TimedPlace


def scene_from_settings(
    cfg: SceneConfig,
    time_zero: str | None = None,
    border: str = "open",
    use: Callable[[], MissionUse | None] = unknown_use,
) -> Scene:
    """The checked scene of ``cfg``, in metres.

    Parameters
    ----------
    cfg : SceneConfig
        If ``file`` is set, the scene is read from the file. Otherwise positions are

            x = (coordinate - c) * unit

        with c the middle of the bounds if ``centre`` is set, else 0.
    time_zero : str or None
        Departure, ISO 8601 UTC; None keeps the departure of the file.
    border : str
        The value of ``cfg.border = auto`` if the map file has none.
    use : callable
        How the mission uses the regions, see :class:`DrawingRules`.

    Raises
    ------
    DataError
        If the scene is incomplete or inconsistent.
    """
    sketch = _sketch(cfg)
    known = (sketch.border or border) if cfg.border == "auto" else cfg.border
    simplify = cfg.simplify if isinstance(cfg.simplify, str) else float(cfg.simplify)
    departure, faults = time_zero or sketch.time_zero, MapFaults(sketch.where, sketch.faults)
    times = faults.each(sketch.timed, lambda place: place.window(sketch.where, departure))
    windows = {place.name: window for place, window in times}
    sketch = replace(sketch, faults=tuple(faults.texts))
    scene = checked_scene(sketch, DrawingRules(use, simplify, cfg.altitude, known == "wall"))
    forbidden = tuple(place.name for place in sketch.timed if place.forbidden)
    return replace(scene, time_zero=departure, border=known, windows=windows, forbidden=forbidden)


def scene_sketch(cfg: SceneConfig) -> SceneSketch:
    """The map of ``cfg`` in metres, before the checks of the complete map; DataError if not readable."""
    sketch = _sketch(cfg)
    MapFaults(sketch.where, sketch.faults).refuse()
    return sketch


def _sketch(cfg: SceneConfig) -> SceneSketch:
    return sketch_file(Path(cfg.file).expanduser()) if cfg.file else _sketch_settings(cfg)


def _sketch_settings(cfg: SceneConfig) -> SceneSketch:
    where = f"scene {cfg.name!r}"
    faults = MapFaults(where)
    bounds = [got for _, got in faults.each([cfg.bounds], lambda v: read_bounds(where, "scene.bounds", v))]
    starts = [got for _, got in faults.each([cfg.start], lambda v: read_start(where, "scene.start", v))]
    middle = bounds[0].mean(axis=0) if bounds and cfg.centre is not None else np.zeros(2)

    def metres(corners: FloatArray) -> FloatArray:
        scaled: FloatArray = (corners - middle) * cfg.unit
        return scaled

    def show(point: FloatArray) -> str:
        x, y = point / cfg.unit + middle
        return f"({x:.6g}, {y:.6g})"

    regions = read_places(faults, "region", cfg.regions.items(), metres)
    obstacles = read_places(faults, "obstacle", numbered_outlines(cfg.obstacles), metres)
    landmarks = read_landmarks(faults, cfg.landmarks, (), metres)
    timed: list[TimedPlace] = []
    with faults.noted():
        timed += read_timed(where, cfg.windows, cfg.regions)
    if not bounds:
        faults.refuse()
    return SceneSketch(
        where=where,
        bounds=metres(bounds[0]),
        start=metres(starts[0]) if starts else np.zeros(0),
        regions=regions,
        obstacles=obstacles,
        show=show,
        crs=projection.local_plane(*cfg.centre) if cfg.centre is not None else None,
        landmarks=landmarks,
        timed=tuple(timed),
        faults=tuple(faults.texts),
    )
