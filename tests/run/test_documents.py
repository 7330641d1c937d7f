"""Experiments write JSON that fits the schemas, and their files can be read back."""

from __future__ import annotations

from pathlib import Path

import pytest

from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.resources import CONF
from pareto_ltl.support.schemas import SCHEMA_NAMES, read_document
from pareto_ltl_apps.cli.commands import run_command_line

SMALL = ("planner.trees=2", "planner.n_max=800", "deployment.runs=20", "report=none")
COMPILED_ALONE = {"phi1_feedback", "phi1_landmarks"}  # kernels that no other test needs: half a minute each


@pytest.mark.parametrize("experiment", sorted(set(CONF.names("experiment")) - COMPILED_ALONE))
def test_the_files_of_an_experiment_fit_their_schemas(experiment: str, tmp_path: Path) -> None:
    place = tmp_path / "run"
    assert run_command_line([f"+experiment={experiment}", *SMALL, f"hydra.run.dir={place}"]) == 0
    written = {path.stem for path in place.glob("*.json")}
    assert written == set(SCHEMA_NAMES) - {
        "sweep",
        "forecast_error",
        "forecast_error_2",
        "plan_1",
        "departures",
    }
    for name in written:
        assert read_document(place / f"{name}.json", name)
    results = Run.open(place)
    assert len(results.plan.path.u) == len(results.deployments["independent"].x[0]) - 1
    assert results.forest.trees
    assert len(results.front.paths) == results.metrics["front_size"]
    assert results.wind.times.size
    assert results.cells.cells
    assert results.settings.name == results.provenance["name"]
