"""Reading and decomposing the maps of the package (phi2: 50 ms) and maps with hundreds of obstacles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from pareto_ltl.settings import SceneConfig
from pareto_ltl.world import cells as workspace
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_settings import scene_from_settings

SCENES = Path(__file__).parents[1] / "conf" / "scene"


def shipped(name: str) -> Scene:
    return scene_from_settings(SceneConfig(**yaml.safe_load((SCENES / f"{name}.yaml").read_text())))


def crowded(side: int) -> Scene:
    """``side`` x ``side`` hexagons of random size on a square grid; the last one is the region."""
    rng = np.random.default_rng(7)
    angles = np.arange(6) * np.pi / 3
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    centres = [(x + 0.5, y + 0.5) for x in range(side) for y in range(side)]
    hexagons = [np.array(c) + rng.uniform(0.1, 0.45) * circle for c in centres]
    bounds = np.array([[0.0, 0.0], [side, side]])
    return Scene(bounds, np.array([0.01, 0.01]), {"a": hexagons[-1]}, tuple(hexagons[:-1]))


@pytest.mark.parametrize("name", ["phi1", "phi2"])
def test_read_a_shipped_map(benchmark, name):
    cfg = SceneConfig(**yaml.safe_load((SCENES / f"{name}.yaml").read_text()))
    benchmark(scene_from_settings, cfg)


@pytest.mark.parametrize("name", ["phi1", "phi2"])
def test_decompose_a_shipped_map(benchmark, name):
    made = benchmark(workspace.decompose, shipped(name))
    benchmark.extra_info |= {"cells": len(made.cells), "doors": len(made.doors)}


@pytest.mark.parametrize("side", [10, 20])
def test_decompose_a_crowded_map(benchmark, side):
    made = benchmark.pedantic(workspace.decompose, (crowded(side),), rounds=3, warmup_rounds=1)
    benchmark.extra_info |= {"cells": len(made.cells), "doors": len(made.doors)}


def test_build_a_locator(benchmark):
    scene = shipped("phi2")
    benchmark(workspace.bucket_cells, workspace.decompose(scene), scene.bounds)


def test_locate_ten_thousand_points_in_numpy(benchmark):
    scene = shipped("phi2")
    points = np.random.default_rng(0).uniform(*scene.bounds, (10_000, 2))
    benchmark(workspace.cells_of_points, workspace.decompose(scene), points)
