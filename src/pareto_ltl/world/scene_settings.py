"""The scene of the settings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    pass
from pareto_ltl.world.scene_checks import checked_scene
from pareto_ltl.world.scene_files import sketch_file
from pareto_ltl.world.scene_sketch import (
    SceneSketch,
    numbered_outlines,
    read_bounds,
    read_outlines,
    read_start,
)


def scene_from_settings(cfg: SceneConfig, time_zero: str | None = None) -> Scene:
    """The map of ``cfg``, checked, in metres.

    Parameters
    ----------
    cfg : SceneConfig
        With ``file`` set, the file alone says where things are. Otherwise ``x = (coordinate - c) unit``,
        where c is the middle of the bounds if the map has a ``centre`` on Earth, and 0 if it has none.
    time_zero : str or None
        Departure, ISO 8601 UTC; None keeps what the file says.
    """
    sketch = sketch_file(Path(cfg.file).expanduser()) if cfg.file else _sketch_settings(cfg)
    scene = checked_scene(sketch)
    return replace(scene, time_zero=time_zero) if time_zero else scene


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
        regions=tuple(read_outlines(where, "region", cfg.regions.items(), metres)),
        obstacles=tuple(read_outlines(where, "obstacle", numbered_outlines(cfg.obstacles), metres)),
        show=show,
        crs=projection.local_plane(*cfg.centre) if cfg.centre is not None else None,
        landmarks=tuple(read_outlines(where, "landmark", numbered_outlines(cfg.landmarks), metres)),
    )
