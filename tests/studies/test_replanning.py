"""A plan flown with and without new plans at fixes: same winds, and only safer plans are taken."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from pareto_ltl.cli.commands import run_command_line

SMALL = (
    "+experiment=phi2", "planner.trees=3", "planner.n_max=1000", "selection.draws=300", "selection.runs=500",
    "refine.flights=100", "refine.sweep_flights=60", "refine.points=4", "evaluation.jobs=1",
    "wind.max_points=40", "wind.modes_max=16",
)  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replanning") / "run"
    words = ("replanning", *SMALL, "replanning.flights=2", "replanning.every=8")
    assert run_command_line([*words, f"hydra.run.dir={folder}"]) == 0
    return folder


def test_both_ways_are_told_flight_by_flight(place: Path) -> None:
    with (place / "replanning_flights.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["flight"] for row in rows] == ["0", "1"]
    assert all(row["alone"] in "01" and row["replanned"] in "01" for row in rows)
    assert all(0 <= int(row["new_plans"]) <= 2 for row in rows)
    with (place / "replanning.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert float(row["failure"]) == sum(int(r["alone"]) for r in rows) / 2
    assert float(row["difference_low"]) <= float(row["difference"]) <= float(row["difference_high"])
    assert "true winds" in (place / "tables.md").read_text(encoding="utf-8")
