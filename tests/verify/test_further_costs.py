"""Results whose fronts compare further costs: the checker derives these again, wherever they stand."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desk import SMALL
from pareto_ltl.extend import cost_named
from pareto_ltl.settings.planner import FURTHER_COSTS
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_verify.claims import front as claims
from pareto_ltl_verify.judge import verify
from pareto_ltl_verify.page_texts import COSTS

KEYS = {"plan.json": ("objectives", "turns"), "metrics.json": ("turns_deg",)}


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("costs") / "hop"
    words = ["plan", "+experiment=hop", *SMALL, f"selection.costs=[{','.join(FURTHER_COSTS)}]"]
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


def test_the_checker_has_every_cost_of_the_planner() -> None:
    """Without its number and text there, a cost counts as that of another package, and is not checked."""
    assert {*claims.FURTHER_COSTS} == {*FURTHER_COSTS}
    assert {*COSTS} == {*FURTHER_COSTS, "energy"}


@given(amount=st.floats(0.0, 1e9), name=st.sampled_from(sorted(COSTS)))
def test_amounts_are_written_as_the_planner_writes_them(amount: float, name: str) -> None:
    text, note = COSTS[name]
    assert (text(amount), note) == (cost_named(name).text(amount), cost_named(name).note)
