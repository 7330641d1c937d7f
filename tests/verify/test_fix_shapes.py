"""Landmarks whose fixes have a shape: the claims of a plan that uses them, and lies about it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import pareto_ltl
from pareto_ltl.settings import Settings
from pareto_ltl_verify.claims import world
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import verify
from quick_wind import QUICK_WIND

MARKS = [
    {"corners": [[0.6, 6.5], [3.1, 6.5], [3.1, 9.4], [0.6, 9.4]], "fix": {"sd": 400}},
    {"corners": [[7.0, 6.9], [9.6, 6.9], [9.6, 7.9], [7.0, 7.9]], "fix": {"along": 60e3, "across": 300}},
]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("made") / "fixes"
    scene = Settings.of_section("scene", "phi1")
    pareto_ltl.plan(
        replace(scene, landmarks=MARKS),
        "F(a & F b)",
        fidelity="full",
        out=place,
        robot={"dt": 1800.0},
        planner={"trees": 2, "n_max": 1500, "max_steps": 80},
        refine={"flights": 60, "sweep_flights": 20, "classes": 1, "points": 4},
        selection={"draws": 300, "runs": 2000},
        wind=QUICK_WIND,
        deployment={"runs": 200},
        report="none",
    )
    return place


def test_the_claims_of_a_plan_with_a_line_of_position_hold(made: Path) -> None:
    fixes = json.loads((made / "scene.json").read_text())["landmark_fixes"]
    assert fixes == [{"sd": 400.0}, {"along": 60e3, "across": 300.0, "bearing": pytest.approx(90.0)}]
    assert json.loads((made / "plan.json").read_text())["fixes"]
    assert not [finding for finding in verify(made) if not finding.holds]


@pytest.mark.parametrize("lie", [None, [None, None], [{"sd": 400}, {"sd": 300}], [{"sd": 4}]])
def test_another_error_of_fixes_than_that_of_the_settings_is_caught(made: Path, lie: Any) -> None:
    file = made / "scene.json"
    honest = file.read_text()
    told = json.loads(honest)
    told["landmark_fixes"] = lie
    try:
        file.write_text(json.dumps(told if lie else {k: v for k, v in told.items() if k != "landmark_fixes"}))
        verdict = world.drawn_map(open_evidence(made))
    finally:
        file.write_text(honest)
    assert verdict is not None
    assert "fix" in verdict.derived
    assert not verdict.holds
