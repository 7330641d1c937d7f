"""Obstacles keep the names that a map gives them, in any script, in texts and files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pareto_ltl.settings.mission import SceneConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_files import scene_from_dict, scene_to_dict
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl_apps.view.page.ground import shown_map

NAMES = ("EFKU CTR", "Päijänne", "Озеро", "湖", '<b>"x"</b>')


def square(lon: float, lat: float, side: float = 0.05) -> dict[str, Any]:
    corners = [[lon, lat], [lon + side, lat], [lon + side, lat + side], [lon, lat + side], [lon, lat]]
    return {"type": "Polygon", "coordinates": [corners]}


def feature(role: str, name: str | None, geometry: dict[str, Any]) -> dict[str, Any]:
    properties = {"role": role} | ({} if name is None else {"name": name})
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def map_with(*names: str | None) -> dict[str, Any]:
    obstacles = [feature("obstacle", name, square(24.2 + 0.1 * k, 61.5)) for k, name in enumerate(names)]
    start = feature("start", None, {"type": "Point", "coordinates": [24.0, 61.4]})
    region = feature("region", "a", square(24.9, 61.7))
    return {"type": "FeatureCollection", "features": [start, region, *obstacles]}


def read(tmp_path: Path, content: dict[str, Any]) -> Scene:
    path = tmp_path / "map.geojson"
    path.write_text(json.dumps(content), encoding="utf-8")
    return scene_from_settings(SceneConfig(name="map", file=str(path)))


def test_names_in_any_script_are_in_titles_scene_json_and_page(tmp_path: Path) -> None:
    scene = read(tmp_path, map_with(*NAMES, None))
    assert scene.obstacle_names == (*NAMES, "")
    assert scene.obstacle_title(2) == "obstacle 2 (Päijänne)"
    assert scene.obstacle_title(6) == scene.barrier_title("obstacle 6") == "obstacle 6"
    assert scene.barrier_title("obstacle 1") == "obstacle 1 (EFKU CTR)"
    for other in ("the eastern border", "obstacle 7", "obstacle x", "a forbidden region"):
        assert scene.barrier_title(other) == other
    again = scene_from_dict(json.loads(json.dumps(scene_to_dict(scene))))
    assert again.obstacle_names == scene.obstacle_names
    shown = [shape["name"] for shape in shown_map(scene)["shapes"] if shape["role"] == "obstacle"]
    assert shown == [scene.obstacle_title(number) for number in range(1, 7)]


def test_a_map_without_names_and_its_scene_json_stay_as_they_are(tmp_path: Path) -> None:
    for names in ((None, None), ("1", "2"), ("obstacle 1", "obstacle 2")):
        scene = read(tmp_path, map_with(*names))
        assert scene.obstacle_names == ()
        assert "obstacle_names" not in scene_to_dict(scene)


def test_an_exported_map_gives_the_same_names_again(tmp_path: Path) -> None:
    scene = read(tmp_path, map_with("EFKU CTR", None, "obstacle (old)", "7"))
    titles = [scene.obstacle_title(number) for number in range(1, 5)]
    assert read(tmp_path, map_with(*titles)).obstacle_names == scene.obstacle_names
    assert scene.obstacle_names == ("EFKU CTR", "", "obstacle (old)", "")


def test_scene_json_as_a_map_keeps_the_names(tmp_path: Path) -> None:
    scene = read(tmp_path, map_with("EFKU CTR", None))
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene_to_dict(scene)), encoding="utf-8")
    again = scene_from_settings(SceneConfig(name="map", file=str(path)))
    assert again.obstacle_names == scene.obstacle_names
    path.write_text(json.dumps(scene_to_dict(scene) | {"obstacle_names": ["EFKU CTR"]}), encoding="utf-8")
    with pytest.raises(DataError, match="1 obstacle_names for 2 obstacles"):
        scene_from_settings(SceneConfig(name="map", file=str(path)))


def test_names_belong_to_the_obstacles_in_several_parts(tmp_path: Path) -> None:
    content = map_with("lake", "hill")
    two = [square(24.2, 61.5)["coordinates"], square(24.2, 61.6)["coordinates"]]
    content["features"][2]["geometry"] = {"type": "MultiPolygon", "coordinates": two}
    assert read(tmp_path, content).obstacle_names == ("lake", "lake", "hill")


def test_as_many_names_as_obstacles() -> None:
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    scene = Scene(
        np.array([[0.0, 0.0], [9.0, 9.0]]), np.array([5.0, 5.0]), {"a": (corners + 6.0,)}, (corners,)
    )
    assert replace(scene, obstacle_names=("x",)).obstacle_title(1) == "obstacle 1 (x)"
    with pytest.raises(ValueError, match="2 obstacle_names for 1 obstacles"):
        replace(scene, obstacle_names=("x", "y"))
