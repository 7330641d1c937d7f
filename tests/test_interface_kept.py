"""What users build on is what ``interface.json`` describes (RELEASING.md, Deprecation)."""

from __future__ import annotations

import json

import pytest

from interface import KEPT, interface

ADVICE = "run python tests/interface.py after an addition; for another change see Deprecation in RELEASING.md"


@pytest.mark.parametrize("part", ["python", "commands", "settings", "files", "tables", "exports"])
def test_the_interface_is_the_one_that_is_declared(part: str) -> None:
    assert interface()[part] == json.loads(KEPT.read_text())[part], ADVICE


def test_a_renamed_setting_or_key_would_be_seen() -> None:
    kept = json.loads(KEPT.read_text())
    assert kept["settings"]["planner.n_max"] == "int"
    assert "/promise" in [key.rstrip("!") for key in kept["files"]["plan"]]
    assert kept["python"]["load_results"]
