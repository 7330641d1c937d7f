"""Results whose fronts compare further costs: the checker derives these again, wherever they stand."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from desk import SMALL
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_verify.judge import verify

KEYS = {"plan.json": ("objectives", "turns"), "metrics.json": ("turns_deg",)}


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("costs") / "hop"
    words = ["plan", "+experiment=hop", *SMALL, "selection.costs=[duration,turns,containment]"]
    words += ["selection=least", "selection.least=turns", "selection.alpha=0.9", "exports=none"]
    words.append(f"hydra.run.dir={place}")
    assert run_command_line(words) == 0
    return place


def broken_claims(place: Path) -> list[str]:
    return [finding.claim for finding in verify(place) if not finding.holds]


def test_an_honest_result_with_further_costs_is_accepted(planned: Path) -> None:
    assert broken_claims(planned) == []


@pytest.mark.parametrize("name", KEYS)
def test_a_further_cost_that_was_changed_is_found(name: str, planned: Path) -> None:
    before = (planned / name).read_bytes()
    document = json.loads(before)
    *outer, last = KEYS[name]
    part = document
    for key in outer:
        part = part[key]
    part[last] += 5.0
    (planned / name).write_text(json.dumps(document))
    try:
        assert broken_claims(planned) != []
    finally:
        (planned / name).write_bytes(before)
