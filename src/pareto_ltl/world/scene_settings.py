"""From the settings of section ``scene`` to a checked scene in metres."""

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
from pareto_ltl.world.scene_files import sketch_file
from pareto_ltl.world.scene_sketch import (
    DrawingRules,
    MissionUse,
    SceneSketch,
    numbered_outlines,
    read_bounds,
    read_places,
    read_start,
    read_timed,
    unknown_use,
)


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
        If ``file`` is set, the scene is that of the file. Otherwise positions are

            x = (coordinate - c) * unit

        with c the middle of the bounds if ``centre`` is set, else 0.
    time_zero : str or None
        Departure, ISO 8601 UTC; None keeps that of the file.
    border : str
        The value of ``cfg.border = auto`` if the map file has none.
    use : callable
        How the mission uses the regions, see :class:`DrawingRules`.

    Raises
    ------
    DataError
        If the scene is incomplete or inconsistent.
    """
    sketch = scene_sketch(cfg)
    known = (sketch.border or border) if cfg.border == "auto" else cfg.border
    simplify = cfg.simplify if isinstance(cfg.simplify, str) else float(cfg.simplify)
    scene = checked_scene(sketch, DrawingRules(use, simplify, cfg.altitude, known == "wall"))
    departure = time_zero or scene.time_zero
    windows = {place.name: place.window(sketch.where, departure) for place in sketch.timed}
    forbidden = tuple(place.name for place in sketch.timed if place.forbidden)
    return replace(scene, time_zero=departure, border=known, windows=windows, forbidden=forbidden)


def scene_sketch(cfg: SceneConfig) -> SceneSketch:
    """The map of ``cfg`` in metres, before the checks of the complete map; DataError if not readable."""
    return sketch_file(Path(cfg.file).expanduser()) if cfg.file else _sketch_settings(cfg)


def _sketch_settings(cfg: SceneConfig) -> SceneSketch:
    where = f"scene {cfg.name!r}"
    bounds = read_bounds(where, "scene.bounds", cfg.bounds)
    middle = bounds.mean(axis=0) if cfg.centre is not None else np.zeros(2)

    def metres(corners: FloatArray) -> FloatArray:
        scaled: FloatArray = (corners - middle) * cfg.unit
        return scaled

    def show(point: FloatArray) -> str:
        x, y = point / cfg.unit + middle
        return f"({x:.6g}, {y:.6g})"

    return SceneSketch(
        where=where,
        bounds=metres(bounds),
        start=metres(read_start(where, "scene.start", cfg.start)),
        regions=tuple(read_places(where, "region", cfg.regions.items(), metres)),
        obstacles=tuple(read_places(where, "obstacle", numbered_outlines(cfg.obstacles), metres)),
        show=show,
        crs=projection.local_plane(*cfg.centre) if cfg.centre is not None else None,
        landmarks=tuple(read_places(where, "landmark", numbered_outlines(cfg.landmarks), metres)),
        timed=tuple(read_timed(where, cfg.windows, cfg.regions)),
    )


__all__ = ["scene_from_settings", "scene_sketch"]
