"""``release/waist.py``: what applications import from inside the planner may only become less."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def waist() -> ModuleType:
    spec = importlib.util.spec_from_file_location("waist", ROOT / "release" / "waist.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_names_from_inside_are_counted_and_public_ones_are_not(waist: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "report").mkdir()
    (tmp_path / "planning").mkdir()
    (tmp_path / "planning" / "one.py").write_text("from pareto_ltl.wind.records import Modes\n")
    (tmp_path / "report" / "one.py").write_text(
        "from pareto_ltl import Run\n"
        "from pareto_ltl.extend import record\n"
        "from pareto_ltl_apps.view.axes import Axes\n"
        "from pareto_ltl.support.errors import DataError\n"
        "from numpy import ndarray\n"
        "import pareto_ltl.world.cells\n"
        "def late():\n"
        "    from pareto_ltl.wind.records import Modes, WindField\n"
    )
    found = waist.imported(tmp_path)
    assert found == {"pareto_ltl.wind.records": {"Modes", "WindField"}, "pareto_ltl.world.cells": {"*"}}
    assert waist.counts(found) == {"names": 3, "modules": 2}


def test_a_number_that_rises_is_one_line_each_and_one_that_falls_is_none(waist: ModuleType) -> None:
    now = {"names": 3, "modules": 2}
    assert waist.problems(now, {"names": 3, "modules": 4}) == []
    (line,) = waist.problems(now, {"names": 2, "modules": 2})
    assert line.startswith("applications import 3 names from inside the planner, at most 2 are allowed")


def test_the_project_is_within_its_numbers(waist: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert waist.main([]) == 0, capsys.readouterr().err
