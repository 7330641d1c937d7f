"""A map with simplified outlines and a region of two parts: the judge knows what was drawn."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from large_maps import rough_disc
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import CLAIMS, findings, verify
from quick_wind import QUICK_WIND

MAP = "map: scene.json is the map of the settings"


def disc(east: float, north: float, radius: float, seed: int) -> list[list[float]]:
    """200 corners, in units of 100 km."""
    return (rough_disc(200, east, north, radius, 0.01, seed) / 1e3).tolist()


SCENE = {
    "name": "rough", "unit": 1e5, "centre": [37.0, -92.0], "bounds": [[0, 0], [10, 10]], "start": [1, 5],
    "regions": {
        "a": [[[7, 4], [9, 4], [9, 6], [7, 6]], [[7, 7], [9, 7], [9, 8], [7, 8]]],
        "b": disc(3, 8, 1.2, 1), "s": disc(4.2, 3, 1.2, 2),
    },
    "obstacles": [disc(7.8, 1.8, 1.0, 3)],
}  # fmt: skip
SMALL = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 2, "n_max": 1500, "max_steps": 80},
    "smoothing": {"candidates": 1, "weights": [1.0]},
    "wind": QUICK_WIND,
    "deployment": {"runs": 200},
    "report": "none",
}


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("simplified") / "run"
    rule = {"rule": "threshold", "alpha": 0.99}
    pareto_ltl.plan(SCENE, "F b & (!s U a)", fidelity="paper", selection=rule, out=place, **SMALL)
    return place


def test_an_honest_result_passes(honest: Path) -> None:
    assert [finding for finding in verify(honest) if not finding.holds] == []
    scene = json.loads((honest / "scene.json").read_text())
    assert 0 < scene["simplified"] <= 2000.0
    assert len(scene["regions"]["a"]) == 2
    assert max(len(scene["obstacles"][0]), len(scene["regions"]["s"]), len(scene["regions"]["b"])) < 60


def scaled(outline: list[Any], factor: float) -> list[Any]:
    corners = np.array(outline)
    return (corners.mean(axis=0) + factor * (corners - corners.mean(axis=0))).tolist()


def resized(kind: str, key: Any, factor: float) -> Callable[[dict[str, Any]], None]:
    def lie(scene: dict[str, Any]) -> None:
        scene[kind][key] = scaled(scene[kind][key], factor)

    return lie


@pytest.mark.parametrize(
    "lie",
    [
        resized("obstacles", 0, 0.97), resized("obstacles", 0, 1.1), resized("regions", "b", 1.05),
        resized("regions", "b", 0.9), resized("regions", "s", 0.95), resized("regions", "s", 1.1),
        lambda scene: scene["regions"]["a"].pop(), lambda scene: scene.update(simplified=1e5),
    ],
)  # fmt: skip
def test_outlines_on_the_careless_side_or_too_far_away_are_caught(
    lie: Callable[[dict[str, Any]], None], honest: Path, tmp_path: Path
) -> None:
    place = tmp_path / "lie"
    shutil.copytree(honest, place)
    scene = json.loads((place / "scene.json").read_text())
    lie(scene)
    (place / "scene.json").write_text(json.dumps(scene))
    claim = next(claim for claim in CLAIMS if claim.name == MAP)
    (finding,) = findings(open_evidence(place), [claim])
    assert not finding.holds
